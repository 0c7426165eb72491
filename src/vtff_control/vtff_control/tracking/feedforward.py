"""Acceleration that holds a target in the turning frame of a chief, compiled for commands.

The formulas are those of `vtff_dynamics.relative.motion.holding_acceleration`,
`vtff_dynamics.frames.rtn.angular_velocity_rtn` and `vtff_dynamics.orbit.gravity`, where they are
told with their sources. A command waits for them, once a second, when no cache knows them any more:
two compiled calls cost less than half of what these functions cost, and each product that they
share is formed once.
"""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.frames.rtn_kernels import write_axes
from vtff_dynamics.orbit.free_flight import (
    acceleration_at,
    fly_states,
    jerk_at,
    scale_oblateness,
)
from vtff_dynamics.vectors import FloatArray

__all__ = ["compile_kernels", "target_acceleration", "velocity_at_rest"]


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
    oblateness = scale_oblateness(j2)
    position = target_rtn[:3] + (delay_steps + 0.5) * sample_time * target_rtn[3:]
    rotation_start, rotation, gravity, gravity_difference, figures = _look_ahead(
        state_chief_gcrf,
        position,
        delay_steps * sample_time,
        0.5 * sample_time,
        GM_EARTH,
        oblateness,
    )
    # Products of numpy, whose sums no loop has.
    held: FloatArray = _hold(
        position, target_rtn, rotation @ gravity, rotation @ gravity_difference, figures, oblateness
    )
    return np.asarray(rotation_start @ rotation.T @ held)


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
    velocity: FloatArray = _drift_at_rest(
        state_chief_gcrf, position_rtn, GM_EARTH, scale_oblateness(j2)
    )
    return velocity


def compile_kernels() -> None:
    """Compile what is used here, or load it from the cache, before the first state is due."""
    radius = 7.0e6
    chief = np.array([radius, 0.0, 0.0, 0.0, math.sqrt(GM_EARTH / radius), 0.0])
    target_acceleration(chief, np.zeros(6), 1, 1.0, 0.0)
    velocity_at_rest(chief, np.zeros(3), 0.0)


@compiled
def _rate_about_r(state: FloatArray, gravity: tuple[float, float, float]) -> float:
    """Return the rate of the RTN axes of a state about R by its acceleration, rad/s."""
    x, y, z, vx, vy, vz = state[0], state[1], state[2], state[3], state[4], state[5]
    nx, ny, nz = y * vz - z * vy, z * vx - x * vz, x * vy - y * vx
    momentum = math.sqrt(nx * nx + ny * ny + nz * nz)
    if not momentum > 0.0:
        raise ValueError("state_chief_gcrf: position and velocity do not span an orbital plane")
    acceleration_n = (nx * gravity[0] + ny * gravity[1] + nz * gravity[2]) / momentum
    rate: float = math.sqrt(x * x + y * y + z * z) * acceleration_n / momentum
    return rate


@compiled
def _drift_at_rest(
    state: FloatArray, position: FloatArray, gm: float, oblateness: float
) -> FloatArray:
    """Return what `velocity_at_rest` does, with the constants of `fly_states`."""
    rate = 0.0
    if oblateness != 0.0:
        gravity = acceleration_at(state[0], state[1], state[2], gm, oblateness)
        rate = _rate_about_r(state, gravity)
    x, y, z = position[0], position[1], position[2]
    return np.array([0.0 * z - 0.0 * y, 0.0 * x - rate * z, rate * y - 0.0 * x])


