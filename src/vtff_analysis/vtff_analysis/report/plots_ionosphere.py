"""Plots of paper 000, figures 8 to 11, from a run: plateau, density profiles, scintillation map."""

from __future__ import annotations

import pathlib
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.patches import Rectangle

from vtff_analysis.evaluation.scintillation import WEAK_SCINTILLATION
from vtff_analysis.plot_style import (
    AXIS_COLOURS,
    MARK_COLOUR,
    STYLE,
    make_figure,
    save_figure,
)
from vtff_analysis.recordings.history import (
    DensityHistory,
    RunHistory,
    SatelliteColumns,
    interpolate,
)
from vtff_analysis.recordings.ionosphere_truth import IonosphereTruth
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.signals import satellite_name

__all__ = [
    "plot_density_profile",
    "plot_edges",
    "plot_plateau",
    "plot_satellite_profiles",
    "plot_scintillation_map",
    "scenario_label",
]

_KILOMETRE = 1e3
_PLATEAU_MARGIN = 150.0  # s before and after the edges that figure 8 shows
_PROFILE_MARGIN = 40e3  # m below and above the edges that figure 9 shows
#: Corners of the scintillation events of the paper's figure 10, deg north and deg east.
_PAPER_EVENTS = ((-7.1, -82.7), (-8.8, -67.6))
_PAPER_SCENARIOS = ("esf", "esf_paper")


def scenario_label(scenario: str) -> str:
    """Return the remark that stands behind the title of every figure of a scenario."""
    return ", PLUMEX-like profile (synthetic)" if scenario == "plumex" else ""


def plot_density_profile(
    history: RunHistory,
    density: DensityHistory,
    truth: IonosphereTruth | None,
    path: pathlib.Path,
    title: str,
) -> pathlib.Path:
    """Draw density against altitude, measured and true, and their difference (figure 11)."""
    falling = np.gradient(density.altitude) < 0.0
    lowest, highest = density.altitude.min(), density.altitude.max()
    difference = np.full(len(density.time), np.nan)
    if truth is not None:
        difference = density.density - truth.mean_density(
            history.chief, history.deputy, density.time
        )
    with mpl.rc_context(STYLE):
        figure = make_figure(8.0)
        axes: Any = figure.subplots(1, 2, sharey=True, width_ratios=(2, 1))
        for chosen, name, colour, marker in (
            (falling, "falling", AXIS_COLOURS[0], "o"),
            (~falling, "rising", AXIS_COLOURS[1], "x"),
        ):
            altitude = density.altitude[chosen] / _KILOMETRE
            style = {"color": colour, "marker": marker, "linestyle": "none", "markersize": 4}
            axes[0].plot(density.density[chosen], altitude, label=f"measured, {name}", **style)
            axes[1].plot(difference[chosen], altitude, **style)
        if truth is not None:
            height = np.linspace(lowest, highest, 4000)
            true = truth.profile.density(height)
            axes[0].plot(true, height / _KILOMETRE, "k-", lw=1.2, label="true")
        for boundary in history.boundaries:
            if boundary.kind == "vertical":
                axes[0].axhline(boundary.altitude / _KILOMETRE, color=MARK_COLOUR, ls=":", lw=1.0)
        axes[0].set(xlabel="electron density (m$^{-3}$)", ylabel="altitude (km)")
        axes[0].set_title("all satellites combined; dotted: edges found")
        axes[1].set(xlabel="measured - true (m$^{-3}$)", title="difference")
        axes[0].legend()
        return save_figure(figure, path, title)


