"""Edges of ionospheric irregularities: vertical ones from density, horizontal ones from rays.

- `DensityEdgeDetector`: the density between two spacecraft, along one climb or descent. An edge is
  a change by half or more between two short pieces of the profile, with a gap as wide as the
  vertical separation between them: over that length an edge is smeared.
- `ExceedanceDetector`: a quantity of one ray each second (variance of the intensity, spread of the
  rate of TEC, gradient of TEC) that goes above a threshold and stays, or falls below it and stays.

The moment at which each spacecraft crosses a vertical edge itself comes from
`vtff_iono.edges.edge_crossing`. The detectors take one sample after the other and report an edge as
soon as the samples after it confirm it.
"""

from __future__ import annotations

import enum
import math
from collections import deque
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_iono.geometry.mapping import pierce_point

__all__ = [
    "BoundaryKind",
    "BoundarySource",
    "DensityEdgeDetector",
    "Edge",
    "ExceedanceDetector",
    "edge_position",
    "intensity_variance",
]


class BoundaryKind(enum.IntEnum):
    """What an edge bounds; the numbers of ``vtff_msgs/IrregularityBoundary``."""

    VERTICAL = 0
    HORIZONTAL = 1


class BoundarySource(enum.IntEnum):
    """What told an edge; the numbers of ``vtff_msgs/IrregularityBoundary``."""

    DENSITY = 0
    S4 = 1
    ROTI = 2
    TEC_GRADIENT = 3


@dataclass(frozen=True)
class Edge:
    """An edge that was crossed.

    Parameters
    ----------
    time, time_sigma : float
        s, in the origin of the samples.
    is_entry : bool
        Into the irregularity: lower density, or more fluctuation.
    altitude : float
        m; NaN for an edge of a ray.
    before, after : float
        Value on either side.
    confidence : float
        0 to 1.
    """

    time: float
    time_sigma: float
    is_entry: bool
    altitude: float
    before: float
    after: float
    confidence: float


class DensityEdgeDetector:
    """Finds edges in densities along a climb or a descent.

    Parameters
    ----------
    width : float
        Length of the pieces that are compared, m.
    relative_change : float
        Smallest change as a part of the larger density.
    sigmas : float
        Smallest change as a multiple of its standard deviation.
    """

    def __init__(
        self, width: float = 3e3, relative_change: float = 0.5, sigmas: float = 6.0
    ) -> None:
        self._width = width
        self._relative_change = relative_change
        self._sigmas = sigmas
        self._samples: deque[tuple[float, float, float, float]] = deque()
        self._direction = 0.0
        self._candidate: tuple[float, Edge] | None = None
        self._examined = -math.inf

    def update(
        self, time: float, altitude: float, separation: float, density: float, sigma: float
    ) -> list[Edge]:
        """Take a sample in and return the edges that it confirms.

        Parameters
        ----------
        time : float
            s, increasing.
        altitude, separation : float
            Of the middle of the two spacecraft, and their difference, m.
        density, sigma : float
            Electrons per cubic metre; a sample with NaN is left out.
        """
        if not math.isfinite(altitude + separation + density + sigma):
            return []
        edges: list[Edge] = []
        if self._samples:
            direction = math.copysign(1.0, altitude - self._samples[-1][1])
            if direction != self._direction:
                edges += self.flush()
                self._direction = direction
        self._samples.append((time, altitude, density, sigma))
        half_gap = 0.5 * max(abs(separation), 100.0) * 1.1
        reach = half_gap + self._width
        while abs(altitude - self._samples[0][1]) > 2.0 * reach + 4.0 * self._width:
            self._samples.popleft()
        edges += self._examine(half_gap, reach)
        return edges

    def flush(self) -> list[Edge]:
        """Return an edge that was waiting for confirmation, and begin anew."""
        edges = [self._candidate[1]] if self._candidate else []
        self._candidate = None
        self._samples.clear()
        self._direction = 0.0
        self._examined = -math.inf
        return edges

    def _examine(self, half_gap: float, reach: float) -> list[Edge]:
        """Compare the two sides of all places that the newest sample makes complete."""
        table = np.array(self._samples)
        way = self._direction * table[:, 1]
        edges = []
        for place in way[(way > self._examined) & (way + reach <= way[-1])]:
            found = self._edge(table, way, place, half_gap, reach)
            if found is None:
                if self._candidate:
                    edges.append(self._candidate[1])
                self._candidate = None
            elif self._candidate is None or found[0] > self._candidate[0]:
                self._candidate = found
            self._examined = place
        return edges

    def _edge(
        self, table: FloatArray, way: FloatArray, place: float, half_gap: float, reach: float
    ) -> tuple[float, Edge] | None:
        """Return the change at a place and its edge, or None."""
        before = (way >= place - reach) & (way <= place - half_gap)
        after = (way >= place + half_gap) & (way <= place + reach)
        if np.count_nonzero(before) < 2 or np.count_nonzero(after) < 2:
            return None
        low, high = float(table[before, 2].mean()), float(table[after, 2].mean())
        change = high - low
        sigma = math.hypot(_mean_sigma(table[before, 3]), _mean_sigma(table[after, 3]))
        largest = max(low, high)
        if not (
            largest > 0.0
            and abs(change) >= self._relative_change * largest
            and abs(change) >= self._sigmas * sigma
        ):
            return None
        near = np.flatnonzero(np.abs(way - place) <= reach)
        excess = (table[near, 2] - 0.5 * (low + high)) * math.copysign(1.0, change)
        rising = np.flatnonzero((excess[:-1] < 0.0) & (excess[1:] >= 0.0))
        if len(rising) == 0:
            return None
        at = rising[np.argmin(np.abs(way[near[rising]] - place))]
        part = excess[at] / (excess[at] - excess[at + 1])
        one, other = table[near[at]], table[near[at + 1]]
        slope = (other[2] - one[2]) / (other[0] - one[0])
        confidence = math.erf(abs(change) / max(sigma, 1e-300) / self._sigmas / math.sqrt(2.0))
        return abs(change), Edge(
            time=float(one[0] + part * (other[0] - one[0])),
            time_sigma=float(abs(one[3] / slope)),
            is_entry=change < 0.0,
            altitude=float(one[1] + part * (other[1] - one[1])),
            before=low,
            after=high,
            confidence=confidence,
        )


