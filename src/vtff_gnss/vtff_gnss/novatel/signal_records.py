"""Observations as they leave the decoder of any range log, before they become an epoch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_dynamics.timescales import GpsTime
from vtff_gnss.constants import FLAG_LOCK_LOST, SYSTEM_GLONASS
from vtff_gnss.novatel.lock_time import LockTimeTracker
from vtff_gnss.novatel.tracking_status import rinex_prn, rinex_signal
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch

__all__ = ["SignalRecords", "epoch_from_records"]


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
    band, attribute = rinex_signal(records.system, records.signal)
    prn = rinex_prn(records.system, records.prn_novatel)
    is_named = (band > 0) & (prn > 0)
    unnamed_count = int(len(prn) - np.count_nonzero(is_named))
    chosen = is_named if unnamed_count else slice(None)
    is_lost = lock_times.update(
        time,
        records.system[chosen],
        prn[chosen],
        records.signal[chosen],
        records.lock_time[chosen],
        records.lock_time_bound[chosen],
    )
    is_glonass = records.system == SYSTEM_GLONASS
    columns: dict[str, npt.NDArray[Any]] = {
        "system": records.system,
        "prn": prn,
        "band": band,
        "attribute": attribute,
        "glonass_channel": np.where(is_glonass, records.glonass_channel, 0),
        "pseudorange": records.pseudorange,
        "carrier_phase_cycles": records.carrier_phase_cycles,
        "doppler_hz": records.doppler_hz,
        "cn0_dbhz": records.cn0_dbhz,
        "pseudorange_sigma": records.pseudorange_sigma,
        "carrier_phase_sigma_cycles": records.carrier_phase_sigma_cycles,
        "lock_time": records.lock_time,
        "flags": records.flags,
    }
    # Copies, so that an epoch does not keep the bytes of its log alive.
    typed = {name: columns[name][chosen].astype(kind) for name, kind in OBSERVATION_COLUMNS.items()}
    typed["flags"][is_lost] |= FLAG_LOCK_LOST
    epoch = ObservationEpoch(
        time=time,
        time_status=time_status,
        receiver_status=receiver_status,
        log_name=log_name,
        **typed,
    )
    return epoch, unnamed_count