def plot_satellite_profiles(
    satellites: SatelliteColumns,
    density: DensityHistory,
    truth: IonosphereTruth | None,
    path: pathlib.Path,
    title: str,
) -> pathlib.Path | None:
    """Draw the density from the two satellites with most seconds on the rising leg (figure 9)."""
    rising = satellites.time > density.time[np.argmin(density.altitude)]
    low, high = float(density.altitude.min()), float(density.altitude.max())
    if truth is not None and truth.region_altitudes is not None:
        low, high = truth.region_altitudes
        low, high = low - _PROFILE_MARGIN, high + _PROFILE_MARGIN
    altitude = satellites.values["altitude"]
    shown = rising & (altitude > low) & (altitude < high)
    if not shown.any():
        return None
    with mpl.rc_context(STYLE):
        figure = make_figure(8.0)
        chosen = _most_frequent(satellites, shown)
        axes: Any = figure.subplots(1, len(chosen), sharex=True, sharey=True, squeeze=False)[0]
        for axis, (system, prn), colour in zip(axes, chosen, AXIS_COLOURS, strict=False):
            rows = shown & (satellites.system == system) & (satellites.prn == prn)
            measured = satellites.values["density"][rows]
            axis.plot(measured, altitude[rows] / _KILOMETRE, "o", ms=3.5, color=colour,
                      label="measured")  # fmt: skip
            if truth is not None:
                height = np.linspace(low, high, 4000)
                true = truth.profile.density(height)
                axis.plot(true, height / _KILOMETRE, "k-", lw=1.2, label="true")
            axis.set(xlabel="electron density (m$^{-3}$)")
            axis.set_title(f"{satellite_name(system, prn)} alone")
        axes[0].set_ylabel("altitude (km)")
        axes[0].legend()
        return save_figure(figure, path, title)


def _most_frequent(columns: SatelliteColumns, chosen: Any, count: int = 2) -> list[tuple[int, int]]:
    """Return system and PRN of the satellites with most of the chosen rows."""
    satellites = np.stack((columns.system[chosen], columns.prn[chosen]), axis=-1)
    unique, counts = np.unique(satellites, axis=0, return_counts=True)
    best = unique[np.argsort(-counts, kind="stable")[:count]]
    return [(int(system), int(prn)) for system, prn in best]


def plot_plateau(
    history: RunHistory,
    truth: IonosphereTruth | None,
    path: pathlib.Path,
    title: str,
    paper_plateau: Sequence[float],
) -> pathlib.Path | None:
    """Draw vertical TEC of each spacecraft from the two satellites that are high for longest.

    For a run with irregularity regions the rising pass through their altitudes is drawn (figure 8).
    Values of `paper_plateau`, TECU, are dotted lines.
    """
    crafts = {
        topic.split("/")[1]: columns
        for topic, columns in sorted(history.slant_tec.items())
        if topic.endswith("/iono/slant_tec")
    }
    if not crafts:
        return None
    start_time = history.start_time
    begin, end = _pass_of_region(truth, history)
    with mpl.rc_context(STYLE):
        figure = make_figure(8.0)
        first = next(iter(crafts.values()))
        best = _most_frequent(first, _high_and_good(first, start_time, begin, end))
        if not best:
            return None
        axes: Any = figure.subplots(len(best), len(crafts), sharex=True, sharey=True, squeeze=False)
        for column, (craft, values) in enumerate(crafts.items()):
            good = _high_and_good(values, start_time, begin, end, 10.0)
            for panel_row, (system, prn) in enumerate(best):
                rows = good & (values.system == system) & (values.prn == prn)
                time = values.time[rows]
                seconds = (time - start_time) / NANOSECONDS_PER_SECOND
                axis = axes[panel_row, column]
                axis.plot(
                    seconds,
                    values.values["vtec_tecu"][rows],
                    ".",
                    ms=3,
                    color=AXIS_COLOURS[column % len(AXIS_COLOURS)],
                    label="measured",
                )
                if truth is not None and craft in truth.time:
                    true = truth.profile.vtec_above_tecu(truth.altitude_at(craft, time))
                    axis.plot(
                        (time - start_time) / NANOSECONDS_PER_SECOND,
                        true,
                        "k-",
                        lw=1.2,
                        label="true",
                    )
                axis.set_title(f"{craft}, {satellite_name(system, prn)}")
                for printed in paper_plateau:
                    axis.axhline(printed, color=MARK_COLOUR, ls=":", lw=1.0)
                if column == 0:
                    axis.set_ylabel("vertical TEC (TECU)")
                if panel_row == len(best) - 1:
                    axis.set_xlabel("time into the run (s)")
        axes[0, 0].legend()
        return save_figure(figure, path, title)


def _pass_of_region(truth: IonosphereTruth | None, history: RunHistory) -> tuple[float, float]:
    """Return begin and end of the chief's rising pass through the regions, s into the run."""
    if truth is None or truth.region_altitudes is None or history.chief not in truth.time:
        return 0.0, np.inf
    times = [
        (crossing.time - history.start_time) / NANOSECONDS_PER_SECOND
        for altitude in truth.region_altitudes
        for crossing in truth.crossings(history.chief, altitude)
        if crossing.vertical_speed > 0.0
    ]
    if not times:
        return 0.0, np.inf
    return min(times) - _PLATEAU_MARGIN, max(times) + _PLATEAU_MARGIN


