"""Plots of `vtff tec`."""

from __future__ import annotations

import pathlib

import numpy as np
import numpy.typing as npt
from matplotlib import rc_context

from vtff_analysis.plot_style import AXIS_COLOURS, STYLE, make_figure, save_figure
from vtff_analysis.tec.processing import TecResult
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime

__all__ = ["write_plots"]

# Most epochs in a plot, whose axes are 1400 pixels wide.
_EPOCHS_DRAWN = 3000
_NANOSECONDS_PER_HOUR = 3600.0 * NANOSECONDS_PER_SECOND


def write_plots(result: TecResult, folder: pathlib.Path, name: str) -> list[pathlib.Path]:
    """Plot vertical and slant content and ROTI against time; return the files."""
    content = result.content
    time = content.rows.pairs.time
    hours = (time - result.source.table.time_nanoseconds[0]) / _NANOSECONDS_PER_HOUR
    unit, factor = ("h", 1.0) if np.ptp(hours) > 2.0 else ("min", 60.0)
    good = (content.rejected == 0) & np.isfinite(content.vtec_tecu) & _select_drawn(time)
    with rc_context(STYLE):
        figure = make_figure(9.5)
        axes = figure.subplots(3, 1, sharex=True)
        for axis, values, label in (
            (axes[0], content.vtec_tecu, "vertical TEC, TECU"),
            (axes[1], content.stec_tecu, "slant TEC, TECU"),
        ):
            points = axis.scatter(
                factor * hours[good], values[good], c=np.degrees(content.rows.elevation[good]),
                s=3.0, cmap="cividis", vmin=0.0, vmax=90.0, rasterized=True,
            )  # fmt: skip
            axis.set_ylabel(label)
        figure.colorbar(points, ax=axes[:2], label="elevation, deg", ticks=[0, 30, 60, 90])
        ends = result.roti["time_nanoseconds"] - result.source.table.time_nanoseconds[0]
        axes[2].plot(
            factor * ends / _NANOSECONDS_PER_HOUR,
            result.roti["roti_tecu_per_minute"],
            ".", color=AXIS_COLOURS[1], markersize=3.0,
        )  # fmt: skip
        axes[2].set_ylabel("ROTI, TECU/min")
        # ROTI is about 0.05 in a quiet ionosphere and 5 in a plasma bubble.
        axes[2].set_yscale("log")
        start = GpsTime(int(result.source.table.time_nanoseconds[0]))
        axes[2].set_xlabel(f"{unit} since {str(start)[:19]} GPS")
        axes[2].set_title(
            f"rates over {result.roti_interval:g} s in windows of {result.roti_window:g} s"
        )
        path = folder / f"{name}_tec.png"
        save_figure(figure, path, f"Electron content, {result.source.description}")
    return [path]


def _select_drawn(time: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """Return which rows belong to every n-th epoch, so that at most about 3000 are drawn."""
    epochs, number = np.unique(time, return_inverse=True)
    return np.asarray(number % max(1, len(epochs) // _EPOCHS_DRAWN) == 0)
