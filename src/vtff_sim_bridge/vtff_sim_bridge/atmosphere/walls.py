"""Walls of emulated plasma that spacecraft truly cross.

Walls are the western and eastern sides of the regions, as meridians; a spacecraft that flies
eastward enters a region by its western wall. Times are s after the start of the run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.angles import wrap_angle
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_sim_bridge.atmosphere.irregularity import IrregularityRegion

__all__ = [
    "WALL_RADIUS",
    "TrueCrossing",
    "WallKey",
    "WallTruth",
    "edges_by_difference",
    "find_true_crossings",
    "find_wall_truth",
    "nearest_wall",
    "next_crossing_error",
    "side_longitudes",
]

WALL_RADIUS = 6.75e6  # m from the Earth's centre, at which longitudes are lengths

WallKey = tuple[int, bool]
"""Number of a region, and whether it is the wall by which an eastward flight enters it."""


@dataclass(frozen=True)
class TrueCrossing:
    """A wall that a spacecraft truly crossed.

    Attributes
    ----------
    wall
        The wall.
    number
        How often the spacecraft has crossed it before.
    spacecraft
        Name.
    time
        s after the start.
    longitude
        rad, not wrapped.
    altitude
        m above the ellipsoid.
    """

    wall: WallKey
    number: int
    spacecraft: str
    time: float
    longitude: float
    altitude: float


@dataclass(frozen=True, eq=False)
class WallTruth:
    """Emulated plasma of a run and the walls that its spacecraft truly crossed.

    Attributes
    ----------
    start
        Start of the run, to which the local times of the regions belong.
    regions
        Irregularity regions.
    crossings
        True crossings of all spacecraft, in order of time.
    """

    start: GpsTime
    regions: tuple[IrregularityRegion, ...]
    crossings: tuple[TrueCrossing, ...]


def side_longitudes(
    region: IrregularityRegion, start: GpsTime, elapsed: npt.ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return the longitudes of the western and eastern side of a region, rad, not wrapped.

    Parameters
    ----------
    region
        The region.
    start
        Time to which its local times belong.
    elapsed
        s after the start, shape (n,).
    """
    elapsed = np.asarray(elapsed, dtype=float)
    west, width = region.longitude_limits(start)
    if region.drift_east is None:
        moved = -elapsed / 3600.0 * math.pi / 12.0
    else:
        moved = region.drift_angle(elapsed)
    western = wrap_angle(west) + moved
    return western, western + width


def find_true_crossings(
    regions: Sequence[IrregularityRegion],
    start: GpsTime,
    spacecraft: str,
    times: npt.ArrayLike,
    positions_itrf: npt.ArrayLike,
) -> list[TrueCrossing]:
    """Return the walls that a spacecraft has crossed eastward.

    Parameters
    ----------
    regions, start
        Irregularity regions, and the time to which their local times belong.
    spacecraft
        Name.
    times
        s after the start, increasing, shape (n,); some seconds apart.
    positions_itrf
        True positions then, m, shape (n, 3).
    """
    times = np.asarray(times, dtype=float)
    latitudes, longitudes, altitudes = np.asarray(geodetic_from_itrf(positions_itrf)).T
    longitudes = np.unwrap(longitudes)
    crossings = []
    for index, region in enumerate(regions):
        sides = side_longitudes(region, start, times)
        for is_entry, side in zip((True, False), sides, strict=True):
            turns = (longitudes - side) / (2.0 * math.pi)
            begun = np.floor(turns)
            for number, sample in enumerate(np.flatnonzero(np.diff(begun) > 0.0).tolist()):
                part = (begun[sample + 1] - turns[sample]) / (turns[sample + 1] - turns[sample])
                time, latitude, longitude, altitude = (
                    float(values[sample] + part * (values[sample + 1] - values[sample]))
                    for values in (times, latitudes, longitudes, altitudes)
                )
                if (
                    region.latitude_south <= latitude <= region.latitude_north
                    and region.altitude_bottom <= altitude <= region.altitude_top
                ):
                    wall = (index, is_entry)
                    crossings.append(
                        TrueCrossing(wall, number, spacecraft, time, longitude, altitude)
                    )
    return crossings


def find_wall_truth(
    regions: Sequence[IrregularityRegion],
    start: GpsTime,
    tracks: Mapping[str, tuple[npt.ArrayLike, npt.ArrayLike]],
) -> WallTruth:
    """Return what spacecraft crossed.

    Parameters
    ----------
    regions, start
        Irregularity regions, and the time to which their local times belong.
    tracks
        For each spacecraft times, s after the start, shape (n,), and its true positions in ITRF
        then, m, shape (n, 3).
    """
    crossings = [
        crossing
        for name, (times, positions) in tracks.items()
        for crossing in find_true_crossings(regions, start, name, times, positions)
    ]
    ordered = sorted(crossings, key=lambda crossing: (crossing.time, crossing.spacecraft))
    return WallTruth(start, tuple(regions), tuple(ordered))


def nearest_wall(
    truth: WallTruth, elapsed: float, longitude: float, is_entry: bool
) -> tuple[WallKey, float]:
    """Return the true wall of a kind that is nearest to a place, and how far east the place is.

    Parameters
    ----------
    truth
        Emulated plasma, with a region at least.
    elapsed
        s after the start.
    longitude
        rad.
    is_entry
        Kind of the wall.

    Returns
    -------
    (int, bool), float
        The wall, and the distance along the equator, m.
    """
    distances = []
    for region in truth.regions:
        west, east = side_longitudes(region, truth.start, elapsed)
        side = float(west if is_entry else east)
        distances.append(WALL_RADIUS * wrap_angle(longitude - side))
    nearest = min(range(len(distances)), key=lambda index: abs(distances[index]))
    return (nearest, is_entry), distances[nearest]


def next_crossing_error(
    truth: WallTruth, wall: WallKey, spacecraft: str, now: float, predicted: float
) -> float | None:
    """Return the error of a predicted next crossing, s; None if it was not flown.

    Parameters
    ----------
    truth
        Emulated plasma and crossings.
    wall, spacecraft
        The wall and the spacecraft that shall cross it next.
    now, predicted
        Time of the prediction and the predicted time, s after the start.
    """
    coming = [
        crossing.time
        for crossing in truth.crossings
        if crossing.wall == wall and crossing.spacecraft == spacecraft and crossing.time > now
    ]
    return predicted - coming[0] if coming else None


def edges_by_difference(crossings: Sequence[TrueCrossing]) -> list[float]:
    """Return the altitude difference of the spacecraft at each crossing that several made, m."""
    groups: dict[tuple[WallKey, int], list[float]] = {}
    for crossing in crossings:
        groups.setdefault((crossing.wall, crossing.number), []).append(crossing.altitude)
    return [max(values) - min(values) for values in groups.values() if len(values) > 1]
