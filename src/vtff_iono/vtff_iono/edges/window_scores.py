"""Scores of the windows in which rays were found to scintillate."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["WindowScore", "score_windows"]


@dataclass(frozen=True)
class WindowScore:
    """Windows found to scintillate, compared with the windows whose rays crossed the region.

    Parameters
    ----------
    crossing_count, other_count : int
        Number of windows whose ray crossed the region for long enough, and of windows whose ray
        never crossed it.
    detection_rate, false_alarm_rate : float
        Fractions of these two kinds that were found to scintillate; NaN for a kind without windows.
    """

    crossing_count: int
    other_count: int
    detection_rate: float
    false_alarm_rate: float


def score_windows(
    is_scintillating: npt.ArrayLike, crossing_time: npt.ArrayLike, crossing_minimum: float = 30.0
) -> WindowScore:
    """Score windows of rays.

    Parameters
    ----------
    is_scintillating : array_like of bool, shape (n,)
        Whether the index of a ray and window was above the threshold.
    crossing_time : array_like, shape (n,)
        Time for which its ray crossed the region, s.
    crossing_minimum : float
        Shortest crossing that must be found, s. Windows with a shorter one are of neither kind.
    """
    detected = np.asarray(is_scintillating, dtype=bool)
    time = np.asarray(crossing_time, dtype=float)
    crossing, other = time >= crossing_minimum, time <= 0.0
    return WindowScore(
        crossing_count=int(np.count_nonzero(crossing)),
        other_count=int(np.count_nonzero(other)),
        detection_rate=float(detected[crossing].mean()) if crossing.any() else math.nan,
        false_alarm_rate=float(detected[other].mean()) if other.any() else math.nan,
    )
