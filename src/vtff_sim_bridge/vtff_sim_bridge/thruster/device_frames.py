"""Frames as emulated CAN devices read and write them, apart from the code of the controllers.

A fault that both ends share would not be seen, so that checksum and frames are written here anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import can
from crccheck.crc import Crc8SaeJ1850

__all__ = ["checksum", "decode_frame", "encode_frame"]


def checksum(frame_identifier: int, payload: bytes | bytearray) -> int:
    """Return the CRC-8 SAE J1850 of identifier (low byte first) and bytes 1 to 7."""
    return int(Crc8SaeJ1850.calc(frame_identifier.to_bytes(2, "little") + payload[1:]))


def encode_frame(message: Any, values: Mapping[str, int]) -> can.Message:
    """Return the frame of a message of a DBC file with counts of its signals."""
    payload = bytearray(message.encode({"Checksum": 0, **values}, scaling=False, strict=False))
    payload[0] = checksum(message.frame_id, payload)
    return can.Message(arbitration_id=message.frame_id, data=payload, is_extended_id=False)


def decode_frame(message: Any, frame: can.Message) -> dict[str, int] | None:
    """Return the counts of the signals of a frame; None if the frame is damaged."""
    payload = bytes(frame.data)
    if (
        frame.is_remote_frame
        or len(payload) != message.length
        or payload[0] != checksum(frame.arbitration_id, payload)
    ):
        return None
    values: dict[str, int] = message.decode(payload, decode_choices=False, scaling=False)
    return values
