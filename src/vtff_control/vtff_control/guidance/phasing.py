"""Phasing on one orbit: impulsive limit, low thrust, and what a cap on the thrust allows.

To get ahead of its place by an angle a spacecraft goes to a lower orbit, drifts there and comes
back (behind: a higher one). Both legs are along-track; the change of the semi-major axis is small
against the axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from vtff_dynamics.constants import GM_EARTH

__all__ = [
    "InfeasiblePhasingError",
    "Phasing",
    "impulsive_phasing_velocity",
    "least_phasing_orbits",
    "phase",
]


class InfeasiblePhasingError(ValueError):
    """A phasing is not possible in its time; the text says what would be."""


@dataclass(frozen=True)
class Phasing:
    """A low-thrust phasing with constant along-track thrust on two equal legs.

    Attributes
    ----------
    acceleration
        m/s2.
    thrust_time
        Duration of each leg, s.
    coast_time
        Time between the legs, s.
    velocity_change
        Velocity change of both legs, m/s.
    semi_major_axis_change
        During the coast, m; negative to get ahead.
    """

    acceleration: float
    thrust_time: float
    coast_time: float
    velocity_change: float
    semi_major_axis_change: float


def impulsive_phasing_velocity(semi_major_axis: float, angle: float, orbits: float) -> float:
    """Return the velocity change of the two impulses of a phasing, m/s; exact two-body.

    Parameters
    ----------
    semi_major_axis
        Semi-major axis of the circular orbit, m.
    angle
        rad ahead (positive) or behind.
    orbits
        Revolutions of the reference during the phasing.

    References
    ----------
    Vallado (2013), Fundamentals of Astrodynamics and Applications, section 6.6.1.
    """
    ratio = 1.0 - angle / (2.0 * math.pi * orbits)
    axis = semi_major_axis * ratio ** (2.0 / 3.0)
    circular = math.sqrt(GM_EARTH / semi_major_axis)
    speed = math.sqrt(GM_EARTH * (2.0 / semi_major_axis - 1.0 / axis))
    return 2.0 * abs(speed - circular)


def least_phasing_orbits(semi_major_axis: float, angle: float, acceleration: float) -> float:
    """Return the revolutions that a phasing takes at least, thrusting all the time.

    Parameters
    ----------
    semi_major_axis, angle
        As in `impulsive_phasing_velocity`.
    acceleration
        m/s2.
    """
    # Half the time down, half up: angle = 3 f T^2 / (4 a).
    duration = math.sqrt(4.0 * semi_major_axis * abs(angle) / (3.0 * acceleration))
    return duration * math.sqrt(GM_EARTH / semi_major_axis**3) / (2.0 * math.pi)


def phase(semi_major_axis: float, angle: float, orbits: float, acceleration: float) -> Phasing:
    """Return the phasing of least fuel with a given acceleration.

    Parameters
    ----------
    semi_major_axis, angle, orbits
        As in `impulsive_phasing_velocity`.
    acceleration
        m/s2.

    Raises
    ------
    InfeasiblePhasingError
        If the acceleration is too small.
    """
    mean_motion = math.sqrt(GM_EARTH / semi_major_axis**3)
    duration = 2.0 * math.pi * orbits / mean_motion
    # angle = 3 f t1 (T - t1) / a.
    product = abs(angle) * semi_major_axis / (3.0 * acceleration)
    discriminant = 0.25 * duration**2 - product
    if discriminant < 0.0:
        least = least_phasing_orbits(semi_major_axis, angle, acceleration)
        reached = math.degrees(3.0 * acceleration * duration**2 / (4.0 * semi_major_axis))
        raise InfeasiblePhasingError(
            f"phasing of {math.degrees(abs(angle)):g} deg in {orbits:g} orbits: impossible with "
            f"{acceleration:.3g} m/s2, which reaches {reached:.3g} deg and takes at least "
            f"{least:.1f} orbits"
        )
    leg = 0.5 * duration - math.sqrt(discriminant)
    return Phasing(
        acceleration,
        leg,
        duration - 2.0 * leg,
        2.0 * acceleration * leg,
        -math.copysign(2.0 * acceleration * leg / mean_motion, angle),
    )
