"""Frames of a NovAtel byte stream: long and short binary, ASCII, abbreviated responses.

A frame is accepted on its CRC alone. The search for the next frame starts one byte after a
rejected start, so that no intact frame is lost to damage before it; the result depends on the
bytes only, not on how they were cut into chunks.

The message length of a binary header is not covered by a checksum of its own. A decoder that
trusts it waits up to 64 kB for the end of a frame whose length was damaged, and holds back all
good frames behind it (novatel_edie 2.10.11 does). Here the length must agree with the layout of
the log (`PAYLOAD_LAYOUTS`), or be at most `MAX_OTHER_PAYLOAD` for other logs.
"""

from __future__ import annotations

import enum
import re
import struct
import zlib
from dataclasses import dataclass
from typing import NamedTuple

from vtff_gnss.novatel.message_ids import PAYLOAD_LAYOUTS

__all__ = [
    "CRC_LENGTH",
    "MIN_HEADER_LENGTH",
    "RESPONSE_BIT",
    "Frame",
    "FrameFormat",
    "FrameScanner",
    "StreamCounters",
    "crc32_novatel",
]

MAX_OTHER_PAYLOAD = 8192
"""Longest accepted payload, in bytes, of a log whose layout is not in `PAYLOAD_LAYOUTS`."""
MAX_APPENDED = 64
"""Bytes by which newer firmware may have lengthened a log of fixed length."""
MIN_HEADER_LENGTH = 28
MAX_HEADER_LENGTH = 64
CRC_LENGTH = 4
RESPONSE_BIT = 0x80
MAX_ASCII_LENGTH = 32768
"""Longest accepted ASCII log, in bytes; 325 observations in RANGEA are 26 kB."""
MAX_RESPONSE_LENGTH = 512
SHORT_HEADER_LENGTH = 12

_SYNC_BINARY = 0xAA
_SYNC_LONG = 0x12
_SYNC_RESPONSE = ord("<")

_FRAME_START = re.compile(rb"\xaa\x44[\x12\x13]|[#%][A-Z]|<(?:OK|ERROR)")
_LONGEST_START = len(b"<ERROR")
_LINE_END = re.compile(rb"[\x00-\x1f\x7f-\xff]")
_ASCII_CRC = re.compile(rb"\*([0-9A-Fa-f]{8})")
_UINT32 = struct.Struct("<I")
_ID_TYPE_LENGTH = struct.Struct("<HBxH")


class FrameFormat(enum.Enum):
    """Format of a frame."""

    BINARY = "binary"
    SHORT_BINARY = "short binary"
    ASCII = "ASCII"
    RESPONSE = "abbreviated response"


class Frame(NamedTuple):
    """One complete frame; its CRC was right (abbreviated responses have none)."""

    format: FrameFormat
    content: bytes


@dataclass
class StreamCounters:
    """Counts of frames and logs of a stream since its start.

    Parameters
    ----------
    bytes_received : int
        Bytes given to the stream.
    bytes_skipped : int
        Bytes that belong to no frame: echoed commands, prompts, NMEA, damage.
    frames_good : int
        Frames with a right CRC.
    frames_crc_bad : int
        Complete frames whose CRC was wrong, chance matches in damaged bytes included.
    frames_implausible : int
        Binary headers with an impossible header or message length.
    frames_truncated : int
        Frames cut off by the end of the stream.
    logs_undecoded : int
        Good frames of logs that have no event of their own.
    logs_malformed : int
        Good frames whose content contradicts the definition of the log.
    logs_without_time : int
        Observation and position logs dropped because the receiver did not know the time yet.
    signals_unnamed : int
        Observations dropped because system, signal or satellite has no RINEX name.
    signals_without_reference : int
        Differential RANGECMP4 observations dropped because their reference was not received.
    responses : int
        Answers to commands.
    """

    bytes_received: int = 0
    bytes_skipped: int = 0
    frames_good: int = 0
    frames_crc_bad: int = 0
    frames_implausible: int = 0
    frames_truncated: int = 0
    logs_undecoded: int = 0
    logs_malformed: int = 0
    logs_without_time: int = 0
    signals_unnamed: int = 0
    signals_without_reference: int = 0
    responses: int = 0


class _Verdict(enum.Enum):
    COMPLETE = 0
    INCOMPLETE = 1
    REJECTED = 2


def crc32_novatel(content: bytes | bytearray | memoryview) -> int:
    """Return NovAtel's CRC-32: reflected 0xEDB88320, start value 0, no final inversion."""
    return zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF


