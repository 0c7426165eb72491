"""Two imagined logs of a receiver, with which a driver compiles all that it needs.

The first second of a receiver cannot wait for compilation, which takes seconds without a cache.
"""

from __future__ import annotations

import struct

from vtff_gnss.novatel import RangeSeries, ReceiverLogStream
from vtff_gnss.novatel.framing import MIN_HEADER_LENGTH, crc32_novatel
from vtff_gnss.novatel.message_ids import ID_RANGE
from vtff_gnss.novatel.range.range_logs import RANGE_RECORD

__all__ = ["rehearse_decoding"]

_HEADER = struct.Struct("<3sBHBBHHBBHIIHH")
_FINE_STEERING = 180


def rehearse_decoding() -> RangeSeries:
    """Return the observations of one satellite at two epochs, decoded from bytes."""
    frames = b"".join(_range_frame(week=2000, milliseconds=50 * epoch) for epoch in range(2))
    (series,) = ReceiverLogStream().feed_series(frames)
    assert isinstance(series, RangeSeries)
    return series


def _range_frame(week: int, milliseconds: int) -> bytes:
    """Return a RANGE log of GPS satellite 1, which has zeros for all that is measured."""
    record = struct.pack("<H", 1).ljust(RANGE_RECORD.itemsize, b"\0")
    payload = struct.pack("<I", 1) + record
    head = _HEADER.pack(
        b"\xaa\x44\x12", MIN_HEADER_LENGTH, ID_RANGE, 0, 0, len(payload), 0, 0, _FINE_STEERING,
        week, milliseconds, 0, 0, 0,
    )  # fmt: skip
    content = head + payload
    return content + struct.pack("<I", crc32_novatel(content))
