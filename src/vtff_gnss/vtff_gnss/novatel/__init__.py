"""NovAtel OEM4/OEMV/OEM6/OEM7 receiver logs: bytes in, typed events out."""

from vtff_gnss.novatel.events import (
    CommandResponse,
    Event,
    IsmScintillation,
    IsmSlantTec,
    RawLog,
    ReceiverVersion,
)
from vtff_gnss.novatel.framing import StreamCounters
from vtff_gnss.novatel.stream import ReceiverLogStream, read_log

__all__ = [
    "CommandResponse",
    "Event",
    "IsmScintillation",
    "IsmSlantTec",
    "RawLog",
    "ReceiverLogStream",
    "ReceiverVersion",
    "StreamCounters",
    "read_log",
]
