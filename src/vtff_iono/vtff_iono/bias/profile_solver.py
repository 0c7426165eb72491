"""The most probable densities and effects, given contents that are linear in both.

Contents are P n + E u + noise. The logarithms x of the densities n = exp(x) have a normal prior
with a full precision matrix; the effects u have independent normal priors of mean zero. The effects
are eliminated from the normal equations, and x is found by Gauss-Newton steps, damped after
Levenberg and Marquardt. The covariance is the inverse of the curvature at the maximum of the
posterior density (Laplace).

References
----------
Marquardt (1963), J. Soc. Indust. Appl. Math. 11, 431.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from vtff_dynamics.vectors import FloatArray

__all__ = ["NormalEquations", "ProfileSolution", "solve_profile"]

# Largest number of steps; they end when the next step would gain less than this, in twice the
# logarithm of the posterior density.
_ITERATIONS = 60
_CONVERGED = 1e-2
# Damping as a fraction of the diagonal of the curvature: first value and limits.
_DAMPING_START, _DAMPING_LEAST, _DAMPING_MOST = 1e-3, 1e-9, 1e6
# Largest change of the logarithm of a density in one step.
_LARGEST_STEP = 3.0


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of densities and effects, linear in both.

    Parameters
    ----------
    density, effects, mixed : ndarray, shapes (n, n), (m, m), (m, n)
        P' W P, E' W E and E' W P.
    density_vector, effects_vector : ndarray, shapes (n,), (m,)
        P' W y and E' W y.
    """

    density: FloatArray
    effects: FloatArray
    mixed: FloatArray
    density_vector: FloatArray
    effects_vector: FloatArray


@dataclass(frozen=True, eq=False)
class ProfileSolution:
    """The most probable densities and effects, and their errors.

    Parameters
    ----------
    log_density : ndarray, shape (n,)
        Logarithms of densities.
    effects : ndarray, shape (m,)
    effects_per_log_density : ndarray, shape (m, n)
        Decrease of the effects where the logarithm of a density increases by one.
    effect_factor, curvature_factor : ndarray, shapes (m, m) and (n, n)
        Cholesky factors of the precision of effects for known densities, and of logarithms; upper
        triangles, below which there may be anything.
    """

    log_density: FloatArray
    effects: FloatArray
    effects_per_log_density: FloatArray
    effect_factor: FloatArray
    curvature_factor: FloatArray

    @functools.cached_property
    def effect_variance(self) -> FloatArray:
        """Variances of the effects, shape (m,)."""
        derivative = self.effects_per_log_density
        # The inverse has its upper triangle only.
        inverse, _ = lapack.dpotri(self.effect_factor)
        solved = _solve(self.curvature_factor, derivative.T).T
        return np.asarray(np.diag(inverse) + np.einsum("ij,ij->i", derivative, solved))

    def variance(self, per_log_density: FloatArray, per_effect: FloatArray) -> FloatArray:
        """Return the variances of r linear functions of logarithms (r, n) and effects (r, m)."""
        by_density = per_log_density - per_effect @ self.effects_per_log_density
        variance = np.zeros(len(per_effect))
        for rows, factor in (
            (by_density, self.curvature_factor),
            (per_effect, self.effect_factor),
        ):
            variance += np.einsum("ij,ji->i", rows, _solve(factor, rows.T))
        return variance


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
        One over the prior variances of the effects; zero for an effect without prior.
    log_density : ndarray, shape (n,)
        Logarithms of densities that the search begins with.
    """
    factor = _factorise(normal.effects + np.diag(effect_precision))
    # Effects are `effects_without_density` minus `effects_per_density` times the densities.
    effects_per_density = _solve(factor, normal.mixed)
    effects_without_density = _solve(factor, normal.effects_vector)
    matrix = normal.density - normal.mixed.T @ effects_per_density
    vector = normal.density_vector - normal.mixed.T @ effects_without_density
    log_density, curvature = _find_maximum(
        matrix, vector, prior_precision, prior_vector, log_density
    )
    density = np.exp(log_density)
    effects = effects_without_density - effects_per_density @ density
    return ProfileSolution(log_density, effects, effects_per_density * density, factor, curvature)


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
    for _ in range(_ITERATIONS):
        density = np.exp(log_density)
        data_slope = density * (vector - matrix @ density)
        slope = data_slope + prior_vector - prior_precision @ log_density
        curvature = density[:, np.newaxis] * matrix * density + prior_precision
        factor = _factorise(curvature)
        if float(slope @ _solve(factor, slope)) < _CONVERGED:
            break
        while damping < _DAMPING_MOST:
            # Where the data ask for less density, the curvature of the exponential counts too:
            # without it the steps overshoot back and forth.
            diagonal = damping * np.diag(curvature) + np.maximum(-data_slope, 0.0)
            damped = curvature + np.diag(diagonal)
            step = _solve(_factorise(damped), slope)
            trial = log_density + np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
            trial_cost = compute_cost(trial)
            if trial_cost < cost:
                log_density, cost = trial, trial_cost
                damping = max(0.1 * damping, _DAMPING_LEAST)
                break
            damping *= 10.0
        else:
            break
    return log_density, factor


def _factorise(matrix: FloatArray) -> FloatArray:
    """Return the Cholesky factor of a positive definite matrix, an upper triangle.

    LAPACK is called here and in `_solve`, because `scipy.linalg` takes as long to look at arguments
    of this size as LAPACK takes to compute.
    """
    factor: FloatArray
    factor, failed = lapack.dpotrf(matrix, clean=False)
    if failed:
        raise np.linalg.LinAlgError("a precision matrix is not positive definite")
    return factor


def _solve(factor: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solution of equations for right sides (n,) or (n, k); see `_factorise`."""
    solution: FloatArray = lapack.dpotrs(factor, right)[0]
    return solution
