"""Search for the evasive manoeuvre: the cheapest burn after which every pair is clear.

A manoeuvre is one burn of constant acceleration in RTN axes. Its candidates are the change of
velocity that stops the drift from the other spacecraft, wholly or not at all, with and without a
change in one of 26 directions, from a fraction of the mean motion times the radius (which turns the
relative eccentricity or inclination vector) to what the thruster can do in the time. They are tried
from the cheapest on; cost is the size of the change and one and a half times the drift that stays,
so that among burns of one size the one that leaves the spacecraft in the formation is taken.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from vtff_control.safety.prediction import (
    FreeMotion,
    hermite_position,
    move_to_nearest,
    sigmas_outside,
)
from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray

__all__ = ["ClearBounds", "find_escape"]

_DIRECTIONS = np.array(
    [direction for direction in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(direction)]
)
_LEVELS = 14
_DRIFT_COST = 1.5


@dataclass(frozen=True)
class ClearBounds:
    """When a pair is clear.

    Attributes
    ----------
    hard_radius
        m.
    clear_radius
        Smallest expected distance, m.
    clear_sigmas
        Sigma between the pair and the hard radius.
    """

    hard_radius: float
    clear_radius: float
    clear_sigmas: float


def find_escape(
    motion: FreeMotion,
    deputy: int,
    bounds: ClearBounds,
    acceleration: FloatArray,
    velocity_limit: float,
    start: float,
    horizon: float,
) -> FloatArray | None:
    """Return the cheapest burn of a deputy after which it is clear of all others for a time.

    Parameters
    ----------
    motion
        Free motion from now.
    deputy
        Index of the deputy in ``motion.names``.
    bounds
        What is clear.
    acceleration
        Largest acceleration on R, T and N, m/s2; 0 where there is no thrust.
    velocity_limit
        Largest change of the velocity on an axis, m/s.
    start
        When the burn starts, s from now.
    horizon
        How long all pairs must be clear, s from now.

    Returns
    -------
    ndarray, shape (3,), or None
        Change of the velocity in RTN, m/s; None if no candidate is clear.
    """
    others = [index for index in range(len(motion.names)) if index != deputy]
    if not others:
        return np.zeros(3)
    start_index = min(int(np.searchsorted(motion.times, start)), len(motion.times) - 1)
    to_rtn = motion.rotation[start_index]
    drift, mean_motion = _drift(motion, deputy, others, start_index)
    scale = mean_motion * bounds.clear_radius
    candidates = _candidates(drift, scale, acceleration, velocity_limit)
    count = min(int(np.searchsorted(motion.times, horizon, side="right")), len(motion.times))
    soon = slice(count)
    relative = np.stack(
        [motion.relative[deputy][soon] - motion.relative[other][soon] for other in others]
    )
    covariances = np.stack([motion.pair_covariance(deputy, other, soon) for other in others])
    chosen = _first_clear(
        motion.times[soon],
        relative,
        covariances,
        motion.transition[soon],
        candidates @ to_rtn,
        _durations(candidates, acceleration),
        float(start),
        bounds.hard_radius,
        bounds.clear_radius,
        bounds.clear_sigmas,
    )
    return None if chosen < 0 else candidates[chosen]


def _durations(candidates: FloatArray, acceleration: FloatArray) -> FloatArray:
    """Return how long each change takes, s, shape (n,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        durations = np.where(candidates == 0.0, 0.0, np.abs(candidates) / acceleration)
    return np.asarray(durations.max(axis=1))


def _drift(
    motion: FreeMotion, deputy: int, others: list[int], start_index: int
) -> tuple[FloatArray, float]:
    """Return how a deputy moves relative to the nearest of the others, and the mean motion.

    The first is a velocity in RTN axes that turn, m/s, whose T component contains that of the
    distance along R, shape (4,): R, T and N, and T with that; the second is in rad/s.
    """
    to_rtn = motion.rotation[start_index]
    # Rotation of the axes, from two moments.
    following = min(start_index + 1, len(motion.times) - 1)
    seconds = max(float(motion.times[following] - motion.times[start_index]), 1.0)
    mean_motion = float(np.linalg.norm(motion.rotation[following][0] - to_rtn[0])) / seconds
    nearest = min(
        others,
        key=lambda other: float(
            np.linalg.norm((motion.relative[deputy] - motion.relative[other])[start_index, :3])
        ),
    )
    difference = (motion.relative[deputy] - motion.relative[nearest])[start_index]
    position, velocity = to_rtn @ difference[:3], to_rtn @ difference[3:]
    velocity = velocity - np.array([-mean_motion * position[1], mean_motion * position[0], 0.0])
    return np.array([*velocity, velocity[1] + 2.0 * mean_motion * position[0]]), mean_motion


def _candidates(
    drift: FloatArray, scale: float, acceleration: FloatArray, velocity_limit: float
) -> FloatArray:
    """Return changes of velocity in RTN, m/s, each once, the cheapest first, shape (n, 3).

    Parameters
    ----------
    drift
        As returned by `_drift`, m/s, shape (4,).
    scale
        Mean motion times the clear radius, m/s.
    acceleration, velocity_limit
        As for `find_escape`.
    """
    available = acceleration > 0.0
    levels = np.geomspace(0.05 * scale, max(velocity_limit, 0.1 * scale), _LEVELS)
    steps = np.concatenate([np.zeros((1, 3)), *(level * _DIRECTIONS for level in levels)])
    candidates = np.where(available, np.concatenate((steps, steps - drift[:3])), 0.0)
    candidates = candidates[np.abs(candidates).max(axis=1) <= velocity_limit]
    candidates = np.unique(candidates, axis=0)
    cost = np.linalg.norm(candidates, axis=1) + _DRIFT_COST * np.abs(drift[3] + candidates[:, 1])
    return np.asarray(candidates[np.argsort(cost, kind="stable")])


@compiled
def _inverse_column(transition: FloatArray, velocity: FloatArray, result: FloatArray) -> None:
    """Write Phi^-1 [0; v]: the transition is symplectic, its inverse is its blocks turned."""
    for k in range(3):
        result[k], result[k + 3] = 0.0, 0.0
        for j in range(3):
            result[k] -= transition[j, k + 3] * velocity[j]
            result[k + 3] += transition[j, k] * velocity[j]


@compiled
def _first_clear(
    times: FloatArray,
    relative: FloatArray,
    covariances: FloatArray,
    transition: FloatArray,
    candidates: FloatArray,
    durations: FloatArray,
    start: float,
    hard_radius: float,
    clear_radius: float,
    clear_sigmas: float,
) -> int:
    """Return the index of the first candidate that is clear over all times, or -1."""
    pieces = 3
    middle = np.empty((6, 6))
    source, state, previous = np.empty(6), np.empty(6), np.empty(6)
    position, later = np.empty(3), np.empty(3)
    for candidate in range(len(candidates)):
        velocity = candidates[candidate]
        duration = durations[candidate]
        centre = start + 0.5 * duration
        if centre > times[-1]:
            continue
        index = 0
        while index + 2 < len(times) and times[index + 1] <= centre:
            index += 1
        share = (centre - times[index]) / (times[index + 1] - times[index])
        for i in range(6):
            for j in range(6):
                middle[i, j] = (1.0 - share) * transition[index, i, j] + share * transition[
                    index + 1, i, j
                ]
        _inverse_column(middle, velocity, source)
        is_clear = True
        for pair in range(len(relative)):
            for moment in range(len(times)):
                time = times[moment]
                elapsed = time - start
                if elapsed <= 0.0:
                    for k in range(6):
                        state[k] = relative[pair, moment, k]
                elif elapsed < duration:
                    for k in range(3):
                        rate = velocity[k] / duration
                        state[k] = relative[pair, moment, k] + 0.5 * rate * elapsed * elapsed
                        state[k + 3] = relative[pair, moment, k + 3] + rate * elapsed
                else:
                    for k in range(6):
                        value = relative[pair, moment, k]
                        for j in range(6):
                            value += transition[moment, k, j] * source[j]
                        state[k] = value
                if moment > 0:
                    step = time - times[moment - 1]
                    reach, distance = 0.0, 0.0
                    for k in range(3):
                        reach += (state[k] - previous[k]) ** 2
                        distance += state[k] ** 2
                    if math.sqrt(distance) - 1.5 * math.sqrt(reach) < 3.0 * clear_radius:
                        for piece in range(pieces):
                            hermite_position(previous, state, step, piece / pieces, position)
                            hermite_position(previous, state, step, (piece + 1) / pieces, later)
                            move_to_nearest(position, later)
                            if not _is_clear(
                                position,
                                covariances[pair, moment],
                                hard_radius,
                                clear_radius,
                                clear_sigmas,
                            ):
                                is_clear = False
                                break
                    elif (
                        sigmas_outside(state[:3], covariances[pair, moment], hard_radius)
                        < clear_sigmas
                    ):
                        is_clear = False
                elif not _is_clear(
                    state[:3], covariances[pair, 0], hard_radius, clear_radius, clear_sigmas
                ):
                    is_clear = False
                if not is_clear:
                    break
                for k in range(6):
                    previous[k] = state[k]
            if not is_clear:
                break
        if is_clear:
            return candidate
    return -1


@compiled
def _is_clear(
    position: FloatArray,
    covariance: FloatArray,
    hard_radius: float,
    clear_radius: float,
    clear_sigmas: float,
) -> bool:
    """Return whether a position is clear."""
    distance = (position[0] ** 2 + position[1] ** 2 + position[2] ** 2) ** 0.5
    if distance < clear_radius:
        return False
    return bool(sigmas_outside(position, covariance, hard_radius) >= clear_sigmas)
