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
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch
from vtff_node.stamps import to_stamp

__all__ = ["serialize_observations"]

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
