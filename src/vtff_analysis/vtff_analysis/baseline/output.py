"""Files of a baseline: CSV, JSON and plot."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
import pathlib

import matplotlib as mpl
import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes

from vtff_analysis.baseline.processing import BaselineRun
from vtff_analysis.baseline.summary import BaselineSummary
from vtff_analysis.large_tables import file_metadata, write_table
from vtff_analysis.plot_style import (
    AXIS_COLOURS,
    AXIS_STYLES,
    MARK_COLOUR,
    STYLE,
    length_unit,
    make_figure,
    save_figure,
    time_unit_of,
)
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_nav.relative.common.solution import (
    SOLUTION_CODE,
    SOLUTION_FIXED,
    SOLUTION_FLOAT,
    SOLUTION_NAMES,
    SOLUTION_PREDICTED,
)

__all__ = ["write_csv", "write_epochs", "write_json", "write_plot"]

# Okabe-Ito colours, the better the solution the stronger.
_SOLUTION_COLOURS = {
    SOLUTION_PREDICTED: "#999999",
    SOLUTION_CODE: "#E69F00",
    SOLUTION_FLOAT: "#56B4E9",
    SOLUTION_FIXED: "#0072B2",
}
_ALLOWED_SIGMAS = 3.0
_SMALL_EXCURSION = 1.0
"""m; a baseline that moves less is drawn as deviation from its mean."""


def write_epochs(
    run: BaselineRun, errors: FloatArray | None, folder: pathlib.Path, form: str, title: str
) -> pathlib.Path:
    """Write a row for each epoch, with all digits as ``baseline.parquet``; return the file.

    Parameters
    ----------
    run
        The solutions.
    errors
        Errors along the local axes, m, shape (n, 3); None without a truth.
    folder
        Existing folder.
    form
        ``parquet``, or ``csv``, for which see `write_csv`.
    title
        What was processed, for the metadata.
    """
    if form == "csv":
        return write_csv(run, errors, folder / "baseline.csv")
    names = _length_names(run, errors)
    lengths = [run.baseline_itrf, run.baseline_local, run.sigma_local]
    lengths += [] if errors is None else [errors]
    values = np.concatenate(lengths, axis=1)
    gps_epoch = np.datetime64("1980-01-06T00:00:00", "ns")
    table = pa.table(
        {
            "time_gps": pa.array(gps_epoch + run.time_nanoseconds.astype("timedelta64[ns]")),
            "time_gps_seconds": run.time_nanoseconds / 1e9,
            "solution": pa.array([SOLUTION_NAMES[int(kind)] for kind in run.solution]),
            **{name: values[:, column] for column, name in enumerate(names)},
            "satellites": run.satellites_used,
            "ambiguities_fixed": run.ambiguities_fixed,
            "ratio": run.ratio,
            "age": run.age,
        }
    )
    units = {**dict.fromkeys(names, "m"), "age": "s", "time_gps": "GPS time, without leap seconds"}
    units["time_gps_seconds"] = "s since 1980-01-06, GPS time"
    ends = [str(GpsTime(int(run.time_nanoseconds[row]))) for row in (0, -1)]
    metadata = file_metadata(ends[0], ends[1], {"table": "baseline", "source": title})
    return write_table(table, folder / "baseline.parquet", units, metadata)


def _length_names(run: BaselineRun, errors: FloatArray | None) -> list[str]:
    """Return the names of the columns that are lengths, in their order."""
    axes = [name.replace("-", "_") for name in run.axes]
    names = [f"baseline_{axis}" for axis in "xyz"]
    names += [f"baseline_{axis}" for axis in axes] + [f"sigma_{axis}" for axis in axes]
    return names + ([] if errors is None else [f"error_{axis}" for axis in axes])


def write_csv(run: BaselineRun, errors: FloatArray | None, path: pathlib.Path) -> pathlib.Path:
    """Write one line per epoch; lengths are in m, and blank where there is no solution."""
    header = ["time_gps", "time_gps_seconds", "solution", *_length_names(run, None)]
    header += ["satellites", "ambiguities_fixed", "ratio", "age"]
    header += _length_names(run, errors)[len(_length_names(run, None)) :]
    with open(path, "w", newline="", encoding="ascii") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        for i in range(len(run)):
            time = GpsTime(int(run.time_nanoseconds[i]))
            lengths = [*run.baseline_itrf[i], *run.baseline_local[i], *run.sigma_local[i]]
            row = [
                time.isoformat().removesuffix(" GPS"),
                f"{time.nanoseconds / 1e9:.9f}".rstrip("0").rstrip("."),
                SOLUTION_NAMES[int(run.solution[i])],
                *(_format_length(length) for length in lengths),
                str(run.satellites_used[i]),
                str(run.ambiguities_fixed[i]),
                f"{run.ratio[i]:.2f}",
                f"{run.age[i]:.3f}",
            ]
            row += [_format_length(error) for error in errors[i]] if errors is not None else []
            writer.writerow(row)
    return path


def write_json(summary: BaselineSummary, path: pathlib.Path) -> pathlib.Path:
    """Write the numbers of the summary; lengths are in m, times in s."""
    content = dataclasses.asdict(summary) | {"fixed_fraction": summary.fixed_fraction}
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="ascii")
    return path


def write_plot(
    run: BaselineRun, errors: FloatArray | None, path: pathlib.Path, title: str
) -> pathlib.Path:
    """Draw each component with its 3-sigma band, the solution and the satellites.

    Where the truth is known, the components are errors. Otherwise the components of a baseline
    that moves less than 1 m are deviations from their mean.
    """
    with mpl.rc_context(STYLE):
        figure = make_figure(10.5)
        panels = figure.subplots(4, 1, sharex=True, height_ratios=(3, 3, 3, 2))
        factor, time_unit = time_unit_of(float(run.seconds[-1]))
        time = run.seconds * factor
        for axis in range(3):
            _draw_component(panels[axis], run, errors, axis, time)
        _draw_quality(panels[3], run, time)
        panels[3].set_xlabel(f"time since {GpsTime(int(run.time_nanoseconds[0]))} ({time_unit})")
        panels[3].set_xlim(0.0, max(float(time[-1]), 1e-9))
        figure.align_ylabels(panels)
        return save_figure(figure, path, title)


def _draw_component(
    panel: Axes, run: BaselineRun, errors: FloatArray | None, axis: int, time: FloatArray
) -> None:
    name, colour = run.axes[axis], AXIS_COLOURS[axis]
    values, what = run.baseline_local[:, axis], "component"
    if errors is not None:
        values, what = errors[:, axis], "error"
    is_finite = np.isfinite(values)
    if not is_finite.any():
        panel.text(0.5, 0.5, "no solution", transform=panel.transAxes, ha="center", va="center")
        panel.set_ylabel(name)
        return
    band = _ALLOWED_SIGMAS * run.sigma_local[:, axis]
    note = ""
    is_best = is_finite & (run.solution == run.solution[is_finite].max())
    centre = values
    if errors is None and np.ptp(values[is_best]) < _SMALL_EXCURSION:
        mean = float(values[is_best].mean())
        values, what, note = values - mean, "deviation", f", mean {mean:.4f} m"
        centre = np.zeros_like(values)
    elif errors is not None:
        centre = np.zeros_like(values)
    if what == "component":
        largest = float(np.abs(values[is_finite]).max())
    else:
        largest = float(max(np.abs(values[is_best]).max(), np.quantile(band[is_best], 0.9)))
    scale, unit = length_unit(largest)
    panel.fill_between(
        time, (centre - band) / scale, (centre + band) / scale,
        color=colour, alpha=0.18, linewidth=0.0, label="3 sigma of the filter",
    )  # fmt: skip
    panel.plot(
        time, values / scale, color=colour, linestyle=AXIS_STYLES[0], linewidth=1.2, label=what
    )
    if what != "component":
        # Epochs before the fix may be metres off; the panel shows the solution.
        limit = 1.15 * largest / scale
        panel.set_ylim(-limit, limit)
    panel.set_title(f"{name} {what}{note}")
    panel.set_ylabel(f"{name} ({unit})")
    panel.legend(loc="upper right", ncols=2)


def _draw_quality(panel: Axes, run: BaselineRun, time: FloatArray) -> None:
    """Draw satellites and integers as lines, and the kind of solution as a strip below them."""
    panel.step(time, run.satellites_used, where="post", color=MARK_COLOUR, label="satellites")
    panel.step(
        time, run.ambiguities_fixed, where="post", color=AXIS_COLOURS[1],
        linestyle=(0, (4, 2)), label="integers",
    )  # fmt: skip
    top = max(int(run.satellites_used.max()), int(run.ambiguities_fixed.max()), 1)
    strip = -0.2 * top
    for number, colour in _SOLUTION_COLOURS.items():
        chosen = run.solution == number
        if chosen.any():
            panel.fill_between(
                time, strip, 0.35 * strip, where=chosen, step="post", color=colour, linewidth=0.0,
                label=SOLUTION_NAMES[number],
            )  # fmt: skip
    panel.set_ylim(1.3 * strip, 1.45 * top)
    panel.set_ylabel("number")
    panel.set_title("satellites, integers and kind of solution")
    panel.legend(loc="upper right", ncols=6)


def _format_length(length: float) -> str:
    return "" if math.isnan(length) else f"{length:.6f}"
