"""The most probable densities and effects, given contents that are linear in both.

Contents are P n + E u + noise. The logarithms x of the densities n = exp(x) have a normal prior
with a full precision matrix; the effects u have independent normal priors of mean zero. The effects
are eliminated from the normal equations, and x is found by Gauss-Newton steps, damped after
Levenberg and Marquardt. The covariance is the inverse of the curvature at the maximum of the
posterior density (Laplace).

Most effects are two of each arc: what is particular to its content, and its level. Samples of
different arcs share neither, so that their normal matrix consists of blocks of two. These are
eliminated first, and only then the effects that arcs share, whose matrix is full.

References
----------
Marquardt (1963), J. Soc. Indust. Appl. Math. 11, 431.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray

__all__ = ["NormalEquations", "ProfileSolution", "solve_profile"]

# Largest number of steps; they end when the next step would gain less than this, in twice the
# logarithm of the posterior density.
_ITERATIONS = 60
_CONVERGED = 1e-2
# After a step of a smaller gain than this the next one is probably not needed.
_NEARLY_CONVERGED = 0.2
# Where a damped step gains this, one without damping gains more than `_CONVERGED`, whatever the
# rounding.
_SURELY_NOT_CONVERGED = 1.001 * _CONVERGED
# Damping as a fraction of the diagonal of the curvature: first value and limits.
_DAMPING_START, _DAMPING_LEAST, _DAMPING_MOST = 1e-3, 1e-9, 1e6
# Largest change of the logarithm of a density in one step.
_LARGEST_STEP = 3.0
_NOT_POSITIVE = "a precision matrix is not positive definite"


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of densities and effects, linear in both.

    Parameters
    ----------
    shared : int
        Number r of the effects that arcs share.
    joint : ndarray, shape (r + n + 1, r + n + 1)
        J' W J, whose columns J are those of the shared effects, the paths P of the n densities,
        and the contents.
    arc_products : ndarray, shape (3, arcs)
        Weighted products of the columns of the two effects of each arc: of the first one with
        itself, of both, and of the second one with itself.
    arc_joint : ndarray, shape (2, arcs, r + n + 1)
        Weighted products of the columns of both effects of each arc with J.
    """

    shared: int
    joint: FloatArray
    arc_products: FloatArray
    arc_joint: FloatArray


class _ArcFactors(NamedTuple):
    """Cholesky factors of the blocks of arcs, lower triangles L of two rows.

    Attributes
    ----------
    first, mixed, second : ndarray, shape (arcs, 1)
        The upper element of the diagonal, the one below it, and the lower one of the diagonal.
    """

    first: FloatArray
    mixed: FloatArray
    second: FloatArray

    @classmethod
    def of(cls, products: FloatArray, precision: FloatArray) -> _ArcFactors:
        """Return the factors of products (3, arcs) and prior precisions (2, arcs)."""
        square = products[2] + precision[1]
        first = np.sqrt(products[0] + precision[0])
        mixed = products[1] / first
        rest = square - mixed**2
        if not (rest > 0.0).all():
            raise np.linalg.LinAlgError(_NOT_POSITIVE)
        parts = first, mixed, np.sqrt(rest)
        return cls(*(part[:, np.newaxis] for part in parts))

    def solve_lower(self, rows: FloatArray) -> FloatArray:
        """Return L^-1 times rows (2, arcs, k)."""
        solved = np.empty_like(rows)
        solved[0] = rows[0] / self.first
        solved[1] = (rows[1] - self.mixed * solved[0]) / self.second
        return solved

    def solve_upper(self, rows: FloatArray) -> FloatArray:
        """Return L'^-1 times rows (2, arcs, k)."""
        solved = np.empty_like(rows)
        solved[1] = rows[1] / self.second
        solved[0] = (rows[0] - self.mixed * solved[1]) / self.first
        return solved

    def variance(self) -> FloatArray:
        """Return the diagonal of the inverse of the blocks, shape (2 arcs,)."""
        of_first = (1.0 + (self.mixed / self.second) ** 2) / self.first**2
        return np.concatenate((of_first, 1.0 / self.second**2))[:, 0]


