"""Lines of a matplotlib figure as data, so that a page can draw them anew and zoom into them.

Beside each picture of lines stands a file of them. A picture with anything else that carries data
(bars, points coloured by a value, images, polar axes) has none and stays a picture.
"""

from __future__ import annotations

import base64
import json
import pathlib
import re
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import Collection, PolyCollection
from matplotlib.colors import to_hex, to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator

from vtff_analysis.page.page import lines_path
from vtff_dynamics.vectors import FloatArray

__all__ = ["line_data", "write_lines"]

#: Samples of a line that are kept; longer lines keep smallest and largest value of equal pieces. A
#: panel is at most 1400 pixels wide, and each piece gives two samples.
_MOST_SAMPLES = 2400
#: Samples of all lines of a panel, as far as each line keeps `_FEWEST_SAMPLES`: where thirty
#: satellites are drawn over each other, the eye tells no single second.
_MOST_SAMPLES_OF_PANEL = 12_000
_FEWEST_SAMPLES = 300
_FORMULA = re.compile(r"\$([^$]*)\$")
_RAISED, _LOWERED = re.compile(r"\^(?:\{([^}]*)\}|(.))"), re.compile(r"_(?:\{([^}]*)\}|(.))")
_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_SUBSCRIPTS = str.maketrans("0123456789e", "₀₁₂₃₄₅₆₇₈₉ₑ")
_ROUND = 1e-3  # of a line's height in the figure: places of axes within a row


