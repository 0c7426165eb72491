"""Fuel that formation keeping spends on the errors of navigation, by theory.

The linear loop of `delay_aware` at the bandwidth that the covariance asks for, driven by Gauss-
Markov errors of navigation: the covariance of its commands is the solution of a Lyapunov equation
(Kwakernaak and Sivan 1972, Linear Optimal Control Systems, section 6.2.12). The observer smooths
the errors before they reach the gain, so what is flown lies below.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from vtff_analysis.closed_loop.drawn_navigation import NavigationErrorModel
from vtff_control.tracking.bandwidth import BandwidthSchedule, weights_at_level
from vtff_control.tracking.riccati import delayed_riccati_gain, delayed_system
from vtff_control.tracking.sdre import SdreDesign
from vtff_dynamics.relative.motion import hcw_state_matrix
from vtff_dynamics.vectors import FloatArray

__all__ = ["expected_delta_v_per_hour"]


def expected_delta_v_per_hour(
    design: SdreDesign, navigation: NavigationErrorModel, mean_motion: float
) -> FloatArray:
    """Return the expected sum of the size of the commands over an hour, m/s, shape (3,).

    Parameters
    ----------
    design
        A ``delay_aware`` or ``navigation_aware`` design; its observer and its quantum are not part
        of the theory.
    navigation
        Errors, whose covariance the controller knows; outages are not part of the theory.
    mean_motion
        Mean motion of the chief, rad/s.

    Raises
    ------
    ValueError
        If the design is another.
    """
    if design.design not in ("delay_aware", "navigation_aware"):
        raise ValueError(f"design: delay_aware or navigation_aware expected, got {design.design!r}")
    sigma = np.array([navigation.position_sigma] * 3 + [navigation.velocity_sigma] * 3)
    level = 0
    tolerated_deviation = design.options.tolerated_deviation
    if tolerated_deviation > 0.0:
        bandwidth = (design.weights.position / design.weights.control) ** 0.25
        schedule = BandwidthSchedule(bandwidth, tolerated_deviation)
        level = schedule.update(np.zeros(6), np.zeros(6), np.diag(sigma**2))
    matrix, weights = hcw_state_matrix(mean_motion), weights_at_level(design.weights, level)
    timing = design.sample_time, design.delay_steps
    gain = delayed_riccati_gain(matrix, weights, *timing)
    transition, effect = delayed_system(matrix, *timing)
    decay = 0.0
    if navigation.correlation_time > 0.0:
        decay = math.exp(-design.sample_time / navigation.correlation_time)
    size = len(transition)
    joint = np.zeros((size + 6, size + 6))
    joint[:size, :size] = transition - effect @ gain
    joint[:size, size:] = -effect @ gain[:, :6]
    joint[size:, size:] = decay * np.eye(6)
    noise = np.zeros_like(joint)
    noise[size:, size:] = (1.0 - decay * decay) * np.diag(sigma**2)
    covariance = solve_discrete_lyapunov(joint, noise)
    command = np.hstack((gain, gain[:, :6]))
    variance = np.einsum("ij,jk,ik->i", command, covariance, command)
    return np.asarray(np.sqrt(2.0 / np.pi * variance) * 3600.0)
