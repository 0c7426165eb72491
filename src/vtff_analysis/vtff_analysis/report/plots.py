"""Plots of formation flight and tracked satellites as PNG files, 1600 pixels wide."""

from __future__ import annotations

import pathlib
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vtff_analysis.evaluation.formation_flight import FormationFlight
from vtff_analysis.paper_reference import paper_columns
from vtff_analysis.plot_style import (
    AXIS_COLOURS,
    AXIS_NAMES,
    AXIS_STYLES,
    ESTIMATE_COLOUR,
    MARK_COLOUR,
    STATE_COLOUR,
    STYLE,
    length_unit,
    make_figure,
    save_figure,
    time_unit_of,
)
from vtff_analysis.recordings.history import ReceiverHistory
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.signals import satellite_from_number, satellite_name, satellite_number

ACQUISITION_VIEW = 150.0
"""Length in s of the close view, which shows the whole acquisition."""

_TRACKING_CELLS = 1200
"""Most cells along the time axis of the tracking plot, about one per pixel."""

_FAR_OUTSIDE = 20.0
"""A largest deviation this many times the 90 % quantile asks for a logarithmic axis."""


def plot_formation(
    flight: FormationFlight,
    folder: pathlib.Path,
    prefix: str = "",
    run_name: str = "",
    scenario: str = "",
    acceleration_cap: float | None = None,
) -> list[pathlib.Path]:
    """Draw relative position, thrust and keeping error of one deputy.

    Parameters
    ----------
    flight
        Flight of the deputy.
    folder
        Folder of the files; must exist.
    prefix
        Stands before the file names in a run with several deputies.
    run_name
        Name of the run for the titles.
    scenario
        Name of the scenario; marks the paper's closest approach where it has one.
    acceleration_cap
        Cap of each axis in m/s2, drawn as a limit; None where it is not recorded.

    Returns
    -------
    list of pathlib.Path
        The files written: in the form of figure A1 of the paper
        (``relative_position_and_thrust.png``), by axis (``relative_position.png``), and, if the
        run has a keeping phase and a target, ``keeping_error.png``.
    """
    title = f"{run_name}: {flight.name} relative to the chief"
    files = []
    with mpl.rc_context(STYLE):
        figure = _draw_position_and_thrust(flight, scenario, acceleration_cap)
        files.append(
            save_figure(figure, folder / f"{prefix}relative_position_and_thrust.png", title)
        )
        figure = _draw_position_by_axis(flight)
        files.append(save_figure(figure, folder / f"{prefix}relative_position.png", title))
        if flight.deviation_rtn is not None and flight.time[flight.keeping].size > 1:
            title = f"{run_name}: deviation of {flight.name} from its target while keeping"
            figure = _draw_keeping_error(flight)
            files.append(save_figure(figure, folder / f"{prefix}keeping_error.png", title))
    return files


def plot_receiver(
    history: ReceiverHistory, folder: pathlib.Path, prefix: str = "", run_name: str = ""
) -> pathlib.Path | None:
    """Draw which satellites a receiver tracked, when, and how strongly.

    Parameters
    ----------
    history
        Its observations.
    folder
        Folder of the file; must exist.
    prefix
        Stands before the file name.
    run_name
        Name of the run for the title.

    Returns
    -------
    pathlib.Path or None
        ``gnss_tracking.png``; None if there is no observation.
    """
    if history.system.size == 0:
        return None
    with mpl.rc_context(STYLE):
        title = f"{run_name}: satellites tracked by {history.name}"
        return save_figure(_draw_tracking(history), folder / f"{prefix}gnss_tracking.png", title)


def _draw_position_and_thrust(
    flight: FormationFlight, scenario: str, acceleration_cap: float | None
) -> Figure:
    """Draw figure A1: (A) position, (B) thrust, of the whole run and of the acquisition."""
    has_thrust = bool(flight.thrust_time.size)
    figure = make_figure(8.4 if has_thrust else 4.6)
    views = _views(flight)
    axes = figure.subplots(1 + has_thrust, len(views), squeeze=False, sharey="row", sharex="col")
    scale, unit = length_unit(np.abs(flight.position_rtn).max())
    for column, (name, end) in enumerate(views):
        factor, time_unit = time_unit_of(end)
        upper, lower = axes[0, column], axes[-1, column]
        for axis in range(3):
            style = {"color": AXIS_COLOURS[axis], "linestyle": AXIS_STYLES[axis]}
            upper.plot(
                flight.time * factor, flight.position_rtn[:, axis] / scale,
                label=AXIS_NAMES[axis], **style,
            )  # fmt: skip
            if has_thrust:
                time, thrust = _thrust_line(flight, axis)
                lower.step(time * factor, thrust, where="post", label=AXIS_NAMES[axis], **style)
        if acceleration_cap is not None and acceleration_cap < 2.0 * np.abs(flight.thrust_rtn).max(
            initial=0.0
        ):
            for limit in (-acceleration_cap, acceleration_cap):
                lower.axhline(limit, color=MARK_COLOUR, linewidth=1.0, linestyle=":")
        for panel in axes[:, column]:
            _mark_keeping(panel, flight, factor, end)
            panel.set_xlim(0.0, end * factor)
        upper.set_title(f"A  relative position, {name}")
        if has_thrust:
            lower.set_title(f"B  applied thrust, {name}")
        lower.set_xlabel(f"time since the start ({time_unit})")
    axes[0, 0].set_ylabel(f"position ({unit})")
    if has_thrust:
        axes[1, 0].set_ylabel("acceleration (m/s²)")
    _mark_closest(axes[0, -1], flight, scenario, scale, views[-1][1])
    axes[0, 0].legend(loc="best")
    return figure


