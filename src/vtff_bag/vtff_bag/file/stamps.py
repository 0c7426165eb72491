"""Stamps of serialised messages, read without deserialising them."""

from __future__ import annotations

import struct

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND

__all__ = ["CLOCK_TYPE", "leading_stamp"]

CLOCK_TYPE = "rosgraph_msgs/msg/Clock"

_STAMP = {0: struct.Struct(">iI"), 1: struct.Struct("<iI")}  # by the byte order flag of CDR
_ENCAPSULATION = 4  # bytes before the first field


def leading_stamp(serialized: bytes) -> int:
    """Return the stamp at the beginning of a CDR message, ns since 1970.

    Parameters
    ----------
    serialized
        CDR of a type that begins with builtin_interfaces/Time or std_msgs/Header: seconds
        (int32) in bytes 4 to 7, nanoseconds (uint32) in bytes 8 to 11.

    Returns
    -------
    int
        0 where the stamp is unset or negative, or the message is too short.
    """
    if len(serialized) < _ENCAPSULATION + 8:
        return 0
    seconds: int
    nanoseconds: int
    seconds, nanoseconds = _STAMP[serialized[1] & 1].unpack_from(serialized, _ENCAPSULATION)
    return max(0, seconds * NANOSECONDS_PER_SECOND + nanoseconds)
