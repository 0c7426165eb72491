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
"""s after the first epoch, after which errors are also stated."""


LARGEST_SCATTER_AT_REST = 1.0
"""m; above it the baseline moves."""


@dataclass(frozen=True)
class ErrorStatistics:
    """Errors against the truth in the local axes, m.

    Parameters
    ----------
    epochs : int
    mean, rms : tuple of 3 float
    rms_3d, largest_3d : float
    """

    epochs: int
    mean: tuple[float, ...]
    rms: tuple[float, ...]
    rms_3d: float
    largest_3d: float


@dataclass(frozen=True)
class BaselineSummary:
    """Numbers of a run; lengths in m, tuples by local axis.

    Parameters
    ----------
    epochs : int
    duration : float
        s.
    counts : dict of str to int
        Epochs by solution, names as `SOLUTION_NAMES`.
    time_to_first_fix : float or None
        s after the first epoch.
    mean, scatter, last : tuple of 3 float or None
        Of the fixed epochs (of all with a solution if none is fixed); scatter is the standard
        deviation. The last one is the best of a static baseline.
    shortest, longest : float or None
        Lengths of the baseline.
    sigma : tuple of 3 float or None
        RMS of the filter's own sigmas of the same epochs.
    ratio : tuple of 2 float or None
        Least and median ratio of those that were tested.
    satellites : tuple of 2 float or None
        Least and mean number.
    errors, errors_converged : ErrorStatistics or None
        Against the truth: from the first fix on, and after `CONVERGENCE_TIME` of longer runs.
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
        """Fixed epochs of all."""
        return self.counts["fixed"] / self.epochs

    @property
    def is_at_rest(self) -> bool:
        """Whether the baseline scatters so little that its mean says something."""
        return self.scatter is not None and max(self.scatter) < LARGEST_SCATTER_AT_REST


def summarise(run: BaselineRun, errors: FloatArray | None = None) -> BaselineSummary:
    """Return the numbers of a run; `errors` (n, 3) are those against the truth."""
    is_fixed = run.solution == SOLUTION_FIXED
    used = is_fixed if is_fixed.any() else run.solution > SOLUTION_PREDICTED
    first_fix = float(run.seconds[is_fixed][0]) if is_fixed.any() else None
    local, has_any = run.baseline_local[used], bool(used.any())
    length = np.linalg.norm(local, axis=1)
    tested = run.ratio[used & (run.ratio > 0.0)]
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
        sigma=_numbers(np.sqrt(np.mean(run.sigma_local[used] ** 2, axis=0))) if has_any else None,
        ratio=_numbers([tested.min(), np.median(tested)]) if tested.size else None,
        satellites=_numbers([run.satellites_used[used].min(), run.satellites_used[used].mean()])
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
