"""Node `receiver_driver`: a NovAtel receiver's bytes in, observations and ephemerides out."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from vtff_gnss.novatel import ReceiverLogStream
from vtff_nav.receiver.event_publisher import EventPublisher
from vtff_nav.receiver.live_feed import LiveFeed
from vtff_nav.receiver.live_port import live_address
from vtff_nav.receiver.log_feed import LogFeed
from vtff_nav.receiver.log_source import SourceError, open_source
from vtff_nav.receiver.second_watch import END_OF_SECOND_LOGS
from vtff_node import diagnostics
from vtff_node.main import EXIT_FAILURE, run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import REQUIRED, ParameterError, parameter


@dataclass(frozen=True)
class ReceiverDriverParameters:
    """Parameters of `receiver_driver`."""

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
    lockstep_participants: list[str] = parameter(
        [], "fully qualified nodes that must acknowledge each second of a log"
    )
    lockstep_side_branches: list[str] = parameter(
        [], "nodes that must acknowledge but may lag (recorder, viewer)"
    )
    expected_nodes: list[str] = parameter(
        [], "fully qualified nodes of the system; absent ones are named when a step hangs"
    )
    # Publishers keep 1000 messages a topic: 16 seconds of 60 receiver logs a second.
    maximum_lag: int = parameter(15, "seconds a side branch may lag", minimum=0, maximum=500)
    start_timeout: float = parameter(
        30.0, "wall time for all participants to take the first second", unit="s", minimum=0.1
    )
    step_timeout: float = parameter(
        5.0, "wall time for all participants to take a later second", unit="s", minimum=0.1
    )


class ReceiverDriverNode(VtffNode):
    """Driver of one NovAtel receiver, run in the namespace of its spacecraft.

    Publishes gnss/high_rate (every epoch) and gnss/epoch (whole seconds) as
    vtff_msgs/GnssObservations, gnss/ephemeris and gnss/glonass_ephemeris (latched),
    gnss/fix, gnss/ism/... of a GPStation-6, and gnss/raw if asked for.
    A live receiver (serial port or TCP) is found at its baud rate, configured with the command
    list, and again after it was unplugged or switched off; the service send_command sends it
    one more. In lockstep a second is acknowledged when /clock has named it and all its bytes
    have been published.
    A log file is read, in lockstep, as fast as the participants follow, or as /clock goes where
    another node publishes it; otherwise by the wall clock. The end of the log ends a node that
    does not follow /clock.
    """

    Parameters = ReceiverDriverParameters

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("receiver_driver", **node_arguments)
        given: ReceiverDriverParameters = self.parameters
        self._problem = ""
        self._damaged_reported = 0
        self._stream = ReceiverLogStream(raw_logs="all" if given.publish_raw else "none")
        try:
            address = live_address(given.port)
            source = None if address is not None else open_source(given.port)
        except (SourceError, ValueError) as error:
            raise ParameterError(f"parameter 'port': {error}") from error
        if address is not None and given.publish_clock:
            raise ParameterError(
                "parameter 'publish_clock': only a log file has a clock to publish"
            )
        self._publisher = EventPublisher(
            self,
            given.frame_id or f"{self.get_namespace().strip('/') or 'receiver'}/gnss_antenna",
            publishes_raw=given.publish_raw,
            holds_epoch=address is not None,
        )
        self._feed: LogFeed | LiveFeed
        if address is not None:
            self._feed = LiveFeed(self, address, self._stream, self._publisher)
        elif source is not None:
            self._feed = LogFeed(self, source, self._stream, self._publisher)

    def on_stop(self) -> None:
        """Close log or port."""
        self._feed.close()

    def fail(self, problem: str) -> None:
        """Report what makes it impossible to go on, and end."""
        self._problem = problem
        self.get_logger().error(problem)
        self.publish_diagnostics()
        self.finish(EXIT_FAILURE)

    def counts(self) -> dict[str, int]:
        """Return what was published, left out and met in the stream, without the zeros."""
        stream = dataclasses.asdict(self._stream.counters)
        counts = {**self._publisher.published, **self._feed.counts(), **stream}
        return {name: count for name, count in counts.items() if count}

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report the connection, what was decoded and damaged, and the newest epoch."""
        counters = self._stream.counters
        damaged = counters.frames_crc_bad + counters.frames_truncated + counters.logs_malformed
        new_damage, self._damaged_reported = damaged - self._damaged_reported, damaged
        level, text, values, hardware_id = self._feed.state()
        if self._problem:
            level, text = diagnostics.ERROR, self._problem
        elif new_damage and level == diagnostics.OK:
            level, text = diagnostics.WARN, f"{new_damage} damaged logs since the last report"
        frames = {
            "good": counters.frames_good,
            "CRC-bad": counters.frames_crc_bad,
            "unknown": counters.logs_undecoded,
            "dropped": counters.logs_malformed + counters.frames_truncated,
        }
        tracking = self._feed.statistics.tracking_values()
        has_satellites = tracking["satellites"] != "0"
        return [
            diagnostics.status(
                f"{self.get_name()}: stream",
                level,
                text,
                {**values, **frames, **self.counts()},
                hardware_id=hardware_id,
            ),
            diagnostics.status(
                f"{self.get_name()}: tracking",
                diagnostics.OK if has_satellites else diagnostics.WARN,
                f"{tracking['satellites']} satellites",
                tracking,
                hardware_id=hardware_id,
            ),
        ]


NODE_CLASS = ReceiverDriverNode


def main() -> None:
    """Run the node."""
    run_node(ReceiverDriverNode)
