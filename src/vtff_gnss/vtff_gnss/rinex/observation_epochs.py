"""Structure of RINEX observation files after the header: epochs, satellites, event records."""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.rinex.calendar_time import RinexClock
from vtff_gnss.rinex.errors import RinexError
from vtff_gnss.rinex.navigation_records import Line
from vtff_gnss.rinex.observation_header import RinexObservationHeader, read_header_record

__all__ = ["Batch", "EpochRecords", "RinexEvent", "walk_epochs"]

_OBSERVATIONS = b"01"
_EVENTS = b"2345"
_CYCLE_SLIPS = b"6"
_POWER_FAILURE = b"1"
_SATELLITES_PER_LINE_2 = 12
_TYPES_PER_LINE_2 = 5
# Seconds in format F11.7 and flag; the date before them may be damaged.
_SECOND_AND_FLAG_2 = re.compile(rb"[ \d]{3}\.\d{7}  [0-6]")


@dataclass(frozen=True)
class RinexEvent:
    """An event record between the epochs.

    Parameters
    ----------
    time : GpsTime or None
    kind : int
        2 start of motion, 3 new site, 4 header lines, 5 external event (RINEX 3.05, table A3).
    records : tuple of str
        The lines that belong to it.
    """

    time: GpsTime | None
    kind: int
    records: tuple[str, ...]


