"""Header and checksum of the long binary frames that an emulated receiver sends.

Source: OEM7 Commands and Logs Reference Manual, "Binary" and "32-bit CRC"; the definition CRCs
are those of novatel_edie and of real logs.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Literal

from vtff_dynamics.constants import NANOSECONDS_PER_MILLISECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.novatel import message_ids as ids
from vtff_gnss.novatel.framing import crc32_novatel
from vtff_gnss.novatel.header import MILLISECONDS_PER_WEEK, TIME_STATUS_UNKNOWN

__all__ = [
    "ID_IONUTC",
    "PORT_ADDRESSES",
    "TIME_STATUS_FINE_STEERING",
    "TIME_STATUS_SATELLITE",
    "Generation",
    "HeaderSettings",
    "encode_frame",
]

ID_IONUTC = 8
TIME_STATUS_FINE_STEERING = 180
TIME_STATUS_SATELLITE = 200
"""Logs of broadcast data: the time of the header is that of the data, not that of sending."""
PORT_ADDRESSES = {"COM1": 0x20, "COM2": 0x40, "COM3": 0x60}

Generation = Literal["OEM6", "OEM7"]
"""Receiver generation; the layouts are the same, some definition CRCs are not."""

_DEFINITION_CRCS_OEM7 = {
    ids.ID_GPSEPHEM: 0x1214,
    ID_IONUTC: 0xEC21,
    ids.ID_VERSION: 0x3681,
    ids.ID_RAWEPHEM: 0x58BA,
    ids.ID_RANGE: 0x5103,
    ids.ID_TIME: 0x9924,
    ids.ID_RANGECMP: 0x9691,
    ids.ID_BESTXYZ: 0x44CF,
    ids.ID_GALINAVEPHEMERIS: 0xDBE9,
    ids.ID_GALFNAVEPHEMERIS: 0x02CD,
    ids.ID_RANGECMP4: 0xFB0E,
}
_DEFINITION_CRCS = {
    "OEM7": _DEFINITION_CRCS_OEM7,
    "OEM6": _DEFINITION_CRCS_OEM7
    | {ids.ID_GPSEPHEM: 0x9145, ids.ID_RAWEPHEM: 0x97B7, ids.ID_BESTXYZ: 0xBDE7},
}

_HEADER = struct.Struct("<BBBBHBBHHBBHIIHH")
_CRC = struct.Struct("<I")
_LONGEST_PAYLOAD = 0xFFFF


@dataclass(frozen=True)
class HeaderSettings:
    """Fields that the headers of one port of a receiver have in common.

    Parameters
    ----------
    port_address : int
        See `PORT_ADDRESSES`.
    generation : {"OEM6", "OEM7"}
        Chooses the definition CRCs.
    software_version : int
        Build number of the firmware.
    idle_time : int
        Idle time of the processor in half per cent.

    Raises
    ------
    ValueError
        If a field does not fit the header.
    """

    port_address: int = PORT_ADDRESSES["COM1"]
    generation: Generation = "OEM7"
    software_version: int = 0
    idle_time: int = 120

    def __post_init__(self) -> None:
        if self.generation not in _DEFINITION_CRCS:
            raise ValueError(f"generation: {self.generation!r} is not one of 'OEM6', 'OEM7'")
        for name, limit in (("port_address", 255), ("software_version", 65535), ("idle_time", 200)):
            if not 0 <= getattr(self, name) <= limit:
                raise ValueError(f"{name}: {getattr(self, name)} is not in 0..{limit}")


def encode_frame(
    message_id: int,
    payload: bytes,
    time: GpsTime | None,
    settings: HeaderSettings,
    time_status: int = TIME_STATUS_FINE_STEERING,
    receiver_status: int = 0,
) -> bytes:
    """Return a complete binary log.

    Parameters
    ----------
    message_id : int
        Message id.
    payload : bytes
        Content without header and checksum.
    time : GpsTime or None
        Time of the header; None before the receiver knows it, whatever `time_status` says. With
        `TIME_STATUS_UNKNOWN` the header has zeros.
    settings : HeaderSettings
        The other fields of the header.
    time_status, receiver_status : int
        Quality of the receiver's time; receiver status word.

    Raises
    ------
    ValueError
        If `time` is not a whole millisecond, which the header cannot hold, or the payload is too
        long.
    """
    week, milliseconds = 0, 0
    if time is None:
        time_status = TIME_STATUS_UNKNOWN
    if time is not None and time_status != TIME_STATUS_UNKNOWN:
        total, remainder = divmod(time.nanoseconds, NANOSECONDS_PER_MILLISECOND)
        if remainder:
            raise ValueError(f"time: {time} is not a whole millisecond")
        week, milliseconds = divmod(total, MILLISECONDS_PER_WEEK)
    if len(payload) > _LONGEST_PAYLOAD:
        raise ValueError(f"payload: {len(payload)} bytes do not fit a frame")
    header = _HEADER.pack(
        0xAA, 0x44, 0x12, _HEADER.size, message_id, 0, settings.port_address, len(payload),
        0, settings.idle_time, time_status, week, milliseconds, receiver_status,
        _DEFINITION_CRCS[settings.generation].get(message_id, 0),
        settings.software_version,
    )  # fmt: skip
    content = header + payload
    return content + _CRC.pack(crc32_novatel(content))
