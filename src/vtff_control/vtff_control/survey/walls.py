"""Walls of drifting plasma: which crossings are of the same wall, where it is, how fast it drifts.

All walls of a night drift with nearly one zonal speed. For every speed that may be, the crossings
of each pass are given to the walls of the passes before by a least-cost assignment; the histories
that differ are compared by their likelihood. In the likeliest one positions and speeds are
estimated by least squares with their covariance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from vtff_dynamics.angles import wrap_angle
from vtff_dynamics.vectors import FloatArray

__all__ = ["LocatedCrossing", "Wall", "WallEstimate", "WallSettings", "estimate_walls"]

_IMPOSSIBLE = 1e9


@dataclass(frozen=True)
class LocatedCrossing:
    """A supported crossing of a wall and where the spacecraft was.

    Attributes
    ----------
    time
        s.
    spacecraft
        Name.
    is_entry
        Whether the irregularity begins there, seen along the flight.
    longitude, latitude
        rad.
    altitude
        m above the ellipsoid.
    sigma
        Sigma of the place along the equator, m.
    """

    time: float
    spacecraft: str
    is_entry: bool
    longitude: float
    latitude: float
    altitude: float
    sigma: float


@dataclass(frozen=True)
class WallSettings:
    """What is assumed of walls.

    Parameters
    ----------
    drift_mean, drift_sigma
        Zonal speed eastward over the Earth before any crossing has told it, m/s: night-time drifts
        of equatorial bubbles are 0 to 150 m/s.
    drift_spread
        Sigma of the speed of one wall about that of all, m/s.
    pass_gap
        Time without crossings that ends a pass, s.
    same_wall
        Distance within which two spacecraft cross the same wall in one pass, m.
    detection
        Probability that a wall there is told in a pass.
    new_wall_spacing
        Mean distance of walls of which nothing is known, m.
    shape_sigma
        Sigma by which a wall differs from a meridian plane that drifts evenly, m.
    radius
        Distance from the Earth's centre at which drift is counted, m.
    """

    drift_mean: float = 75.0
    drift_sigma: float = 45.0
    drift_spread: float = 5.0
    pass_gap: float = 420.0
    same_wall: float = 60e3
    detection: float = 0.9
    new_wall_spacing: float = 1.5e6
    shape_sigma: float = 2e3
    radius: float = 6.75e6


@dataclass(eq=False)
class Wall:
    """A wall and what is estimated of it.

    Attributes
    ----------
    crossings
        Crossings of it, in order of time.
    is_entry
        Whether the irregularity begins there, seen along the flight.
    longitude, drift
        Longitude (rad) at the reference time and speed eastward (m/s).
    covariance
        Covariance of the place along the equator (m) and the speed (m/s) at the reference time,
        shape (2, 2).
    time
        Reference time, s.
    radius
        Distance from the Earth's centre at which drift is counted, m.
    passes
        Number of passes in which it was crossed.
    """

    crossings: list[LocatedCrossing]
    is_entry: bool
    longitude: float = 0.0
    drift: float = 0.0
    covariance: FloatArray = field(default_factory=lambda: np.zeros((2, 2)))
    time: float = 0.0
    radius: float = 1.0
    passes: int = 0

    def longitude_at(self, time: float) -> float:
        """Return the longitude at a time (s), rad."""
        return self.longitude + self.drift * (time - self.time) / self.radius

    def sigma_at(self, time: float) -> float:
        """Return the sigma of the place along the equator at a time (s), m."""
        row = np.array([1.0, time - self.time])
        return math.sqrt(float(row @ self.covariance @ row))

    @property
    def spacecraft(self) -> set[str]:
        """Names of the spacecraft that have crossed it."""
        return {crossing.spacecraft for crossing in self.crossings}


@dataclass(eq=False)
class WallEstimate:
    """All walls.

    Attributes
    ----------
    walls
        In order of longitude at their first crossing.
    drift, drift_sigma
        Speed of all walls eastward, m/s.
    probability
        Probability of this history of crossings among the others that are possible.
    passes
        Number of passes so far.
    """

    walls: list[Wall]
    drift: float
    drift_sigma: float
    probability: float
    passes: int


def estimate_walls(
    crossings: Sequence[LocatedCrossing], settings: WallSettings | None = None
) -> WallEstimate:
    """Return the walls that crossings show.

    Parameters
    ----------
    crossings
        Supported crossings of the night, any order.
    settings
        What is assumed of walls.
    """
    given = settings or WallSettings()
    passes = _passes(sorted(crossings, key=lambda c: c.time), given)
    if not passes:
        return WallEstimate([], given.drift_mean, given.drift_sigma, 1.0, 0)
    low, high = (given.drift_mean + s * 3.5 * given.drift_sigma for s in (-1.0, 1.0))
    histories: dict[tuple[tuple[int, ...], ...], tuple[float, list[list[_Group]]]] = {}
    for drift in np.arange(low, high + 1.0, 2.0):
        tracks, key, score = _history(passes, float(drift), given)
        if key not in histories or score > histories[key][0]:
            histories[key] = (score, tracks)
    scores = np.array([score for score, _ in histories.values()])
    best = int(scores.argmax())
    probability = float(1.0 / np.exp(scores - scores[best]).sum())
    tracks = list(histories.values())[best][1]
    return _least_squares(tracks, len(passes), probability, given)


@dataclass(frozen=True, eq=False)
class _Group:
    """Crossings of one wall in one pass: mean time (s), place (rad) and its sigma (m)."""

    number: int
    time: float
    longitude: float
    sigma: float
    is_entry: bool
    crossings: list[LocatedCrossing]


def _passes(crossings: list[LocatedCrossing], given: WallSettings) -> list[list[_Group]]:
    """Return the groups of crossings of the same wall, pass by pass."""
    passes: list[list[list[LocatedCrossing]]] = []
    last = -math.inf
    for crossing in crossings:
        if crossing.time - last > given.pass_gap:
            passes.append([])
        last = crossing.time
        for group in passes[-1]:
            near = abs(_east(crossing.longitude, group[0].longitude, given)) <= given.same_wall
            others = crossing.spacecraft not in {c.spacecraft for c in group}
            if near and others and crossing.is_entry == group[0].is_entry:
                group.append(crossing)
                break
        else:
            passes[-1].append([crossing])
    numbers = iter(range(len(crossings)))
    return [[_group(next(numbers), group) for group in groups] for groups in passes]


def _group(number: int, crossings: list[LocatedCrossing]) -> _Group:
    weights = np.array([crossing.sigma**-2 for crossing in crossings])
    share = weights / weights.sum()
    first = crossings[0]
    offsets = [wrap_angle(crossing.longitude - first.longitude) for crossing in crossings]
    return _Group(
        number,
        float(share @ [crossing.time for crossing in crossings]),
        first.longitude + float(share @ offsets),
        float(weights.sum() ** -0.5),
        first.is_entry,
        crossings,
    )


def _history(
    passes: list[list[_Group]], drift: float, given: WallSettings
) -> tuple[list[list[_Group]], tuple[tuple[int, ...], ...], float]:
    """Return the groups of each wall if all drift with a speed, a key of it, and log-likelihood."""
    score = -0.5 * ((drift - given.drift_mean) / given.drift_sigma) ** 2
    # A wall that is not told again and a new wall that was not there before.
    birth = -math.log(given.new_wall_spacing)
    missed = math.log(1.0 - given.detection)
    tracks: list[list[_Group]] = []
    for groups in passes:
        costs = np.full((len(tracks), len(groups)), _IMPOSSIBLE)
        for row, track in enumerate(tracks):
            last = track[-1]
            for column, group in enumerate(groups):
                if group.is_entry != last.is_entry:
                    continue
                elapsed = group.time - last.time
                error = _east(group.longitude, last.longitude, given) - drift * elapsed
                variance = group.sigma**2 + last.sigma**2 + 2.0 * given.shape_sigma**2
                variance += (given.drift_spread * elapsed) ** 2
                likelihood = -0.5 * error**2 / variance - 0.5 * math.log(2.0 * math.pi * variance)
                gain = likelihood + math.log(given.detection) - birth - missed
                if gain > 0.0:
                    costs[row, column] = -gain
        rows, columns = linear_sum_assignment(costs) if costs.size else ([], [])
        score += missed * len(tracks) + birth * len(groups)
        taken = set()
        for row, column in zip(rows, columns, strict=True):
            if costs[row, column] < 0.0:
                score -= float(costs[row, column])
                tracks[row].append(groups[column])
                taken.add(int(column))
        tracks += [[group] for column, group in enumerate(groups) if column not in taken]
    key = tuple(tuple(group.number for group in track) for track in tracks)
    return tracks, key, score


def _least_squares(
    tracks: list[list[_Group]], passes: int, probability: float, given: WallSettings
) -> WallEstimate:
    """Return places and speeds of walls by least squares: two unknowns each, and the common one."""
    count = len(tracks)
    time = max(track[-1].time for track in tracks)
    normal = np.zeros((2 * count + 1, 2 * count + 1))
    right = np.zeros(2 * count + 1)

    def add(columns: list[int], values: list[float], measured: float, sigma: float) -> None:
        row = np.zeros(2 * count + 1)
        row[columns] = values
        normal[:] += np.outer(row, row) / sigma**2
        right[:] += row * measured / sigma**2

    add([2 * count], [1.0], given.drift_mean, given.drift_sigma)
    for index, track in enumerate(tracks):
        add([2 * index + 1, 2 * count], [1.0, -1.0], 0.0, given.drift_spread)
        for group in track:
            east = _east(group.longitude, track[0].longitude, given)
            sigma = math.hypot(group.sigma, given.shape_sigma)
            add([2 * index, 2 * index + 1], [1.0, group.time - time], east, sigma)
    covariance = np.linalg.inv(normal)
    solution = covariance @ right
    walls = []
    for index, track in enumerate(tracks):
        columns = slice(2 * index, 2 * index + 2)
        own: FloatArray = np.array(covariance[columns, columns], dtype=float)
        walls.append(
            Wall(
                [crossing for group in track for crossing in group.crossings],
                track[0].is_entry,
                track[0].longitude + float(solution[2 * index]) / given.radius,
                float(solution[2 * index + 1]),
                own,
                time,
                given.radius,
                len(track),
            )
        )
    return WallEstimate(
        walls,
        float(solution[-1]),
        math.sqrt(float(covariance[-1, -1])),
        probability,
        passes,
    )


def _east(longitude: float, origin: float, given: WallSettings) -> float:
    """Return how far east a longitude is of another, m."""
    return given.radius * wrap_angle(longitude - origin)
