"""The RTN frame of a chief: its axes, their rotation, and the states of deputies in it.

The origin is in the chief; R points along the radius outward, N along the orbital angular momentum,
T = N x R along-track. Relative velocities are those seen in the rotating frame.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray, cross, norm

__all__ = [
    "angular_velocity_rtn",
    "deputy_state_gcrf",
    "relative_state_rtn",
    "rotation_gcrf_to_rtn",
]


_Row = tuple[float, float, float]


def rotation_gcrf_to_rtn(state_gcrf: npt.ArrayLike) -> FloatArray:
    """Return the rotation matrix (3, 3) from GCRF to the RTN axes of a state (6,).

    Raises
    ------
    ValueError
        If position and velocity are parallel or zero, so that there is no orbital plane.
    """
    return np.array(_axes_rtn(state_gcrf)[0])


def _axes_rtn(state_gcrf: npt.ArrayLike) -> tuple[tuple[_Row, _Row, _Row], float]:
    """Return the axes of a state (6,) and the size of its angular momentum, m2/s."""
    # Numbers one by one: operations on arrays of three take three times as long.
    x, y, z, vx, vy, vz = np.asarray(state_gcrf, dtype=float).tolist()
    nx, ny, nz = y * vz - z * vy, z * vx - x * vz, x * vy - y * vx
    magnitude = math.sqrt(nx * nx + ny * ny + nz * nz)
    if not magnitude > 0.0:
        raise ValueError("state_gcrf: position and velocity do not span an orbital plane")
    radius = math.sqrt(x * x + y * y + z * z)
    x, y, z = x / radius, y / radius, z / radius
    nx, ny, nz = nx / magnitude, ny / magnitude, nz / magnitude
    along = (ny * z - nz * y, nz * x - nx * z, nx * y - ny * x)
    return ((x, y, z), along, (nx, ny, nz)), magnitude


def _axes_and_rates(
    state_gcrf: FloatArray, acceleration_gcrf: npt.ArrayLike | None
) -> tuple[FloatArray, float, float]:
    """Return `rotation_gcrf_to_rtn` and the rates of the axes about R and N, rad/s."""
    axes, momentum = _axes_rtn(state_gcrf)
    rate_n = momentum / float(state_gcrf[:3] @ state_gcrf[:3])
    rate_r = 0.0
    if acceleration_gcrf is not None:
        rate_r = float(angular_velocity_rtn(state_gcrf, acceleration_gcrf)[0])
    return np.array(axes), rate_r, rate_n


def _velocity_of_axes(rate_r: float, rate_n: float, x: float, y: float, z: float) -> _Row:
    """Return the cross product of the rates (rate_r, 0, rate_n) and a position in RTN, m/s."""
    return 0.0 * z - rate_n * y, rate_n * x - rate_r * z, rate_r * y - 0.0 * x


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
    rotation, rate_r, rate_n = _axes_and_rates(chief, acceleration_chief_gcrf)
    x, y, z = (rotation @ difference[:3]).tolist()
    vx, vy, vz = (rotation @ difference[3:]).tolist()
    turned_x, turned_y, turned_z = _velocity_of_axes(rate_r, rate_n, x, y, z)
    return np.array([x, y, z, vx - turned_x, vy - turned_y, vz - turned_z])


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
    x, y, z, vx, vy, vz = np.asarray(relative_state, dtype=float).tolist()
    rotation, rate_r, rate_n = _axes_and_rates(chief, acceleration_chief_gcrf)
    to_gcrf = rotation.T
    turned_x, turned_y, turned_z = _velocity_of_axes(rate_r, rate_n, x, y, z)
    velocity = (vx + turned_x, vy + turned_y, vz + turned_z)
    deputy: FloatArray = chief + np.concatenate(
        (to_gcrf @ np.array([x, y, z]), to_gcrf @ np.array(velocity))
    )
    return deputy
