"""Edges and scintillation of rays as an ionosphere processor would tell them, from the truth.

This stands in for receivers and the ionosphere chain in software loops and statistics. The rays are
drawn once, fixed in east, north and up; each second the length of each in the true regions decides
whether it scintillates. Times of edges have white errors, some edges are missed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf
from vtff_dynamics.frames.geodetic import rotation_itrf_to_enu
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_sim_bridge.atmosphere.irregularity import IrregularityRegion, path_length_in_region
from vtff_sim_bridge.noise.random_streams import Effect, generator

__all__ = [
    "EmulatedRayEdge",
    "EmulatedScintillation",
    "RayEdgeEmulation",
    "RayEdgeEmulationSettings",
]

_RAY_LENGTH = 2e7  # m: beyond every region
_FARTHEST = math.radians(30.0)  # from a region whose top a ray above the horizon can meet


@dataclass(frozen=True)
class RayEdgeEmulationSettings:
    """What is drawn.

    Parameters
    ----------
    rays
        Number of rays.
    lowest_elevation_deg
        deg.
    time_sigma
        Sigma of the time of an edge, s.
    detection
        Probability that an edge of a ray is told.
    confirmation
        Time after an edge at which it is told, s.
    window
        Window of the scintillation indices, s.
    """

    rays: int = 10
    lowest_elevation_deg: float = 10.0
    time_sigma: float = 1.0
    detection: float = 0.9
    confirmation: float = 12.0
    window: float = 10.0


@dataclass(frozen=True, eq=False)
class EmulatedRayEdge:
    """An edge that a ray has met.

    Attributes
    ----------
    time
        Time of the edge, whole s after the start.
    ray
        Number of the ray.
    spacecraft
        Name.
    is_entry
        Whether the ray enters the region.
    position_itrf
        Position of the spacecraft then, m, shape (3,).
    """

    time: float
    ray: int
    spacecraft: str
    is_entry: bool
    position_itrf: FloatArray


@dataclass(frozen=True, eq=False)
class EmulatedScintillation:
    """Indices of all rays of a spacecraft in a window that ends at a time (s), shape (n,)."""

    time: float
    spacecraft: str
    s4: FloatArray


class RayEdgeEmulation:
    """Edges and indices of the rays of a formation.

    Parameters
    ----------
    regions
        True regions.
    start
        Time to which the local times of the regions belong.
    spacecraft
        Names.
    seed
        Seed of rays and errors.
    settings
        What is drawn.

    Attributes
    ----------
    azimuths, elevations
        Directions of the rays, rad, shape (n,).
    """

    def __init__(
        self,
        regions: Sequence[IrregularityRegion],
        start: GpsTime,
        spacecraft: Sequence[str],
        seed: int,
        settings: RayEdgeEmulationSettings | None = None,
    ) -> None:
        self.settings = settings or RayEdgeEmulationSettings()
        self._regions, self._start = tuple(regions), start
        self._random = generator(seed, Effect.RAY_EDGE)
        count = self.settings.rays
        # Even in azimuth but for a draw, so that there are rays ahead and behind.
        turn = (np.arange(count) + self._random.random(count)) / count
        self.azimuths: FloatArray = 2.0 * math.pi * turn
        lowest = math.sin(math.radians(self.settings.lowest_elevation_deg))
        self.elevations: FloatArray = np.arcsin(self._random.uniform(lowest, 1.0, count))
        self._directions = np.stack(
            (
                np.cos(self.elevations) * np.sin(self.azimuths),
                np.cos(self.elevations) * np.cos(self.azimuths),
                np.sin(self.elevations),
            ),
            axis=1,
        )
        self._inside = {name: np.zeros(count, dtype=bool) for name in spacecraft}
        self._s4: dict[str, list[FloatArray]] = {name: [] for name in spacecraft}
        self._last: tuple[float, Mapping[str, FloatArray]] | None = None
        self._waiting: list[tuple[float, EmulatedRayEdge]] = []

    def advance(
        self, time: float, states_gcrf: Mapping[str, FloatArray]
    ) -> tuple[list[EmulatedRayEdge], list[EmulatedScintillation]]:
        """Return what is told until a time.

        Parameters
        ----------
        time
            Whole s after the start.
        states_gcrf
            True state of each spacecraft then, m and m/s, shape (6,).
        """
        last, self._last = self._last, (time, dict(states_gcrf))
        windows: list[EmulatedScintillation] = []
        if last is not None and time > last[0]:
            seconds = np.arange(last[0] + 1.0, time + 0.5)
            for name in self._inside:
                path = CubicHermiteSpline(
                    [last[0], time],
                    np.stack((last[1][name][:3], states_gcrf[name][:3])),
                    np.stack((last[1][name][3:], states_gcrf[name][3:])),
                )
                windows += self._observe(name, seconds, path(seconds))
        told = [edge for due, edge in self._waiting if due <= time]
        self._waiting = [(due, edge) for due, edge in self._waiting if due > time]
        return told, windows

    def _observe(
        self, name: str, seconds: FloatArray, positions_gcrf: FloatArray
    ) -> list[EmulatedScintillation]:
        windows = []
        positions = np.array(
            [
                rotation_gcrf_to_itrf(self._start + second) @ position
                for second, position in zip(seconds.tolist(), positions_gcrf, strict=True)
            ]
        )
        indices = self._indices(seconds, positions)
        for second, position, s4 in zip(seconds.tolist(), positions, indices, strict=True):
            inside = s4 > 0.0
            for ray in np.flatnonzero(inside != self._inside[name]).tolist():
                self._tell(second, ray, name, bool(inside[ray]), position)
            self._inside[name] = inside
            self._s4[name].append(s4)
            if len(self._s4[name]) >= self.settings.window:
                mean = np.mean(self._s4[name], axis=0)
                noisy = np.abs(mean + 0.03 * self._random.standard_normal(mean.shape))
                windows.append(EmulatedScintillation(second, name, noisy))
                self._s4[name].clear()
        return windows

    def _indices(self, seconds: FloatArray, positions: FloatArray) -> FloatArray:
        """Return the index of each ray at positions in ITRF (m), shape (k, n)."""
        to_itrf = rotation_itrf_to_enu(positions[len(positions) // 2])
        directions = self._directions @ to_itrf
        s4 = np.zeros((len(seconds), len(directions)))
        for region in self._regions:
            angle = region.drift_angle(seconds)
            # In axes that go with the plasma, the region is where it was at the start.
            turn = np.zeros((len(seconds), 3, 3))
            turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
            turn[:, 0, 1] = np.sin(angle)
            turn[:, 1, 0] = -turn[:, 0, 1]
            turn[:, 2, 2] = 1.0
            receivers = np.einsum("kij,kj->ki", turn, positions)
            of_time = self._start if region.drift_east is not None else self._start + seconds[-1]
            if not self._is_near(region, of_time, receivers[0]):
                continue
            satellites = receivers[:, None] + _RAY_LENGTH * np.einsum(
                "kij,nj->kni", turn, directions
            )
            length = path_length_in_region(region, of_time, receivers[:, None], satellites)
            s4 = np.maximum(s4, np.where(length > 0.5 * region.taper_length, region.s4, 0.0))
        return s4

    @staticmethod
    def _is_near(region: IrregularityRegion, time: GpsTime, position: FloatArray) -> bool:
        """Return whether a ray from a position may cross a region at all."""
        west, width = region.longitude_limits(time)
        longitude = math.atan2(position[1], position[0])
        middle = (longitude - west - 0.5 * width + math.pi) % (2.0 * math.pi) - math.pi
        return abs(middle) <= 0.5 * width + _FARTHEST

    def _tell(
        self, second: float, ray: int, name: str, is_entry: bool, position: FloatArray
    ) -> None:
        is_told = self._random.random() < self.settings.detection
        error = self.settings.time_sigma * float(self._random.standard_normal())
        if is_told:
            edge = EmulatedRayEdge(second + error, ray, name, is_entry, position)
            self._waiting.append((second + self.settings.confirmation, edge))
