"""Which phases of one receiver are continuous, signal by signal.

An arc of a link ends when either of its signals is interrupted. In scintillation that is nearly
always the weaker one: fades make a receiver lose L2 every few seconds, while L1 goes on for
minutes. The integer of a signal that goes on is still right, and with it the other is found at
once: a cycle of L2 alone changes the content by 2.3 TECU.

What jumps without a report of the receiver has slipped, or was wound up by the plasma, in a fade:
the blame is on the signals that faded in that second, and on both where none did. While the other
signal of a link is lost no test sees a jump: a fade then counts as one.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_gnss import constants as c
from vtff_gnss.signals import SignalKey, signal_from_number, signal_number
from vtff_iono.content.slant_tec import SlantTecRows
from vtff_iono.links.arcs import LOCK_INTERVAL_MARGIN, LOCK_TIME_MARGIN, ArcBreak
from vtff_iono.spacecraft.spacecraft_ionosphere import ObservationBlock

__all__ = ["SignalContinuity"]

# dB; a signal fades where its C/N0 falls by so much below its mean, to a third of the amplitude, or
# to two fifths where no test sees whether it has slipped. The mean is of so many seconds, more than
# fades last.
_FADE, _UNSEEN_FADE, _FADE_MEMORY = 10.0, 8.0, 30.0
# What ends an arc though no receiver reports an interruption: either signal may have slipped.
_GEOMETRY_FREE, _WIDE_LANE = int(ArcBreak.GEOMETRY_FREE), int(ArcBreak.WIDE_LANE)
_OTHER_LINK, _CLOSURE = int(ArcBreak.OTHER_LINK), int(ArcBreak.CLOSURE)
_PHASE_VALID, _LOCK_LOST = int(c.FLAG_PHASE_VALID), int(c.FLAG_LOCK_LOST)
_HALF_CYCLE_ADDED = int(c.FLAG_HALF_CYCLE_ADDED)
# Columns of the state of a signal: number of its stretch, mean C/N0 (dB-Hz; NaN at first), and lock
# time (s) and half-cycle bit of its last observation.
_STRETCH, _MEAN_CN0, _LAST_LOCK, _LAST_HALF = range(4)
_STATE_COLUMNS = 4


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
        # Signals in the order of their first observations: their numbers and states.
        self._index: dict[int, int] = {}
        self._states = np.zeros((0, _STATE_COLUMNS))
        self._times = np.zeros(0, dtype=np.int64)
        # Whether each signal is of the system and the bands.
        self._is_chosen = np.zeros(0, dtype=bool)
        # Fields of the observations of the last block, and the indices of their signals.
        self._fields = tuple(np.zeros(0, dtype=np.uint8) for _ in SignalKey._fields)
        self._signals = np.zeros(0, dtype=np.int64)
        # The chosen observations of its last epoch: rows from which that begins, indices, keys.
        self._last_epoch = -1
        self._last_indices = np.zeros(0, dtype=np.int64)
        self._last_signals: list[SignalKey] = []
        # The stretches that were returned, of these signals.
        self._stretches: list[int] = []
        self._result: dict[SignalKey, int] = {}

    def update(self, block: ObservationBlock, rows: SlantTecRows) -> dict[SignalKey, int]:
        """Return the number of the stretch of each signal with a phase at the end of the block.

        The dictionary is the one of the block before while nothing has changed.

        Parameters
        ----------
        block : ObservationBlock
            All observations since the last call.
        rows : SlantTecRows
            Links and arcs of these observations.
        """
        if not len(block.time):
            return {}
        columns = block.columns
        fields = tuple(columns[name] for name in SignalKey._fields)
        # As a rule a second has the signals of the one before, in the same order.
        if not _are_equal(*fields, *self._fields):
            signals, inverse = np.unique(signal_number(*fields), return_inverse=True)
            self._fields, self._signals = fields, self._indices(signals.tolist())[inverse]
            self._last_epoch = -1
        signal = self._signals
        is_any_chosen, last_epoch = _follow_signals(
            block.time,
            signal,
            self._is_chosen,
            columns["cn0_dbhz"],
            columns["flags"],
            columns["lock_time"],
            rows.pairs.row_first,
            rows.pairs.row_second,
            rows.arc,
            rows.break_reason,
            self._states,
            self._times,
        )
        if not is_any_chosen:
            return {}
        is_same = last_epoch == self._last_epoch
        if not is_same:
            self._last_epoch = last_epoch
            last = last_epoch + np.flatnonzero(self._is_chosen[signal[last_epoch:]])
            self._last_indices = signal[last]
            numbers = signal_number(*(field[last] for field in fields))
            self._last_signals = [signal_from_number(value) for value in numbers.tolist()]
        stretches = self._states[self._last_indices, _STRETCH].astype(np.int64).tolist()
        if not (is_same and stretches == self._stretches):
            self._stretches = stretches
            self._result = dict(zip(self._last_signals, stretches, strict=True))
        return self._result

    def _indices(self, numbers: list[int]) -> npt.NDArray[np.int64]:
        """Return the indices of signals, with states of zero for those that are new."""
        index = self._index
        indices = np.array([index.setdefault(number, len(index)) for number in numbers])
        missing = len(index) - len(self._times)
        if missing:
            states = np.zeros((missing, _STATE_COLUMNS))
            states[:, _MEAN_CN0] = np.nan
            self._states = np.concatenate((self._states, states))
            self._times = np.concatenate((self._times, np.zeros(missing, dtype=np.int64)))
            keys = map(signal_from_number, index)
            is_chosen = [key.system == self._system and key.band in self._bands for key in keys]
            self._is_chosen = np.array(is_chosen, dtype=bool)
        return indices


@compiled
def _are_equal(  # type: ignore[no-untyped-def]
    system, prn, band, attribute, last_system, last_prn, last_band, last_attribute
):
    """Return whether observations (n,) are of the same signals as the last ones (m,)."""
    if len(system) != len(last_system):
        return False
    for row in range(len(system)):
        if (
            prn[row] != last_prn[row]
            or attribute[row] != last_attribute[row]
            or band[row] != last_band[row]
            or system[row] != last_system[row]
        ):
            return False
    return True


@compiled
def _follow_signals(  # type: ignore[no-untyped-def]
    time,
    signal,
    is_chosen,
    cn0_dbhz,
    flags,
    lock_time,
    row_first,
    row_second,
    arc,
    break_reason,
    states,
    times,
):
    """Count the breaks of the observations (n,) of the chosen signals in the states of these.

    `states` and `times` are those of the last observation of each signal. Mean C/N0 are followed of
    all observations, since a link may have a signal that is not chosen. Without any observation of
    a chosen signal nothing is done.

    Returned is whether there is one, and the first row of the last epoch.
    """
    is_any_chosen = False
    for row in range(len(time)):
        if is_chosen[signal[row]]:
            is_any_chosen = True
            break
    if not is_any_chosen:
        return False, 0
    lowest = np.full(len(states), np.inf)
    total, count = np.zeros(len(states)), np.zeros(len(states))
    for row in range(len(time)):
        s = signal[row]
        lowest[s] = min(lowest[s], cn0_dbhz[row])
        total[s] += cn0_dbhz[row]
        count[s] += 1.0
    has_faded = np.zeros(len(states), dtype=np.bool_)
    level = np.zeros(len(states))
    for s in range(len(states)):
        if count[s] == 0.0:
            continue
        mean = total[s] / count[s]
        if np.isnan(states[s, _MEAN_CN0]):
            states[s, _MEAN_CN0] = mean
        before = states[s, _MEAN_CN0]
        level[s] = before
        has_faded[s] = lowest[s] < before - _FADE
        states[s, _MEAN_CN0] = before + (mean - before) / _FADE_MEMORY
    # What may have slipped though no receiver reports it.
    is_blamed = np.zeros(len(time), dtype=np.bool_)
    for row in range(len(time)):
        is_blamed[row] = cn0_dbhz[row] < level[signal[row]] - _UNSEEN_FADE
    for row in range(len(arc)):
        if arc[row] > 0:
            is_blamed[row_first[row]] = is_blamed[row_second[row]] = False
    for row in range(len(break_reason)):
        reason = break_reason[row]
        if (
            reason == _GEOMETRY_FREE
            or reason == _WIDE_LANE
            or reason == _OTHER_LINK
            or reason == _CLOSURE
        ):
            first, second = row_first[row], row_second[row]
            faded_first, faded_second = has_faded[signal[first]], has_faded[signal[second]]
            no_fade = not (faded_first or faded_second)
            is_blamed[first] |= faded_first or no_fade
            is_blamed[second] |= faded_second or no_fade
    for row in range(len(time)):
        s = signal[row]
        if not is_chosen[s]:
            continue
        interval = (time[row] - times[s]) / NANOSECONDS_PER_SECOND
        lock, flag = float(lock_time[row]), np.int64(flags[row])
        half = float(flag & _HALF_CYCLE_ADDED)
        if (
            is_blamed[row]
            or (flag & _PHASE_VALID) == 0
            or (flag & _LOCK_LOST) != 0
            or lock < states[s, _LAST_LOCK] - LOCK_TIME_MARGIN
            or lock < interval - LOCK_INTERVAL_MARGIN
            or half != states[s, _LAST_HALF]
        ):
            states[s, _STRETCH] += 1.0
        times[s] = time[row]
        states[s, _LAST_LOCK] = lock
        states[s, _LAST_HALF] = half
    last_epoch = len(time) - 1
    while last_epoch > 0 and time[last_epoch - 1] == time[last_epoch]:
        last_epoch -= 1
    return True, last_epoch
