"""Acceleration that holds a target in the turning frame of a chief."""

from __future__ import annotations

import numpy as np

from vtff_dynamics.frames.rtn import angular_velocity_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.gravity import gravity_acceleration, predict_state
from vtff_dynamics.relative.motion import holding_acceleration
from vtff_dynamics.vectors import FloatArray, cross

__all__ = ["target_acceleration", "velocity_at_rest"]


def target_acceleration(
    state_chief_gcrf: FloatArray,
    target_rtn: FloatArray,
    delay_steps: int,
    sample_time: float,
    j2: float,
) -> FloatArray:
    """Return the acceleration that keeps a target's motion while a command acts, m/s2, shape (3,).

    It is taken at the middle of the interval in which the command acts, where a held value equals
    the mean, and turned into the RTN axes at the start of that interval, which are the axes in
    which the thruster holds it.

    Parameters
    ----------
    state_chief_gcrf
        Chief of now, m and m/s, shape (6,).
    target_rtn
        Wanted relative state of now, m and m/s, shape (6,).
    delay_steps
        Whole samples until the command acts.
    sample_time
        Time for which it acts, s.
    j2
        Second zonal coefficient; 0 leaves the point mass.

    Raises
    ------
    ValueError
        If position and velocity of the chief are parallel.
    """
    start = predict_state(state_chief_gcrf, delay_steps * sample_time, j2)
    middle = predict_state(start, 0.5 * sample_time, j2)
    position = target_rtn[:3] + (delay_steps + 0.5) * sample_time * target_rtn[3:]
    gravity = _perturbed_gravity(middle, j2)
    coriolis = 2.0 * cross(angular_velocity_rtn(middle, gravity), target_rtn[3:])
    held = holding_acceleration(position, middle, gravity) + coriolis
    return np.asarray(rotation_gcrf_to_rtn(start) @ rotation_gcrf_to_rtn(middle).T @ held)


def velocity_at_rest(
    state_chief_gcrf: FloatArray, position_rtn: FloatArray, j2: float
) -> FloatArray:
    """Return the relative velocity that is reported for a deputy at rest, m/s, shape (3,).

    Relative states are formed with the frame turning about N alone (`relative_state_rtn`).
    Perturbations out of the plane turn it about R as well, so that a deputy at rest 15 km in-track
    seems to drift along N by millimetres per second.

    Parameters
    ----------
    state_chief_gcrf
        m and m/s, shape (6,).
    position_rtn
        Where the deputy rests, m, shape (3,).
    j2
        Second zonal coefficient; 0 leaves the point mass.

    Raises
    ------
    ValueError
        If position and velocity of the chief are parallel.
    """
    rate_r, _, _ = angular_velocity_rtn(state_chief_gcrf, _perturbed_gravity(state_chief_gcrf, j2))
    return cross((rate_r, 0.0, 0.0), position_rtn)


def _perturbed_gravity(state_gcrf: FloatArray, j2: float) -> FloatArray | None:
    """Return the acceleration by point mass and J2, m/s2; None for the point mass alone.

    Without perturbations the frame of the chief turns about N alone.
    """
    return gravity_acceleration(state_gcrf[:3], j2=j2) if j2 else None
