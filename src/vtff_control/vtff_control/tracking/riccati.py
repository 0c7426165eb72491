"""Riccati gains of relative motion, continuous and sampled with a delay.

The motion is ``x' = A x + B u`` with x the relative position and velocity in RTN and u the thrust
acceleration. The cost of a gain is quadratic: ``Q`` on the deviation, ``R`` on the acceleration.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm, solve_continuous_are, solve_discrete_are

from vtff_dynamics.vectors import FloatArray

INPUT_MATRIX: FloatArray = np.vstack((np.zeros((3, 3)), np.eye(3)))
"""Input matrix B of ``x' = A x + B u``, shape (6, 3): thrust accelerates the relative velocity."""


class Weights(NamedTuple):
    """Diagonal weights of the quadratic cost: ``Q = diag(position, velocity)``, ``R = control``."""

    position: float
    velocity: float
    control: float


def state_weight_matrix(weights: Weights) -> FloatArray:
    """Return ``Q = diag(position, position, position, velocity, ...)``, shape (6, 6)."""
    return np.diag([weights.position] * 3 + [weights.velocity] * 3)


def riccati_gain(state_matrix: npt.ArrayLike, weights: Weights) -> FloatArray:
    """Gain of the continuous Riccati equation (paper, section 3.5).

    Parameters
    ----------
    state_matrix
        A of ``x' = A x + B u``, shape (6, 6).
    weights
        Weights of the cost.

    Returns
    -------
    ndarray, shape (3, 6)
        ``K = R^-1 B' G`` of ``u = -K (x - x_d)``, where G solves
        ``G A + A' G - G B R^-1 B' G + Q = 0``.

    Raises
    ------
    numpy.linalg.LinAlgError
        If there is no stabilising solution.
    """
    solution = solve_continuous_are(
        state_matrix, INPUT_MATRIX, state_weight_matrix(weights), weights.control * np.eye(3)
    )
    return np.asarray(INPUT_MATRIX.T @ solution / weights.control)


def discretise(state_matrix: npt.ArrayLike, sample_time: float) -> tuple[FloatArray, FloatArray]:
    """Sample ``x' = A x + B u`` with the input held constant over one sample.

    Parameters
    ----------
    state_matrix
        A, shape (6, 6).
    sample_time
        Sample interval in s.

    Returns
    -------
    transition : ndarray, shape (6, 6)
    input_effect : ndarray, shape (6, 3)
        Matrices of ``x[k+1] = transition x[k] + input_effect u[k]``.
    """
    joint = np.zeros((9, 9))
    joint[:6, :6] = state_matrix
    joint[:6, 6:] = INPUT_MATRIX
    sampled = np.asarray(expm(joint * sample_time))
    return sampled[:6, :6], sampled[:6, 6:]


def delayed_system(
    state_matrix: npt.ArrayLike, sample_time: float, delay_steps: int
) -> tuple[FloatArray, FloatArray]:
    """Sample the relative motion with the waiting commands as states.

    The state is ``(x, u_1, ..., u_d)``, where ``u_1`` acts in the coming interval and a new
    command enters the queue behind ``u_d``.

    Parameters
    ----------
    state_matrix
        A of the continuous motion, shape (6, 6).
    sample_time
        Sample interval in s.
    delay_steps
        Length d of the queue, 0 or more.

    Returns
    -------
    transition : ndarray, shape (6 + 3 d, 6 + 3 d)
    input_effect : ndarray, shape (6 + 3 d, 3)
    """
    transition, input_effect = discretise(state_matrix, sample_time)
    if delay_steps == 0:
        return transition, input_effect
    size = 6 + 3 * delay_steps
    transition_queue = np.zeros((size, size))
    transition_queue[:6, :6] = transition
    transition_queue[:6, 6:9] = input_effect
    transition_queue[6:-3, 9:] = np.eye(size - 9)
    input_queue = np.zeros((size, 3))
    input_queue[-3:] = np.eye(3)
    return transition_queue, input_queue


def delayed_riccati_gain(
    state_matrix: npt.ArrayLike, weights: Weights, sample_time: float, delay_steps: int
) -> FloatArray:
    """Gain of the discrete Riccati equation of `delayed_system`.

    Returns
    -------
    ndarray, shape (3, 6 + 3 delay_steps)
        Gain of ``u = -K (x - x_d, u_1, ..., u_d)``. A waiting command has no weight of its own:
        it was paid for when it was given.

    Raises
    ------
    numpy.linalg.LinAlgError
        If there is no stabilising solution.
    """
    transition, input_effect = delayed_system(state_matrix, sample_time, delay_steps)
    state_weight = np.zeros_like(transition)
    state_weight[:6, :6] = state_weight_matrix(weights)
    control_weight = weights.control * np.eye(3)
    solution = solve_discrete_are(transition, input_effect, state_weight, control_weight)
    coupling = input_effect.T @ solution
    return np.linalg.solve(control_weight + coupling @ input_effect, coupling @ transition)
