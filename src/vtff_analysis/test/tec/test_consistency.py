"""Satellites that disagree by more than their sigmas: told, and only then."""

from __future__ import annotations

import numpy as np
import pytest

from vtff_analysis.tec.consistency import satellite_disagreement

SATELLITES = 12
EPOCHS = 60


def samples(seed, bias_sigma=0.0, gradient=0.0, sigma=0.5, vertical=20.0):
    """Contents of satellites above a layer whose content falls with the azimuth's cosine.

    Slant contents are made with a mapping of their own, 1 / sin of the elevation.
    """
    generator = np.random.default_rng(seed)
    time = np.repeat(np.arange(EPOCHS) * 30, SATELLITES)
    link = np.tile(np.arange(SATELLITES), EPOCHS)
    elevation = np.radians(generator.uniform(15.0, 85.0, SATELLITES))[link]
    side = np.cos(generator.uniform(0.0, 2.0 * np.pi, SATELLITES))[link]
    factor = 1.0 / np.sin(elevation)
    bias = generator.normal(0.0, bias_sigma, SATELLITES)[link]
    stec = vertical * (1.0 + gradient * side * np.cos(elevation)) * factor + bias
    stec += generator.normal(0.0, sigma, SATELLITES)[link]
    return time, link, elevation, stec, stec / factor, np.full(len(stec), sigma)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("gradient", [0.0, 0.1])
def test_satellites_with_honest_sigmas_are_not_told(seed, gradient):
    assert not satellite_disagreement(*samples(seed, gradient=gradient)).is_beyond_sigma


@pytest.mark.parametrize("seed", range(5))
def test_biases_of_satellites_that_were_not_removed_are_told(seed):
    """One of the misleading cases: --biases none where signals have biases of some ns."""
    found = satellite_disagreement(*samples(seed, bias_sigma=10.0))  # 3.5 ns
    assert found.is_beyond_sigma
    assert found.stated_tecu == pytest.approx(0.5)
    assert 4.0 < found.rms_tecu < 20.0
    assert "--biases" in found.describe() and "disagree" in found.describe()


def test_biases_that_the_sigmas_contain_are_not_told():
    *columns, sigma = samples(3, bias_sigma=10.0, sigma=10.0)
    assert not satellite_disagreement(*columns, np.sqrt(2.0) * sigma).is_beyond_sigma


def test_few_satellites_tell_nothing():
    time, link, *columns = samples(1)
    few = link < 3
    assert satellite_disagreement(time[few], link[few], *(c[few] for c in columns)) is None
    nothing = np.zeros(len(time), dtype=bool)
    assert (
        satellite_disagreement(time[nothing], link[nothing], *(c[nothing] for c in columns)) is None
    )
