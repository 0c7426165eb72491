"""Which phases of one receiver are continuous, signal by signal.

An arc of a link ends when either of its signals is interrupted. In scintillation that is nearly
always the weaker one: fades make a receiver lose L2 every few seconds, while L1 goes on for
minutes. The integer of a signal that goes on is still right, and with it the other is found at
once: a cycle of L2 alone changes the content by 2.3 TECU.

What jumps without a report of the receiver has slipped, or was wound up by the plasma, in a fade:
the blame is on the signals that faded in that second, and on both where none did.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_gnss import constants as c
from vtff_gnss.signals import SignalKey, signal_from_number, signal_number
from vtff_iono.content.slant_tec import SlantTecRows
from vtff_iono.links.arcs import LOCK_INTERVAL_MARGIN, LOCK_TIME_MARGIN, ArcBreak
from vtff_iono.spacecraft.spacecraft_ionosphere import ObservationBlock

__all__ = ["SignalContinuity"]

# A signal has faded where its C/N0 falls by so much below its mean of so many seconds, dB: to a
# third of its amplitude.
_FADE, _FADE_MEMORY = 10.0, 10.0
# What ends an arc though no receiver reports an interruption: either signal may have slipped.
_TESTS = (ArcBreak.GEOMETRY_FREE, ArcBreak.WIDE_LANE, ArcBreak.OTHER_LINK, ArcBreak.CLOSURE)


class SignalContinuity:
    """Numbers of the continuous stretches of the phases of one receiver.

    Parameters
    ----------
    system : int
        System of the signals.
    bands : tuple of int
        RINEX frequency digits of the signals.
    """

    def __init__(self, system: int, bands: tuple[int, int]) -> None:
        self._system, self._bands = system, bands
        self._stretches: dict[int, int] = {}
        # Time, ns, lock time, s, and half-cycle bit of the last observation of each signal.
        self._last: dict[int, tuple[int, float, int]] = {}
        self._mean_cn0: dict[int, float] = {}  # dB-Hz

    def update(self, block: ObservationBlock, rows: SlantTecRows) -> dict[SignalKey, int]:
        """Return the number of the stretch of each signal with a phase at the end of the block.

        Parameters
        ----------
        block : ObservationBlock
            All observations since the last call.
        rows : SlantTecRows
            Links and arcs of these observations.
        """
        columns = block.columns
        chosen = (columns["system"] == self._system) & np.isin(columns["band"], self._bands)
        if not chosen.any():
            return {}
        number = signal_number(*(columns[name] for name in SignalKey._fields))
        is_blamed = self._blame(number, columns["cn0_dbhz"], rows)
        signals, time = number[chosen], block.time[chosen]
        flags = columns["flags"][chosen]
        order = np.lexsort((time, signals))
        signals, time, flags = signals[order], time[order], flags[order]
        lock_time = columns["lock_time"][chosen][order].astype(float)
        half = flags & c.FLAG_HALF_CYCLE_ADDED
        is_first = np.diff(signals, prepend=-1) != 0
        before = [self._last.get(signal, (0, 0.0, 0)) for signal in signals[is_first].tolist()]
        last_time, last_lock, last_half = (
            _shifted(column, is_first, [row[index] for row in before])
            for index, column in enumerate((time, lock_time, half))
        )
        interval = (time - last_time) / NANOSECONDS_PER_SECOND
        is_broken = (
            is_blamed[chosen][order]
            | ((flags & c.FLAG_PHASE_VALID) == 0)
            | ((flags & c.FLAG_LOCK_LOST) != 0)
            | (lock_time < last_lock - LOCK_TIME_MARGIN)
            | (lock_time < interval - LOCK_INTERVAL_MARGIN)
            | (half != last_half)
        )
        ends = np.flatnonzero(np.append(is_first[1:], True))
        broken = np.add.reduceat(is_broken.astype(np.int64), np.flatnonzero(is_first))
        result = {}
        for row, breaks in zip(ends.tolist(), broken.tolist(), strict=True):
            signal = int(signals[row])
            self._stretches[signal] = self._stretches.get(signal, 0) + breaks
            self._last[signal] = (int(time[row]), float(lock_time[row]), int(half[row]))
            if time[row] == block.time[-1]:
                result[signal_from_number(signal)] = self._stretches[signal]
        return result

    def _blame(
        self, number: npt.NDArray[np.int64], cn0_dbhz: npt.NDArray[Any], rows: SlantTecRows
    ) -> npt.NDArray[np.bool_]:
        """Return which observations (n,) may have slipped though no receiver reports it."""
        signals, inverse = np.unique(number, return_inverse=True)
        lowest = np.full(len(signals), np.inf)
        np.minimum.at(lowest, inverse, cn0_dbhz)
        mean = np.bincount(inverse, cn0_dbhz) / np.bincount(inverse)
        before = np.array(
            [self._mean_cn0.get(s, m) for s, m in zip(signals.tolist(), mean, strict=True)]
        )
        has_faded = (lowest < before - _FADE)[inverse]
        self._mean_cn0 |= dict(
            zip(signals.tolist(), (before + (mean - before) / _FADE_MEMORY).tolist(), strict=True)
        )
        is_blamed = np.zeros(len(number), dtype=bool)
        slipped = np.isin(rows.break_reason, _TESTS)
        first, second = rows.pairs.row_first[slipped], rows.pairs.row_second[slipped]
        no_fade = ~(has_faded[first] | has_faded[second])
        is_blamed[first] |= has_faded[first] | no_fade
        is_blamed[second] |= has_faded[second] | no_fade
        return is_blamed


def _shifted(
    column: npt.NDArray[Any], is_first: npt.NDArray[np.bool_], before: list[float]
) -> npt.NDArray[Any]:
    """Return each row's predecessor; that of the first row of each signal is given."""
    result = np.empty_like(column)
    result[1:] = column[:-1]
    result[is_first] = before
    return result
