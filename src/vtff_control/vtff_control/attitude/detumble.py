"""Detumbling without attitude: B-dot, and the Y-Thomson spin from magnetometer samples.

The field turns in the body as the body turns in the field: its rate of change is w x B but for the
turn of the field along the orbit (0.002 rad/s), so it shows the rates across the field.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.vectors import FloatArray, cross, norm

__all__ = ["FieldMotion", "ThomsonGains", "b_dot_moment", "field_motion", "thomson_moment"]


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


def b_dot_moment(motion: FieldMotion, gain: float) -> FloatArray:
    """Return the moment against the rates across the field, A m2, shape (3,).

    Parameters
    ----------
    motion : FieldMotion
    gain : float
        Torque over rate across the field, N m s.

    References
    ----------
    Stickler and Alfriend (1976), Elementary magnetic attitude control system, J. Spacecraft 13(5).
    """
    square = float(motion.field_body @ motion.field_body)
    moment: FloatArray = -gain / square * motion.field_rate_body
    return moment


@dataclass(frozen=True)
class ThomsonGains:
    """Gains of the Y-Thomson controller.

    Parameters
    ----------
    nutation : float
        Moment of the y rod over the rate of the angle between y and the field, A m2 s.
    spin : float
        Moment of the x or z rod over the error of the spin, A m2 s.
    """

    nutation: float = 40.0
    spin: float = 20.0


def thomson_moment(motion: FieldMotion, spin_reference: float, gains: ThomsonGains) -> FloatArray:
    """Return the moment that leaves a spin about y alone, at its reference, A m2, shape (3,).

    The y rod damps what is not a spin about y; of x and z, the rod across the larger part of the
    field in the x-z plane changes the spin. The spin axis then goes to the orbit normal by itself.

    References
    ----------
    Thomson (1962), Spin stabilization of attitude against gravity torque, J. Astronaut. Sci. 9;
    Steyn and Hashida (1999), An attitude control system for a low-cost Earth observation satellite
    with orbit maintenance capability, AIAA/USU conference, SSC99-XI-4.
    """
    moment = np.zeros(3)
    moment[1] = gains.nutation * motion.cone_rate
    error = motion.spin_y - spin_reference
    x, _, z = motion.field_body
    # Torque about y is M_z B_x - M_x B_z.
    if abs(z) >= abs(x):
        moment[0] = gains.spin * error * math.copysign(1.0, z)
    else:
        moment[2] = -gains.spin * error * math.copysign(1.0, x)
    return moment
