"""Header of a NovAtel long binary frame."""

from __future__ import annotations

import struct
from typing import NamedTuple

from vtff_dynamics.constants import NANOSECONDS_PER_MILLISECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.novatel.framing import CRC_LENGTH, RESPONSE_BIT

__all__ = ["MILLISECONDS_PER_WEEK", "TIME_STATUS_UNKNOWN", "BinaryLog", "parse_binary_log"]

TIME_STATUS_UNKNOWN = 20
"""The receiver does not know the time; week and time of the header mean nothing."""

MILLISECONDS_PER_WEEK = 604_800_000

_HEADER = struct.Struct("<3xBHBxHHxBHII")


class BinaryLog(NamedTuple):
    """One binary log: fields of its header, its payload and the whole frame.

    `time` is None where the receiver did not know the time.
    """

    message_id: int
    is_response: bool
    time_status: int
    receiver_status: int
    time: GpsTime | None
    payload: bytes
    content: bytes


def parse_binary_log(content: bytes) -> BinaryLog:
    """Take apart a long binary frame whose length and CRC have been checked."""
    header_length, message_id, message_type, _, _, time_status, week, milliseconds, status = (
        _HEADER.unpack_from(content)
    )
    has_time = week > 0 and time_status != TIME_STATUS_UNKNOWN
    return BinaryLog(
        message_id=message_id,
        is_response=bool(message_type & RESPONSE_BIT),
        time_status=time_status,
        receiver_status=status,
        time=_time(week, milliseconds) if has_time else None,
        payload=content[header_length:-CRC_LENGTH],
        content=content,
    )


def _time(week: int, milliseconds: int) -> GpsTime:
    return GpsTime((week * MILLISECONDS_PER_WEEK + milliseconds) * NANOSECONDS_PER_MILLISECOND)
