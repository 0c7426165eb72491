"""Plots of navigation, sky, ionosphere and timing as PNG files, 1600 pixels wide."""

from __future__ import annotations

import pathlib
from collections.abc import Mapping
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter

from vtff_analysis.evaluation.gnss_summary import signal_names
from vtff_analysis.evaluation.navigation import NavigationError
from vtff_analysis.plot_style import (
    AXIS_COLOURS,
    AXIS_NAMES,
    MARK_COLOUR,
    STATE_COLOUR,
    STYLE,
    length_unit,
    make_figure,
    save_figure,
    time_unit_of,
)
from vtff_analysis.recordings.history import (
    NavigationHistory,
    ReceiverHistory,
    SatelliteColumns,
    TimeArray,
)
from vtff_analysis.tec.processing import rejection_counts
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.signals import satellite_from_number, satellite_name, satellite_number
from vtff_iono.geometry.satellite_geometry import satellite_geometry
from vtff_nav.relative.common.solution import SOLUTION_FIXED, SOLUTION_NAMES, SOLUTION_PREDICTED

SKY_EPOCHS = 300
"""Largest number of epochs in a sky plot."""

REASONS = 2
"""Largest number of reasons for rejection that are named."""

LINES = 12
"""Largest number of satellites in colour; the others are grey and behind them."""

# Tol's muted colours with black: twelve colours that differ with any colour vision.
_SATELLITE_COLOURS = (
    "#332288", "#88CCEE", "#44AA99", "#117733", "#999933", "#DDCC77",
    "#CC6677", "#882255", "#AA4499", "#000000", "#0072B2", "#D55E00",
)  # fmt: skip

# Okabe-Ito colours without the yellow, which is too faint on white; a mark tells the signals
# apart where two colours are alike.
_SIGNAL_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
_SIGNAL_MARKS = ("o", "s", "^", "D", "v", "P", "X", "*")
_ELEVATION_STEP_DEG = 5.0  # of the medians of C/N0
_MEDIANS = 30  # over the time of a figure
_ROW_FILL = 0.55  # share of the row of a node that its histogram fills; its text is above


