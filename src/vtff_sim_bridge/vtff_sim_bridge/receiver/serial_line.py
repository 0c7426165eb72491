"""Serial line of an emulated receiver: what its rate carries in scenario time, and its load."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND

__all__ = ["DEFAULT_BAUD", "SerialLine"]

DEFAULT_BAUD = 9600
"""Factory setting of the ports."""


class SerialLine:
    """Serial line of a receiver.

    Parameters
    ----------
    is_limited : bool
        Whether it carries no more than its rate allows.
    buffer_bytes : int
        Size of the transmit buffer of a limited line.

    Attributes
    ----------
    baud, bits_per_byte : int
        Rate in bit/s; bits of each byte with those around it.
    waiting : bytearray
        Bytes in the transmit buffer.
    dropped_frames : int
        Frames for which it had no room.
    """

    def __init__(self, is_limited: bool, buffer_bytes: int) -> None:
        self.baud = DEFAULT_BAUD
        self.bits_per_byte = 10
        self.is_limited = is_limited
        self.waiting = bytearray()
        self.dropped_frames = 0
        self._buffer_bytes = buffer_bytes
        self._time_nanoseconds: int | None = None
        self._credit = 0
        self._recent: deque[tuple[Sequence[int], list[int]]] = deque()

    def send(self, times: Sequence[int], frames: Sequence[list[bytes]]) -> list[bytes]:
        """Take the frames of epochs, at times in ns; return the bytes to put out at each.

        With a limit these are the bytes that the line carried since the epoch before.
        """
        contents = [of_one[0] if len(of_one) == 1 else b"".join(of_one) for of_one in frames]
        self._account(times, contents)
        if not self.is_limited:
            return contents
        return [self._pass_on(*epoch) for epoch in zip(times, frames, strict=True)]

    def _pass_on(self, time: int, frames: list[bytes]) -> bytes:
        carried = self._carry(time)
        for frame in frames:
            if len(self.waiting) + len(frame) <= self._buffer_bytes:
                self.waiting += frame
            else:
                self.dropped_frames += 1
        return carried

    def load_percent(self) -> float:
        """Return the bits asked for in the last second of scenario time, relative to the rate."""
        if not self._recent:
            return 0.0
        before = self._recent[-1][0][-1] - NANOSECONDS_PER_SECOND
        recent_bytes = sum(
            count
            for times, counts in self._recent
            for time, count in zip(times, counts, strict=True)
            if time > before
        )
        return 100.0 * recent_bytes * self.bits_per_byte / self.baud

    def _carry(self, nanoseconds: int) -> bytes:
        if self._time_nanoseconds is not None:
            self._credit += self.baud * (nanoseconds - self._time_nanoseconds)
        self._time_nanoseconds = nanoseconds
        per_byte = self.bits_per_byte * NANOSECONDS_PER_SECOND
        count = min(self._credit // per_byte, len(self.waiting))
        carried = bytes(self.waiting[:count])
        del self.waiting[:count]
        # An idle line saves nothing up.
        self._credit = self._credit - count * per_byte if self.waiting else 0
        return carried

    def _account(self, times: Sequence[int], contents: list[bytes]) -> None:
        while self._recent and self._recent[0][0][-1] <= times[0] - NANOSECONDS_PER_SECOND:
            self._recent.popleft()
        self._recent.append((times, list(map(len, contents))))
