"""Acceptance of integers: ratio test with a fixed failure rate, partial resolution.

References
----------
Verhagen and Teunissen (2013), "The ratio test for future GNSS ambiguity resolution", GPS Solutions
17, 535-548 (ratio test with a fixed failure rate). Hou, Verhagen and Wu (2016), see
`failure_rate_table`. Teunissen, Joosten and Tiberius (1999), "Geometry-free ambiguity success rates
in case of partial fixing", ION NTM, 201-207 (partial resolution).
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import gammaincc

from vtff_dynamics.vectors import FloatArray
from vtff_nav.relative.integers.failure_rate_table import CRITICAL_VALUE_COEFFICIENTS, FAILURE_RATES
from vtff_nav.relative.integers.least_squares import (
    Decorrelation,
    IntegerSolution,
    IntegerStatus,
    bootstrapped_success_rate,
    component_success_rates,
    decorrelate,
    search_decorrelated,
)

__all__ = ["FixStatus", "PartialFix", "partial_fix", "ratio_threshold"]

IntegerArray = npt.NDArray[np.int64]

_LARGEST_FAILURE_RATE = 0.2
"""The published critical values hold up to this rate; a worse model is never fixed."""

_NODE_LIMIT = 1_000_000
"""About 20 ms of search; ambiguities that need more nodes do not pass a test."""


class FixStatus(enum.Enum):
    """Outcome of an attempt to fix ambiguities."""

    FIXED = "all fixed"
    PARTIAL = "some fixed"
    WEAK = "success rate too low"
    RATIO = "ratio test failed"
    RESIDUAL = "integers do not fit the float solution"
    BAD_INPUT = "no integer search possible"


@dataclass(frozen=True, eq=False)
class PartialFix:
    """Integer combinations that passed the tests, and the ambiguities given these integers.

    Parameters
    ----------
    status : FixStatus
        k = n with FIXED, 0 < k < n with PARTIAL, otherwise k = 0.
    reason : str
        Sentence for people; empty with FIXED.
    transformation : ndarray of int64, shape (n, k)
        ``transformation.T @ ambiguities == integers``: constraints for a filter.
    integers : ndarray of int64, shape (k,)
    ambiguities : ndarray, shape (n,)
        Float ambiguities given the integers, cycles; whole numbers where `determined`.
    covariance : ndarray, shape (n, n)
        Covariance of `ambiguities`, cycles^2; zero where `determined`.
    determined : ndarray of bool, shape (n,)
        Whether the integers determine an ambiguity by itself.
    success_rate : float
        Bootstrapped success rate of the combinations fixed, or of all ambiguities if none is.
    ratio, ratio_threshold : float
        Ratio and threshold of the last test; NaN if there was none.
    squared_norm : float
        Squared norm of the integers: chi-square with k degrees of freedom if they are right.
    """

    status: FixStatus
    reason: str
    transformation: IntegerArray
    integers: IntegerArray
    ambiguities: FloatArray
    covariance: FloatArray
    determined: npt.NDArray[np.bool_]
    success_rate: float
    ratio: float
    ratio_threshold: float
    squared_norm: float


def ratio_threshold(
    failure_rate_least_squares: float, ambiguities: int, failure_rate: float = 0.001
) -> float:
    """Return the smallest ratio of second to best squared norm that may be accepted.

    Parameters
    ----------
    failure_rate_least_squares : float
        Probability that integer least squares without test is wrong; the bootstrapped failure rate
        is an upper bound of it.
    ambiguities : int
        n >= 1; above 66 the values of 66, the last published, are taken.
    failure_rate : float
        Probability of an accepted wrong fix: 0.001 or 0.01.

    Returns
    -------
    float
        1 where no test is needed, infinity where nothing can be accepted.

    References
    ----------
    Hou, Verhagen and Wu (2016): coefficients of `failure_rate_table`.
    """
    if failure_rate not in FAILURE_RATES:
        rates = " or ".join(str(rate) for rate in FAILURE_RATES)
        raise ValueError(f"failure_rate: {rates} expected, got {failure_rate}")
    if ambiguities < 1:
        raise ValueError(f"ambiguities: at least 1 expected, got {ambiguities}")
    if failure_rate_least_squares < failure_rate:
        return 1.0
    if not failure_rate_least_squares <= _LARGEST_FAILURE_RATE:
        return float("inf")
    row = CRITICAL_VALUE_COEFFICIENTS[min(ambiguities, len(CRITICAL_VALUE_COEFFICIENTS)) - 1]
    first = 3 * FAILURE_RATES.index(failure_rate)
    scale, exponent, offset = row[first : first + 3]
    critical = scale * float(failure_rate_least_squares) ** exponent + offset
    if critical <= 0.0:
        return float("inf")
    return 1.0 / min(float(critical), 1.0)


def partial_fix(
    float_ambiguities: npt.ArrayLike,
    covariance: npt.ArrayLike,
    success_rate: float = 0.999,
    failure_rate: float = 0.001,
    residual_probability: float = 1e-6,
    minimum_ratio: float = 1.0,
) -> PartialFix:
    """Fix all ambiguities that can be fixed reliably.

    The first attempt is to fix all of them by integer least squares with the ratio test. If that is
    refused, the largest set of the most precise decorrelated ambiguities whose success rate
    suffices is fixed, with the same tests.

    Parameters
    ----------
    float_ambiguities : array_like, shape (n,)
        cycles.
    covariance : array_like, shape (n, n)
        cycles^2.
    success_rate : float
        Smallest bootstrapped success rate of a subset.
    failure_rate : float
        Failure rate of the ratio test, for each of the two attempts; see `ratio_threshold`.
    residual_probability : float
        Integers are refused if their squared norm would be exceeded by chance with a smaller
        probability: the covariance or the measurements are wrong then, and the tests are void.
    minimum_ratio : float
        Smallest ratio that is accepted in any case, against models that are too optimistic.

    Raises
    ------
    ValueError
        If shapes or parameters do not fit. Bad numbers give `FixStatus.BAD_INPUT` instead.
    """
    ambiguities = np.asarray(float_ambiguities, dtype=float)
    matrix = np.asarray(covariance, dtype=float)
    n = len(ambiguities)
    if ambiguities.ndim != 1 or matrix.shape != (n, n):
        raise ValueError(
            f"shapes (n,) and (n, n) expected, got {ambiguities.shape}, {matrix.shape}"
        )
    if n == 0:
        return _float_solution(ambiguities, matrix, FixStatus.BAD_INPUT, "no ambiguities")
    if not np.isfinite(ambiguities).all():
        return _float_solution(ambiguities, matrix, FixStatus.BAD_INPUT, "ambiguity not finite")
    decorrelation = decorrelate(matrix)
    if decorrelation.status is not IntegerStatus.OK:
        reason = f"{decorrelation.status.value}: {decorrelation.reason}"
        return _float_solution(ambiguities, matrix, FixStatus.BAD_INPUT, reason)
    nearest = np.rint(ambiguities)
    center = decorrelation.transformation.T @ (ambiguities - nearest)
    rate_of_all = decorrelation.success_rate
    attempt = _Attempt(FixStatus.WEAK, f"success rate {rate_of_all:.4f}", None, np.nan)
    refused = ""
    for is_subset in (False, True):
        first = _first_of_subset(decorrelation, success_rate) if is_subset else 0
        if is_subset and first in (0, n):
            break
        attempt = _test_integers(
            decorrelation, center, first, failure_rate, residual_probability, minimum_ratio
        )
        if attempt.status is FixStatus.FIXED:
            assert attempt.solution is not None
            return _condition_on_integers(decorrelation, center, nearest, first, attempt, refused)
        refused = attempt.reason
    return _float_solution(
        ambiguities, matrix, attempt.status, attempt.reason, rate_of_all, attempt
    )


@dataclass(frozen=True, eq=False)
class _Attempt:
    """Result of the tests of a set of ambiguities; the status is FIXED if it passed."""

    status: FixStatus
    reason: str
    solution: IntegerSolution | None
    threshold: float


def _first_of_subset(decorrelation: Decorrelation, success_rate: float) -> int:
    """Return the first index of the largest trailing subset with a success rate; n without."""
    rates = component_success_rates(decorrelation.conditional_variances)
    sufficient = np.multiply.accumulate(rates[::-1]) >= success_rate
    return len(rates) - int(np.count_nonzero(sufficient))


def _test_integers(
    decorrelation: Decorrelation,
    center: FloatArray,
    first: int,
    failure_rate: float,
    residual_probability: float,
    minimum_ratio: float,
) -> _Attempt:
    """Search the integers of the decorrelated ambiguities from `first` on, and test them."""
    variances = decorrelation.conditional_variances[first:]
    fixed = len(variances)
    failure_rate_untested = 1.0 - bootstrapped_success_rate(variances)
    threshold = max(minimum_ratio, ratio_threshold(failure_rate_untested, fixed, failure_rate))
    if not np.isfinite(threshold):
        reason = f"success rate {1.0 - failure_rate_untested:.4f} of {fixed}"
        return _Attempt(FixStatus.WEAK, reason, None, threshold)
    solution = search_decorrelated(
        center[first:],
        decorrelation.lower[first:, first:],
        variances,
        node_limit=_NODE_LIMIT,
    )
    if solution.status is not IntegerStatus.OK:
        return _Attempt(FixStatus.WEAK, solution.reason, None, threshold)
    if solution.ratio < threshold:
        reason = f"ratio {solution.ratio:.2f} of {fixed}, {threshold:.2f} needed"
        return _Attempt(FixStatus.RATIO, reason, solution, threshold)
    norm = float(solution.squared_norms[0])
    if gammaincc(0.5 * fixed, 0.5 * norm) < residual_probability:
        reason = f"squared norm {norm:.1f} with {fixed} degrees of freedom"
        return _Attempt(FixStatus.RESIDUAL, reason, solution, threshold)
    return _Attempt(FixStatus.FIXED, "", solution, threshold)


def _condition_on_integers(
    decorrelation: Decorrelation,
    center: FloatArray,
    nearest: FloatArray,
    first: int,
    attempt: _Attempt,
    refused: str,
) -> PartialFix:
    """Return the ambiguities given the integers of the decorrelated ones from `first` on.

    With Q_z = L^T D L and the fixed ones last, Q_11|2 = L_11^T D_1 L_11 and the gain is
    L_21^T L_22^-T.
    """
    solution = attempt.solution
    assert solution is not None
    n = len(center)
    integers = solution.candidates[0]
    lower, back = decorrelation.lower, decorrelation.inverse_transposed
    shift = np.linalg.solve(lower[first:, first:].T, integers - center[first:])
    free = center[:first] + lower[first:, :first].T @ shift
    # Whole and fractional parts are transformed apart, so that integers stay exact.
    whole = nearest.astype(np.int64) + back[:, first:] @ integers
    spread = back[:, :first] @ lower[:first, :first].T
    transformation = decorrelation.transformation[:, first:]
    status = FixStatus.FIXED if first == 0 else FixStatus.PARTIAL
    return PartialFix(
        status=status,
        reason="" if first == 0 else f"{n - first} of {n} fixed; all of them: {refused}",
        transformation=transformation,
        integers=integers + transformation.T @ nearest.astype(np.int64),
        ambiguities=whole + back[:, :first] @ free,
        covariance=(spread * decorrelation.conditional_variances[:first]) @ spread.T,
        determined=np.asarray(np.equal(back[:, :first], 0).all(axis=1)),
        success_rate=solution.success_rate,
        ratio=solution.ratio,
        ratio_threshold=attempt.threshold,
        squared_norm=float(solution.squared_norms[0]),
    )


def _float_solution(
    ambiguities: FloatArray,
    covariance: FloatArray,
    status: FixStatus,
    reason: str,
    success_rate: float = 0.0,
    attempt: _Attempt | None = None,
) -> PartialFix:
    n = len(ambiguities)
    solution = None if attempt is None else attempt.solution
    return PartialFix(
        status=status,
        reason=reason,
        transformation=np.zeros((n, 0), dtype=np.int64),
        integers=np.zeros(0, dtype=np.int64),
        ambiguities=ambiguities,
        covariance=covariance,
        determined=np.zeros(n, dtype=bool),
        success_rate=success_rate,
        ratio=float("nan") if solution is None else solution.ratio,
        ratio_threshold=float("nan") if attempt is None else attempt.threshold,
        squared_norm=float("nan"),
    )
