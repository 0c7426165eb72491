"""RANGE logs of the same signals that follow each other, decoded together.

A receiver that logs 20 times a second lists the same signals in many logs. To decode these in one
step, and to keep what was measured as it stands in their bytes until it is asked for, costs a small
part of an `ObservationEpoch` for each.
"""

from __future__ import annotations

import functools

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.novatel.message_ids import ID_RANGE, OBSERVATION_LOG_NAMES
from vtff_gnss.novatel.range.lock_time import MAX_TOLERANCE, LockTimeTracker
from vtff_gnss.novatel.range.signal_records import MEASURED_COLUMNS, SignalNames, signal_names
from vtff_gnss.novatel.range_kernels import (
    copy_range_columns,
    find_lost_locks,
    read_range_heads,
)
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch

__all__ = ["RangeSeries", "decode_range_series"]

_LOG_NAME = OBSERVATION_LOG_NAMES[ID_RANGE]


class RangeSeries:
    """Observations of the same n signals in k RANGE logs of one receiver.

    `epochs` gives them one by one, `write_columns` all at once.

    Parameters
    ----------
    nanoseconds : ndarray of int64, shape (k,)
        Receiver times, ns since 1980-01-06 (GPS).
    time_status, receiver_status : ndarray of uint8 and uint32, shape (k,)
    names : SignalNames
        Names of the n signals; most of the time the same object for the same signals.
    frames : ndarray of uint8, shape (k, length)
        Frames of the logs.
    flags : ndarray of uint16, shape (k, n)
        ``FLAG_*``, or-ed.

    Attributes
    ----------
    times : list of int
        Receiver times as Python integers, ns since 1980-01-06 (GPS).
    """

    def __init__(
        self,
        nanoseconds: npt.NDArray[np.int64],
        time_status: npt.NDArray[np.uint8],
        receiver_status: npt.NDArray[np.uint32],
        names: SignalNames,
        frames: npt.NDArray[np.uint8],
        flags: npt.NDArray[np.uint16],
    ) -> None:
        self.nanoseconds = nanoseconds
        self.times: list[int] = nanoseconds.tolist()
        self.time_status = time_status
        self.receiver_status = receiver_status
        self.names = names
        self._frames = frames
        self._flags = flags

    def __len__(self) -> int:
        """Return the number of logs."""
        return len(self.times)

    def write_columns(self, rows: npt.NDArray[np.uint8], starts: npt.NDArray[np.int64]) -> None:
        """Write what was measured into rows of bytes, in the byte order of x86.

        Parameters
        ----------
        rows : ndarray of uint8, shape (k or fewer, size)
            A row for each of the last logs.
        starts : ndarray of int64, shape (8,)
            Where in a row each of `MEASURED_COLUMNS` begins: n elements of the type that
            `OBSERVATION_COLUMNS` states.
        """
        logs = slice(len(self) - len(rows), None)
        copy_range_columns(self._frames[logs], self.names.places, self._flags[logs], rows, starts)

    def epochs(self, first: int = 0) -> list[ObservationEpoch]:
        """Return the logs from `first` on as epochs; none shares its columns with another."""
        template, starts = _row_layout(self.names)
        rows = np.empty((len(self) - first, len(template)), dtype=np.uint8)
        rows[:] = template
        self.write_columns(rows, starts[-len(MEASURED_COLUMNS) :])
        count = len(self.names)
        columns = [
            rows[:, start : start + count * np.dtype(kind).itemsize].view(kind)
            for start, kind in zip(starts.tolist(), OBSERVATION_COLUMNS.values(), strict=True)
        ]
        heads = zip(
            self.times[first:],
            self.time_status[first:].tolist(),
            self.receiver_status[first:].tolist(),
            strict=True,
        )
        return [
            ObservationEpoch(
                time=GpsTime(nanoseconds),
                time_status=time_status,
                receiver_status=receiver_status,
                log_name=_LOG_NAME,
                **dict(zip(OBSERVATION_COLUMNS, values, strict=True)),
            )
            for (nanoseconds, time_status, receiver_status), *values in zip(
                heads, *columns, strict=True
            )
        ]


def decode_range_series(
    content: bytes, count: int, lock_times: LockTimeTracker
) -> RangeSeries | None:
    """Decode RANGE logs together, as one by one.

    Parameters
    ----------
    content : bytes
        Frames of one length, whose checksums and lengths are right.
    count : int
        Number of frames.
    lock_times : LockTimeTracker
        Takes the lock times.

    Returns
    -------
    RangeSeries or None
        None, and nothing is taken, where the logs do not list the same signals in the same order,
        one of them twice, or where a log has no time: then decode them one by one.
    """
    frames = np.frombuffer(content, dtype=np.uint8).reshape(count, -1)
    header_length = content[3]
    signals = np.empty(
        (4, int.from_bytes(content[header_length : header_length + 4], "little")), np.int64
    )
    nanoseconds = np.empty(count, dtype=np.int64)
    time_status = np.empty(count, dtype=np.uint8)
    receiver_status = np.empty(count, dtype=np.uint32)
    if not read_range_heads(frames, signals, nanoseconds, time_status, receiver_status):
        return None
    names = signal_names(signals.tobytes())
    if names.has_repetition:
        return None
    flags = np.empty((count, len(names)), dtype=np.uint16)
    find_lost_locks(
        frames,
        names.places,
        names.lock_key,
        nanoseconds,
        lock_times.seconds,
        lock_times.lock_time,
        MAX_TOLERANCE,
        flags,
    )
    return RangeSeries(nanoseconds, time_status, receiver_status, names, frames, flags)


@functools.lru_cache(maxsize=64)
def _row_layout(names: SignalNames) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.int64]]:
    """Return a row with the names of signals, and where in it each column of an epoch begins."""
    columns = {
        name: names.columns.get(name, np.zeros(len(names), dtype=kind))
        for name, kind in OBSERVATION_COLUMNS.items()
    }
    starts = []
    row = bytearray()
    for column in columns.values():
        row += bytes(-len(row) % column.itemsize)
        starts.append(len(row))
        row += column.tobytes()
    row += bytes(-len(row) % 8)
    return np.frombuffer(bytes(row), dtype=np.uint8), np.array(starts, dtype=np.int64)
