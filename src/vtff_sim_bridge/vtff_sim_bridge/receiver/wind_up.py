"""Carrier phase wind-up: a circularly polarised antenna that turns counts its own turns."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vtff_dynamics.constants import EARTH_ROTATION_RATE
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.orbits.line_of_sight import LineOfSight

__all__ = ["WindUp", "wind_up_cycles"]

_EARTH_ROTATION = np.array([0.0, 0.0, EARTH_ROTATION_RATE])


def wind_up_cycles(line_of_sight: LineOfSight, body_axes_itrf: FloatArray) -> FloatArray:
    """Return the wind-up between satellites and a receiver, cycles in [-0.5, 0.5], shape (k, n).

    Parameters
    ----------
    line_of_sight : LineOfSight
        Shape (k, n).
    body_axes_itrf : ndarray, shape (k, 3, 3)
        Rows are the x, y and z axes of the body; the boresight of the antenna is -z.

    Notes
    -----
    Wu and others (1993), Effects of antenna orientation on GPS carrier phase, Manuscripta
    Geodaetica 18:91. The axes of the satellites are those of their orbits (z to the centre of the
    Earth, x forward); their turns towards the Sun are the same for all receivers near each other.
    """
    to_receiver = -line_of_sight.direction_itrf
    position = line_of_sight.position_satellite_itrf
    velocity = line_of_sight.velocity_satellite_itrf + np.cross(_EARTH_ROTATION, position)
    down = -position / np.linalg.norm(position, axis=-1, keepdims=True)
    side = np.cross(down, velocity)
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    satellite = _dipole(to_receiver, np.cross(side, down), -side)
    # x, and the third axis of a right-handed system with the boresight, which is -z: -y.
    axis_x, axis_y = body_axes_itrf[:, None, 0], -body_axes_itrf[:, None, 1]
    receiver = _dipole(to_receiver, axis_x, axis_y)
    sine = np.einsum("kni,kni->kn", to_receiver, np.cross(satellite, receiver))
    cosine = np.einsum("kni,kni->kn", satellite, receiver)
    return np.asarray(np.arctan2(sine, cosine) / (2.0 * math.pi))


def _dipole(to_receiver: FloatArray, axis_x: FloatArray, axis_y: FloatArray) -> FloatArray:
    """Return the effective dipole x - k (k x) + k x y of crossed dipoles along x and y."""
    along = np.einsum("...i,...i->...", to_receiver, axis_x)[..., None]
    return np.asarray(axis_x - to_receiver * along + np.cross(to_receiver, axis_y))


class WindUp:
    """Wind-up of the satellites of one receiver, without jumps while they are in the sky."""

    def __init__(self) -> None:
        self._last: dict[tuple[int, int], float] = {}

    def second(
        self,
        line_of_sight: LineOfSight,
        body_axes_itrf: FloatArray,
        satellites: Sequence[tuple[int, int]],
        emitted: slice,
    ) -> FloatArray:
        """Return the wind-up at the epochs of a second, cycles, shape (k, n).

        Only epochs that are `emitted` lead the count on. A new satellite begins within half a
        cycle.
        """
        cycles = wind_up_cycles(line_of_sight, body_axes_itrf)
        last = np.array([self._last.get(key, math.nan) for key in satellites])
        for index in range(*emitted.indices(len(cycles))):
            turns = np.round(last - cycles[index])
            cycles[index] += np.where(np.isnan(turns), 0.0, turns)
            last = cycles[index]
        self._last = dict(zip(satellites, last.tolist(), strict=True))
        return cycles
