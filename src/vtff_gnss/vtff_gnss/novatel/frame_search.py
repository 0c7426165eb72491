"""Search for intact frames, compiled: many frames of a stream in one call.

Here are only frames of which nothing is to be judged: long binary, whole, with a right checksum,
one after the other. What else a stream may hold is the work of `vtff_gnss.novatel.framing`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_gnss.novatel.message_ids import ID_RANGE, PAYLOAD_LAYOUTS

__all__ = [
    "CRC_LENGTH",
    "MAX_APPENDED",
    "MAX_HEADER_LENGTH",
    "MAX_OTHER_PAYLOAD",
    "MIN_HEADER_LENGTH",
    "RESPONSE_BIT",
    "IntactFrames",
]

MAX_OTHER_PAYLOAD = 8192
"""Longest accepted payload, in bytes, of a log whose layout is not in `PAYLOAD_LAYOUTS`."""
MAX_APPENDED = 64
"""Bytes by which newer firmware may have lengthened a log of fixed length."""
MIN_HEADER_LENGTH = 28
MAX_HEADER_LENGTH = 64
CRC_LENGTH = 4
RESPONSE_BIT = 0x80

#: Number, fixed bytes, bytes of a counted element and place of the count of each known log.
_LAYOUTS = np.array([(number, *layout) for number, layout in PAYLOAD_LAYOUTS.items()], np.int64)
#: Groups of frames that are found in one call.
_GROUPS = 64


def _make_crc_tables() -> npt.NDArray[np.uint32]:
    """Return the tables of the CRC-32 of 0xEDB88320 for 8 bytes at a time, shape (8, 256).

    Table j holds the CRC of a byte that is followed by j zeros.
    """
    tables = np.zeros((8, 256), dtype=np.uint32)
    value = np.arange(256, dtype=np.uint32)
    for _ in range(8):
        value = (value >> np.uint32(1)) ^ np.where(value & 1, np.uint32(0xEDB88320), np.uint32(0))
    tables[0] = value
    for number in range(1, 8):
        before = tables[number - 1]
        tables[number] = (before >> np.uint32(8)) ^ tables[0][before & np.uint32(255)]
    return tables


_CRC_TABLES = _make_crc_tables()


class IntactFrames:
    """Finds intact frames that follow each other without a gap."""

    def __init__(self) -> None:
        self._groups = np.zeros((_GROUPS, 3), dtype=np.int64)

    def find(self, content: bytes, position: int) -> list[tuple[int, int, int]]:
        """Return the intact frames from a position on, up to the first byte that is none of theirs.

        Returns
        -------
        list of (start, end, count)
            Consecutive RANGE logs of one length are one group of `count` frames; each other frame
            is a group of its own. Empty if no intact frame is at the position; there may be more
            frames than are returned.
        """
        view = np.frombuffer(content, dtype=np.uint8)
        count = _find_intact_frames(view, position, _LAYOUTS, _CRC_TABLES, self._groups)
        return [(start, end, frames) for start, end, frames in self._groups[:count].tolist()]


@compiled
def _find_intact_frames(content, position, layouts, crc_tables, groups):  # type: ignore[no-untyped-def]
    """Fill groups of intact long binary frames, and return their number.

    Parameters
    ----------
    content : ndarray of uint8, shape (m,)
    position : int
    layouts : ndarray of int64, shape (logs, 4)
    crc_tables : ndarray of uint32, shape (8, 256)
    groups : ndarray of int64, shape (most, 3)
        Takes start, end and number of frames.
    """
    size = len(content)
    count = 0
    length_before = -1  # of the last frame, if that is a RANGE log
    while position + MIN_HEADER_LENGTH + CRC_LENGTH <= size:
        if content[position] != 0xAA or content[position + 1] != 0x44:
            break
        header_length = np.int64(content[position + 3])
        if content[position + 2] != 0x12 or not (
            MIN_HEADER_LENGTH <= header_length <= MAX_HEADER_LENGTH
        ):
            break
        message_id = content[position + 4] | np.int64(content[position + 5]) << 8
        payload_length = content[position + 8] | np.int64(content[position + 9]) << 8
        length = header_length + payload_length + CRC_LENGTH
        if position + length > size:
            break
        row = -1
        if not content[position + 6] & RESPONSE_BIT:
            for candidate in range(len(layouts)):
                if layouts[candidate, 0] == message_id:
                    row = candidate
                    break
        if row < 0:
            if payload_length > MAX_OTHER_PAYLOAD:
                break
        elif layouts[row, 2] == 0:
            if not 0 <= payload_length - layouts[row, 1] <= MAX_APPENDED:
                break
        else:
            if payload_length < layouts[row, 1]:
                break
            elements = np.int64(0)
            for byte in range(4):
                place = position + header_length + layouts[row, 3] + byte
                elements |= np.int64(content[place]) << (8 * byte)
            if not 0 <= payload_length - layouts[row, 1] - layouts[row, 2] * elements < 4:
                break
        end = position + length - CRC_LENGTH
        crc = np.int64(0)
        place = position
        while place + 8 <= end:
            for byte in range(4):
                crc ^= np.int64(content[place + byte]) << (8 * byte)
            crc = (
                np.int64(crc_tables[7, crc & 255])
                ^ np.int64(crc_tables[6, crc >> 8 & 255])
                ^ np.int64(crc_tables[5, crc >> 16 & 255])
                ^ np.int64(crc_tables[4, crc >> 24])
                ^ np.int64(crc_tables[3, content[place + 4]])
                ^ np.int64(crc_tables[2, content[place + 5]])
                ^ np.int64(crc_tables[1, content[place + 6]])
                ^ np.int64(crc_tables[0, content[place + 7]])
            )
            place += 8
        while place < end:
            crc = np.int64(crc_tables[0, (crc ^ content[place]) & 255]) ^ (crc >> 8)
            place += 1
        for byte in range(4):
            crc ^= np.int64(content[end + byte]) << (8 * byte)
        if crc != 0:
            break
        is_range = message_id == ID_RANGE and row >= 0
        if is_range and length == length_before:
            groups[count - 1, 1] = position + length
            groups[count - 1, 2] += 1
        else:
            if count == len(groups):
                break
            groups[count, 0] = position
            groups[count, 1] = position + length
            groups[count, 2] = 1
            count += 1
        length_before = length if is_range else -1
        position += length
    return count
