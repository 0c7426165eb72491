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


def test_the_factor_has_limits():
    assert learnt(0.0, 0.0) == pytest.approx(0.2)
    assert learnt(1e-3, 0.0) == pytest.approx(20.0)
