"""Free relative ellipses that sample walls at several altitudes, safe whatever happens along-track.

A deputy on an ellipse with relative eccentricity and inclination vectors in parallel is R = -size
cos(u - phase) above the chief and N = width sin(u - phase) beside it, u being the argument of
latitude: where they are level they are apart across the track (D'Amico 2010, section 2.2). The
phase puts the largest difference of altitude where walls are expected; the size decides how far
about that place it is large enough.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vtff_control.survey.goals import SurveyGoal
from vtff_control.survey.prediction import PredictedCrossing
from vtff_dynamics.relative.impulses import (
    InfeasibleChangeError,
    least_impulses,
    least_velocity_change,
)
from vtff_dynamics.relative.separation import safety_figures
from vtff_dynamics.relative.transition import j2_transition_matrix
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "EllipseLimits",
    "RelativeEllipse",
    "Transfer",
    "cheapest_transfer",
    "choose_ellipse",
    "information",
    "is_safe",
]

_PHASES = 72
_SIZES = 16
_ALONG_TRACK_SHARES = (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0)
"""Mean distances along the track that a transfer may end at, as shares of the usual one."""


@dataclass(frozen=True)
class EllipseLimits:
    """Limits of relative ellipses.

    Parameters
    ----------
    largest_size
        Radial amplitude of the farthest deputy, m.
    separation
        Least distance of any pair in the radial-normal plane, m.
    along_track
        Mean distance of each deputy behind the spacecraft before it, m.
    deputies
        Number of deputies.
    """

    largest_size: float = 6000.0
    separation: float = 200.0
    along_track: float = 2000.0
    deputies: int = 1


@dataclass(frozen=True)
class RelativeEllipse:
    """Ellipses of all deputies: that of deputy k of n has k / n of the size and width.

    Attributes
    ----------
    size, width
        Radial and cross-track amplitude of the farthest deputy, m.
    phase
        Argument of latitude at which the deputies are lowest, rad.
    along_track
        Mean distance of each deputy behind the spacecraft before it, m.
    """

    size: float
    width: float
    phase: float
    along_track: float

    def designs(self, deputies: int) -> list[FloatArray]:
        """Return the mean relative elements of all deputies, m, each of shape (6,)."""
        cosine, sine = math.cos(self.phase), math.sin(self.phase)
        return [
            np.array(
                [
                    0.0,
                    -number * self.along_track,
                    number / deputies * self.size * cosine,
                    number / deputies * self.size * sine,
                    number / deputies * self.width * cosine,
                    number / deputies * self.width * sine,
                ]
            )
            for number in range(1, deputies + 1)
        ]


def is_safe(designs: Sequence[FloatArray], separation: float) -> bool:
    """Return whether every pair keeps a distance in the radial-normal plane without thrust.

    Parameters
    ----------
    designs
        Mean relative elements of all deputies, m, each of shape (6,).
    separation
        m.
    """
    craft = [np.zeros(6), *designs]
    return all(
        safety_figures(second, first).separation_radial_normal >= separation
        for index, first in enumerate(craft)
        for second in craft[index + 1 :]
    )


def information(
    crossings: Sequence[PredictedCrossing],
    goal: SurveyGoal,
    design: FloatArray,
    probability: float = 1.0,
) -> float:
    """Return the number of wall crossings that a design is expected to sample as asked.

    Parameters
    ----------
    crossings
        Crossings of the chief to come.
    goal
        What to sample.
    design
        Mean relative elements of the farthest deputy, m, shape (6,).
    probability
        That the crossings are where they are expected.
    """
    return probability * float(_samples(crossings, goal, np.asarray(design)[np.newaxis, 2:4])[0])


def _samples(
    crossings: Sequence[PredictedCrossing], goal: SurveyGoal, eccentricity: FloatArray
) -> FloatArray:
    """Return how many crossings each relative eccentricity vector (k, 2) samples as asked, (k,)."""
    latitude = np.array([crossing.mean_latitude for crossing in crossings])
    radial = -(eccentricity[:, :1] * np.cos(latitude) + eccentricity[:, 1:] * np.sin(latitude))
    asked = goal.altitude_difference
    if goal.kind == "profile":
        # Every fifth of the altitude difference that a crossing adds counts once.
        level = np.floor(5.0 * np.clip(radial / asked, -1.0, 1.0)).astype(int)
        return np.array([len(set(row)) for row in level.tolist()], dtype=float)
    # A tenth of the difference is kept for what the orbit does until then.
    sampled = (np.abs(radial) >= 1.1 * asked).astype(float)
    # The larger margin decides between equal numbers, without counting as a sample.
    margin = 0.01 * np.minimum(np.abs(radial) / asked, 2.0)
    if goal.kind == "both_walls":
        sampled = _neighbours(crossings, sampled)
    total: FloatArray = (sampled + margin).sum(axis=1)
    return total


def _neighbours(crossings: Sequence[PredictedCrossing], sampled: FloatArray) -> FloatArray:
    """Return for each crossing whether the other wall of its bubble is sampled too, (k, n)."""
    both = np.zeros(sampled.shape)
    for index, (first, second) in enumerate(itertools.pairwise(crossings)):
        if first.is_entry and not second.is_entry:
            pair = sampled[:, index] * sampled[:, index + 1]
            both[:, index] = both[:, index + 1] = pair
    return both


def choose_ellipse(
    crossings: Sequence[PredictedCrossing],
    goal: SurveyGoal,
    current: FloatArray,
    limits: EllipseLimits,
    mean_motion: float,
    worth: float,
    probability: float = 1.0,
    budget: float = math.inf,
) -> RelativeEllipse | None:
    """Return the ellipse whose samples are worth most beyond its velocity change.

    Parameters
    ----------
    crossings
        Crossings of the chief after the ellipse could be reached.
    goal
        What to sample.
    current
        Mean relative elements of the farthest deputy now, m, shape (6,).
    limits
        Limits of ellipses.
    mean_motion
        rad/s.
    worth
        Velocity change that one crossing more is worth, m/s.
    probability
        That the crossings are where they are expected.
    budget
        Largest velocity change, m/s.

    Returns
    -------
    RelativeEllipse or None
        None if the budget reaches no ellipse.
    """
    current = np.asarray(current, dtype=float)
    phases = 2.0 * math.pi * np.arange(_PHASES) / _PHASES
    smallest = min(goal.altitude_difference, limits.largest_size)
    sizes = np.linspace(smallest, limits.largest_size, _SIZES)
    grid = np.array([[size, phase] for size in sizes for phase in phases])
    vectors = grid[:, :1] * np.stack((np.cos(grid[:, 1]), np.sin(grid[:, 1])), axis=1)
    gains = probability * _samples(crossings, goal, vectors)
    best: tuple[float, RelativeEllipse] | None = None
    width = 1.05 * limits.separation * limits.deputies
    for (size, phase), gain in zip(grid.tolist(), gains.tolist(), strict=True):
        ellipse = RelativeEllipse(size, width, phase, limits.along_track)
        change = sum(least_velocity_change(ellipse.designs(1)[0] - current, mean_motion))
        value = gain - change / worth
        if change > budget:
            continue
        if best is None or value > best[0]:
            best = value, ellipse
    return None if best is None else best[1]


@dataclass(frozen=True)
class Transfer:
    """A change to another ellipse.

    Attributes
    ----------
    ellipse
        Where it leads.
    orbits
        Its duration, orbits.
    velocity_change
        Velocity change of the farthest deputy by impulses, m/s, sum of all axes.
    """

    ellipse: RelativeEllipse
    orbits: float
    velocity_change: float


def cheapest_transfer(
    ellipse: RelativeEllipse,
    current: FloatArray,
    chief_mean: FloatArray,
    mean_motion: float,
    orbits: float,
    deputies: int = 1,
) -> Transfer | None:
    """Return the transfer to an ellipse in a given time, its mean place along the track left free.

    None where impulses do not reach it in that time.

    Parameters
    ----------
    ellipse
        Where it leads, but for the distance along the track.
    current
        Mean relative elements of the farthest deputy now, m, shape (6,).
    chief_mean
        Mean elements of the chief now, m and rad, shape (6,).
    mean_motion
        rad/s.
    orbits
        Duration, orbits.
    deputies
        Number of deputies.
    """
    latitude = float(chief_mean[1])
    turn = 2.0 * math.pi * orbits
    free = j2_transition_matrix(chief_mean, turn / mean_motion) @ current
    best: Transfer | None = None
    for share in _ALONG_TRACK_SHARES:
        moved = dataclasses.replace(ellipse, along_track=share * ellipse.along_track)
        wanted = moved.designs(deputies)[-1] - free
        try:
            impulses = least_impulses(wanted, mean_motion, latitude, latitude + turn, samples=41)
        except InfeasibleChangeError:
            continue
        change = float(sum(np.abs(impulse.velocity_rtn).sum() for impulse in impulses))
        if best is None or change < best.velocity_change:
            best = Transfer(moved, orbits, change)
    return best
