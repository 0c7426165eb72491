"""White and slow noise found in drawn residuals, and what slow errors of codes are worth."""

from __future__ import annotations

import numpy as np
import pytest

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.signals import SignalKey
from vtff_nav.relative.noise.components import (
    NoiseComponents,
    Redundancy,
    SlowError,
    white_equivalent_variance,
)
from vtff_nav.relative.noise.monitor import NoiseMonitor, NoisePrior

KEYS = [SignalKey(0, prn, 1, ord("C")) for prn in range(1, 25)]
STATED = 1.4e-3
PRIOR = SlowError(4e-3, 100.0)


def learned(
    white_sigma: float, slow: SlowError, seconds: int, seed: int, redundant: float = 0.6
) -> NoiseComponents:
    """Show residuals of drawn noise to components."""
    random = np.random.default_rng(seed)
    prior = NoisePrior(PRIOR.sigma / np.sqrt(2.0), 0.3, PRIOR.correlation_time)
    components = NoiseMonitor(prior, 3600.0).phase  # with the models that are shipped
    decay = np.exp(-1.0 / slow.correlation_time)
    error = slow.sigma * random.standard_normal(len(KEYS))
    variance, number = np.full(len(KEYS), STATED**2), np.full(len(KEYS), redundant)
    last = None
    for second in range(seconds):
        noise = slow.sigma * np.sqrt(1.0 - decay**2) * random.standard_normal(len(KEYS))
        error = decay * error + noise
        residual = error + white_sigma * random.standard_normal(len(KEYS))
        if last is not None:
            components.add_changes(residual - last, number, variance, 1.0)
        components.add_residuals(GpsTime(second * 10**9), KEYS, residual, number, variance)
        last = residual
    return components


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_stated_noise_is_believed(seed):
    """White noise as stated: the factor stays 1, and no slow error is seen after a minute."""
    components = learned(STATED, SlowError(0.0, 100.0), 60, seed)
    assert components.white_factor == 1.0
    assert components.slow.sigma == 0.0


@pytest.mark.parametrize("seed", [1, 2])
def test_white_noise_of_three_times_the_stated(seed):
    components = learned(3.0 * STATED, SlowError(0.0, 100.0), 120, seed)
    assert components.white_factor == pytest.approx(9.0, rel=0.2)
    assert components.slow.sigma == 0.0


@pytest.mark.parametrize("sigma", [1.4e-3, 2.8e-3, 7e-3])
def test_slow_error(sigma):
    """Sigma and correlation time within what 24 processes tell in 10 min; white noise as it is."""
    components = learned(STATED, SlowError(sigma, 100.0), 600, 1)
    assert components.white_factor == 1.0
    assert components.slow.sigma == pytest.approx(sigma, rel=0.3)
    assert 30.0 < components.slow.correlation_time < 300.0


@pytest.mark.parametrize("sigma", [1.3e-3, 2.0e-3, 3.2e-3])
def test_slow_errors_between_the_coarse_steps_are_not_overstated(sigma):
    """On average over draws; models a factor of 1.6 apart would be up to a quarter off."""
    found = [learned(STATED, SlowError(sigma, 100.0), 400, seed).slow.sigma for seed in range(6)]
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(sigma, rel=0.12)


def test_slow_error_that_ends():
    """A slow error is given up, though later than it is found."""
    components = learned(STATED, SlowError(0.0, 100.0), 30, 1)
    assert components.slow.sigma == 0.0
    before = learned(STATED, SlowError(2.8e-3, 100.0), 30, 1)
    assert before.slow.sigma > 1e-3


def test_redundancy_against_dense_matrices():
    """Residuals and redundancy numbers of a weighted adjustment, and their variances."""
    random = np.random.default_rng(1)
    design, sigma = random.standard_normal((12, 4)), random.uniform(0.5, 2.0, 12)
    values = random.standard_normal((12, 2))
    result = Redundancy.of(values, sigma, design, np.zeros(4))
    noise = np.diag(sigma**2)
    gain = np.linalg.inv(design.T @ np.linalg.inv(noise) @ design) @ design.T @ np.linalg.inv(noise)
    maker = np.eye(12) - design @ gain
    spread = np.sqrt(np.diagonal(maker @ noise @ maker.T))
    expected = maker @ values / spread[:, None] * sigma[:, None]
    np.testing.assert_allclose(result.residual, expected, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(result.number, np.diagonal(maker), rtol=1e-6)
    assert result.number.sum() == pytest.approx(8.0)


def test_codes_with_slow_errors_count_as_their_mean():
    """Independent measurements of these variances know a constant as the mean of the real ones."""
    white, slow, count = 0.18, SlowError(0.7, 100.0), 300
    epochs = np.arange(1, count + 1)
    variances = white_equivalent_variance(np.full(count, white), slow, epochs, 1.0)
    lags = np.abs(epochs[:, None] - epochs)
    covariance = slow.sigma**2 * np.exp(-lags / slow.correlation_time) + white * np.eye(count)
    for number in (1, 10, 100, 300):
        mean_variance = covariance[:number, :number].mean()
        assert 1.0 / np.sum(1.0 / variances[:number]) == pytest.approx(mean_variance, rel=0.05)
    assert np.all(variances >= white)
    free = white_equivalent_variance(np.full(count, white), SlowError(0.0, 1.0), epochs, 1.0)
    np.testing.assert_array_equal(free, white)
