"""Raw observations of one receiver epoch as numpy columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime

__all__ = ["OBSERVATION_COLUMNS", "EpochTimes", "ObservationEpoch", "ObservationSeries"]

OBSERVATION_COLUMNS: dict[str, type[np.generic]] = {
    "system": np.uint8,
    "prn": np.uint8,
    "band": np.uint8,
    "attribute": np.uint8,
    "glonass_channel": np.int8,
    "pseudorange": np.float64,
    "carrier_phase_cycles": np.float64,
    "doppler_hz": np.float32,
    "cn0_dbhz": np.float32,
    "pseudorange_sigma": np.float32,
    "carrier_phase_sigma_cycles": np.float32,
    "lock_time": np.float32,
    "flags": np.uint16,
}
"""Name and element type of every column, as in ``vtff_msgs/GnssObservations``."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _ObservationColumns:
    """Columns of `OBSERVATION_COLUMNS`."""

    system: npt.NDArray[np.uint8]
    prn: npt.NDArray[np.uint8]
    band: npt.NDArray[np.uint8]
    attribute: npt.NDArray[np.uint8]
    glonass_channel: npt.NDArray[np.int8]
    pseudorange: npt.NDArray[np.float64]
    carrier_phase_cycles: npt.NDArray[np.float64]
    doppler_hz: npt.NDArray[np.floating[Any]]
    cn0_dbhz: npt.NDArray[np.floating[Any]]
    pseudorange_sigma: npt.NDArray[np.floating[Any]]
    carrier_phase_sigma_cycles: npt.NDArray[np.floating[Any]]
    lock_time: npt.NDArray[np.floating[Any]]
    flags: npt.NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class ObservationEpoch(_ObservationColumns):
    """Observations of all signals that one receiver tracked at one epoch.

    Element i of every column belongs to one signal; all columns have shape (n,). Names, units and
    signs are those of ``vtff_msgs/GnssObservations``, so that a node copies the columns.

    Parameters
    ----------
    time : GpsTime
        Receiver time of the epoch.
    time_status : int
        The receiver's own code of the quality of its time (NovAtel: 180 = fine steering).
    receiver_status : int
        The receiver's own status word.
    log_name : str
        Receiver log that the epoch was read from, e.g. ``"RANGECMP"``.
    system, prn, band, attribute : ndarray of uint8
        ``SYSTEM_*``, RINEX satellite number, RINEX frequency digit and RINEX tracking attribute
        as an ASCII code.
    glonass_channel : ndarray of int8
        -7..+6; `GLONASS_CHANNEL_UNKNOWN` if the log does not tell; 0 for other systems.
    pseudorange : ndarray of float64
        m.
    carrier_phase_cycles : ndarray of float64
        Cycles, RINEX sign: grows with distance.
    doppler_hz : ndarray of float32
        Hz, positive when approaching.
    cn0_dbhz, pseudorange_sigma, carrier_phase_sigma_cycles : ndarray of float32
        dB-Hz; m and cycles as stated by the receiver.
    lock_time : ndarray of float32
        s of continuous tracking; a lower bound where the log saturates.
    flags : ndarray of uint16
        ``FLAG_*``, or-ed. Values whose flag is absent are kept as the receiver gave them.
    """

    time: GpsTime
    time_status: int
    receiver_status: int
    log_name: str

    def __len__(self) -> int:
        """Return the number of signals."""
        return len(self.prn)

    def __eq__(self, other: object) -> bool:
        """Compare all fields; NaN equals NaN."""
        if not isinstance(other, ObservationEpoch):
            return NotImplemented
        for field in fields(self):
            mine, theirs = getattr(self, field.name), getattr(other, field.name)
            if isinstance(mine, np.ndarray):
                if not np.array_equal(mine, theirs, equal_nan=mine.dtype.kind == "f"):
                    return False
            elif mine != theirs:
                return False
        return True

    __hash__ = None  # type: ignore[assignment]

    @property
    def gps_week(self) -> int:
        """Full GPS week number since 1980-01-06."""
        return self.time.week

    @property
    def gps_time_of_week(self) -> float:
        """Seconds of the GPS week."""
        return self.time.time_of_week

    def columns(self) -> dict[str, npt.NDArray[np.generic]]:
        """Return all columns by name."""
        return {name: getattr(self, name) for name in OBSERVATION_COLUMNS}


class EpochTimes(Sequence[GpsTime]):
    """Times of epochs, which become objects when they are asked for.

    Parameters
    ----------
    nanoseconds : sequence of int
        GPS times, ns since 1980-01-06.

    Attributes
    ----------
    nanoseconds : list of int
        GPS times, ns since 1980-01-06, as a list.
    """

    def __init__(self, nanoseconds: Sequence[int]) -> None:
        self.nanoseconds = list(nanoseconds)

    def __len__(self) -> int:
        """Return the number of epochs."""
        return len(self.nanoseconds)

    @overload
    def __getitem__(self, index: int) -> GpsTime: ...

    @overload
    def __getitem__(self, index: slice) -> EpochTimes: ...

    def __getitem__(self, index: int | slice) -> GpsTime | EpochTimes:
        """Return the time of an epoch, or the times of some."""
        if isinstance(index, slice):
            return EpochTimes(self.nanoseconds[index])
        return GpsTime(self.nanoseconds[index])


_SIGNAL_COLUMNS = ("system", "prn", "band", "attribute", "glonass_channel")


@dataclass(frozen=True, eq=False)
class ObservationSeries(_ObservationColumns):
    """Observations of the same n signals at k epochs of one receiver, as a simulator makes them.

    Columns are those of `ObservationEpoch`: `system` to `glonass_channel` of shape (n,), the others
    of shape (k, n) and maybe more precise. What is not observed at an epoch has any value there.

    Parameters
    ----------
    times : sequence of GpsTime
        Receiver times of the epochs.
    time_status, receiver_status, log_name
        Fields of `ObservationEpoch` that are equal in all epochs.
    is_observed : ndarray of bool, shape (k, n)
    channel : ndarray of uint8, shape (k, n), or None
        Receiver channels 0..31, if known.
    """

    times: Sequence[GpsTime]
    time_status: int
    receiver_status: int
    log_name: str
    is_observed: npt.NDArray[np.bool_]
    channel: npt.NDArray[np.uint8] | None = None

    def __len__(self) -> int:
        """Return the number of epochs."""
        return len(self.times)

    def epoch(self, index: int) -> ObservationEpoch:
        """Return what was observed at one epoch."""
        chosen = self.is_observed[index]
        columns: dict[str, Any] = {
            name: getattr(self, name)[chosen]
            if name in _SIGNAL_COLUMNS
            else getattr(self, name)[index][chosen].astype(kind, copy=False)
            for name, kind in OBSERVATION_COLUMNS.items()
        }
        return ObservationEpoch(
            self.times[index], self.time_status, self.receiver_status, self.log_name, **columns
        )
