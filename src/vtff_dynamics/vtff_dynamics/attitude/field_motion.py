"""Motion of the magnetic field in the body, from two samples of a magnetometer.

The field turns in the body as the body turns in the field: its rate of change is w x B but for the
turn of the field along the orbit (0.002 rad/s), so it shows the rates across the field.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.vectors import FloatArray, cross, norm

__all__ = ["FieldMotion", "field_motion"]


@dataclass(frozen=True)
class FieldMotion:
    """The field and its motion in the body.

    Attributes
    ----------
    field_body
        T, shape (3,).
    field_rate_body
        T/s, shape (3,).
    spin_y
        Rate of the body about y from the turn of the field in the x-z plane, rad/s.
    cone_rate
        Rate of the angle between y and the field, rad/s.
    """

    field_body: FloatArray
    field_rate_body: FloatArray
    spin_y: float
    cone_rate: float

    @property
    def rate_across(self) -> float:
        """Rate of the body across the field, rad/s."""
        return norm(cross(self.field_body, self.field_rate_body)) / norm(self.field_body) ** 2


def field_motion(earlier: FloatArray, later: FloatArray, interval: float) -> FieldMotion:
    """Return field and motion from two samples.

    Parameters
    ----------
    earlier, later : ndarray, shape (3,)
        Samples of the magnetometer, T; the body turns by less than half a turn between them.
    interval : float
        Time between them, s.
    """
    axis = cross(earlier, later)
    sine = norm(axis)
    cosine = float(earlier @ later)
    angle = math.atan2(sine, cosine)
    # The chord is too short for fast turns: the field turns about the axis by the angle.
    turn_rate = axis / sine * angle / interval if sine > 0.0 else np.zeros(3)
    rate = cross(turn_rate, later)

    def plane_angle(field: FloatArray) -> float:
        return math.atan2(field[0], field[2])

    def cone(field: FloatArray) -> float:
        return math.acos(max(-1.0, min(1.0, field[1] / norm(field))))

    # A body that turns positively about y sees the field turn from x to z, backwards.
    change = math.remainder(plane_angle(later) - plane_angle(earlier), 2.0 * math.pi)
    return FieldMotion(later, rate, -change / interval, (cone(later) - cone(earlier)) / interval)
