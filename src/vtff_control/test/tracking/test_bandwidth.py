"""The bandwidth follows the covariance, and never gives up what must be stopped."""

import numpy as np
import pytest

from vtff_control.tracking.bandwidth import BandwidthSchedule, weights_at_level
from vtff_control.tracking.riccati import Weights

TARGET = np.array([0.0, 100.0, 0.0, 0.0, 0.0, 0.0])


def covariance(sigma: float) -> np.ndarray:
    return np.diag([sigma**2] * 3 + [(0.01 * sigma) ** 2] * 3)


def level(sigma: float, *deviation: float) -> int:
    difference = np.array([*deviation, *np.zeros(6 - len(deviation))])
    schedule = BandwidthSchedule(0.1, 1e-3)
    return schedule.update(TARGET + difference, difference, covariance(sigma))


def test_the_bandwidth_falls_with_the_square_root_of_sigma() -> None:
    assert level(0.0) == 0
    assert level(1e-4) == 0
    assert level(0.1) == pytest.approx(0.5 * 4 * np.log2(100.0), abs=0.5)
    assert level(1.0) == pytest.approx(0.5 * 4 * np.log2(1000.0), abs=0.5)
    assert level(1e6) == 28


def test_large_deviations_get_the_full_bandwidth() -> None:
    assert level(1.0, 0.0, 900.0) == 0
    assert level(1.0, 0.0, 3.0) == level(1.0)
    assert 0 < level(1.0, 0.0, 50.0) < level(1.0)


def test_a_deputy_in_motion_is_held_fast() -> None:
    # 1 m/s a few metres beside the target, with a sigma of 1 m that alone asks for 3 mrad/s.
    assert level(1.0, 0.0, 5.0, 0.0, 0.0, -1.0, 0.0) == 0
    # 5 m/s towards the chief, 100 m away, with a sigma as after an outage.
    assert level(30.0, 0.0, 0.0, 0.0, 0.0, -5.0, 0.0) <= 4


def test_noise_hardly_moves_the_level() -> None:
    generator = np.random.default_rng(1)
    schedule = BandwidthSchedule(0.1, 1e-3)
    sigmas = 0.1 * np.exp(0.05 * generator.standard_normal(1000))
    levels = [schedule.update(TARGET, np.zeros(6), covariance(sigma)) for sigma in sigmas]
    assert np.count_nonzero(np.diff(levels)) <= 3, "of 1000 samples"


def test_slower_levels_keep_the_damping() -> None:
    design = Weights(1e-4, 1e-2, 1.0)

    def damping(weights: Weights) -> float:
        stiffness = (weights.position / weights.control) ** 0.5
        return (weights.velocity / weights.control + 2.0 * stiffness) ** 0.5 / (
            2.0 * stiffness**0.5
        )

    assert weights_at_level(design, 0) is design
    for slower in (1, 8, 20):
        weights = weights_at_level(design, slower)
        assert damping(weights) == pytest.approx(damping(design), rel=1e-12)
        bandwidth = (weights.position / weights.control) ** 0.25
        assert bandwidth == pytest.approx(0.1 * 2.0 ** (-slower / 4), rel=1e-12)