@dataclass(frozen=True, eq=False)
class ProfileSolution:
    """The most probable densities and effects, and their errors.

    Effects are r shared ones, then the first effects of all arcs, then their second ones: m.

    Parameters
    ----------
    log_density : ndarray, shape (n,)
        Logarithms of densities.
    effects : ndarray, shape (m,)
    curvature_factor : ndarray, shape (n, n)
        Cholesky factor of the precision of logarithms, an upper triangle, below which there may be
        anything, as of the next one.
    shared_factor : ndarray, shape (r, r)
        Cholesky factor of the precision of shared effects for known densities.
    shared_rows : ndarray, shape (r, n)
        Products of the columns of shared effects and the paths, divided by the transposed factor.
    arc_factors : _ArcFactors
        Cholesky factors of the precisions of the effects of arcs for known others.
    arc_rows : ndarray, shape (2 arcs, r + n)
        Products of the columns of the effects of arcs with those of shared effects and the paths,
        divided by these factors.
    """

    log_density: FloatArray
    effects: FloatArray
    curvature_factor: FloatArray
    shared_factor: FloatArray
    shared_rows: FloatArray
    arc_factors: _ArcFactors
    arc_rows: FloatArray

    @functools.cached_property
    def _shared_inverse(self) -> FloatArray:
        """Inverse of the factor of shared effects, shape (r, r)."""
        return np.triu(lapack.dtrtri(self.shared_factor)[0])

    @functools.cached_property
    def _shared_per_log_density(self) -> FloatArray:
        """Decrease of shared effects where the logarithm of a density increases by one, (r, n)."""
        return np.asarray(self._shared_inverse @ self.shared_rows * np.exp(self.log_density))

    @functools.cached_property
    def _arcs_per_log_density(self) -> FloatArray:
        """Decrease of effects of arcs where a logarithm increases by one, shape (2 arcs, n)."""
        shared = len(self.shared_factor)
        rows = self.arc_rows[:, shared:] * np.exp(self.log_density)
        rows -= self.arc_rows[:, :shared] @ self._shared_per_log_density
        return _over_arcs(self.arc_factors.solve_upper, rows)

    @functools.cached_property
    def shared_variance(self) -> FloatArray:
        """Variances of the shared effects, shape (r,)."""
        inverse = self._shared_inverse
        variance = np.einsum("ij,ij->i", inverse, inverse)
        return np.asarray(variance + self._density_variance(self._shared_per_log_density))

    @functools.cached_property
    def effect_variance(self) -> FloatArray:
        """Variances of the effects, shape (m,)."""
        # What the errors of shared effects cause in those of arcs, for known densities.
        shared = self.arc_rows[:, : len(self.shared_factor)] @ self._shared_inverse
        shared = _over_arcs(self.arc_factors.solve_upper, shared)
        variance = self.arc_factors.variance() + np.einsum("ij,ij->i", shared, shared)
        variance += self._density_variance(self._arcs_per_log_density)
        return np.concatenate((self.shared_variance, variance))

    def variance(self, per_effect: FloatArray) -> FloatArray:
        """Return the variances of k linear functions of effects (k, m), shape (k,)."""
        shared = len(self.shared_factor)
        by_density = per_effect[:, :shared] @ self._shared_per_log_density
        by_density += per_effect[:, shared:] @ self._arcs_per_log_density
        of_arcs = _over_arcs(self.arc_factors.solve_lower, per_effect[:, shared:].T)
        of_shared = per_effect[:, :shared].T - self.arc_rows[:, :shared].T @ of_arcs
        of_shared = _solve_transposed(self.shared_factor, of_shared)
        variance = np.einsum("ij,ij->j", of_arcs, of_arcs)
        variance += np.einsum("ij,ij->j", of_shared, of_shared)
        return np.asarray(variance + self._density_variance(by_density))

    def _density_variance(self, per_log_density: FloatArray) -> FloatArray:
        """Return the variances of linear functions of logarithms (k, n), (k,)."""
        solved = _solve_transposed(self.curvature_factor, per_log_density.T).T
        return np.asarray(np.einsum("ij,ij->i", solved, solved))


def _over_arcs(solve: Callable[[FloatArray], FloatArray], rows: FloatArray) -> FloatArray:
    """Return what a function of rows (2, arcs, k) returns for rows (2 arcs, k), (2 arcs, k)."""
    return solve(rows.reshape(2, -1, rows.shape[1])).reshape(rows.shape)


def solve_profile(
    normal: NormalEquations,
    prior_precision: FloatArray,
    prior_vector: FloatArray,
    effect_precision: FloatArray,
    log_density: FloatArray,
) -> ProfileSolution:
    """Return the maximum of the posterior density.

    Parameters
    ----------
    normal : NormalEquations
    prior_precision, prior_vector : ndarray, shapes (n, n), (n,)
        Precision of the logarithms of densities, and precision times their mean.
    effect_precision : ndarray, shape (m,)
        One over the prior variances of the effects, in the order of `ProfileSolution`; zero for an
        effect without prior.
    log_density : ndarray, shape (n,)
        Logarithms of densities that the search begins with.
    """
    shared = normal.shared
    factors = _ArcFactors.of(normal.arc_products, effect_precision[shared:].reshape(2, -1))
    arc_rows = factors.solve_lower(normal.arc_joint).reshape(-1, len(normal.joint))
    joint = normal.joint - arc_rows.T @ arc_rows
    precision = joint[:shared, :shared] + np.diag(effect_precision[:shared])
    factor = _factorise(precision)
    # Symmetric: the transposed rows below lie in memory as LAPACK wants them.
    shared_rows = _solve_transposed(factor, joint[shared:, :shared].T)
    reduced = joint[shared:, shared:] - shared_rows.T @ shared_rows
    log_density, curvature = _find_maximum(
        np.ascontiguousarray(reduced[:-1, :-1]),
        np.ascontiguousarray(reduced[:-1, -1]),
        prior_precision,
        prior_vector,
        log_density,
    )
    density = np.exp(log_density)
    shared_rows, shared_right = shared_rows[:, :-1], shared_rows[:, -1]
    of_shared = lapack.dtrtrs(factor, shared_right - shared_rows @ density)[0]
    arc_rows, arc_right = arc_rows[:, :-1], arc_rows[:, -1]
    right = arc_right - arc_rows @ np.concatenate((of_shared, density))
    of_arcs = _over_arcs(factors.solve_upper, right[:, np.newaxis])[:, 0]
    effects = np.concatenate((of_shared, of_arcs))
    return ProfileSolution(log_density, effects, curvature, factor, shared_rows, factors, arc_rows)


