"""Detectors of edges of irregularities: vertical edges from density, horizontal edges from rays.

- `DensityEdgeDetector` examines the density between two spacecraft along one climb or descent. An
  edge is a change by half or more between two short segments of the profile. The gap between the
  segments is as wide as the vertical separation of the spacecraft, over which an edge is smeared.
- `ExceedanceDetector` examines a quantity of one ray each second (variance of the intensity, spread
  of the rate of TEC, gradient of TEC). An edge is where the quantity rises above a threshold and
  stays there, or falls below it and stays there.

The moment at which each spacecraft crosses a vertical edge comes from
`vtff_iono.edges.edge_crossing`. The detectors accept one sample after the other and return an edge
as soon as the samples after it confirm it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_iono.geometry.mapping import pierce_point

__all__ = [
    "DensityEdgeDetector",
    "Edge",
    "ExceedanceDetector",
    "edge_position",
    "intensity_variance",
]


@dataclass(frozen=True)
class Edge:
    """An edge that was crossed.

    Parameters
    ----------
    time, time_sigma : float
        Time of the crossing, counted as the times of the samples are, and its sigma, s.
    is_entry : bool
        Whether the irregularity begins: lower density, or more fluctuation.
    altitude : float
        Altitude of the edge, m; NaN for an edge of a ray.
    before, after : float
        Value of the quantity before and after the edge.
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


class _DensitySample(NamedTuple):
    """A density at the middle of the two spacecraft."""

    time: float
    altitude: float
    density: float
    sigma: float


class DensityEdgeDetector:
    """Finds edges in densities along a climb or a descent.

    Parameters
    ----------
    width : float
        Length of the two segments of the profile that are compared, m.
    relative_change : float
        Smallest change of an edge as a fraction of the larger density.
    sigmas : float
        Smallest change of an edge as a multiple of the sigma of the change.
    """

    def __init__(
        self, width: float = 3e3, relative_change: float = 0.5, sigmas: float = 6.0
    ) -> None:
        self._width = width
        self._relative_change = relative_change
        self._sigmas = sigmas
        self._samples: deque[_DensitySample] = deque()
        self._direction = 0.0  # 1 in a climb, -1 in a descent
        self._candidate: tuple[float, Edge] | None = None  # change of density, and edge
        self._examined_to = -math.inf

    def update(
        self, time: float, altitude: float, separation: float, density: float, sigma: float
    ) -> list[Edge]:
        """Add a sample and return the edges that it confirms.

        Parameters
        ----------
        time : float
            s, increasing.
        altitude, separation : float
            Altitude of the middle of the two spacecraft, and difference of their altitudes, m.
        density, sigma : float
            Electrons per cubic metre; a sample with NaN is left out.
        """
        if not math.isfinite(altitude + separation + density + sigma):
            return []
        edges: list[Edge] = []
        if self._samples:
            direction = math.copysign(1.0, altitude - self._samples[-1].altitude)
            if direction != self._direction:
                edges += self.flush()
                self._direction = direction
        self._samples.append(_DensitySample(time, altitude, density, sigma))
        half_gap = 0.5 * max(abs(separation), 100.0) * 1.1
        reach = half_gap + self._width
        while abs(altitude - self._samples[0].altitude) > 2.0 * reach + 4.0 * self._width:
            self._samples.popleft()
        edges += self._examine(half_gap, reach)
        return edges

    def flush(self) -> list[Edge]:
        """Return the edge that waits for confirmation, if there is one, and start anew."""
        edges = [self._candidate[1]] if self._candidate else []
        self._candidate = None
        self._samples.clear()
        self._direction = 0.0
        self._examined_to = -math.inf
        return edges

    def _examine(self, half_gap: float, reach: float) -> list[Edge]:
        """Compare both sides of all altitudes whose upper or lower side the newest sample ends.

        Among neighbouring altitudes with an edge, the altitude with the largest change counts.
        """
        samples = np.array(self._samples)
        advance = self._direction * samples[:, 1]
        edges = []
        is_new = (advance > self._examined_to) & (advance + reach <= advance[-1])
        for middle in advance[is_new]:
            candidate = self._edge_at(samples, advance, middle, half_gap, reach)
            if candidate is None:
                if self._candidate:
                    edges.append(self._candidate[1])
                self._candidate = None
            elif self._candidate is None or candidate[0] > self._candidate[0]:
                self._candidate = candidate
            self._examined_to = middle
        return edges

    def _edge_at(
        self, samples: FloatArray, advance: FloatArray, middle: float, half_gap: float, reach: float
    ) -> tuple[float, Edge] | None:
        """Return the change of density at an altitude and the edge there; None without an edge.

        Parameters
        ----------
        samples : ndarray, shape (n, 4)
            Rows of `_DensitySample`.
        advance : ndarray, shape (n,)
            Altitudes of the samples, in a descent negative, so that they increase, m.
        middle : float
            The altitude that is examined, with the sign of `advance`, m.
        half_gap, reach : float
            Distances from there to the beginning and the end of the segments on both sides, m.
        """
        before = (advance >= middle - reach) & (advance <= middle - half_gap)
        after = (advance >= middle + half_gap) & (advance <= middle + reach)
        if np.count_nonzero(before) < 2 or np.count_nonzero(after) < 2:
            return None
        density_before = float(samples[before, 2].mean())
        density_after = float(samples[after, 2].mean())
        change = density_after - density_before
        sigma = math.hypot(_mean_sigma(samples[before, 3]), _mean_sigma(samples[after, 3]))
        largest = max(density_before, density_after)
        if not (
            largest > 0.0
            and abs(change) >= self._relative_change * largest
            and abs(change) >= self._sigmas * sigma
        ):
            return None
        near = np.flatnonzero(np.abs(advance - middle) <= reach)
        excess = samples[near, 2] - 0.5 * (density_before + density_after)
        excess *= math.copysign(1.0, change)
        rising = np.flatnonzero((excess[:-1] < 0.0) & (excess[1:] >= 0.0))
        if len(rising) == 0:
            return None
        at = rising[np.argmin(np.abs(advance[near[rising]] - middle))]
        fraction = excess[at] / (excess[at] - excess[at + 1])
        low, high = _DensitySample(*samples[near[at]]), _DensitySample(*samples[near[at + 1]])
        slope = (high.density - low.density) / (high.time - low.time)
        confidence = math.erf(abs(change) / max(sigma, 1e-300) / self._sigmas / math.sqrt(2.0))
        return abs(change), Edge(
            time=float(low.time + fraction * (high.time - low.time)),
            time_sigma=float(abs(low.sigma / slope)),
            is_entry=change < 0.0,
            altitude=float(low.altitude + fraction * (high.altitude - low.altitude)),
            before=density_before,
            after=density_after,
            confidence=confidence,
        )


