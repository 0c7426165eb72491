"""Observations as the bytes of a vtff_msgs/GnssObservations, without a message object.

A receiver has 20 of these messages a second. To build the object and to let ROS serialise it costs
four times as much as to copy the columns to their positions in the bytes, which depend on the frame
and the number of signals only.

References
----------
OMG, Common Object Request Broker Architecture 3.4, part 2, section 9.3 (CDR: alignment to the size
of a number, sequences after a count of 4 bytes); OMG, DDSI-RTPS 2.5, section 10 (first 4 bytes).
"""

from __future__ import annotations

import functools
import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND, SECONDS_PER_WEEK
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.novatel import RangeSeries
from vtff_gnss.novatel.range.signal_records import MEASURED_COLUMNS, SignalNames
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch
from vtff_node.stamps import fits_stamp, to_stamp

__all__ = ["serialize_observations", "serialize_series"]

_LITTLE_ENDIAN = b"\x00\x01\x00\x00"  # encapsulation of plain CDR
_STAMP = struct.Struct("<iI")
_WEEK = struct.Struct("<H")
_TIME_OF_WEEK = struct.Struct("<d")
_TIME_STATUS = struct.Struct("<B")
_UINT32 = struct.Struct("<I")


class _Layout(NamedTuple):
    """Positions in the bytes of a message with a number of signals.

    `template` holds all that is the same in each of them: frame and numbers of elements.
    """

    template: bytes
    week: int
    time_of_week: int
    time_status: int
    receiver_status: int
    columns: tuple[tuple[str, np.dtype[Any], int, int], ...]


def serialize_observations(epoch: ObservationEpoch, frame_id: str) -> bytes:
    """Return the message of one receiver epoch as `rclpy.serialization.serialize_message` does.

    Raises
    ------
    ValueError
        If the columns are not all of one length, or the time does not fit a stamp.
    TypeError
        If a column has another element type than the message.
    """
    count = len(epoch)
    layout = _layout(frame_id, count)
    content = bytearray(layout.template)
    stamp = to_stamp(epoch.time.to_unix_nanoseconds())
    _STAMP.pack_into(content, len(_LITTLE_ENDIAN), stamp.sec, stamp.nanosec)
    _WEEK.pack_into(content, layout.week, epoch.gps_week)
    _TIME_OF_WEEK.pack_into(content, layout.time_of_week, epoch.gps_time_of_week)
    _TIME_STATUS.pack_into(content, layout.time_status, epoch.time_status)
    _UINT32.pack_into(content, layout.receiver_status, epoch.receiver_status)
    for name, kind, start, end in layout.columns:
        column: npt.NDArray[Any] = getattr(epoch, name)
        if column.dtype != kind:
            raise TypeError(f"observation column '{name}' is {column.dtype}; it must be {kind}")
        if column.shape != (count,):
            raise ValueError(
                f"observation column '{name}' has shape {column.shape}; 'prn' has {count} elements"
            )
        content[start:end] = column.tobytes()
    return bytes(content)


def serialize_series(series: RangeSeries, frame_id: str) -> list[bytes]:
    """Return the messages of some epochs of the same signals, as `serialize_observations` does.

    Raises
    ------
    ValueError
        If a time does not fit a stamp.
    """
    offset = _unix_offset(series.times)
    if offset is None:
        return [serialize_observations(epoch, frame_id) for epoch in series.epochs()]
    template, heads, columns = _series_layout(frame_id, series.names)
    rows = np.empty((len(series), len(template)), dtype=np.uint8)
    rows[:] = template
    series.write_columns(rows, columns)
    status = series.time_status, series.receiver_status
    _write_heads(rows, heads, offset, series.nanoseconds, *status)
    content = rows.tobytes()
    return [content[k : k + len(template)] for k in range(0, len(content), len(template))]


def _unix_offset(times: Sequence[int]) -> int | None:
    """Return Unix times less GPS times of some times in ns since 1980-01-06 (GPS).

    None if a leap second is between them, or one does not fit a stamp.
    """
    ends = min(times), max(times)
    unix = [GpsTime(time).to_unix_nanoseconds() for time in ends]
    first, last = (after - before for after, before in zip(unix, ends, strict=True))
    return first if first == last and all(map(fits_stamp, unix)) else None


