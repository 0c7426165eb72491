"""Edges of irregularities in altitude: found by chief and deputy, against the true regions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from vtff_analysis.recordings.history import (
    Boundary,
    DensityHistory,
    RunHistory,
    TimeArray,
    interpolate,
)
from vtff_analysis.recordings.ionosphere_truth import IonosphereTruth
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray

__all__ = ["add_edges"]

_HIGH_ELEVATION = math.radians(30.0)
_PLATEAU_SECONDS = 10  # inside an edge, over which the content of the plateau is taken

Summary = dict[str, Any]


def add_edges(
    measured: Summary, true: Summary, history: RunHistory, truth: IonosphereTruth | None
) -> None:
    """Add lower and upper edge of each spacecraft on the rising pass, and the separations.

    Parameters
    ----------
    measured, true
        Numbers by name; extended.
    history
        The run; its density must not be None.
    truth
        True ionosphere; None where it is not recorded.
    """
    density = history.density
    assert density is not None
    perigee = int(density.time[np.argmin(density.altitude)])
    edges = [edge for edge in history.boundaries if edge.kind == "vertical"]
    measured["vertical_edges"] = len(edges)
    passes = {
        "falling": [edge for edge in edges if edge.time < perigee],
        "rising": [edge for edge in edges if edge.time >= perigee],
    }
    region_altitudes = None if truth is None else truth.region_altitudes
    if region_altitudes is not None:
        # There is one region: further edges are false and would spoil the pairs.
        passes = {
            name: _longest_stays(edges_of_pass, (history.chief, history.deputy))
            for name, edges_of_pass in passes.items()
        }
    for role, craft in (("chief", history.chief), ("deputy", history.deputy)):
        for name, edge in _bottom_and_top(passes["rising"], craft).items():
            key = f"{role}_{name}"
            measured[f"{key}_time_s"] = (edge.time - history.start_time) / NANOSECONDS_PER_SECOND
            measured[f"{key}_altitude_m"] = edge.altitude
            if role == "chief":
                measured[f"vtec_{name}_tecu"] = _plateau_content(history, edge)
            if truth is not None and region_altitudes is not None:
                altitude = region_altitudes[0 if name == "bottom" else 1]
                times = [c.time for c in truth.crossings(craft, altitude) if c.vertical_speed > 0.0]
                true[f"{key}_altitude_m"] = altitude
                true[f"vtec_{name}_tecu"] = float(truth.profile.vtec_above_tecu(altitude))
                if times:
                    seconds = (times[0] - history.start_time) / NANOSECONDS_PER_SECOND
                    true[f"{key}_time_s"] = seconds
    for name, edges_of_pass in passes.items():
        pairs = _pair_edges(history, edges_of_pass, float(np.median(np.abs(density.separation))))
        if not pairs:
            continue
        middles = [(chief.time + deputy.time) // 2 for chief, deputy in pairs]
        speeds = _vertical_speed(density, np.array(middles))
        delays = [(chief.time - deputy.time) / NANOSECONDS_PER_SECOND for chief, deputy in pairs]
        separations = [delay * speed for delay, speed in zip(delays, speeds, strict=True)]
        measured[f"separation_{name}_m"] = float(np.mean(separations))
        if truth is not None:
            separation = truth.separation_at(history.chief, history.deputy, middles)
            true[f"separation_{name}_m"] = float(np.mean(separation))


def _longest_stays(edges: Sequence[Boundary], crafts: Sequence[str]) -> list[Boundary]:
    """Return the two edges between which each spacecraft was inside for longest."""
    chosen: list[Boundary] = []
    for craft in crafts:
        own_edges = sorted((e for e in edges if e.spacecraft == craft), key=lambda e: e.time)
        stays = [
            (entry, leaving)
            for entry, leaving in zip(own_edges[:-1], own_edges[1:], strict=True)
            if entry.entry and not leaving.entry
        ]
        if stays:
            longest = max(stays, key=lambda stay: stay[1].time - stay[0].time)
            chosen.extend(longest)
    return chosen


def _bottom_and_top(edges: Sequence[Boundary], craft: str) -> dict[str, Boundary]:
    """Return the two edges of a spacecraft that rises through one irregularity.

    With several irregularities bottom and top are not unique, and the result is empty.
    """
    own_edges = [edge for edge in edges if edge.spacecraft == craft]
    named = {"bottom" if edge.entry else "top": edge for edge in own_edges}
    return named if len(named) == len(own_edges) else {}


def _pair_edges(
    history: RunHistory, edges: Sequence[Boundary], separation: float
) -> list[tuple[Boundary, Boundary]]:
    """Return the edges that chief and deputy have both found, in the order of the chief's times.

    Edges of one structure are nearer in altitude than half the separation (m) of the spacecraft.
    """
    pairs = []
    deputy_edges = [edge for edge in edges if edge.spacecraft == history.deputy]
    for edge in sorted((e for e in edges if e.spacecraft == history.chief), key=lambda e: e.time):
        same_kind = [other for other in deputy_edges if other.entry == edge.entry]
        nearest = min(
            same_kind, key=lambda other: abs(other.altitude - edge.altitude), default=None
        )
        if nearest is not None and abs(nearest.altitude - edge.altitude) < 0.5 * separation:
            pairs.append((edge, nearest))
    return pairs


def _vertical_speed(density: DensityHistory, time: TimeArray) -> FloatArray:
    """Return the vertical speed of the middle between the spacecraft at times, m/s."""
    seconds = (density.time - density.time[0]) / NANOSECONDS_PER_SECOND
    return interpolate(time, density.time, np.gradient(density.altitude, seconds))


def _plateau_content(history: RunHistory, edge: Boundary) -> float | None:
    """Return the median vertical content of high satellites just inside an edge, TECU."""
    columns = history.slant_tec.get(f"/{history.chief}/iono/slant_tec")
    if columns is None:
        return None
    sign = 1.0 if edge.entry else -1.0
    inside = (columns.time - edge.time) / NANOSECONDS_PER_SECOND * sign
    chosen = (inside >= 0.0) & (inside < _PLATEAU_SECONDS) & ~(columns.values["rejected"] > 0)
    chosen &= columns.values["elevation"] > _HIGH_ELEVATION
    contents = columns.values["vtec_tecu"][chosen]
    return float(np.nanmedian(contents)) if np.isfinite(contents).any() else None
