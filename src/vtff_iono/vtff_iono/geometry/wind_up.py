"""Carrier-phase wind-up of an upright antenna: the turns that its phases count.

The signals of GNSS are circularly polarised. Their phase counts how an antenna turns against that
of the satellite (`vtff_gnss.wind_up`): about its own axis, and as the ray moves over both. A cycle
is the same on both frequencies, but not the same length, and looks like 0.51 TECU with GPS L1 and
L2.

A turn of an antenna about its own axis adds the same cycles to all rays. Hence it hardly matters
which horizontal axis the receiver is taken to have, as long as it does not spin: what its heading
changes by is common to all satellites.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray
from vtff_gnss import wind_up
from vtff_gnss.orbits.line_of_sight import ellipsoid_normal
from vtff_iono.geometry.mapping import distinct_positions

__all__ = ["WindUpCounter", "count_wind_up", "wind_up_cycles"]


def wind_up_cycles(
    position_receiver_itrf: FloatArray,
    direction_itrf: FloatArray,
    range_satellite: FloatArray,
    velocity_satellite_itrf: FloatArray,
) -> FloatArray:
    """Return the wind-up of rays, cycles in [-0.5, 0.5], shape (n,); NaN without a direction.

    The antenna of the receiver looks to the zenith and has its axes to the north and east. The
    satellite looks down, with its axes along its orbit and across it; by how much its turns
    towards the Sun differ from that is not known here.

    Parameters
    ----------
    position_receiver_itrf, direction_itrf : ndarray, shape (n, 3)
        Positions of the receiver, m, and unit vectors to the satellites.
    range_satellite : ndarray, shape (n,)
        Distances of the satellites, m.
    velocity_satellite_itrf : ndarray, shape (n, 3)
        Velocities of the satellites as seen from the Earth, m/s.
    """
    satellite = position_receiver_itrf + range_satellite[:, np.newaxis] * direction_itrf
    positions, number = distinct_positions(position_receiver_itrf)
    up = ellipsoid_normal(positions)
    east = np.cross((0.0, 0.0, 1.0), up)
    east /= np.linalg.norm(east, axis=-1, keepdims=True)
    north, west = np.cross(up, east)[number], -east[number]
    return wind_up.wind_up_cycles(direction_itrf, satellite, velocity_satellite_itrf, north, west)


def count_wind_up(arc: npt.NDArray[np.int64], cycles: FloatArray) -> FloatArray:
    """Return the cycles since arcs began, without jumps, shape (n,); zero where `cycles` is NaN.

    Parameters
    ----------
    arc : ndarray of int64, shape (n,)
        Number of the arc of each row; the rows of an arc are in order of time.
    cycles : ndarray, shape (n,)
        See `wind_up_cycles`.
    """
    result = np.zeros(len(cycles))
    known = np.flatnonzero(np.isfinite(cycles))
    if not len(known):
        return result
    order = known[np.argsort(arc[known], kind="stable")]
    is_first = np.diff(arc[order], prepend=arc[order[0]] - 1) != 0
    steps = np.diff(cycles[order], prepend=0.0)
    steps = np.where(is_first, 0.0, steps - np.round(steps))
    total = np.cumsum(steps)
    first = np.flatnonzero(is_first)
    result[order] = total - np.repeat(total[first], np.diff(first, append=len(order)))
    return result


class WindUpCounter:
    """Wind-up of the arcs of one receiver since they began, without jumps, epoch by epoch."""

    def __init__(self) -> None:
        # By link: number of the arc, and the cycles at its first and at its latest epoch.
        self._arcs = np.zeros(0, dtype=np.int64)
        self._cycles = np.zeros((2, 0))

    def count(
        self, link: npt.NDArray[np.int64], arc: npt.NDArray[np.int64], cycles: FloatArray
    ) -> FloatArray:
        """Return the cycles of rows in order of time since their arcs began, shape (n,).

        Rows with NaN as `cycles` count nothing, and have zero.
        """
        new = int(link.max(initial=-1)) + 1 - len(self._arcs)
        if new > 0:
            self._arcs = np.append(self._arcs, np.zeros(new, dtype=np.int64))
            self._cycles = np.hstack((self._cycles, np.full((2, new), np.nan)))
        counted: FloatArray = _count_cycles(link, arc, cycles, self._arcs, self._cycles)
        return counted


@compiled
def _count_cycles(link, arc, cycles, arcs, of_arcs):  # type: ignore[no-untyped-def]
    """Return the cycles of rows (n,) since their arcs began, of which the latest are kept in place.

    `arcs` (links,) are the numbers of the arcs, `of_arcs` (2, links) the cycles at their first and
    at their latest epochs, NaN before the first arc of a link.
    """
    counted = np.zeros(len(cycles))
    for row in range(len(cycles)):
        number, now = link[row], cycles[row]
        if not math.isfinite(now):
            continue
        if arcs[number] != arc[row] or math.isnan(of_arcs[1, number]):
            arcs[number] = arc[row]
            of_arcs[0, number] = of_arcs[1, number] = now
        of_arcs[1, number] = now + np.rint(of_arcs[1, number] - now)
        counted[row] = of_arcs[1, number] - of_arcs[0, number]
    return counted
