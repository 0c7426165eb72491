"""Limits of a reconfiguration, its plan, and why there is none."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from vtff_dynamics.vectors import FloatArray

__all__ = [
    "OBJECTIVES",
    "InfeasibleReconfigurationError",
    "ReconfigurationLimits",
    "ReconfigurationPlan",
]

OBJECTIVES = ("norms", "axes", "energy")
"""What is least: the sum of the norms of the thrust, the sum over its axes, or of its squares."""


class InfeasibleReconfigurationError(ValueError):
    """A reconfiguration is not possible within its limits.

    Attributes
    ----------
    constraint
        Name of the limit that cannot be met: ``acceleration_cap`` or ``closest_approach``.
    limit, reachable
        The limit, and the nearest value to it that would do (m/s2) or that can be had (m).
    """

    def __init__(self, text: str, constraint: str, limit: float, reachable: float) -> None:
        super().__init__(text)
        self.constraint = constraint
        self.limit = limit
        self.reachable = reachable


@dataclass(frozen=True)
class ReconfigurationLimits:
    """Limits and objective of a reconfiguration.

    Parameters
    ----------
    acceleration_cap
        Largest thrust on each axis, m/s2.
    closest_approach
        Smallest distance of any two spacecraft at any time, m.
    axes
        Axes with thrust: some of R, T, N.
    objective
        One of `OBJECTIVES`.
    largest_passes
        Passes of the sequential convexification.
    largest_passes_safe
        Further passes for passive safety.
    converged_share
        Change of the total velocity change, as a share of it, below which passes end.
    """

    acceleration_cap: float
    closest_approach: float = 10.0
    axes: str = "RTN"
    objective: str = "norms"
    largest_passes: int = 8
    largest_passes_safe: int = 40
    converged_share: float = 2e-3

    def __post_init__(self) -> None:
        """Check the values."""
        if not (math.isfinite(self.acceleration_cap) and self.acceleration_cap > 0.0):
            raise ValueError(
                f"acceleration_cap: positive m/s2 expected, got {self.acceleration_cap:g}"
            )
        if not (math.isfinite(self.closest_approach) and self.closest_approach >= 0.0):
            raise ValueError(
                f"closest_approach: a distance in m expected, got {self.closest_approach:g}"
            )
        if not self.axes or set(self.axes) - set("RTN") or len(set(self.axes)) != len(self.axes):
            raise ValueError(f"axes: some of R, T and N expected, got {self.axes!r}")
        if self.objective not in OBJECTIVES:
            raise ValueError(
                f"objective: one of {', '.join(OBJECTIVES)} expected, got {self.objective!r}"
            )


@dataclass(frozen=True, eq=False)
class ReconfigurationPlan:
    """Thrust and path of every spacecraft.

    Attributes
    ----------
    step
        Length of a step, s.
    accelerations
        Thrust in RTN during each step, m/s2, shape (m, n, 3).
    states
        Relative states at the ends of the steps, m and m/s, shape (m, n + 1, 6).
    closest_approach
        Smallest distance of two spacecraft in the linear motion, also between steps, m.
    closest_drifts
        With passive safety: smallest distance in the free drift after a loss of all thrust at the
        start of each step and at the end, m, shape (n + 1,).
    closest_drifts_during
        The same for a loss at any time of each step, m, shape (n,). It may be less than the closest
        approach in single steps after `safe_step`.
    safe_step
        With passive safety: step from which on that distance is at least the closest approach;
        before it is at least that of the drift from the initial states.
    passes
        Convex problems that were solved.
    solve_time
        Wall time of the planning, s; nothing of the plan depends on it.
    """

    step: float
    accelerations: FloatArray
    states: FloatArray
    closest_approach: float
    closest_drifts: FloatArray | None
    closest_drifts_during: FloatArray | None
    safe_step: int | None
    passes: int
    solve_time: float = field(compare=False)

    @property
    def velocity_changes(self) -> FloatArray:
        """Sum of the norms of the thrust, of each spacecraft, m/s, shape (m,)."""
        changes: FloatArray = self.step * np.linalg.norm(self.accelerations, axis=2).sum(axis=1)
        return changes

    @property
    def velocity_changes_axes(self) -> FloatArray:
        """Sum of the absolute values on the axes, m/s, shape (m, 3)."""
        changes: FloatArray = self.step * np.abs(self.accelerations).sum(axis=1)
        return changes
