"""Lag of fluctuations: sign, fraction of a sample, reach, and its sigma."""

import math

import numpy as np
import pytest

from vtff_iono.scintillation.fluctuation_lag import fluctuation_lag, series_lag

RATE = 20.0


def pattern(shift, count=2000, seed=0, width=0.5, rays=1):
    """Return smooth noise of a correlation time `width` (s), seen `shift` samples later."""
    generator = np.random.default_rng(seed)
    spectrum = np.fft.rfft(generator.standard_normal((rays, count)))
    frequency = np.fft.rfftfreq(count, 1.0 / RATE)
    spectrum *= np.exp(-0.5 * (2.0 * np.pi * frequency * width) ** 2)
    spectrum[:, 0] = 0.0
    delayed = spectrum * np.exp(-2j * np.pi * frequency * shift / RATE)
    series = np.fft.irfft(delayed, count)
    return series / np.std(np.fft.irfft(spectrum, count))


@pytest.mark.parametrize("shift", [-40.0, -7.3, 0.0, 12.5, 60.0])
def test_a_lag_is_positive_if_the_second_is_later(shift):
    result = series_lag(pattern(0.0), pattern(shift), RATE)
    assert result.lag == pytest.approx(shift / RATE, abs=0.02)
    assert result.correlation > 0.9


def test_lags_beyond_the_reach_are_not_found():
    inside = series_lag(pattern(0.0), pattern(30.0), RATE, largest_lag=2.0)
    assert inside.lag == pytest.approx(1.5, abs=0.01)
    outside = series_lag(pattern(0.0), pattern(60.0), RATE, largest_lag=2.0)
    assert abs(outside.lag) <= 2.0 and outside.correlation < 0.5


def test_rays_are_used_together():
    """Each ray has the lag of its row; rows of other satellites do not agree."""
    first, second = pattern(0.0, rays=6), pattern(10.0, rays=6)
    noise = np.random.default_rng(1).standard_normal((2, *first.shape))
    together = series_lag(first + noise[0], second + noise[1], RATE)
    assert together.lag == pytest.approx(0.5, abs=0.1)
    assert together.correlation == pytest.approx(0.5, abs=0.1)
    mixed = series_lag(first, second[::-1], RATE)
    assert mixed.correlation < 0.4


def test_lag_and_sigma_follow_from_the_correlation():
    """Computed with sums instead of transforms: parabola through three values, widths of a fade."""
    noise = 0.5 * np.random.default_rng(8).standard_normal((2, 2, 600))
    first, second = pattern(0.0, 600, rays=2) + noise[0], pattern(9.0, 600, rays=2) + noise[1]
    result = series_lag(first, second, RATE, largest_lag=1.0)
    norm = np.sqrt((first**2).sum() * (second**2).sum())
    values = np.array(
        [
            (first[:, max(0, -s) : 600 - max(0, s)] * second[:, max(0, s) : 600 + min(0, s)]).sum()
            for s in range(-20, 21)
        ]
    )
    values /= norm
    best = int(np.argmax(values))
    quadratic, linear, peak = np.polyfit([-1.0, 0.0, 1.0], values[best - 1 : best + 2], 2)
    assert result.lag == pytest.approx((best - 20 - linear / (2.0 * quadratic)) / RATE, abs=1e-9)
    assert result.correlation == pytest.approx(peak, abs=1e-9)
    width = np.sqrt(peak / (-2.0 * quadratic))
    scatter = np.sqrt((1.0 - peak**2) / (1200.0 / width))
    assert result.sigma == pytest.approx(width * np.sqrt(scatter / peak) / RATE, rel=1e-6)


def test_power_is_taken_relative_to_its_running_mean():
    """Slow changes of gain by a factor of ten do not matter, nor does the unit."""
    first, second = 1.0 + 0.2 * pattern(0.0), 1.0 + 0.2 * pattern(24.0)
    gain = np.exp(np.linspace(0.0, 2.3, 2000))
    result = fluctuation_lag(3.0 * gain * first, 70.0 * gain[::-1] * second, RATE)
    assert result.lag == pytest.approx(1.2, abs=0.05)
    assert result.correlation > 0.8


@pytest.mark.parametrize(("trend", "length"), [(10.0, 200), (2.55, 51), (1000.0, 800)])
def test_the_running_mean_has_the_length_of_the_trend(trend, length):
    """The mean is shorter at the beginning, and lags behind its middle at the end."""
    power = 5.0 + np.cumsum(np.random.default_rng(3).normal(0.0, 0.1, (2, 800)), axis=1)
    relative = np.empty_like(power)
    for index in range(800):
        end = min(index + length // 2 + 1, 800)
        window = power[:, max(end - length, 0) : end]
        relative[:, index] = power[:, index] / window.mean(axis=1) - 1.0
    expected = series_lag(relative[0], relative[1], RATE)
    result = fluctuation_lag(power[0], power[1], RATE, trend=trend)
    assert result.lag == pytest.approx(expected.lag, abs=1e-6)
    assert result.correlation == pytest.approx(expected.correlation, abs=1e-9)


def test_without_fluctuations_there_is_no_lag():
    result = fluctuation_lag(np.ones((2, 100)), np.full((2, 100), 5.0), RATE)
    assert math.isnan(result.lag) and math.isnan(result.sigma) and math.isnan(result.correlation)
