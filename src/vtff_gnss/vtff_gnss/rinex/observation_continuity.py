"""Lock times of RINEX observations, which the format does not carry, from their continuity."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_gnss.constants import FLAG_LOCK_LOST, FLAG_PHASE_VALID
from vtff_gnss.observation_table import signal_keys
from vtff_gnss.rinex.errors import RinexError
from vtff_gnss.rinex.observation_records import SignalRows

__all__ = ["set_lock_times"]

# Longest step as a multiple of the usual step; covers the jitter of time tags.
_LONGEST_STEP = 1.5


def set_lock_times(
    rows: SignalRows,
    slips: SignalRows,
    time_nanoseconds: npt.NDArray[np.int64],
    power_failures: Collection[int],
    interval: float | None,
    name: str,
) -> None:
    """Fill in the lock times and complete ``FLAG_LOCK_LOST``.

    A signal's lock time counts from its first phase after a loss of lock: the loss-of-lock digit, a
    power failure, a reported slip, or a step between its phases of more than 1.5 times the usual
    one (the median step between the epochs of the file). It is a lower bound: at the start of a
    file and of each arc it is 0. After any of these the flag is set, except where a signal is
    seen first, where it stays as the file has it.

    Parameters
    ----------
    rows : SignalRows
        All observations; changed in place.
    slips : SignalRows
        Reported slips, not zero; the epoch is the one that follows.
    time_nanoseconds : ndarray of int64, shape (m,)
    power_failures : collection of int
        Epochs before which the receiver had been off.
    interval : float or None
        s; as the header says, used for a file of one or two epochs.
    name : str
        File, for messages.

    Raises
    ------
    RinexError
        If a satellite is listed twice in an epoch.
    """
    if not len(rows.epoch):
        return
    flags = rows.columns["flags"]
    keys = signal_keys(rows.columns)
    # Rows are in the order of time already.
    order = np.argsort(keys, kind="stable")
    _refuse_duplicates(rows, keys, order, name)
    flags[np.isin(rows.epoch, list(power_failures))] |= FLAG_LOCK_LOST
    _flag_slips(rows, keys, slips)
    order = order[(flags[order] & FLAG_PHASE_VALID) != 0]
    lock_time = np.zeros(len(keys))
    if len(order):
        time = time_nanoseconds[rows.epoch[order]]
        is_first = np.concatenate([[True], keys[order][1:] != keys[order][:-1]])
        longest = _LONGEST_STEP * _usual_step(time_nanoseconds, interval)
        is_interrupted = ~is_first & (np.diff(time, prepend=time[0]) > longest)
        flags[order[is_interrupted]] |= FLAG_LOCK_LOST
        is_start = is_first | ((flags[order] & FLAG_LOCK_LOST) != 0)
        start = np.maximum.accumulate(np.where(is_start, np.arange(len(order)), 0))
        lock_time[order] = (time - time[start]) / NANOSECONDS_PER_SECOND
    rows.columns["lock_time"][:] = lock_time


def _usual_step(time_nanoseconds: npt.NDArray[np.int64], interval: float | None) -> float:
    """Return the usual step between epochs in ns."""
    if len(time_nanoseconds) > 2 or (interval is None and len(time_nanoseconds) > 1):
        return float(np.median(np.diff(time_nanoseconds)))
    return np.inf if interval is None else interval * NANOSECONDS_PER_SECOND


def _refuse_duplicates(
    rows: SignalRows, keys: npt.NDArray[np.int64], order: npt.NDArray[np.intp], name: str
) -> None:
    is_same = (keys[order][1:] == keys[order][:-1]) & (
        rows.epoch[order][1:] == rows.epoch[order][:-1]
    )
    if is_same.any():
        number = int(rows.line_number[order[1:][is_same]].min())
        raise RinexError(f"{name}:{number}: a satellite is listed twice in this epoch")


def _flag_slips(rows: SignalRows, keys: npt.NDArray[np.int64], slips: SignalRows) -> None:
    """Flag the first observation after each reported slip; its repair need not be right."""
    slipped = signal_keys(slips.columns)
    for i in np.flatnonzero(slips.columns["flags"] & FLAG_PHASE_VALID):
        after = np.flatnonzero((keys == slipped[i]) & (rows.epoch >= slips.epoch[i]))
        rows.columns["flags"][after[:1]] |= FLAG_LOCK_LOST
