"""Riccati gains against their equations and against dynamic programming."""

import numpy as np
import pytest
from scipy.integrate import quad_vec

from vtff_control.tracking.riccati import (
    INPUT_MATRIX,
    Weights,
    delayed_riccati_gain,
    delayed_system,
    discretise,
    riccati_gain,
    state_weight_matrix,
)
from vtff_dynamics.relative.motion import hcw_state_matrix, hcw_transition_matrix

MEAN_MOTION = 1.0948e-3
PAPER = Weights(1e-4, 1e-4, 1.0)
DELAY_AWARE = Weights(1e-4, 1e-2, 1.0)


@pytest.mark.parametrize("weights", [PAPER, DELAY_AWARE, Weights(1e-6, 1e-3, 4.0)])
def test_continuous_gain_solves_riccati_equation(weights: Weights) -> None:
    state_matrix = hcw_state_matrix(MEAN_MOTION)
    gain = riccati_gain(state_matrix, weights)
    # The lower rows of G are R K; the upper left block follows from the equation's lower rows.
    lower = weights.control * gain
    solution = np.empty((6, 6))
    solution[3:] = lower
    solution[:3, 3:] = lower[:, :3].T
    quadratic = weights.control * gain.T @ gain
    weight = state_weight_matrix(weights)
    rest = quadratic - weight - solution @ state_matrix
    solution[:3, :3] = (rest - state_matrix.T[:, 3:] @ lower)[3:, :3]
    residual = solution @ state_matrix + state_matrix.T @ solution - quadratic + weight
    np.testing.assert_allclose(solution, solution.T, atol=1e-12)
    np.testing.assert_allclose(residual, 0.0, atol=1e-12)
    assert np.linalg.eigvalsh(solution).min() > 0.0


@pytest.mark.parametrize("mean_motion", [7e-5, MEAN_MOTION, 1.2e-3])
def test_continuous_loop_is_stable_with_the_damping_of_a_double_integrator(
    mean_motion: float,
) -> None:
    state_matrix = hcw_state_matrix(mean_motion)
    gain = riccati_gain(state_matrix, PAPER)
    poles = np.linalg.eigvals(state_matrix - INPUT_MATRIX @ gain)
    assert poles.real.max() < -0.05
    # Orbital rates are small beside the loop: position gain sqrt(q), velocity sqrt(q + 2 sqrt(q)).
    np.testing.assert_allclose(gain[:, :3], 0.01 * np.eye(3), atol=3e-4)
    np.testing.assert_allclose(gain[:, 3:], np.sqrt(0.0201) * np.eye(3), atol=3e-4)


def test_discretisation_is_the_transition_matrix_and_its_integral() -> None:
    transition, input_effect = discretise(hcw_state_matrix(MEAN_MOTION), 30.0)
    np.testing.assert_allclose(transition, hcw_transition_matrix(MEAN_MOTION, 30.0), atol=1e-12)
    integral, _ = quad_vec(lambda t: hcw_transition_matrix(MEAN_MOTION, t)[:, 3:], 0.0, 30.0)
    np.testing.assert_allclose(input_effect, integral, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("delay_steps", [0, 1, 3])
def test_delayed_system_applies_a_command_after_the_delay(delay_steps: int) -> None:
    state_matrix = hcw_state_matrix(MEAN_MOTION)
    transition, input_effect = discretise(state_matrix, 1.0)
    transition_queue, input_queue = delayed_system(state_matrix, 1.0, delay_steps)
    rng = np.random.default_rng(1)
    commands = rng.normal(size=(8, 3))
    state = rng.normal(size=6)
    queued = np.concatenate((state, np.zeros(3 * delay_steps)))
    for step, command in enumerate(commands):
        applied = commands[step - delay_steps] if step >= delay_steps else np.zeros(3)
        state = transition @ state + input_effect @ applied
        queued = transition_queue @ queued + input_queue @ command
        np.testing.assert_allclose(queued[:6], state, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("delay_steps", [0, 1, 2])
def test_delayed_gain_equals_dynamic_programming(delay_steps: int) -> None:
    state_matrix = hcw_state_matrix(MEAN_MOTION)
    transition, input_effect = delayed_system(state_matrix, 1.0, delay_steps)
    weight = np.zeros_like(transition)
    weight[:6, :6] = state_weight_matrix(DELAY_AWARE)
    cost = weight.copy()
    for _ in range(600):
        coupling = input_effect.T @ cost
        gain = np.linalg.solve(np.eye(3) + coupling @ input_effect, coupling @ transition)
        cost = weight + transition.T @ cost @ (transition - input_effect @ gain)
    solved = delayed_riccati_gain(state_matrix, DELAY_AWARE, 1.0, delay_steps)
    np.testing.assert_allclose(solved, gain, atol=1e-9)
    assert np.abs(np.linalg.eigvals(transition - input_effect @ solved)).max() < 1.0