def _draw_position_by_axis(flight: FormationFlight) -> Figure:
    """Draw radial, in-track and cross-track position in own panels, with target and estimate."""
    figure = make_figure(10.0)
    views = _views(flight)
    axes = figure.subplots(3, len(views), squeeze=False, sharex="col")
    for axis in range(3):
        values = flight.position_rtn[:, axis]
        scale, unit = length_unit(np.abs(values).max())
        for column, (name, end) in enumerate(views):
            panel = axes[axis, column]
            factor, time_unit = time_unit_of(end)
            if flight.estimate_time is not None and flight.estimate_rtn is not None:
                panel.plot(
                    flight.estimate_time * factor, flight.estimate_rtn[:, axis] / scale,
                    color=ESTIMATE_COLOUR, linewidth=1.2, label="navigated",
                )  # fmt: skip
            panel.plot(
                flight.time * factor, values / scale, color=STATE_COLOUR, label=flight.source
            )
            if flight.deviation_rtn is not None:
                target = values - flight.deviation_rtn[:, axis]
                panel.plot(
                    flight.time * factor, target / scale,
                    color=MARK_COLOUR, linewidth=1.2, linestyle="--", label="target",
                )  # fmt: skip
            _mark_keeping(panel, flight, factor, end)
            panel.set_xlim(0.0, end * factor)
            panel.set_title(f"{AXIS_NAMES[axis]}, {name}")
            if axis == 2:
                panel.set_xlabel(f"time since the start ({time_unit})")
        axes[axis, 0].set_ylabel(f"position ({unit})")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper right", ncols=3, frameon=False)
    return figure


def _draw_keeping_error(flight: FormationFlight) -> Figure:
    """Draw the deviation from the target, logarithmic where it decays over orders of magnitude."""
    assert flight.deviation_rtn is not None
    figure = make_figure(9.6)
    panels = figure.subplots(3, 1, sharex=True)
    factor, time_unit = time_unit_of(float(flight.time[-1]))
    time = flight.time[flight.keeping] * factor
    for axis, panel in enumerate(panels):
        deviation = flight.deviation_rtn[flight.keeping, axis]
        rms = float(np.sqrt(np.mean(deviation**2)))
        scale, unit = length_unit(float(np.abs(deviation).max()))
        panel.axhline(0.0, color=MARK_COLOUR, linewidth=1.0)
        panel.plot(time, deviation / scale, color=AXIS_COLOURS[axis])
        form = _choose_scale(panel, deviation / scale, unit)
        numbers = f"RMS {rms / scale:.3g} {unit}, mean {deviation.mean() / scale:.3g} {unit}"
        numbers = numbers.replace("-", "\N{MINUS SIGN}")
        panel.set_title(f"{AXIS_NAMES[axis]}: {numbers}{form}")
        panel.set_ylabel(f"deviation ({unit})")
        panel.set_xlim(time[0], time[-1])
    panels[-1].set_xlabel(f"time since the start ({time_unit})")
    return figure


def _choose_scale(panel: Axes, values: FloatArray, unit: str) -> str:
    """Make the axis logarithmic beyond the usual values if some values are far outside.

    Returns a note for the title; empty where the axis stays linear.
    """
    usual = float(np.quantile(np.abs(values), 0.9))
    largest = float(np.abs(values).max())
    if usual == 0.0 or largest < _FAR_OUTSIDE * usual:
        return ""
    limit = 10.0 ** np.ceil(np.log10(usual))
    panel.set_yscale("symlog", linthresh=limit, linscale=1.5)
    decades = int(np.ceil(np.log10(largest / limit)))
    above = [limit * 10.0**power for power in range(decades + 1)]
    ticks = [sign * tick for sign in (-1, 1) for tick in above]
    panel.set_yticks([0.0, -0.5 * limit, 0.5 * limit, *ticks])
    panel.yaxis.set_major_formatter("{x:g}")
    margin = 1.3
    panel.set_ylim(
        min(margin * values.min(), -1.1 * limit), max(margin * values.max(), 1.1 * limit)
    )
    return f" (logarithmic beyond ± {limit:g} {unit})"


