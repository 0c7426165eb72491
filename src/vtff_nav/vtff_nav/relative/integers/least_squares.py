"""Integer least squares of float ambiguities: LAMBDA with decorrelation, exact, up to n = 60.

A float solution a with covariance Q is transformed by an integer matrix of determinant +-1 to
z = Z^T a whose covariance is nearly diagonal, and the integer vectors that are nearest in the
metric of Q are found by a depth-first search. The search is exact: the candidates are the best
integer vectors, or the status tells why there are none.

References
----------
Teunissen (1995), "The least-squares ambiguity decorrelation adjustment: a method for fast GPS
integer ambiguity estimation", J. Geodesy 70, 65-82. Chang, Yang and Zhou (2005), "MLAMBDA: a
modified LAMBDA method for integer least-squares estimation", J. Geodesy 79, 552-565.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.special import erf

from vtff_dynamics.vectors import FloatArray
from vtff_nav.relative.integers import kernels

__all__ = [
    "Decorrelation",
    "IntegerSolution",
    "IntegerStatus",
    "bootstrapped_success_rate",
    "component_success_rates",
    "decorrelate",
    "search",
    "search_decorrelated",
]

IntegerArray = npt.NDArray[np.int64]

_LARGEST_AMBIGUITY = 2.0**52
"""Cycles; a double above it has no fraction of a cycle."""

_DEFAULT_NODE_LIMIT = 20_000_000
"""About 0.5 s of search; ambiguities that can be fixed need less than 1e5 nodes at n = 40."""

_TIE = 1e-12
"""Relative difference of squared norms that may come from rounding."""


class IntegerStatus(enum.Enum):
    """Outcome of a decorrelation or a search."""

    OK = "ok"
    NOT_FINITE = "not finite"
    NOT_POSITIVE_DEFINITE = "covariance not positive definite"
    ILL_CONDITIONED = "covariance too ill-conditioned for exact integers"
    OUT_OF_RANGE = "ambiguity too large for a fraction of a cycle"
    SEARCH_LIMIT = "search not finished"


@dataclass(frozen=True, eq=False)
class Decorrelation:
    """Decorrelated ambiguities z = Z^T a and the factors of their covariance L^T D L.

    Parameters
    ----------
    status : IntegerStatus
        If it is not OK, the arrays are NaN or 0.
    reason : str
        Which ambiguity is the cause of the status; empty if OK.
    transformation : ndarray of int64, shape (n, n)
        Z, determinant +1 or -1.
    inverse_transposed : ndarray of int64, shape (n, n)
        Z^-T, so that a = Z^-T z without rounding.
    lower : ndarray, shape (n, n)
        L, unit lower triangular.
    conditional_variances : ndarray, shape (n,)
        Diagonal of D, cycles^2: variance of z_i given z_i+1 to z_n. They fall towards the last one,
        but for pairs of which an exchange would not reduce the variance.
    """

    status: IntegerStatus
    reason: str
    transformation: IntegerArray
    inverse_transposed: IntegerArray
    lower: FloatArray
    conditional_variances: FloatArray

    @property
    def success_rate(self) -> float:
        """Success rate of bootstrapping all ambiguities; 0 if the status is not OK."""
        if self.status is not IntegerStatus.OK:
            return 0.0
        return bootstrapped_success_rate(self.conditional_variances)


@dataclass(frozen=True, eq=False)
class IntegerSolution:
    """The best integer vectors and their norms.

    Parameters
    ----------
    candidates : ndarray of int64, shape (m, n)
        Best first, cycles; equal norms in the order of the integers. Empty, shape (0, n), unless
        the status is OK.
    squared_norms : ndarray, shape (m,)
        (a - z)^T Q^-1 (a - z).
    ratio : float
        Second squared norm over the first; infinite if the first is zero, NaN with less than two
        candidates.
    success_rate : float
        Success rate of bootstrapping in the decorrelated space, a lower bound of the success rate
        of integer least squares.
    status : IntegerStatus
    reason : str
        Cause of the status; empty if OK.
    nodes : int
        Number of nodes visited in the search tree.
    """

    candidates: IntegerArray
    squared_norms: FloatArray
    ratio: float
    success_rate: float
    status: IntegerStatus
    reason: str
    nodes: int


def component_success_rates(conditional_variances: npt.ArrayLike) -> FloatArray:
    """Return the probability that each ambiguity is rounded rightly, given the later ones.

    Parameters
    ----------
    conditional_variances : array_like, shape (n,)
        cycles^2.
    """
    deviations = np.sqrt(np.asarray(conditional_variances, dtype=float))
    return np.asarray(erf(0.5 / (np.sqrt(2.0) * deviations)))


def bootstrapped_success_rate(conditional_variances: npt.ArrayLike) -> float:
    """Return the probability that bootstrapping gives the true integers.

    Parameters
    ----------
    conditional_variances : array_like, shape (n,)
        cycles^2; 1 is returned for n = 0.

    References
    ----------
    Teunissen (1998), "Success probability of integer GPS ambiguity rounding and bootstrapping",
    J. Geodesy 72, 606-612, eq. 25.
    """
    return float(np.prod(component_success_rates(conditional_variances)))


def decorrelate(covariance: npt.ArrayLike) -> Decorrelation:
    """Decorrelate ambiguities.

    Parameters
    ----------
    covariance : array_like, shape (n, n)
        Covariance, cycles^2; only its symmetric part is used.

    Raises
    ------
    ValueError
        If the covariance is not a square matrix. Bad numbers in it give a status instead.
    """
    matrix = np.asarray(covariance, dtype=float)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise ValueError(f"covariance: shape (n, n) expected, got {matrix.shape}")
    n = len(matrix)
    if not np.isfinite(matrix).all():
        row, column = np.argwhere(~np.isfinite(matrix))[0]
        return _failed(
            n, IntegerStatus.NOT_FINITE, f"covariance[{row}, {column}] is {matrix[row, column]}"
        )
    lower = np.zeros((n, n))
    variances = np.empty(n)
    order = np.empty(n, dtype=np.int64)
    code, index = kernels.factorise(0.5 * (matrix + matrix.T), lower, variances, order)
    if code != kernels.KERNEL_OK:
        return _failed(
            n,
            IntegerStatus.NOT_POSITIVE_DEFINITE,
            f"ambiguity {index}: variance {matrix[index, index]:.6g} cycles^2 is not positive or "
            "is that of a combination of the others within rounding",
        )
    transformation = np.zeros((n, n), dtype=np.int64)
    transformation[order, np.arange(n)] = 1
    inverse_transposed = transformation.copy()
    if kernels.reduce(lower, variances, transformation, inverse_transposed) != kernels.KERNEL_OK:
        return _failed(n, IntegerStatus.ILL_CONDITIONED, "transformation beyond 2^31")
    return Decorrelation(IntegerStatus.OK, "", transformation, inverse_transposed, lower, variances)


def search_decorrelated(
    float_ambiguities: npt.ArrayLike,
    lower: npt.ArrayLike,
    conditional_variances: npt.ArrayLike,
    candidates: int = 2,
    node_limit: int = _DEFAULT_NODE_LIMIT,
) -> IntegerSolution:
    """Find the best integer vectors of ambiguities that are decorrelated already.

    Parameters
    ----------
    float_ambiguities : array_like, shape (n,)
        cycles; small enough that their fractions are exact, as `search` and `partial_fix` prepare
        them.
    lower, conditional_variances : array_like, shapes (n, n) and (n,)
        Factors of their covariance L^T D L, for example the trailing part of a `Decorrelation`.
    candidates : int
        m >= 1.
    node_limit : int
        Number of nodes after which the search gives up.
    """
    center = np.asarray(float_ambiguities, dtype=float)
    factor = np.ascontiguousarray(lower, dtype=float)
    variances = np.ascontiguousarray(conditional_variances, dtype=float)
    if candidates < 1:
        raise ValueError(f"candidates: at least 1 expected, got {candidates}")
    success_rate = bootstrapped_success_rate(variances)
    n = len(center)
    if n == 0:
        empty = np.zeros((1, 0), dtype=np.int64)
        return IntegerSolution(empty, np.zeros(1), np.nan, 1.0, IntegerStatus.OK, "", 0)
    vectors = np.zeros((candidates, n))
    norms = np.zeros(candidates)
    nodes = kernels.search(center, factor, variances, vectors, norms, node_limit)
    if nodes < 0:
        return _unsolved_in_time(n, success_rate, node_limit)
    return IntegerSolution(
        candidates=vectors.astype(np.int64),
        squared_norms=norms,
        ratio=_ratio(norms),
        success_rate=success_rate,
        status=IntegerStatus.OK,
        reason="",
        nodes=nodes,
    )


def search(
    float_ambiguities: npt.ArrayLike,
    covariance: npt.ArrayLike,
    candidates: int = 2,
    node_limit: int = _DEFAULT_NODE_LIMIT,
) -> IntegerSolution:
    """Find the integer vectors with the least (a - z)^T Q^-1 (a - z).

    Parameters
    ----------
    float_ambiguities : array_like, shape (n,)
        a, cycles; any size up to 4.5e15.
    covariance : array_like, shape (n, n)
        Q, cycles^2; only its symmetric part is used.
    candidates : int
        Number m of vectors, at least 1.
    node_limit : int
        Number of nodes after which the search gives up with `IntegerStatus.SEARCH_LIMIT`.

    Raises
    ------
    ValueError
        If shapes do not fit. Bad numbers give a status and a reason instead.

    References
    ----------
    Teunissen (1995), Chang, Yang and Zhou (2005): see the module.
    """
    ambiguities = np.asarray(float_ambiguities, dtype=float)
    matrix = np.ascontiguousarray(covariance, dtype=float)
    n = len(matrix)
    if ambiguities.shape != (n,):
        raise ValueError(f"float_ambiguities: shape ({n},) expected, got {ambiguities.shape}")
    if not np.isfinite(ambiguities).all():
        index = int(np.argmin(np.isfinite(ambiguities)))
        reason = f"float_ambiguities[{index}] is {ambiguities[index]}"
        return _unsolved(n, IntegerStatus.NOT_FINITE, reason)
    if n and np.abs(ambiguities).max() > _LARGEST_AMBIGUITY:
        index = int(np.abs(ambiguities).argmax())
        reason = f"float_ambiguities[{index}] is {ambiguities[index]} cycles"
        return _unsolved(n, IntegerStatus.OUT_OF_RANGE, reason)
    decorrelation = decorrelate(covariance)
    if decorrelation.status is not IntegerStatus.OK:
        return _unsolved(n, decorrelation.status, decorrelation.reason)
    # Integer parts are taken off first, so that combining the fractions loses no digits.
    whole = np.rint(ambiguities)
    found = search_decorrelated(
        (ambiguities - whole) @ decorrelation.transformation,
        decorrelation.lower,
        decorrelation.conditional_variances,
        candidates,
        node_limit,
    )
    integers = found.candidates @ decorrelation.inverse_transposed.T + whole.astype(np.int64)
    order = _order_of_ties(found.squared_norms, integers)
    return replace(found, candidates=integers[order])


def _ratio(squared_norms: FloatArray) -> float:
    if len(squared_norms) < 2:
        return float("nan")
    best, second = squared_norms[:2].tolist()
    return second / best if best > 0.0 else float("inf")


def _order_of_ties(squared_norms: FloatArray, integers: IntegerArray) -> list[int]:
    """Return the order by norm, and by the integers where norms differ by rounding only."""
    order = list(range(len(integers)))
    first = 0
    for last in range(1, len(order) + 1):
        if last < len(order) and squared_norms[last] - squared_norms[last - 1] <= (
            _TIE * squared_norms[last]
        ):
            continue
        order[first:last] = sorted(order[first:last], key=lambda i: integers[i].tolist())
        first = last
    return order


def _failed(n: int, status: IntegerStatus, reason: str) -> Decorrelation:
    zeros = np.zeros((n, n), dtype=np.int64)
    return Decorrelation(status, reason, zeros, zeros, np.full((n, n), np.nan), np.full(n, np.nan))


def _unsolved_in_time(n: int, success_rate: float, node_limit: int) -> IntegerSolution:
    reason = f"not finished after {node_limit} nodes, success rate {success_rate:.3g}"
    return _unsolved(n, IntegerStatus.SEARCH_LIMIT, reason, success_rate, node_limit)


def _unsolved(
    n: int, status: IntegerStatus, reason: str, success_rate: float = 0.0, nodes: int = 0
) -> IntegerSolution:
    return IntegerSolution(
        candidates=np.zeros((0, n), dtype=np.int64),
        squared_norms=np.zeros(0),
        ratio=float("nan"),
        success_rate=success_rate,
        status=status,
        reason=reason,
        nodes=nodes,
    )
