"""Binary motion datagrams as a C compiler lays them out."""

from __future__ import annotations

import ctypes

from vtff_sim_bridge.simremote.motion import MotionState
from vtff_sim_bridge.simremote.udp_motion import MotionDatagram


class NaturalLayout(ctypes.LittleEndianStructure):
    """The structure as a C compiler lays it out, the reference for size and offsets."""

    _fields_ = [
        ("type", ctypes.c_uint32),
        ("time_action", ctypes.c_uint32),
        ("time_of_validity_ms", ctypes.c_uint32),
        ("vehicle_id", ctypes.c_uint32),
        ("numbers", ctypes.c_double * 24),
        ("latency_ms", ctypes.c_int32),
    ]


def datagram_of(command: MotionDatagram, packed: bool = False) -> bytes:
    """Return a motion command as a datagram of 216 bytes, or 212 without the padding."""
    time = command.time_nanoseconds
    number = int(command.vehicle_id.removeprefix("v").removesuffix("_m1"))
    numbers = [number for vector in command.motion for number in vector]
    structure = NaturalLayout(
        0 if isinstance(command.motion, MotionState) else 1,
        int(time is not None),
        (time or 0) // 1_000_000,
        number,
        (ctypes.c_double * 24)(*numbers),
        command.latency_ms,
    )
    return bytes(structure)[: 212 if packed else 216]
