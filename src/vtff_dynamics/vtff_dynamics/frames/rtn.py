"""The RTN frame of a chief: its axes, their rotation, and the states of deputies in it.

The origin is in the chief; R points along the radius outward, N along the orbital angular momentum,
T = N x R along-track. Relative velocities are those seen in the rotating frame.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray, cross, norm

__all__ = [
    "angular_velocity_rtn",
    "deputy_state_gcrf",
    "relative_state_rtn",
    "rotation_gcrf_to_rtn",
]


def rotation_gcrf_to_rtn(state_gcrf: npt.ArrayLike) -> FloatArray:
    """Return the rotation matrices (..., 3, 3) from GCRF to the RTN axes of states (..., 6).

    Raises
    ------
    ValueError
        If position and velocity are parallel or zero, so that there is no orbital plane.
    """
    states = np.array(state_gcrf, dtype=float, order="C")
    rotations: FloatArray = _axes_of_states(states.reshape(-1, 6))
    return rotations.reshape(*states.shape[:-1], 3, 3)


@compiled
def _axes_of_states(states: FloatArray) -> FloatArray:
    """Return the axes R, T, N of states (n, 6) as rows, shape (n, 3, 3)."""
    axes = np.empty((len(states), 3, 3))
    for index in range(len(states)):
        x, y, z, vx, vy, vz = states[index]
        nx, ny, nz = y * vz - z * vy, z * vx - x * vz, x * vy - y * vx
        momentum = math.sqrt(nx * nx + ny * ny + nz * nz)
        if not momentum > 0.0:
            raise ValueError("state_gcrf: position and velocity do not span an orbital plane")
        radius = math.sqrt(x * x + y * y + z * z)
        x, y, z = x / radius, y / radius, z / radius
        nx, ny, nz = nx / momentum, ny / momentum, nz / momentum
        axes[index, 0] = x, y, z
        axes[index, 1] = ny * z - nz * y, nz * x - nx * z, nx * y - ny * x
        axes[index, 2] = nx, ny, nz
    return axes


def angular_velocity_rtn(
    state_gcrf: npt.ArrayLike, acceleration_gcrf: npt.ArrayLike | None = None
) -> FloatArray:
    """Return the angular velocity of the RTN axes of a state, in RTN, rad/s, shape (3,).

    Parameters
    ----------
    state_gcrf : array_like, shape (6,)
        Position and velocity, m and m/s.
    acceleration_gcrf : array_like, shape (3,), optional
        Total acceleration, m/s2. Its component along N turns the axes about R (at most 2e-6 rad/s
        by J2); when absent they turn about N alone.

    Returns
    -------
    ndarray, shape (3,)
        ``[r a_N / h, 0, h / r2]``, h the angular momentum.

    Raises
    ------
    ValueError
        If position and velocity are parallel or zero.
    """
    state = np.asarray(state_gcrf, dtype=float)
    angular_momentum = cross(state[:3], state[3:])
    magnitude = norm(angular_momentum)
    if not magnitude > 0.0:
        raise ValueError("state_gcrf: position and velocity do not span an orbital plane")
    rate_n = magnitude / float(state[:3] @ state[:3])
    if acceleration_gcrf is None:
        return np.array([0.0, 0.0, rate_n])
    acceleration_n = float(angular_momentum @ np.asarray(acceleration_gcrf)) / magnitude
    return np.array([norm(state[:3]) * acceleration_n / magnitude, 0.0, rate_n])


def relative_state_rtn(
    state_chief_gcrf: npt.ArrayLike,
    state_deputy_gcrf: npt.ArrayLike,
    acceleration_chief_gcrf: npt.ArrayLike | None = None,
) -> FloatArray:
    """Return the deputy's position and rotating-frame velocity in the chief's RTN frame.

    Parameters
    ----------
    state_chief_gcrf, state_deputy_gcrf : array_like, shape (6,)
        Position and velocity, m and m/s.
    acceleration_chief_gcrf : array_like, shape (3,), optional
        Total acceleration of the chief, m/s2. With it the velocity is the exact derivative of the
        relative position. Without, the frame turns with h/r2 about N alone, the usual definition
        (Alfriend et al. 2010, section 4.1), which under J2 differs along N by up to 2 mm/s for
        each km in-track.

    Returns
    -------
    ndarray, shape (6,)
        Position (R, T, N) in m and velocity in m/s.

    Raises
    ------
    ValueError
        If the chief's position and velocity are parallel.
    """
    chief = np.asarray(state_chief_gcrf, dtype=float)
    difference = np.asarray(state_deputy_gcrf, dtype=float) - chief
    rotation = rotation_gcrf_to_rtn(chief)
    position = rotation @ difference[:3]
    turning = cross(angular_velocity_rtn(chief, acceleration_chief_gcrf), position)
    return np.concatenate((position, rotation @ difference[3:] - turning))


def deputy_state_gcrf(
    state_chief_gcrf: npt.ArrayLike,
    relative_state: npt.ArrayLike,
    acceleration_chief_gcrf: npt.ArrayLike | None = None,
) -> FloatArray:
    """Return the deputy's GCRF state (6,); the inverse of `relative_state_rtn`.

    Parameters
    ----------
    state_chief_gcrf : array_like, shape (6,)
        Position and velocity of the chief, m and m/s.
    relative_state : array_like, shape (6,)
        Position and rotating-frame velocity of the deputy in RTN, m and m/s.
    acceleration_chief_gcrf : array_like, shape (3,), optional
        As in `relative_state_rtn`.

    Raises
    ------
    ValueError
        If the chief's position and velocity are parallel.
    """
    chief = np.asarray(state_chief_gcrf, dtype=float)
    relative = np.asarray(relative_state, dtype=float)
    to_gcrf = rotation_gcrf_to_rtn(chief).T
    turning = cross(angular_velocity_rtn(chief, acceleration_chief_gcrf), relative[:3])
    position, velocity = to_gcrf @ relative[:3], to_gcrf @ (relative[3:] + turning)
    return np.asarray(chief + np.concatenate((position, velocity)))
