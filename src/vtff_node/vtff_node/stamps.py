"""Header stamps as integer nanoseconds since 1970 (UTC), never as floats."""

from __future__ import annotations

from builtin_interfaces.msg import Time

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND


def to_nanoseconds(stamp: Time) -> int:
    """Return a stamp as nanoseconds since 1970."""
    return int(stamp.sec) * NANOSECONDS_PER_SECOND + int(stamp.nanosec)


def to_stamp(nanoseconds: int) -> Time:
    """Return nanoseconds since 1970 as a stamp.

    Raises
    ------
    ValueError
        If the time lies outside the years 1901 to 2038, which the 32-bit seconds of a ROS stamp
        can hold.
    """
    seconds, remainder = divmod(nanoseconds, NANOSECONDS_PER_SECOND)
    if not -(2**31) <= seconds < 2**31:
        raise ValueError(
            f"time {seconds} s since 1970 does not fit a ROS stamp, which ends on 2038-01-19"
        )
    return Time(sec=seconds, nanosec=remainder)


class StampOrder:
    """Accepts each stamp once and in ascending order; after a jump far back the order starts anew.

    A node must not act on a message that is repeated or was overtaken by a later one. A simulator
    that starts again, or a bag that is played again, goes back in time by much more than messages
    overtake each other.

    Attributes
    ----------
    refused
        Number of stamps refused so far.
    """

    #: A smaller step back in time is disorder, a larger step is a new beginning, ns.
    JUMP_BACK = 30 * NANOSECONDS_PER_SECOND

    def __init__(self) -> None:
        self.refused = 0
        self._newest: int | None = None
        self._reported = 0

    def accepts(self, nanoseconds: int) -> bool:
        """Return whether the node shall act on a message with this stamp; count the refusals."""
        if self._newest is not None and 0 <= self._newest - nanoseconds < self.JUMP_BACK:
            self.refused += 1
            return False
        self._newest = nanoseconds
        return True

    def refused_since_last_look(self) -> bool:
        """Return whether a stamp was refused since the last call of this method."""
        before, self._reported = self._reported, self.refused
        return self.refused > before
