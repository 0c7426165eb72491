"""Header stamps as integer nanoseconds since 1970 (UTC), never as floats."""

from __future__ import annotations

from builtin_interfaces.msg import Time

NANOSECONDS = 1_000_000_000


def to_nanoseconds(stamp: Time) -> int:
    """Return a stamp as nanoseconds since 1970."""
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def to_stamp(nanoseconds: int) -> Time:
    """Return nanoseconds since 1970 as a stamp.

    Raises
    ------
    ValueError
        Outside the years 1901 to 2038 that the 32-bit seconds of a ROS stamp can hold.
    """
    seconds, remainder = divmod(nanoseconds, NANOSECONDS)
    if not -(2**31) <= seconds < 2**31:
        raise ValueError(
            f"time {seconds} s since 1970 does not fit a ROS stamp, which ends on 2038-01-19"
        )
    return Time(sec=seconds, nanosec=remainder)
