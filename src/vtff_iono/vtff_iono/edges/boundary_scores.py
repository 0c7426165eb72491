"""How well edges and scintillating minutes were found."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray

__all__ = ["BoundaryScore", "MinuteScore", "score_boundaries", "score_minutes"]


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
