"""Carrier phase wind-up: a circularly polarised antenna that turns counts its own turns."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vtff_dynamics.vectors import FloatArray
from vtff_gnss import wind_up
from vtff_gnss.orbits.line_of_sight import LineOfSight

__all__ = ["WindUp", "wind_up_cycles"]


def wind_up_cycles(line_of_sight: LineOfSight, body_axes_itrf: FloatArray) -> FloatArray:
    """Return the wind-up between satellites and a receiver, cycles in [-0.5, 0.5], shape (k, n).

    It is that of `vtff_gnss.wind_up`.

    Parameters
    ----------
    line_of_sight : LineOfSight
        Shape (k, n).
    body_axes_itrf : ndarray, shape (k, 3, 3)
        Rows are the x, y and z axes of the body; the boresight of the antenna is -z.
    """
    # x, and the third axis of a right-handed system with the boresight, which is -z: -y.
    axis_x, axis_y = body_axes_itrf[:, None, 0], -body_axes_itrf[:, None, 1]
    return wind_up.wind_up_cycles(
        line_of_sight.direction_itrf,
        line_of_sight.position_satellite_itrf,
        line_of_sight.velocity_satellite_itrf,
        axis_x,
        axis_y,
    )


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
