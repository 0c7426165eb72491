"""Edges of irregularities in the density between two spacecraft, along one climb or descent.

Around each altitude the densities are fitted with a straight line and a wall, for walls of several
widths; the separation of the spacecraft smears each of them. A wall is told if its change is

- many times its sigma, which contains errors that are correlated from second to second while the
  same satellites are used, and errors that all seconds share until more is known of them: of these
  the difference between two seconds is what the estimator has learned between them (with a little
  less it is doubtful, which something else must confirm),
- a part of the density beside it, and
- no part of a smooth rise: against a straight line the wall stands out, and neither a parabola fits
  nearly as well nor a layer, whose logarithm is a parabola and which is no steeper and no thinner
  than layers are.

In fades densities end near walls as a rule. Where they have ended, or go on again, a wall is told
by what was seen of it. The place of a wall is the mean over all places and widths that fit, each as
likely as it fits, with straight lines beside it and with densities that grow in proportion to
themselves, as below the peak of a layer. Its sigma is what they scatter by: that is much where half
of a wall was seen, where it lies in a gap, or where the densities beside it are unsure. No density
is negative, which limits what was not seen.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from vtff_dynamics.vectors import FloatArray
from vtff_iono.edges.edge_detectors import Edge
from vtff_iono.edges.wall_fit import (
    KINK,
    LAYER,
    PARABOLA,
    SAMPLE_COLUMNS,
    SMOOTH_WALL,
    WALL,
    fit_wall,
)
from vtff_iono.edges.wall_search import (
    FEWEST_AT_END,
    MEANS,
    STEEPEST,
    find_walls,
    fit_places,
)
from vtff_iono.edges.wall_width import WidthsByShape

__all__ = ["DensityEdgeDetector"]

# Smallest length over which a wall is smeared, m.
_NARROWEST = 100.0
# Rows of the table of a profile at first.
_FIRST_ROWS = 256
# Fewest means on either side of a wall while densities go on.
_FEWEST_SAMPLES = 3
# s; densities on both sides of a longer gap are not compared.
_LONGEST_GAP = 30.0
# Where a wall is, is found from this many means at most, among so many places and these widths, m.
_MEANS_OF_PLACE, _PLACES = 40, 51
_WIDTHS = (0.0, 0.7e3, 1.2e3, 2e3, 3e3, 4e3, 5e3, 6e3, 7e3, 8.5e3, 10e3, 12e3, 14e3, 17e3, 20e3)
# m^2; variances of widths between those that are tried.
_STEP_VARIANCES = np.gradient(_WIDTHS) ** 2 / 12.0
# Least weight of a shape beside that of a straight line.
_LEAST_WEIGHT = 1e-30
# Beside a wall the density is a straight line or grows in proportion to itself: see `fit_wall`.
_PASSES_OF_PLACE = (2, 3)
# The shapes of walls, as `vtff_iono.edges.wall_width.WALL_SHAPES` has them.
_SHAPES = (WALL, SMOOTH_WALL)
# m; beyond the wall that was found.
_BEYOND = 500.0
# Largest correlation of means that follow each other.
_LARGEST_CORRELATION = 0.8
# Where the straight line goes against the wall, a kink at none of these distances, in half lengths
# of the wall, fits nearly as well.
_KINKS = (-1.0, -0.5, 0.0, 0.5, 1.0)
# A parabola and a layer fit the window worse than the wall by this sum of squares over sigmas; how
# often the fit of a layer, which is not linear, is improved.
_STANDS_OUT, _PASSES_OF_LAYER = 16.0, 6
# A wall is told when densities reach over this many times the half window of its fit.
_CONFIRMED = 1.5


class _Profile:
    """Densities along one climb or descent, the newest last; the oldest are forgotten.

    The tables are kept, because to build them anew each second would cost as much as all fits.
    """

    def __init__(self) -> None:
        self._rows = np.empty((_FIRST_ROWS, SAMPLE_COLUMNS))
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
        rows = np.empty((2 * max(count, _FIRST_ROWS), SAMPLE_COLUMNS))
        slow = np.zeros((len(rows), self._slow.shape[1]))
        rows[:count], slow[:count] = self.samples, self.slow_parts
        self._rows, self._slow, self._begin, self._end = rows, slow, 0, count


@dataclass(frozen=True)
class _Candidate:
    """A wall at an altitude, in a descent negative, with its significance and half window, m."""

    significance: float
    advance: float
    width: float
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
        sigmas: float = 5.0,
        widths: tuple[float, ...] = (0.0, 2e3, 5e3, 10e3, 20e3),
    ) -> None:
        self._relative_change = relative_change
        self._sigmas = sigmas
        # Widths of walls with the margins beside them, shapes (k,).
        windows = [(width, margin) for width in widths]
        windows += [(width, wide_margin) for width in widths if width < wide_margin]
        self._widths, self._margins = np.array(windows, dtype=float).T.copy()
        self._profile = _Profile()
        # Whether densities had ended before this profile; at the very first nothing was lost.
        self._has_ended = False
        self._direction = 0.0  # 1 in a climb, -1 in a descent
        self._candidates: list[_Candidate] = []
        self._told: list[_Candidate] = []
        # Places up to which the windows were fitted, and the half windows, m.
        self._examined_to = np.full(len(windows), -math.inf)
        self._reaches = np.zeros(len(windows))
        self._fewest = _FEWEST_SAMPLES

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
            if direction != self._direction or time - last_time > _LONGEST_GAP:
                edges += self.flush()
            self._direction = direction
        self._profile.add((time, altitude, density, fast_sigma, common_sigma), slow_parts or {})
        self._length, self._slow_time = max(abs(separation), _NARROWEST), slow_time
        self._reaches = 0.55 * (self._widths + self._length) + self._margins
        self._profile.forget_beyond(2.5 * float(self._reaches.max()))
        last = self._direction * altitude
        self._examine(last)
        return edges + self._confirmed(last)

    def flush_after_gap(self, time: float) -> list[Edge]:
        """Return the edges of densities that have ended long before a time, s, if they have."""
        if not len(self._profile) or time - self._profile.samples[-1, 0] <= _LONGEST_GAP:
            return []
        return self.flush()

    def flush(self) -> list[Edge]:
        """Return the edges that wait for confirmation, and start anew."""
        if len(self._profile):
            # What is missing behind a wall does not come any more.
            self._fewest = FEWEST_AT_END
            self._examine(math.inf)
            self._fewest = _FEWEST_SAMPLES
            self._has_ended = True
        edges = self._confirmed(math.inf)
        self._profile = _Profile()
        self._candidates, self._told = [], []
        self._examined_to[:] = -math.inf
        return edges

    def _confirmed(self, advance: float) -> list[Edge]:
        """Return the walls that stand out in their surroundings, once these are known."""
        edges = []
        for candidate in sorted(self._candidates, key=lambda c: -c.significance):
            if candidate not in self._candidates:
                continue
            # Doubtful ones wait until no window of another shape can show the wall better, and hide
            # no wall that is sure.
            is_doubtful = candidate.edge.is_doubtful
            hiding = [told for told in self._told if is_doubtful or not told.edge.is_doubtful]
            reach = float(self._reaches.max()) if is_doubtful else candidate.reach
            if any(candidate.contains(told) for told in hiding):
                self._candidates.remove(candidate)
            elif candidate.advance + _CONFIRMED * reach <= advance:
                if is_doubtful:
                    self._candidates.remove(candidate)
                self._told.append(candidate)
                edges.append(self._located(candidate))
            else:
                # Nothing beside a stronger wall is told before it.
                self._candidates = [
                    c for c in self._candidates if c is candidate or not candidate.contains(c)
                ]
        self._told = self._told[-4:]
        return sorted(edges, key=lambda edge: edge.time)

    def _advance(self) -> FloatArray:
        """Return the altitudes of the profile, in a descent negative, m."""
        # Increasing, because a turn begins a new profile.
        return np.asarray(self._direction * self._profile.samples[:, 1])

    def _examine(self, last: float) -> None:
        """Fit walls of all windows in all places that are new; `last` as in `find_walls`."""
        walls = find_walls(
            self._profile.samples,
            self._profile.slow_parts,
            self._direction,
            self._length,
            self._slow_time,
            self._widths,
            self._reaches,
            self._examined_to,
            last,
            self._has_ended,
            self._fewest,
            self._sigmas,
            self._relative_change,
        )
        for window, fewest, *wall in walls.tolist():
            self._keep_if_wall(int(window), int(fewest), *wall)

    def _keep_if_wall(
        self,
        window: int,
        fewest: int,
        middle: float,
        level: float,
        slope: float,
        change: float,
        sigma: float,
        misfit: float,
        freedom: float,
        is_against: float,
    ) -> None:
        """Keep a wall that nothing smooth fits nearly as well; arguments as of `find_walls`."""
        width, reach = float(self._widths[window]), float(self._reaches[window])
        advance = self._advance()
        first, end = advance.searchsorted((middle - reach, middle + reach)).tolist()
        samples = self._profile.samples[first:end]
        slow = self._profile.slow_parts[first:end]
        # All are fitted as unsurely as the wall is.
        smooth = [(PARABOLA, 1, 0.0), (LAYER, _PASSES_OF_LAYER, 0.0)]
        if is_against:
            half_length = 0.5 * (width + self._length)
            smooth += [(KINK, 1, place * half_length) for place in _KINKS]
        for kind, passes, beside in smooth:
            instead = fit_wall(
                samples,
                slow,
                self._direction,
                middle + beside,
                reach,
                width,
                self._length,
                self._slow_time,
                STEEPEST,
                MEANS,
                0 if kind == KINK else fewest,
                passes,
                kind,
            )
            if instead[0] and instead[5] - misfit < _STANDS_OUT * max(1.0, misfit / freedom):
                return
        before, after = level - 0.5 * change, level + 0.5 * change
        significance = abs(change) / sigma
        climb, duration = np.abs(samples[-1] - samples[0])[[1, 0]].tolist()
        edge = Edge(
            time=float(np.interp(middle, advance, self._profile.samples[:, 0])),
            time_sigma=max(width, self._length) / significance * duration / climb,
            is_entry=change < 0.0,
            altitude=self._direction * middle,
            before=before,
            after=after,
            confidence=math.erf(significance / self._sigmas / math.sqrt(2.0)),
            width=width,
            is_doubtful=significance < self._sigmas,
        )
        self._candidates.append(_Candidate(significance, middle, width, reach, edge))

    def _located(self, candidate: _Candidate) -> Edge:
        """Return the edge of a candidate in its place: the mean over likely places and widths."""
        advance = self._advance()
        middle, reach = candidate.advance, candidate.reach
        first, end = advance.searchsorted((middle - reach, middle + reach)).tolist()
        samples, slow = self._profile.samples[first:end], self._profile.slow_parts[first:end]
        # In a gap a wall may be anywhere.
        gap = float(np.diff(advance[first:end]).max(initial=0.0))
        span = 0.5 * (candidate.width + self._length) + _BEYOND + gap
        # A wall whose one side was not seen may go on there.
        unseen = 0.5 * _WIDTHS[-1]
        low = middle - span - (unseen if advance[0] > middle - reach else 0.0)
        high = middle + span + (unseen if advance[-1] < middle + reach else 0.0)
        places = np.linspace(low, high, _PLACES)
        level, change, sigma, misfits, freedoms, correlations = fit_places(
            samples,
            slow,
            self._direction,
            places,
            reach,
            np.array(_WIDTHS),
            self._length,
            self._slow_time,
            _MEANS_OF_PLACE,
            np.array(_PASSES_OF_PLACE),
            np.array(_SHAPES),
        )
        # No density is negative, also where a wall was not seen to its end.
        is_possible = level - 0.5 * np.abs(change) >= -sigma
        misfits[~(is_possible & ((change < 0.0) == candidate.edge.is_entry))] = np.inf
        # The best one rises linearly.
        best = np.unravel_index(np.argmin(misfits[0]), misfits[0].shape)
        least, freedom = float(misfits[0][best]), float(freedoms[0][best])
        of_best = float(correlations[0][best])
        if not math.isfinite(least):
            return candidate.edge
        # What is no line and no wall is an error too. Where errors of fades go on from one mean to
        # the next, these are so many fewer means (Bartlett 1946).
        of_best = min(max(of_best, 0.0), _LARGEST_CORRELATION)
        fewer = (1.0 + of_best) / (1.0 - of_best)
        weight = np.exp(-0.5 * (misfits - least) / (max(1.0, least / freedom) * fewer))
        weight = weight.sum(axis=1) / weight[0].sum()
        widths_by_shape = _widths_by_shape(weight.sum(axis=2))
        # The place is that of a wall that rises linearly.
        weight = weight[0]
        of_place, of_width = weight.sum(axis=0), weight.sum(axis=1)
        place = float(of_place @ places)
        variance = float(of_place @ (places - place) ** 2)
        variance += ((places[1] - places[0]) ** 2 + _per_step(weight, places) ** 2) / 12.0
        widths = np.array(_WIDTHS)
        width = float(of_width @ widths)
        width_variance = float(of_width @ ((widths - width) ** 2 + _STEP_VARIANCES))
        climb, duration = np.abs(samples[-1] - samples[0])[[1, 0]].tolist()
        return replace(
            candidate.edge,
            time=float(np.interp(place, advance, self._profile.samples[:, 0])),
            time_sigma=math.sqrt(variance) * duration / climb,
            altitude=self._direction * place,
            altitude_sigma=math.sqrt(variance),
            width=width,
            width_sigma=math.sqrt(width_variance),
            widths=widths_by_shape,
        )


def _widths_by_shape(weight: FloatArray) -> WidthsByShape:
    """Return the widths by the shape of a wall, of weights (shapes, widths)."""
    of_shape = np.maximum(weight.sum(axis=1), _LEAST_WEIGHT)
    widths = np.array(_WIDTHS)
    mean = weight @ widths / of_shape
    variance = np.sum(weight * ((widths - mean[:, np.newaxis]) ** 2 + _STEP_VARIANCES), axis=1)
    sigma = np.sqrt(np.maximum(variance / of_shape, _STEP_VARIANCES[0]))
    # The likeliest width of a wide distribution has as much less of the same probability.
    return WidthsByShape(mean, sigma, -2.0 * np.log(of_shape / sigma))


def _per_step(weight: FloatArray, places: FloatArray) -> float:
    """Return by how much the place of a wall changes from one width to the next, m.

    It does where a wall was not seen to its end. `weight` (widths, places) are probabilities.
    """
    of_width = weight.sum(axis=1)
    best = int(np.argmax(of_width))
    near = np.arange(max(best - 1, 0), min(best + 2, len(of_width)))
    near = near[of_width[near] > 0.0]
    place = weight[near] @ places / of_width[near]
    return float(np.ptp(place)) / max(len(place) - 1, 1)
