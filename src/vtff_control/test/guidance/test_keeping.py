"""Estimator of mean relative elements, and keeping by pulses of an engine."""

import math

import numpy as np
import pytest

from vtff_control.guidance.elements_estimator import ElementsEstimator
from vtff_control.guidance.keeping import (
    T5_ENGINE,
    FormationKeeper,
    KeepingEngine,
    drift_is_known,
)
from vtff_dynamics.orbit.mean_elements import osculating_elements, state_from_elements
from vtff_dynamics.relative.designs import helix
from vtff_dynamics.relative.relative_elements import (
    control_matrix,
    mean_relative_elements,
    relative_state_of_mean_elements,
)
from vtff_dynamics.relative.transition import j2_transition_matrix, propagate_mean_elements

CHIEF = np.array([6.95e6, 0.4, 1e-3, -5e-4, 1.3, 0.2])
MASS = 120.0


def states(elements, time):
    chief = propagate_mean_elements(CHIEF, time)
    relative = j2_transition_matrix(CHIEF, time) @ elements
    return state_from_elements(osculating_elements(chief)), relative_state_of_mean_elements(
        chief, relative
    )


def test_estimate_is_better_than_its_states_and_its_covariance_honest():
    sigma = np.array([2e-3] * 3 + [2e-5] * 3)
    squares, single = [], []
    for seed in range(12):
        generator = np.random.default_rng(seed)
        truth = generator.normal(0.0, 60.0, 6) * [0.01, 1.0, 1.0, 1.0, 1.0, 1.0]
        estimator = ElementsEstimator(
            model_position_sigma=1e-5, model_velocity_sigma=1e-8, correlation_time=0.0
        )
        for time in np.arange(0.0, 5400.0, 180.0):
            chief, relative = states(truth, time)
            noisy = relative + sigma * generator.standard_normal(6)
            estimator.update(time, chief, noisy, np.diag(sigma**2))
        expected = j2_transition_matrix(CHIEF, time) @ truth
        error = estimator.elements - expected
        squares.append(error @ np.linalg.solve(estimator.covariance, error))
        single.append(mean_relative_elements(chief, noisy) - expected)
        assert abs(error[0]) < 5e-3
    assert 0.4 < np.mean(squares) / 6.0 < 1.8
    assert np.std([error[0] for error in single]) > 0.02


def test_thrust_moves_the_estimate():
    estimator = ElementsEstimator()
    chief, relative = states(helix(50.0, 80.0, 0.3), 0.0)
    estimator.update(0.0, chief, relative)
    before = estimator.elements.copy()
    variance = estimator.covariance[0, 0]
    estimator.add_thrust([0.0, 1e-4, 0.0], 10.0)
    # Gauss: the semi-major axis grows by 2 dv / n.
    assert estimator.elements[0] - before[0] == pytest.approx(
        2e-3 / estimator.mean_motion, rel=1e-6
    )
    assert estimator.covariance[0, 0] > variance


def flown_with_engines(seed, correlation_time, until=4500.0):
    """Return the estimator, the true elements and the true errors of both engines, after a burn.

    Errors of navigation are correlated over a time, s; thrust is reported without its errors.
    """
    generator = np.random.default_rng(seed)
    errors = generator.normal(0.0, 0.05, (2, 3, 3))
    sigma = np.array([2e-3] * 3 + [2e-5] * 3)
    decay = math.exp(-60.0 / correlation_time) if correlation_time else 0.0
    noise = sigma * generator.standard_normal(6)
    estimator = ElementsEstimator()
    elements, step = helix(50.0, 80.0, 0.3), 30.0
    for time in np.arange(0.0, until, step):
        mean = propagate_mean_elements(CHIEF, time)
        if time % 60.0 == 0.0:
            relative = relative_state_of_mean_elements(mean, elements)
            drawn = generator.standard_normal(6)
            noise = decay * noise + math.sqrt(1.0 - decay**2) * sigma * drawn
            chief = state_from_elements(osculating_elements(mean))
            estimator.update(time, chief, relative + noise, np.diag(sigma**2))
        # Both burn for a third of an hour, along all axes and not at the same time.
        own = 2e-5 * np.array([math.cos(time / 400.0), math.sin(time / 300.0), 1.0])
        own, other = own * (time < 1200.0), own[::-1] * (900.0 <= time < 2100.0)
        estimator.add_thrust(own, step, time % 60.0 + 0.5 * step, other)
        effect = control_matrix(estimator.mean_motion, mean[1] + 0.5 * step * estimator.mean_motion)
        change = own + errors[0] @ own - other - errors[1] @ other
        half = j2_transition_matrix(mean, 0.5 * step)
        elements = half @ (half @ elements + step * effect @ change)
    at_update = j2_transition_matrix(CHIEF, -(until - estimator.time)) @ elements
    return estimator, at_update, errors