def _draw_tracking(history: ReceiverHistory) -> Figure:
    """Draw one row per satellite, coloured by its strongest signal."""
    numbers = satellite_number(history.system, history.prn)
    satellites, row = np.unique(numbers, return_inverse=True)
    seconds = (history.epoch_time - history.epoch_time.min()) * 1e-9
    end = float(seconds.max())
    intervals = np.diff(np.unique(seconds))
    cell = max(end / _TRACKING_CELLS, float(np.median(intervals)) if intervals.size else 1.0)
    column = np.round(seconds / cell).astype(np.int64)
    strongest = np.full((len(satellites), int(column.max()) + 1), np.nan)
    column = np.repeat(column, history.observations_per_epoch)
    np.fmax.at(strongest, (row, column), history.cn0_dbhz)
    factor, time_unit = time_unit_of(end)
    edges = (np.arange(strongest.shape[1] + 1) - 0.5) * cell * factor
    figure = make_figure(max(4.0, 1.8 + 0.27 * len(satellites)))
    panel = figure.subplots()
    rows = np.arange(len(satellites) + 1) - 0.5
    mesh = panel.pcolormesh(edges, rows, strongest, cmap="viridis")
    panel.grid(False)
    panel.hlines(rows, edges[0], edges[-1], color="white", linewidth=6.0)
    names = [satellite_name(*satellite_from_number(number)) for number in satellites]
    panel.set_yticks(range(len(names)), names, fontsize=11.0)
    panel.set_ylim(len(names) - 0.4, -0.6)
    panel.set_xlabel(f"time since the first epoch ({time_unit})")
    figure.colorbar(mesh, label="C/N0 (dB-Hz)", pad=0.01)
    return figure


def _views(flight: FormationFlight) -> Sequence[tuple[str, float]]:
    """Return name and end in s of each column: the whole run, and its beginning if it is long."""
    end = max(float(flight.time[-1]), 1.0)
    if end <= 2.0 * ACQUISITION_VIEW:
        return [("whole run", end)]
    return [("whole run", end), (f"first {ACQUISITION_VIEW:.0f} s", ACQUISITION_VIEW)]


def _thrust_line(flight: FormationFlight, axis: int) -> tuple[FloatArray, FloatArray]:
    """Return times and values of the steps of the thrust; the last value ends the last step."""
    end = flight.thrust_time[-1] + flight.thrust_duration[-1]
    values = flight.thrust_rtn[:, axis]
    return np.append(flight.thrust_time, end), np.append(values, values[-1])


def _mark_keeping(panel: Axes, flight: FormationFlight, factor: float, end: float) -> None:
    """Draw the begin of the keeping phase, which only a flight with a target has."""
    if flight.deviation_rtn is None or flight.keeping_start >= end:
        return
    panel.axvline(flight.keeping_start * factor, color=MARK_COLOUR, linewidth=1.0, alpha=0.6)
    if end <= 2.0 * ACQUISITION_VIEW:
        # The label stands above the panel, where no curve runs through it.
        panel.annotate(
            "keeping", (flight.keeping_start * factor, 1.0), (0.0, 3.0),
            xycoords=("data", "axes fraction"), textcoords="offset points",
            ha="center", va="bottom", fontsize=11.0, color=MARK_COLOUR,
        )  # fmt: skip


def _mark_closest(
    panel: Axes, flight: FormationFlight, scenario: str, scale: float, end: float
) -> None:
    """Mark the smallest in-track position, and the paper's where it has one."""
    minimum, time = flight.minimum_in_track()
    for column in paper_columns(scenario):
        if "minimum_in_track_m" not in column.values or time > end:
            continue
        factor, _ = time_unit_of(end)
        panel.plot(
            time * factor, minimum / scale, "o", color=AXIS_COLOURS[1], markersize=7.0,
            label=f"closest in-track: {minimum:.2f} m at {time:.0f} s",
        )  # fmt: skip
        printed = column.values["minimum_in_track_m"]
        printed_time = column.values["minimum_in_track_time_s"]
        panel.plot(
            printed_time * factor, printed / scale, "o", color="black", markersize=12.0,
            fillstyle="none", label=f"paper: {printed:.2f} m at {printed_time:.0f} s",
        )  # fmt: skip
        handles, labels = panel.get_legend_handles_labels()
        panel.legend(handles[-2:], labels[-2:], loc="upper right")
        return
