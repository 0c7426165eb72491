"""Observations as they leave the decoder of any range log, before they become an epoch."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.constants import FLAG_LOCK_LOST, SYSTEM_GLONASS
from vtff_gnss.novatel.range.lock_time import LockTimeTracker, lock_key
from vtff_gnss.novatel.range.tracking_status import rinex_prn, rinex_signal
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch

__all__ = ["SignalRecords", "epoch_from_records"]

_MEASURED_COLUMNS = (
    "pseudorange", "carrier_phase_cycles", "doppler_hz", "cn0_dbhz", "pseudorange_sigma",
    "carrier_phase_sigma_cycles", "lock_time", "flags",
)  # fmt: skip
"""Columns of an `ObservationEpoch` beyond those that name its signals."""


class SignalRecords(NamedTuple):
    """Columns of one range log in NovAtel's numbering; all of shape (n,).

    Carrier phase has the RINEX sign already; `lock_time_bound` is the greatest lock time that the
    log allows, `lock_time` the least.
    """

    system: npt.NDArray[np.intp]
    signal: npt.NDArray[np.intp]
    prn_novatel: npt.NDArray[np.integer]
    glonass_channel: npt.NDArray[np.integer]
    pseudorange: npt.NDArray[np.float64]
    carrier_phase_cycles: npt.NDArray[np.float64]
    doppler_hz: npt.NDArray[np.floating]
    cn0_dbhz: npt.NDArray[np.floating]
    pseudorange_sigma: npt.NDArray[np.floating]
    carrier_phase_sigma_cycles: npt.NDArray[np.floating]
    lock_time: npt.NDArray[np.floating]
    lock_time_bound: npt.NDArray[np.floating]
    flags: npt.NDArray[np.uint16]


def epoch_from_records(
    records: SignalRecords,
    time: GpsTime,
    time_status: int,
    receiver_status: int,
    log_name: str,
    lock_times: LockTimeTracker,
) -> tuple[ObservationEpoch, int]:
    """Name the signals as RINEX does, flag losses of lock, and build the epoch.

    Returns
    -------
    epoch : ObservationEpoch
        In the order of the log.
    unnamed_count : int
        Records left out because system, signal or satellite has no RINEX name.
    """
    signals = (records.system, records.signal, records.prn_novatel, records.glonass_channel)
    names = _signal_names(np.array(signals, dtype=np.int64).tobytes())
    if names.unnamed_count:
        records = SignalRecords._make(column[names.is_named] for column in records)
    is_lost = lock_times.update(time, names.lock_key, records.lock_time, records.lock_time_bound)
    # Copies, so that an epoch keeps neither the bytes of its log alive nor shares its columns.
    columns: dict[str, npt.NDArray[Any]] = {
        name: column.copy() for name, column in names.columns.items()
    }
    for name in _MEASURED_COLUMNS:
        columns[name] = getattr(records, name).astype(OBSERVATION_COLUMNS[name])
    columns["flags"] |= is_lost * np.uint16(FLAG_LOCK_LOST)
    epoch = ObservationEpoch(
        time=time,
        time_status=time_status,
        receiver_status=receiver_status,
        log_name=log_name,
        **columns,
    )
    return epoch, names.unnamed_count


@dataclass(frozen=True, eq=False)
class _SignalNames:
    """RINEX names of the signals of a log; arrays are read-only.

    Parameters
    ----------
    is_named : ndarray of bool
        Which of the records have a name.
    unnamed_count : int
        Number of records without a name.
    lock_key : ndarray of int64, shape (n,)
        See `vtff_gnss.novatel.range.lock_time.lock_key`.
    columns : dict of str to ndarray, shape (n,)
        Columns `system` to `glonass_channel` of an `ObservationEpoch`.
    """

    is_named: npt.NDArray[np.bool_]
    unnamed_count: int
    lock_key: npt.NDArray[np.int64]
    columns: dict[str, npt.NDArray[Any]]


@functools.lru_cache(maxsize=256)
def _signal_names(signals: bytes) -> _SignalNames:
    """Return the names of a list of signals, which stays the same over many epochs.

    Parameters
    ----------
    signals : bytes
        Columns `system`, `signal`, `prn_novatel` and `glonass_channel` of `SignalRecords`, each of
        int64, one after the other.
    """
    systems, signal, numbers, channel = np.frombuffer(signals, dtype=np.int64).reshape(4, -1)
    band, attribute = rinex_signal(systems, signal)
    prn = rinex_prn(systems, numbers)
    is_named = (band > 0) & (prn > 0)
    columns: dict[str, npt.NDArray[Any]] = {
        "system": systems,
        "prn": prn,
        "band": band,
        "attribute": attribute,
        "glonass_channel": np.where(systems == SYSTEM_GLONASS, channel, 0),
    }
    return _SignalNames(
        is_named,
        int(np.count_nonzero(~is_named)),
        lock_key(systems[is_named], prn[is_named], signal[is_named]),
        {name: c[is_named].astype(OBSERVATION_COLUMNS[name]) for name, c in columns.items()},
    )
