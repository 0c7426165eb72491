"""A dipole in the field as a spherical pendulum: how far it swings from a state of motion."""

from __future__ import annotations

import math

from scipy.optimize import brentq

from vtff_dynamics.vectors import FloatArray, cross, norm

__all__ = ["swing_peak"]


def swing_peak(
    direction: FloatArray,
    rate: FloatArray,
    field: FloatArray,
    dipole_strength: float,
    inertia: float,
) -> float:
    """Return the largest angle between a dipole and a constant field, rad.

    Energy and the angular momentum about the field are kept:
    E = I v^2 / 2 + m B (1 - cos a), L = I b . (d x v); at the peak v is L / (I sin a).

    Parameters
    ----------
    direction : ndarray, shape (3,)
        Unit vector of the dipole.
    rate : ndarray, shape (3,)
        Rate of the body against the axes in which the field is constant, rad/s, same axes.
    field : ndarray, shape (3,)
        T, same axes.
    dipole_strength : float
        A m2.
    inertia : float
        Moment of inertia across the dipole, kg m2; equal in all directions across it.
    """
    strength = norm(field)
    along = field / strength
    velocity = cross(rate, direction)
    angle = math.acos(max(-1.0, min(1.0, float(along @ direction))))
    momentum = inertia * float(along @ cross(direction, velocity))
    depth = dipole_strength * strength
    energy = 0.5 * inertia * float(velocity @ velocity) + depth * (1.0 - math.cos(angle))

    def left(swing: float) -> float:
        """Return the energy that is left for the motion away from the field at an angle."""
        across = momentum / math.sin(swing)
        return energy - depth * (1.0 - math.cos(swing)) - 0.5 * across * across / inertia

    highest = math.pi - 1e-6
    if left(angle + 1e-9) <= 0.0:
        return angle
    return highest if left(highest) > 0.0 else float(brentq(left, angle + 1e-9, highest))
