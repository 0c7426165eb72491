"""What a receiver log stream yields."""

from __future__ import annotations

from dataclasses import dataclass

from vtff_dynamics.timescales import GpsTime
from vtff_gnss.ephemeris import BroadcastEphemeris, GlonassEphemeris
from vtff_gnss.fix import Fix, ReceiverTime
from vtff_gnss.observations import ObservationEpoch

__all__ = ["CommandResponse", "Event", "RawLog"]


@dataclass(frozen=True)
class RawLog:
    """One receiver log exactly as received (``vtff_msgs/ReceiverLog``).

    Parameters
    ----------
    time : GpsTime or None
        Time in the log header; None where the receiver did not know it.
    name : str
        Log name with its format suffix, e.g. ``"RANGEB"``; ``"LOG<id>B"`` for an unknown id.
    log_id : int
        Message id in the receiver's protocol.
    content : bytes
        All bytes, framing and checksum included.
    """

    time: GpsTime | None
    name: str
    log_id: int
    content: bytes


@dataclass(frozen=True)
class CommandResponse:
    """The receiver's answer to a command.

    Parameters
    ----------
    is_ok : bool
        The command was accepted.
    text : str
        The answer, e.g. ``"OK"`` or ``"ERROR:Invalid Message. Field = BESTGP"``.
    command : str
        Name of the command; empty for abbreviated answers, which do not tell it.
    """

    is_ok: bool
    text: str
    command: str = ""


Event = (
    ObservationEpoch
    | BroadcastEphemeris
    | GlonassEphemeris
    | Fix
    | ReceiverTime
    | RawLog
    | CommandResponse
)
"""Any event of a receiver log stream."""
