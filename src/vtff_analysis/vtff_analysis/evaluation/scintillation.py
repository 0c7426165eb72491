"""Scintillation of a run: how many minutes of it, where, and how much of it is true."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vtff_analysis.recordings.history import RunHistory, SatelliteColumns, TimeArray, interpolate
from vtff_analysis.recordings.ionosphere_truth import IonosphereTruth, SatelliteTruth
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.signals import satellite_number
from vtff_iono.edges.window_scores import score_windows

__all__ = [
    "WEAK_SCINTILLATION",
    "add_scintillation",
    "scintillating_windows",
    "true_lag",
]

WEAK_SCINTILLATION = 0.2
"""S4 from which on there is scintillation (paper 000, section 4.2)."""

_MINUTE = 60 * NANOSECONDS_PER_SECOND

# Length of the windows of the indices where a recording has one window only, ns.
_USUAL_WINDOW = _MINUTE

_LAG_STEP = 5 * NANOSECONDS_PER_SECOND  # before and after, over which the ground speed is taken

Summary = dict[str, Any]


def scintillating_windows(history: RunHistory) -> tuple[TimeArray, int]:
    """Return the windows of the indices in which the chief saw scintillation.

    Returns
    -------
    ndarray of int64, shape (n,)
        Ends of the windows, ns since 1970.
    int
        Their length, ns.
    """
    columns = _indices_of_l1(history, history.chief)
    if columns is None:
        return np.empty(0, dtype=np.int64), _USUAL_WINDOW
    ends = np.unique(columns.time[columns.values["s4_corrected"] > WEAK_SCINTILLATION])
    return ends, _window_length(columns)


def add_scintillation(
    measured: Summary, true: Summary, history: RunHistory, truth: IonosphereTruth | None
) -> None:
    """Add the minutes of scintillation of each spacecraft, and where they begin and end.

    Parameters
    ----------
    measured, true
        Numbers by name; extended.
    history
        The run.
    truth
        True ionosphere; None where it is not recorded.
    """
    for role, craft in (("chief", history.chief), ("deputy", history.deputy)):
        columns = _indices_of_l1(history, craft)
        if columns is None:
            continue
        detected = columns.values["s4_corrected"] > WEAK_SCINTILLATION
        window = _window_length(columns)
        minutes = window / _MINUTE
        measured[f"{role}_scintillating_minutes"] = minutes * int(np.count_nonzero(detected))
        rays = None if truth is None else truth.satellites.get(craft)
        if rays is None or not len(columns.time):
            continue
        crossing_minimum = 0.5 * window / NANOSECONDS_PER_SECOND
        score = score_windows(detected, _crossing_seconds(columns, rays, window), crossing_minimum)
        true[f"{role}_scintillating_minutes"] = minutes * score.crossing_count
        if score.crossing_count:
            measured[f"{role}_scintillation_detected_percent"] = 100.0 * score.detection_rate
        if score.other_count:
            measured[f"{role}_scintillation_false_percent"] = 100.0 * score.false_alarm_rate
    _add_events(measured, true, history, truth)


def _window_length(columns: SatelliteColumns) -> int:
    """Return the length of the windows of the indices, ns: the shortest time between two."""
    satellite = satellite_number(columns.system, columns.prn)
    order = np.lexsort((columns.time, satellite))
    between = np.diff(columns.time[order])[np.diff(satellite[order]) == 0]
    between = between[between > 0]
    return int(between.min()) if between.size else _USUAL_WINDOW


def true_lag(truth: IonosphereTruth, history: RunHistory, ends: TimeArray) -> float | None:
    """Return how much later the deputy is where the chief was, over the rotating Earth, s.

    Parameters
    ----------
    truth
        True orbits.
    history
        The run, for the names of chief and deputy.
    ends
        Ends of the windows of scintillation; the lag is that of the middle window.

    Returns
    -------
    float or None
        None without windows.
    """
    if not len(ends):
        return None
    middle = int(ends[len(ends) // 2])
    ahead = _direction(*truth.place_at(history.chief, middle + _LAG_STEP))
    behind = _direction(*truth.place_at(history.chief, middle - _LAG_STEP))
    chief, deputy = (
        _direction(*truth.place_at(craft, middle)) for craft in (history.chief, history.deputy)
    )
    rate = np.linalg.norm(ahead - behind) / 10.0
    return float(np.linalg.norm(chief - deputy) / rate)


def _indices_of_l1(history: RunHistory, craft: str) -> SatelliteColumns | None:
    """Return the indices of L1 of a spacecraft whose S4 is finite."""
    columns = history.scintillation.get(f"/{craft}/iono/scintillation")
    if columns is None:
        return None
    kept = (columns.values["band"] == 1) & np.isfinite(columns.values["s4_corrected"])
    values = {name: column[kept] for name, column in columns.values.items()}
    return SatelliteColumns(columns.time[kept], columns.system[kept], columns.prn[kept], values)


def _crossing_seconds(columns: SatelliteColumns, rays: SatelliteTruth, window: int) -> FloatArray:
    """Return for how many seconds the ray of each row crossed a region in the row's window, ns."""
    strong = rays.s4 > WEAK_SCINTILLATION
    # The time of a row is the end of its window.
    offset = int(columns.time[0] % window)
    ends = -(-(rays.time[strong] - offset) // window) * window + offset
    windows, counts = np.unique(
        np.stack((ends, rays.satellite[strong])), axis=1, return_counts=True
    )
    seconds = {(int(t), int(s)): int(n) for t, s, n in zip(*windows, counts, strict=True)}
    satellites = satellite_number(columns.system, columns.prn)
    rows = zip(columns.time.tolist(), satellites.tolist(), strict=True)
    return np.array([float(seconds.get(row, 0)) for row in rows])


def _add_events(
    measured: Summary, true: Summary, history: RunHistory, truth: IonosphereTruth | None
) -> None:
    """Add where the chief was in the first and in the last window of scintillation."""
    (ends, window), density = scintillating_windows(history), history.density
    if not len(ends) or density is None:
        return
    east = np.degrees(np.unwrap(np.radians(density.longitude_deg)))
    for name, end in (("first", ends[0]), ("last", ends[-1])):
        middle = end - window // 2
        longitude = float(interpolate(middle, density.time, east))
        measured[f"{name}_event_latitude_deg"] = float(
            interpolate(middle, density.time, density.latitude_deg)
        )
        measured[f"{name}_event_longitude_deg"] = (longitude + 180.0) % 360.0 - 180.0
    rays = None if truth is None else truth.satellites.get(history.chief)
    if truth is None or rays is None:
        return
    strong = rays.time[rays.s4 > WEAK_SCINTILLATION]
    if len(strong):
        for name, time in (("first", strong[0]), ("last", strong[-1])):
            latitude, longitude = truth.place_at(history.chief, int(time))
            true[f"{name}_event_latitude_deg"] = latitude
            true[f"{name}_event_longitude_deg"] = longitude


def _direction(latitude_deg: float, longitude_deg: float) -> FloatArray:
    """Return the unit vector of a place on a sphere, shape (3,)."""
    latitude, longitude = math.radians(latitude_deg), math.radians(longitude_deg)
    return np.array(
        [
            math.cos(latitude) * math.cos(longitude),
            math.cos(latitude) * math.sin(longitude),
            math.sin(latitude),
        ]
    )
