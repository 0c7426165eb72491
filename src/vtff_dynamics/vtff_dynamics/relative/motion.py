"""Relative motion in the RTN frame of a chief: linear, state-dependent and holding forms.

All relative states are position and rotating-frame velocity (R, T, N), m and m/s, shape (6,).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import GM_EARTH, J2_EARTH
from vtff_dynamics.frames.rtn import angular_velocity_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.gravity import gravity_acceleration, gravity_jerk
from vtff_dynamics.vectors import FloatArray, cross, norm

__all__ = [
    "FrameRates",
    "frame_rates_rtn",
    "hcw_input_matrix",
    "hcw_state_matrix",
    "hcw_transition_matrix",
    "holding_acceleration",
    "relative_acceleration",
    "state_dependent_matrix",
]


def hcw_state_matrix(mean_motion: float) -> FloatArray:
    """Return A (6, 6) of the Hill-Clohessy-Wiltshire equations ``xdot = A x``.

    Parameters
    ----------
    mean_motion : float
        Mean motion of the circular chief orbit, rad/s.

    References
    ----------
    Clohessy and Wiltshire (1960), J. Aerospace Sci. 27, eqs. (1) to (3).
    """
    n = mean_motion
    matrix = np.zeros((6, 6))
    matrix[:3, 3:] = np.eye(3)
    matrix[3, 0] = 3.0 * n * n
    matrix[3, 4] = 2.0 * n
    matrix[4, 3] = -2.0 * n
    matrix[5, 2] = -n * n
    return matrix


def hcw_transition_matrix(mean_motion: float, duration: float) -> FloatArray:
    """Return the transition matrix (6, 6) of the Hill-Clohessy-Wiltshire equations.

    Parameters
    ----------
    mean_motion : float
        Mean motion of the circular chief orbit, rad/s, not zero.
    duration : float
        Time over which the state is carried, s; may be negative.

    References
    ----------
    Alfriend et al. (2010), Spacecraft Formation Flying, section 5.3.
    """
    n = mean_motion
    angle = n * duration
    s, c = math.sin(angle), math.cos(angle)
    return np.array(
        [
            [4.0 - 3.0 * c, 0.0, 0.0, s / n, 2.0 * (1.0 - c) / n, 0.0],
            [6.0 * (s - angle), 1.0, 0.0, -2.0 * (1.0 - c) / n, (4.0 * s - 3.0 * angle) / n, 0.0],
            [0.0, 0.0, c, 0.0, 0.0, s / n],
            [3.0 * n * s, 0.0, 0.0, c, 2.0 * s, 0.0],
            [-6.0 * n * (1.0 - c), 0.0, 0.0, -2.0 * s, 4.0 * c - 3.0, 0.0],
            [0.0, 0.0, -n * s, 0.0, 0.0, c],
        ]
    )


def hcw_input_matrix(mean_motion: float, duration: float) -> FloatArray:
    """Return the change (6, 3) of a relative state by a constant acceleration of 1 m/s2 (R, T, N).

    The integral of `hcw_transition_matrix` over a duration, for thrust that is constant in the
    turning frame.

    Parameters
    ----------
    mean_motion : float
        Mean motion of the circular chief orbit, rad/s, not zero.
    duration : float
        s.
    """
    n = mean_motion
    angle = n * duration
    s, c = math.sin(angle), math.cos(angle)
    across, along = (1.0 - c) / n, (4.0 * s - 3.0 * angle) / n
    behind = 2.0 * (angle - s) / n**2
    return np.array(
        [
            [across / n, behind, 0.0],
            [-behind, (4.0 * (1.0 - c) - 1.5 * angle**2) / n**2, 0.0],
            [0.0, 0.0, across / n],
            [s / n, 2.0 * across, 0.0],
            [-2.0 * across, along, 0.0],
            [0.0, 0.0, s / n],
        ]
    )


def state_dependent_matrix(
    relative_state_rtn: npt.ArrayLike,
    radius_chief: float,
    angular_rate: float,
    angular_acceleration: float,
    gravitational_parameter: float = GM_EARTH,
) -> FloatArray:
    """Return A(x) (6, 6) so that ``A(x) @ x`` is the exact two-body relative motion.

    The nonlinear equations of relative motion about an eccentric orbit are factored without
    approximation: with ``q = (2 r x + x2 + y2 + z2) / r2`` the differential gravity is
    ``1 - (1 + q)^-1.5 = q g(q)``, g smooth, and q is linear in (x, y, z) with coefficients
    ``[2 r + x, y, z] / r2``. At x = 0 on a circular orbit A(x) is the HCW matrix.

    Parameters
    ----------
    relative_state_rtn : array_like, shape (6,)
        Relative state in RTN, m and m/s; only the position enters A.
    radius_chief : float
        Distance of the chief from the centre of the Earth, m.
    angular_rate, angular_acceleration : float
        Rate of the RTN axes about N, rad/s, and its derivative, rad/s2.
    gravitational_parameter : float
        m3/s2.

    Returns
    -------
    ndarray, shape (6, 6)
        With control: ``xdot = A(x) @ x + B @ u``, B = [0; I].

    Raises
    ------
    ValueError
        If the deputy is at the centre of the Earth.

    References
    ----------
    Battin (1999), An Introduction to the Mathematics and Methods of Astrodynamics, eq. (8.62),
    for g; Alfriend et al. (2010), eqs. (4.14) to (4.16), for the motion.
    """
    x, y, z = np.asarray(relative_state_rtn, dtype=float)[:3].tolist()
    r = radius_chief
    q = (x * (2.0 * r + x) + y * y + z * z) / (r * r)
    if not 1.0 + q > 0.0:
        raise ValueError("relative_state_rtn: the deputy is at the centre of the Earth")
    cubed_ratio = (1.0 + q) * math.sqrt(1.0 + q)
    g = (3.0 + q * (3.0 + q)) / ((1.0 + cubed_ratio) * cubed_ratio)
    gravity = gravitational_parameter / (r * r * r)
    radial = gravity * g / r
    isotropic = gravity / cubed_ratio
    centrifugal = angular_rate * angular_rate - isotropic

    matrix = np.zeros((6, 6))
    matrix[0, 3] = matrix[1, 4] = matrix[2, 5] = 1.0
    matrix[3, 0] = centrifugal + radial * (2.0 * r + x)
    matrix[3, 1] = angular_acceleration + radial * y
    matrix[3, 2] = radial * z
    matrix[3, 4] = 2.0 * angular_rate
    matrix[4, 0] = -angular_acceleration
    matrix[4, 1] = centrifugal
    matrix[4, 3] = -2.0 * angular_rate
    matrix[5, 2] = -isotropic
    return matrix


def relative_acceleration(
    relative_state_rtn: npt.ArrayLike,
    radius_chief: float,
    angular_rate: float,
    angular_acceleration: float,
    gravitational_parameter: float = GM_EARTH,
) -> FloatArray:
    """Return the exact two-body relative acceleration seen in the rotating RTN frame, m/s2.

    Parameters
    ----------
    relative_state_rtn : array_like, shape (6,)
        Relative state in RTN, m and m/s.
    radius_chief, angular_rate, angular_acceleration, gravitational_parameter : float
        As in `state_dependent_matrix`, with which this agrees to rounding.

    Returns
    -------
    ndarray, shape (3,)
        Second derivative of (R, T, N) without control.

    References
    ----------
    Alfriend et al. (2010), Spacecraft Formation Flying, eqs. (4.14) to (4.16).
    """
    state = np.asarray(relative_state_rtn, dtype=float)
    matrix = state_dependent_matrix(
        state, radius_chief, angular_rate, angular_acceleration, gravitational_parameter
    )
    acceleration_rtn: FloatArray = matrix[3:] @ state
    return acceleration_rtn


@dataclass(frozen=True)
class FrameRates:
    """Rotation of the RTN axes against inertial space, in RTN components.

    Attributes
    ----------
    angular_velocity_rtn : ndarray, shape (3,)
        rad/s. The T component is zero by construction of the frame.
    angular_acceleration_rtn : ndarray, shape (3,)
        rad/s2.
    """

    angular_velocity_rtn: FloatArray
    angular_acceleration_rtn: FloatArray


def frame_rates_rtn(
    state_chief_gcrf: npt.ArrayLike,
    acceleration_chief_gcrf: npt.ArrayLike | None = None,
    jerk_chief_gcrf: npt.ArrayLike | None = None,
) -> FrameRates:
    """Return angular velocity and acceleration of the chief's RTN axes.

    Parameters
    ----------
    state_chief_gcrf : array_like, shape (6,)
        Position and velocity of the chief, m and m/s.
    acceleration_chief_gcrf : array_like, shape (3,), optional
        True total acceleration of the chief, m/s2; two-body when absent. With it, perturbations
        along T change the rate about N, and those along N turn the frame about R.
    jerk_chief_gcrf : array_like, shape (3,), optional
        Jerk of the chief, m/s3; when absent that of `vtff_dynamics.orbit.gravity` (J2 only if an
        acceleration is given). It enters only the angular acceleration about R.

    Raises
    ------
    ValueError
        If the chief's position and velocity are parallel.

    References
    ----------
    Casotto (2016), "The equations of relative motion in the orbital reference frame",
    Celest. Mech. Dyn. Astron. 124, section 2.
    """
    chief = np.asarray(state_chief_gcrf, dtype=float)
    rotation = rotation_gcrf_to_rtn(chief)
    radius = norm(chief[:3])
    radial_velocity = float(rotation[0] @ chief[3:])
    momentum = radius * float(rotation[1] @ chief[3:])
    angular_velocity = angular_velocity_rtn(chief, acceleration_chief_gcrf)
    rate_r, _, rate = angular_velocity.tolist()
    if acceleration_chief_gcrf is None:
        rate_change = -2.0 * rate * radial_velocity / radius
        return FrameRates(angular_velocity, np.array([0.0, 0.0, rate_change]))

    if jerk_chief_gcrf is None:
        jerk_chief_gcrf = gravity_jerk(chief)
    _, force_t, force_n = (rotation @ np.asarray(acceleration_chief_gcrf, dtype=float)).tolist()
    momentum_change = radius * force_t
    # dN/dt = -rate_r T, so that the N component of the acceleration changes by that much less.
    force_n_change = float(rotation[2] @ np.asarray(jerk_chief_gcrf, dtype=float))
    force_n_change -= rate_r * force_t
    rate_r_change = (
        radial_velocity * force_n + radius * force_n_change - rate_r * momentum_change
    ) / momentum
    rate_change = (momentum_change - 2.0 * rate * radius * radial_velocity) / (radius * radius)
    return FrameRates(angular_velocity, np.array([rate_r_change, 0.0, rate_change]))


def holding_acceleration(
    relative_position_rtn: npt.ArrayLike,
    state_chief_gcrf: npt.ArrayLike,
    acceleration_chief_gcrf: npt.ArrayLike | None = None,
    jerk_chief_gcrf: npt.ArrayLike | None = None,
) -> FloatArray:
    """Return the control acceleration that keeps a deputy at rest in the chief's RTN frame.

    It is the inertial acceleration of a point fixed in the eccentric, nonlinear rotating frame,
    less gravity there: ``u = a_c + W' x rho + W x (W x rho) - g(r_c + rho)``.

    Parameters
    ----------
    relative_position_rtn : array_like, shape (3,)
        Target position in RTN, m.
    state_chief_gcrf : array_like, shape (6,)
        Position and velocity of the chief, m and m/s.
    acceleration_chief_gcrf : array_like, shape (3,), optional
        The chief's true gravitational acceleration, m/s2. When absent the world is two-body and
        the result exact. When given, the rates of the frame follow from it, and the differential
        gravity between the two is that of the point mass and J2.
    jerk_chief_gcrf : array_like, shape (3,), optional
        As in `frame_rates_rtn`.

    Returns
    -------
    ndarray, shape (3,)
        Acceleration in RTN, m/s2.

    Raises
    ------
    ValueError
        If the chief's position and velocity are parallel.
    """
    chief = np.asarray(state_chief_gcrf, dtype=float)
    relative = np.asarray(relative_position_rtn, dtype=float)
    rotation = rotation_gcrf_to_rtn(chief)
    rates = frame_rates_rtn(chief, acceleration_chief_gcrf, jerk_chief_gcrf)
    j2 = 0.0 if acceleration_chief_gcrf is None else J2_EARTH
    position_target = chief[:3] + rotation.T @ relative
    gravity_difference = gravity_acceleration(position_target, j2=j2) - gravity_acceleration(
        chief[:3], j2=j2
    )
    angular_velocity = rates.angular_velocity_rtn
    inertial = cross(rates.angular_acceleration_rtn, relative) + cross(
        angular_velocity, cross(angular_velocity, relative)
    )
    return inertial - rotation @ gravity_difference
