"""Contents that a density profile with its gradients lets expect of further rays.

A satellite that has just risen has hardly been measured by its codes, while the contents of the
others tell the ionosphere that its ray passes (`vtff_iono.bias.profile_bias`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_iono.bias.altitude_shells import shell_middles, shell_paths, vertical_paths
from vtff_iono.geometry.mapping import pierce_point, shell_height

__all__ = ["GRADIENT_UNIT", "ExpectedContents", "Knots", "pierce_offsets"]

GRADIENT_UNIT = 1e6
"""Unit of the distance of pierce points, m."""

# Longest interval of knots, s, and their largest number.
_KNOT_INTERVAL = 300.0
_MOST_KNOTS = 36
# By how much a profile is continued downwards, and the part of it that tells how, m.
_CONTINUED, _LOWEST_PART = 100e3, 50e3


class Knots(NamedTuple):
    """Evenly spaced times, linear in between.

    Attributes
    ----------
    begin, interval : float
        Time of the first knot, and the time from each to the next, s.
    number : int
    """

    begin: float
    interval: float
    number: int

    @classmethod
    def over(cls, time: FloatArray) -> Knots:
        """Return knots from the first to the last time (s), each 300 s or less, up to 36."""
        span = max(float(np.ptp(time)), 1.0)
        intervals = min(math.ceil(span / _KNOT_INTERVAL), _MOST_KNOTS - 1)
        return cls(float(time.min()), span / intervals, intervals + 1)

    def weights(self, time: FloatArray) -> FloatArray:
        """Return the weights of the knots at times (n,), s, shape (n, knots).

        Their sum is one between the first and the last knot. It falls to zero within an interval
        after the last one: nothing is known of the next one, whose expectation is zero.
        """
        position = (time - self.begin) / self.interval
        distance = np.abs(position[:, np.newaxis] - np.arange(self.number))
        return np.asarray(np.maximum(0.0, 1.0 - distance))


@dataclass(frozen=True, eq=False)
class ExpectedContents:
    """Contents of rays by a profile.

    Parameters
    ----------
    edges : ndarray, shape (shells + 1,)
        Edges of the shells of the profile, m.
    density : ndarray, shape (shells,)
        Density of the shells, electrons per cubic metre.
    knots : Knots
    vertical_tecu : ndarray, shape (3 knots,)
        Vertical contents that the shells lack at the knots, TECU; then their gradients to the east
        and to the north, TECU per 1000 km.
    arc_sigma : float
        Sigma of what is particular to an arc, relative to its content.
    """

    edges: FloatArray
    density: FloatArray
    knots: Knots
    vertical_tecu: FloatArray
    arc_sigma: float

    def continued_below(self) -> ExpectedContents:
        """Return the contents of receivers that may fall below the profile, by 100 km at most.

        The density there continues the exponential through the lowest 50 km.
        """
        middle, step = shell_middles(self.edges), self.edges[1] - self.edges[0]
        below = step * np.arange(-math.ceil(_CONTINUED / step), 0)
        lowest = middle < self.edges[0] + _LOWEST_PART
        line = np.polyfit(middle[lowest], np.log(self.density[lowest]), 1)
        density = np.exp(np.polyval(line, middle[0] + below))
        return replace(
            self,
            edges=np.concatenate((self.edges[0] + below, self.edges)),
            density=np.concatenate((density, self.density)),
        )

    def contents(
        self, time: FloatArray, position_receiver_itrf: FloatArray, direction_itrf: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return slant contents, TECU, and slant over vertical contents, shape (n,).

        Parameters
        ----------
        time : ndarray, shape (n,)
            s, counted as that of the samples of the profile.
        position_receiver_itrf, direction_itrf : ndarray, shape (n, 3)
            Positions of the receiver, m, and unit vectors to satellites above the horizon.
        """
        altitude = geodetic_from_itrf(position_receiver_itrf)[:, 2]
        paths = shell_paths(position_receiver_itrf, direction_itrf, altitude, self.edges)
        content = paths @ self.density
        vertical = vertical_paths(altitude, self.edges) @ self.density
        offset = pierce_offsets(position_receiver_itrf, direction_itrf, altitude)
        weights = self.knots.weights(time)
        factors = np.hstack((weights, weights * offset[:, :1], weights * offset[:, 1:]))
        mapping = content / vertical
        return content + mapping * (factors @ self.vertical_tecu), mapping


def pierce_offsets(
    position_receiver_itrf: FloatArray, direction_itrf: FloatArray, altitude: FloatArray
) -> FloatArray:
    """Return the offsets of pierce points from receivers to the east and north, 1000 km, (n, 2).

    Parameters
    ----------
    position_receiver_itrf, direction_itrf : ndarray, shape (n, 3)
        Positions of the receivers, m, and unit vectors to satellites above the horizon.
    altitude : ndarray, shape (n,)
        Altitudes of the receivers, m. Rays pierce the middle of the shell above.
    """
    receiver = position_receiver_itrf
    point = pierce_point(receiver, direction_itrf, altitude + 0.5 * shell_height(altitude))
    offset = (point - receiver) / GRADIENT_UNIT
    east = np.cross([0.0, 0.0, 1.0], receiver)
    east /= np.linalg.norm(east, axis=-1, keepdims=True)
    north = np.cross(receiver, east)
    north /= np.linalg.norm(north, axis=-1, keepdims=True)
    columns = (offset * east).sum(axis=-1), (offset * north).sum(axis=-1)
    return np.asarray(np.stack(columns, axis=-1))
