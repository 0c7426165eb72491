"""Observations as they leave the decoder of any range log, before they become an epoch."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.constants import FLAG_LOCK_LOST, SYSTEM_GLONASS
from vtff_gnss.novatel.range.lock_time import LockTimeTracker, lock_key
from vtff_gnss.novatel.range.tracking_status import rinex_prn, rinex_signal
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch

__all__ = ["EpochHeader", "SignalRecords", "epoch_from_records", "epochs_from_records"]

_MEASURED_COLUMNS = (
    "pseudorange", "carrier_phase_cycles", "doppler_hz", "cn0_dbhz", "pseudorange_sigma",
    "carrier_phase_sigma_cycles", "lock_time", "flags",
)  # fmt: skip


@dataclass(frozen=True)
class SignalRecords:
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
    names = _names_of(
        records.system.tobytes(),
        records.signal.tobytes(),
        np.asarray(records.prn_novatel, dtype=np.intp).tobytes(),
        np.asarray(records.glonass_channel, dtype=np.int64).tobytes(),
    )
    chosen = names.chosen
    is_lost = lock_times.update(
        time, names.lock_key, records.lock_time[chosen], records.lock_time_bound[chosen]
    )
    # Copies, so that an epoch keeps neither the bytes of its log alive nor shares its columns.
    columns: dict[str, npt.NDArray[Any]] = {
        name: column.copy() for name, column in names.columns.items()
    }
    for name in _MEASURED_COLUMNS:
        columns[name] = getattr(records, name)[chosen].astype(OBSERVATION_COLUMNS[name])
    columns["flags"][is_lost] |= FLAG_LOCK_LOST
    epoch = ObservationEpoch(
        time=time,
        time_status=time_status,
        receiver_status=receiver_status,
        log_name=log_name,
        **columns,
    )
    return epoch, names.unnamed_count


@dataclass(frozen=True)
class EpochHeader:
    """Fields of the header of a range log."""

    time: GpsTime
    time_status: int
    receiver_status: int


def epochs_from_records(
    records: SignalRecords,
    headers: Sequence[EpochHeader],
    log_name: str,
    lock_times: LockTimeTracker,
) -> tuple[list[ObservationEpoch], int] | None:
    """Build the epochs of k logs of the same signals, as `epoch_from_records` one by one.

    Parameters
    ----------
    records : SignalRecords
        Columns `system` to `glonass_channel` of shape (n,), the others of shape (k, n).

    Returns
    -------
    epochs : list of ObservationEpoch
    unnamed_count : int
        Records left out of each log.

    None if a signal is in the logs twice: `lock_times` then has to take one epoch after another.
    """
    names = _names_of(
        records.system.tobytes(),
        records.signal.tobytes(),
        np.asarray(records.prn_novatel, dtype=np.intp).tobytes(),
        np.asarray(records.glonass_channel, dtype=np.int64).tobytes(),
    )
    if names.has_repetition:
        return None
    chosen = (slice(None), names.chosen)
    is_lost = lock_times.update_series(
        [header.time for header in headers],
        names.lock_key,
        records.lock_time[chosen],
        records.lock_time_bound[chosen],
    )
    columns: dict[str, npt.NDArray[Any]] = {
        name: np.tile(column, (len(headers), 1)) for name, column in names.columns.items()
    }
    for name in _MEASURED_COLUMNS:
        columns[name] = getattr(records, name)[chosen].astype(OBSERVATION_COLUMNS[name])
    columns["flags"][is_lost] |= FLAG_LOCK_LOST
    epochs = [
        ObservationEpoch(
            time=header.time,
            time_status=header.time_status,
            receiver_status=header.receiver_status,
            log_name=log_name,
            **dict(zip(columns, rows, strict=True)),
        )
        for header, *rows in zip(headers, *columns.values(), strict=True)
    ]
    return epochs, names.unnamed_count


class _Names(NamedTuple):
    """RINEX names of the signals of a log; arrays are read-only."""

    chosen: npt.NDArray[np.bool_] | slice
    unnamed_count: int
    lock_key: npt.NDArray[np.intp]
    has_repetition: bool
    columns: dict[str, npt.NDArray[Any]]


@functools.lru_cache(maxsize=256)
def _names_of(system: bytes, signal: bytes, prn_novatel: bytes, glonass_channel: bytes) -> _Names:
    """Return the names of a list of signals, which stays the same over many epochs."""
    systems, signals, numbers = (
        np.frombuffer(column, dtype=np.intp) for column in (system, signal, prn_novatel)
    )
    band, attribute = rinex_signal(systems, signals)
    prn = rinex_prn(systems, numbers)
    is_named = (band > 0) & (prn > 0)
    unnamed_count = int(len(prn) - np.count_nonzero(is_named))
    chosen = is_named if unnamed_count else slice(None)
    channel = np.frombuffer(glonass_channel, dtype=np.int64)
    columns: dict[str, npt.NDArray[Any]] = {
        "system": systems,
        "prn": prn,
        "band": band,
        "attribute": attribute,
        "glonass_channel": np.where(systems == SYSTEM_GLONASS, channel, 0),
    }
    key = lock_key(systems[chosen], prn[chosen], signals[chosen])
    return _Names(
        chosen,
        unnamed_count,
        key,
        len(np.unique(key)) < len(key),
        {name: c[chosen].astype(OBSERVATION_COLUMNS[name]) for name, c in columns.items()},
    )
