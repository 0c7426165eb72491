"""The lag between the fluctuations of a signal that two spacecraft observe."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray

__all__ = ["FluctuationLag", "fluctuation_lag", "series_lag"]


@dataclass(frozen=True)
class FluctuationLag:
    """Lag of the fluctuations at a second spacecraft behind those at a first.

    Parameters
    ----------
    lag, sigma : float
        Lag and its sigma, s; positive if the second spacecraft observes the fluctuations later.
        NaN without fluctuations.
    correlation : float
        Correlation at this lag, -1 to 1; NaN without fluctuations.
    """

    lag: float
    sigma: float
    correlation: float


def fluctuation_lag(
    power_first: npt.ArrayLike,
    power_second: npt.ArrayLike,
    sample_rate_hz: float,
    largest_lag: float = 10.0,
    trend: float = 10.0,
) -> FluctuationLag:
    """Return the lag at which the intensities of two spacecraft are most alike.

    Parameters
    ----------
    power_first, power_second : array_like, shape (m, n)
        Intensities or linear C/N0 of m rays at n evenly spaced times; a row holds the same
        satellite in both. All rays are used together.
    sample_rate_hz : float
        Rate of the samples.
    largest_lag : float
        Largest lag that is searched to either side, s.
    trend : float
        Length of the running mean that is divided out, s.
    """
    first = _fluctuation(power_first, sample_rate_hz, trend)
    second = _fluctuation(power_second, sample_rate_hz, trend)
    return series_lag(first, second, sample_rate_hz, largest_lag)


def series_lag(
    first: npt.ArrayLike, second: npt.ArrayLike, sample_rate_hz: float, largest_lag: float = 10.0
) -> FluctuationLag:
    """Return the lag at which series without a mean are most alike; a missing sample is zero.

    Parameters
    ----------
    first, second : array_like, shape (m, n)
        Series of m rays at n evenly spaced times; a row holds the same satellite in both.
    sample_rate_hz, largest_lag : float
        As in `fluctuation_lag`.
    """
    first = np.atleast_2d(np.asarray(first, dtype=float))
    second = np.atleast_2d(np.asarray(second, dtype=float))
    count = first.shape[-1]
    size = 2 * count
    spectrum = np.fft.rfft(second, size) * np.fft.rfft(first, size).conj()
    correlation = np.fft.irfft(spectrum.sum(axis=0), size)
    norm = math.sqrt(float(np.sum(first**2)) * float(np.sum(second**2)))
    if norm == 0.0:
        return FluctuationLag(math.nan, math.nan, math.nan)
    reach = min(int(largest_lag * sample_rate_hz), count - 1)
    shifts = np.arange(-reach, reach + 1)
    values = correlation[shifts] / norm
    best = int(np.clip(np.argmax(values), 1, len(values) - 2))
    low, peak, high = values[best - 1 : best + 2]
    curvature = low - 2.0 * peak + high
    offset = 0.5 * (low - high) / curvature if curvature < 0.0 else 0.0
    # The sigma is the noise of the correlation over its curvature at the peak. Samples of a fade
    # are not independent: their number is divided by the width of the peak.
    samples_per_width = math.sqrt(max(peak, 1e-12) / max(-curvature, 1e-12))
    independent = max(1.0, first.size / max(1.0, samples_per_width))
    noise = math.sqrt(max(0.0, 1.0 - float(peak) ** 2) / independent)
    sigma = samples_per_width * math.sqrt(noise / max(float(peak), 1e-3))
    return FluctuationLag(
        lag=float(shifts[best] + offset) / sample_rate_hz,
        sigma=sigma / sample_rate_hz,
        correlation=float(peak),
    )


def _fluctuation(power: npt.ArrayLike, sample_rate_hz: float, trend: float) -> FloatArray:
    """Return intensities divided by their running mean, minus 1; 0 where the mean is zero."""
    power = np.atleast_2d(np.asarray(power, dtype=float))
    length = max(1, min(power.shape[-1], round(trend * sample_rate_hz)))
    total = np.cumsum(np.pad(power, ((0, 0), (1, 0))), axis=-1)
    ends = np.minimum(np.arange(power.shape[-1]) + length // 2 + 1, power.shape[-1])
    starts = np.maximum(ends - length, 0)
    mean = (total[:, ends] - total[:, starts]) / (ends - starts)
    relative: FloatArray = np.nan_to_num(power / mean - 1.0)
    return relative
