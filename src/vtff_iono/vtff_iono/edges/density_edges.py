"""Edges of irregularities in the density between two spacecraft, along one climb or descent.

Around each altitude the densities are fitted with a straight line and a wall, for walls of several
widths; the separation of the spacecraft smears each of them. A wall is told if its change is

- many times its sigma, which contains errors that are correlated from second to second while the
  same satellites are used, and errors that all seconds share until more is known of them: of these
  the difference between two seconds is what the estimator has learned between them,
- a part of the density beside it, and
- no part of a smooth rise: against a straight line the wall stands out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray
from vtff_iono.edges.edge_detectors import Edge

__all__ = ["DensityEdgeDetector", "compile_kernels", "fit_wall", "smeared_step"]

# Smallest length over which a wall is smeared, m.
_NARROWEST = 100.0
# Rows of the table of a profile at first, and its columns.
_FIRST_ROWS, _COLUMNS = 256, 5
# Largest number of means that a fit uses.
_MEANS = 24
# Fewest means on either side of a wall.
_FEWEST_SAMPLES = 3
# s; densities on both sides of a longer gap are not compared.
_LONGEST_GAP = 10.0
# The change of a wall is at least this part of what the straight line changes over the window.
_SHAPE = 0.3
# Where the straight line goes against the wall, the whole window changes in the sense of the wall:
# the foot of a wider wall beside it is no wall.
_SHAPE_AGAINST = 1.0
# A wall is told when densities reach over this many times the half window of its fit.
_CONFIRMED = 1.5


def smeared_step(distance: FloatArray, width: float, length: float, power: int = 1) -> FloatArray:
    """Return the integral (power 1), or a higher one, of a wall that is averaged over a length.

    Parameters
    ----------
    distance : ndarray
        From the middle of the wall, m.
    width : float
        Width over which the wall rises linearly from 0 to 1, m.
    length : float
        Length over which it is averaged besides, m.
    power : int
        0: the wall itself; 1: its integral over distance.
    """

    def ramp(argument: FloatArray, order: int) -> FloatArray:
        return np.asarray(np.maximum(argument, 0.0) ** order / math.factorial(order))

    first, second = max(width, 1e-3), max(length, 1e-3)
    total = sum(
        sign * ramp(distance + shift, 2 + power)
        for sign, shift in (
            (1.0, 0.5 * (first + second)),
            (-1.0, 0.5 * (first - second)),
            (-1.0, 0.5 * (second - first)),
            (1.0, -0.5 * (first + second)),
        )
    )
    return np.asarray(total / (first * second))


class _Profile:
    """Densities along one climb or descent, the newest last; the oldest are forgotten.

    The tables are kept, because to build them anew each second would cost as much as all fits.
    """

    def __init__(self) -> None:
        self._rows = np.empty((_FIRST_ROWS, _COLUMNS))
        self._slow = np.zeros((_FIRST_ROWS, 0))
        self._column: dict[int, int] = {}
        self._begin = self._end = 0

    def __len__(self) -> int:
        """Return the number of samples."""
        return self._end - self._begin

    @property
    def samples(self) -> FloatArray:
        """Time (s), altitude (m), density and sigmas of its fast and its common error (1/m3)."""
        return self._rows[self._begin : self._end]

    @property
    def slow_parts(self) -> FloatArray:
        """Density by one sigma of the slow error of each satellite, 1/m3, shape (n, satellites)."""
        return self._slow[self._begin : self._end]

    def add(
        self, sample: tuple[float, float, float, float, float], slow: Mapping[int, float]
    ) -> None:
        """Add a sample and its slow parts by number of the satellite."""
        if self._end == len(self._rows):
            self._make_room()
        new = [number for number in slow if number not in self._column]
        if new:
            self._column.update({number: len(self._column) + k for k, number in enumerate(new)})
            self._slow = np.hstack((self._slow, np.zeros((len(self._slow), len(new)))))
        self._rows[self._end] = sample
        parts = self._slow[self._end]
        parts[:] = 0.0
        for number, part in slow.items():
            parts[self._column[number]] = part
        self._end += 1

    def forget_beyond(self, distance: float) -> None:
        """Forget the samples whose altitudes differ from the last one by more than this, m."""
        altitude = self.samples[:, 1]
        while abs(altitude[-1] - self._rows[self._begin, 1]) > distance:
            self._begin += 1

    def _make_room(self) -> None:
        """Move the samples to the beginning of tables that are twice as long as they are."""
        count = len(self)
        rows = np.empty((2 * max(count, _FIRST_ROWS), _COLUMNS))
        slow = np.zeros((len(rows), self._slow.shape[1]))
        rows[:count], slow[:count] = self.samples, self.slow_parts
        self._rows, self._slow, self._begin, self._end = rows, slow, 0, count


@dataclass(frozen=True)
class _Candidate:
    """A wall at an altitude, in a descent negative, with its significance and half window, m."""

    significance: float
    advance: float
    reach: float
    edge: Edge

    def contains(self, other: _Candidate) -> bool:
        """Return whether another wall is in the window of either."""
        return abs(self.advance - other.advance) <= max(self.reach, other.reach)


class DensityEdgeDetector:
    """Finds edges in densities along a climb or a descent.

    Parameters
    ----------
    margin : float
        Length of the profile beside a wall that is fitted with it, m.
    wide_margin : float
        The same once more for walls that are thinner than it: where densities are unsure, more of
        them are needed to tell a wall from a slope.
    relative_change : float
        Smallest change of an edge as a fraction of the larger density beside it.
    sigmas : float
        Smallest change of an edge as a multiple of the sigma of the change.
    widths : tuple of float
        Widths of walls that are tried, m.
    """

    def __init__(
        self,
        margin: float = 3e3,
        wide_margin: float = 8e3,
        relative_change: float = 0.15,
        sigmas: float = 6.0,
        widths: tuple[float, ...] = (0.0, 2e3, 5e3, 10e3, 20e3),
    ) -> None:
        self._relative_change = relative_change
        self._sigmas = sigmas
        # Widths of walls with the margins beside them.
        self._windows = [(width, margin) for width in widths]
        self._windows += [(width, wide_margin) for width in widths if width < wide_margin]
        self._profile = _Profile()
        self._direction = 0.0  # 1 in a climb, -1 in a descent
        self._candidates: list[_Candidate] = []
        self._told: list[_Candidate] = []
        self._examined_to = dict.fromkeys(self._windows, -math.inf)

    def update(
        self,
        time: float,
        altitude: float,
        separation: float,
        density: float,
        fast_sigma: float,
        slow_parts: Mapping[int, float] | None = None,
        slow_time: float = 100.0,
        common_sigma: float = 0.0,
    ) -> list[Edge]:
        """Add a sample and return the edges that it confirms.

        Parameters
        ----------
        time : float
            s, increasing.
        altitude, separation : float
            Altitude of the middle of the two spacecraft, and difference of their altitudes, m.
        density : float
            Electrons per cubic metre; a sample with NaN is left out.
        fast_sigma : float
            Sigma of errors that are independent from sample to sample, electrons per cubic metre.
        slow_parts : mapping of int to float, optional
            By number of a satellite how much one sigma of its slow error moves the density,
            electrons per cubic metre.
        slow_time : float
            Correlation time of the slow errors, s.
        common_sigma : float
            Sigma of the error that is left of what is estimated over all seconds, electrons per
            cubic metre.
        """
        if not math.isfinite(altitude + separation + density + fast_sigma):
            return []
        edges: list[Edge] = []
        if len(self._profile):
            last_time, last_altitude = self._profile.samples[-1, :2].tolist()
            direction = math.copysign(1.0, altitude - last_altitude)
            # After a gap the constant between the receivers may be another one, a step of density.
            if direction != self._direction or time - last_time > _LONGEST_GAP:
                edges += self.flush()
                self._direction = direction
        self._profile.add((time, altitude, density, fast_sigma, common_sigma), slow_parts or {})
        length = max(abs(separation), _NARROWEST)
        self._profile.forget_beyond(2.5 * max(_reach(*window, length) for window in self._windows))
        # Increasing, because a turn begins a new profile.
        advance = self._direction * self._profile.samples[:, 1]
        first, last = float(advance[0]), float(advance[-1])
        for window in self._windows:
            reach = _reach(*window, length)
            begin = int(advance.searchsorted(self._examined_to[window], "right"))
            end = int(advance.searchsorted(last - reach, "right"))
            for middle in advance[begin:end].tolist():
                if middle - reach >= first:
                    self._fit(advance, middle, window, length, slow_time)
            if end > begin:
                self._examined_to[window] = float(advance[end - 1])
        return edges + self._confirmed(last)

    def flush(self) -> list[Edge]:
        """Return the edges that wait for confirmation, and start anew."""
        edges = self._confirmed(math.inf)
        self._profile = _Profile()
        self._direction = 0.0
        self._candidates, self._told = [], []
        self._examined_to = dict.fromkeys(self._windows, -math.inf)
        return edges

    def _confirmed(self, advance: float) -> list[Edge]:
        """Return the walls that stand out in their surroundings, once these are known."""
        edges = []
        for candidate in sorted(self._candidates, key=lambda c: -c.significance):
            if candidate not in self._candidates:
                continue
            if any(candidate.contains(told) for told in self._told):
                self._candidates.remove(candidate)
            elif candidate.advance + _CONFIRMED * candidate.reach <= advance:
                self._told.append(candidate)
                edges.append(candidate.edge)
            else:
                # Nothing beside a stronger wall is told before it.
                self._candidates = [
                    c for c in self._candidates if c is candidate or not candidate.contains(c)
                ]
        self._told = self._told[-4:]
        return sorted(edges, key=lambda edge: edge.time)

    def _fit(
        self,
        advance: FloatArray,
        middle: float,
        window: tuple[float, float],
        length: float,
        slow_time: float,
    ) -> None:
        """Fit a line and a wall in the middle of a window (width, margin); keep it if it is one."""
        width, _ = window
        reach = _reach(*window, length)
        samples = self._profile.samples
        first = int(advance.searchsorted(middle - reach))
        end = int(advance.searchsorted(middle + reach, "right"))
        is_fitted, level, slope, change, sigma = fit_wall(
            samples[first:end],
            self._profile.slow_parts[first:end],
            self._direction,
            middle,
            reach,
            width,
            length,
            slow_time,
        )
        if not is_fitted:
            return
        before, after = level - 0.5 * change, level + 0.5 * change
        largest = max(before, after)
        shape = _SHAPE if slope * change >= 0.0 else _SHAPE_AGAINST
        if not (
            largest > 0.0
            and min(before, after) >= -self._sigmas * sigma
            and abs(change) >= self._sigmas * sigma
            and abs(change) >= self._relative_change * largest
            and abs(change) >= shape * 2.0 * abs(slope)
        ):
            return
        significance = abs(change) / sigma
        at = _crossing(advance, samples[:, 2], middle, 0.5 * (before + after), change)
        at = at if abs(at - middle) <= 0.5 * (width + length) else middle
        crossing = float(np.interp(at, advance, samples[:, 0]))
        climb, duration = np.abs(samples[end - 1] - samples[first])[[1, 0]].tolist()
        speed = climb / duration
        edge = Edge(
            time=crossing,
            time_sigma=max(width, length) / significance / speed,
            is_entry=change < 0.0,
            altitude=self._direction * at,
            before=before,
            after=after,
            confidence=math.erf(significance / self._sigmas / math.sqrt(2.0)),
            width=width,
        )
        self._candidates.append(_Candidate(significance, middle, reach, edge))


@compiled
def fit_wall(samples, slow, direction, middle, reach, width, length, slow_time):  # type: ignore[no-untyped-def]
    """Fit a line and a wall to densities by generalised least squares.

    Parameters
    ----------
    samples : ndarray, shape (n, 5)
        Time, s, altitude, m, density and sigmas of its fast and of its common error, 1/m3.
    slow : ndarray, shape (n, m)
        What one sigma of each slow error adds to the densities, 1/m3.
    direction : float
        1 in a climb, -1 in a descent.
    middle, reach : float
        Altitude of the wall times the direction, and the distance by which the slope is counted, m.
    width, length : float
        Width of the wall and length over which it is smeared, m.
    slow_time : float
        Correlation time of the slow errors, s.

    Returns
    -------
    is_fitted : bool
        Whether there are enough samples on both sides.
    level, slope, change, sigma : float
        Density in the middle, its change by the line over `reach`, that by the wall along the
        motion and its sigma, which contains what is no line and no wall, 1/m3.
    """
    count = len(samples)
    nothing = (False, 0.0, 0.0, 0.0, 0.0)
    if count < 2 * _FEWEST_SAMPLES:
        return nothing
    # Means of at most _MEANS groups of samples.
    most = min(count, _MEANS)
    number = np.zeros(most)
    means = np.zeros((most, 5))  # time, distance, density, variances
    parts = np.zeros((most, slow.shape[1]))
    group, last = -1, -1
    for row in range(count):
        now = min(row * _MEANS // count, _MEANS - 1)
        if now != last:
            group += 1
            last = now
        number[group] += 1.0
        means[group, 0] += samples[row, 0] - samples[0, 0]
        means[group, 1] += direction * samples[row, 1] - middle
        means[group, 2] += samples[row, 2]
        means[group, 3] += samples[row, 3] ** 2
        means[group, 4] += samples[row, 4] ** 2
        for column in range(slow.shape[1]):
            parts[group, column] += slow[row, column]
    groups = group + 1
    before, behind = 0, 0
    half_length = 0.5 * (width + length)
    rounded, smeared = max(width, 1e-3), max(length, 1e-3)
    table = np.empty((groups, 4))  # columns of the design, and the density
    for row in range(groups):
        for column in range(5):
            means[row, column] /= number[row]
        for column in range(slow.shape[1]):
            parts[row, column] /= number[row]
        distance = means[row, 1]
        before += distance < -half_length
        behind += distance > half_length
        # `smeared_step` of power 0.
        wall = (
            max(distance + 0.5 * (rounded + smeared), 0.0) ** 2
            - max(distance - 0.5 * (rounded - smeared), 0.0) ** 2
            - max(distance - 0.5 * (smeared - rounded), 0.0) ** 2
            + max(distance - 0.5 * (rounded + smeared), 0.0) ** 2
        ) / (2.0 * rounded * smeared)
        table[row, 0] = 1.0
        table[row, 1] = distance / reach
        table[row, 2] = wall - 0.5
        table[row, 3] = means[row, 2]
    if min(before, behind) < _FEWEST_SAMPLES:
        return nothing
    # The Cholesky factor of the covariance makes the errors of the rows independent.
    factor = np.zeros((groups, groups))
    for row in range(groups):
        for other in range(row + 1):
            total = 0.0
            for column in range(slow.shape[1]):
                total += parts[row, column] * parts[other, column]
            total *= math.exp(-abs(means[row, 0] - means[other, 0]) / slow_time)
            # Errors of an estimate and of a better one differ by what was learned between them.
            total += min(means[row, 4], means[other, 4])
            if row == other:
                total += means[row, 3] / number[row]
            for column in range(other):
                total -= factor[row, column] * factor[other, column]
            if row > other:
                factor[row, other] = total / factor[other, other]
            elif total > 0.0:
                factor[row, row] = math.sqrt(total)
            else:
                return nothing
        for column in range(4):
            total = table[row, column]
            for other in range(row):
                total -= factor[row, other] * table[other, column]
            table[row, column] = total / factor[row, row]
    normal = np.zeros((3, 4))
    for row in range(groups):
        for column in range(3):
            for other in range(4):
                normal[column, other] += table[row, column] * table[row, other]
    # The cofactors of the symmetric normal matrix, of which the last column gives the change.
    a, b, c = normal[0, 0], normal[0, 1], normal[0, 2]
    d, e, f = normal[1, 1], normal[1, 2], normal[2, 2]
    inverse = np.array(
        [
            [d * f - e * e, c * e - b * f, b * e - c * d],
            [c * e - b * f, a * f - c * c, b * c - a * e],
            [b * e - c * d, b * c - a * e, a * d - b * b],
        ]
    )
    determinant = a * inverse[0, 0] + b * inverse[1, 0] + c * inverse[2, 0]
    if not determinant > 0.0:
        return nothing
    solution = np.zeros(3)
    for row in range(3):
        for column in range(3):
            solution[row] += inverse[row, column] * normal[column, 3] / determinant
    misfit = 0.0
    for row in range(groups):
        residual = table[row, 3]
        for column in range(3):
            residual -= table[row, column] * solution[column]
        misfit += residual * residual
    # What is no line and no wall of this width is an error too.
    variance = inverse[2, 2] / determinant * max(1.0, misfit / max(1, groups - 3))
    return True, solution[0], solution[1], solution[2], math.sqrt(variance)


def compile_kernels() -> None:
    """Compile `fit_wall`, which takes seconds without a cache and would delay the first wall."""
    fit_wall(np.zeros((0, _COLUMNS)), np.zeros((0, 0)), 1.0, 0.0, 1.0, 0.0, 1.0, 1.0)


def _reach(width: float, margin: float, length: float) -> float:
    """Return the half window of a wall with a margin beside it, m."""
    return 0.55 * (width + length) + margin


def _crossing(
    advance: FloatArray, density: FloatArray, middle: float, level: float, change: float
) -> float:
    """Return where densities cross a level in the sense of a change, nearest to an altitude, m."""
    excess = (density - level) * math.copysign(1.0, change)
    rising = np.flatnonzero((excess[:-1] < 0.0) & (excess[1:] >= 0.0))
    if len(rising) == 0:
        return middle
    below, above = excess[rising], excess[rising + 1]
    places = advance[rising] + below / (below - above) * (advance[rising + 1] - advance[rising])
    return float(places[np.argmin(np.abs(places - middle))])
