"""Parameters of the node `receiver_driver`, which its feeds share."""

from __future__ import annotations

from dataclasses import dataclass

from vtff_nav.receiver.second_watch import END_OF_SECOND_LOGS
from vtff_node.parameters import REQUIRED, parameter, with_default
from vtff_node.step_source import StepSourceParameters

__all__ = ["ReceiverDriverParameters"]


@dataclass(frozen=True)
class ReceiverDriverParameters(StepSourceParameters):
    """Parameters of `receiver_driver`; it is the step source of a run that replays its log."""

    port: str = parameter(
        REQUIRED,
        "the receiver: /dev/tty..., serial://<device>, tcp://<host>:<port> or file://<log>",
    )
    baud: int = parameter(
        460800, "rate of a serial port; the receiver is set to it", unit="bit/s", minimum=300
    )
    searches_baud: bool = parameter(
        True, "look for a receiver that is not heard at 'baud' at the other standard rates"
    )
    commands: list[str] = parameter(
        [], "sent to a live receiver each time it is connected; empty = nothing is ever sent"
    )
    end_of_second_log: str = parameter(
        "TIME",
        "last log of a second, see 'commands': the gnss/epoch of the second follows it",
        choices=tuple(END_OF_SECOND_LOGS),
    )
    silence_timeout: float = parameter(
        0.3, "silence that ends a second whose last log is missing", unit="s", minimum=0.01
    )
    receiver_timeout: float = parameter(
        3.0,
        "without lockstep, silence after which the receiver is looked for",
        unit="s",
        minimum=0.1,
    )
    frame_id: str = parameter("", "frame of the observations, empty = <namespace>/gnss_antenna")
    publish_raw: bool = parameter(False, "publish every log as received on gnss/raw")
    publish_clock: bool = parameter(
        False,
        "publish the time of a log file on /clock (one node of a system at most); "
        "in lockstep a driver without it follows /clock",
    )
    replay_rate: float = parameter(
        1.0,
        "without lockstep, seconds of a log per second of wall time; 0 = as fast as possible",
        minimum=0.0,
    )
    # Publishers keep 1000 messages a topic: 16 seconds of 60 receiver logs a second.
    maximum_lag: int = with_default(StepSourceParameters, "maximum_lag", 15)
