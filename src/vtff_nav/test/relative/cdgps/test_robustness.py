"""The relative filter, with its defaults, where its assumptions do not hold: short flights."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from cdgps_test_support import CHIEF, DEPUTY_250M, J2, START, configuration, fly, simulate
from cdgps_truth_support import longest_run, wrong_integers

from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.filter import RelativeFilter
from vtff_nav.relative.cdgps.state import GaussianState
from vtff_nav.relative.common.antenna_correction import Antenna, AntennaPair
from vtff_nav.relative.common.dynamics import (
    MotionNoise,
    OrbitalMotion,
    Prediction,
    ThrustInterval,
)
from vtff_nav.relative.common.solution import SOLUTION_FIXED
from vtff_nav.relative.kernels.sky import north_and_east, shell_paths
from vtff_nav.relative.noise.components import SlowError
from vtff_sim_bridge.gnss.configuration import MultipathModel, NoiseModel

SECONDS = 200
NEES_HIGH = 2.5


def nine(state: np.ndarray) -> np.ndarray:
    """Return a state with an empirical acceleration of zero."""
    return np.concatenate((state, np.zeros(3)))


def assert_honest(scenario, flight, bound: float) -> None:
    """Assert that a flight is fixed, within a bound (m), honest, and has the right integers."""
    wrong = [wrong_integers(scenario.truth, k, s) for k, s in enumerate(flight.solutions)]
    nees = flight.normalised_squares()[60:].mean() / 3.0
    print(f"3-D RMS {1e3 * flight.rms():.2f} mm, mean NEES {nees:.2f} of 1")
    assert flight.is_fixed[60:].all()
    assert longest_run(wrong) <= 2
    assert flight.rms() <= bound
    assert nees < NEES_HIGH
    assert np.mean([bool(s.degraded) for s in flight.solutions]) < 0.05
    # A satellite whose integer is not known yet does not degrade a fixed solution.
    fixed = [s for s in flight.solutions if s.solution == SOLUTION_FIXED]
    assert not any("ambiguities" in text for s in fixed for text in s.degraded)


@pytest.mark.parametrize(("phase", "code", "bound"), [(2e-3, 0.2, 6e-3), (5e-3, 0.5, 14e-3)])
def test_multipath(phase, code, bound):
    """Gauss-Markov multipath of 100 s that nobody states.

    The bounds are twice the covariance of such processes with plasma and exact dynamics.
    """
    changes = {"multipath": MultipathModel(code_sigma=code, phase_sigma=phase)}
    scenario = simulate(SECONDS, receiver_changes=changes)
    assert_honest(scenario, fly(scenario, configuration()), bound)


def test_noise_of_three_times_the_stated():
    """The bound is 2.5 times the sigma with noise of that size, 1.8 mm so early in a flight."""
    noise = NoiseModel("fixed", 0.6, 0.003, 0.01, stated_sigma_factor=1.0 / 3.0)
    scenario = simulate(SECONDS, receiver_changes={"noise": noise})
    assert_honest(scenario, fly(scenario, configuration()), 4.5e-3)


def test_thrust_of_another_scale_and_direction():
    """5 % more than reported and 2 deg off: found in the first seconds, and kept."""
    reported = np.array([0.3, -0.8, 0.2])
    turned = 1.05 * (reported + np.cross([0.02, -0.015, 0.025], reported))
    scenario = simulate(
        150, thrust_rtn=lambda k: turned if 40 <= k < 70 or 90 <= k < 100 else (0.0, 0.0, 0.0)
    )
    heard = np.where(scenario.thrust_rtn.any(axis=1)[:, None], reported, 0.0)
    flight = fly(dataclasses.replace(scenario, thrust_rtn=heard), configuration())
    squares = flight.normalised_squares() / 3.0
    assert squares[40:110].mean() < NEES_HIGH
    assert flight.error[91:100].max() < 10e-3
    assert flight.error[115:].max() < 4e-3
    assert flight.is_fixed[60:].all()


def test_thrust_coupling_is_the_derivative():
    """Against the motion with another thrust, for scale and misalignment."""
    acceleration = np.array([0.2, -0.7, 0.4])
    motion = OrbitalMotion(J2, MotionNoise(1e-6), MotionNoise(1e-6))

    def relative(thrust: np.ndarray) -> np.ndarray:
        burn = [ThrustInterval(START + 1.0, 2.0, thrust)]
        return motion.predict(START, 8.0, nine(CHIEF), nine(DEPUTY_250M - CHIEF), burn)

    coupling, size = relative(acceleration).thrust_coupling, 1e-3
    for error in range(4):
        axis = np.eye(3)[error - 1]
        change = acceleration if error == 0 else np.cross(axis, acceleration)
        moved = relative(acceleration + size * change).relative
        expected = (moved - relative(acceleration - size * change).relative) / (2.0 * size)
        np.testing.assert_allclose(coupling[:6, error], expected[:6], rtol=1e-4, atol=1e-5)


def test_an_error_of_the_attitude_turns_a_thrust_along_the_body():
    """The derivative of the filter is that of the motion with the turned thrust."""
    acceleration, error = np.array([0.2, -0.7, 0.4]), 1e-3 * np.array([0.5, -0.3, 0.8])
    to_rtn = np.array([[0.0, 0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, -0.6]])
    motion = OrbitalMotion(J2, MotionNoise(1e-6), MotionNoise(1e-6))
    difference = nine(DEPUTY_250M - CHIEF)

    def predicted(thrust: np.ndarray) -> Prediction:
        burn = [ThrustInterval(START, 2.0, thrust)]
        return motion.predict(START, 2.0, nine(CHIEF), difference, burn)

    moved = predicted(acceleration + np.cross(to_rtn @ error, acceleration)).relative
    for rotation, expected in ((to_rtn, moved), (None, predicted(acceleration).relative)):
        filter_ = RelativeFilter(CdgpsConfiguration(), difference, 1e-6 * np.eye(9), 0.0)
        labels = [("attitude_error", 1, axis) for axis in range(3)]
        filter_.expect_attitude_errors(dict.fromkeys(labels, 1e-4), {})
        for label, value in zip(labels, error, strict=True):
            filter_.state.mean[filter_.state.index(label)] = value
        filter_.predict(predicted(acceleration), 2.0, np.zeros(2), rotation)
        np.testing.assert_allclose(filter_.state.mean[:6], expected[:6], rtol=0.0, atol=1e-7)
        covariance = filter_.state.covariance[:3, filter_.state.index(labels[0])]
        assert covariance.any() == (rotation is not None)


def test_a_newer_attitude_has_the_error_of_the_one_before_it_less_its_turn():
    """The antenna stays where it was; a smaller sigma is information, a larger one is noise."""
    difference, label = nine(DEPUTY_250M - CHIEF), ("attitude_error", 1, 0)
    filter_ = RelativeFilter(CdgpsConfiguration(), difference, 1e-6 * np.eye(9), 0.0)
    filter_.expect_attitude_errors({label: 4e-4}, {})
    index = filter_.state.index(label)
    # The position has the error of the attitude at a lever arm of 0.4 m.
    filter_.state.covariance[0, 0] = 0.4**2 * 4e-4 + 1e-10
    filter_.state.covariance[0, index] = filter_.state.covariance[index, 0] = -0.4 * 4e-4
    antenna = np.zeros(len(filter_.state))
    antenna[[0, index]] = 1.0, 0.4

    def sigmas() -> np.ndarray:
        covariance = filter_.state.covariance
        variances = covariance[0, 0], covariance[index, index], antenna @ covariance @ antenna
        return np.sqrt(np.array(variances))

    filter_.expect_attitude_errors({label: 1e-4}, {label: 5e-3})
    # Half the sigma: the position has gained as much, and the antenna is where it was.
    np.testing.assert_allclose(sigmas(), [0.4e-2, 1e-2, 1e-5], rtol=1e-3)
    # Navigation knows nothing of the error itself: the new attitude is as likely as the old one.
    assert filter_.state.mean[index] == pytest.approx(0.0, abs=1e-9)
    assert filter_.state.mean[0] - difference[0] == pytest.approx(-0.4 * 5e-3, rel=1e-3)
    filter_.expect_attitude_errors({label: 9e-4}, {label: 0.0})
    np.testing.assert_allclose(sigmas()[:2], [0.4e-2, 3e-2], rtol=1e-3)
    # Half a radian away is no newer estimate of the same, nor is an attitude that was unknown.
    for turns in ({label: 0.5}, {}):
        filter_.expect_attitude_errors({label: 1e-4}, turns)
        assert filter_.state.mean[index] == 0.0
        assert not filter_.state.covariance[0, index]


@pytest.mark.parametrize("antenna_sigma", [1e-4, 1e-2, 1.0])
def test_corrections_of_the_attitude_against_a_solution_of_all_measurements(antenna_sigma):
    """A constant attitude, measured at each estimate; the antenna at its arm is measured once."""
    difference, label, arm = nine(DEPUTY_250M - CHIEF), ("attitude_error", 1, 0), 0.4
    measured, sigma = np.array([8e-3, -15e-3, 4e-3, -2e-3]), 1e-2
    position_sigma, antenna = 3e-3, -4e-3  # m
    estimates = np.cumsum(measured) / np.arange(1, 5)
    variances = sigma**2 / np.arange(1, 5)
    motion = np.diag([position_sigma**2, *np.full(8, 1e-6)])
    filter_ = RelativeFilter(CdgpsConfiguration(), difference, motion, 0.0)
    state = filter_.state
    filter_.expect_attitude_errors({label: variances[0]}, {})
    index = state.index(label)
    design = np.zeros((1, len(state)))
    design[0, [0, index]] = 1.0, arm
    residual = np.array([antenna - arm * estimates[0]])
    noise = np.array([antenna_sigma**2])
    state.update(state.innovation(design, residual, noise, np.zeros((1, 0))))
    for variance, turn in zip(variances[1:], np.diff(estimates), strict=True):
        filter_.expect_attitude_errors({label: variance}, {label: turn})
    # Position and attitude from all of it at once.
    rows = np.array([[1.0, 0.0], [1.0, arm], *np.tile([0.0, 1.0], (4, 1))])
    sigmas = np.array([position_sigma, antenna_sigma, *np.full(4, sigma)])
    values = np.array([0.0, antenna, *measured])
    information = (rows / sigmas[:, None] ** 2).T @ rows
    expected = np.linalg.solve(information, (rows / sigmas[:, None] ** 2).T @ values)
    found = [state.mean[0] - difference[0], estimates[-1] + state.mean[index]]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8)
    both = state.covariance[np.ix_([0, index], [0, index])]
    np.testing.assert_allclose(both, np.linalg.inv(information), rtol=1e-6)


def test_corrections_that_undo_a_drift_do_not_sum_up():
    """The attitude drifts, and its estimator takes that back in every period."""
    difference, label = nine(DEPUTY_250M - CHIEF), ("attitude_error", 1, 0)
    filter_ = RelativeFilter(CdgpsConfiguration(), difference, 1e-6 * np.eye(9), 0.0)
    filter_.expect_attitude_errors({label: 1e-4}, {})
    for _ in range(300):
        filter_.expect_attitude_errors({label: 1e-4}, {label: 2e-4})
    assert filter_.state.mean[filter_.state.index(label)] == pytest.approx(0.0, abs=1e-9)


def test_shells_against_a_ray_through_a_thick_layer():
    """A layer whose density grows to north-east, integrated along both rays."""
    radius, height, half = 6.93e6, 200e3, 20e3
    chief = radius * np.array([0.6, 0.3, 0.74]) / np.linalg.norm([0.6, 0.3, 0.74])
    axes = north_and_east(chief)
    positions = np.array(
        [chief, chief + 4000.0 * axes[0] + 2500.0 * axes[1] - 800.0 * chief / radius]
    )
    zenith, slopes = chief / radius, (0.7, -0.4)
    angles = [(0.3, 0.2), (1.0, 2.0), (0.6, 4.0), (1.4, 5.5)]
    direction = np.array(
        [
            np.cos(e) * (np.cos(a) * axes[0] + np.sin(a) * axes[1]) + np.sin(e) * zenith
            for e, a in angles
        ]
    )

    def content(position: np.ndarray, ray: np.ndarray) -> float:
        distance = np.linspace(0.0, 2.5e6, 500_001)
        points = position + distance[:, None] * ray
        size = np.linalg.norm(points, axis=1)
        inside = np.abs(size - radius - height) < half
        place = np.degrees(np.arcsin(points @ axes.T / size[:, None]))
        density = (1.0 + place @ slopes) / (2.0 * half)
        return float(np.sum(density * inside) * (distance[1] - distance[0]))

    expected = [content(positions[1], ray) - content(positions[0], ray) for ray in direction]
    columns = shell_paths(
        positions, np.array([direction, direction]), np.array([height, 1.5 * height])
    )
    assert columns.shape == (len(angles), 6)
    np.testing.assert_allclose(columns[:, :3] @ [1.0, *slopes], expected, rtol=0.05, atol=2e-3)


def test_coupling_and_reweighing_against_a_batch():
    """A constant whose a priori variance is changed afterwards, and a member that it moves."""
    random = np.random.default_rng(2)
    labels = [("position",), ("rate",)]
    state = GaussianState(labels, np.zeros(2), np.diag([4.0, 9.0]))
    rows, values = [], []
    for epoch in range(5):
        if epoch:
            state.transform([0], np.array([[1.0, 0.5]]))
        value = np.array([random.standard_normal()])
        design = np.array([[1.0, 0.0]])
        empty = np.zeros((1, 0))
        state.update(state.innovation(design, value - state.mean[:1], np.array([0.1]), empty))
        rows.append([1.0, 0.5 * epoch])
        values.append(value[0])
    state.reweigh([("rate",)], 9.0, 0.25)
    design = np.array(rows)
    information = np.diag([1.0 / 4.0, 1.0 / 0.25]) + design.T @ design / 0.1
    first = np.linalg.solve(information, design.T @ np.array(values) / 0.1)
    to_last = np.array([[1.0, 2.0], [0.0, 1.0]])
    np.testing.assert_allclose(state.mean, to_last @ first, rtol=1e-9)
    expected = to_last @ np.linalg.inv(information) @ to_last.T
    np.testing.assert_allclose(state.covariance, expected, rtol=1e-9)


def test_likelihood_of_other_variances_against_a_batch():
    """Constants that are estimated with others; a variance may be zero."""
    random = np.random.default_rng(3)
    last = np.array([4.0, 9.0, 1.0, 100.0])
    labels = [("weighed", 0), ("weighed", 1), ("other", 0), ("other", 1)]
    design, noise = random.standard_normal((7, 4)), np.full(7, 0.2)
    values = design @ (np.sqrt([0.5, 0.0, 1.0, 100.0]) * random.standard_normal(4))
    state = GaussianState(labels, np.zeros(4), np.diag(last))
    for row in range(7):
        part = slice(row, row + 1)
        residual = values[part] - design[part] @ state.mean
        state.update(state.innovation(design[part], residual, noise[part], np.zeros((1, 0))))

    def batch(variances: list[float]) -> float:
        prior = np.diag([*variances, *last[2:]])
        covariance = design @ prior @ design.T + np.diag(noise)
        determinant = np.linalg.slogdet(covariance)[1]
        return -0.5 * float(values @ np.linalg.solve(covariance, values) + determinant)

    expected = batch([0.3, 0.0]) - batch([2.0, 5.0])
    likelihoods = state.log_likelihoods(labels[:2], last[:2], np.array([[0.3, 0.0], [2.0, 5.0]]))
    assert likelihoods[0] - likelihoods[1] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("kind", ["attitude_error", "antenna_offset"])
def test_doubt_about_phases_is_no_doubt_about_what_moves_the_antenna(kind):
    """An antenna that is known to 1 mm, which something moves by 8 mm, and doubt of 5."""
    antennas = AntennaPair(Antenna(), Antenna(lever_arm_sigma=0.02))
    filter_ = RelativeFilter(
        CdgpsConfiguration(antennas=antennas), nine(DEPUTY_250M - CHIEF), 1e-6 * np.eye(9), 0.0
    )
    label = (kind, 1, 0)
    if kind == "attitude_error":
        filter_.expect_attitude_errors({label: 4e-4}, {})
    index, state = filter_.state.index(label), filter_.state
    state.covariance[0, 0] += 0.4**2 * 4e-4
    state.covariance[0, index] = state.covariance[index, 0] = -0.4 * 4e-4
    filter_._doubt(SlowError(0.0, 100.0), SlowError(1.0, 100.0))
    antenna = np.zeros(len(state))
    antenna[[0, index]] = 1.0, 0.4
    assert state.covariance[index, index] == pytest.approx(4e-4)
    assert math.sqrt(antenna @ state.covariance @ antenna) == pytest.approx(5e-3)
    assert math.sqrt(state.covariance[1, 1]) == pytest.approx(5e-3)


def filter_with_plasma_of(sigma_tecu_share: float) -> RelativeFilter:
    """Return a filter whose plasma is known to a share of its prior, correlated with motion."""
    filter_ = RelativeFilter(CdgpsConfiguration(), nine(DEPUTY_250M - CHIEF), 1e-6 * np.eye(9), 0.0)
    filter_.state.add(("code_bias", (0, 2, 0)), 0.0, 1e-2)
    covariance = filter_.state.covariance
    for layer in filter_.state.columns("plasma"):
        covariance[layer, layer] *= sigma_tecu_share**2
        covariance[0, layer] = covariance[layer, 0] = 0.4 * np.sqrt(
            covariance[0, 0] * covariance[layer, layer]
        )
    return filter_


def test_doubt_about_phases_is_doubt_about_the_plasma_that_they_told():
    """Variances of the plasma rise as those of the position do, those of code biases do not."""
    filter_ = filter_with_plasma_of(1e-3)
    before = filter_.state.covariance.copy()
    filter_._doubt(SlowError(0.0, 100.0), SlowError(1.0, 100.0))
    ratio = np.diagonal(filter_.state.covariance) / np.diagonal(before)
    np.testing.assert_allclose(ratio[[0, 1, *filter_.state.columns("plasma")]], 25.0, rtol=1e-3)
    np.testing.assert_allclose(ratio[filter_.state.columns("code_bias")], 1.0, rtol=1e-9)


def test_doubt_makes_nothing_less_known_than_before_all_measurements():
    """Plasma and accelerations are not raised beyond their processes."""
    filter_ = filter_with_plasma_of(0.9)
    filter_.expect_accelerations(MotionNoise(5e-8, across_sigma=1e-8))
    accelerations = np.array([1e-8, 5e-8, 1e-8]) ** 2
    filter_.state.covariance[6:9, 6:9] = np.diag(accelerations)
    prior = [
        filter_._prior_variance(label)
        for label in filter_.state.labels_of("plasma", "plasma_shell")
    ]
    filter_._doubt(SlowError(0.0, 100.0), SlowError(1.0, 100.0))
    variances = np.diagonal(filter_.state.covariance)
    assert (variances[filter_.state.columns("plasma", "plasma_shell")] <= prior).all()
    np.testing.assert_allclose(variances[6:9], accelerations, rtol=1e-3)


def test_doubt_divides_the_information_of_the_measurements():
    """As if all measurements had had noise of another size; the prior counts as it did."""
    random = np.random.default_rng(5)
    prior = np.diag([4.0, 0.09, 1e6])
    design = random.standard_normal((6, 3))
    labels = [("known", 0), ("known", 1), ("unknown",)]
    state = GaussianState(labels, np.zeros(3), prior)
    noise = np.full(6, 0.25)
    state.update(state.innovation(design, random.standard_normal(6), noise, np.zeros((6, 0))))
    mean = state.mean.copy()
    state.doubt(7.0, [0, 1], prior[:2, :2])
    information = np.diag([1.0 / 4.0, 1.0 / 0.09, 0.0]) + design.T @ design / (7.0 * 0.25)
    np.testing.assert_allclose(state.covariance, np.linalg.inv(information), rtol=1e-5)
    np.testing.assert_array_equal(state.mean, mean)
