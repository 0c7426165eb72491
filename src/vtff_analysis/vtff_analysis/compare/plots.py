"""Overlaid plots of several runs as PNG files, 1600 pixels wide."""

from __future__ import annotations

import pathlib
from collections.abc import Callable, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np

from vtff_analysis.compare.comparison import ComparedRun
from vtff_analysis.plot_style import (
    AXIS_NAMES,
    STYLE,
    length_unit,
    make_figure,
    save_figure,
    time_unit_of,
)
from vtff_dynamics.vectors import FloatArray

# Okabe-Ito colours; the line style tells runs apart without colours.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#000000")
_STYLES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (2, 1)), "-.", ":", (0, (8, 2)))

#: Times in s and values (n, 3) of a run; None where it has none.
Curves = tuple[FloatArray, FloatArray] | None


def plot_comparison(runs: Sequence[ComparedRun], folder: pathlib.Path) -> list[pathlib.Path]:
    """Draw the same quantities of all runs, each run with its own colour and line style.

    Parameters
    ----------
    runs
        At least two runs.
    folder
        Folder of the files; must exist.

    Returns
    -------
    list of pathlib.Path
        Plots of each deputy: relative position, deviation from the target, cumulative dv and
        navigation error; a quantity that no run has is left out.
    """
    deputies = sorted({name for run in runs for name in {**run.flights, **run.errors}})
    files = []
    for deputy in deputies:
        prefix = f"{deputy}_" if len(deputies) > 1 else ""
        quantities: tuple[tuple[str, str, str, Callable[[ComparedRun, str], Curves]], ...] = (
            ("position", "relative position", "m", _position),
            ("deviation", "deviation from the target", "m", _deviation),
            ("delta_v", "dv spent so far", "m/s", _spent),
            ("navigation_error", "navigated minus true position", "m", _error),
        )
        for name, title, unit, curves in quantities:
            drawn = [(run.name, curves(run, deputy)) for run in runs]
            filled = [(run_name, curve) for run_name, curve in drawn if curve is not None]
            if filled:
                path = folder / f"{prefix}compare_{name}.png"
                files.append(_draw(filled, path, f"{deputy}: {title}", unit))
    return files


def _draw(
    curves: Sequence[tuple[str, tuple[FloatArray, FloatArray]]],
    path: pathlib.Path,
    title: str,
    unit: str,
) -> pathlib.Path:
    end = max(float(time[-1]) for _, (time, _) in curves)
    factor, time_unit = time_unit_of(end)
    with mpl.rc_context(STYLE):
        figure = make_figure(9.6)
        panels = figure.subplots(3, 1, sharex=True)
        for axis, panel in enumerate(panels):
            # An outlier of one run must not set the scale of the others.
            usual = max(
                float(np.quantile(np.abs(values[:, axis]), 0.995)) for _, (_, values) in curves
            )
            scale, length = length_unit(usual) if unit == "m" else (1.0, unit)
            for number, (name, (time, values)) in enumerate(curves):
                panel.plot(
                    time * factor, values[:, axis] / scale, label=name, linewidth=1.5,
                    color=_COLOURS[number % len(_COLOURS)],
                    linestyle=_STYLES[number % len(_STYLES)],
                )  # fmt: skip
            panel.set_title(AXIS_NAMES[axis])
            panel.set_ylabel(length)
        panels[-1].set_xlabel(f"time since the start of the run ({time_unit})")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="outside lower center", ncols=min(3, len(labels)), frameon=False
        )
        return save_figure(figure, path, title)


def _position(run: ComparedRun, deputy: str) -> Curves:
    flight = run.flights.get(deputy)
    return None if flight is None else (flight.time, flight.position_rtn)


def _deviation(run: ComparedRun, deputy: str) -> Curves:
    flight = run.flights.get(deputy)
    if flight is None or flight.deviation_rtn is None or not flight.time[flight.keeping].size:
        return None
    return flight.time[flight.keeping], flight.deviation_rtn[flight.keeping]


def _spent(run: ComparedRun, deputy: str) -> Curves:
    flight = run.flights.get(deputy)
    if flight is None or not flight.thrust_time.size:
        return None
    spent = np.abs(flight.thrust_rtn) * flight.thrust_duration[:, np.newaxis]
    return flight.thrust_time + flight.thrust_duration, np.cumsum(spent, axis=0)


def _error(run: ComparedRun, deputy: str) -> Curves:
    error = run.errors.get(deputy)
    return None if error is None else (error.time, error.position_rtn)
