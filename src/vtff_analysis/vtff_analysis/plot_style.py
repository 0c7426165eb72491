"""Look of all plots: size, fonts, colours, units."""

from __future__ import annotations

import os
import pathlib
from typing import Any

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from PIL import Image

from vtff_analysis.page.line_data import write_lines

#: Environment variable: with the value ``svg`` every figure is also written as SVG.
FIGURES_VARIABLE = "VTFF_FIGURES"
DPI = 125
WIDTH = 12.8  # inch, 1600 pixels
STYLE: Any = {
    "font.size": 13.0,
    "axes.titlesize": 14.0,
    "axes.titlelocation": "left",
    "figure.titlesize": 15.0,
    "legend.fontsize": 12.0,
    "axes.grid": True,
    "grid.color": "0.88",
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "lines.linewidth": 1.8,
}

# Okabe-Ito colours, which differ with any colour vision; line styles differ without colours.
AXIS_COLOURS = ("#0072B2", "#D55E00", "#009E73")
AXIS_STYLES = ("-", "-", (0, (4, 2)))
AXIS_NAMES = ("radial", "in-track", "cross-track")
STATE_COLOUR = "#0072B2"
ESTIMATE_COLOUR = "#CC79A7"
MARK_COLOUR = "0.35"

_LENGTH_UNITS = ((1e5, 1e3, "km"), (1.0, 1.0, "m"), (1e-3, 1e-3, "mm"), (1e-6, 1e-6, "µm"))
_SMALLEST_LENGTH_UNIT = (1e-9, "nm")

_LONGEST_IN_SECONDS = 7200.0


def make_figure(height: float) -> Figure:
    """Return an empty figure, 1600 pixels wide, with a height in inches."""
    # The padding separates the last time label of a panel from the first of the next.
    layout = ConstrainedLayoutEngine(w_pad=0.13)
    figure = Figure(figsize=(WIDTH, height), layout=layout)
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, path: pathlib.Path, title: str) -> pathlib.Path:
    """Write a figure as PNG under its title, and its lines beside it; return the path.

    Beside it stands an SVG file if the environment variable `FIGURES_VARIABLE` holds ``svg``.
    """
    figure.suptitle(title, x=0.01, ha="left", weight="bold")
    figure.set_dpi(DPI)
    layout = figure.get_layout_engine()
    assert layout is not None
    layout.execute(figure)
    figure.set_layout_engine("none")
    # `savefig` would draw everything once more before, for the layout alone.
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    canvas.print_png(path, metadata={"Title": title})
    write_lines(figure, path)
    if "svg" in os.environ.get(FIGURES_VARIABLE, ""):
        with rc_context({"svg.hashsalt": path.stem}):  # equal figures have equal bytes
            figure.savefig(path.with_suffix(".svg"), metadata={"Date": None})
    return path


def figure_title(path: pathlib.Path) -> str:
    """Return the title of a figure that `save_figure` has written; empty for another picture."""
    with Image.open(path) as picture:
        return str(picture.info.get("Title", ""))


def length_unit(largest: float) -> tuple[float, str]:
    """Return size (m) and name of the unit that suits lengths up to the largest one (m)."""
    if largest == 0.0:
        return 1.0, "m"
    for threshold, scale, unit in _LENGTH_UNITS:
        if largest >= threshold:
            return scale, unit
    return _SMALLEST_LENGTH_UNIT


def time_unit_of(end: float) -> tuple[float, str]:
    """Return factor and name of the unit of a time axis that ends at `end` (s)."""
    return (1.0, "s") if end <= _LONGEST_IN_SECONDS else (1.0 / 3600.0, "h")