@functools.lru_cache(maxsize=64)
def _series_layout(
    frame_id: str, names: SignalNames
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the message of some signals without its numbers, and where in it these stand.

    Returns
    -------
    template : ndarray of uint8, shape (size,)
    heads : ndarray of int64, shape (5,)
        Positions of stamp, week, time of week, time status and receiver status.
    columns : ndarray of int64, shape (8,)
        Those of `MEASURED_COLUMNS`.
    """
    layout = _layout(frame_id, len(names))
    content = bytearray(layout.template)
    starts = []
    for name, kind, start, end in layout.columns:
        if name in MEASURED_COLUMNS:
            starts.append(start)
        else:
            content[start:end] = names.columns[name].astype(kind, copy=False).tobytes()
    heads = (
        len(_LITTLE_ENDIAN),
        layout.week,
        layout.time_of_week,
        layout.time_status,
        layout.receiver_status,
    )
    template = np.frombuffer(bytes(content), dtype=np.uint8)
    return template, np.array(heads, dtype=np.int64), np.array(starts, dtype=np.int64)


@compiled
def _write_integer(row, position, number, size):  # type: ignore[no-untyped-def]
    for byte in range(size):
        row[position + byte] = number >> (8 * byte) & 255


@compiled
def _write_heads(rows, heads, unix_offset, gps, time_status, receiver_status):  # type: ignore[no-untyped-def]
    """Write the fields of messages that are not in columns.

    Parameters
    ----------
    rows : ndarray of uint8, shape (k, size)
    heads : ndarray of int64, shape (5,)
        See `_series_layout`.
    unix_offset : int
        Unix times less GPS times, ns.
    gps : ndarray of int64, shape (k,)
        Times, ns since 1980-01-06 (GPS).
    time_status, receiver_status : ndarray of uint8 and uint32, shape (k,)
    """
    time_of_week = np.empty(1)
    bits = time_of_week.view(np.int64)
    for index in range(len(rows)):
        row = rows[index]
        week, rest = divmod(gps[index], NANOSECONDS_PER_SECOND * SECONDS_PER_WEEK)
        time_of_week[0] = rest / NANOSECONDS_PER_SECOND
        seconds, remainder = divmod(gps[index] + unix_offset, NANOSECONDS_PER_SECOND)
        _write_integer(row, heads[0], seconds, 4)
        _write_integer(row, heads[0] + 4, remainder, 4)
        _write_integer(row, heads[1], week, 2)
        _write_integer(row, heads[2], bits[0], 8)
        _write_integer(row, heads[3], np.int64(time_status[index]), 1)
        _write_integer(row, heads[4], np.int64(receiver_status[index]), 4)


@functools.lru_cache(maxsize=256)
def _layout(frame_id: str, count: int) -> _Layout:
    content = bytearray(_LITTLE_ENDIAN)

    def reserve(size: int, alignment: int) -> int:
        """Append zeros for a field; return its position."""
        # The first 4 bytes do not count for the alignment.
        content.extend(bytes(-(len(content) - len(_LITTLE_ENDIAN)) % alignment))
        position = len(content)
        content.extend(bytes(size))
        return position

    reserve(_STAMP.size, 4)
    text = frame_id.encode() + b"\0"
    _UINT32.pack_into(content, reserve(_UINT32.size, 4), len(text))
    content.extend(text)
    week = reserve(_WEEK.size, 2)
    time_of_week = reserve(_TIME_OF_WEEK.size, 8)
    time_status = reserve(_TIME_STATUS.size, 1)
    receiver_status = reserve(_UINT32.size, 4)
    columns = []
    for name, kind in OBSERVATION_COLUMNS.items():
        _UINT32.pack_into(content, reserve(_UINT32.size, 4), count)
        dtype = np.dtype(kind)
        # Fast CDR aligns a sequence without elements too.
        start = reserve(count * dtype.itemsize, dtype.itemsize)
        columns.append((name, dtype, start, start + count * dtype.itemsize))
    return _Layout(bytes(content), week, time_of_week, time_status, receiver_status, tuple(columns))
