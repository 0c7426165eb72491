"""Two imagined logs of a receiver, with which a driver compiles all that it needs.

The first second of a receiver cannot wait for compilation, which takes seconds without a cache.
"""

from __future__ import annotations

import struct

from vtff_dynamics.constants import NANOSECONDS_PER_MILLISECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.novatel import RangeSeries, ReceiverLogStream
from vtff_gnss.novatel.encode.frame import HeaderSettings, encode_frame
from vtff_gnss.novatel.message_ids import ID_RANGE
from vtff_gnss.novatel.range.range_logs import RANGE_RECORD

__all__ = ["rehearse_decoding"]

#: One record of GPS satellite 1, which has zeros for all that is measured.
_PAYLOAD = struct.pack("<IH", 1, 1).ljust(4 + RANGE_RECORD.itemsize, b"\0")
_START = GpsTime.from_week_tow(2000, 0.0)


def rehearse_decoding() -> RangeSeries:
    """Return the observations of one satellite at two epochs, decoded from bytes."""
    times = (_START, GpsTime(_START.nanoseconds + 50 * NANOSECONDS_PER_MILLISECOND))
    frames = [encode_frame(ID_RANGE, _PAYLOAD, time, HeaderSettings()) for time in times]
    (series,) = ReceiverLogStream().feed_series(b"".join(frames))
    assert isinstance(series, RangeSeries)
    return series