@compiled
def _look_ahead(
    state_chief: FloatArray,
    position: FloatArray,
    delay: float,
    half: float,
    gm: float,
    oblateness: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return what the frame of a chief does in the middle of the interval of a command.

    Parameters
    ----------
    state_chief
        m and m/s, shape (6,).
    position
        Position of the target then, RTN, m, shape (3,).
    delay, half
        Time until the interval starts, and half its length, s.
    gm, oblateness
        As of `fly_states`.

    Returns
    -------
    rotation_start, rotation
        From GCRF to RTN at the start and in the middle of the interval, shape (3, 3).
    gravity, gravity_difference
        Acceleration of the chief in the middle, and how much more the target has, m/s2, shape (3,).
    figures
        Radius (m), radial velocity (m/s), angular momentum (m2/s), rates of the axes about R and N
        (rad/s) and N component of the jerk (m/s3) of the chief there, shape (6,).
    """
    start, times = np.empty((1, 6)), np.zeros(2)
    for k in range(6):
        start[0, k] = state_chief[k]
    times[1] = delay
    begun = fly_states(start, times, gm, oblateness)[1]
    times[1] = half
    middle = fly_states(begun, times, gm, oblateness)[1, 0]
    rotation_start, rotation = np.empty((3, 3)), np.empty((3, 3))
    write_axes(begun[0], rotation_start)
    rate = write_axes(middle, rotation)
    acceleration = acceleration_at(middle[0], middle[1], middle[2], gm, oblateness)
    target = np.empty(3)
    for k in range(3):
        turned = rotation[0, k] * position[0] + rotation[1, k] * position[1]
        target[k] = middle[k] + (turned + rotation[2, k] * position[2])
    acceleration_target = acceleration_at(target[0], target[1], target[2], gm, oblateness)
    gravity, gravity_difference = np.empty(3), np.empty(3)
    for k in range(3):
        gravity[k] = acceleration[k]
        gravity_difference[k] = acceleration_target[k] - acceleration[k]
    radius = math.sqrt(middle[0] * middle[0] + middle[1] * middle[1] + middle[2] * middle[2])
    radial, along = 0.0, 0.0
    for k in range(3):
        radial += rotation[0, k] * middle[k + 3]
        along += rotation[1, k] * middle[k + 3]
    rate_r, jerk = 0.0, 0.0
    if oblateness != 0.0:
        rate_r = _rate_about_r(middle, acceleration)
        jx, jy, jz = jerk_at(middle, gm, oblateness)
        jerk = rotation[2, 0] * jx + rotation[2, 1] * jy + rotation[2, 2] * jz
    figures = np.array([radius, radial, radius * along, rate_r, rate, jerk])
    return rotation_start, rotation, gravity, gravity_difference, figures


@compiled
def _hold(
    position: FloatArray,
    target: FloatArray,
    force: FloatArray,
    gravity_difference: FloatArray,
    figures: FloatArray,
    oblateness: float,
) -> FloatArray:
    """Return the acceleration that holds a target, in the axes of that moment, m/s2, shape (3,).

    Parameters
    ----------
    position
        Position of the target at the moment, RTN, m, shape (3,).
    target
        Relative state whose velocity the target keeps, m and m/s, shape (6,).
    force, gravity_difference
        Acceleration of the chief and how much more the target has, RTN, m/s2, shape (3,).
    figures
        As of `_look_ahead`.
    oblateness
        0 for the point mass, m2.
    """
    radius, radial, momentum = figures[0], figures[1], figures[2]
    rate_r, rate, jerk = figures[3], figures[4], figures[5]
    rate_r_change, rate_change = 0.0, -2.0 * rate * radial / radius
    if oblateness != 0.0:
        momentum_change = radius * force[1]
        force_n_change = jerk - rate_r * force[1]
        rate_r_change = (
            radial * force[2] + radius * force_n_change - rate_r * momentum_change
        ) / momentum
        rate_change = (momentum_change - 2.0 * rate * radius * radial) / (radius * radius)
    x, y, z = position[0], position[1], position[2]
    # Cross products of rates about R and N with the position, and of these with each other.
    wx, wy, wz = 0.0 * z - rate * y, rate * x - rate_r * z, rate_r * y - 0.0 * x
    inertial_x = (0.0 * z - rate_change * y) + (0.0 * wz - rate * wy)
    inertial_y = (rate_change * x - rate_r_change * z) + (rate * wx - rate_r * wz)
    inertial_z = (rate_r_change * y - 0.0 * x) + (rate_r * wy - 0.0 * wx)
    vx, vy, vz = target[3], target[4], target[5]
    held = np.empty(3)
    held[0] = (inertial_x - gravity_difference[0]) + 2.0 * (0.0 * vz - rate * vy)
    held[1] = (inertial_y - gravity_difference[1]) + 2.0 * (rate * vx - rate_r * vz)
    held[2] = (inertial_z - gravity_difference[2]) + 2.0 * (rate_r * vy - 0.0 * vx)
    return held