def _mean_sigma(sigma: FloatArray) -> float:
    """Return the sigma of the mean of independent samples."""
    return float(np.sqrt(np.sum(sigma**2))) / len(sigma)


class _Sample(NamedTuple):
    """A sample of a quantity, and whether it is above the threshold."""

    time: float
    value: float
    exceeds: bool


class ExceedanceDetector:
    """Finds when a quantity rises above a threshold and stays, or falls below it and stays.

    Parameters
    ----------
    threshold : float
        In the unit of the quantity.
    begin_count, begin_window : int
        An event begins with the first of at least `begin_count` exceedances in `begin_window`
        samples.
    end_window : int
        It ends with the last exceedance before `end_window` samples without one.
    interval : float
        Time between samples, s; a gap of more than `end_window` intervals ends an event.
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
        self._recent: deque[_Sample] = deque(maxlen=begin_window)
        self._is_inside = False
        self._last_exceedance = _Sample(math.nan, math.nan, True)
        self._last_time = math.nan
        self._samples_below = 0

    def update(self, time: float, value: float) -> list[Edge]:
        """Add a sample (s, any unit; NaN is left out) and return the edges that it confirms."""
        if not math.isfinite(value):
            return []
        edges: list[Edge] = []
        if time - self._last_time > self._end_window * self._interval:
            edges += self.flush()
        self._last_time = time
        sample = _Sample(time, value, value > self._threshold)
        self._recent.append(sample)
        if sample.exceeds:
            self._last_exceedance = sample
            self._samples_below = 0
        else:
            self._samples_below += 1
        if sample.exceeds and not self._is_inside:
            exceedances = [sample for sample in self._recent if sample.exceeds]
            if len(exceedances) >= self._begin_count:
                self._is_inside = True
                edges.append(self._edge(exceedances[0].time, True, len(exceedances)))
        elif self._is_inside and self._samples_below >= self._end_window:
            edges += self.flush()
        return edges

    def flush(self) -> list[Edge]:
        """Return the end of an event that is not over, if there is one, and start anew."""
        edges = []
        if self._is_inside:
            end = self._last_exceedance.time + self._interval
            edges.append(self._edge(end, False, self._samples_below))
        self._is_inside = False
        self._samples_below = 0
        self._recent.clear()
        return edges

    def _edge(self, time: float, is_entry: bool, count: int) -> Edge:
        """Return an edge that a number of samples confirms."""
        outside, inside = self._threshold, self._last_exceedance.value
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

    The square root is the S4 of this time alone, without the slower fades.

    Parameters
    ----------
    power : array_like, shape (..., n)
        Linear C/N0 or intensity over a short time, such as the 20 samples of a second.
    """
    power = np.asarray(power, dtype=float)
    ramp = np.linspace(-1.0, 1.0, power.shape[-1])
    mean = power.mean(axis=-1, keepdims=True)
    slope = (power * ramp).sum(axis=-1, keepdims=True) / (ramp**2).sum()
    return np.asarray(((power - mean - slope * ramp) ** 2).mean(axis=-1) / mean[..., 0] ** 2)


def edge_position(
    position_spacecraft_itrf: npt.ArrayLike,
    direction_itrf: npt.ArrayLike,
    altitude: float,
) -> FloatArray:
    """Return where a ray meets an irregularity at an altitude (m), ITRF, m.

    For a spacecraft below that altitude this is the pierce point. A spacecraft above it flies in or
    above the irregularity: then it is the position of the spacecraft. Shapes as in
    `vtff_iono.geometry.mapping.pierce_point`.
    """
    spacecraft = np.asarray(position_spacecraft_itrf, dtype=float)
    point = pierce_point(spacecraft, direction_itrf, altitude)
    return np.where(np.isnan(point), spacecraft, point)
