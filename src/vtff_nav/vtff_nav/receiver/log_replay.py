"""A receiver log as events grouped into whole seconds, and its pace by the wall clock."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.fix import Fix, ReceiverTime
from vtff_gnss.novatel import CommandResponse, Event, ReceiverLogStream
from vtff_gnss.observations import ObservationEpoch
from vtff_nav.receiver.log_source import FileSource

#: Limit of disorder among the logs of one receiver, s. After a longer step back the time of the
#: receiver was reset, or another recording follows in the same file.
DISORDER_SECONDS = 30
#: The pace by the wall clock does not wait during a longer gap of the log, s.
LONGEST_GAP_SECONDS = 60
#: Number of bytes that are searched for the first measurement.
READ_AHEAD_LENGTH = 1 << 20


def whole_second(time: GpsTime) -> int:
    """Return a time rounded up to whole seconds, s since 1980-01-06 (GPS)."""
    return -(-time.nanoseconds // NANOSECONDS_PER_SECOND)


class LogReplay:
    """Events of a receiver log in the order of the stream, grouped into whole seconds.

    Second T holds the measurements after T - 1 s up to T. Only observations and the receiver's own
    solutions are measurements. Ephemerides and raw logs belong to the current second, those before
    the first measurement to the first second: a receiver stamps an ephemeris that it had stored
    with the time at which it received it, minutes ago. In a log whose first `READ_AHEAD_LENGTH`
    bytes hold no measurement, the times of all events count.

    A measurement up to `DISORDER_SECONDS` before the current second belongs to the current second;
    an earlier measurement begins a second in the past.

    Parameters
    ----------
    source
        The log file.
    stream
        Decoder of its bytes.
    """

    def __init__(self, source: FileSource, stream: ReceiverLogStream) -> None:
        self._source = source
        self._stream = stream
        self._events: deque[Event] = deque()
        self._first_second: int | None = None
        self._every_time_counts = False
        #: Current second, s since 1980-01-06 (GPS); None before the first.
        self.second: int | None = None
        #: Whether all bytes have been read; events may be left, see `has_next`.
        self.at_end = False

    @property
    def has_next(self) -> bool:
        """Whether an event can be taken without reading more bytes."""
        return bool(self._events) and self._first_second is not None

    @property
    def undated_count(self) -> int:
        """Number of events that were read before the first event with a time."""
        return 0 if self._first_second is not None else len(self._events)

    def read_more(self) -> None:
        """Read and decode one chunk.

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
        """Return the second that the next event begins; None if it is of the current second."""
        if self.second is None:
            return self._first_second
        second = self._second_of(self._events[0])
        if second is None or self.second - DISORDER_SECONDS <= second <= self.second:
            return None
        return second

    def take(self) -> Event:
        """Take the next event; the second that it begins becomes the current second."""
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
    """Decides, by the wall clock, when the seconds of a log may begin.

    Parameters
    ----------
    rate
        Seconds of the log per second of wall time; 0 means without waiting.
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._origin: tuple[int, float] | None = None
        self._last = 0

    def may_begin(self, second: int, now: float) -> bool:
        """Return whether a second of the log may begin at wall time `now`, in s.

        After a jump of the log, backwards or forwards by more than `LONGEST_GAP_SECONDS`, the pace
        starts anew.
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
