"""Edges of irregularities in the density between two spacecraft, along one climb or descent.

Around each altitude the densities are fitted with a straight line and a wall, for walls of several
widths; the separation of the spacecraft smears each of them. A wall is told if its change is

- many times its sigma, which contains errors that are correlated from second to second while the
  same satellites are used,
- a part of the density beside it, and
- no part of a smooth rise: against a straight line the wall stands out.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vtff_dynamics.vectors import FloatArray
from vtff_iono.edges.edge_detectors import Edge

__all__ = ["DensityEdgeDetector", "smeared_step"]

# Smallest length over which a wall is smeared, m.
_NARROWEST = 100.0
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


class _Sample(NamedTuple):
    """A density at the middle of the two spacecraft, and the sigma of its fast error."""

    time: float
    altitude: float
    density: float
    fast_sigma: float


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
        self._samples: deque[_Sample] = deque()
        self._slow_parts: deque[Mapping[int, float]] = deque()
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
        """
        if not math.isfinite(altitude + separation + density + fast_sigma):
            return []
        edges: list[Edge] = []
        if self._samples:
            direction = math.copysign(1.0, altitude - self._samples[-1].altitude)
            # After a gap the constant between the receivers may be another one, a step of density.
            is_late = time - self._samples[-1].time > _LONGEST_GAP
            if direction != self._direction or is_late:
                edges += self.flush()
                self._direction = direction
        self._samples.append(_Sample(time, altitude, density, fast_sigma))
        self._slow_parts.append(slow_parts or {})
        length = max(abs(separation), _NARROWEST)
        longest = max(_reach(*window, length) for window in self._windows)
        while abs(altitude - self._samples[0].altitude) > 2.5 * longest:
            self._samples.popleft()
            self._slow_parts.popleft()
        samples, slow = np.array(self._samples), self._slow_table()
        advance = self._direction * samples[:, 1]
        for window in self._windows:
            reach = _reach(*window, length)
            is_new = (advance > self._examined_to[window]) & (advance + reach <= advance[-1])
            for middle in advance[is_new & (advance - reach >= advance[0])].tolist():
                self._fit(samples, slow, advance, middle, window, length, slow_time)
            if is_new.any():
                self._examined_to[window] = float(advance[is_new][-1])
        return edges + self._confirmed(float(advance[-1]))

    def flush(self) -> list[Edge]:
        """Return the edges that wait for confirmation, and start anew."""
        edges = self._confirmed(math.inf)
        self._samples.clear()
        self._slow_parts.clear()
        self._direction = 0.0
        self._candidates, self._told = [], []
        self._examined_to = dict.fromkeys(self._windows, -math.inf)
        return edges

    def _slow_table(self) -> FloatArray:
        """Return the slow parts of all samples, a column for each satellite."""
        numbers = sorted({number for parts in self._slow_parts for number in parts})
        column = {number: index for index, number in enumerate(numbers)}
        table = np.zeros((len(self._slow_parts), len(numbers)))
        for row, parts in zip(table, self._slow_parts, strict=True):
            for number, part in parts.items():
                row[column[number]] = part
        return table

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
        samples: FloatArray,
        slow: FloatArray,
        advance: FloatArray,
        middle: float,
        window: tuple[float, float],
        length: float,
        slow_time: float,
    ) -> None:
        """Fit a line and a wall in the middle of a window (width, margin); keep it if it is one."""
        width, _ = window
        reach = _reach(*window, length)
        near = np.flatnonzero(np.abs(advance - middle) <= reach)
        if len(near) < 2 * _FEWEST_SAMPLES:
            return
        groups = np.minimum(np.arange(len(near)) * _MEANS // len(near), _MEANS - 1)
        groups = np.unique(groups, return_inverse=True)[1]
        count = np.bincount(groups)
        time, density, fast = (
            np.bincount(groups, column) / count
            for column in (samples[near, 0], samples[near, 2], samples[near, 3] ** 2)
        )
        begins = np.flatnonzero(np.diff(groups, prepend=-1))
        parts = np.add.reduceat(slow[near], begins, axis=0) / count[:, np.newaxis]
        distance = np.bincount(groups, advance[near] - middle) / count
        covariance = np.diag(fast / count)
        covariance += (parts @ parts.T) * np.exp(-np.abs(np.subtract.outer(time, time)) / slow_time)
        half_length = 0.5 * (width + length)
        sides = (
            np.count_nonzero(distance < -half_length),
            np.count_nonzero(distance > half_length),
        )
        if min(sides) < _FEWEST_SAMPLES:
            return
        wall = smeared_step(distance, width, length, 0) - 0.5
        design = np.stack((np.ones(len(time)), distance / reach, wall), axis=-1)
        weighted = np.linalg.solve(covariance, design)
        normal = np.linalg.inv(design.T @ weighted)
        level, slope, change = (normal @ (weighted.T @ density)).tolist()
        # What is no line and no wall of this width is an error too.
        residual = density - design @ (level, slope, change)
        misfit = float(residual @ np.linalg.solve(covariance, residual))
        freedom = max(1, len(time) - len(normal))
        sigma = math.sqrt(float(normal[2, 2]) * max(1.0, misfit / freedom))
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
        speed = abs(samples[near[-1], 1] - samples[near[0], 1]) / (
            samples[near[-1], 0] - samples[near[0], 0]
        )
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
