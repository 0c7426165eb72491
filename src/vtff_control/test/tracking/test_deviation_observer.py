"""The observer averages noise, finds constant disturbances, and cannot wind up."""

import numpy as np
import pytest

from vtff_control.tracking.deviation_observer import DeviationObserver
from vtff_control.tracking.riccati import discretise
from vtff_dynamics.relative.motion import hcw_state_matrix

MEAN_MOTION = 1.1e-3
TRANSITION, EFFECT = discretise(hcw_state_matrix(MEAN_MOTION), 1.0)
DISTURBANCE = np.array([2e-6, -3e-6, 1e-6])


def covariance(sigma: float) -> np.ndarray:
    return np.diag([sigma**2] * 3 + [(0.01 * sigma) ** 2] * 3)


def test_a_constant_disturbance_is_found_and_noise_averaged() -> None:
    generator = np.random.default_rng(2)
    observer, state, sigma = DeviationObserver(1.0), np.zeros(6), 1e-3
    deviations = np.array([sigma] * 3 + [0.01 * sigma] * 3)
    errors = []
    for step in range(1500):
        measured = state + deviations * generator.standard_normal(6)
        estimate = observer.update(measured, covariance(sigma))
        errors.append(estimate - state)
        command = -0.01 * state[:3] - 0.2 * state[3:] + 1e-6 * np.sin(0.01 * step)
        observer.predict(command, MEAN_MOTION)
        state = TRANSITION @ state + EFFECT @ (command + DISTURBANCE)
    np.testing.assert_allclose(observer.disturbance_rtn, DISTURBANCE, atol=5e-7)
    assert np.sqrt(np.mean(np.square(np.array(errors)[500:, :3]))) < 0.4 * sigma


def test_saturation_does_not_wind_it_up() -> None:
    """A minute at the cap with a thruster that is 5 % strong leaves no disturbance behind."""
    observer = DeviationObserver(1.0)
    state = np.array([0.0, 900.0, 0.0, 0.0, 0.0, 0.0])
    command = np.array([0.0, -1.4, 0.0])
    for _ in range(60):
        observer.update(state, None)
        observer.predict(command, MEAN_MOTION)
        state = TRANSITION @ state + EFFECT @ (1.05 * command)
    assert np.abs(observer.disturbance_rtn).max() < 1e-6


def test_a_prediction_with_a_large_sigma_teaches_nothing() -> None:
    observer = DeviationObserver(1.0)
    for _ in range(100):
        observer.update(np.zeros(6), covariance(1e-3))
        observer.predict(np.zeros(3), MEAN_MOTION)
    before = observer.disturbance_rtn
    for step in range(60):
        observer.update(np.array([0.0, 0.3 * step, 0.0, 0.0, 0.3, 0.0]), covariance(30.0))
        observer.predict(np.zeros(3), MEAN_MOTION)
    np.testing.assert_allclose(observer.disturbance_rtn, before, atol=1e-6)


def test_a_restart_forgets_the_deviation_only() -> None:
    observer = DeviationObserver(1.0)
    state = np.zeros(6)
    for _ in range(300):
        observer.update(state, None)
        observer.predict(np.zeros(3), MEAN_MOTION)
        state = TRANSITION @ state + EFFECT @ DISTURBANCE
    found = observer.disturbance_rtn
    assert found == pytest.approx(DISTURBANCE, abs=1e-7)
    observer.restart()
    elsewhere = np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
    np.testing.assert_array_equal(observer.update(elsewhere, covariance(1.0)), elsewhere)
    np.testing.assert_array_equal(observer.disturbance_rtn, found)