def plot_navigation_error(
    error: NavigationError, folder: pathlib.Path, prefix: str, title: str
) -> pathlib.Path:
    """Draw position and velocity errors by axis with the 3-sigma bounds of navigation."""
    with mpl.rc_context(STYLE):
        figure = make_figure(9.6)
        axes = figure.subplots(3, 2, sharex=True)
        factor, time_unit = time_unit_of(float(error.time[-1]))
        kinds = (
            ("position", "", error.position_rtn, error.position_sigma_rtn),
            ("velocity", "/s", error.velocity_rtn, error.velocity_sigma_rtn),
        )
        for column, (what, per, values, sigma) in enumerate(kinds):
            # Errors are large while a filter starts: the scale is that of the later ones.
            settled = values[len(values) // 5 :]
            for axis in range(3):
                panel = axes[axis, column]
                bound = 3.0 * sigma[:, axis]
                usual = max(
                    float(np.abs(settled[:, axis]).max()),
                    float(np.quantile(bound, 0.8)),
                    1e-9,
                )
                scale, unit = length_unit(usual)
                if bound.any():
                    panel.fill_between(
                        error.time * factor, -bound / scale, bound / scale,
                        color="0.85", linewidth=0.0, label="±3 sigma as stated",
                    )  # fmt: skip
                panel.plot(error.time * factor, values[:, axis] / scale, color=AXIS_COLOURS[axis])
                panel.set_ylim(-1.5 * usual / scale, 1.5 * usual / scale)
                counted = error.is_settled
                counted = counted if counted.any() else ~counted
                rms = float(np.sqrt(np.mean(values[counted, axis] ** 2)))
                after = "" if counted.all() else " after 60 s"
                panel.set_title(
                    f"{AXIS_NAMES[axis]} {what}: RMS{after} {rms / scale:.3g} {unit}{per}"
                )
                panel.set_ylabel(f"error ({unit}{per})")
            axes[2, column].set_xlabel(f"time since the start ({time_unit})")
        if error.position_sigma_rtn.any():
            axes[0, 0].legend(loc="upper right")
        return save_figure(figure, folder / f"{prefix}navigation_error.png", title)


def plot_navigation_quality(
    quality: NavigationHistory, start: int, folder: pathlib.Path, prefix: str, title: str
) -> pathlib.Path:
    """Draw kind of solution, satellites and ambiguities, and innovations over time."""
    with mpl.rc_context(STYLE):
        figure = make_figure(8.4)
        upper, middle, lower = figure.subplots(3, 1, sharex=True, height_ratios=(2, 3, 3))
        time = (quality.time - start) * 1e-9
        factor, time_unit = time_unit_of(float(time[-1]))
        time = time * factor
        upper.plot(time, quality.solution, ".", color=STATE_COLOUR, markersize=4.0)
        kinds = range(SOLUTION_PREDICTED, SOLUTION_FIXED + 1)
        upper.set_yticks(kinds, [SOLUTION_NAMES[kind] for kind in kinds])
        upper.set_ylim(0.5, 4.5)
        fixed = float((quality.solution == SOLUTION_FIXED).mean())
        upper.set_title(f"kind of solution: fixed {100.0 * fixed:.1f} % of the time")
        middle.step(
            time, quality.ambiguities_fixed, where="post", color=AXIS_COLOURS[2],
            label="ambiguities fixed",
        )  # fmt: skip
        middle.step(
            time, quality.satellites_used, where="post", color=AXIS_COLOURS[0],
            label="satellites used",
        )  # fmt: skip
        middle.set_ylabel("number")
        middle.legend(loc="best")
        lower.plot(time, quality.innovation_rms, color=AXIS_COLOURS[1])
        lower.axhline(1.0, color=MARK_COLOUR, linewidth=1.0, linestyle=":")
        lower.set_title("innovations: 1 where they are as large as the filter expects")
        lower.set_ylabel("RMS (predicted sigma)")
        lower.set_xlabel(f"time since the start ({time_unit})")
        return save_figure(figure, folder / f"{prefix}navigation_quality.png", title)


def plot_sky(
    history: ReceiverHistory, folder: pathlib.Path, prefix: str, title: str
) -> pathlib.Path | None:
    """Draw where the satellites stood, coloured by C/N0, and C/N0 over elevation by signal.

    Returns
    -------
    pathlib.Path or None
        ``sky.png``; None without fixes or ephemerides to compute it from.
    """
    points = _compute_sky(history)
    if points is None:
        return None
    with mpl.rc_context(STYLE):
        figure = make_figure(6.4)
        sky = figure.add_subplot(1, 2, 1, projection="polar")
        sky.set_theta_zero_location("N")  # type: ignore[attr-defined]
        sky.set_theta_direction(-1)  # type: ignore[attr-defined]
        lowest = min(0.0, np.floor(points.elevation_deg.min() / 10.0) * 10.0)
        distance = 90.0 - points.elevation_deg
        marks = sky.scatter(points.azimuth, distance, c=points.cn0_dbhz, s=7.0, cmap="viridis")
        sky.set_ylim(0.0, 90.0 - lowest)
        rings = [value for value in (60.0, 30.0, 0.0, lowest) if value >= lowest]
        sky.set_yticks([90.0 - ring for ring in rings], [f"{ring:.0f}°" for ring in rings])
        sky.set_xticks(np.radians([0.0, 90.0, 180.0, 270.0]), ["N", "E", "S", "W"])
        for name, row in points.first_rows.items():
            sky.annotate(name, (points.azimuth[row], distance[row]), fontsize=8.0, color="0.2")
        _draw_signal_strength(figure.add_subplot(1, 2, 2), points)
        figure.colorbar(marks, ax=sky, label="C/N0 (dB-Hz)", pad=0.12, shrink=0.8)
        return save_figure(figure, folder / f"{prefix}sky.png", title)


def _draw_signal_strength(panel: Axes, points: _SkyPoints) -> None:
    """Draw samples of C/N0 over elevation, and the median of each signal as a line with marks."""
    for index, name in enumerate(sorted(set(points.signal))):
        chosen = points.signal == name
        colour = _SIGNAL_COLOURS[index % len(_SIGNAL_COLOURS)]
        mark = _SIGNAL_MARKS[index % len(_SIGNAL_MARKS)]
        elevation_deg, cn0_dbhz = points.elevation_deg[chosen], points.cn0_dbhz[chosen]
        panel.plot(elevation_deg, cn0_dbhz, ".", color=colour, alpha=0.15, markersize=2.5)
        middles, medians = _medians(elevation_deg, cn0_dbhz, _ELEVATION_STEP_DEG)
        panel.plot(
            middles, medians, color=colour, marker=mark, markersize=7.0, linewidth=1.4,
            markeredgecolor="white", markeredgewidth=0.6, label=name,
        )  # fmt: skip
    panel.set_xlabel("elevation (°)")
    panel.set_ylabel("C/N0 (dB-Hz)")
    panel.set_title("signal strength; lines: medians")
    panel.legend(loc="lower right", ncols=2, handlelength=2.6)


def _medians(places: FloatArray, values: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """Return the middles of the steps along an axis that have values, and the median in each."""
    known = np.isfinite(values)
    numbers = np.floor(places[known] / step)
    found = np.unique(numbers)
    medians = [np.median(values[known][numbers == number]) for number in found]
    return (found + 0.5) * step, np.array(medians)


def plot_satellite_values(
    columns: SatelliteColumns,
    panels: Mapping[str, tuple[str, str]],
    start: int,
    path: pathlib.Path,
    title: str,
    has_medians: bool = False,
) -> pathlib.Path | None:
    """Draw columns over time, one colour for each satellite.

    Rejected samples are left out, and the title of the first panel counts them with their reasons:
    until the bias of a receiver is known, its content is off by up to tens of TECU. Where no
    sample is good, all are drawn in grey.

    Parameters
    ----------
    columns
        Slant TEC or scintillation indices.
    panels
        Title and axis label of a panel by its column; columns without a value are left out.
    start
        Zero of the time axis, ns since 1970.
    path
        PNG file.
    title
        Title of the figure.
    has_medians
        Draw running medians as lines and the samples pale: for samples whose noise hides how the
        satellites differ.

    Returns
    -------
    pathlib.Path or None
        None if no column has a value.
    """
    end = (columns.time.max() - start) * 1e-9 if columns.time.size else 0.0
    columns, remark, all_rejected = _select_good(columns)
    wanted = {
        name: text
        for name, text in panels.items()
        if np.isfinite(columns.values[name]).any() and np.nanmax(np.abs(columns.values[name])) > 0
    }
    if not wanted:
        return None
    satellites = satellite_number(columns.system, columns.prn)
    numbers, counts = np.unique(satellites, return_counts=True)
    longest = set(numbers[np.argsort(counts)[::-1][:LINES]].tolist())
    seconds = (columns.time - start) * 1e-9
    factor, time_unit = time_unit_of(float(end))
    with mpl.rc_context(STYLE):
        figure = make_figure(1.4 + 3.2 * len(wanted))
        drawn = figure.subplots(len(wanted), 1, sharex=True, squeeze=False)[:, 0]
        for panel, (name, (text, label)) in zip(drawn, wanted.items(), strict=True):
            colours = iter(_SATELLITE_COLOURS)
            for number in numbers.tolist():
                rows = satellites == number
                named = number in longest
                colour = next(colours) if named and not all_rejected else "0.75"
                label_of_satellite = satellite_name(*satellite_from_number(number))
                times, values = seconds[rows] * factor, columns.values[name][rows]
                panel.plot(
                    times, values, ".", markersize=2.5 if named else 1.5, color=colour,
                    zorder=3 if named else 2, alpha=0.2 if has_medians else None,
                    label=label_of_satellite if named and not has_medians else None,
                )  # fmt: skip
                if has_medians and named and end > 0.0:
                    # A little longer, so that the last sample has no median of its own.
                    step = 1.000001 * end * factor / _MEDIANS
                    panel.plot(
                        *_medians(times, values, step), color=colour, linewidth=1.4, zorder=4,
                        label=label_of_satellite,
                    )  # fmt: skip
            if has_medians:
                text += f"; lines: medians of {end / _MEDIANS:.0f} s"
            panel.set_title(text + (remark if panel is drawn[0] else ""))
            panel.set_ylabel(label)
        drawn[-1].set_xlim(-0.02 * end * factor, 1.02 * end * factor)
        drawn[-1].set_xlabel(f"time since the start ({time_unit})")
        figure.legend(
            *drawn[0].get_legend_handles_labels(),
            loc="outside right upper", markerscale=4.0, frameon=False,
        )  # fmt: skip
        return save_figure(figure, path, title)


def _select_good(columns: SatelliteColumns) -> tuple[SatelliteColumns, str, bool]:
    """Return the good samples, a remark on the others, and whether there were only others."""
    reasons = columns.values.get("rejected")
    if reasons is None:
        return columns, "", False
    rejected = reasons > 0  # NaN where the topic has no such column
    if not rejected.any():
        return columns, "", False
    counts = rejection_counts(reasons[rejected].astype(np.uint16))
    names = sorted(counts, key=lambda name: -counts[name])[:REASONS]
    counted = ", ".join(name.lower().replace("_", " ") for name in names)
    share = f"{100.0 * rejected.mean():.0f} % of the samples"
    if rejected.all():
        return columns, f":\nall samples were rejected (mostly: {counted})", True
    good = ~rejected
    kept = SatelliteColumns(
        columns.time[good],
        columns.system[good],
        columns.prn[good],
        {name: values[good] for name, values in columns.values.items()},
    )
    return kept, f":\n{share} are rejected and not shown (mostly: {counted})", False


def plot_compute_time(
    compute_time: Mapping[str, FloatArray], folder: pathlib.Path, title: str
) -> pathlib.Path:
    """Draw how long the nodes took for a step: a histogram each, on one logarithmic time axis."""
    positive = {node: times[times > 0.0] * 1e3 for node, times in compute_time.items()}
    filled = np.concatenate(list(positive.values())) if positive else np.empty(0)
    low, high = (filled.min(), filled.max()) if filled.size else (1e-3, 1.0)
    bins = np.geomspace(0.8 * low, 1.25 * high, 90)
    with mpl.rc_context(STYLE):
        figure = make_figure(1.6 + 0.75 * len(positive))
        panel = figure.subplots()
        for row, (node, milliseconds) in enumerate(positive.items()):
            text = "no step"
            if milliseconds.size:
                counts, _ = np.histogram(milliseconds, bins)
                heights = row - _ROW_FILL * counts / counts.max()  # the axis points downwards
                panel.stairs(heights, bins, baseline=row, fill=True, color=STATE_COLOUR)
                median, late = np.quantile(milliseconds, [0.5, 0.99])
                panel.plot([median] * 2, [row, row - _ROW_FILL], color=AXIS_COLOURS[1], lw=1.5)
                text = f"median {median:.3g}, 99 % below {late:.3g}, longest "
                text += f"{milliseconds.max():.3g} ms"
            panel.text(
                0.0, row - _ROW_FILL, f" {node}: {text}", va="bottom",
                transform=panel.get_yaxis_transform(),
            )  # fmt: skip
            panel.axhline(row, color=MARK_COLOUR, linewidth=0.8)
        panel.set_xscale("log")
        panel.set_xlim(bins[0], bins[-1])
        panel.set_ylim(max(len(positive), 1) - 0.9, -1.0)
        panel.set_yticks([])
        panel.set_xlabel("wall time for one step (ms); heights: share of the steps of each node")
        panel.xaxis.set_major_formatter("{x:g}")
        panel.xaxis.set_minor_formatter(NullFormatter())
        return save_figure(figure, folder / "timing.png", title)


class _SkyPoints(NamedTuple):
    """Observed signals with their directions, a row each.

    Attributes
    ----------
    elevation_deg, azimuth, cn0_dbhz
        deg, rad and dB-Hz, shape (n,).
    signal
        RINEX names of the signals as ``G1C``, shape (n,).
    first_rows
        First row of each satellite by its name.
    """

    elevation_deg: FloatArray
    azimuth: FloatArray
    cn0_dbhz: FloatArray
    signal: npt.NDArray[np.str_]
    first_rows: dict[str, int]


def _compute_sky(history: ReceiverHistory) -> _SkyPoints | None:
    """Return the sky positions of the observed signals at up to `SKY_EPOCHS` epochs.

    None without fixes, ephemerides or observations.
    """
    usable = np.isfinite(history.fix_position_itrf).all(axis=1)
    if not usable.any() or not history.ephemerides or not history.epoch_time.size:
        return None
    store = EphemerisStore(history.ephemerides, healthy_only=False)
    epoch = np.unique(np.linspace(0, history.epoch_time.size - 1, SKY_EPOCHS).astype(np.int64))
    epochs = np.isin(np.arange(history.epoch_time.size), epoch)
    rows = np.repeat(epochs, history.observations_per_epoch)
    time = np.repeat(history.epoch_time, history.observations_per_epoch)[rows]
    system, prn, cn0 = history.system[rows], history.prn[rows], history.cn0_dbhz[rows]
    nearest = _index_before(history.fix_time[usable], time)
    geometry = satellite_geometry(
        store,
        _gps_nanoseconds(time),
        system,
        prn,
        history.fix_position_itrf[usable][nearest],
    )
    computed = np.isfinite(geometry.elevation)
    if not computed.any():
        return None
    numbers = satellite_number(system, prn)[computed]
    satellites, first_rows = np.unique(numbers, return_index=True)
    names = [satellite_name(*satellite_from_number(number)) for number in satellites]
    return _SkyPoints(
        np.degrees(geometry.elevation[computed]),
        geometry.azimuth[computed],
        cn0[computed].astype(float),
        signal_names(system, history.band[rows], history.attribute[rows])[computed],
        dict(zip(names, first_rows.tolist(), strict=True)),
    )


def _index_before(times: TimeArray, wanted: TimeArray) -> TimeArray:
    """Return the index of the last of `times` not after each wanted time, else of the first."""
    order = np.argsort(times, kind="stable")
    position = np.searchsorted(times[order], wanted, side="right") - 1
    return np.asarray(order[np.maximum(position, 0)])


def _gps_nanoseconds(time: TimeArray) -> TimeArray:
    """Return the GPS times (ns since 1980) of stamps (ns since 1970).

    Each distinct stamp is converted once: an epoch has many rows.
    """
    distinct, inverse = np.unique(time, return_inverse=True)
    gps = [GpsTime.from_unix_nanoseconds(int(value)).nanoseconds for value in distinct]
    return np.array(gps, dtype=np.int64)[inverse]
