"""Errors of navigation against truth, with what navigation claims for itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vtff_analysis.recordings.history import DeputyHistory, FloatArray

SOLUTION_NAMES = ("none", "predicted", "code", "float", "fixed", "truth")
"""vtff_msgs/RelativeState.SOLUTION_* by number."""

SOLUTION_FIXED = 4


@dataclass(frozen=True, eq=False)
class NavigationError:
    """Estimate minus truth at the times that both have.

    Attributes
    ----------
    time
        s since the first true state, shape (n,).
    position_rtn, velocity_rtn
        m and m/s, shape (n, 3).
    position_sigma_rtn, velocity_sigma_rtn
        One sigma as navigation states it, shape (n, 3); zero where it states none.
    """

    time: FloatArray
    position_rtn: FloatArray
    velocity_rtn: FloatArray
    position_sigma_rtn: FloatArray
    velocity_sigma_rtn: FloatArray

    def within_three_sigma(self) -> FloatArray | None:
        """Return the fraction of positions within 3 sigma by axis; None without sigma."""
        stated = self.position_sigma_rtn > 0.0
        if not stated.any():
            return None
        inside = np.abs(self.position_rtn) <= 3.0 * self.position_sigma_rtn
        return np.asarray(inside.mean(axis=0))


def navigation_error(history: DeputyHistory) -> NavigationError | None:
    """Return the errors of one deputy; None where truth, estimate or a common time is missing."""
    truth, estimate, quality = history.truth, history.estimate, history.navigation
    if truth is None or estimate is None:
        return None
    _, in_truth, in_estimate = np.intersect1d(
        truth.time, estimate.time, assume_unique=True, return_indices=True
    )
    if in_truth.size == 0:
        return None
    none = np.zeros((in_truth.size, 3))
    return NavigationError(
        time=(truth.time[in_truth] - truth.time[0]) * 1e-9,
        position_rtn=estimate.position_rtn[in_estimate] - truth.position_rtn[in_truth],
        velocity_rtn=estimate.velocity_rtn[in_estimate] - truth.velocity_rtn[in_truth],
        position_sigma_rtn=none if quality is None else quality.position_sigma_rtn[in_estimate],
        velocity_sigma_rtn=none if quality is None else quality.velocity_sigma_rtn[in_estimate],
    )
