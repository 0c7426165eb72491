"""Errors of navigation against truth, with the sigmas that navigation states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_analysis.recordings.history import DeputyHistory, seconds_since
from vtff_dynamics.vectors import FloatArray

__all__ = ["NAVIGATION_START_DURATION", "NavigationError", "navigation_error"]

NAVIGATION_START_DURATION = 60.0
"""s after the first solution in which the errors are those of the start of navigation; the paper
starts its filter with as many seconds of code (section 3.4)."""


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
    is_settled
        Whether navigation has had a solution for `NAVIGATION_START_DURATION`, shape (n,).
    position_covariance_rtn
        m2, shape (n, 3, 3); zero where navigation states none.
    """

    time: FloatArray
    position_rtn: FloatArray
    velocity_rtn: FloatArray
    position_sigma_rtn: FloatArray
    velocity_sigma_rtn: FloatArray
    is_settled: npt.NDArray[np.bool_]
    position_covariance_rtn: FloatArray

    def fraction_within_three_sigma(self) -> FloatArray | None:
        """Return the fraction of positions within 3 sigma, shape (3,); None without sigma."""
        if not (self.position_sigma_rtn > 0.0).any():
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
    no_sigma = np.zeros((in_truth.size, 3))
    since_first_solution = seconds_since(int(estimate.time[0]), estimate.time[in_estimate])
    return NavigationError(
        time=seconds_since(int(truth.time[0]), truth.time[in_truth]),
        position_rtn=estimate.position_rtn[in_estimate] - truth.position_rtn[in_truth],
        velocity_rtn=estimate.velocity_rtn[in_estimate] - truth.velocity_rtn[in_truth],
        position_sigma_rtn=no_sigma if quality is None else quality.position_sigma_rtn[in_estimate],
        velocity_sigma_rtn=no_sigma if quality is None else quality.velocity_sigma_rtn[in_estimate],
        is_settled=since_first_solution >= NAVIGATION_START_DURATION,
        position_covariance_rtn=(
            np.zeros((in_truth.size, 3, 3))
            if quality is None
            else quality.position_covariance_rtn[in_estimate]
        ),
    )
