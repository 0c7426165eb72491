"""State transition of relative motion: mean relative elements under J2 and drag, and eccentric RTN.

The Hill-Clohessy-Wiltshire equations stand in `vtff_dynamics.relative.motion`.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import GM_EARTH, J2_EARTH, RADIUS_EARTH_JGM3
from vtff_dynamics.orbit.elements import true_anomaly_from_mean
from vtff_dynamics.orbit.mean_elements import secular_rates
from vtff_dynamics.relative.relative_elements import relative_state_of_mean_elements
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "drag_effect",
    "j2_transition_matrix",
    "propagate_mean_elements",
    "propagate_relative_state",
    "yamanaka_ankersen_transition_matrix",
]


def propagate_mean_elements(elements_mean: npt.ArrayLike, duration: float) -> FloatArray:
    """Return mean elements after a time under J2, shape (6,); angles are not wrapped.

    Parameters
    ----------
    elements_mean
        Mean quasi-nonsingular elements, m and rad, shape (6,).
    duration
        s, may be negative.
    """
    mean = np.asarray(elements_mean, dtype=float)
    rates = secular_rates(mean)
    result = mean + duration * rates
    eccentricity_squared = float(mean[2] ** 2 + mean[3] ** 2)
    if eccentricity_squared > 0.0:
        perigee_rate = float(mean[2] * rates[3] - mean[3] * rates[2]) / eccentricity_squared
        angle = perigee_rate * duration
        cosine, sine = math.cos(angle), math.sin(angle)
        result[2] = cosine * mean[2] - sine * mean[3]
        result[3] = sine * mean[2] + cosine * mean[3]
    return result


def j2_transition_matrix(elements_chief_mean: npt.ArrayLike, duration: float) -> FloatArray:
    """Return the transition matrix (6, 6) of mean relative elements under J2, any eccentricity.

    Parameters
    ----------
    elements_chief_mean
        Mean quasi-nonsingular elements of the chief at the start, m and rad, shape (6,).
    duration
        s, may be negative.

    References
    ----------
    Koenig, Guffanti and D'Amico (2017), New State Transition Matrices for Spacecraft Relative
    Motion in Perturbed Orbits, J. Guidance Control Dynamics 40(7), eq. (A6).
    """
    axis, _, ex, ey, inclination, _ = np.asarray(elements_chief_mean, dtype=float).tolist()
    mean_motion = math.sqrt(GM_EARTH / axis**3)
    eta = math.sqrt(1.0 - ex * ex - ey * ey)
    kappa = 0.75 * J2_EARTH * (RADIUS_EARTH_JGM3 / axis) ** 2 * mean_motion / eta**4
    cosine = math.cos(inclination)
    big_e, big_f, big_g = 1.0 + eta, 4.0 + 3.0 * eta, 1.0 / eta**2
    big_p, big_q = 3.0 * cosine**2 - 1.0, 5.0 * cosine**2 - 1.0
    big_s, big_t = math.sin(2.0 * inclination), math.sin(inclination) ** 2
    turn = kappa * big_q * duration
    cos_turn, sin_turn = math.cos(turn), math.sin(turn)
    end_x, end_y = cos_turn * ex - sin_turn * ey, sin_turn * ex + cos_turn * ey
    k = kappa * duration
    return np.array(
        [
            [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            [
                -3.5 * k * big_e * big_p - 1.5 * mean_motion * duration,
                1.0,
                k * ex * big_f * big_g * big_p,
                k * ey * big_f * big_g * big_p,
                -k * big_f * big_s,
                0.0,
            ],
            [
                3.5 * k * end_y * big_q,
                0.0,
                cos_turn - 4.0 * k * ex * end_y * big_g * big_q,
                -sin_turn - 4.0 * k * ey * end_y * big_g * big_q,
                5.0 * k * end_y * big_s,
                0.0,
            ],
            [
                -3.5 * k * end_x * big_q,
                0.0,
                sin_turn + 4.0 * k * ex * end_x * big_g * big_q,
                cos_turn + 4.0 * k * ey * end_x * big_g * big_q,
                -5.0 * k * end_x * big_s,
                0.0,
            ],
            [0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            [
                3.5 * k * big_s,
                0.0,
                -4.0 * k * ex * big_g * big_s,
                -4.0 * k * ey * big_g * big_s,
                2.0 * k * big_t,
                1.0,
            ],
        ]
    )


def drag_effect(elements_chief_mean: npt.ArrayLike, duration: float) -> FloatArray:
    """Return mean relative elements (m) that differential drag builds up, for 1 m/s, shape (6,).

    The model knows no density: drag is one number, the rate of the relative semi-major axis in m/s,
    which a filter or a look at two orbits gives. The chief's orbit is nearly circular; what drag
    does to the eccentricity vector there is below a per cent of this.

    Parameters
    ----------
    elements_chief_mean, duration
        As in `j2_transition_matrix`.

    References
    ----------
    Koenig, Guffanti and D'Amico (2017), section "Density-model-free", near-circular orbits.
    """
    column = j2_transition_matrix(elements_chief_mean, duration)[:, 0]
    effect: FloatArray = 0.5 * duration * column
    effect[0] = duration
    return effect


def propagate_relative_state(
    elements_chief_mean: npt.ArrayLike,
    relative_mean: npt.ArrayLike,
    duration: float,
    drag: float = 0.0,
) -> FloatArray:
    """Return the relative state in RTN after a time under J2, m and m/s, shape (6,).

    Parameters
    ----------
    elements_chief_mean
        Mean elements of the chief at the start, m and rad, shape (6,).
    relative_mean
        Mean relative elements at the start, m, shape (6,).
    duration
        s.
    drag
        Rate of the relative semi-major axis by differential drag, m/s.
    """
    relative = j2_transition_matrix(elements_chief_mean, duration) @ np.asarray(
        relative_mean, dtype=float
    )
    if drag:
        relative = relative + drag * drag_effect(elements_chief_mean, duration)
    return relative_state_of_mean_elements(
        propagate_mean_elements(elements_chief_mean, duration), relative
    )


def yamanaka_ankersen_transition_matrix(
    semi_major_axis: float, eccentricity: float, true_anomaly: float, duration: float
) -> FloatArray:
    """Return the transition matrix (6, 6) of RTN states about an eccentric two-body orbit.

    Parameters
    ----------
    semi_major_axis
        Semi-major axis of the chief, m.
    eccentricity
        In [0, 1).
    true_anomaly
        At the start, rad.
    duration
        s, may be negative.

    References
    ----------
    Yamanaka and Ankersen (2002), New State Transition Matrix for Relative Motion on an Arbitrary
    Elliptical Orbit, J. Guidance Control Dynamics 25(1), table 1 and eqs. (82) to (84); their axes
    are x = T, y = -N, z = -R.
    """
    e = eccentricity
    eta_squared = 1.0 - e * e
    mean_motion = math.sqrt(GM_EARTH / semi_major_axis**3)
    # k^2 of the paper: angular rate = k^2 rho^2.
    rate = mean_motion / eta_squared**1.5
    start_eccentric = math.atan2(
        math.sqrt(eta_squared) * math.sin(true_anomaly), e + math.cos(true_anomaly)
    )
    start_mean = start_eccentric - e * math.sin(start_eccentric)
    end_anomaly = true_anomaly_from_mean(start_mean + mean_motion * duration, e)
    fundamental_end = _fundamental_in_plane(e, end_anomaly, rate * duration)
    in_plane = fundamental_end @ np.linalg.inv(_fundamental_in_plane(e, true_anomaly, 0.0))
    turn = end_anomaly - true_anomaly
    cosine, sine = math.cos(turn), math.sin(turn)

    transition = np.zeros((6, 6))
    # States of the fundamental matrix: (x, z, x', z') = (T, -R, T', -R').
    signs = np.array([1.0, -1.0, 1.0, -1.0])
    rows = np.array([1, 0, 4, 3])
    transition[np.ix_(rows, rows)] = signs[:, np.newaxis] * in_plane * signs
    transition[np.ix_([2, 5], [2, 5])] = [[cosine, sine], [-sine, cosine]]
    scale_in = _scaling(e, true_anomaly, rate)
    return np.asarray(np.linalg.solve(_scaling(e, end_anomaly, rate), transition @ scale_in))


def _fundamental_in_plane(e: float, anomaly: float, k2_time: float) -> FloatArray:
    """Return the fundamental matrix of the scaled in-plane motion (x, z, x', z'), (4, 4)."""
    rho = 1.0 + e * math.cos(anomaly)
    s, c = rho * math.sin(anomaly), rho * math.cos(anomaly)
    s_rate = math.cos(anomaly) + e * math.cos(2.0 * anomaly)
    c_rate = -(math.sin(anomaly) + e * math.sin(2.0 * anomaly))
    j = k2_time
    return np.array(
        [
            [1.0, -c * (1.0 + 1.0 / rho), s * (1.0 + 1.0 / rho), 3.0 * rho * rho * j],
            [0.0, s, c, 2.0 - 3.0 * e * s * j],
            [0.0, 2.0 * s, 2.0 * c - e, 3.0 * (1.0 - 2.0 * e * s * j)],
            [0.0, s_rate, c_rate, -3.0 * e * (s_rate * j + s / (rho * rho))],
        ]
    )


def _scaling(e: float, anomaly: float, rate: float) -> FloatArray:
    """Return the matrix from states in time to states in true anomaly, scaled by rho, (6, 6)."""
    rho = 1.0 + e * math.cos(anomaly)
    identity = np.eye(3)
    return np.block(
        [
            [rho * identity, np.zeros((3, 3))],
            [-e * math.sin(anomaly) * identity, identity / (rate * rho)],
        ]
    )
