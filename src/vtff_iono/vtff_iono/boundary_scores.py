"""How well edges and scintillating minutes were found, and the lag between two spacecraft."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray

__all__ = [
    "BoundaryScore",
    "FluctuationLag",
    "MinuteScore",
    "fluctuation_lag",
    "score_boundaries",
    "score_minutes",
]


@dataclass(frozen=True, eq=False)
class BoundaryScore:
    """Edges found against true ones.

    Parameters
    ----------
    true_count, found_count, matched_count : int
    detection_rate : float
        Part of the true edges that were found; NaN without true edges.
    false_alarms : int
        Found edges that are none.
    errors : ndarray, shape (matched_count,)
        Found less true, in the unit of the places.
    """

    true_count: int
    found_count: int
    matched_count: int
    detection_rate: float
    false_alarms: int
    errors: FloatArray


def score_boundaries(
    found: npt.ArrayLike,
    truth: npt.ArrayLike,
    tolerance: float,
    found_entry: npt.ArrayLike | None = None,
    true_entry: npt.ArrayLike | None = None,
) -> BoundaryScore:
    """Match found to true edges, the nearest first, each at most once.

    Parameters
    ----------
    found, truth : array_like, shapes (n,) and (m,)
        Times or altitudes, one unit.
    tolerance : float
        Largest difference of a match.
    found_entry, true_entry : array_like of bool, optional
        Entries are matched with entries only, if both are given.
    """
    found, truth = np.asarray(found, dtype=float), np.asarray(truth, dtype=float)
    distance = np.abs(found[:, np.newaxis] - truth)
    if found_entry is not None and true_entry is not None:
        differs = np.asarray(found_entry)[:, np.newaxis] != np.asarray(true_entry)
        distance = np.where(differs, np.inf, distance)
    errors = []
    while distance.size and distance.min() <= tolerance:
        i, j = np.unravel_index(np.argmin(distance), distance.shape)
        errors.append(found[i] - truth[j])
        distance[i, :] = np.inf
        distance[:, j] = np.inf
    return BoundaryScore(
        true_count=len(truth),
        found_count=len(found),
        matched_count=len(errors),
        detection_rate=len(errors) / len(truth) if len(truth) else math.nan,
        false_alarms=len(found) - len(errors),
        errors=np.array(errors),
    )


@dataclass(frozen=True)
class MinuteScore:
    """Scintillating minutes found against true ones.

    Parameters
    ----------
    crossing_count, other_count : int
        Minutes whose ray crossed the region for long enough, and those whose ray never did.
    detection_rate, false_alarm_rate : float
        Parts of the two that were called scintillating; NaN of none.
    """

    crossing_count: int
    other_count: int
    detection_rate: float
    false_alarm_rate: float


def score_minutes(
    is_scintillating: npt.ArrayLike, crossing_time: npt.ArrayLike, least_crossing: float = 30.0
) -> MinuteScore:
    """Score minutes of rays.

    Parameters
    ----------
    is_scintillating : array_like of bool, shape (n,)
        Whether the index of a ray and minute was above the threshold.
    crossing_time : array_like, shape (n,)
        For how long its ray crossed the region, s.
    least_crossing : float
        From which on it ought to be found, s. Minutes that crossed for less count as neither.
    """
    detected = np.asarray(is_scintillating, dtype=bool)
    time = np.asarray(crossing_time, dtype=float)
    crossing, other = time >= least_crossing, time <= 0.0
    return MinuteScore(
        crossing_count=int(np.count_nonzero(crossing)),
        other_count=int(np.count_nonzero(other)),
        detection_rate=float(detected[crossing].mean()) if crossing.any() else math.nan,
        false_alarm_rate=float(detected[other].mean()) if other.any() else math.nan,
    )


@dataclass(frozen=True)
class FluctuationLag:
    """Lag of the fluctuations that one spacecraft sees behind those of another.

    Parameters
    ----------
    lag, sigma : float
        s; positive if the second one sees them later. NaN without fluctuations.
    correlation : float
        Correlation at this lag, -1 to 1.
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
        Intensities or linear C/N0 of m rays at n even instants, those of one satellite in the
        same row. All rays are used together.
    sample_rate_hz : float
    largest_lag : float
        s, to either side.
    trend : float
        Length of the running mean that is divided out, s.
    """
    first = _fluctuation(power_first, sample_rate_hz, trend)
    second = _fluctuation(power_second, sample_rate_hz, trend)
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
    # Noise of the correlation over its curvature at the peak; samples of a fade are not
    # independent, so that as many count as there are widths of the peak.
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
    """Return intensities over their running mean, less 1; of rays without fluctuation 0."""
    power = np.atleast_2d(np.asarray(power, dtype=float))
    length = max(1, min(power.shape[-1], round(trend * sample_rate_hz)))
    total = np.cumsum(np.pad(power, ((0, 0), (1, 0))), axis=-1)
    ends = np.minimum(np.arange(power.shape[-1]) + length // 2 + 1, power.shape[-1])
    starts = np.maximum(ends - length, 0)
    mean = (total[:, ends] - total[:, starts]) / (ends - starts)
    relative: FloatArray = np.nan_to_num(power / mean - 1.0)
    return relative
