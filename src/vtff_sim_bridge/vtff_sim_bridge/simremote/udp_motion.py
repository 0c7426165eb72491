"""Binary motion commands that SimGEN takes as UDP datagrams.

One lineage of public clients shows this structure (Spirent's `SimGen_UDP_rx_commands.h`), all
little-endian: type, time action, time of validity in ms into the run, vehicle number, 24 binary64
numbers in the order of MOT or MOTB, and a latency that clients write as 0 and that is a diagnostic
of SimGEN. The structure is 216 bytes with natural alignment, 212 packed; both are read. There is
no reply.
"""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

from vtff_dynamics.constants import NANOSECONDS_PER_MILLISECOND
from vtff_sim_bridge.simremote.language import MOT_FIELDS, MOTB_FIELDS, SimRemoteSyntaxError
from vtff_sim_bridge.simremote.motion import GeodeticMotionState, MotionState, Vector

TYPE_MOT = 0
TYPE_MOTB = 1

_LAYOUT = struct.Struct("<4I24di")
_PADDING = 4


class MotionDatagram(NamedTuple):
    """One motion command.

    Attributes
    ----------
    vehicle_id : str
        Vehicle, such as ``v1_m1``.
    motion : MotionState or GeodeticMotionState
        Motion of a command of type MOT or MOTB.
    time_nanoseconds : int or None
        Time into the run, whole milliseconds; None for immediately.
    latency_ms : int
        Latency as received, ms; its sign convention is not known and nothing uses it.
    """

    vehicle_id: str
    motion: MotionState | GeodeticMotionState
    time_nanoseconds: int | None
    latency_ms: int = 0


def parse_datagram(datagram: bytes) -> MotionDatagram:
    """Return the motion command in a datagram of 216 or 212 bytes.

    Raises
    ------
    SimRemoteSyntaxError
        If the size, type, time action, vehicle or a number is not as described above.
    """
    if len(datagram) not in (_LAYOUT.size, _LAYOUT.size + _PADDING):
        raise SimRemoteSyntaxError(f"datagram: 216 or 212 bytes expected, got {len(datagram)}")
    kind, action, milliseconds, vehicle, *numbers, latency_ms = _LAYOUT.unpack_from(datagram)
    if kind not in (TYPE_MOT, TYPE_MOTB):
        raise SimRemoteSyntaxError(f"type: 0 (MOT) or 1 (MOTB) expected, got {kind}")
    if action not in (0, 1):
        raise SimRemoteSyntaxError(f"time_action: 0 or 1 expected, got {action}")
    if not 1 <= vehicle <= 999:
        raise SimRemoteSyntaxError(f"vehicle_id: 1 to 999 expected, got {vehicle}")
    for name, number in zip(MOT_FIELDS if kind == TYPE_MOT else MOTB_FIELDS, numbers, strict=True):
        if not math.isfinite(number):
            raise SimRemoteSyntaxError(f"{name}: a finite number expected, got {number}")
    values = iter(numbers)
    vectors: list[Vector] = list(zip(values, values, values, strict=True))
    return MotionDatagram(
        f"v{vehicle}_m1",
        MotionState(*vectors) if kind == TYPE_MOT else GeodeticMotionState(*vectors),
        milliseconds * NANOSECONDS_PER_MILLISECOND if action == 1 else None,
        latency_ms,
    )
