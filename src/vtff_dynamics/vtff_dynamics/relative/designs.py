"""Formations that need no thrust on a nearly circular orbit, as mean relative elements.

Every design returns the relative elements of a deputy in m, shape (6,), in the order of
`vtff_dynamics.relative.relative_elements`. Sizes are those of the motion about the chief in m;
a phase is the mean argument of latitude u at which the deputy is lowest (R = -size), in rad, so
that deputies of one design differ in phase.

With e and i the angle between the relative eccentricity vector and the relative inclination vector
decides about safety: parallel vectors keep spacecraft apart in the R-N plane whatever happens
in-track, perpendicular ones let them meet there (D'Amico 2010, section 2.2).
"""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.vectors import FloatArray

__all__ = [
    "DESIGNS",
    "cartwheel",
    "general_circular",
    "helix",
    "leader_follower",
    "projected_circular_radial_normal",
    "projected_circular_track_normal",
]

DESIGNS = (
    "leader_follower",
    "projected_circular_track_normal",
    "projected_circular_radial_normal",
    "general_circular",
    "cartwheel",
    "helix",
)
"""Names of the designs, which are the functions of this module."""


def leader_follower(along_track: float) -> FloatArray:
    """Return a deputy on the chief's orbit, ahead of it by a distance in m."""
    return np.array([0.0, along_track, 0.0, 0.0, 0.0, 0.0])


def projected_circular_track_normal(
    radius: float, phase: float, along_track: float = 0.0
) -> FloatArray:
    """Return a deputy whose projection on the T-N plane (the Earth's surface) is a circle.

    Radial amplitude is half the radius. The vectors e and i are perpendicular: the R-N separation
    from the chief passes through zero twice an orbit.

    References
    ----------
    Alfriend et al. (2010), Spacecraft Formation Flying, section 4.10: the projected circular orbit.
    """
    return _relative(0.5 * radius, phase, radius, phase + 0.5 * math.pi, along_track)


def projected_circular_radial_normal(
    radius: float, phase: float, along_track: float = 0.0
) -> FloatArray:
    """Return a deputy whose projection on the R-N plane is a circle; e and i are parallel."""
    return _relative(radius, phase, radius, phase, along_track)


def general_circular(radius: float, phase: float, along_track: float = 0.0) -> FloatArray:
    """Return a deputy on a circle in space about the chief; e and i are perpendicular.

    References
    ----------
    Alfriend et al. (2010), section 4.10: the general circular orbit.
    """
    half = 0.5 * radius
    return _relative(half, phase, math.sqrt(3.0) * half, phase + 0.5 * math.pi, along_track)


def cartwheel(radial: float, phase: float, along_track: float = 0.0) -> FloatArray:
    """Return a deputy on the 2:1 ellipse in the orbital plane, without cross-track motion."""
    return _relative(radial, phase, 0.0, 0.0, along_track)


def helix(radial: float, normal: float, phase: float, along_track: float = 0.0) -> FloatArray:
    """Return a deputy with parallel e and i: its R-N separation never falls below the smaller."""
    return _relative(radial, phase, normal, phase, along_track)


def _relative(
    eccentricity: float, phase: float, inclination: float, node: float, along_track: float
) -> FloatArray:
    """Return relative elements of the two vectors, each given by length (m) and angle (rad)."""
    return np.array(
        [
            0.0,
            along_track,
            eccentricity * math.cos(phase),
            eccentricity * math.sin(phase),
            inclination * math.cos(node),
            inclination * math.sin(node),
        ]
    )
