"""Numbers that describe a baseline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_analysis.baseline.processing import BaselineRun
from vtff_dynamics.vectors import FloatArray
from vtff_nav.relative.common.solution import (
    SOLUTION_FIXED,
    SOLUTION_NAMES,
    SOLUTION_PREDICTED,
)

__all__ = ["BaselineSummary", "ErrorStatistics", "summarise"]

CONVERGENCE_TIME = 600.0
"""s after the first epoch, from which on errors are also stated."""

LARGEST_SCATTER_AT_REST = 1.0
"""m; a baseline with a larger scatter moves."""


@dataclass(frozen=True)
class ErrorStatistics:
    """Errors against the truth in the local axes, m.

    Parameters
    ----------
    epochs : int
        Number of epochs that the errors belong to.
    mean, rms : tuple of 3 float
        By local axis.
    rms_3d, largest_3d : float
        RMS and maximum of the length of the error.
    """

    epochs: int
    mean: tuple[float, ...]
    rms: tuple[float, ...]
    rms_3d: float
    largest_3d: float


@dataclass(frozen=True)
class BaselineSummary:
    """Numbers of a baseline; lengths in m, tuples by local axis.

    Parameters
    ----------
    epochs : int
        Number of epochs.
    duration : float
        s from the first to the last epoch.
    counts : dict of str to int
        Epochs by solution, names as `SOLUTION_NAMES`.
    time_to_first_fix : float or None
        s from the first epoch to the first fix; None without a fix.
    mean, scatter, last : tuple of 3 float or None
        Mean, standard deviation and last value of the baseline over the fixed epochs, or over all
        epochs with a solution if none is fixed. The last value is the best of a static baseline.
    shortest, longest : float or None
        Smallest and largest length of the baseline.
    sigma : tuple of 3 float or None
        RMS of the filter's own sigmas over the same epochs.
    ratio : tuple of 2 float or None
        Least and median ratio of the ambiguity tests.
    satellites : tuple of 2 float or None
        Least and mean number of satellites.
    errors, errors_converged : ErrorStatistics or None
        Errors against the truth from the first fix on, and, in longer runs, after
        `CONVERGENCE_TIME`.
    """

    epochs: int
    duration: float
    counts: dict[str, int]
    time_to_first_fix: float | None
    mean: tuple[float, ...] | None
    scatter: tuple[float, ...] | None
    last: tuple[float, ...] | None
    shortest: float | None
    longest: float | None
    sigma: tuple[float, ...] | None
    ratio: tuple[float, ...] | None
    satellites: tuple[float, ...] | None
    errors: ErrorStatistics | None
    errors_converged: ErrorStatistics | None

    @property
    def fixed_fraction(self) -> float:
        """Fixed epochs as a fraction of all epochs."""
        return self.counts["fixed"] / self.epochs

    @property
    def is_at_rest(self) -> bool:
        """Whether the baseline scatters so little that its mean is meaningful."""
        return self.scatter is not None and max(self.scatter) < LARGEST_SCATTER_AT_REST


def summarise(run: BaselineRun, errors: FloatArray | None = None) -> BaselineSummary:
    """Return the numbers of a run; `errors` are those against the truth, shape (n, 3), m."""
    is_fixed = run.solution == SOLUTION_FIXED
    chosen = is_fixed if is_fixed.any() else run.solution > SOLUTION_PREDICTED
    first_fix = float(run.seconds[is_fixed][0]) if is_fixed.any() else None
    local, has_any = run.baseline_local[chosen], bool(chosen.any())
    length = np.linalg.norm(local, axis=1)
    tested = run.ratio[chosen & (run.ratio > 0.0)]
    since = run.seconds
    return BaselineSummary(
        epochs=len(run),
        duration=float(since[-1]),
        counts={
            name: int(np.count_nonzero(run.solution == number))
            for number, name in SOLUTION_NAMES.items()
        },
        time_to_first_fix=first_fix,
        mean=_numbers(local.mean(axis=0)) if has_any else None,
        scatter=_numbers(local.std(axis=0)) if has_any else None,
        last=_numbers(local[-1]) if has_any else None,
        shortest=float(length.min()) if has_any else None,
        longest=float(length.max()) if has_any else None,
        sigma=_numbers(np.sqrt(np.mean(run.sigma_local[chosen] ** 2, axis=0))) if has_any else None,
        ratio=_numbers([tested.min(), np.median(tested)]) if tested.size else None,
        satellites=_numbers([run.satellites_used[chosen].min(), run.satellites_used[chosen].mean()])
        if has_any
        else None,
        errors=_statistics(errors, since >= (first_fix or 0.0)),
        errors_converged=_statistics(errors, since >= CONVERGENCE_TIME)
        if since[-1] > 1.1 * CONVERGENCE_TIME
        else None,
    )


def _statistics(errors: FloatArray | None, chosen: npt.NDArray[np.bool_]) -> ErrorStatistics | None:
    if errors is None:
        return None
    listed = errors[chosen & np.isfinite(errors).all(axis=1)]
    if not len(listed):
        return None
    lengths = np.linalg.norm(listed, axis=1)
    return ErrorStatistics(
        epochs=len(listed),
        mean=_numbers(listed.mean(axis=0)),
        rms=_numbers(np.sqrt(np.mean(listed**2, axis=0))),
        rms_3d=float(np.sqrt(np.mean(lengths**2))),
        largest_3d=float(lengths.max()),
    )


def _numbers(values: npt.ArrayLike) -> tuple[float, ...]:
    return tuple(np.asarray(values, dtype=float).tolist())
