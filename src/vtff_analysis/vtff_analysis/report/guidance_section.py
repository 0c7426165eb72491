"""The section of a report about guidance: its phases as a table, and one picture."""

from __future__ import annotations

import math
import pathlib
from collections.abc import Callable, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np

from vtff_analysis.evaluation.guidance import (
    flown_positions,
    phases_of,
    smallest_distance,
)
from vtff_analysis.page.page import Picture, escape, render_figures, render_table
from vtff_analysis.plot_style import (
    AXIS_COLOURS,
    ESTIMATE_COLOUR,
    MARK_COLOUR,
    STYLE,
    make_figure,
    save_figure,
    time_unit_of,
)
from vtff_analysis.recordings.guidance import GuidanceHistory
from vtff_analysis.recordings.history import RunHistory

__all__ = ["draw_guidance", "render_guidance"]

_COLOURS = (*AXIS_COLOURS, ESTIMATE_COLOUR, "#E69F00", "#56B4E9", "#000000")
_MOST_REFUSALS = 20
_CAPTION = (
    "Smallest distance of any pair beside that of the plan, distance of each deputy from the "
    "wanted position, and velocity change that was commanded; dotted lines: changes of mode or "
    "formation."
)


def draw_guidance(history: RunHistory, folder: pathlib.Path, title: str) -> list[Picture]:
    """Draw distances, deviations and velocity changes over time; nothing without guidance."""
    guidance = history.guidance
    if guidance is None or len(guidance.time) < 2:
        return []
    flown = flown_positions(history, guidance)
    end = (guidance.time[-1] - history.start_time) * 1e-9
    factor, unit = time_unit_of(float(end))
    time = (guidance.time - history.start_time) * 1e-9 * factor
    with mpl.rc_context(STYLE):
        figure = make_figure(9.5)
        axes: Any = figure.subplots(3, 1, sharex=True)
        axes[0].plot(time, smallest_distance(flown), color=AXIS_COLOURS[0], label="flown")
        axes[0].plot(
            time,
            guidance.closest_approach,
            color=AXIS_COLOURS[1],
            linestyle="--",
            label="closest approach of the plan",
        )
        axes[0].set(ylabel="smallest distance\nof a pair (m)")
        for column, name in enumerate(guidance.spacecraft):
            colour = _COLOURS[column % len(_COLOURS)]
            if column:
                difference = flown[:, column] - guidance.position_rtn[:, column]
                lengths = np.linalg.norm(difference, axis=-1)
                axes[1].plot(time, 1e2 * lengths, color=colour, label=name)
            change = 1e3 * guidance.velocity_change[:, column]
            axes[2].plot(time, change, color=colour, label=name)
        axes[1].set_ylabel("from the wanted\nposition (cm)")
        axes[2].set(ylabel="velocity change (mm/s)", xlabel=f"time since the start ({unit})")
        phases = phases_of(guidance, flown)
        for axis in axes:
            for phase in phases[1:]:
                at = (phase.first - history.start_time) * 1e-9 * factor
                axis.axvline(at, color=MARK_COLOUR, linestyle=":", linewidth=1.0)
            if axis.get_legend_handles_labels()[0]:
                axis.legend(loc="best")
        axes[0].set_title(" | ".join(phase.name for phase in phases[:6]))
        path = save_figure(figure, folder / "guidance.png", f"{title}: guidance")
    return [Picture(path, _CAPTION, "guidance")]


def render_guidance(history: RunHistory, pictures: Sequence[Picture]) -> str:
    """Return the HTML of the section; empty without guidance."""
    guidance = history.guidance
    if guidance is None:
        return ""
    phases = phases_of(guidance, flown_positions(history, guidance))
    seconds: Callable[[int], str] = lambda time: f"{(time - history.start_time) * 1e-9:.0f} s"  # noqa: E731
    rows = []
    for phase in phases:
        spent = phase.velocity_change
        rows.append(
            [
                phase.name,
                f"{seconds(phase.first)} to {seconds(phase.last)}",
                _metres(phase.planned_closest),
                _metres(phase.flown_closest),
                " / ".join(f"{1e3 * value:.2f}" for value in spent.values()),
                f"{1e3 * sum(spent.values()):.2f}",
                " / ".join(f"{1e2 * value:.1f}" for value in phase.deviation.values()),
            ]
        )
    heads = [
        "mode, formation",
        "from, to",
        "closest, planned",
        "closest, flown",
        f"velocity change, mm/s: {' / '.join(guidance.spacecraft)}",
        "sum, mm/s",
        f"RMS from the wanted position, cm: {' / '.join(guidance.spacecraft[1:])}",
    ]
    return (
        render_table(heads, rows)
        + _render_reasons(guidance, history.start_time)
        + render_figures(pictures, "guidance")
    )


def _metres(value: float) -> str:
    return f"{value:.2f} m" if math.isfinite(value) else ""


def _render_reasons(guidance: GuidanceHistory, start_time: int) -> str:
    """Return why modes changed or requests were refused, in the order of time."""
    reasons = np.array(guidance.reason)
    changed = np.flatnonzero((reasons[1:] != reasons[:-1]) & (reasons[1:] != "")) + 1
    rows = [0, *changed.tolist()] if reasons.size and reasons[0] else changed.tolist()
    items = "".join(
        f"<li>{(guidance.time[row] - start_time) * 1e-9:.0f} s: {escape(guidance.reason[row])}</li>"
        for row in rows[:_MOST_REFUSALS]
    )
    return f"<ul>{items}</ul>" if items else ""
