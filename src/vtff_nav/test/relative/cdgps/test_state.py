"""The labelled Gaussian state against batch least squares and its own limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vtff_nav.relative.cdgps.state import GaussianState


def random_state(random: np.random.Generator, size: int) -> GaussianState:
    root = random.standard_normal((size, size))
    labels = [("member", index) for index in range(size)]
    return GaussianState(labels, random.standard_normal(size), root @ root.T + np.eye(size))


def measurements(random: np.random.Generator, size: int, count: int):
    design = random.standard_normal((count, size))
    return design, random.standard_normal(count), 0.1 + random.random(count)


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.integers(1, 6), st.integers(3, 12))
def test_update_is_least_squares(seed, size, count):
    """Prior and measurements together, nuisance parameter without prior."""
    random = np.random.default_rng(seed)
    state = random_state(random, size)
    design, values, variances = measurements(random, size, count)
    nuisance = random.standard_normal((count, 1))
    prior_mean, prior = state.mean.copy(), state.covariance.copy()
    innovation = state.innovation(design, values, variances, nuisance)
    state.update(innovation)
    whole = np.hstack((design, nuisance))
    normal = whole.T @ (whole / variances[:, None])
    normal[:size, :size] += np.linalg.inv(prior)
    solution = np.linalg.solve(normal, whole.T @ (values / variances))
    expected = np.linalg.inv(normal)
    np.testing.assert_allclose(state.mean - prior_mean, solution[:size], atol=1e-8)
    np.testing.assert_allclose(state.covariance, expected[:size, :size], atol=1e-8)
    np.testing.assert_allclose(innovation.nuisance_gain @ values, solution[size:], atol=1e-8)


def test_left_out_measurement_has_not_been_made():
    random = np.random.default_rng(5)
    design, values, variances = measurements(random, 4, 9)
    nuisance = np.ones((9, 1))
    with_all = random_state(np.random.default_rng(6), 4)
    without = random_state(np.random.default_rng(6), 4)
    innovation = with_all.innovation(design, values, variances, nuisance)
    innovation.leave_out(3)
    rows = np.arange(9) != 3
    fewer = without.innovation(design[rows], values[rows], variances[rows], nuisance[rows])
    assert innovation.degrees_of_freedom == fewer.degrees_of_freedom == 7
    assert innovation.squared_norm == pytest.approx(fewer.squared_norm, rel=1e-9)
    np.testing.assert_allclose(innovation.normalised[rows], fewer.normalised, atol=1e-9)
    with_all.update(innovation)
    without.update(fewer)
    np.testing.assert_allclose(with_all.mean, without.mean, atol=1e-10)
    np.testing.assert_allclose(with_all.covariance, without.covariance, atol=1e-10)


def test_noise_that_is_added_has_been_there():
    random = np.random.default_rng(5)
    design, values, variances = measurements(random, 4, 9)
    nuisance = np.ones((9, 1))
    state = random_state(np.random.default_rng(6), 4)
    innovation = state.innovation(design, values, variances, nuisance)
    innovation.add_noise(3, 2.5)
    noisier = variances + 2.5 * (np.arange(9) == 3)
    expected = state.innovation(design, values, noisier, nuisance)
    np.testing.assert_allclose(innovation.weight, expected.weight, atol=1e-10)
    np.testing.assert_allclose(innovation.noise, expected.noise)
    np.testing.assert_allclose(innovation.variances, expected.variances)


def test_residual_against_all_others():
    """The residual is the measurement less its prediction by an update with all others."""
    random = np.random.default_rng(7)
    design, values, variances = measurements(random, 4, 9)
    nuisance = np.ones((9, 1))
    state = random_state(np.random.default_rng(8), 4)
    residual, variance = state.innovation(design, values, variances, nuisance).leave_one_out
    rows = np.arange(9) != 2
    others = state.innovation(design[rows], values[rows], variances[rows], nuisance[rows])
    change = state.update(others)
    clock = float((others.nuisance_gain @ values[rows])[0])
    assert residual[2] == pytest.approx(values[2] - design[2] @ change - clock, abs=1e-9)
    assert variance[2] > variances[2]


def test_statistics_without_faults():
    """The squared norm is chi-square, the normalised innovations are standard normal."""
    random = np.random.default_rng(11)
    squares, normalised = [], []
    for _ in range(2000):
        state = random_state(np.random.default_rng(3), 3)
        design, _, variances = measurements(np.random.default_rng(4), 3, 8)
        error = np.linalg.cholesky(state.covariance) @ random.standard_normal(3)
        values = design @ error + np.sqrt(variances) * random.standard_normal(8)
        values += 1e3 * random.standard_normal()  # the nuisance parameter
        innovation = state.innovation(design, values, variances, np.ones((8, 1)))
        squares.append(innovation.squared_norm)
        normalised.append(innovation.normalised)
    assert np.mean(squares) == pytest.approx(7.0, abs=5.0 * np.sqrt(14.0 / 2000))
    assert np.std(normalised) == pytest.approx(1.0, abs=0.03)


def test_unknown_ambiguity_meets_a_millimetre():
    """No digits are lost between a prior of 10 m and phases of 1 mm."""
    size = 6
    prior = np.full(size, 100.0)
    state = GaussianState(range(size), np.zeros(size), np.diag(prior))
    random = np.random.default_rng(2)
    normal = np.diag(1.0 / prior)
    for _ in range(200):
        design = random.standard_normal((8, size))
        normal += design.T @ design / 1e-6
        state.update(state.innovation(design, np.zeros(8), np.full(8, 1e-6), np.zeros((8, 0))))
    np.testing.assert_allclose(state.covariance, np.linalg.inv(normal), rtol=1e-5, atol=1e-13)
    assert np.linalg.eigvalsh(state.covariance).min() > 0.0


def test_constraint_holds_exactly():
    state = random_state(np.random.default_rng(8), 5)
    design = np.array([[1.0, -1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 2.0, 0.0, 1.0]])
    values = np.array([0.3, -0.7])
    target = design @ state.mean + values
    before = state.covariance.copy()
    state.constrain(design, values, design @ before @ design.T)
    np.testing.assert_allclose(design @ state.mean, target, atol=1e-12)
    np.testing.assert_allclose(design @ state.covariance @ design.T, 0.0, atol=1e-12)
    assert np.linalg.eigvalsh(before - state.covariance).min() > -1e-9


def test_members_come_and_go():
    state = GaussianState(["a", "b"], [1.0, 2.0], np.diag([4.0, 9.0]))
    state.add("c", 3.0, 16.0)
    assert "c" in state
    assert (state.value("c"), state.sigma("c")) == (3.0, 4.0)
    state.rename("b", "d")
    state.remove(["a", "absent"])
    assert state.labels == ["d", "c"]
    assert (state.index("c"), state.sigma("d")) == (1, 3.0)
    state.add_noise("d", 7.0)
    assert state.sigma("d") == 4.0


def test_gauss_markov_reaches_its_steady_state():
    state = GaussianState(["a", "b"], [5.0, 1.0], np.array([[9.0, 2.0], [2.0, 1.0]]))
    for _ in range(200):
        state.predict_gauss_markov(np.array([0.9, 1.0]), np.array([4.0, 0.0]), np.zeros(2))
    assert state.value("a") == pytest.approx(0.0, abs=1e-8)
    assert state.sigma("a") == pytest.approx(2.0)
    assert state.covariance[0, 1] == pytest.approx(0.0, abs=1e-8)


def test_bad_covariance_is_told():
    state = GaussianState(["a"], [0.0], [[-1.0]])
    with pytest.raises(ValueError, match="not positive definite"):
        state.innovation(np.ones((1, 1)), np.zeros(1), np.zeros(1), np.zeros((1, 0)))


def test_states_that_are_joined_are_predicted_as_one():
    """Blocks of members, one after the other, as by the transition matrix of all of them."""
    random = np.random.default_rng(4)
    state, other = random_state(random, 3), random_state(random, 4)
    other = GaussianState([("other", i) for i in range(4)], other.mean, other.covariance)
    before = other.covariance.copy()
    state.join(other)
    np.testing.assert_array_equal(state.part("other").covariance, before)
    np.testing.assert_array_equal(state.covariance[:3, 3:], 0.0)
    design, values, variances = measurements(random, 7, 5)
    state.update(state.innovation(design, values, variances, np.zeros((5, 0))))
    transitions, noise = (random.standard_normal((3, 3)), random.standard_normal((2, 2))), np.eye(3)
    whole = np.eye(7)
    whole[:3, :3], whole[3:5, 3:5] = transitions
    expected = whole @ state.covariance @ whole.T
    expected[:3, :3] += noise
    mean = state.mean.copy()
    state.predict_block(3, np.ones(2), transitions[1], np.zeros((2, 2)))
    state.predict_block(0, np.zeros(3), transitions[0], noise)
    np.testing.assert_allclose(state.covariance, expected, atol=1e-12)
    np.testing.assert_array_equal(state.mean, [0.0, 0.0, 0.0, 1.0, 1.0, *mean[5:]])
    assert state.part("other").labels == other.labels


def test_a_copy_moves_with_its_original():
    """A copy and the original are one unknown until one of them gets noise of its own."""
    random = np.random.default_rng(2)
    state = random_state(random, 3)
    state.add_copy(("copy",), ("member", 1), 0.7)
    design = np.zeros((1, 4))
    design[0, 1], design[0, 3] = -1.0, 1.0
    np.testing.assert_allclose(design @ state.covariance, 0.0, atol=1e-12)
    state.update(state.innovation(np.eye(4)[:1], np.ones(1), np.ones(1), np.zeros((1, 0))))
    assert state.value(("copy",)) - state.value(("member", 1)) == pytest.approx(0.7)
    state.add_noise(("copy",), 0.25)
    assert (design @ state.covariance @ design.T).item() == pytest.approx(0.25)
