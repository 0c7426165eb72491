"""Pictures of a campaign's table: distributions of figures, and what drives them."""

from __future__ import annotations

import base64
import io
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from scipy.stats import rankdata

from vtff_analysis.plot_style import AXIS_COLOURS, MARK_COLOUR, STYLE, make_figure
from vtff_analysis.studies.figures import describe_name
from vtff_dynamics.vectors import FloatArray

__all__ = ["Column", "association", "draw_distributions", "draw_drivers", "draw_scatter"]

_BLUE, _ORANGE, _ = AXIS_COLOURS
_DPI = 100
_DIVERGING = "PuOr"  # told apart with any colour vision
_MARKED = ((5.0, (0, (1, 1.5))), (50.0, "-"), (95.0, (0, (4, 2))))
"""Percentiles drawn into a histogram, with their line styles."""


@dataclass(frozen=True, eq=False)
class Column:
    """Column of a table of cases.

    Attributes
    ----------
    name
        Name of the column.
    unit
        Unit for labels; empty for none.
    values
        Numbers, NaN where there is none, shape (n,); of texts their position in `categories`.
    categories
        Texts that stand for numbers; empty for a column of numbers.
    """

    name: str
    unit: str
    values: FloatArray
    categories: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """Name in words, without the unit."""
        return describe_name(self.name)

    @property
    def label(self) -> str:
        """Name in words with the unit."""
        return f"{self.words} ({self.unit})" if self.unit else self.words


def association(driver: Column, figure: Column) -> float:
    """Tell how strongly an input drives a figure.

    Returns
    -------
    float
        Spearman's rank correlation, -1 to 1; of an input of texts the correlation ratio of the
        ranks, 0 to 1. NaN where one of them is constant or fewer than three cases have both.
    """
    both = np.isfinite(driver.values) & np.isfinite(figure.values)
    first, second = driver.values[both], rankdata(figure.values[both])
    if len(second) < 3 or np.ptp(first) == 0.0 or np.ptp(second) == 0.0:
        return float("nan")
    if not driver.categories:
        return float(np.corrcoef(rankdata(first), second)[0, 1])
    deviation = second - second.mean()
    between = sum(
        np.count_nonzero(first == value) * deviation[first == value].mean() ** 2
        for value in np.unique(first)
    )
    return float(np.sqrt(between / np.sum(deviation**2)))


def draw_distributions(figures: Sequence[Column]) -> str:
    """Draw a histogram of each figure with its percentiles; return the picture as a data URL."""
    rows = -(-len(figures) // 2)
    with mpl.rc_context(STYLE):
        picture = make_figure(0.4 + 3.3 * rows)
        panels: Any = picture.subplots(rows, 2, squeeze=False)
        for panel, figure in zip(panels.flat, figures, strict=False):
            _draw_histogram(panel, figure)
        for panel in panels.flat[len(figures) :]:
            panel.set_axis_off()
        return _data_url(picture)


def draw_drivers(drivers: Sequence[Column], figures: Sequence[Column]) -> str:
    """Draw the association of every input with every figure; return the picture as a data URL."""
    values = np.array([[association(driver, figure) for driver in drivers] for figure in figures])
    with mpl.rc_context(STYLE):
        picture = make_figure(1.8 + 0.55 * len(figures))
        panel: Any = picture.subplots()
        panel.grid(False)
        image = panel.imshow(values, cmap=_DIVERGING, vmin=-1.0, vmax=1.0, aspect="auto")
        panel.set_xticks(
            range(len(drivers)), [_wrapped(driver.words, _DRIVER_WIDTH) for driver in drivers]
        )
        panel.set_yticks(range(len(figures)), [_wrapped(figure.words) for figure in figures])
        for (row, column), value in np.ndenumerate(values):
            text = "—" if np.isnan(value) else f"{value:+.2f}"
            colour = "white" if abs(value) > 0.7 else "black"
            panel.text(column, row, text, ha="center", va="center", color=colour)
        bar = picture.colorbar(image, ax=panel, shrink=0.9)
        bar.set_label("rank correlation (1)")
        return _data_url(picture)


def draw_scatter(pairs: Sequence[tuple[Column, Column]]) -> str:
    """Draw figures over the inputs that drive them most; return the picture as a data URL."""
    rows = -(-len(pairs) // 2)
    with mpl.rc_context(STYLE):
        picture = make_figure(0.4 + 3.3 * rows)
        panels: Any = picture.subplots(rows, 2, squeeze=False)
        for panel, (driver, figure) in zip(panels.flat, pairs, strict=False):
            size = 16.0 if len(figure.values) < 500 else 4.0
            panel.scatter(
                driver.values, figure.values, s=size, color=_BLUE, alpha=0.6, linewidths=0.0
            )
            if driver.categories:
                panel.set_xticks(range(len(driver.categories)), driver.categories)
            elif _spans_decades(driver.values):
                panel.set_xscale("log")
            panel.set_xlabel(_wrapped(driver.label))
            panel.set_ylabel(_wrapped(figure.label, _PANEL_HEIGHT))
        for panel in panels.flat[len(pairs) :]:
            panel.set_axis_off()
        return _data_url(picture)


def _draw_histogram(panel: Any, figure: Column) -> None:
    values = figure.values[np.isfinite(figure.values)]
    panel.set_xlabel(_wrapped(figure.label))
    panel.set_ylabel("cases")
    if len(values) == 0:
        panel.text(0.5, 0.5, "no case has it", ha="center", transform=panel.transAxes)
        return
    bins: Any = "auto" if np.ptp(values) > 0.0 else 1
    edges = np.histogram_bin_edges(values, bins=bins)
    if len(edges) > 61:
        edges = np.linspace(edges[0], edges[-1], 61)
    panel.hist(values, bins=edges, color=_BLUE, alpha=0.75)
    for percentile, style in _MARKED:
        value = float(np.percentile(values, percentile))
        panel.axvline(
            value, color=_ORANGE, ls=style, lw=1.6, label=f"{percentile:g} %: {value:.4g}"
        )
    panel.legend(fontsize=10, framealpha=0.85)
    missing = len(figure.values) - len(values)
    if missing:
        panel.set_title(f"{missing} cases without it", color=MARK_COLOUR, fontsize=11)


def _spans_decades(values: FloatArray) -> bool:
    finite = values[np.isfinite(values)]
    return bool(len(finite) and finite.min() > 0.0 and finite.max() / finite.min() >= 100.0)


_PANEL_HEIGHT = 22  # letters that fit beside a panel
_DRIVER_WIDTH = 18  # letters that fit below a column of the drivers


def _wrapped(words: str, width: int = 34) -> str:
    """Return words on lines of a width."""
    return "\n".join(textwrap.wrap(words, width))


def _data_url(figure: Figure) -> str:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=_DPI)
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode("ascii")
