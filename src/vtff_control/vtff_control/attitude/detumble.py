"""Detumbling without attitude: B-dot, and the Y-Thomson spin from magnetometer samples."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.attitude.field_motion import FieldMotion
from vtff_dynamics.vectors import FloatArray

__all__ = ["ThomsonGains", "b_dot_moment", "thomson_moment"]


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
