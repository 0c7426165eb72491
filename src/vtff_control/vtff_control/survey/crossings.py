"""When a spacecraft crossed a wall of irregular plasma, from what its rays have met.

A ray towards a satellite ahead meets a wall long before the spacecraft does, and one towards a
satellite behind leaves the plasma long after it. So the entry of the spacecraft is that of the rays
behind it, and its exit that of the rays ahead: these cross the wall when the spacecraft does.
Rays that agree support each other. About a wall the scintillation has a pattern that interference,
multipath or a fade within the plasma has not: just outside, the rays that look into the plasma
scintillate and those that look away from it do not. An edge without agreeing rays or without this
pattern is false until proved otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

__all__ = ["CrossingFinder", "CrossingSettings", "RayEdge", "WallCrossing"]

Ray = tuple[int, int]
"""Satellite system and number of a ray."""


@dataclass(frozen=True)
class RayEdge:
    """An edge that a ray of a spacecraft has met (``vtff_msgs/IrregularityBoundary``).

    Attributes
    ----------
    time, time_sigma
        Time of the crossing and its sigma, s.
    spacecraft
        Name of the spacecraft whose ray it is.
    ray
        Satellite of the ray.
    is_entry
        Whether the ray enters the irregularity.
    """

    time: float
    time_sigma: float
    spacecraft: str
    ray: Ray
    is_entry: bool


@dataclass(frozen=True)
class WallCrossing:
    """A crossing of a wall by a spacecraft.

    Attributes
    ----------
    time, time_sigma
        s.
    spacecraft
        Name.
    is_entry
        Whether it enters the irregularity.
    support
        Rays that agree.
    is_supported
        Whether rays and scintillation together show that it is no false edge.
    """

    time: float
    time_sigma: float
    spacecraft: str
    is_entry: bool
    support: int
    is_supported: bool


@dataclass(frozen=True)
class CrossingSettings:
    """What makes a crossing of edges of rays.

    Parameters
    ----------
    agreement
        Largest time between edges of rays that show one crossing, s.
    delay
        Time after an edge in which what belongs to it may still be told, s.
    window
        Time about an edge whose scintillation is looked at, s: shorter than the delay, so that what
        is looked at has been told.
    fewest_rays
        Rays that must agree.
    fewest_share
        Share of the rays on the side that counts which must agree, and of those on the other side
        which must scintillate just outside a wall.
    s4_threshold
        Scintillation index from which on a ray scintillates.
    smallest_sigma
        Sigma of a crossing that no number of rays makes smaller, s.
    """

    agreement: float = 6.0
    delay: float = 60.0
    window: float = 30.0
    fewest_rays: int = 2
    fewest_share: float = 0.3
    s4_threshold: float = 0.2
    smallest_sigma: float = 0.5


@dataclass(frozen=True)
class _Scintillation:
    """Rays of a spacecraft in a window (s): azimuth, rad, and scintillation index."""

    begin: float
    time: float
    azimuths: Mapping[Ray, float]
    s4: Mapping[Ray, float]


class CrossingFinder:
    """Crossings of walls by the spacecraft of a formation, from edges of rays and scintillation.

    Parameters
    ----------
    settings
        What makes a crossing.
    heading
        Azimuth of the motion over the Earth, rad from north over east.
    """

    def __init__(
        self, settings: CrossingSettings | None = None, heading: float = 0.5 * math.pi
    ) -> None:
        self.heading = heading
        self._settings = settings or CrossingSettings()
        self._edges: list[RayEdge] = []
        self._scintillation: dict[str, list[_Scintillation]] = {}
        self._judged = -math.inf

    def add_edge(self, edge: RayEdge) -> None:
        """Take an edge of a ray; one that is told when its time has been judged is left out.

        Such an edge comes from a ray that was lost and found again an hour later.
        """
        if edge.time > self._judged:
            self._edges.append(edge)

    def add_scintillation(
        self,
        begin: float,
        time: float,
        spacecraft: str,
        azimuths: Mapping[Ray, float],
        s4: Mapping[Ray, float],
    ) -> None:
        """Take the scintillation of all rays of a spacecraft in a window.

        Parameters
        ----------
        begin, time
            Start and end of the window, s.
        spacecraft
            Name.
        azimuths
            Azimuth of each ray, rad.
        s4
            Amplitude scintillation index of each ray; not a number where it is not known.
        """
        windows = self._scintillation.setdefault(spacecraft, [])
        windows.append(_Scintillation(begin, time, dict(azimuths), dict(s4)))
        del windows[:-60]

    def take(self, time: float) -> list[WallCrossing]:
        """Return crossings that are complete at a time, in order of their times.

        Parameters
        ----------
        time
            s; edges later than `delay` before it are kept.
        """
        self._judged = max(self._judged, time - self._settings.delay)
        crossings = []
        for spacecraft in sorted({edge.spacecraft for edge in self._edges}):
            for is_entry in (True, False):
                crossings += self._take_kind(time, spacecraft, is_entry)
        return sorted(crossings, key=lambda crossing: (crossing.time, crossing.spacecraft))

    def _take_kind(self, time: float, spacecraft: str, is_entry: bool) -> list[WallCrossing]:
        given = self._settings
        own = sorted(
            (e for e in self._edges if e.spacecraft == spacecraft and e.is_entry == is_entry),
            key=lambda edge: edge.time,
        )
        crossings: list[WallCrossing] = []
        while own and own[0].time <= time - given.delay:
            first = own[0]
            window = self._window(spacecraft, first.time)
            if window is not None and not self._counts(window, first):
                self._edges.remove(own.pop(0))
                continue
            cluster = [first]
            for edge in own[1:]:
                counts = window is None or self._counts(window, edge)
                if edge.time - cluster[-1].time <= given.agreement and counts:
                    cluster.append(edge)
            taken = {id(edge) for edge in cluster}
            self._edges = [edge for edge in self._edges if id(edge) not in taken]
            own = [edge for edge in own if id(edge) not in taken]
            crossings.append(self._crossing(cluster, window))
        return crossings

    def _crossing(self, cluster: list[RayEdge], window: _Scintillation | None) -> WallCrossing:
        given, first = self._settings, cluster[0]
        # A ray may tell an edge by several quantities; the median of the rays bears one outlier.
        rays = {edge.ray for edge in cluster}
        times = np.array([np.median([e.time for e in cluster if e.ray == ray]) for ray in rays])
        moment = float(np.median(times))
        stated = min(edge.time_sigma for edge in cluster)
        spread = 1.2533 * max(float(np.std(times)), stated) / math.sqrt(len(rays))
        supported = len(rays) >= given.fewest_rays
        if window is None:
            supported = False
        else:
            side = sum(self._on_side(a, first.is_entry) for a in window.azimuths.values())
            supported &= len(rays) >= given.fewest_share * side
            supported &= self._scintillates_inside(first.spacecraft, moment, first.is_entry)
            supported &= self._looks_in_from_outside(first.spacecraft, moment, first.is_entry)
        return WallCrossing(
            moment,
            max(spread, given.smallest_sigma),
            first.spacecraft,
            first.is_entry,
            len(rays),
            supported,
        )

    def _window(self, spacecraft: str, time: float) -> _Scintillation | None:
        """Return the window nearest to a time that shows where the rays point; None without one."""
        windows = self._scintillation.get(spacecraft, [])
        reach = self._settings.window
        near = [window for window in windows if abs(window.time - time) <= reach]
        return min(near, key=lambda window: abs(window.time - time)) if near else None

    def _on_side(self, azimuth: float, is_entry: bool) -> bool:
        ahead = math.cos(azimuth - self.heading)
        return ahead <= 0.0 if is_entry else ahead >= 0.0

    def _counts(self, window: _Scintillation, edge: RayEdge) -> bool:
        azimuth = window.azimuths.get(edge.ray)
        return azimuth is None or self._on_side(azimuth, edge.is_entry)

    def _scintillates_inside(self, spacecraft: str, time: float, is_entry: bool) -> bool:
        """Return whether at least half of the rays that count scintillate just inside a wall."""
        given = self._settings
        for window in self._scintillation.get(spacecraft, []):
            inner = window.time - time if is_entry else time - window.time
            if 0.0 <= inner <= given.window:
                counting, _ = self._scintillating(window, is_entry)
                if counting and 2 * sum(counting) >= len(counting):
                    return True
        return False

    def _looks_in_from_outside(self, spacecraft: str, time: float, is_entry: bool) -> bool:
        """Return whether just outside a wall the rays scintillate that look in, and no others."""
        given = self._settings
        # Time from the wall to the near end of each window that is wholly outside.
        outside = [
            (time - window.time if is_entry else window.begin - time, window)
            for window in self._scintillation.get(spacecraft, [])
        ]
        slack = 2.0 * given.smallest_sigma
        near = [pair for pair in outside if -slack <= pair[0] <= given.window]
        if not near:
            return False
        window = min(near, key=lambda pair: pair[0])[1]
        looking_away, looking_in = self._scintillating(window, is_entry)
        return 2 * sum(looking_away) < max(len(looking_away), 1) and sum(looking_in) >= max(
            given.fewest_share * len(looking_in), 1.0
        )

    def _scintillating(
        self, window: _Scintillation, is_entry: bool
    ) -> tuple[list[bool], list[bool]]:
        """Return which rays on the side that counts, and on the other one, scintillate."""
        counting: list[bool] = []
        others: list[bool] = []
        for ray, value in window.s4.items():
            if math.isfinite(value):
                side = counting if self._on_side(window.azimuths[ray], is_entry) else others
                side.append(value >= self._settings.s4_threshold)
        return counting, others