@pytest.mark.parametrize("correlation_time", [0.0, 300.0])
def test_errors_of_engines_are_learnt_and_the_covariance_is_honest(correlation_time):
    squares, left = [], []
    for seed in range(6):
        estimator, true, errors = flown_with_engines(seed, correlation_time)
        missing = estimator.elements - true
        squares.append(missing @ np.linalg.solve(estimator.covariance, missing) / 6.0)
        left.append(np.diag(estimator.engine_errors - errors[0]))
        left.append(np.diag(estimator.engine_errors_chief - errors[1]))
    # White errors are taken for correlated ones: the filter then states too much, never too little.
    assert (0.3 if correlation_time else 0.02) < np.mean(squares) < 1.8
    # Known to 5 % before; along the track by its part in the drift alone.
    radial, in_track, normal = np.sqrt(np.mean(np.square(left), axis=0))
    assert radial < 0.01
    assert normal < 0.03
    assert in_track < 0.045


def test_thrust_that_nobody_noted_begins_anew():
    estimator, true, _ = flown_with_engines(1, 300.0, until=3000.0)
    time = estimator.time + 60.0
    chief, relative = states(helix(50.0, 80.0, 0.3) + [0.0, 0.0, 0.0, 0.0, 0.0, 2.0], time)
    estimator.update(time, chief, relative)
    np.testing.assert_allclose(estimator.elements, mean_relative_elements(chief, relative))
    assert not estimator.engine_errors.any()


def test_an_engine_that_is_known_to_be_weak_is_told_more():
    engine = KeepingEngine(largest=0.01, smallest=1e-4, step=1e-6)
    design = helix(60.0, 90.0, 1.0)
    total = {}
    for share in (0.0, -0.2):
        keeper = FormationKeeper(design, engine, MASS, 10.0)
        keeper.engine_errors = share * np.eye(3)
        keeper.estimator.update(0.0, *states(design + [0.3, 2.0, 1.0, -1.0, 2.0, 1.0], 0.0))
        thrust = [keeper.command(time, True) for time in np.arange(0.0, 250.0, 10.0)]
        total[share] = np.abs(thrust).sum()
    assert total[0.0] > 0.0
    assert total[-0.2] == pytest.approx(total[0.0] / 0.8, rel=0.01)


def test_pulses_are_those_of_the_engine():
    engine = KeepingEngine(largest=0.01, smallest=2e-3, step=1e-4)
    design = helix(60.0, 90.0, 1.0)
    keeper = FormationKeeper(design, engine, MASS, 10.0)
    pulses = []
    for time in np.arange(0.0, 9000.0, 10.0):
        if time % 60.0 == 0.0:
            keeper.estimator.update(time, *states(design + [0.3, 2.0, 1.0, -1.0, 2.0, 1.0], time))
        pulses.append(keeper.command(time) * MASS)
    thrust = np.abs(np.array(pulses))
    fired = thrust[thrust > 0.0]
    assert len(fired) > 3
    assert fired.min() >= engine.smallest * (1.0 - 1e-9)
    assert fired.max() <= engine.largest * (1.0 + 1e-9)
    steps = fired / engine.step
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert not thrust[:, 0].any()