def _high_and_good(
    columns: SatelliteColumns,
    start_time: int,
    begin: float,
    end: float,
    lowest_elevation_deg: float = 30.0,
) -> Any:
    """Return which rows are not rejected, high enough and between two times (s into the run)."""
    seconds = (columns.time - start_time) / NANOSECONDS_PER_SECOND
    good = ~(columns.values["rejected"] > 0) & (seconds >= begin) & (seconds <= end)
    return good & (columns.values["elevation"] > np.radians(lowest_elevation_deg))


def plot_scintillation_map(
    scintillation: SatelliteColumns,
    density: DensityHistory,
    truth: IonosphereTruth | None,
    scenario: str,
    path: pathlib.Path,
    title: str,
) -> pathlib.Path | None:
    """Draw S4 against altitude, and where along the path of the formation it is high (figure 10).

    The true regions are drawn where they were in the middle of the scintillation.
    """
    first = (scintillation.values["band"] == 1) & np.isfinite(scintillation.values["s4_corrected"])
    if not first.any():
        return None
    # A stamp is the end of its minute; the index belongs to the middle of the minute.
    time = scintillation.time[first] - 30 * NANOSECONDS_PER_SECOND
    s4 = scintillation.values["s4_corrected"][first]
    altitude, latitude, longitude = (
        interpolate(time, density.time, values)
        for values in (
            density.altitude / _KILOMETRE,
            density.latitude_deg,
            np.degrees(np.unwrap(np.radians(density.longitude_deg))),
        )
    )
    longitude = (longitude + 180.0) % 360.0 - 180.0
    with mpl.rc_context(STYLE):
        figure = make_figure(6.5)
        axes: Any = figure.subplots(1, 2, width_ratios=(1, 1.6))
        axes[0].plot(s4, altitude, "o", ms=4, color=AXIS_COLOURS[0], alpha=0.6)
        axes[0].axvline(WEAK_SCINTILLATION, color=MARK_COLOUR, ls="--", lw=1.0)
        axes[0].set(xlabel="S4 of L1, noise removed", ylabel="altitude (km)")
        axes[0].set_title("each satellite and minute")
        order = np.argsort(s4, kind="stable")
        drawn = axes[1].scatter(
            longitude[order], latitude[order], c=s4[order], s=40, cmap="viridis", vmin=0.0, vmax=0.5
        )
        figure.colorbar(drawn, ax=axes[1], label="S4, highest on top")
        strong = time[s4 > WEAK_SCINTILLATION]
        if truth is not None and len(strong):
            _draw_regions(axes, truth, int(strong[len(strong) // 2]))
        if scenario in _PAPER_SCENARIOS:
            corners = np.array(_PAPER_EVENTS)
            axes[1].plot(
                corners[:, 1], corners[:, 0], "D", color=AXIS_COLOURS[1], ms=9, mfc="none", mew=2,
                label="first and last event of the paper",
            )  # fmt: skip
            axes[1].legend(loc="upper center")
        axes[1].set(xlabel="longitude (deg east)", ylabel="latitude (deg north)")
        axes[1].set_title("along the path of the formation")
        return save_figure(figure, path, title)


def _draw_regions(axes: Any, truth: IonosphereTruth, time: int) -> None:
    """Draw the altitudes of the regions, and their outlines at a time (ns since 1970)."""
    for region in truth.regions:
        axes[0].axhspan(
            region.altitude_bottom / _KILOMETRE,
            region.altitude_top / _KILOMETRE,
            color="0.9",
            zorder=0,
        )
        west, width = np.degrees(region.longitude_limits(GpsTime.from_unix_nanoseconds(time)))
        west = (west + 180.0) % 360.0 - 180.0
        south, north = np.degrees([region.latitude_south, region.latitude_north])
        outline = Rectangle((west, south), width, north - south, fc="0.9", ec="0.5", zorder=0)
        axes[1].add_patch(outline)
        axes[1].annotate("true region", (west + width, north), va="bottom", color="0.35")


_EDGE_MARKS = {True: "^", False: "v"}
_EDGE_NAMES = {True: "entered", False: "left"}


def plot_edges(
    history: RunHistory, truth: IonosphereTruth | None, path: pathlib.Path, title: str
) -> pathlib.Path | None:
    """Draw every edge found against time and altitude, and its error where the truth is recorded.

    Edges in density (vertical) are filled marks, those of single rays (horizontal) hollow ones.
    True are the altitudes of the regions and the paths of the spacecraft.
    """
    if not history.boundaries:
        return None
    limits = None if truth is None else truth.region_altitudes
    errors = [] if truth is None or limits is None else _edge_errors(history, truth, limits)
    with mpl.rc_context(STYLE):
        figure = make_figure(8.0 if errors else 5.5)
        axes: Any = figure.subplots(
            1 + bool(errors), 1, sharex=True, squeeze=False,
            height_ratios=(2, 1)[: 1 + bool(errors)],
        )[:, 0]  # fmt: skip
        crafts = (history.chief, history.deputy)
        for craft, colour in zip(crafts, AXIS_COLOURS, strict=False):
            if truth is not None and craft in truth.time:
                time = (truth.time[craft] - history.start_time) / NANOSECONDS_PER_SECOND
                altitude = truth.altitude[craft] / _KILOMETRE
                axes[0].plot(time, altitude, color=colour, lw=0.9, label=f"path of {craft}")
            for kind, is_entry in (
                (kind, entry) for kind in ("vertical", "horizontal") for entry in (True, False)
            ):
                chosen = [
                    edge
                    for edge in history.boundaries
                    if (edge.spacecraft, edge.kind, edge.entry) == (craft, kind, is_entry)
                ]
                if not chosen:
                    continue
                where = "in density" if kind == "vertical" else "of a ray"
                axes[0].plot(
                    [(e.time - history.start_time) / NANOSECONDS_PER_SECOND for e in chosen],
                    [edge.altitude / _KILOMETRE for edge in chosen],
                    _EDGE_MARKS[is_entry],
                    color=colour,
                    markerfacecolor=colour if kind == "vertical" else "none",
                    markersize=9 if kind == "vertical" else 6,
                    label=f"{craft} {_EDGE_NAMES[is_entry]}, {where} ({len(chosen)})",
                )
            own_errors = [error for error in errors if error[0] == craft]
            if own_errors:
                axes[1].plot(
                    [error[1] for error in own_errors],
                    [error[2] for error in own_errors],
                    "o",
                    color=colour,
                    label=f"{craft}, RMS {_root_mean_square([e[2] for e in own_errors]):.0f} m",
                )
        if limits is not None:
            for limit in limits:
                axes[0].axhline(limit / _KILOMETRE, color=MARK_COLOUR, ls="--", lw=1.0)
        named = "" if limits is None else "; dashed: true edges in altitude"
        axes[0].set(ylabel="altitude (km)", title=f"edges found{named}")
        found = [edge.altitude for edge in history.boundaries]
        shown = [*found, *(limits or ())]
        margin = max(10e3, 0.2 * (max(shown) - min(shown)))
        axes[0].set_ylim((min(shown) - margin) / _KILOMETRE, (max(shown) + margin) / _KILOMETRE)
        axes[0].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
        if errors:
            axes[1].axhline(0.0, color=MARK_COLOUR, lw=1.0)
            axes[1].set(ylabel="error in altitude (m)", title="edges in density, found less true")
            axes[1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
        axes[-1].set_xlabel("time into the run (s)")
        return save_figure(figure, path, title)


def _edge_errors(
    history: RunHistory, truth: IonosphereTruth, limits: tuple[float, float]
) -> list[tuple[str, float, float]]:
    """Return spacecraft, time (s into the run) and error (m) of each edge in density.

    The error is the altitude that the spacecraft truly had at the time found, less that of the
    nearest true edge.
    """
    errors = []
    for edge in history.boundaries:
        if edge.kind != "vertical" or edge.spacecraft not in truth.time:
            continue
        altitude = float(truth.altitude_at(edge.spacecraft, edge.time))
        error = min((altitude - limit for limit in limits), key=abs)
        seconds = (edge.time - history.start_time) / NANOSECONDS_PER_SECOND
        errors.append((edge.spacecraft, seconds, error))
    return [error for error in errors if np.isfinite(error[2])]


def _root_mean_square(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
