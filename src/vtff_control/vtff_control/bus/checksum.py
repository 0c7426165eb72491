"""Checksum of the frames of vtff's CAN devices."""

from __future__ import annotations

from crccheck.crc import Crc8SaeJ1850

__all__ = ["checksum"]


def checksum(frame_identifier: int, payload: bytes | bytearray) -> int:
    """Return the checksum of a frame: CRC-8 SAE J1850 over identifier and payload.

    Parameters
    ----------
    frame_identifier
        CAN identifier; it is part of the sum (two bytes, low one first), so that a frame is
        never taken for another one.
    payload
        All bytes of the frame; the first, which holds the checksum, is left out.
    """
    return int(Crc8SaeJ1850.calc(frame_identifier.to_bytes(2, "little") + payload[1:]))
