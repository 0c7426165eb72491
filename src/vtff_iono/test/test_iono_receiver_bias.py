"""Receiver biases in orbit and on the ground, with a known answer and levels that are wrong."""

import functools
import math

import numpy as np
import pytest
from formation_simulation import RADIUS, chapman, plumex_like

from vtff_dynamics.frames import itrf_from_geodetic
from vtff_gnss.line_of_sight import ellipsoid_normal
from vtff_iono.bias_samples import BiasSamples, ReceiverBiasError
from vtff_iono.geometry_free import tecu_per_metre
from vtff_iono.mapping import mapping_factor, profile_content
from vtff_iono.receiver_bias import estimate_receiver_biases

PER_NS = 2.8533508
BIAS = 8.0
ALTITUDE = np.arange(100e3, 2000e3, 1e3)
PROFILES = {"chapman": (ALTITUDE, chapman(ALTITUDE)), "plumex": plumex_like(step=1e3)}


@functools.lru_cache(maxsize=4)
def seen(name, hours, orbit=True, satellites=32):
    """Time, content, elevation, direction, position and satellite of all rays above 10 deg."""
    generator = np.random.default_rng(1)
    direction = generator.standard_normal((satellites, 3))
    gps = 26_560e3 * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    rate = 2.0 * np.pi / (5500.0 if orbit else 43_000.0)
    rows = []
    for time in np.arange(0.0, hours * 3600.0, 20.0 if orbit else 900.0):
        height = 502e3 + 266e3 * math.cos(rate * time) if orbit else 0.0
        receiver = itrf_from_geodetic([0.0, rate * time, height])
        ray = gps - receiver
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        elevation = np.arcsin(ray @ ellipsoid_normal(receiver))
        up = np.flatnonzero(elevation > math.radians(10.0))
        content = profile_content(elevation[up], RADIUS + height, *PROFILES[name])
        rows += [
            (time, one, elevation[i], *ray[i], *receiver, i)
            for i, one in zip(up, content, strict=True)
        ]
    return np.array(rows)


def samples(rows, seed, level_sigma, bias=BIAS):
    """Contents with a receiver bias and levels wrong by `level_sigma`, new each 25 minutes."""
    arc = (rows[:, 9] * 100 + rows[:, 0] // 1500).astype(np.int64)
    number = np.unique(arc, return_inverse=True)[1]
    levels = np.random.default_rng(seed).normal(0.0, level_sigma, number.max() + 1)
    return BiasSamples(
        time=rows[:, 0],
        group=np.zeros(len(rows), dtype=np.int64),
        stec_tecu=rows[:, 1] + bias + levels[number],
        stec_sigma_tecu=np.full(len(rows), level_sigma),
        elevation=rows[:, 2],
        direction_itrf=rows[:, 3:6],
        position_receiver_itrf=rows[:, 6:9],
        arc=arc,
    )


@pytest.mark.parametrize("name", PROFILES)
@pytest.mark.parametrize("seed", range(3))
def test_orbit(name, seed):
    """Bound of the project: 0.15 ns, inside the stated two sigma; two revolutions."""
    rows = seen(name, 3.0)
    (found,) = estimate_receiver_biases(samples(rows, seed, 0.2))
    assert abs(found.bias_tecu - BIAS) <= 0.15 * PER_NS
    assert abs(found.bias_tecu - BIAS) <= 2.0 * found.sigma_tecu
    assert found.sigma_tecu <= 0.15 * PER_NS
    value, sigma = found.code_bias(tecu_per_metre(1575.42e6, 1227.60e6))
    assert value * 1e9 == pytest.approx(-found.bias_tecu / PER_NS, rel=1e-3)
    assert sigma * 1e9 == pytest.approx(found.sigma_tecu / PER_NS, rel=1e-3)


def test_ground_without_gradients():
    """A thin layer at 450 km: only the models with other shells are wrong, and the sigma knows."""
    rows = seen("chapman", 12.0, orbit=False).copy()
    rows[:, 1] = 20.0 * mapping_factor(rows[:, 2], RADIUS, 0.0)
    (found,) = estimate_receiver_biases(samples(rows, 0, 0.1))
    assert abs(found.bias_tecu - BIAS) <= 2.0 * found.sigma_tecu
    assert found.spread_tecu > 0.3
    nearest = np.min(np.abs(np.array(found.model_tecu) - BIAS))
    assert nearest < 0.2
    assert not found.is_bounded


def test_groups_share_the_ionosphere():
    rows = seen("chapman", 3.0)
    one = samples(rows, 0, 0.1)
    group = (rows[:, 9] % 2).astype(np.int64)
    stec = one.stec_tecu + np.where(group == 1, -15.0, 0.0)
    both = BiasSamples(**{**vars(one), "group": group, "stec_tecu": stec})
    first, second = estimate_receiver_biases(both)
    assert abs(first.bias_tecu - BIAS) <= 2.5 * first.sigma_tecu
    assert abs(second.bias_tecu - (BIAS - 15.0)) <= 2.5 * second.sigma_tecu


def test_contents_are_not_negative():
    """Levels that all err together make pairs ask for a bias that leaves nothing."""
    rows = seen("chapman", 12.0, orbit=False).copy()
    # Content that falls towards the horizon looks like a large bias with little content.
    rows[:, 1] = 0.5 + 2.0 * np.sin(rows[:, 2])
    (found,) = estimate_receiver_biases(samples(rows, 0, 0.01))
    assert found.is_bounded
    high = rows[:, 2] >= math.radians(20.0)
    assert found.bias_tecu <= np.quantile(rows[high, 1] + BIAS, 0.02) + 0.05


def test_too_few_satellites():
    rows = seen("chapman", 3.0)[:20]
    with pytest.raises(ReceiverBiasError, match=r"only \d+ pairs of satellites"):
        estimate_receiver_biases(samples(rows, 0, 0.1))
