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
import numpy.typing as npt

from vtff_control.safety.prediction import FreeMotion, hermite_position, sigmas_outside
from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray

__all__ = ["ClearBounds", "Escape", "find_escape"]

_DIRECTIONS = np.array(
    [direction for direction in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(direction)]
)
_LEVELS = 14
# Manoeuvres of each kind: no step, or one of every level in every direction.
_STEPS = 1 + _LEVELS * len(_DIRECTIONS)
_KINDS = 2
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


@dataclass(frozen=True, eq=False)
class Escape:
    """An evasive manoeuvre.

    Attributes
    ----------
    velocity_rtn
        Change of the velocity, m/s, shape (3,).
    clear_until
        Until when all pairs are clear, s; infinite if over the whole prediction.
    number
        Number of the candidate, by which another search finds it.
    """

    velocity_rtn: FloatArray
    clear_until: float
    number: int


def find_escape(
    motion: FreeMotion,
    deputy: int,
    bounds: ClearBounds,
    acceleration: FloatArray,
    velocity_limit: float,
    start: float,
    horizon: float,
    likely: int | None = None,
) -> Escape | None:
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
    likely
        Number of a candidate that is tried before all others, such as that of a step ago: where it
        is clear it is returned though it may not be the cheapest, for a tenth of the work.

    Returns
    -------
    Escape or None
        None if no candidate is clear.
    """
    others = [index for index in range(len(motion.names)) if index != deputy]
    if not others:
        return Escape(np.zeros(3), np.inf, 0)
    start_index = min(int(np.searchsorted(motion.times, start)), len(motion.times) - 1)
    to_rtn = motion.rotation[start_index]
    drift, mean_motion = _drift(motion, deputy, others, start_index)
    levels = _levels(mean_motion, bounds, velocity_limit)
    count = min(int(np.searchsorted(motion.times, horizon, side="right")), len(motion.times))
    soon = slice(count)
    relative = np.stack(
        [motion.relative[deputy][soon] - motion.relative[other][soon] for other in others]
    )
    covariances = np.stack([motion.pair_covariance(deputy, other, soon) for other in others])

    def first_clear(numbers: npt.NDArray[np.intp], velocities: FloatArray) -> Escape | None:
        """Return the first candidate that is clear, of those with these numbers in this order."""
        chosen, clear_until = _first_clear(
            motion.times[soon],
            relative,
            covariances,
            motion.transition[soon],
            velocities @ to_rtn,
            _durations(velocities, acceleration),
            float(start),
            bounds.hard_radius,
            bounds.clear_radius,
            bounds.clear_sigmas,
        )
        if chosen < 0:
            return None
        return Escape(velocities[chosen], float(clear_until), int(numbers[chosen]))

    if likely is not None:
        number = np.array([likely])
        velocity = _candidates(number, drift, levels, acceleration)
        if np.abs(velocity).max() <= velocity_limit:
            escape = first_clear(number, velocity)
            if escape is not None:
                return escape
    candidates = _candidates(np.arange(_KINDS * _STEPS), drift, levels, acceleration)
    cheapest = _by_cost(candidates, drift, velocity_limit)
    return first_clear(cheapest, candidates[cheapest])


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


def _levels(mean_motion: float, bounds: ClearBounds, velocity_limit: float) -> FloatArray:
    """Return the sizes of the steps of velocity on an axis, m/s, shape (1 + levels,).

    The first is none.
    """
    smallest = mean_motion * bounds.clear_radius
    levels = np.geomspace(0.05 * smallest, max(velocity_limit, 0.1 * smallest), _LEVELS)
    return np.concatenate((np.zeros(1), levels))


def _candidates(
    numbers: npt.NDArray[np.intp], drift: FloatArray, levels: FloatArray, acceleration: FloatArray
) -> FloatArray:
    """Return changes of velocity in RTN, m/s, shape (n, 3); some are larger than allowed.

    A number means the same kind of manoeuvre in every search: a step on top of nothing, or of the
    change that stops the drift.
    """
    available = acceleration > 0.0
    kind, step = np.divmod(numbers, _STEPS)
    level, direction = np.divmod(step - 1, len(_DIRECTIONS))
    share = np.where(available, 1.0, 0.0)
    steps = levels[level + 1, np.newaxis] * share * _DIRECTIONS[direction]
    bases = np.stack((np.zeros(3), np.where(available, -drift[:3], 0.0)))
    return np.where(available, bases[kind] + steps, 0.0)


def _by_cost(
    candidates: FloatArray, drift: FloatArray, velocity_limit: float
) -> npt.NDArray[np.intp]:
    """Return the numbers of the candidates that are allowed, each once, the cheapest first."""
    allowed = np.flatnonzero(np.abs(candidates).max(axis=1) <= velocity_limit)
    different, first = np.unique(candidates[allowed], axis=0, return_index=True)
    cost = np.linalg.norm(different, axis=1) + _DRIFT_COST * np.abs(drift[3] + different[:, 1])
    return np.asarray(allowed[first[np.argsort(cost, kind="stable")]])


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
) -> tuple[int, float]:
    """Return the index of the first candidate that is clear over all times, or -1."""
    pieces = 3
    middle = np.empty((6, 6))
    source, state, previous = np.empty(6), np.empty(6), np.empty(6)
    position = np.empty(3)
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
                        for piece in range(1, pieces + 1):
                            hermite_position(previous, state, step, piece / pieces, position)
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
            return candidate, times[-1]
    return -1, 0.0


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
