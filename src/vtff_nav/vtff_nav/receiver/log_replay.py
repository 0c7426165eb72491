"""A receiver log as a sequence of events in whole seconds, and its pace by the wall clock."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.fix import Fix, ReceiverTime
from vtff_gnss.novatel import CommandResponse, Event, ReceiverLogStream
from vtff_gnss.observations import ObservationEpoch
from vtff_nav.receiver.log_source import FileSource

#: Logs of one receiver are out of order by less than this; further back, its time was reset or
#: another log follows in the same file.
DISORDER_SECONDS = 30
#: A longer gap in a log is not waited out.
LONGEST_GAP_SECONDS = 60
#: Bytes searched for the first measurement.
READ_AHEAD_LENGTH = 1 << 20


def whole_second(time: GpsTime) -> int:
    """Return the whole second (GPS) at which a time has passed: its own or the next one."""
    return -(-time.nanoseconds // NANOSECONDS_PER_SECOND)


class LogReplay:
    """Events of a receiver log in the order of the stream, grouped into whole seconds.

    A second T holds what was measured after T - 1 s up to T. The time goes by observations and
    the receiver's solutions. Ephemerides and logs as received belong to the second under way, or
    to the first: a receiver stamps what it had stored, e.g. ephemerides, with the time at which
    it got it, minutes ago. Only in a log whose first `READ_AHEAD_LENGTH` bytes hold no
    measurement every time counts.

    Measurements up to `DISORDER_SECONDS` back belong to the second under way as well; one
    further back begins a second in the past.

    Parameters
    ----------
    source
        Where the bytes come from.
    stream
        Decodes them.
    """

    def __init__(self, source: FileSource, stream: ReceiverLogStream) -> None:
        self._source = source
        self._stream = stream
        self._events: deque[Event] = deque()
        self._first_second: int | None = None
        self._every_time_counts = False
        #: Second under way, s since 1980-01-06 (GPS); None before the first.
        self.second: int | None = None
        #: All bytes have been read; `has_next` tells whether events are left.
        self.at_end = False

    @property
    def has_next(self) -> bool:
        """Whether an event can be taken without reading on."""
        return bool(self._events) and self._first_second is not None

    @property
    def undated_count(self) -> int:
        """Number of events that wait for a first time, at the end of a log in vain."""
        return 0 if self._first_second is not None else len(self._events)

    def read_more(self) -> None:
        """Read one chunk.

        Raises
        ------
        SourceError
            If reading fails.
        """
        chunk = self._source.read()
        if chunk:
            events = self._stream.feed(chunk)
        else:
            self.at_end = True
            events = self._stream.close()
        self._events.extend(events)
        if self._first_second is None:
            self._first_second = self._first_second_of(events)
            read_enough = self.at_end or self._source.position >= READ_AHEAD_LENGTH
            if self._first_second is None and read_enough:
                self._every_time_counts = True
                self._first_second = self._first_second_of(self._events)

    def next_second(self) -> int | None:
        """Return the second that the next event begins; None if it belongs to that under way."""
        if self.second is None:
            return self._first_second
        second = self._second_of(self._events[0])
        if second is None or self.second - DISORDER_SECONDS <= second <= self.second:
            return None
        return second

    def take(self) -> Event:
        """Take the next event, and with it enter the second that it begins."""
        second = self.next_second()
        if second is not None:
            self.second = second
        return self._events.popleft()

    def _second_of(self, event: Event) -> int | None:
        is_measured = isinstance(event, (ObservationEpoch, Fix, ReceiverTime))
        if isinstance(event, CommandResponse) or not (is_measured or self._every_time_counts):
            return None
        return None if event.time is None else whole_second(event.time)

    def _first_second_of(self, events: Iterable[Event]) -> int | None:
        seconds = (self._second_of(event) for event in events)
        return next((second for second in seconds if second is not None), None)


class WallClockPacer:
    """Lets the seconds of a log begin as the wall clock goes.

    Parameters
    ----------
    rate
        Seconds of the log per second of wall time; 0 = without waiting.
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._origin: tuple[int, float] | None = None
        self._last = 0

    def may_begin(self, second: int, now: float) -> bool:
        """Whether a second of the log may begin at wall time `now`, in s.

        The time of the log may jump: backwards, or forwards by more than `LONGEST_GAP_SECONDS`,
        the pace starts anew.
        """
        if self._rate == 0.0:
            return True
        if self._origin is None or not 0 <= second - self._last <= LONGEST_GAP_SECONDS:
            self._origin = (second, now)
        origin_second, origin_wall = self._origin
        if now < origin_wall + (second - origin_second) / self._rate:
            return False
        self._last = second
        return True