def _mean_sigma(sigma: FloatArray) -> float:
    return float(np.sqrt(np.sum(sigma**2))) / len(sigma)


class ExceedanceDetector:
    """Finds when a quantity goes above a threshold and stays, or falls below it and stays.

    Parameters
    ----------
    threshold : float
    begin_count, begin_window : int
        An event begins with the first of at least so many exceedances in so many samples.
    end_window : int
        It ends with the last exceedance before so many samples without.
    interval : float
        Of the samples, s; a gap of more than `end_window` of them ends an event.
    """

    def __init__(
        self,
        threshold: float,
        begin_count: int = 3,
        begin_window: int = 5,
        end_window: int = 10,
        interval: float = 1.0,
    ) -> None:
        self._threshold = threshold
        self._begin_count = begin_count
        self._end_window = end_window
        self._interval = interval
        self._recent: deque[tuple[float, float, bool]] = deque(maxlen=begin_window)
        self._is_inside = False
        self._last_above = (math.nan, math.nan)
        self._last_time = math.nan
        self._since = 0

    def update(self, time: float, value: float) -> list[Edge]:
        """Take a sample (s, any unit; NaN is left out) in and return the edges it confirms."""
        if not math.isfinite(value):
            return []
        edges: list[Edge] = []
        if time - self._last_time > self._end_window * self._interval:
            edges += self.flush()
        self._last_time = time
        above = value > self._threshold
        self._recent.append((time, value, above))
        if above:
            self._last_above = (time, value)
            self._since = 0
        else:
            self._since += 1
        if above and not self._is_inside:
            exceedances = [sample for sample in self._recent if sample[2]]
            if len(exceedances) >= self._begin_count:
                self._is_inside = True
                edges.append(self._edge(exceedances[0][0], True, len(exceedances)))
        elif self._is_inside and self._since >= self._end_window:
            edges += self.flush()
        return edges

    def flush(self) -> list[Edge]:
        """Return the end of an event that is not over, and begin anew."""
        edges = []
        if self._is_inside:
            edges.append(self._edge(self._last_above[0] + self._interval, False, self._since))
        self._is_inside = False
        self._since = 0
        self._recent.clear()
        return edges

    def _edge(self, time: float, is_entry: bool, count: int) -> Edge:
        outside, inside = self._threshold, self._last_above[1]
        window = self._recent.maxlen if is_entry else self._end_window
        return Edge(
            time=time,
            time_sigma=self._interval * math.sqrt(self._begin_count),
            is_entry=is_entry,
            altitude=math.nan,
            before=outside if is_entry else inside,
            after=inside if is_entry else outside,
            confidence=min(1.0, count / max(1, window or 1)),
        )


def intensity_variance(power: npt.ArrayLike) -> FloatArray:
    """Return the variance of intensity relative to its squared mean, a straight line removed.

    Parameters
    ----------
    power : array_like, shape (..., n)
        Linear C/N0 or intensity over a short time, such as the 20 samples of a second. The square
        root is the S4 of this time alone, without the slower fades.
    """
    power = np.asarray(power, dtype=float)
    place = np.linspace(-1.0, 1.0, power.shape[-1])
    mean = power.mean(axis=-1, keepdims=True)
    slope = (power * place).sum(axis=-1, keepdims=True) / (place**2).sum()
    return np.asarray(((power - mean - slope * place) ** 2).mean(axis=-1) / mean[..., 0] ** 2)


def edge_position(
    position_spacecraft_itrf: npt.ArrayLike,
    direction_itrf: npt.ArrayLike,
    altitude: float,
) -> FloatArray:
    """Return where a ray meets an irregularity at an altitude (m), ITRF, m.

    It is the pierce point; for a spacecraft above that altitude, which flies in or above the
    irregularity, it is the spacecraft itself. Shapes as in
    `vtff_iono.geometry.mapping.pierce_point`.
    """
    spacecraft = np.asarray(position_spacecraft_itrf, dtype=float)
    point = pierce_point(spacecraft, direction_itrf, altitude)
    return np.where(np.isnan(point), spacecraft, point)
