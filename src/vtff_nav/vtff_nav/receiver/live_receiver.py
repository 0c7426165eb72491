"""A live receiver as the driver sees it: its events, the seconds of lockstep, its health."""

from __future__ import annotations

import math

from vtff_gnss.novatel import Event
from vtff_gnss.observations import ObservationEpoch
from vtff_nav.receiver.receiver_session import ReceiverSession
from vtff_nav.receiver.second_watch import SecondWatch
from vtff_nav.receiver.stream_statistics import StreamStatistics

__all__ = ["LiveReceiver"]

#: Wall time, s, for which a second of lockstep waits for a receiver that is looked for again.
#: Its commands then arrive between the same two seconds in every run.
RECOVERY_HOLD = 2.0
#: Wall time, s, without observations that is worth a warning.
OBSERVATION_GAP = 3.0
#: Seconds of scenario time without a byte after which the receiver is configured again; doubled
#: each time that does not help, up to the second number.
SILENT_SECONDS = (2, 32)


class LiveReceiver:
    """Joins a session with the watch over seconds and the statistics.

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
        """Newest second, s since 1980-01-06 (GPS), that was read to its end."""
        return self._watch.newest_end

    def is_quiet(self, now: float) -> bool:
        """Whether nothing more is expected to come soon."""
        return self._watch.is_quiet(now)

    def advance(self, now: float) -> list[Event]:
        """Do what can be done without waiting and return what was decoded; `now` in s."""
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
        """Return what does not come though the receiver is configured; empty if all does."""
        if is_lockstep:
            silent = self._watch.silent_seconds
            return f"nothing received for {silent} s of scenario time" if silent else ""
        silent_time = 0.0 if self._observed_at is None else now - self._observed_at
        return f"no observations for {silent_time:.0f} s" if silent_time > OBSERVATION_GAP else ""

    def begin_second(self, second: int, now: float) -> None:
        """Begin to wait for the end of a second of lockstep, s since 1980-01-06 (GPS)."""
        self._watch.begin(second, now)
        self._is_waiting = True
        self._is_read = False

    def second_is_done(self, now: float) -> bool:
        """Whether all that the receiver sends for the second has been read; true once."""
        if not self._is_waiting:
            return False
        if not self._is_read:
            if not self._watch.is_done(now):
                return False
            self._is_read = True
            self._look_after_silence()
        if not self.session.is_running and now - self._ran_at < RECOVERY_HOLD:
            return False
        self._is_waiting = False
        return True

    def _look_after_silence(self) -> None:
        silent = self._watch.silent_seconds
        if silent == 0:
            self._silent_limit = SILENT_SECONDS[0]
        elif silent >= self._silent_limit:
            self.session.configure_again(f"nothing was received for {silent} s of scenario time")
            self._silent_limit = silent + min(silent, SILENT_SECONDS[1])
