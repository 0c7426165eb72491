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


class StampOrder:
    """Accepts each stamp once and in order; a jump far back in time starts anew.

    A message that is repeated or has been overtaken must not be answered twice. A simulator
    that starts again, or a bag that is played again, goes back by more than a moment.

    Attributes
    ----------
    refused
        Stamps refused so far.
    """

    #: A smaller step back is disorder, a larger one a new beginning, ns.
    JUMP_BACK = 30 * NANOSECONDS

    def __init__(self) -> None:
        self.refused = 0
        self._newest: int | None = None
        self._reported = 0

    def accepts(self, nanoseconds: int) -> bool:
        """Whether a message of this stamp is to be acted on."""
        if self._newest is not None and 0 <= self._newest - nanoseconds < self.JUMP_BACK:
            self.refused += 1
            return False
        self._newest = nanoseconds
        return True

    def refused_since_last_look(self) -> bool:
        """Whether any was refused since the last call."""
        before, self._reported = self._reported, self.refused
        return self.refused > before
