"""Numbers of the ionosphere of a run: edges, contents, scintillation, density; measured and true.

A measured number stands under ``ionosphere_<name>``, the true one, where the run tells it, under
``ionosphere_true_<name>`` (docs/summary.md).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_analysis.recordings.history import (
    Boundary,
    DensityHistory,
    FloatArray,
    RunHistory,
    SatelliteColumns,
    TimeArray,
)
from vtff_analysis.recordings.ionosphere_truth import IonosphereTruth
from vtff_gnss.constants import ELECTRONS_PER_TECU
from vtff_iono.density.density_profile import COMPARISON_ALTITUDES, binned_profile
from vtff_iono.edges.boundary_scores import score_minutes
from vtff_sim_bridge.atmosphere.density_models import PLUMEX_BUBBLES

__all__ = [
    *("CHIEF", "DEPUTY", "MINUTE", "WEAK_SCINTILLATION"),
    *("scintillating_minutes", "summarise_ionosphere"),
]

WEAK_SCINTILLATION = 0.2
"""S4 from which on there is scintillation (paper 000, section 4.2)."""

#: The paper counts the bubbles of its section 4.3 from above.
_BUBBLES = dict(enumerate(reversed(PLUMEX_BUBBLES), 1))

CHIEF, DEPUTY = "chief", "deputy"

_SECOND = 1_000_000_000
MINUTE = 60 * _SECOND
"""ns; window of the scintillation indices."""

_HIGH_ELEVATION = math.radians(30.0)
_PLATEAU_SECONDS = 10  # within the edges, over which the content of a plateau is taken
_DENSITY_START = 100 * _SECOND  # until then the bias between the receivers is being found
_PER_CUBIC_CENTIMETRE = 1e-6

Summary = dict[str, Any]


def summarise_ionosphere(
    history: RunHistory, truth: IonosphereTruth | None, lag: float | None = None
) -> Summary:
    """Summarise the ionosphere of a run.

    Parameters
    ----------
    history
        The run.
    truth
        None where it is not known.
    lag
        By which the deputy's fluctuations of C/N0 follow the chief's, s.

    Returns
    -------
    dict
        Flat, keys of docs/summary.md; empty where nothing was measured.
    """
    measured: Summary = {}
    true: Summary = {}
    if history.density is not None:
        _add_edges(measured, true, history, truth)
        _add_density(measured, history.density, truth)
        single = _single_satellite_error(history, truth)
        if single is not None:
            measured["density_error_single_satellite_per_cm3"] = single
    _add_scintillation(measured, true, history, truth)
    _add_contents(measured, history, truth)
    if lag is not None:
        measured["lag_s"] = lag
        if truth is not None:
            true["lag_s"] = _true_lag(truth, scintillating_minutes(history))
    return {
        **{f"ionosphere_{name}": value for name, value in measured.items()},
        **{f"ionosphere_true_{name}": value for name, value in true.items() if name in measured},
    }


def _add_edges(
    measured: Summary, true: Summary, history: RunHistory, truth: IonosphereTruth | None
) -> None:
    """Tell the lower and upper edge, rising, of each spacecraft, and what follows from them."""
    density = history.density
    assert density is not None
    perigee = int(density.time[np.argmin(density.altitude)])
    edges = [edge for edge in history.boundaries if edge.kind == "vertical"]
    measured["vertical_edges"] = len(edges)
    passes = {
        "falling": [edge for edge in edges if edge.time < perigee],
        "rising": [edge for edge in edges if edge.time >= perigee],
    }
    if truth is not None and truth.region_altitudes is not None:
        # One region: what else looks like edges does not belong to it.
        passes = {name: _longest_stays(found) for name, found in passes.items()}
    for craft in (CHIEF, DEPUTY):
        for name, edge in _bottom_and_top(passes["rising"], craft).items():
            key = f"{craft}_{name}"
            measured[f"{key}_time_s"] = (edge.time - history.start_time) / _SECOND
            measured[f"{key}_altitude_m"] = edge.altitude
            if craft == CHIEF:
                measured[f"vtec_{name}_tecu"] = _plateau_content(history, edge)
            if truth is not None and truth.region_altitudes is not None:
                altitude = truth.region_altitudes[0 if name == "bottom" else 1]
                times = [c.time for c in truth.crossings(craft, altitude) if c.vertical_speed > 0.0]
                true[f"{key}_altitude_m"] = altitude
                true[f"vtec_{name}_tecu"] = float(truth.profile.vtec_above_tecu(altitude))
                if times:
                    true[f"{key}_time_s"] = (times[0] - history.start_time) / _SECOND
    for name, found in passes.items():
        pairs = _pairs(found, float(np.median(np.abs(density.separation))))
        if not pairs:
            continue
        middles = [(one.time + other.time) // 2 for one, other in pairs]
        speeds = _vertical_speed(density, np.array(middles))
        between = [(c.time - d.time) / _SECOND for c, d in pairs]
        separations = [gap * speed for gap, speed in zip(between, speeds, strict=True)]
        measured[f"separation_{name}_m"] = float(np.mean(separations))
        if truth is not None:
            separation = truth.separation_at(CHIEF, DEPUTY, middles)
            true[f"separation_{name}_m"] = float(np.mean(separation))


def _longest_stays(edges: list[Boundary]) -> list[Boundary]:
    """Return the two edges between which each spacecraft was inside for longest."""
    found = []
    for craft in (CHIEF, DEPUTY):
        mine = sorted((e for e in edges if e.spacecraft == craft), key=lambda e: e.time)
        stays = [
            (one, other)
            for one, other in zip(mine[:-1], mine[1:], strict=True)
            if one.entry and not other.entry
        ]
        found += max(stays, key=lambda stay: stay[1].time - stay[0].time, default=())
    return found


def _bottom_and_top(edges: list[Boundary], craft: str) -> dict[str, Boundary]:
    """Return the edges of a spacecraft that rises through one irregularity; empty of several."""
    mine = [edge for edge in edges if edge.spacecraft == craft]
    found = {"bottom" if edge.entry else "top": edge for edge in mine}
    return found if len(found) == len(mine) else {}


def _pairs(edges: list[Boundary], separation: float) -> list[tuple[Boundary, Boundary]]:
    """Return the edges that chief and deputy have both found, in the order of the chief's times.

    Edges of one structure are nearer in altitude than half the separation (m) of the spacecraft.
    """
    found = []
    deputies = [edge for edge in edges if edge.spacecraft == DEPUTY]
    for edge in sorted((e for e in edges if e.spacecraft == CHIEF), key=lambda e: e.time):
        same = [other for other in deputies if other.entry == edge.entry]
        nearest = min(same, key=lambda other: abs(other.altitude - edge.altitude), default=None)
        if nearest is not None and abs(nearest.altitude - edge.altitude) < 0.5 * separation:
            found.append((edge, nearest))
    return found


def _vertical_speed(density: DensityHistory, time: TimeArray) -> FloatArray:
    """Return the vertical speed of the middle of the spacecraft at times, m/s."""
    seconds = (density.time - density.time[0]) / _SECOND
    speed = np.gradient(density.altitude, seconds)
    return np.asarray(np.interp((time - density.time[0]) / _SECOND, seconds, speed))


def _plateau_content(history: RunHistory, edge: Boundary) -> float | None:
    """Return the median vertical content of high satellites just inside an edge, TECU."""
    columns = history.slant_tec.get(f"/{CHIEF}/iono/slant_tec")
    if columns is None:
        return None
    inside = (columns.time - edge.time) / _SECOND * (1.0 if edge.entry else -1.0)
    chosen = (inside >= 0.0) & (inside < _PLATEAU_SECONDS) & ~(columns.values["rejected"] > 0)
    chosen &= columns.values["elevation"] > _HIGH_ELEVATION
    contents = columns.values["vtec_tecu"][chosen]
    return float(np.nanmedian(contents)) if np.isfinite(contents).any() else None


def _add_density(measured: Summary, density: DensityHistory, truth: IonosphereTruth | None) -> None:
    """Compare with the density averaged over the separation, in 1 km bins of the rising leg."""
    if truth is None:
        return
    true = truth.mean_density(CHIEF, DEPUTY, density.time)
    known = np.isfinite(true)
    rising = known & (np.arange(len(true)) > np.argmin(density.altitude))
    if not rising.any():
        return
    bins, errors = _binned_errors(density, true, rising)
    parts: dict[str, tuple[float, float]] = {"": COMPARISON_ALTITUDES}
    if truth.region_altitudes is None:
        parts |= {
            f"_bubble_{number}": (bubble.altitude_bottom, bubble.altitude_top)
            for number, bubble in _BUBBLES.items()
        }
    for name, (low, high) in parts.items():
        inside = (bins > low) & (bins < high)
        if inside.any():
            mean = float(errors[inside].mean()) * _PER_CUBIC_CENTIMETRE
            measured[f"density_error{name}_per_cm3"] = mean
    content = (density.density - true) * np.abs(density.separation) / ELECTRONS_PER_TECU
    later = known & (density.time - density.time[0] >= _DENSITY_START)
    if later.any():
        measured["differential_tec_rms_tecu"] = float(np.sqrt(np.mean(content[later] ** 2)))


def _binned_errors(
    density: DensityHistory, true: FloatArray, chosen: npt.NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """Return the middles of 1 km bins (m) and the absolute error of each."""
    altitude, sigma = density.altitude[chosen], density.sigma[chosen]
    found = binned_profile(altitude, density.density[chosen], sigma)
    wanted = binned_profile(altitude, true[chosen], np.ones(len(altitude)))
    return found.altitude, np.abs(found.density - wanted.density)


def _single_satellite_error(history: RunHistory, truth: IonosphereTruth | None) -> float | None:
    """Return the mean absolute error of the satellite with most seconds, each by itself, cm-3."""
    columns, density = history.satellite_density, history.density
    if columns is None or density is None or truth is None:
        return None
    low, high = COMPARISON_ALTITUDES
    altitude = columns.values["altitude"]
    shown = columns.time > density.time[np.argmin(density.altitude)]
    shown &= (altitude > low) & (altitude < high)
    satellite = columns.system.astype(np.int64) << 8 | columns.prn
    found, counts = np.unique(satellite[shown], return_counts=True)
    if not len(found):
        return None
    mine = shown & (satellite == found[np.argmax(counts)])
    error = columns.values["density"][mine] - truth.mean_density(CHIEF, DEPUTY, columns.time[mine])
    return float(np.nanmean(np.abs(error))) * _PER_CUBIC_CENTIMETRE


def _first_band(history: RunHistory, craft: str) -> SatelliteColumns | None:
    """Return the indices of L1 of a spacecraft, as far as they are finite."""
    columns = history.scintillation.get(f"/{craft}/iono/scintillation")
    if columns is None:
        return None
    kept = (columns.values["band"] == 1) & np.isfinite(columns.values["s4_corrected"])
    values = {name: column[kept] for name, column in columns.values.items()}
    return SatelliteColumns(columns.time[kept], columns.system[kept], columns.prn[kept], values)


def scintillating_minutes(history: RunHistory) -> TimeArray:
    """Return the ends of the minutes in which the chief saw scintillation."""
    columns = _first_band(history, CHIEF)
    if columns is None:
        return np.empty(0, dtype=np.int64)
    return np.unique(columns.time[columns.values["s4_corrected"] > WEAK_SCINTILLATION])


def _add_scintillation(
    measured: Summary, true: Summary, history: RunHistory, truth: IonosphereTruth | None
) -> None:
    for craft in (CHIEF, DEPUTY):
        columns = _first_band(history, craft)
        if columns is None:
            continue
        found = columns.values["s4_corrected"] > WEAK_SCINTILLATION
        measured[f"{craft}_scintillating_minutes"] = int(np.count_nonzero(found))
        given = None if truth is None else truth.satellites.get(craft)
        if given is None or not len(columns.time):
            continue
        crossing = _crossing_seconds(columns, given.time, given.satellite, given.s4)
        score = score_minutes(found, crossing)
        true[f"{craft}_scintillating_minutes"] = score.crossing_count
        if score.crossing_count:
            measured[f"{craft}_scintillation_detected_percent"] = 100.0 * score.detection_rate
        if score.other_count:
            measured[f"{craft}_scintillation_false_percent"] = 100.0 * score.false_alarm_rate
    _add_events(measured, true, history, truth)


def _crossing_seconds(
    columns: SatelliteColumns, time: TimeArray, satellite: Any, s4: FloatArray
) -> FloatArray:
    """Return for how many seconds the ray of each row crossed a region in its minute."""
    strong = s4 > WEAK_SCINTILLATION
    # A minute is told by its end.
    offset = int(columns.time[0] % MINUTE)
    ends = -(-(time[strong] - offset) // MINUTE) * MINUTE + offset
    minutes, counts = np.unique(np.stack((ends, satellite[strong])), axis=1, return_counts=True)
    known = {(int(t), int(s)): int(n) for t, s, n in zip(*minutes, counts, strict=True)}
    mine = columns.system.astype(np.int64) << 8 | columns.prn
    rows = zip(columns.time.tolist(), mine.tolist(), strict=True)
    return np.array([float(known.get(row, 0)) for row in rows])


def _add_events(
    measured: Summary, true: Summary, history: RunHistory, truth: IonosphereTruth | None
) -> None:
    """Tell where the chief was in the first and last minute of scintillation."""
    ends, density = scintillating_minutes(history), history.density
    if not len(ends) or density is None:
        return
    seconds = (density.time - density.time[0]) / _SECOND
    east = np.degrees(np.unwrap(np.radians(density.longitude_deg)))
    for name, end in (("first", ends[0]), ("last", ends[-1])):
        middle = (end - MINUTE // 2 - density.time[0]) / _SECOND
        latitude = float(np.interp(middle, seconds, density.latitude_deg))
        longitude = float(np.interp(middle, seconds, east))
        measured[f"{name}_event_latitude_deg"] = latitude
        measured[f"{name}_event_longitude_deg"] = (longitude + 180.0) % 360.0 - 180.0
    given = None if truth is None else truth.satellites.get(CHIEF)
    if truth is None or given is None:
        return
    strong = given.time[given.s4 > WEAK_SCINTILLATION]
    if len(strong):
        for name, time in (("first", strong[0]), ("last", strong[-1])):
            latitude, longitude = truth.place_at(CHIEF, int(time))
            true[f"{name}_event_latitude_deg"] = latitude
            true[f"{name}_event_longitude_deg"] = longitude


def _add_contents(measured: Summary, history: RunHistory, truth: IonosphereTruth | None) -> None:
    """Compare the absolute contents of rays with those that the receivers were given."""
    for craft in (CHIEF, DEPUTY):
        columns = history.slant_tec.get(f"/{craft}/iono/slant_tec")
        given = None if truth is None else truth.satellites.get(craft)
        if columns is None or given is None:
            continue
        good = ~(columns.values["rejected"] > 0)
        mine = columns.system.astype(np.int64) << 8 | columns.prn
        found = _seconds_and_satellites(columns.time[good], mine[good])
        known = _seconds_and_satellites(given.time, given.satellite)
        _, one, other = np.intersect1d(found, known, return_indices=True)
        if len(one):
            error = columns.values["stec_tecu"][good][one] - given.stec_tecu[other]
            rms = float(np.sqrt(np.nanmean(error**2)))
            measured[f"{craft}_slant_tec_error_rms_tecu"] = rms


def _seconds_and_satellites(time: TimeArray, satellite: Any) -> npt.NDArray[np.int64]:
    """Return one number a second and satellite; satellites have 16 bits."""
    return np.asarray(np.round(time / _SECOND).astype(np.int64) << 16 | satellite)


def _true_lag(truth: IonosphereTruth, ends: TimeArray) -> float | None:
    """Return how much later the deputy is where the chief was, over the rotating Earth, s."""
    if not len(ends):
        return None
    middle = int(ends[len(ends) // 2])
    ahead = _direction(*truth.place_at(CHIEF, middle + 5 * _SECOND))
    behind = _direction(*truth.place_at(CHIEF, middle - 5 * _SECOND))
    chief, deputy = (_direction(*truth.place_at(craft, middle)) for craft in (CHIEF, DEPUTY))
    rate = np.linalg.norm(ahead - behind) / 10.0
    return float(np.linalg.norm(chief - deputy) / rate)


def _direction(latitude_deg: float, longitude_deg: float) -> FloatArray:
    latitude, longitude = math.radians(latitude_deg), math.radians(longitude_deg)
    return np.array(
        [
            math.cos(latitude) * math.cos(longitude),
            math.cos(latitude) * math.sin(longitude),
            math.sin(latitude),
        ]
    )
