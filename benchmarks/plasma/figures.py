"""Figures of flights through plasma: densities, absolute contents, walls that were told."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.vectors import FloatArray
from vtff_iono.edges.boundary import Boundary

from .chain import ChainResult
from .worlds import Bubble, PlasmaWorld

__all__ = [
    "AbsoluteFigures",
    "DensityFigures",
    "EdgeFigures",
    "absolute_figures",
    "density_figures",
    "edge_figures",
    "wall_errors",
]

CM3 = 1e6
_SETTLED = 60.0
"""s from the start until densities count."""
_FIRST_ABSOLUTE = 600.0
# A wall is told if an edge of the right sense is within this distance of it, m, and a half width.
_NEAR = 2e3
_STRONG = 5.0
# What theory gives for the change of a density over a wall: noise of one phase for a second, m,
# satellites, and mean path through a layer over its height.
_WHITE, _SATELLITES, _PATH = 0.001 / math.sqrt(20.0), 9.0, 1.6
_TECU_PER_METRE = 9.51775
_SEGMENT = 3e3  # m, beside a wall


@dataclass(frozen=True)
class DensityFigures:
    """Errors of the density of a flight, 1e4 cm-3; z are errors over sigmas."""

    mean_error: float
    sigma: float
    z_rms: float
    largest_z: float
    impossible: int


def density_figures(world: PlasmaWorld, result: ChainResult) -> DensityFigures:
    """Return the errors of the densities that were published."""
    rows = result.density[result.density[:, 0] > _SETTLED]
    if not len(rows):
        return DensityFigures(*[math.nan] * 3, 0.0, 0)
    error, sigma = rows[:, 2] - rows[:, 4], rows[:, 3]
    z = error / sigma
    return DensityFigures(
        float(np.abs(error).mean()) / CM3 / 1e4,
        float(np.sqrt(np.mean(sigma**2))) / CM3 / 1e4,
        float(np.sqrt(np.mean(z**2))),
        float(np.abs(z).max()),
        int(np.count_nonzero(rows[:, 2] < -3.0 * sigma)),
    )


@dataclass(frozen=True)
class AbsoluteFigures:
    """Errors of absolute slant contents after the first estimate, TECU; NaN without one."""

    rms: float
    z_rms: float


def absolute_figures(result: ChainResult) -> AbsoluteFigures:
    """Return the errors of the absolute contents."""
    rows = result.absolute[result.absolute[:, 0] > _FIRST_ABSOLUTE]
    if not len(rows):
        return AbsoluteFigures(math.nan, math.nan)
    rms, z = (float(np.sqrt(np.mean(v**2))) for v in (rows[:, 2], rows[:, 2] / rows[:, 3]))
    return AbsoluteFigures(rms, z)


@dataclass(frozen=True)
class WallError:
    """A wall of a bubble, and what was told of it; times of chief and deputy, s."""

    name: str
    is_upper: bool
    contrast_sigmas: float
    width: float
    time: FloatArray
    told_time: FloatArray
    time_sigma: FloatArray
    told_width: float
    speed: float

    @property
    def is_told(self) -> bool:
        """Whether both spacecraft have an edge there."""
        return bool(np.isfinite(self.told_time).all())

    def __str__(self) -> str:
        """Return a line of a report."""
        side = "upper" if self.is_upper else "lower"
        text = f"{self.name} {side}: contrast {self.contrast_sigmas:.0f} sigma, "
        text += f"width {1e-3 * self.width:.1f} km; "
        if not self.is_told:
            return text + "not told"
        error = self.told_time - self.time
        return text + (
            f"told {error[0]:+.2f}, {error[1]:+.2f} s off, sigma {self.time_sigma[0]:.2f}, "
            f"{self.time_sigma[1]:.2f} s, width {1e-3 * self.told_width:.1f} km"
        )


def wall_errors(world: PlasmaWorld, result: ChainResult) -> list[WallError]:
    """Return the walls of a bubble, and what was told of them."""
    bubble = world.bubble
    assert bubble is not None
    walls = []
    for is_upper, altitude in ((False, bubble.altitude_bottom), (True, bubble.altitude_top)):
        times, speed = _crossings(result, altitude)
        told, sigmas, width = np.full(2, np.nan), np.full(2, np.nan), math.nan
        for boundary in result.edges:
            craft = boundary.spacecraft
            at = 1e-9 * (boundary.time - result.start)
            far = abs(at - times[craft]) * speed
            right = boundary.is_entry == (is_upper != world.is_rising)
            if right and far <= _NEAR + 0.5 * bubble.wall_width:
                told[craft], sigmas[craft], width = at, boundary.time_sigma, boundary.width
        walls.append(
            WallError(
                world.name,
                is_upper,
                _contrast(world, altitude, speed),
                bubble.wall_width,
                times,
                told,
                sigmas,
                width,
                speed,
            )
        )
    return walls


def _crossings(result: ChainResult, altitude: float) -> tuple[FloatArray, float]:
    """Return when chief and deputy cross an altitude, s, and how fast, m/s."""
    time, times = result.altitudes[:, 0], []
    for heights in result.altitudes[:, 1:].T:
        order = np.argsort(heights)
        times.append(float(np.interp(altitude, heights[order], time[order])))
    index = int(np.clip(round(times[0] - time[0]), 5, len(time) - 6))
    chief = result.altitudes[:, 1]
    return np.array(times), abs(float(chief[index + 5] - chief[index - 5])) / 10.0


def _contrast(world: PlasmaWorld, altitude: float, speed: float) -> float:
    """Return the change of density over a wall in sigmas that theory gives.

    Slow errors of four phases change with their correlation time between both sides of the wall;
    white noise and fluctuations that the spacecraft do not share are averaged over the segments.
    """
    bubble = world.bubble
    assert bubble is not None
    gnss = world.gnss()
    background = _background_density(world)
    contrast = bubble.depth * background
    separation = world.vertical_separation
    multipath = gnss.receivers[0].multipath
    apart = (_SEGMENT + bubble.wall_width + separation) / speed
    slow = 2.0 * multipath.phase_sigma * _TECU_PER_METRE
    slow *= math.sqrt(2.0 * (1.0 - math.exp(-apart / multipath.correlation_time)))
    seconds = max(1.0, _SEGMENT / speed)
    white = 2.0 * _WHITE * _TECU_PER_METRE * math.sqrt(2.0 / seconds)
    fluctuation = _fluctuation_tecu(bubble) * math.sqrt(2.0)
    averaged = min(1.0, 2.0 * bubble.decorrelation_time / seconds)
    fluctuation *= math.sqrt(averaged)
    column = math.sqrt(slow**2 + white**2 + fluctuation**2)
    sigma = column * 1e16 / (math.sqrt(_SATELLITES) * _PATH * separation)
    return contrast / sigma


def _background_density(world: PlasmaWorld) -> float:
    """Return the density of the background of a world beside the middle of its bubble, 1/m3."""
    assert world.bubble is not None
    plain = dataclasses.replace(world, bubble=None).gnss().profile
    assert plain is not None
    middle = 0.5 * (world.bubble.altitude_bottom + world.bubble.altitude_top)
    return float(plain.density(middle))


def _fluctuation_tecu(bubble: Bubble) -> float:
    """Return what the phases of a ray scatter by in L1 less L2 of both receivers, TECU.

    For weak scatter a phase has half the scattered power: sigma^2 = (1 - d) / (2 d) with the direct
    power d = (1 - S4^2)^(1/2); L2 follows L1 by the same pattern.
    """
    if bubble.s4 == 0.0:
        return 0.0
    lengths = []
    for scale, wavelength in ((1.0, 0.1903), ((1575.42 / 1227.60) ** 1.5, 0.2442)):
        direct = math.sqrt(max(1.0 - min(bubble.s4 * scale, 0.97) ** 2, 0.0))
        lengths.append(math.sqrt((1.0 - direct) / (2.0 * direct)) * wavelength / (2.0 * math.pi))
    return abs(lengths[1] - lengths[0]) * math.sqrt(2.0) * _TECU_PER_METRE


@dataclass(frozen=True)
class EdgeFigures:
    """What was told of the walls of all bubbles; `strong` ones have a contrast over 5 sigma."""

    walls: int
    strong_walls: int
    told: int
    strong_told: int
    false: int
    time_z: float
    time_z_median: float
    widths: int
    widths_good: int
    width_error: float
    separations: int
    separation_z: float
    separation_error: float


def edge_figures(flown: Sequence[tuple[PlasmaWorld, ChainResult]]) -> EdgeFigures:
    """Return the figures of all bubbles together."""
    every = [wall_errors(world, result) for world, result in flown]
    walls = [wall for of_bubble in every for wall in of_bubble]
    told = [wall for wall in walls if wall.is_told]
    strong = [wall for wall in walls if wall.contrast_sigmas > _STRONG]
    edges: list[Boundary] = [edge for _, result in flown for edge in result.edges]
    ratio = np.array([(w.told_time - w.time) / w.time_sigma for w in told]).ravel()
    wide = [abs(w.told_width / w.width - 1.0) for w in told if w.width > 1e3]
    errors, ratios = [], []
    for (_, result), of_bubble in zip(flown, every, strict=True):
        if not all(wall.is_told for wall in of_bubble):
            continue
        error, variance = 0.0, 0.0
        length = float(np.abs(np.subtract(*result.altitudes[:, 1:].T)).mean())
        for wall in of_bubble:
            lag = np.subtract(*(wall.told_time - wall.time))
            error += 0.5 * float(lag) * wall.speed / length
            variance += 0.25 * float(wall.time_sigma @ wall.time_sigma) * (wall.speed / length) ** 2
        errors.append(error)
        ratios.append(error / math.sqrt(variance))
    return EdgeFigures(
        len(walls),
        len(strong),
        len(told),
        sum(wall.is_told for wall in strong),
        (len(edges) - 2 * len(told)) // 2,
        _rms(ratio),
        float(np.median(np.abs(ratio))) if len(ratio) else math.nan,
        len(wide),
        sum(error <= 0.3 for error in wide),
        float(np.median(wide)) if wide else math.nan,
        len(errors),
        _rms(np.array(ratios)),
        _rms(np.array(errors)),
    )


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan
