"""A live receiver: its events, the end of each second of lockstep, and its health."""

from __future__ import annotations

import math

from vtff_gnss.novatel import Event
from vtff_gnss.observations import ObservationEpoch
from vtff_nav.receiver.receiver_session import ReceiverSession
from vtff_nav.receiver.second_watch import SecondWatch
from vtff_nav.receiver.stream_statistics import StreamStatistics

__all__ = ["LiveReceiver"]

#: Wall time, s, for which a second of lockstep waits for a receiver that was lost. The commands
#: to the receiver then arrive between the same two seconds in every run.
RECOVERY_HOLD = 2.0
#: Wall time, s, without observations after which a warning is given.
OBSERVATION_GAP = 3.0
#: Seconds of scenario time without a byte after which the receiver is configured again. The first
#: number is doubled as long as that does not help; its growth is limited to the second number.
SILENT_SECONDS = (2, 32)


class LiveReceiver:
    """Joins the session of a receiver with the watch over its seconds and its statistics.

    Parameters
    ----------
    session : ReceiverSession
    watch : SecondWatch
    """

    def __init__(self, session: ReceiverSession, watch: SecondWatch) -> None:
        self.session = session
        self.statistics = StreamStatistics()
        self._watch = watch
        self._is_waiting = False
        self._is_read = False
        self._silent_limit = SILENT_SECONDS[0]
        self._ran_at = -math.inf
        self._observed_at: float | None = None

    @property
    def newest_end(self) -> int:
        """Newest second that was read to its end, s since 1980-01-06 (GPS)."""
        return self._watch.newest_end

    def is_quiet(self, now: float) -> bool:
        """Return whether the receiver has been silent so long that its second is over."""
        return self._watch.is_quiet(now)

    def advance(self, now: float) -> list[Event]:
        """Advance the session without waiting and return the decoded events; `now` in s."""
        bytes_before = self.session.bytes_received
        was_running = self.session.is_running
        events = self.session.advance(now)
        byte_count = self.session.bytes_received - bytes_before
        is_dialogue = not (was_running and self.session.is_running)
        self._watch.read(byte_count, events, now, is_dialogue=is_dialogue)
        self.statistics.add(byte_count, events)
        if self.session.is_running:
            self._ran_at = now
        if self._observed_at is None or any(isinstance(e, ObservationEpoch) for e in events):
            self._observed_at = now
        return events

    def shortage(self, now: float, *, is_lockstep: bool) -> str:
        """Return what a configured receiver does not send; empty if it sends everything."""
        if is_lockstep:
            silent = self._watch.silent_seconds
            return f"nothing received for {silent} s of scenario time" if silent else ""
        silent_time = 0.0 if self._observed_at is None else now - self._observed_at
        return f"no observations for {silent_time:.0f} s" if silent_time > OBSERVATION_GAP else ""

    def begin_second(self, second: int, now: float) -> None:
        """Begin to wait for the end of a second of lockstep, in s since 1980-01-06 (GPS)."""
        self._watch.begin(second, now)
        self._is_waiting = True
        self._is_read = False

    def second_is_done(self, now: float) -> bool:
        """Return whether all logs of the second have been read; True only once for each second."""
        if not self._is_waiting:
            return False
        if not self._is_read:
            if not self._watch.is_done(now):
                return False
            self._is_read = True
            self._configure_silent_receiver()
        if not self.session.is_running and now - self._ran_at < RECOVERY_HOLD:
            return False
        self._is_waiting = False
        return True

    def _configure_silent_receiver(self) -> None:
        silent = self._watch.silent_seconds
        if silent == 0:
            self._silent_limit = SILENT_SECONDS[0]
        elif silent >= self._silent_limit:
            self.session.configure_again(f"nothing was received for {silent} s of scenario time")
            self._silent_limit = silent + min(silent, SILENT_SECONDS[1])
