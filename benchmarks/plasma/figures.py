"""Figures of flights through plasma: densities, absolute contents, walls that were told."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import FREQUENCY_L1, FREQUENCY_L2
from vtff_iono.edges.boundary import Boundary
from vtff_iono.links.geometry_free import tecu_per_metre

from .chain import ChainResult
from .wall_bounds import WallBound, wall_bound
from .worlds import PlasmaWorld

__all__ = [
    "AbsoluteFigures",
    "DensityFigures",
    "EdgeFigures",
    "absolute_figures",
    "density_figures",
    "edge_figures",
    "false_edges",
    "wall_errors",
]

CM3 = 1e6
_SETTLED = 60.0
"""s from the start until densities count."""
# A wall is told if an edge of the right sense is within this distance of it, m, and a half width.
_NEAR = 2e3
_STRONG = 5.0
# A width is sure where its sigma is below this part of it.
_SURE = 0.2
# A width is told within 30 % as a rule where its bound is below this part of it.
_TOLD = 0.15
# Draws of the walls or bubbles from which the intervals of 90 % are taken.
_DRAWS = 2000
# Of the contrast: m beside a wall; s before and after it, and in how many places.
_SEGMENT, _AROUND, _PLACES = 3e3, 60.0, 25


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
    """Errors of absolute slant contents, TECU; NaN without any; z are over sigmas.

    `part` is the part of these among all of their time, `code_bound` what codes allow (RMS).
    """

    rms: float
    z_rms: float
    part: float
    code_bound: float


def absolute_figures(
    world: PlasmaWorld,
    result: ChainResult,
    first: float,
    last: float,
    ages: tuple[float, float] = (0.0, math.inf),
) -> AbsoluteFigures:
    """Return the errors of the absolute contents between two times into the flight, s.

    Only those of arcs count whose age, s, is in an interval.
    """
    time, age = result.absolute[:, 0], result.absolute[:, 4]
    of_time = (time > first) & (time <= last)
    rows = result.absolute[of_time & (age >= ages[0]) & (age < ages[1])]
    if not len(rows):
        return AbsoluteFigures(*[math.nan] * 4)
    return AbsoluteFigures(
        _rms(rows[:, 2]),
        _rms(rows[:, 2] / rows[:, 3]),
        len(rows) / int(np.count_nonzero(of_time)),
        _rms(_code_bound(world, rows[:, 4])),
    )


def _code_bound(world: PlasmaWorld, age: FloatArray) -> FloatArray:
    """Return the least sigma of contents that the codes of arcs of some ages (s) allow, TECU.

    It is the Cramer-Rao bound of the level of an arc whose codes have multipath, a first-order
    Markov process: the mean of such a process is known to a variance of 2 s^2 / (2 + T / t) after
    a time T (Grenander 1950). The satellite bias is known to its sigma, the bias of the receiver
    exactly, and thermal noise has averaged out. What the plasma is like does not count.
    """
    multipath = world.gnss().receivers[0].multipath
    scale = tecu_per_metre(FREQUENCY_L1, FREQUENCY_L2)
    satellite = scale * SPEED_OF_LIGHT * 1e-9 * world.satellite_bias_ns
    code = scale * math.sqrt(2.0) * multipath.code_sigma
    variance = 2.0 * code**2 / (2.0 + age / multipath.correlation_time)
    return np.asarray(np.sqrt(satellite**2 + variance))


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
    time_covariance: float
    told_width: float
    width_sigma: float
    speed: float
    bound: WallBound

    @property
    def is_told(self) -> bool:
        """Whether both spacecraft have an edge there."""
        return bool(np.isfinite(self.told_time).all())

    def __str__(self) -> str:
        """Return a line of a report."""
        side = "upper" if self.is_upper else "lower"
        text = f"{self.name} {side}: contrast {self.contrast_sigmas:.0f} sigma, "
        text += f"width {1e-3 * self.width:.1f} km (bound {1e-3 * self.bound.width_sigma:.2f} km); "
        if not self.is_told:
            return text + "not told"
        error = self.told_time - self.time
        return text + (
            f"told {error[0]:+.2f}, {error[1]:+.2f} s off, sigma {self.time_sigma[0]:.2f}, "
            f"{self.time_sigma[1]:.2f} s, width {1e-3 * self.told_width:.1f} "
            f"+- {1e-3 * self.width_sigma:.1f} km"
        )


def wall_errors(world: PlasmaWorld, result: ChainResult) -> list[WallError]:
    """Return the walls of a bubble, and what was told of them."""
    bubble = world.bubble
    assert bubble is not None
    walls = []
    for is_upper, altitude in ((False, bubble.altitude_bottom), (True, bubble.altitude_top)):
        times, speed = _crossings(result, altitude)
        told, sigmas = np.full(2, np.nan), np.full(2, np.nan)
        width = width_sigma = covariance = math.nan
        for boundary in result.edges:
            craft = boundary.spacecraft
            at = 1e-9 * (boundary.time - result.start)
            far = abs(at - times[craft]) * speed
            right = boundary.is_entry == (is_upper != world.is_rising)
            if right and far <= _NEAR + 0.5 * bubble.wall_width:
                told[craft], sigmas[craft] = at, boundary.time_sigma
                width, width_sigma = boundary.width, boundary.width_sigma
                covariance = boundary.time_covariance
        change = bubble.depth * _background_density(world, altitude)
        sigma = _change_sigma(world, result, float(times.mean()), speed)
        bound = WallBound(math.inf, math.inf)
        if math.isfinite(sigma):
            length, segment = world.vertical_separation, _segment(speed)
            bound = wall_bound(bubble.wall_width, length, speed, change, sigma, segment)
        walls.append(
            WallError(
                world.name,
                is_upper,
                change / sigma,
                bubble.wall_width,
                times,
                told,
                sigmas,
                covariance,
                width,
                width_sigma,
                speed,
                bound,
            )
        )
    return walls


def false_edges(world: PlasmaWorld, result: ChainResult) -> list[str]:
    """Return a line for each edge that was told where there is no wall."""
    told = [time for wall in wall_errors(world, result) for time in wall.told_time.tolist()]
    lines = []
    for edge in result.edges:
        at = 1e-9 * (edge.time - result.start)
        if at not in told:
            height = float(np.interp(at, *result.altitudes[:, [0, 1 + edge.spacecraft]].T))
            lines.append(
                f"{world.name}: {'entry' if edge.is_entry else 'exit'} of spacecraft "
                f"{edge.spacecraft} at {at:.1f} s, {1e-3 * height:.1f} km, width "
                f"{1e-3 * edge.width:.1f} km, confidence {edge.confidence:.3f}: no wall"
            )
    return lines


def _crossings(result: ChainResult, altitude: float) -> tuple[FloatArray, float]:
    """Return when chief and deputy cross an altitude, s, and how fast, m/s."""
    time, times = result.altitudes[:, 0], []
    for heights in result.altitudes[:, 1:].T:
        order = np.argsort(heights)
        times.append(float(np.interp(altitude, heights[order], time[order])))
    index = int(np.clip(round(times[0] - time[0]), 5, len(time) - 6))
    chief = result.altitudes[:, 1]
    return np.array(times), abs(float(chief[index + 5] - chief[index - 5])) / 10.0


def _segment(speed: float) -> float:
    """Return the length of a segment beside a wall, s."""
    return max(1.0, _SEGMENT / speed)


def _change_sigma(world: PlasmaWorld, result: ChainResult, time: float, speed: float) -> float:
    """Return the sigma of the change of density over a wall by the column that was measured, 1/m3.

    The sigma is that of the measured differential contents of this flight with every integer known,
    which no receiver knows: multipath, noise, and fluctuations that the spacecraft do not share. It
    is what the mean of a segment beside the wall scatters by against that of the other side, for
    places of the wall up to a minute before and after; satellites are weighted by it. A satellite
    counts that was measured on both sides of this wall: what it shows elsewhere is not this wall.
    """
    bubble = world.bubble
    assert bubble is not None
    separation = world.vertical_separation
    segment = _segment(speed)
    apart = segment + (bubble.wall_width + separation) / speed
    information = 0.0
    for rows in result.column_errors.values():
        changes = [
            _segment_change(rows, time + before, segment, apart)
            for before in np.linspace(-_AROUND, _AROUND, _PLACES)
        ]
        squares = [change**2 for change in changes if change is not None]
        is_measured = _segment_change(rows, time, segment, apart) is not None
        if is_measured and len(squares) >= _PLACES // 2:
            path = float(np.mean(rows[:, 2])) * separation
            information += path**2 / max(float(np.mean(squares)), 1e-12)
    # Electrons per cubic metre; 1e16 per square metre are a TECU.
    return 1e16 / math.sqrt(information) if information > 0.0 else math.inf


def _segment_change(rows: FloatArray, middle: float, segment: float, apart: float) -> float | None:
    """Return the change of the mean error from one segment to the next, TECU.

    `rows` are times, errors, and paths of seconds; segments (s) have their middles `apart` (s)
    around a time, s. None if either is not measured for half of its time.
    """
    means = []
    for side in (-0.5, 0.5):
        near = np.abs(rows[:, 0] - middle - side * apart) <= 0.5 * segment
        if np.count_nonzero(near) < max(1.0, 0.5 * segment):
            return None
        means.append(float(rows[near, 1].mean()))
    return means[1] - means[0]


def _background_density(world: PlasmaWorld, altitude: float) -> float:
    """Return the density of a world without its bubble at an altitude (m), 1/m3."""
    plain = dataclasses.replace(world, bubble=None).gnss().profile
    assert plain is not None
    return float(plain.density(altitude))


@dataclass(frozen=True)
class EdgeFigures:
    """What was told of the walls of all bubbles; `strong` ones have a contrast over 5 sigma.

    Intervals contain 90 %: of a part as Wilson (1927), of an RMS by drawing walls or bubbles again.
    """

    walls: int
    strong_walls: int
    told: int
    strong_told: int
    strong_interval: tuple[float, float]
    false: int
    time_z: float
    time_z_interval: tuple[float, float]
    time_z_median: float
    widths: int
    widths_good: int
    widths_sure: int
    widths_sure_good: int
    widths_possible: int
    widths_possible_good: int
    width_error: float
    width_z: float
    width_z_interval: tuple[float, float]
    separations: int
    separation_z: float
    separation_z_interval: tuple[float, float]
    separation_error: float
    separation_error_interval: tuple[float, float]
    separation_bound: float


def edge_figures(flown: Sequence[tuple[PlasmaWorld, ChainResult]]) -> EdgeFigures:
    """Return the figures of all bubbles together."""
    every = [wall_errors(world, result) for world, result in flown]
    walls = [wall for of_bubble in every for wall in of_bubble]
    told = [wall for wall in walls if wall.is_told]
    strong = [wall for wall in walls if wall.contrast_sigmas > _STRONG]
    edges: list[Boundary] = [edge for _, result in flown for edge in result.edges]
    # Both spacecraft cross one wall, and what is wrong of it is so for both.
    ratio = np.array([_rms((w.told_time - w.time) / w.time_sigma) for w in told])
    wide = [
        (abs(w.told_width / w.width - 1.0), w.width_sigma < _SURE * w.told_width)
        for w in told
        if w.width > 1e3
    ]
    sure = [error for error, is_sure in wide if is_sure]
    possible = [
        abs(w.told_width / w.width - 1.0)
        for w in told
        if w.width > 1e3 and w.bound.width_sigma < _TOLD * w.width
    ]
    width_ratio = np.array(
        [(w.told_width - w.width) / w.width_sigma for w in told if w.width > 1e3]
    )
    errors, ratios, bounds = [], [], []
    for (_, result), of_bubble in zip(flown, every, strict=True):
        if not all(wall.is_told for wall in of_bubble):
            continue
        error, variance = 0.0, 0.0
        length = float(np.abs(np.subtract(*result.altitudes[:, 1:].T)).mean())
        for wall in of_bubble:
            lag = np.subtract(*(wall.told_time - wall.time))
            error += 0.5 * float(lag) * wall.speed / length
            lag_variance = float(wall.time_sigma @ wall.time_sigma) - 2.0 * wall.time_covariance
            variance += 0.25 * lag_variance * (wall.speed / length) ** 2
        bounds.append(0.5 * math.hypot(*[wall.bound.lag_sigma / length for wall in of_bubble]))
        errors.append(error)
        ratios.append(error / math.sqrt(variance))
    strong_told = sum(wall.is_told for wall in strong)
    return EdgeFigures(
        len(walls),
        len(strong),
        len(told),
        strong_told,
        _interval_of_part(strong_told, len(strong)),
        (len(edges) - 2 * len(told)) // 2,
        _rms(ratio),
        _interval_of_rms(ratio),
        float(np.median(ratio)) if len(ratio) else math.nan,
        len(wide),
        sum(error <= 0.3 for error, _ in wide),
        len(sure),
        sum(error <= 0.3 for error in sure),
        len(possible),
        sum(error <= 0.3 for error in possible),
        float(np.median([error for error, _ in wide])) if wide else math.nan,
        _rms(width_ratio),
        _interval_of_rms(width_ratio),
        len(errors),
        _rms(np.array(ratios)),
        _interval_of_rms(np.array(ratios)),
        _rms(np.array(errors)),
        _interval_of_rms(np.array(errors)),
        _rms(np.array(bounds)),
    )


def _interval_of_part(count: int, total: int) -> tuple[float, float]:
    if not total:
        return math.nan, math.nan
    interval = binomtest(count, total).proportion_ci(confidence_level=0.9, method="wilson")
    return interval.low, interval.high


def _interval_of_rms(values: FloatArray) -> tuple[float, float]:
    if len(values) < 2:
        return math.nan, math.nan
    draws = np.random.default_rng(0).integers(0, len(values), (_DRAWS, len(values)))
    low, high = np.percentile(np.sqrt(np.mean(values[draws] ** 2, axis=1)), (5.0, 95.0))
    return float(low), float(high)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan
