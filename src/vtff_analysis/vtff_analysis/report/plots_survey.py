"""Picture of a survey: walls over time, a map, altitudes of the crossings, and the drift."""

from __future__ import annotations

import math
import pathlib
from typing import Any

import matplotlib as mpl
import numpy as np

from vtff_analysis.plot_style import (
    AXIS_COLOURS,
    ESTIMATE_COLOUR,
    MARK_COLOUR,
    STATE_COLOUR,
    STYLE,
    make_figure,
    save_figure,
)
from vtff_analysis.survey.recording import SurveyHistory
from vtff_dynamics.time.timescales import GpsTime
from vtff_sim_bridge.atmosphere.irregularity import IrregularityRegion
from vtff_sim_bridge.atmosphere.walls import WALL_RADIUS, WallTruth, side_longitudes

__all__ = ["plot_survey"]

_HOUR = 3.6e12  # ns
_TRUE_COLOUR = "0.8"
_MARKERS = "osD^v<>"


def plot_survey(
    survey: SurveyHistory,
    truth: WallTruth,
    span: tuple[int, int],
    path: pathlib.Path,
    title: str,
) -> pathlib.Path:
    """Draw what a survey told of walls against the truth, and when it changed the formation.

    Parameters
    ----------
    survey
        What it learnt and decided.
    truth
        Emulated plasma and true crossings; none where they are not recorded.
    span
        Start and end of the run, ns since 1970.
    path
        File.
    title
        Title of the picture.
    """
    start_time, end = span
    with mpl.rc_context(STYLE):
        has_crossings = bool(survey.crossings or truth.crossings)
        ratios = (3, 2, 3, 2) if has_crossings else (3, 2, 2)
        figure = make_figure(1.3 * sum(ratios))
        axes: Any = figure.subplots(len(ratios), 1, height_ratios=ratios)
        hours = np.linspace(0.0, (end - start_time) / _HOUR, 100)
        _draw_longitudes(axes[0], survey, truth, start_time, hours)
        _draw_map(axes[1], survey, truth, start_time)
        if has_crossings:
            _draw_altitudes(axes[2], survey, truth, start_time)
        _draw_drift(axes[-1], survey, truth, start_time)
        for axis in (axes[0], *axes[2:]):
            axis.set_xlim(0.0, hours[-1])
            axis.set_xlabel("time since the start (h)")
            for plan in survey.plans:
                axis.axvline((plan.time - start_time) / _HOUR, color=MARK_COLOUR, ls=":", lw=1.5)
        return save_figure(figure, path, title)


def _sides_deg(region: IrregularityRegion, start: GpsTime, hours: Any) -> tuple[Any, Any]:
    """Return the longitudes of the western and eastern side at times in h, deg, not wrapped."""
    west, east = side_longitudes(region, start, 3600.0 * hours)
    return np.degrees(west), np.degrees(east)


def _draw_longitudes(
    axis: Any,
    survey: SurveyHistory,
    truth: WallTruth,
    start_time: int,
    hours: Any,
) -> None:
    for number, region in enumerate(truth.regions):
        west, east = _sides_deg(region, truth.start, hours)
        label = "true bubbles" if number == 0 else None
        axis.fill_between(hours, west, east, color=_TRUE_COLOUR, lw=0, label=label)
    at = (survey.decisions[-1].time - start_time) / _HOUR
    for number, wall in enumerate(survey.decisions[-1].walls):
        moved = np.degrees(wall.drift * 3600.0 * (hours - at) / WALL_RADIUS)
        label = "walls as estimated at the end" if number == 0 else None
        axis.plot(hours, wall.longitude_deg + moved, color=ESTIMATE_COLOUR, lw=1.2, label=label)
    for number, name in enumerate(_names(survey)):
        own = [crossing for crossing in survey.crossings if crossing.spacecraft == name]
        axis.plot(
            [(crossing.time - start_time) / _HOUR for crossing in own],
            [crossing.longitude_deg for crossing in own],
            _MARKERS[number % len(_MARKERS)],
            color=AXIS_COLOURS[number % len(AXIS_COLOURS)],
            ms=6,
            mfc="none",
            label=f"crossings told by {name}",
        )
    axis.set_ylabel("longitude (deg E)")
    axis.legend(loc="upper left", bbox_to_anchor=(0.0, 1.18), ncols=4, fontsize="small")


def _draw_map(axis: Any, survey: SurveyHistory, truth: WallTruth, start_time: int) -> None:
    last = (survey.decisions[-1].time - start_time) / _HOUR
    for region in truth.regions:
        west, east = _sides_deg(region, truth.start, np.array([0.0, last]))
        south, north = math.degrees(region.latitude_south), math.degrees(region.latitude_north)
        for index, style in ((0, "--"), (1, "-")):
            axis.plot(
                [west[index], east[index], east[index], west[index], west[index]],
                [south, south, north, north, south],
                style,
                color="0.6",
                lw=1.0,
            )
    if survey.crossings:
        points = axis.scatter(
            [crossing.longitude_deg for crossing in survey.crossings],
            [crossing.latitude_deg for crossing in survey.crossings],
            c=[(crossing.time - start_time) / _HOUR for crossing in survey.crossings],
            cmap="cividis",
            s=30,
        )
        axis.figure.colorbar(points, ax=axis, label="time (h)")
    axis.set(xlabel="longitude (deg E)", ylabel="latitude (deg)")
    place = "map of the crossings"
    if truth.regions:
        place += "; bubbles at the start (dashed) and at the end"
    axis.set_title(place, loc="left", fontsize="medium")


def _draw_altitudes(axis: Any, survey: SurveyHistory, truth: WallTruth, start_time: int) -> None:
    if truth.crossings:
        axis.plot(
            [crossing.time / 3600.0 for crossing in truth.crossings],
            [crossing.altitude / 1e3 for crossing in truth.crossings],
            "x",
            color="0.4",
            ms=4,
            label="true crossings",
        )
    for number, name in enumerate(_names(survey)):
        own = [crossing for crossing in survey.crossings if crossing.spacecraft == name]
        axis.plot(
            [(crossing.time - start_time) / _HOUR for crossing in own],
            [crossing.altitude / 1e3 for crossing in own],
            _MARKERS[number % len(_MARKERS)],
            color=AXIS_COLOURS[number % len(AXIS_COLOURS)],
            ms=6,
            mfc="none",
            label=name,
        )
    for number, plan in enumerate(survey.plans):
        axis.annotate(
            plan.reason,
            ((plan.time - start_time) / _HOUR, 1.0 - 0.08 * number),
            xycoords=("data", "axes fraction"),
            xytext=(4, -4),
            textcoords="offset points",
            va="top",
            fontsize="small",
        )
    axis.set_ylabel("altitude of the crossings (km)")
    axis.margins(y=0.25)  # for the reasons above and the legend below
    axis.legend(loc="lower right", ncols=3, fontsize="small")


def _draw_drift(axis: Any, survey: SurveyHistory, truth: WallTruth, start_time: int) -> None:
    for number, region in enumerate(truth.regions):
        if region.drift_east is not None:
            label = "true, each bubble" if number == 0 else None
            axis.axhline(region.drift_east, color="k", ls="--", lw=1.0, label=label)
    time = [(decision.time - start_time) / _HOUR for decision in survey.decisions]
    drift = np.array([decision.drift for decision in survey.decisions])
    sigma = np.array([decision.drift_sigma for decision in survey.decisions])
    axis.fill_between(
        time,
        drift - sigma,
        drift + sigma,
        step="post",
        color=STATE_COLOUR,
        alpha=0.25,
        label="one sigma",
    )
    axis.step(time, drift, where="post", color=STATE_COLOUR, label="estimate")
    axis.set_ylabel("zonal drift (m/s)")
    axis.legend(loc="upper right", ncols=3, fontsize="small")


def _names(survey: SurveyHistory) -> list[str]:
    return sorted({crossing.spacecraft for crossing in survey.crossings})