def write_lines(figure: Figure, picture: pathlib.Path) -> None:
    """Write the lines of a figure beside its picture; remove an old file where it has none.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    data = line_data(figure)
    path = lines_path(picture)
    if data is None:
        path.unlink(missing_ok=True)
    else:
        path.write_text(json.dumps(data, separators=(",", ":")), encoding="utf-8")


def line_data(figure: Figure) -> dict[str, Any] | None:
    """Return titles, axes and lines of a figure; None if it has data other than lines.

    Returns
    -------
    dict or None
        ``rows``: a list of rows of panels from above, each panel with ``title``, ``x``, ``y``
        (labels), ``ticks`` (places on the y axis that have names), ``log`` (whether x and y are
        logarithmic), ``symlog`` (`_symmetric_scale` of y), ``limits`` (x and y) and ``lines``.
        A line has ``name``, ``colour``, ``dash``, ``points`` (whether it is points alone) and
        whether it is the outline of an ``area``, and
        either ``x`` and ``y``, numbers of ``arrays`` (`_packed`), or ``across`` or ``upright``: the
        place of a line through the whole panel.
    """
    panels = [axes for axes in figure.axes if axes.get_visible()]
    if not panels or any(not _has_lines_alone(axes) for axes in panels):
        return None
    placed = sorted(panels, key=lambda axes: (-axes.get_position().y1, axes.get_position().x0))
    rows: list[list[Axes]] = []
    for axes in placed:
        top = axes.get_position().y1
        if rows and abs(rows[-1][0].get_position().y1 - top) < _ROUND:
            rows[-1].append(axes)
        else:
            rows.append([axes])
    data = {"rows": [[_panel(axes) for axes in row] for row in rows]}
    return {**data, "arrays": _shared_arrays(data)}


def _shared_arrays(data: dict[str, Any]) -> list[dict[str, Any]]:
    """Put the number of an array in the place of each array, and return the arrays, once each.

    The lines of a figure mostly have the same times.
    """
    numbers: dict[str, int] = {}
    arrays: list[dict[str, Any]] = []
    for row in data["rows"]:
        for line in (line for panel in row for line in panel["lines"]):
            for axis in ("x", "y"):
                if axis not in line:
                    continue
                array = line[axis]
                key = f"{array['middle']!r} {array['float32']}"
                if key not in numbers:
                    numbers[key] = len(arrays)
                    arrays.append(array)
                line[axis] = numbers[key]
    return arrays


def _has_lines_alone(axes: Axes) -> bool:
    bands = [area for area in axes.collections if isinstance(area, PolyCollection)]
    others = len(axes.collections) - len(bands)
    filled = [*axes.images, *axes.patches, *axes.tables]
    twins = axes.get_shared_x_axes().get_siblings(axes)
    overlaid = any(other is not axes and other.bbox.bounds == axes.bbox.bounds for other in twins)
    # Equal scales on both axes would be lost: a circle is to stay a circle.
    plain = axes.name == "rectilinear" and axes.get_aspect() == "auto"
    simple = plain and not filled and not others and not overlaid
    return simple and bool(axes.lines)


def _panel(axes: Axes) -> dict[str, Any]:
    lengths = [len(line.get_xdata()) for line in axes.lines if line.get_visible()]  # type: ignore[arg-type]
    share = min(1.0, _MOST_SAMPLES_OF_PANEL / max(1, sum(lengths)))
    return {
        "title": _without_markup(axes.get_title(loc="left") or axes.get_title()),
        "x": _without_markup(axes.get_xlabel()),
        "y": _without_markup(axes.get_ylabel()),
        "log": [axes.get_xscale() == "log", axes.get_yscale() == "log"],
        "symlog": _symmetric_scale(axes),
        "ticks": _named_ticks(axes),
        "limits": [list(map(float, axes.get_xlim())), list(map(float, axes.get_ylim()))],
        "lines": [
            *(_band(area) for area in axes.collections),
            *(_line(axes, line, share) for line in axes.lines if line.get_visible()),
        ],
    }


def _symmetric_scale(axes: Axes) -> tuple[float, float] | None:
    """Return the scale of a y axis that is logarithmic on both sides; None for other scales.

    The largest value of the linear part about zero, and the decades that each half of it takes.
    """
    scale: Any = axes.yaxis.get_transform()
    if axes.get_yscale() != "symlog":
        return None
    return float(scale.linthresh), float(scale.linscale) / (1.0 - 1.0 / float(scale.base))


def _without_markup(text: str) -> str:
    """Return a text of matplotlib with its powers and indices between ``$`` as characters."""

    def plain(formula: re.Match[str]) -> str:
        raised = _RAISED.sub(lambda m: (m[1] or m[2]).translate(_SUPERSCRIPTS), formula[1])
        return _LOWERED.sub(lambda m: (m[1] or m[2]).translate(_SUBSCRIPTS), raised)

    return _FORMULA.sub(plain, text)


def _named_ticks(axes: Axes) -> list[tuple[float, str]]:
    """Return the places on the y axis that have names, with these."""
    if not isinstance(axes.yaxis.get_major_locator(), FixedLocator):
        return []
    names = [label.get_text() for label in axes.get_yticklabels()]
    ticks = list(zip(map(float, axes.get_yticks()), names, strict=True))
    return [(place, name) for place, name in ticks if name]


def _band(area: Collection) -> dict[str, Any]:
    """Return an area between two lines as the corners of its polygons, which nan separates."""
    label = str(area.get_label())
    colours: Any = area.get_facecolor()
    corners = [np.vstack((path.vertices, [[np.nan, np.nan]])) for path in area.get_paths()]
    outline = np.vstack(corners) if corners else np.empty((0, 2))
    return {
        "name": "" if label.startswith("_") else label,
        "colour": to_hex(colours[0], keep_alpha=True) if len(colours) else "#00000000",
        "dash": [],
        "points": False,
        "area": True,
        "x": _packed(outline[:, 0]),
        "y": _packed(outline[:, 1]),
    }


def _line(axes: Axes, line: Line2D, share: float) -> dict[str, Any]:
    label = str(line.get_label())
    style = line.get_linestyle()
    points = style in ("None", "", " ")
    colour: Any = line.get_markerfacecolor() if points else line.get_color()
    described: dict[str, Any] = {
        "name": "" if label.startswith("_") else label,
        "colour": to_hex(
            to_rgba(colour, line.get_alpha()), keep_alpha=line.get_alpha() is not None
        ),
        "dash": [] if points or style == "-" else [5, 3] if style == "--" else [2, 3],
        "points": points,
    }
    x = np.asarray(line.get_xdata(orig=False), dtype=float)
    y = np.asarray(line.get_ydata(orig=False), dtype=float)
    if line.get_transform() == axes.get_yaxis_transform(which="grid"):
        return {**described, "across": float(y[0])}
    if line.get_transform() == axes.get_xaxis_transform(which="grid"):
        return {**described, "upright": float(x[0])}
    if line.get_drawstyle() == "steps-post":
        described["steps"] = True
    most = min(_MOST_SAMPLES, max(_FEWEST_SAMPLES, int(share * x.size)))
    x, y = _thinned(x, y, most)
    return {**described, "x": _packed(x), "y": _packed(y)}


def _thinned(x: FloatArray, y: FloatArray, most: int) -> tuple[FloatArray, FloatArray]:
    """Return a line of at most so many samples with all its extremes and gaps."""
    if x.size <= most:
        return x, y
    keep = []
    for piece in np.array_split(np.arange(x.size), most // 3):
        values = y[piece]
        finite = np.flatnonzero(np.isfinite(values))
        chosen = set() if finite.size == values.size else {int(np.argmin(np.isfinite(values)))}
        if finite.size:
            chosen |= {
                int(finite[np.argmin(values[finite])]),
                int(finite[np.argmax(values[finite])]),
            }
        keep += [int(piece[index]) for index in sorted(chosen)]
    return x[keep], y[keep]


def _packed(values: FloatArray) -> dict[str, Any]:
    """Return numbers as base64 of 32-bit differences to their middle, to nine digits or so."""
    finite = values[np.isfinite(values)]
    middle = 0.5 * float(finite.min() + finite.max()) if finite.size else 0.0
    differences = (values - middle).astype("<f4")
    return {"middle": middle, "float32": base64.b64encode(differences.tobytes()).decode("ascii")}
