"""Frames of vtff's CAN devices: a message of a DBC file with a checksum in its first byte."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import can

from vtff_control.bus.checksum import checksum

__all__ = ["encode_frame", "find_damage"]


def encode_frame(message: Any, values: Mapping[str, int]) -> can.Message:
    """Return the frame of a message.

    Parameters
    ----------
    message
        Message of a DBC file.
    values
        Counts of its signals but the checksum.
    """
    payload = bytearray(message.encode({**values, "Checksum": 0}, scaling=False))
    payload[0] = checksum(message.frame_id, payload)
    return can.Message(arbitration_id=message.frame_id, data=payload, is_extended_id=False)


def find_damage(message: Any, frame: can.Message) -> str:
    """Return what is wrong with a frame of a message, one line; empty if it is whole."""
    payload = bytes(frame.data)
    if frame.is_remote_frame or len(payload) != message.length:
        return f"{message.name}: {len(payload)} bytes, {message.length} expected"
    if payload[0] != checksum(frame.arbitration_id, payload):
        return f"{message.name}: wrong checksum"
    return ""
