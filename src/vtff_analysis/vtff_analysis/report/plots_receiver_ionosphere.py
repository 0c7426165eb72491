"""Plot of the ionosphere processor's TEC and scintillation against those of a GPStation-6."""

from __future__ import annotations

import pathlib
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np

from vtff_analysis.evaluation.receiver_comparison import ReceiverComparison
from vtff_analysis.plot_style import AXIS_COLOURS, STYLE, make_figure, save_figure

__all__ = ["plot_comparisons"]

_LABELS = {"slant_tec": "slant TEC (TECU)", "s4": "S4", "sigma_phi": "sigma phi (rad)"}
_MARKERS = "ox+sd^"


def plot_comparisons(
    comparisons: Sequence[ReceiverComparison], path: pathlib.Path, title: str
) -> pathlib.Path:
    """Draw our values against the receiver's, one panel a quantity and one marker a signal."""
    quantities = [name for name in _LABELS if any(c.quantity == name for c in comparisons)]
    with mpl.rc_context(STYLE):
        figure = make_figure(5.5)
        axes: Any = figure.subplots(1, len(quantities), squeeze=False)[0]
        for axis, quantity in zip(axes, quantities, strict=True):
            drawn = [comparison for comparison in comparisons if comparison.quantity == quantity]
            for number, comparison in enumerate(drawn):
                axis.plot(
                    comparison.receivers,
                    comparison.ours,
                    _MARKERS[number % len(_MARKERS)],
                    ms=4,
                    color=AXIS_COLOURS[number % len(AXIS_COLOURS)],
                    label=f"{comparison.craft} {comparison.signal}".strip(),
                )
            values = np.concatenate([np.concatenate((c.ours, c.receivers)) for c in drawn])
            ends = [float(values.min()), float(values.max())]
            axis.plot(ends, ends, "k-", lw=1.0)
            label = _LABELS[quantity]
            axis.set(xlabel=f"receiver: {label}", ylabel=f"ours: {label}")
            axis.legend()
        return save_figure(figure, path, title)
