"""NovAtel OEM4/OEMV/OEM6/OEM7 receiver logs: bytes in, typed events out.

A further log gets its number in `message_ids`, its decoder in one of the log modules and its event
in `events`; `stream` lists the decoded numbers and chooses the decoder, and
`vtff_nav.receiver.event_publisher` publishes the event.
"""

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
