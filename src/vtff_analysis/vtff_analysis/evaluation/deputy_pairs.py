"""Deputies relative to each other: what their filters say of the difference, against the truth."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vtff_analysis.evaluation.navigation import NAVIGATION_START_DURATION
from vtff_analysis.recordings.history import DeputyHistory, seconds_since
from vtff_analysis.recordings.topics import key_part
from vtff_dynamics.vectors import FloatArray
from vtff_nav.relative.common.deputy_difference import difference_of_deputies

__all__ = ["PairError", "normalised_error", "pair_error", "summarise_pairs"]


@dataclass(frozen=True, eq=False)
class PairError:
    """Error of the second deputy less the first, after the start of both navigations.

    Attributes
    ----------
    position_rtn
        Estimated minus true difference in the chief's RTN frame, m, shape (n, 3).
    covariance_rtn
        m2, shape (n, 3, 3); `vtff_nav.relative.common.deputy_difference`.
    separation
        True distance, m, shape (n,).
    """

    position_rtn: FloatArray
    covariance_rtn: FloatArray
    separation: FloatArray


def pair_error(first: DeputyHistory, second: DeputyHistory) -> PairError | None:
    """Return the errors of a pair at the times that all four histories have, None without any."""
    needed = (first.truth, first.estimate, second.truth, second.estimate)
    if first.navigation is None or second.navigation is None or None in needed:
        return None
    histories = [history for history in needed if history is not None]
    common = functools.reduce(np.intersect1d, [history.time for history in histories])
    if common.size == 0:
        return None
    start = max(int(histories[1].time[0]), int(histories[3].time[0]))
    common = common[seconds_since(start, common) >= NAVIGATION_START_DURATION]
    if common.size == 0:
        return None
    rows = [np.searchsorted(history.time, common) for history in histories]
    positions = [h.position_rtn[r] for h, r in zip(histories, rows, strict=True)]
    difference, covariance = difference_of_deputies(
        positions[1],
        positions[3],
        first.navigation.position_covariance_rtn[rows[1]],
        second.navigation.position_covariance_rtn[rows[3]],
    )
    true = positions[2] - positions[0]
    return PairError(difference - true, covariance, np.linalg.norm(true, axis=1))


def normalised_error(position: FloatArray, covariance: FloatArray) -> float | None:
    """Return the mean normalised squared error of positions; 1 is honest, None without covariance.

    Parameters
    ----------
    position
        Errors, m, shape (n, 3).
    covariance
        m2, shape (n, 3, 3).
    """
    stated = np.trace(covariance, axis1=1, axis2=2) > 0.0
    if not stated.any():
        return None
    error = position[stated]
    weighted = np.linalg.solve(covariance[stated], error[..., np.newaxis])[..., 0]
    return float(np.mean(np.sum(error * weighted, axis=1)) / position.shape[1])


def summarise_pairs(deputies: Mapping[str, DeputyHistory]) -> dict[str, float | None]:
    """Return the numbers of every two deputies, keys of docs/summary.md."""
    summary: dict[str, float | None] = {}
    for first, second in itertools.combinations(deputies, 2):
        prefix = f"pair_{key_part(first)}_{key_part(second)}"
        truths = deputies[first].truth, deputies[second].truth
        if truths[0] is not None and truths[1] is not None:
            _, rows, other = np.intersect1d(
                truths[0].time, truths[1].time, assume_unique=True, return_indices=True
            )
            if rows.size:
                true = truths[1].position_rtn[other] - truths[0].position_rtn[rows]
                summary[f"{prefix}_minimum_separation_m"] = float(
                    np.linalg.norm(true, axis=1).min()
                )
        error = pair_error(deputies[first], deputies[second])
        if error is not None:
            squared = np.sum(error.position_rtn**2, axis=1)
            summary[f"{prefix}_error_settled_3d_rms_m"] = float(np.sqrt(squared.mean()))
            summary[f"{prefix}_error_settled_nees"] = normalised_error(
                error.position_rtn, error.covariance_rtn
            )
    return summary
