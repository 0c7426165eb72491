"""TEC and scintillation of the ionosphere processor against those of a GPStation-6 itself."""

from __future__ import annotations

import pathlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt

from vtff_analysis.plot_style import AXIS_COLOURS, STYLE, make_figure, save_figure
from vtff_analysis.recordings.history import FloatArray, RunHistory, SatelliteColumns
from vtff_gnss.constants import SYSTEM_LETTERS

__all__ = ["ReceiverComparison", "compare_with_receiver", "plot_comparisons"]

_SECOND = 1_000_000_000
_OURS, _RECEIVERS = "/iono/", "/gnss/ism/"


@dataclass(frozen=True, eq=False)
class ReceiverComparison:
    """One quantity of one signal, ours and the receiver's at equal times of equal satellites.

    Attributes
    ----------
    craft
        Name of the spacecraft; empty for a receiver whose topics have no namespace.
    quantity
        ``slant_tec``, ``s4`` or ``sigma_phi``.
    signal
        RINEX name (``G1C``), of a content the two bands (``G12``).
    unit
        Of the values; empty for S4.
    ours, receivers
        Shape (n,).
    """

    craft: str
    quantity: str
    signal: str
    unit: str
    ours: FloatArray
    receivers: FloatArray

    @property
    def mean(self) -> float:
        """Mean of ours less the receiver's."""
        return float(np.mean(self.ours - self.receivers))

    @property
    def scatter(self) -> float:
        """Standard deviation of ours less the receiver's."""
        return float(np.std(self.ours - self.receivers))

    def keys(self) -> dict[str, Any]:
        """Return the keys of the summary."""
        craft = f"{self.craft}_" if self.craft else ""
        stem = f"ionosphere_{craft}receiver_{self.quantity}_{self.signal.lower()}"
        unit = f"_{self.unit.lower()}" if self.unit else ""
        return {
            f"{stem}_samples": len(self.ours),
            f"{stem}_mean_difference{unit}": self.mean,
            f"{stem}_scatter{unit}": self.scatter,
        }


#: Topic, identity columns beside time and satellite, and its quantities: name, field, unit.
_TOPICS: tuple[tuple[str, tuple[str, ...], tuple[tuple[str, str, str], ...]], ...] = (
    ("slant_tec", ("band_first", "band_second"), (("slant_tec", "stec_tecu", "TECU"),)),
    (
        "scintillation",
        ("band", "attribute"),
        (("s4", "s4_corrected", ""), ("sigma_phi", "sigma_phi", "rad")),
    ),
)


def compare_with_receiver(history: RunHistory) -> list[ReceiverComparison]:
    """Compare what both the ionosphere processor and the receiver have formed.

    Parameters
    ----------
    history
        The run; the receiver's own values are those of <craft>/gnss/ism/slant_tec and
        <craft>/gnss/ism/scintillation.

    Returns
    -------
    list of ReceiverComparison
        One a spacecraft, quantity and signal, in the order of their names; empty where the
        receiver has logged nothing.
    """
    found = []
    recorded = {"slant_tec": history.slant_tec, "scintillation": history.scintillation}
    for name, identity, quantities in _TOPICS:
        topics: Mapping[str, SatelliteColumns] = recorded[name]
        for topic, receivers in topics.items():
            craft, separator, _ = topic.rpartition(f"{_RECEIVERS}{name}")
            ours = topics.get(f"{craft}{_OURS}{name}")
            if not separator or ours is None:
                continue
            for quantity in quantities:
                found += _comparisons(craft.strip("/"), ours, receivers, identity, quantity)
    return found


def _comparisons(
    craft: str,
    ours: SatelliteColumns,
    receivers: SatelliteColumns,
    identity: tuple[str, ...],
    quantity: tuple[str, str, str],
) -> list[ReceiverComparison]:
    name, field, unit = quantity
    keys, values = [], []
    for columns in (ours, receivers):
        value = columns.values[field]
        kept = np.isfinite(value)
        if "rejected" in columns.values:
            kept &= ~(columns.values["rejected"] > 0)
        keys.append(_keys(columns, identity)[kept])
        values.append(value[kept])
    # A view of each row as one element makes rows comparable.
    rows = [np.ascontiguousarray(k).view([("", k.dtype)] * k.shape[1]).ravel() for k in keys]
    _, one, other = np.intersect1d(*rows, return_indices=True)
    signals = keys[0][one][:, [1, *range(3, 3 + len(identity))]]
    found = []
    for signal in np.unique(signals, axis=0):
        mine = (signals == signal).all(axis=1)
        label = _signal_name(signal.tolist(), identity)
        pair = (values[0][one][mine], values[1][other][mine])
        found.append(ReceiverComparison(craft, name, label, unit, *pair))
    return found


def _keys(columns: SatelliteColumns, identity: tuple[str, ...]) -> npt.NDArray[np.int64]:
    """Return whole second, system, PRN and identity of each row, shape (n, 3 + identity)."""
    parts = [np.round(columns.time / _SECOND), columns.system, columns.prn]
    parts += [columns.values[name] for name in identity]
    return np.stack([np.asarray(part, dtype=np.int64) for part in parts], axis=-1)


def _signal_name(signal: list[int], identity: tuple[str, ...]) -> str:
    system, first, second = signal
    letter = SYSTEM_LETTERS[system] if system < len(SYSTEM_LETTERS) else "X"
    return f"{letter}{first}{chr(second) if identity[1] == 'attribute' else second}"


def plot_comparisons(
    comparisons: list[ReceiverComparison], path: pathlib.Path, title: str
) -> pathlib.Path:
    """Draw ours against the receiver's, one panel a quantity and one marker a signal."""
    names = {"slant_tec": "slant TEC (TECU)", "s4": "S4", "sigma_phi": "sigma phi (rad)"}
    shown = [name for name in names if any(c.quantity == name for c in comparisons)]
    with mpl.rc_context(STYLE):
        figure = make_figure(5.5)
        axes: Any = figure.subplots(1, len(shown), squeeze=False)[0]
        for axis, quantity in zip(axes, shown, strict=True):
            mine = [c for c in comparisons if c.quantity == quantity]
            for number, comparison in enumerate(mine):
                axis.plot(
                    comparison.receivers,
                    comparison.ours,
                    "ox+sd^"[number % 6],
                    ms=4,
                    color=AXIS_COLOURS[number % len(AXIS_COLOURS)],
                    label=f"{comparison.craft} {comparison.signal}".strip(),
                )
            values = np.concatenate([np.concatenate((c.ours, c.receivers)) for c in mine])
            ends = [float(values.min()), float(values.max())]
            axis.plot(ends, ends, "k-", lw=1.0)
            axis.set(xlabel=f"receiver: {names[quantity]}", ylabel=f"ours: {names[quantity]}")
            axis.legend()
        return save_figure(figure, path, title)
