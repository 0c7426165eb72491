"""Least-squares position, velocity and clock of one epoch, as a receiver computes them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.vectors import FloatArray

__all__ = ["PointSolution", "RangeEquations", "ionosphere_free", "solve_point"]


@dataclass(frozen=True, eq=False)
class RangeEquations:
    """Equations of one epoch, linear about a point; n satellites.

    Parameters
    ----------
    direction : ndarray, shape (n, 3)
        Unit vectors from the point to the satellites, Earth-fixed.
    excess : ndarray, shape (n,)
        Measured less computed range (or range rate), m (m/s): clock and errors.
    sigma : ndarray, shape (n,)
        Sigmas of the measurements, m (m/s).
    system : ndarray of int, shape (n,)
        Each system has its own clock offset in the equations.
    """

    direction: FloatArray
    excess: FloatArray
    sigma: FloatArray
    system: npt.NDArray[np.integer]


@dataclass(frozen=True, eq=False)
class PointSolution:
    """Solution: correction to the point (3,), its sigmas (3,), clock and its sigma, in s (s/s)."""

    correction: FloatArray
    sigma: FloatArray
    clock: float
    clock_sigma: float


def ionosphere_free(
    first: FloatArray, second: FloatArray, frequency_first: float, frequency_second: float
) -> tuple[FloatArray, float, float]:
    """Return the ionosphere-free combination of two pseudoranges, and its two factors."""
    ratio = (frequency_first / frequency_second) ** 2
    factor_first, factor_second = ratio / (ratio - 1.0), -1.0 / (ratio - 1.0)
    return factor_first * first + factor_second * second, factor_first, factor_second


def solve_point(equations: RangeEquations) -> PointSolution | None:
    """Return the weighted least-squares solution, None if there are too few satellites.

    The point must be so near (some metres to kilometres: a second-order error of d^2 / 2e7 m) that
    one step suffices. The sigmas are those of the measurements, or greater by the misfit of the
    solution where that is worse than they say.
    """
    systems = np.flatnonzero(np.bincount(equations.system))
    unknowns = 3 + len(systems)
    count = len(equations.excess)
    if count < unknowns:
        return None
    design = np.zeros((count, unknowns))
    design[:, :3] = -equations.direction
    design[:, 3:] = equations.system[:, None] == systems
    weighted = design / equations.sigma[:, None]
    target = equations.excess / equations.sigma
    normal = weighted.T @ weighted
    try:
        covariance = np.linalg.inv(normal)
    except np.linalg.LinAlgError:
        return None
    solution = covariance @ (weighted.T @ target)
    misfit = target - weighted @ solution
    redundancy = count - unknowns
    factor = math.sqrt(max(1.0, float(misfit @ misfit) / redundancy)) if redundancy else 1.0
    sigma = factor * np.sqrt(np.diag(covariance))
    return PointSolution(
        correction=solution[:3],
        sigma=sigma[:3],
        clock=float(solution[3]) / SPEED_OF_LIGHT,
        clock_sigma=float(sigma[3]) / SPEED_OF_LIGHT,
    )
