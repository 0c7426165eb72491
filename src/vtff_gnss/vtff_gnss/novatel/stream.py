"""A NovAtel byte stream to typed events.

A further log: see `vtff_gnss.novatel`; here it needs its number in `_DECODED_IDS` and a branch in
`_decode_log`, or an entry in `_EPHEMERIS_DECODERS`.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Literal

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.ephemeris import BroadcastEphemeris, GlonassEphemeris
from vtff_gnss.fix import Fix, ReceiverTime
from vtff_gnss.novatel import message_ids as ids
from vtff_gnss.novatel.definitions import MessageDecoder, log_name
from vtff_gnss.novatel.events import CommandResponse, Event, RawLog
from vtff_gnss.novatel.framing import Frame, FrameFormat, FrameScanner, StreamCounters
from vtff_gnss.novatel.header import BinaryLog, parse_binary_log
from vtff_gnss.novatel.ism_logs import decode_ismredobs, decode_ismredtec
from vtff_gnss.novatel.range.lock_time import LockTimeTracker
from vtff_gnss.novatel.range.range_logs import (
    GlonassChannels,
    decode_range,
    decode_rangecmp,
)
from vtff_gnss.novatel.range.rangecmp2 import decode_rangecmp2
from vtff_gnss.novatel.range.rangecmp45 import RangeCmp4Decoder, decode_rangecmp5
from vtff_gnss.novatel.range.signal_records import SignalRecords, epoch_from_records
from vtff_gnss.novatel.solution_logs import (
    fix_from_bestxyz,
    fix_from_payload,
    galileo_ephemeris,
    glonass_ephemeris,
    gps_ephemeris,
    gps_ephemeris_from_subframes,
    receiver_time,
    receiver_time_from_payload,
)
from vtff_gnss.novatel.version_log import decode_version

__all__ = ["RawLogs", "ReceiverLogStream", "read_log"]

RawLogs = Literal["none", "undecoded", "all"]
"""Which logs also, or only, appear as `RawLog`."""

_CHUNK_LENGTH = 1 << 16
_EPHEMERIS_DECODERS = {
    ids.ID_GPSEPHEM: gps_ephemeris,
    ids.ID_GALINAVEPHEMERIS: galileo_ephemeris,
    ids.ID_GALFNAVEPHEMERIS: galileo_ephemeris,
}
_SOLUTION_DECODERS: dict[int, Callable[[bytes, GpsTime], Fix | ReceiverTime | None]] = {
    ids.ID_BESTXYZ: fix_from_payload,
    ids.ID_TIME: receiver_time_from_payload,
}
_MESSAGE_TYPE_PLACE = 6  # in a header; 0 is a binary log of the first antenna


class ReceiverLogStream:
    """Decodes the bytes of one receiver port or log file.

    Binary and ASCII logs and answers to commands may be mixed. Damaged bytes cost the frames
    they hit and nothing else, and never raise: see `counters`. The events depend on the bytes
    only, not on the chunks they come in.

    Parameters
    ----------
    raw_logs : {"none", "undecoded", "all"}
        Give no log, the logs without an event of their own, or every log as a `RawLog`.
    every_ephemeris : bool
        Give an ephemeris each time it is received, not only when it is new or has changed.
    counters : StreamCounters, optional
        Where to count; own counters by default.

    Attributes
    ----------
    counters : StreamCounters
        Numbers of bytes, logs and errors so far.
    """

    def __init__(
        self,
        raw_logs: RawLogs = "none",
        every_ephemeris: bool = False,
        counters: StreamCounters | None = None,
    ) -> None:
        if raw_logs not in ("none", "undecoded", "all"):
            raise ValueError(f"raw_logs: {raw_logs!r} is not one of 'none', 'undecoded', 'all'")
        self.counters = StreamCounters() if counters is None else counters
        self._raw_logs = raw_logs
        self._every_ephemeris = every_ephemeris
        self._scanner = FrameScanner(self.counters)
        self._messages = MessageDecoder()
        self._glonass_channels = GlonassChannels()
        self._rangecmp4 = RangeCmp4Decoder()
        self._lock_times: defaultdict[int, LockTimeTracker] = defaultdict(LockTimeTracker)
        self._last_ephemerides: dict[tuple[str, int, int, int], object] = {}
        self._solutions = _SolutionJoiner()

    def feed(self, chunk: bytes | bytearray | memoryview) -> list[Event]:
        """Take the next bytes and return the events that they complete, in stream order."""
        return self._decode_all(self._scanner.feed(chunk))

    def close(self) -> list[Event]:
        """End the stream and return what it still held back."""
        return self._decode_all(self._scanner.close()) + self._solutions.release()

    def _decode_all(self, frames: list[Frame]) -> list[Event]:
        return [event for frame in frames for event in self._decode(frame)]

    def _decode(self, frame: Frame) -> list[Event]:
        if frame.format is FrameFormat.RESPONSE:
            text = frame.content[1:].decode("ascii")
            return [CommandResponse(is_ok=text.startswith("OK"), text=text)]
        if frame.format is FrameFormat.SHORT_BINARY:
            return self._count_undecoded(frame, log_id=int.from_bytes(frame.content[4:6], "little"))
        content = frame.content
        if frame.format is FrameFormat.ASCII:
            binary = self._messages.to_binary(content)
            if binary is None:
                return self._count_undecoded(frame, log_id=None)
            content = binary
        log = parse_binary_log(content)
        if log.is_response:
            return [_command_response(log)]
        if log.message_id not in _DECODED_IDS:
            return self._count_undecoded(frame, log.message_id, log.time)
        events = self._solutions.advance(log.time)
        try:
            events += self._decode_log(log)
        except (ValueError, OverflowError):
            self.counters.logs_malformed += 1
        if self._raw_logs == "all":
            events.append(_raw_log(frame, log.message_id, log.time))
        return events

    def _count_undecoded(
        self, frame: Frame, log_id: int | None, time: GpsTime | None = None
    ) -> list[Event]:
        self.counters.logs_undecoded += 1
        return [] if self._raw_logs == "none" else [_raw_log(frame, log_id, time)]

    def _decode_log(self, log: BinaryLog) -> list[Event]:
        if log.message_id == ids.ID_VERSION:
            return [decode_version(log.payload, log.time)]
        if log.time is None:
            self.counters.logs_without_time += 1
            return []
        if log.message_id in ids.OBSERVATION_LOG_NAMES:
            return self._observations(log, log.time)
        if log.message_id in (ids.ID_ISMREDTEC, ids.ID_ISMREDOBS):
            return self._ionosphere(log, log.time)
        if log.message_id == ids.ID_RAWEPHEM:
            return self._if_new(gps_ephemeris_from_subframes(log.payload, log.time))
        if log.message_id in _SOLUTION_DECODERS and log.content[_MESSAGE_TYPE_PLACE] == 0:
            # These two come every second; novatel_edie takes twenty times as long.
            solution = _SOLUTION_DECODERS[log.message_id](log.payload, log.time)
            if solution is not None:
                return self._solutions.add(solution)
        message = self._messages.decode(log.content)
        if message is None:
            raise ValueError(f"{log_name(log.message_id)}: does not fit its definition")
        if log.message_id == ids.ID_BESTXYZ:
            return self._solutions.add(fix_from_bestxyz(message, log.time))
        if log.message_id == ids.ID_TIME:
            return self._solutions.add(receiver_time(message, log.time))
        if log.message_id == ids.ID_GLOEPHEMERIS:
            ephemeris = glonass_ephemeris(message, log.time)
            self._glonass_channels.learn(ephemeris.prn, ephemeris.glonass_channel)
            return self._if_new(ephemeris)
        return self._if_new(_EPHEMERIS_DECODERS[log.message_id](message, log.time))

    def _observations(self, log: BinaryLog, time: GpsTime) -> list[Event]:
        epoch, unnamed_count = epoch_from_records(
            self._records(log, time),
            time,
            log.time_status,
            log.receiver_status,
            ids.OBSERVATION_LOG_NAMES[log.message_id],
            # Logs of one epoch in two formats are two series of lock times.
            self._lock_times[log.message_id],
        )
        self.counters.signals_unnamed += unnamed_count
        return [epoch]

    def _ionosphere(self, log: BinaryLog, time: GpsTime) -> list[Event]:
        if log.message_id == ids.ID_ISMREDTEC:
            slant_tec, unnamed_count = decode_ismredtec(log.payload, time)
            self.counters.signals_unnamed += unnamed_count
            return list(slant_tec)
        scintillation, unnamed_count = decode_ismredobs(log.payload, time)
        self.counters.signals_unnamed += unnamed_count
        return [scintillation]

    def _records(self, log: BinaryLog, time: GpsTime) -> SignalRecords:
        if log.message_id == ids.ID_RANGE:
            return decode_range(log.payload)
        if log.message_id == ids.ID_RANGECMP:
            return decode_rangecmp(log.payload, self._glonass_channels)
        if log.message_id == ids.ID_RANGECMP2:
            return decode_rangecmp2(log.payload)
        if log.message_id == ids.ID_RANGECMP5:
            return decode_rangecmp5(log.payload)
        records, missing_count = self._rangecmp4.decode(log.payload, time)
        self.counters.signals_without_reference += missing_count
        return records

    def _if_new(self, ephemeris: BroadcastEphemeris | GlonassEphemeris) -> list[Event]:
        """Return the ephemeris unless it is the last one of its satellite and message again."""
        if isinstance(ephemeris, BroadcastEphemeris):
            key = ("kepler", ephemeris.system, ephemeris.prn, ephemeris.source)
        else:
            key = ("state", 0, ephemeris.prn, 0)
        content = repr(replace(ephemeris, time=GpsTime(0)))
        is_repeated = self._last_ephemerides.get(key) == content
        self._last_ephemerides[key] = content
        return [] if is_repeated and not self._every_ephemeris else [ephemeris]


class _SolutionJoiner:
    """Joins the clock offset of TIME to the fix of the same epoch.

    TIME may come before or after BESTXYZ. A fix is held back, until TIME or the next epoch, only
    once the receiver was seen to send TIME second.
    """

    def __init__(self) -> None:
        self._time: ReceiverTime | None = None
        self._last_fix_time: GpsTime | None = None
        self._held_fix: Fix | None = None
        self._time_follows_fix = False

    def add(self, solution: Fix | ReceiverTime) -> list[Event]:
        if isinstance(solution, Fix):
            return self._add_fix(solution)
        return self._add_time(solution)

    def _add_fix(self, fix: Fix) -> list[Event]:
        events = self.release()
        self._last_fix_time = fix.time
        if self._time is not None and self._time.time == fix.time:
            return [*events, _with_clock(fix, self._time)]
        if self._time_follows_fix:
            self._held_fix = fix
            return events
        return [*events, fix]

    def _add_time(self, time: ReceiverTime) -> list[Event]:
        self._time = time
        self._time_follows_fix = time.time == self._last_fix_time
        if self._held_fix is None:
            return [time]
        fix, self._held_fix = self._held_fix, None
        return [time, _with_clock(fix, time) if fix.time == time.time else fix]

    def advance(self, time: GpsTime | None) -> list[Event]:
        """Let go of a fix that a log of a later epoch has overtaken."""
        if self._held_fix is not None and time is not None and time > self._held_fix.time:
            return self.release()
        return []

    def release(self) -> list[Event]:
        """Let go of a fix that is held back."""
        fix, self._held_fix = self._held_fix, None
        return [] if fix is None else [fix]


_DECODED_IDS = frozenset(
    {
        *ids.OBSERVATION_LOG_NAMES,
        *_EPHEMERIS_DECODERS,
        ids.ID_VERSION,
        ids.ID_ISMREDTEC,
        ids.ID_ISMREDOBS,
        ids.ID_RAWEPHEM,
        ids.ID_GLOEPHEMERIS,
        ids.ID_BESTXYZ,
        ids.ID_TIME,
    }
)


def read_log(
    path: str | os.PathLike[str],
    raw_logs: RawLogs = "none",
    every_ephemeris: bool = False,
    progress: Callable[[int, int], None] | None = None,
    counters: StreamCounters | None = None,
) -> Iterator[Event]:
    """Read a receiver log file and yield its events.

    Parameters
    ----------
    path : path-like
        Binary, ASCII or mixed log file.
    raw_logs, every_ephemeris
        See `ReceiverLogStream`.
    progress : callable, optional
        Called as ``progress(bytes_read, bytes_total)`` after each block of the file.
    counters : StreamCounters, optional
        Filled in while reading.

    Raises
    ------
    OSError
        If the file cannot be read.
    """
    stream = ReceiverLogStream(raw_logs, every_ephemeris, counters)
    with open(path, "rb") as file:
        total = os.fstat(file.fileno()).st_size
        bytes_read = 0
        while chunk := file.read(_CHUNK_LENGTH):
            yield from stream.feed(chunk)
            bytes_read += len(chunk)
            if progress is not None:
                progress(bytes_read, total)
    yield from stream.close()


def _with_clock(fix: Fix, time: ReceiverTime) -> Fix:
    if not time.is_valid:
        return fix
    offset = {"clock_offset": time.clock_offset, "clock_offset_sigma": time.clock_offset_sigma}
    return Fix(**(vars(fix) | offset))


def _command_response(log: BinaryLog) -> CommandResponse:
    """Convert a binary response: a code, 1 = OK, and a text."""
    text = log.payload[4:].split(b"\0")[0].decode("ascii", errors="replace")
    is_ok = int.from_bytes(log.payload[:4], "little") == 1
    return CommandResponse(is_ok=is_ok, text=text, command=log_name(log.message_id))


def _raw_log(frame: Frame, log_id: int | None, time: GpsTime | None) -> RawLog:
    if frame.format is FrameFormat.ASCII:
        name = frame.content[1:].split(b",", 1)[0].decode("ascii")
    else:
        name = f"{log_name(log_id or 0)}B"
    return RawLog(time=time, name=name, log_id=log_id or 0, content=frame.content)
