"""The emulated laser: equation 9 of paper 004, and noise that depends on the seed alone."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vtff_sim_bridge.laser.laser_ranging import LaserRanging


def test_latency_acts_on_the_range_rate():
    laser = LaserRanging(range_sigma=0.0)
    assert laser.measure(0, (30.0, 40.0, 0.0), (0.0, 0.0, 5.0)) == 50.0
    assert laser.measure(0, (30.0, 40.0, 0.0), (3.0, 4.0, 0.0)) == pytest.approx(
        50.0 - 5.15e-3 * 5.0, abs=1e-12
    )


def test_noise_has_its_sigma_and_the_order_does_not_matter():
    laser = LaserRanging(range_sigma=1e-3, seed=4)
    stamps = [k * 10**9 for k in range(2000)]
    there = [laser.measure(s, (100.0, 0.0, 0.0), (0.0, 0.0, 0.0)) for s in stamps]
    back = [laser.measure(s, (100.0, 0.0, 0.0), (0.0, 0.0, 0.0)) for s in reversed(stamps)]
    assert there == back[::-1]
    assert np.std(there) == pytest.approx(1e-3, rel=0.06)
    assert abs(np.mean(there) - 100.0) < 4 * 1e-3 / math.sqrt(len(there))
    other = LaserRanging(range_sigma=1e-3, seed=4, link="deputy_2")
    assert other.measure(0, (100.0, 0.0, 0.0), (0.0, 0.0, 0.0)) != there[0]


def test_no_echo_from_far_away_or_from_oneself():
    laser = LaserRanging(maximum_range=1000.0)
    assert math.isnan(laser.measure(0, (1001.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    assert math.isnan(laser.measure(0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    with pytest.raises(ValueError, match="must not be negative"):
        LaserRanging(range_sigma=-1.0)