class FrameScanner:
    """Cuts a byte stream into frames.

    Parameters
    ----------
    counters : StreamCounters
        Where bytes and frames are counted.
    """

    def __init__(self, counters: StreamCounters) -> None:
        self._counters = counters
        self._buffer = b""

    def feed(self, chunk: bytes | bytearray | memoryview) -> list[Frame]:
        """Take the next bytes of the stream and return the frames that they complete."""
        self._counters.bytes_received += len(chunk)
        self._buffer = b"".join((self._buffer, chunk)) if self._buffer else bytes(chunk)
        return self._scan(is_end=False)

    def close(self) -> list[Frame]:
        """End the stream and return the frames hidden behind one that was cut off."""
        return self._scan(is_end=True)

    def _scan(self, is_end: bool) -> list[Frame]:
        buffer = self._buffer
        frames: list[Frame] = []
        position = 0
        while True:
            match = _FRAME_START.search(buffer, position)
            if match is None:
                tail = 0 if is_end else _LONGEST_START - 1
                end = max(position, len(buffer) - tail)
                self._counters.bytes_skipped += end - position
                position = end
                break
            start = match.start()
            self._counters.bytes_skipped += start - position
            position = start
            verdict, frame_format, end = self._judge(start, is_end)
            if verdict is _Verdict.INCOMPLETE:
                if not is_end:
                    break
                self._counters.frames_truncated += 1
            if verdict is _Verdict.COMPLETE:
                frames.append(Frame(frame_format, buffer[start:end]))
                if frame_format is FrameFormat.RESPONSE:
                    self._counters.responses += 1
                else:
                    self._counters.frames_good += 1
                position = end
            else:
                position = start + 1
                self._counters.bytes_skipped += 1
        self._buffer = buffer[position:]
        return frames

    def _judge(self, start: int, is_end: bool) -> tuple[_Verdict, FrameFormat, int]:
        """Judge the frame that may start at `start`: verdict, format and end."""
        lead = self._buffer[start]
        if lead == _SYNC_BINARY:
            if self._buffer[start + 2] == _SYNC_LONG:
                frame_format, length = FrameFormat.BINARY, self._binary_length(start)
            else:
                frame_format, length = FrameFormat.SHORT_BINARY, self._short_binary_length(start)
            return self._check_binary(start, length), frame_format, start + (length or 0)
        line = self._line(start, is_end)
        if line is None:
            return _Verdict.INCOMPLETE, FrameFormat.ASCII, start
        if lead == _SYNC_RESPONSE:
            is_short = 0 < len(line) <= MAX_RESPONSE_LENGTH
            verdict = _Verdict.COMPLETE if is_short else _Verdict.REJECTED
            return verdict, FrameFormat.RESPONSE, start + len(line)
        return self._check_ascii(start, line)

    def _binary_length(self, start: int) -> int | None:
        """Return the length of a long binary frame, 0 if impossible, None if not yet known."""
        buffer = self._buffer
        available = len(buffer) - start
        if available < 4:
            return None
        header_length = buffer[start + 3]
        if not MIN_HEADER_LENGTH <= header_length <= MAX_HEADER_LENGTH:
            return 0
        if available < 10:
            return None
        message_id, message_type, payload_length = _ID_TYPE_LENGTH.unpack_from(buffer, start + 4)
        length = int(header_length + payload_length + CRC_LENGTH)
        layout = PAYLOAD_LAYOUTS.get(message_id)
        if layout is None or message_type & RESPONSE_BIT:
            return length if payload_length <= MAX_OTHER_PAYLOAD else 0
        if layout.stride == 0:
            is_plausible = 0 <= payload_length - layout.fixed <= MAX_APPENDED
            return length if is_plausible else 0
        count_at = start + header_length + layout.count_offset
        if payload_length < layout.fixed:
            return 0
        if len(buffer) < count_at + 4:
            return None
        count = _UINT32.unpack_from(buffer, count_at)[0]
        padding = payload_length - layout.fixed - layout.stride * count
        return length if 0 <= padding < 4 else 0

    def _short_binary_length(self, start: int) -> int | None:
        """Return the length of a short binary frame, None if not yet known."""
        if len(self._buffer) - start < 4:
            return None
        return SHORT_HEADER_LENGTH + self._buffer[start + 3] + CRC_LENGTH

    def _check_binary(self, start: int, length: int | None) -> _Verdict:
        if length == 0:
            self._counters.frames_implausible += 1
            return _Verdict.REJECTED
        if length is None or len(self._buffer) < start + length:
            return _Verdict.INCOMPLETE
        crc_at = start + length - CRC_LENGTH
        with memoryview(self._buffer) as view:
            crc = crc32_novatel(view[start:crc_at])
        if crc != _UINT32.unpack_from(self._buffer, crc_at)[0]:
            self._counters.frames_crc_bad += 1
            return _Verdict.REJECTED
        return _Verdict.COMPLETE

    def _line(self, start: int, is_end: bool) -> bytes | None:
        """Return the printable characters from `start` on; None if they may go on.

        An unprintable character ends the line whatever it is, so that files with LF only and
        ASCII logs followed at once by binary ones are read. Empty if the line is too long.
        """
        match = _LINE_END.search(self._buffer, start, start + MAX_ASCII_LENGTH + 1)
        if match is not None:
            return self._buffer[start : match.start()]
        if len(self._buffer) - start > MAX_ASCII_LENGTH:
            return b""
        return self._buffer[start:] if is_end else None

    def _check_ascii(self, start: int, line: bytes) -> tuple[_Verdict, FrameFormat, int]:
        found_crc = False
        # A damaged line end joins two logs: the first CRC that is right ends this one.
        for match in _ASCII_CRC.finditer(line):
            found_crc = True
            if crc32_novatel(line[1 : match.start()]) == int(match.group(1), 16):
                return _Verdict.COMPLETE, FrameFormat.ASCII, start + match.end()
        self._counters.frames_crc_bad += found_crc
        return _Verdict.REJECTED, FrameFormat.ASCII, start
