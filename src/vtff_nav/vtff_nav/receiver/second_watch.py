"""End of a second: when all logs of a receiver for a whole second have been read."""

from __future__ import annotations

from collections.abc import Iterable

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_gnss.fix import Fix, ReceiverTime
from vtff_gnss.novatel import Event
from vtff_gnss.observations import ObservationEpoch

__all__ = ["END_OF_SECOND_LOGS", "SecondWatch"]

END_OF_SECOND_LOGS: dict[str, type[ReceiverTime] | type[Fix] | type[ObservationEpoch]] = {
    "TIME": ReceiverTime,
    "BESTXYZ": Fix,
    "RANGE": ObservationEpoch,
}
"""Logs that can end a second, with their events; RANGE includes its compressed forms."""

#: Fraction of the silence time-out that applies while a receiver stays silent.
SHORTER_WAIT = 0.2


class SecondWatch:
    """Decides when the bytes of a second have been read.

    A second ends with the last log of the command list. Where this log is missing, because it was
    damaged, or the receiver is silent or does not know the time yet, silence on the port ends the
    second.

    Parameters
    ----------
    end_log : str
        Name in `END_OF_SECOND_LOGS`.
    silence_timeout : float
        Wall time, s, without a byte after which the second is over. A fifth of it if no byte has
        come in this second and the second before was ended by silence too.

    Attributes
    ----------
    newest_end : int
        Newest second, s since 1980-01-06 (GPS), whose end log has been read; -1 before the first.
    silent_seconds : int
        Number of seconds up to now in which not a single byte came.
    """

    def __init__(self, end_log: str, silence_timeout: float) -> None:
        self._end_type = END_OF_SECOND_LOGS[end_log]
        self._silence_timeout = silence_timeout
        self._ended_by_silence = False
        self._second: int | None = None
        self._last_second = -1
        self._quiet_since = 0.0
        self._is_heard = False
        self.newest_end = -1
        self.silent_seconds = 0

    def read(
        self,
        byte_count: int,
        events: Iterable[Event],
        now: float,
        *,
        is_dialogue: bool = False,
    ) -> None:
        """Note the bytes and events read at wall time `now`, in s.

        Bytes of a dialogue about commands do not count as a sign that the receiver sends logs.
        """
        if byte_count:
            self._quiet_since = now
            self._is_heard |= not is_dialogue
        for event in events:
            if isinstance(event, self._end_type):
                second = event.time.nanoseconds // NANOSECONDS_PER_SECOND
                self.newest_end = max(self.newest_end, second)

    def begin(self, second: int, now: float) -> None:
        """Begin to wait for the end of a second; its bytes may already have come."""
        if second < self._last_second:  # the scenario began again
            self.newest_end = -1
        self._second = self._last_second = second
        self._quiet_since = now

    def is_quiet(self, now: float) -> bool:
        """Return whether no byte has come for the time after which a second is over."""
        is_dead = self._ended_by_silence and not self._is_heard
        wait = self._silence_timeout * (SHORTER_WAIT if is_dead else 1.0)
        return now - self._quiet_since > wait

    def is_done(self, now: float) -> bool:
        """Return whether the second has been read; True once, then `begin` the next second."""
        if self._second is None:
            return False
        if self.newest_end >= self._second:
            self._ended_by_silence = False
        elif self.is_quiet(now):
            self._ended_by_silence = True
        else:
            return False
        self.silent_seconds = 0 if self._is_heard else self.silent_seconds + 1
        self._is_heard = False
        self._second = None
        return True
