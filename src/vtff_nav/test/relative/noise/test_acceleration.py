"""The sigma of empirical accelerations follows their estimates."""

import numpy as np
import pytest

from vtff_nav.relative.common.dynamics import MotionNoise
from vtff_nav.relative.noise.acceleration import AccelerationMonitor

NOISE = MotionNoise(empirical_sigma=1e-6, gradient_sigma=1e-9)


def learnt(sigma, variance, distance=0.0):
    """Return the factor after an hour of estimates of a sigma with a variance."""
    monitor, generator = AccelerationMonitor(NOISE), np.random.default_rng(1)
    for _ in range(3600):
        mean = np.zeros(9)
        mean[6:] = sigma * generator.standard_normal(3)
        monitor.learn(mean, variance * np.eye(9), distance, 1.0)
    return monitor.factor


def test_nothing_is_learnt_where_measurements_tell_nothing():
    assert learnt(0.0, 1e-12) == pytest.approx(1.0, abs=1e-3)


def test_the_factor_is_that_of_the_accelerations():
    assert learnt(5e-6, 0.0) == pytest.approx(5.0, rel=0.1)
    assert learnt(3e-7, 0.0) == pytest.approx(0.3, rel=0.1)


def test_the_sigma_at_a_distance_is_the_measure():
    assert learnt(1e-5, 0.0, distance=1e4) == pytest.approx(1.0, rel=0.1)


def test_axes_count_by_what_measurements_tell_of_them():
    """An axis of which nothing is known does not hide that another is five times as large."""
    noise = MotionNoise(1e-6, across_sigma=1e-9)
    monitor, generator = AccelerationMonitor(noise), np.random.default_rng(3)
    covariance, kept = np.diag([1.0] * 6 + [1e-18, 0.0, 1e-18]), np.exp(-2.0 / 900.0)
    for _ in range(3600):
        mean = np.zeros(9)
        mean[7] = 5e-6 * generator.standard_normal()
        # What is known of the others is the process, which follows its sigma.
        across = kept * covariance[6, 6] + (1.0 - kept) * monitor.sigma(0.0)[0] ** 2
        covariance[6, 6] = covariance[8, 8] = across
        monitor.learn(mean, covariance, 0.0, 1.0)
    assert monitor.factor == pytest.approx(5.0, rel=0.1)
    np.testing.assert_allclose(monitor.sigma(0.0), monitor.factor * np.array([1e-9, 1e-6, 1e-9]))


def test_axes_without_noise_do_not_count():
    monitor = AccelerationMonitor(MotionNoise(1e-6, across_sigma=0.0))
    for _ in range(600):
        monitor.learn(np.zeros(9), np.zeros((9, 9)), 0.0, 1.0)
    assert monitor.factor < 0.5
    still = AccelerationMonitor(MotionNoise(0.0))
    still.learn(np.zeros(9), np.zeros((9, 9)), 0.0, 1.0)
    assert still.factor == 1.0


def test_the_factor_has_limits():
    assert learnt(0.0, 0.0) == pytest.approx(0.05)
    assert learnt(1e-3, 0.0) == pytest.approx(20.0)


def test_small_accelerations_of_half_an_orbit_leave_what_may_come_after_it():
    monitor = AccelerationMonitor(NOISE, smallest_factor=0.3)
    for _ in range(3000):
        monitor.learn(np.zeros(9), np.zeros((9, 9)), 0.0, 1.0)
    assert monitor.factor == 0.3
    assert AccelerationMonitor(NOISE, 0.1, smallest_factor=0.3).factor == 0.3


def test_a_covariance_above_that_of_the_process_does_not_raise_the_factor():
    monitor = AccelerationMonitor(NOISE)
    # The start was far away, where the accelerations of the process are ten times as large.
    monitor.learn(np.zeros(9), 1e-10 * np.eye(9), 1e4, 1.0)
    for second in range(600):
        monitor.learn(np.zeros(9), 1e-10 * np.exp(-2.0 * second / 900.0) * np.eye(9), 0.0, 1.0)
    assert 0.7 < monitor.factor < 1.05


@pytest.mark.parametrize("true_sigma", [2e-7, 5e-6])
def test_a_filter_finds_the_accelerations_that_act(true_sigma):
    # Independent truth: a Gauss-Markov acceleration on each axis, seen through positions of 1 mm.
    generator, step, time = np.random.default_rng(5), 1.0, NOISE.empirical_time
    phi = np.eye(9) + step * np.eye(9, k=3)
    phi[:3, 6:] = 0.5 * step**2 * np.eye(3)
    decay = np.exp(-step / time)
    phi[6:, 6:] = decay * np.eye(3)
    monitor, truth = AccelerationMonitor(NOISE), np.zeros(9)
    truth[6:] = true_sigma * generator.standard_normal(3)
    mean, covariance = np.zeros(9), np.diag([1.0] * 6 + [NOISE.empirical_sigma**2] * 3)
    for _ in range(7200):
        driven = np.sqrt(1.0 - decay**2) * generator.standard_normal(3)
        truth = phi @ truth
        truth[6:] += true_sigma * driven
        mean, covariance = phi @ mean, phi @ covariance @ phi.T
        steady = (monitor.factor * NOISE.empirical_sigma) ** 2
        covariance[6:, 6:] += (1.0 - decay**2) * steady * np.eye(3)
        innovation = truth[:3] + 1e-3 * generator.standard_normal(3) - mean[:3]
        gain = np.linalg.solve(covariance[:3, :3] + 1e-6 * np.eye(3), covariance[:3]).T
        mean, covariance = mean + gain @ innovation, covariance - gain @ covariance[:3]
        monitor.learn(mean, covariance, 0.0, step)
    found = monitor.factor * NOISE.empirical_sigma
    assert 0.5 < found / true_sigma < 2.0


@pytest.mark.parametrize(
    ("sigma", "variance", "is_borne_out"),
    [(1e-6, 0.1e-12, True), (5e-6, 0.1e-12, False), (0.0, 0.95e-12, False)],
)
def test_measurements_bear_out_accelerations_that_are_as_small_as_assumed(
    sigma, variance, is_borne_out
):
    """Not while they tell nothing, nor where accelerations are larger, learnt or not."""
    monitor, generator = AccelerationMonitor(NOISE), np.random.default_rng(2)
    answers = []
    for _ in range(300):
        mean = np.zeros(9)
        mean[6:] = sigma * generator.standard_normal(3)
        monitor.learn(mean, variance * np.eye(9), 0.0, 1.0)
        answers.append(monitor.is_borne_out)
    assert any(answers[5:]) == is_borne_out
