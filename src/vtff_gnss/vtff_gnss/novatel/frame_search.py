"""Search for intact frames, compiled: many frames of a stream in one call.

Here are only frames of which nothing is to be judged: long binary, whole, with a right checksum,
one after the other. What else a stream may hold is the work of `vtff_gnss.novatel.framing`.
"""

from __future__ import annotations

import numpy as np

from vtff_dynamics.byte_integers import read_integer
from vtff_dynamics.compiled import compiled
from vtff_gnss.novatel.checksum import add_byte, add_words
from vtff_gnss.novatel.message_ids import ID_RANGE, PAYLOAD_LAYOUTS

__all__ = [
    "CRC_LENGTH",
    "MAX_APPENDED",
    "MAX_HEADER_LENGTH",
    "MAX_OTHER_PAYLOAD",
    "MIN_HEADER_LENGTH",
    "RESPONSE_BIT",
    "find_intact_frames",
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


def find_intact_frames(content: bytes, position: int) -> list[tuple[int, int, int]]:
    """Return the intact frames from a position on, up to the first byte that is none of theirs.

    Returns
    -------
    list of (start, end, count)
        Consecutive RANGE logs of one length are one group of `count` frames; each other frame is a
        group of its own, with a count of 0. Empty if no intact frame is at the position; there may
        be more frames than are returned.
    """
    groups = np.empty((_GROUPS, 3), dtype=np.int64)
    count = _fill_groups(np.frombuffer(content, dtype=np.uint8), position, _LAYOUTS, groups)
    return [(start, end, frames) for start, end, frames in groups[:count].tolist()]


@compiled
def _fill_groups(content, position, layouts, groups):  # type: ignore[no-untyped-def]
    """Fill groups of intact long binary frames, and return their number.

    Parameters
    ----------
    content : ndarray of uint8, shape (m,)
    position : int
    layouts : ndarray of int64, shape (logs, 4)
    groups : ndarray of int64, shape (most, 3)
        Takes start, end and number of RANGE logs.
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
            elements = read_integer(content, position + header_length + layouts[row, 3], 4)
            if not 0 <= payload_length - layouts[row, 1] - layouts[row, 2] * elements < 4:
                break
        end = position + length - CRC_LENGTH
        checksum = np.int64(0)
        place = position
        while place + 8 <= end:
            checksum = add_words(
                checksum, read_integer(content, place, 4), read_integer(content, place + 4, 4)
            )
            place += 8
        while place < end:
            checksum = add_byte(checksum, content[place])
            place += 1
        if checksum != read_integer(content, end, 4):
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
            groups[count, 2] = 1 if is_range else 0
            count += 1
        length_before = length if is_range else -1
        position += length
    return count
