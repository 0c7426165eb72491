"""TEC and scintillation of the ionosphere processor against those of a GPStation-6 itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_analysis.recordings.history import RunHistory, SatelliteColumns
from vtff_analysis.recordings.matching import match_rows
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import SYSTEM_LETTERS
from vtff_gnss.signals import signal_from_number, signal_number

__all__ = ["ReceiverComparison", "compare_with_receiver"]

_OURS, _RECEIVERS = "/iono/", "/gnss/ism/"


@dataclass(frozen=True, eq=False)
class ReceiverComparison:
    """One quantity of one signal: our values and the receiver's, of equal times and satellites.

    Attributes
    ----------
    craft
        Name of the spacecraft; empty for a receiver whose topics have no namespace.
    quantity
        ``slant_tec``, ``s4`` or ``sigma_phi``.
    signal
        RINEX name of the signal (``G1C``); of a content, system and the two bands (``G12``).
    unit
        Unit of the values; empty for S4.
    ours, receivers
        Values of the ionosphere processor and of the receiver, shape (n,).
    """

    craft: str
    quantity: str
    signal: str
    unit: str
    ours: FloatArray
    receivers: FloatArray

    @property
    def mean(self) -> float:
        """Mean of our values less the receiver's."""
        return float(np.mean(self.ours - self.receivers))

    @property
    def scatter(self) -> float:
        """Standard deviation of our values less the receiver's."""
        return float(np.std(self.ours - self.receivers))

    def summarise(self) -> dict[str, Any]:
        """Return the numbers by their keys in the summary."""
        craft = f"{self.craft}_" if self.craft else ""
        stem = f"ionosphere_{craft}receiver_{self.quantity}_{self.signal.lower()}"
        unit = f"_{self.unit.lower()}" if self.unit else ""
        return {
            f"{stem}_samples": len(self.ours),
            f"{stem}_mean_difference{unit}": self.mean,
            f"{stem}_scatter{unit}": self.scatter,
        }


@dataclass(frozen=True)
class _Quantity:
    """A quantity that both have: topic, column, unit, and the columns that name its signal."""

    name: str
    topic: str
    column: str
    unit: str
    signal_columns: tuple[str, str]


_CONTENT_BANDS = ("band_first", "band_second")
_SIGNAL = ("band", "attribute")
_QUANTITIES = (
    _Quantity("slant_tec", "slant_tec", "stec_tecu", "TECU", _CONTENT_BANDS),
    _Quantity("s4", "scintillation", "s4_corrected", "", _SIGNAL),
    _Quantity("sigma_phi", "scintillation", "sigma_phi", "rad", _SIGNAL),
)


def compare_with_receiver(history: RunHistory) -> list[ReceiverComparison]:
    """Compare what both the ionosphere processor and the receiver have computed.

    Parameters
    ----------
    history
        The run; the receiver's own values are those of <craft>/gnss/ism/slant_tec and
        <craft>/gnss/ism/scintillation.

    Returns
    -------
    list of ReceiverComparison
        One for each quantity, spacecraft and signal: contents before indices, then in the order
        of the names. Empty where the receiver has logged nothing.
    """
    comparisons = []
    for topic_name in dict.fromkeys(quantity.topic for quantity in _QUANTITIES):
        quantities = [quantity for quantity in _QUANTITIES if quantity.topic == topic_name]
        topics: Mapping[str, SatelliteColumns] = getattr(history, topic_name)
        for topic, receivers in topics.items():
            craft, separator, _ = topic.rpartition(f"{_RECEIVERS}{topic_name}")
            ours = topics.get(f"{craft}{_OURS}{topic_name}")
            if not separator or ours is None:
                continue
            for quantity in quantities:
                comparisons += _compare_quantity(craft.strip("/"), ours, receivers, quantity)
    return comparisons


def _compare_quantity(
    craft: str, ours: SatelliteColumns, receivers: SatelliteColumns, quantity: _Quantity
) -> list[ReceiverComparison]:
    """Return a comparison for each signal of a spacecraft."""
    our_rows = _usable_rows(ours, quantity)
    receiver_rows = _usable_rows(receivers, quantity)
    in_ours, in_receivers = match_rows(
        our_rows.time, our_rows.signal, receiver_rows.time, receiver_rows.signal
    )
    groups = np.array(
        [signal_from_number(number).group for number in our_rows.signal[in_ours]]
    ).reshape(-1, 3)
    comparisons = []
    for group in np.unique(groups, axis=0):
        rows = (groups == group).all(axis=1)
        comparisons.append(
            ReceiverComparison(
                craft=craft,
                quantity=quantity.name,
                signal=_signal_name(group.tolist(), quantity.signal_columns),
                unit=quantity.unit,
                ours=our_rows.value[in_ours[rows]],
                receivers=receiver_rows.value[in_receivers[rows]],
            )
        )
    return comparisons


@dataclass(frozen=True, eq=False)
class _Rows:
    """Time (ns since 1970), `signal_number` and value of rows, shape (n,) each."""

    time: npt.NDArray[np.int64]
    signal: npt.NDArray[np.int64]
    value: FloatArray


def _usable_rows(columns: SatelliteColumns, quantity: _Quantity) -> _Rows:
    """Return the rows of a quantity that are finite, not rejected and name their signal."""
    value = columns.values[quantity.column]
    first, second = (columns.values[name] for name in quantity.signal_columns)
    kept = np.isfinite(value) & np.isfinite(first) & np.isfinite(second)
    if "rejected" in columns.values:
        kept &= ~(columns.values["rejected"] > 0)
    signal = signal_number(columns.system[kept], columns.prn[kept], first[kept], second[kept])
    return _Rows(columns.time[kept], signal, value[kept])


def _signal_name(group: list[int], signal_columns: tuple[str, str]) -> str:
    system, first, second = group
    letter = SYSTEM_LETTERS[system] if system < len(SYSTEM_LETTERS) else "X"
    return f"{letter}{first}{chr(second) if signal_columns == _SIGNAL else second}"
