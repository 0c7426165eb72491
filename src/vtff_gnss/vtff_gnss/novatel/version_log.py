"""VERSION log: which receiver this is (OEM7 Commands and Logs Reference Manual, VERSION)."""

from __future__ import annotations

import struct

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.novatel.events import ReceiverVersion

__all__ = ["decode_version"]

_COUNT = struct.Struct("<I")
_COMPONENT = struct.Struct("<I16s16s16s16s16s12s12s")
_RECEIVER_CARD = 1


def decode_version(payload: bytes, time: GpsTime | None) -> ReceiverVersion:
    """Return what the payload of VERSION tells about the receiver card; `time` of its header.

    Raises
    ------
    ValueError
        If no component is listed, or the payload is too short.
    """
    (count,) = _COUNT.unpack_from(payload)
    if count < 1 or len(payload) < _COUNT.size + count * _COMPONENT.size:
        raise ValueError(f"VERSION: {count} components in {len(payload)} bytes")
    components = [
        _COMPONENT.unpack_from(payload, _COUNT.size + index * _COMPONENT.size)
        for index in range(count)
    ]
    card = next((item for item in components if item[0] == _RECEIVER_CARD), components[0])
    model, serial_number, hardware, software = (
        field.split(b"\0")[0].decode("ascii", errors="replace").strip() for field in card[1:5]
    )
    return ReceiverVersion(time, model, serial_number, hardware, software)
