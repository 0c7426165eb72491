"""The program of paper 001's appendix as it is printed, faults and all, in km and s.

One thing is not as printed, because it would not run: `potential_field` is called with three
arguments and takes two; the third is left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.vectors import FloatArray

__all__ = ["FAULTS", "LiteralRun", "run_literal"]

FAULTS = (
    "potential_field is called with three arguments and takes two",
    "the grid has steps of 100 km for a field of some km, and the gradient is taken without the "
    "spacing: exp(-r/2) of 300 km is 1e-66",
    "both components of the target's velocity are set to its speed",
    "the first velocities point along (y, x) instead of (-y, x)",
    "the axes of the CW frame are the relative position and velocity, not orthogonal, and its "
    "transpose is taken for its inverse",
    "the mean motion is the chaser's speed over radius",
    "within the tolerance the arrival's impulse is given at once",
    "the orbits are stepped by Euler in 30 s; the loop ends after five steps (150 s)",
    "the satellites of table 1 are 200 to 500 km apart, one of them 102 km high",
    "text and code differ: 6 exp(-r/2) and 3 exp(-r/2); a peak at 0.2 km needs another r0 than 0.5",
)
"""Faults of the paper."""

_MU = 398600.0  # km3/s2
_TRANSFER = 60.0  # s
_TOLERANCE = 0.005  # km
_STEPS = 5
_SPACING = 100  # km


@dataclass(frozen=True, eq=False)
class LiteralRun:
    """Result of the program.

    Attributes
    ----------
    velocity_changes
        Sums for the two chasers, km/s.
    separations
        Lead to both chasers and between these at the end, km.
    """

    velocity_changes: tuple[float, float]
    separations: tuple[float, float, float]


def run_literal() -> LiteralRun:
    """Run the main script from the positions of table 1."""
    positions = np.array([[6678.0, 0.0], [6970.0, 20.0], [6480.0, 50.0]])
    velocities = np.array(
        [math.sqrt(_MU / _norm(p)) * np.array([p[1], p[0]]) / _norm(p) for p in positions]
    )
    sums = [0.0, 0.0]
    for _ in range(_STEPS):
        changed = velocities.copy()
        for chaser, other in ((1, 2), (2, 1)):
            wanted = _potential_field(
                positions[0] - positions[chaser], positions[other] - positions[chaser]
            )
            speed = math.sqrt(_MU / _norm(wanted + positions[chaser]))
            velocity = np.full(2, speed) - velocities[chaser]
            mean_motion = _norm(velocities[chaser]) / _norm(positions[chaser])
            frame = np.column_stack((wanted / _norm(wanted), velocity / _norm(velocity)))
            change = _delta_v(frame @ -wanted, frame @ -velocity, mean_motion)
            sums[chaser - 1] += _norm(change)
            changed[chaser] = velocities[chaser] + frame.T @ change
        # The inner loop runs from the same state for t = 1 to 30 s; the last one stays.
        time = 30.0
        fall = -_MU * positions / np.linalg.norm(positions, axis=1, keepdims=True) ** 3
        velocities = fall * time + changed
        positions = velocities * time + positions
    first, second, third = positions
    return LiteralRun(
        (sums[0], sums[1]), (_norm(second - first), _norm(third - first), _norm(third - second))
    )


def _norm(vector: FloatArray) -> float:
    return math.hypot(*vector.tolist())


def _potential_field(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the gradient at the chaser, of the grid without its spacing."""
    lowest = math.floor(min(*first, *second, 0.0))
    highest = math.ceil(max(*first, *second, 0.0))
    low = (int(lowest / _SPACING) - 1) * _SPACING
    high = (int(highest / _SPACING) + 1) * _SPACING
    axis = np.arange(low, high + 1, _SPACING, dtype=float)
    x, y = np.meshgrid(axis, axis)
    radius = 0.5
    avoidance = (4.0 - radius**2) * radius**6
    total = np.zeros(x.shape)
    for other in (first, second):
        squared = (x - other[0]) ** 2 + (y - other[1]) ** 2
        total += -avoidance / squared**3 + 3.0 * np.exp(-0.5 * np.sqrt(squared))
    along_y, along_x = np.gradient(total)
    origin = int(np.flatnonzero(axis == 0.0)[0])
    return np.array([along_x[origin, origin], along_y[origin, origin]])


def _delta_v(position: FloatArray, velocity: FloatArray, mean_motion: float) -> FloatArray:
    n = mean_motion
    angle = n * _TRANSFER
    s, c = math.sin(angle), math.cos(angle)
    rr = np.array([[4.0 - 3.0 * c, 0.0], [6.0 * (s - angle), 1.0]])
    rv = np.array([[s, 2.0 - 2.0 * c], [2.0 * c - 2.0, 4.0 * s - 3.0 * angle]]) / n
    vr = n * np.array([[3.0 * s, 0.0], [6.0 * c - 6.0, 0.0]])
    vv = np.array([[c, 2.0 * s], [-2.0 * s, 4.0 * c - 3.0]])
    change: FloatArray
    if _norm(position) < _TOLERANCE:
        change = -(vr - vv @ np.linalg.inv(rv) @ rr) @ position
    else:
        change = -np.linalg.inv(rv) @ rr @ position - velocity
    return change
