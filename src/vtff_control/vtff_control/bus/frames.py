"""Frames of vtff's CAN devices: a message of a DBC file with a checksum in its first byte."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any, NamedTuple

import can

from vtff_control.bus.checksum import checksum

__all__ = ["encode_frame", "find_damage"]


class _Place(NamedTuple):
    """Place of a signal in the payload, read as one number."""

    signal: str
    mask: int  # of the bits of the signal, before they are shifted
    shift: int


def encode_frame(message: Any, values: Mapping[str, int]) -> can.Message:
    """Return the frame of a message.

    Parameters
    ----------
    message
        Message of a DBC file.
    values
        Counts of its signals but the checksum, in range: it is not checked again, which would
        triple the time.
    """
    # cantools converts each value by name and kind, which takes five times as long.
    little, big = 0, 0
    low_first, high_first = _places(message)
    for name, mask, shift in low_first:
        little |= (values[name] & mask) << shift
    for name, mask, shift in high_first:
        big |= (values[name] & mask) << shift
    payload = bytearray(little.to_bytes(message.length, "little"))
    if high_first:
        payload = bytearray(map(int.__or__, payload, big.to_bytes(message.length, "big")))
    payload[0] = checksum(message.frame_id, payload)
    return can.Message(arbitration_id=message.frame_id, data=payload, is_extended_id=False)


@functools.lru_cache(maxsize=64)
def _places(message: Any) -> tuple[tuple[_Place, ...], tuple[_Place, ...]]:
    """Return the places of the signals but the checksum: low byte first, and high byte first.

    In a DBC file the start of a signal is its lowest bit where the low byte is first, and its
    highest one where the high byte is.
    """
    low_first, high_first = [], []
    for signal in message.signals:
        mask = 2**signal.length - 1
        if signal.name == "Checksum":
            continue
        if signal.byte_order == "little_endian":
            low_first.append(_Place(signal.name, mask, signal.start))
        else:
            byte, bit = divmod(signal.start, 8)
            lowest = 8 * (message.length - 1 - byte) + bit - (signal.length - 1)
            high_first.append(_Place(signal.name, mask, lowest))
    return tuple(low_first), tuple(high_first)


def find_damage(message: Any, frame: can.Message) -> str:
    """Return what is wrong with a frame of a message, one line; empty if it is whole."""
    payload = bytes(frame.data)
    if frame.is_remote_frame or len(payload) != message.length:
        return f"{message.name}: {len(payload)} bytes, {message.length} expected"
    if payload[0] != checksum(frame.arbitration_id, payload):
        return f"{message.name}: wrong checksum"
    return ""
