"""Least-squares position, velocity and clock of one epoch, as a receiver computes them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.vectors import FloatArray

__all__ = ["PointSolution", "RangeEquations", "ionosphere_free_factors", "solve_points"]


@dataclass(frozen=True, eq=False)
class RangeEquations:
    """Equations of q kinds of measurements of one epoch, linear about a point; n satellites.

    Parameters
    ----------
    direction : ndarray, shape (n, 3)
        Unit vectors from the point to the satellites, Earth-fixed.
    excess : ndarray, shape (q, n)
        Measured less computed range (or range rate), m (m/s): clock and errors.
    sigma : ndarray, shape (q, n)
        Sigmas of the measurements, m (m/s).
    system : ndarray of int, shape (n,)
        Each system has its own clock offset in the equations.
    systems : ndarray of int, shape (any,)
        The systems, in order.
    """

    direction: FloatArray
    excess: FloatArray
    sigma: FloatArray
    system: npt.NDArray[np.int64]
    systems: npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class PointSolution:
    """Solution: correction to the point (3,), its sigmas (3,), clock and its sigma, in s (s/s)."""

    correction: FloatArray
    sigma: FloatArray
    clock: float
    clock_sigma: float


def ionosphere_free_factors(frequency_first: float, frequency_second: float) -> tuple[float, float]:
    """Return the factors of two pseudoranges in their ionosphere-free combination."""
    ratio = (frequency_first / frequency_second) ** 2
    return ratio / (ratio - 1.0), -1.0 / (ratio - 1.0)


def solve_points(equations: RangeEquations) -> list[PointSolution] | None:
    """Return the q weighted least-squares solutions, None if there are too few satellites.

    The point must be so near (some metres to kilometres: a second-order error of d^2 / 2e7 m) that
    one step suffices. The sigmas are those of the measurements, or greater by the misfit of the
    solution where that is worse than they say.
    """
    systems = equations.systems
    unknowns = 3 + len(systems)
    count = len(equations.system)
    if count < unknowns:
        return None
    weighted, target = _weight_equations(
        equations.direction, equations.excess, equations.sigma, equations.system, systems
    )
    transposed = weighted.transpose(0, 2, 1)
    try:
        covariance = np.linalg.inv(transposed @ weighted)
    except np.linalg.LinAlgError:
        return None
    solution = covariance @ (transposed @ target)
    misfit = (target - weighted @ solution)[:, :, 0]
    redundancy = count - unknowns
    solutions = []
    for k, row in enumerate(misfit):
        factor = math.sqrt(max(1.0, float(row @ row) / redundancy)) if redundancy else 1.0
        sigma = factor * np.sqrt(covariance[k].diagonal())
        found = PointSolution(
            correction=solution[k, :3, 0],
            sigma=sigma[:3],
            clock=float(solution[k, 3, 0]) / SPEED_OF_LIGHT,
            clock_sigma=float(sigma[3]) / SPEED_OF_LIGHT,
        )
        solutions.append(found)
    return solutions


@compiled
def _weight_equations(direction, excess, sigma, system, systems):  # type: ignore[no-untyped-def]
    """Return design (q, n, unknowns) and measurements (q, n, 1) of equations over their sigmas.

    The unknowns are a position and the clocks of the `systems`.
    """
    kinds, count = excess.shape
    weighted = np.zeros((kinds, count, 3 + len(systems)))
    target = np.empty((kinds, count, 1))
    for q in range(kinds):
        for n in range(count):
            target[q, n, 0] = excess[q, n] / sigma[q, n]
            for i in range(3):
                weighted[q, n, i] = -direction[n, i] / sigma[q, n]
            for i in range(len(systems)):
                if systems[i] == system[n]:
                    weighted[q, n, 3 + i] = 1.0 / sigma[q, n]
    return weighted, target
