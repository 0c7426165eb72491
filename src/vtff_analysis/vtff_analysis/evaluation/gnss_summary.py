"""Summary of what a GNSS receiver observed: epochs, gaps, satellites, signals, ephemerides."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_analysis.recordings.history import ReceiverHistory, TimeArray
from vtff_gnss.constants import FLAG_LOCK_LOST, SYSTEM_LETTERS
from vtff_gnss.fix import STATUS_NONE
from vtff_gnss.signals import satellite_number, signal_from_number, signal_number

__all__ = ["count_signals", "signal_names", "summarise_receiver", "system_name"]

GAP_FACTOR = 1.5
"""An interval this many times the usual one is a gap."""

SYSTEM_NAMES = ("gps", "glonass", "sbas", "galileo", "beidou", "qzss", "navic")
"""Names of the satellite systems in keys, at the index of their number."""


def summarise_receiver(history: ReceiverHistory) -> dict[str, Any]:
    """Summarise the observations of one receiver.

    Parameters
    ----------
    history
        Its observations as columns.

    Returns
    -------
    dict
        Flat, keys as in docs/summary.md without the receiver's name.
    """
    satellites = satellite_number(history.system, history.prn)
    summary: dict[str, Any] = {"gnss_epochs": history.epoch_time.size}
    summary.update(_summarise_epochs(np.unique(history.epoch_time)))
    summary["gnss_observations"] = history.system.size
    summary["gnss_satellites"] = np.unique(satellites).size
    for number in np.unique(history.system):
        satellites_of_system = satellites[history.system == number]
        summary[f"gnss_satellites_{system_name(int(number))}"] = np.unique(
            satellites_of_system
        ).size
    summary.update(_summarise_tracking(history, satellites))
    for signal, count in count_signals(history).items():
        summary[f"gnss_observations_{signal.lower()}"] = count
    if history.fix_time.size:
        usable = history.fix_status != STATUS_NONE
        summary["gnss_fixes"] = history.fix_time.size
        summary["gnss_fixes_usable"] = int(usable.sum())
    ephemerides = satellite_number(history.ephemeris_system, history.ephemeris_prn)
    summary["gnss_ephemerides"] = ephemerides.size
    summary["gnss_ephemeris_satellites"] = np.unique(ephemerides).size
    return summary


def signal_names(
    system: npt.NDArray[np.uint8], band: npt.NDArray[np.uint8], attribute: npt.NDArray[np.uint8]
) -> npt.NDArray[np.str_]:
    """Return each signal by RINEX system, frequency and attribute (``G1C``), shape (n,)."""
    # PRN 0 stands for all satellites: only system, band and attribute are told apart.
    numbers, rows = np.unique(signal_number(system, 0, band, attribute), return_inverse=True)
    return np.array([_signal_name(number) for number in numbers], dtype=np.str_)[rows]


def count_signals(history: ReceiverHistory) -> dict[str, int]:
    """Return observations by signal, named as by `signal_names`."""
    numbers = signal_number(history.system, 0, history.band, history.attribute)
    signals, counts = np.unique(numbers, return_counts=True)
    names = [_signal_name(number) for number in signals]
    return dict(zip(names, counts.tolist(), strict=True))


def _signal_name(number: int) -> str:
    signal = signal_from_number(number)
    return f"{_system_letter(signal.system)}{signal.band}{chr(signal.attribute)}"


def system_name(system: int) -> str:
    """Return the name of a satellite system by its number."""
    return SYSTEM_NAMES[system] if system < len(SYSTEM_NAMES) else f"system{system}"


def _system_letter(system: int) -> str:
    return SYSTEM_LETTERS[system] if system < len(SYSTEM_LETTERS) else f"X{system}"


def _summarise_epochs(times: TimeArray) -> dict[str, Any]:
    if times.size == 0:
        return {}
    summary: dict[str, Any] = {"gnss_time_span_s": (times[-1] - times[0]) * 1e-9}
    if times.size < 2:
        return summary
    intervals = np.diff(times) * 1e-9
    usual = float(np.median(intervals))
    gaps = intervals > GAP_FACTOR * usual
    summary["gnss_interval_s"] = usual
    summary["gnss_gaps"] = int(gaps.sum())
    summary["gnss_missing_epochs"] = int(np.sum(np.round(intervals[gaps] / usual) - 1))
    summary["gnss_longest_gap_s"] = float(intervals[gaps].max()) if gaps.any() else 0.0
    return summary


def _summarise_tracking(
    history: ReceiverHistory, satellites: npt.NDArray[np.int64]
) -> dict[str, Any]:
    if history.epoch_time.size == 0:
        return {}
    epoch = np.repeat(np.arange(history.epoch_time.size), history.observations_per_epoch)
    names, column = np.unique(satellites, return_inverse=True)
    tracked = np.unique(epoch * max(1, names.size) + column)
    per_epoch = np.bincount(tracked // max(1, names.size), minlength=history.epoch_time.size)
    summary: dict[str, Any] = {
        "gnss_satellites_per_epoch_minimum": per_epoch.min(),
        "gnss_satellites_per_epoch_mean": per_epoch.mean(),
        "gnss_satellites_per_epoch_maximum": per_epoch.max(),
        "gnss_possible_cycle_slips": int(np.count_nonzero(history.flags & FLAG_LOCK_LOST)),
    }
    if history.cn0_dbhz.size:
        summary["gnss_cn0_mean_dbhz"] = float(np.nanmean(history.cn0_dbhz, dtype=float))
    return summary
