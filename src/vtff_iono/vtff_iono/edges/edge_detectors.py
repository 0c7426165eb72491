"""Edges of irregularities as detectors tell them, and the detector of edges of rays.

`ExceedanceDetector` examines a quantity of one ray each second (variance of the intensity, spread
of the rate of TEC, gradient of TEC). An edge is where the quantity rises above a threshold and
stays there, or falls below it and stays there. Vertical edges: `vtff_iono.edges.density_edges`.
The detectors accept one sample after the other and return an edge as soon as the samples after it
confirm it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_iono.edges.wall_width import WidthsByShape
from vtff_iono.geometry.mapping import pierce_point

__all__ = [
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
    altitude, altitude_sigma : float
        Altitude of the edge and its sigma, m; NaN for an edge of a ray, the sigma also where it
        was not estimated.
    before, after : float
        Value of the quantity before and after the edge.
    confidence : float
        0 to 1.
    width, width_sigma : float
        Width over which the density changes, and its sigma, m; NaN for an edge of a ray.
    is_doubtful : bool
        Whether it is to be told only if something else shows it, too.
    widths : WidthsByShape, optional
        Widths by the shape of the wall, if they were estimated.
    """

    time: float
    time_sigma: float
    is_entry: bool
    altitude: float
    before: float
    after: float
    confidence: float
    width: float = math.nan
    width_sigma: float = math.nan
    altitude_sigma: float = math.nan
    is_doubtful: bool = False
    widths: WidthsByShape | None = None


class _Sample(NamedTuple):
    """A sample of a quantity, and whether it is above the threshold."""

    time: float
    value: float
    exceeds: bool


# A sample that is not above the threshold, of which nothing else counts.
_NOTHING = _Sample(math.nan, math.nan, False)


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

    @property
    def is_expecting(self) -> bool:
        """Whether a sample below the threshold changes what is found later.

        It does not where neither an event is under way nor the recent samples have an exceedance.
        """
        return self._is_inside or any(sample.exceeds for sample in self._recent)

    def update(self, time: float, value: float) -> list[Edge]:
        """Add a sample (s, any unit; NaN is left out) and return the edges that it confirms."""
        if not math.isfinite(value):
            return []
        edges: list[Edge] = []
        if time - self._last_time > self._end_window * self._interval:
            edges += self.flush()
        self._last_time = time
        if not (self._is_inside or value > self._threshold):
            # Outside an event a sample below the threshold only moves the window on.
            self._recent.append(_NOTHING)
            return edges
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