def _find_maximum(
    matrix: FloatArray,
    vector: FloatArray,
    prior_precision: FloatArray,
    prior_vector: FloatArray,
    log_density: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the logarithms at the maximum, and the Cholesky factor of the curvature there."""

    def compute_cost(logarithm: FloatArray) -> float:
        density = np.exp(logarithm)
        misfit = density @ (0.5 * (matrix @ density) - vector)
        return float(misfit + logarithm @ (0.5 * (prior_precision @ logarithm) - prior_vector))

    damping, cost = _DAMPING_START, compute_cost(log_density)
    gain = np.inf
    for _ in range(_ITERATIONS):
        density = np.exp(log_density)
        data_slope = density * (vector - matrix @ density)
        slope = data_slope + prior_vector - prior_precision @ log_density
        curvature: FloatArray = _curvature(matrix, density, prior_precision)
        factor = None
        if gain < _NEARLY_CONVERGED:
            factor = _factorise(curvature)
            if float(slope @ _solve(factor, slope)) < _CONVERGED:
                break
        diagonal = np.diag(curvature)
        # Where the data ask for less density, the curvature of the exponential counts too: without
        # it the steps overshoot back and forth.
        overshoot = np.maximum(-data_slope, 0.0)
        while damping < _DAMPING_MOST:
            damped = curvature.copy()
            np.fill_diagonal(damped, diagonal + (damping * diagonal + overshoot))
            step = _solve(_factorise(damped, is_given_up=True), slope)
            gain = float(slope @ step)
            # A damped step gains less than one without damping: where it gains enough, the search
            # has not converged, and the curvature needs no factor.
            if factor is None and gain < _SURELY_NOT_CONVERGED:
                factor = _factorise(curvature)
                if float(slope @ _solve(factor, slope)) < _CONVERGED:
                    return log_density, factor
            trial = log_density + np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
            trial_cost = compute_cost(trial)
            if trial_cost < cost:
                log_density, cost = trial, trial_cost
                damping = max(0.1 * damping, _DAMPING_LEAST)
                break
            damping *= 10.0
        else:
            break
    return log_density, _factorise(curvature) if factor is None else factor


@compiled
def _curvature(matrix, density, precision):  # type: ignore[no-untyped-def]
    """Return the curvature of the cost by logarithms of densities (n,), shape (n, n).

    `matrix` is that by densities, `precision` that of the prior; array operations would pass over
    such a matrix three times.
    """
    curvature = np.empty(matrix.shape)
    for row in range(len(density)):
        of_row = density[row]
        for column in range(len(density)):
            by_data = of_row * matrix[row, column] * density[column]
            curvature[row, column] = by_data + precision[row, column]
    return curvature


def _factorise(matrix: FloatArray, *, is_given_up: bool = False) -> FloatArray:
    """Return the Cholesky factor of a positive definite matrix, an upper triangle.

    A matrix that is given up becomes the factor.

    LAPACK is called here and in `_solve`, because `scipy.linalg` takes as long to look at arguments
    of this size as LAPACK takes to compute. It wants matrices column by column: that is how the
    transposed one, which is the same, lies in memory.
    """
    factor: FloatArray
    factor, failed = lapack.dpotrf(matrix.T, clean=False, overwrite_a=is_given_up)
    if failed:
        raise np.linalg.LinAlgError(_NOT_POSITIVE)
    return factor


def _solve(factor: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solution of equations for right sides (n,) or (n, k); see `_factorise`."""
    solution: FloatArray = lapack.dpotrs(factor, right)[0]
    return solution


def _solve_transposed(factor: FloatArray, right: FloatArray) -> FloatArray:
    """Return right sides (n, k) divided by a transposed factor, (n, k)."""
    solution: FloatArray = lapack.dtrtrs(factor, right, trans=1)[0]
    return solution