@dataclass
class Batch:
    """Satellite records under the same lists of observation types.

    Element i of the lists belongs to record i: name of the satellite, place of its first line (from
    0), and its epoch.
    """

    types: dict[str, tuple[str, ...]]
    scale_factors: dict[tuple[str, str], float]
    satellites: list[bytes] = field(default_factory=list)
    line_indices: list[int] = field(default_factory=list)
    epochs: list[int] = field(default_factory=list)

    @property
    def lines_per_record_2(self) -> int:
        """Lines of a satellite in RINEX 2, where all systems have the same types."""
        return -(-len(self.types[""]) // _TYPES_PER_LINE_2)


@dataclass
class EpochRecords:
    """All epochs of a file.

    Parameters
    ----------
    times : list of int
        ns of GPS time.
    clock_offsets : list of float
        s; NaN where not given.
    power_failures : set of int
        Epochs before which the power had failed.
    batches, slips : list of Batch
        Observations, and cycle-slip records (flag 6) with the number of the epoch that follows.
    events : list of RinexEvent
    damaged : list of RinexError
        Epochs that are left out, because their number of satellites or their first line is wrong.
    error : RinexError or None
        Error that ended the reading before the end of the file.
    """

    times: list[int] = field(default_factory=list)
    clock_offsets: list[float] = field(default_factory=list)
    power_failures: set[int] = field(default_factory=set)
    batches: list[Batch] = field(default_factory=list)
    slips: list[Batch] = field(default_factory=list)
    events: list[RinexEvent] = field(default_factory=list)
    damaged: list[RinexError] = field(default_factory=list)
    error: RinexError | None = None


def walk_epochs(
    lines: Sequence[bytes], start: int, header: RinexObservationHeader, name: str
) -> EpochRecords:
    """Find epochs and satellite records; the observations themselves are not read yet.

    An epoch whose number of satellites is not that of its records, or whose first line is
    malformed, is left out, and reading goes on at the next line that begins an epoch. Without such
    a line the error ends the reading.

    Parameters
    ----------
    lines : sequence of bytes
        All lines of the file without line ends.
    start : int
        First one after the header.
    header : RinexObservationHeader
        Not changed by header lines within the file; these count for what follows them.
    name : str
        File, for messages.
    """
    walker = (_Walker2 if header.version < 3.0 else _Walker3)(lines, start, header, name)
    try:
        while walker.has_more():
            walker.step()
    except RinexError as error:
        walker.result.error = error
    return walker.result


class _TimeOrderError(RinexError):
    """An epoch is not later than the one before: no damage of one epoch, but of the file."""


class _Walker3:
    """Walks from one ``>`` line to the next (RINEX 3 and 4)."""

    DATE = slice(2, 18)
    SECOND = slice(18, 29)
    FLAG = 31
    COUNT = slice(32, 35)
    CLOCK = slice(41, 56)

    def __init__(
        self, lines: Sequence[bytes], start: int, header: RinexObservationHeader, name: str
    ) -> None:
        self.result = EpochRecords()
        self._lines = lines
        self._next = start
        self._end = len(lines)
        # Blank lines at the end of a file end nothing; in RINEX 2 they may be missing values.
        self._last = self._end - 1
        while self._last > start and not lines[self._last].strip():
            self._last -= 1
        self._header = copy.deepcopy(header)
        self._name = name
        self._clock = RinexClock(header.time_system)
        self._batch = self._new_batch()
        self.result.batches.append(self._batch)

    def has_more(self) -> bool:
        """Return whether lines are left."""
        return self._next <= self._last

    def step(self) -> None:
        """Take one epoch or event, or pass over a damaged one.

        Raises
        ------
        RinexError
            If it is malformed or incomplete, and no other epoch follows; nothing of it is kept
            then. Or if time does not grow.
        """
        start = self._next
        try:
            self._take()
        except _TimeOrderError:
            raise
        except RinexError as error:
            self._next = start
            if not self._resynchronise(start):
                raise
            self.result.damaged.append(error)

    def _resynchronise(self, damaged: int) -> bool:
        """Go to the first epoch after line `damaged`; return False if there is none."""
        for index in range(damaged + 1, self._last + 1):
            if self._begins_epoch(self._lines[index]):
                self._next = index
                return True
        return False

    def _begins_epoch(self, line: bytes) -> bool:
        return line[:1] == b">"

    def _contains_epoch(self, first: int, end: int) -> bool:
        """Return whether any of the lines `first` to `end` begins an epoch."""
        return b">" in [line[:1] for line in self._lines[first:end]]

    def _check_records(self, first: int, end: int) -> None:
        """Refuse an epoch whose records, lines `first` to `end`, are more or fewer than it says."""
        lines = self._lines
        is_wrong = self._contains_epoch(first, end)
        if not is_wrong and end <= self._last and not self._begins_epoch(lines[end]):
            # Without another epoch it is an error of what follows, not of this epoch.
            is_wrong = any(self._begins_epoch(lines[k]) for k in range(end, self._last + 1))
        if is_wrong:
            raise self._error("epoch: its number of satellites is not that of its records")

    def _take(self) -> None:
        line = self._lines[self._next]
        self._check_epoch_line(line)
        kind = line[self.FLAG : self.FLAG + 1]
        try:
            count = int(line[self.COUNT])
        except ValueError:
            count = -1
        if count < 0 or kind not in _OBSERVATIONS + _EVENTS + _CYCLE_SLIPS or not kind:
            raise self._error(f"epoch: flag and number of records: {line[self.FLAG :][:4]!r}")
        if kind in _EVENTS:
            self._take_event(line, int(kind), count)
            return
        index = len(self.result.times)
        time = self._time(line)
        if index and kind in _OBSERVATIONS and time <= self.result.times[-1]:
            reason = f"epoch: {GpsTime(time)} is not after {GpsTime(self.result.times[-1])}"
            raise _TimeOrderError(str(self._error(reason)))
        clock_offset = self._clock_offset(line)
        batch = self._batch
        if kind in _CYCLE_SLIPS:
            batch = self._new_batch()
            self.result.slips.append(batch)
        self._take_satellites(batch, count, index)
        if kind in _OBSERVATIONS:
            self.result.times.append(time)
            self.result.clock_offsets.append(clock_offset)
            if kind == _POWER_FAILURE:
                self.result.power_failures.add(index)

    def _check_epoch_line(self, line: bytes) -> None:
        if line[:1] != b">":
            raise self._error("epoch: '>' is required at the start of the line")

    def _take_satellites(self, batch: Batch, count: int, index: int) -> None:
        first, end = self._next + 1, self._next + 1 + count
        self._require(end)
        self._check_records(first, end)
        batch.satellites.extend([line[:3] for line in self._lines[first:end]])
        batch.line_indices.extend(range(first, end))
        batch.epochs.extend([index] * count)
        self._next = end

    def _take_event(self, line: bytes, kind: int, count: int) -> None:
        first, end = self._next + 1, self._next + 1 + count
        self._require(end)
        texts = [text.decode("ascii", "replace") for text in self._lines[first:end]]
        time = GpsTime(self._time(line)) if line[self.DATE].strip() else None
        records = iter([self._line(first + i) for i in range(count)])
        for record in records:
            read_header_record(self._header, record, records)
        self.result.events.append(RinexEvent(time, kind, tuple(texts)))
        batch = self._new_batch()
        if (batch.types, batch.scale_factors) != (self._batch.types, self._batch.scale_factors):
            self._batch = batch
            self.result.batches.append(batch)
        self._next = end

    def _new_batch(self) -> Batch:
        return Batch(dict(self._header.observation_types), dict(self._header.scale_factors))

    def _time(self, line: bytes) -> int:
        try:
            return self._clock.nanoseconds(line[self.DATE], line[self.SECOND])
        except ValueError as error:
            text = line[self.DATE.start : self.SECOND.stop].decode("ascii", "replace")
            raise self._error(f"epoch: {text!r}: {error}") from None

    def _clock_offset(self, line: bytes) -> float:
        text = line[self.CLOCK].strip()
        if not text:
            return math.nan
        try:
            return float(text)
        except ValueError:
            shown = text.decode("ascii", "replace")
            raise self._error(f"receiver clock offset: {shown!r} is not a number") from None

    def _require(self, end: int) -> None:
        if end > self._end:
            raise self._error(
                f"epoch: the file ends inside it: {end - self._next} lines are required, "
                f"{self._end - self._next} are there"
            )

    def _line(self, index: int) -> Line:
        return Line(self._name, index + 1, self._lines[index].decode("ascii", "replace"))

    def _error(self, reason: str) -> RinexError:
        return RinexError(f"{self._name}:{self._next + 1}: {reason}")


class _Walker2(_Walker3):
    """Walks through RINEX 2: satellites in the epoch line, observations on lines of five."""

    DATE = slice(1, 15)
    SECOND = slice(15, 26)
    FLAG = 28
    COUNT = slice(29, 32)
    CLOCK = slice(68, 80)

    def _check_epoch_line(self, line: bytes) -> None:
        if len(line) <= self.FLAG:
            raise self._error("epoch: the line is too short")

    def _begins_epoch(self, line: bytes) -> bool:
        # The decimal point of the seconds stands where no value has one. Events may have no time.
        if line[18:19] == b".":
            return _SECOND_AND_FLAG_2.match(line, self.SECOND.start) is not None
        flag = line[self.FLAG : self.FLAG + 1]
        return bool(flag) and flag in _EVENTS and not line[: self.FLAG].strip()

    def _contains_epoch(self, first: int, end: int) -> bool:
        return any(map(self._begins_epoch, self._lines[first:end]))

    def _take_satellites(self, batch: Batch, count: int, index: int) -> None:
        list_lines = max(-(-count // _SATELLITES_PER_LINE_2), 1)
        per_record = batch.lines_per_record_2
        first = self._next + list_lines
        end = first + count * per_record
        self._require(end)
        self._check_records(first, end)
        listed = b"".join(
            line[32:68].ljust(36) for line in self._lines[self._next : self._next + list_lines]
        )
        names = [listed[3 * i : 3 * i + 3] for i in range(count)]
        if any(not name[2:3].isdigit() for name in names):
            raise self._error(f"epoch: {count} satellites are not all listed")
        default = self._header.satellite_system.encode("ascii", "replace")
        if default == b"M":
            default = b"G"
        batch.satellites.extend([default + n[1:] if n[:1] == b" " else n for n in names])
        batch.line_indices.extend(range(first, end, per_record) if per_record else [first] * count)
        batch.epochs.extend([index] * count)
        self._next = end