def test_the_first_decision_comes_when_the_drift_is_known():
    """After a reconfiguration the rest of its errors drifts by decimetres until somebody acts."""
    sigma = np.array([2e-3] * 3 + [2e-5] * 3)
    design = helix(60.0, 90.0, 1.0)
    ends = {}
    for may_begin in (None, False):
        generator = np.random.default_rng(5)
        keeper = FormationKeeper(design, T5_ENGINE, MASS, 10.0)
        assert not drift_is_known([keeper])
        known, true = math.nan, design + [0.04, 0.1, 0.0, 0.0, 0.0, 0.0]
        for time in np.arange(0.0, 4000.0, 10.0):
            if time % 60.0 == 0.0:
                chief, relative = states(true, time)
                noisy = relative + sigma * generator.standard_normal(6)
                keeper.estimator.update(time, chief, noisy, np.diag(sigma**2))
            if drift_is_known([keeper]) and math.isnan(known):
                known = time
            if keeper.command(time, may_begin).any():
                break
        ends[may_begin] = time
        assert 60.0 < known < 900.0
    quarter = 0.5 * math.pi / keeper.estimator.mean_motion
    assert ends[None] < quarter <= ends[False]


def test_nothing_is_commanded_before_a_state_and_the_engine_is_checked():
    keeper = FormationKeeper(np.zeros(6), T5_ENGINE, MASS, 10.0)
    assert not keeper.command(0.0).any()
    assert math.isnan(keeper.estimator.time)
    with pytest.raises(ValueError, match="in this order"):
        KeepingEngine(1e-3, 2e-3, 1e-4)


def flown_after_a_push(push_rtn, hours):
    """Return deviations from the design (m, shape (k, 6)) and thrust (m/s2, (k, 3)) after a push.

    The push takes place in no time and is not noted; the ion engine gives it in minutes.
    """
    generator = np.random.default_rng(5)
    sigma = np.array([1.5e-3] * 3 + [1.5e-5] * 3)
    design, mass, step = helix(50.0, 80.0, 0.3), 1600.0, 10.0
    estimator = ElementsEstimator(correlation_time=0.0)
    keeper = FormationKeeper(design, T5_ENGINE, mass, step, estimator=estimator)
    elements = design.copy()
    deviations, thrusts = [], []
    for time in np.arange(0.0, 3600.0 * hours, step):
        mean = propagate_mean_elements(CHIEF, time)
        if time % 60.0 == 0.0:
            relative = relative_state_of_mean_elements(mean, elements)
            chief = state_from_elements(osculating_elements(mean))
            noisy = relative + sigma * generator.standard_normal(6)
            estimator.update(time, chief, noisy, np.diag(sigma**2))
        thrust = keeper.command(time)
        estimator.add_thrust(thrust, step, time % 60.0 + 0.5 * step)
        change = step * thrust + np.multiply(push_rtn, time == 600.0)
        latitude = mean[1] + 0.5 * step * estimator.mean_motion
        half = j2_transition_matrix(mean, 0.5 * step)
        moved = control_matrix(estimator.mean_motion, latitude) @ change
        elements = half @ (half @ elements + moved)
        deviations.append(elements - design)
        thrusts.append(thrust)
    return np.array(deviations), np.array(thrusts)


@pytest.mark.parametrize(
    ("push_rtn", "cost"),
    [((0.0, 0.01, 0.0), 0.035), ((0.01, -0.003, 0.004), 0.035)],
)
def test_an_engine_too_weak_for_a_return_at_once_takes_its_time(push_rtn, cost):
    """A push that the engine needs ten minutes for neither swings up nor costs much more."""
    deviations, thrusts = flown_after_a_push(push_rtn, 5.0)
    assert np.abs(deviations).max() > 5.0
    assert (np.abs(deviations[-360:]) < 0.6).all()
    assert np.abs(thrusts).sum() * 10.0 < cost
    assert np.abs(thrusts).max() <= T5_ENGINE.largest / 1600.0


def test_a_state_out_of_all_reach_is_answered_within_the_longest_plan():
    """A deputy that is said to be a thousand kilometres off costs neither memory nor time."""
    estimator = ElementsEstimator()
    keeper = FormationKeeper(helix(50.0, 80.0, 0.3), T5_ENGINE, 1600.0, 10.0, estimator=estimator)
    chief, relative = states(1e6 * np.array([0.3, 1.0, 0.5, 0.5, 0.2, 0.2]), 0.0)
    estimator.update(0.0, chief, relative)
    thrust = keeper.command(0.0, may_begin=True)
    assert np.abs(thrust).max() <= T5_ENGINE.largest / 1600.0
    orbit = 2.0 * math.pi / estimator.mean_motion
    assert 0 < len(keeper._schedule) <= 8.0 * orbit / 10.0
