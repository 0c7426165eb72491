"""Node `receiver_driver`: a NovAtel receiver's bytes in, observations and ephemerides out."""

from __future__ import annotations

import dataclasses

from vtff_gnss.novatel import ReceiverLogStream
from vtff_nav.receiver.driver_parameters import ReceiverDriverParameters
from vtff_nav.receiver.event_publisher import EventPublisher
from vtff_nav.receiver.live_feed import LiveFeed
from vtff_nav.receiver.live_port import live_address
from vtff_nav.receiver.log_feed import LogFeed
from vtff_nav.receiver.log_source import SourceError, open_source
from vtff_node import diagnostics
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import ParameterError


class ReceiverDriverNode(VtffNode):
    """Driver of one NovAtel receiver, run in the namespace of its spacecraft.

    Publishes gnss/high_rate (every epoch) and gnss/epoch (whole seconds) as
    vtff_msgs/GnssObservations, gnss/ephemeris and gnss/glonass_ephemeris (latched),
    gnss/fix, gnss/ism/... of a GPStation-6, and gnss/raw if asked for.
    A live receiver (serial port or TCP) is searched at all standard baud rates and configured with
    the command list, and again after it was unplugged or switched off. The service send_command
    sends it one more command. In lockstep the driver acknowledges a second when /clock has named
    it and all its logs have been published.
    A log file is read by the wall clock or, in lockstep, as fast as the participants acknowledge
    its seconds; where another node publishes /clock, the log follows that clock. The end of the log
    ends a node that does not follow /clock.
    """

    Parameters = ReceiverDriverParameters

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("receiver_driver", **node_arguments)
        given: ReceiverDriverParameters = self.parameters
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
            self._feed = LiveFeed(self, given, address, self._stream, self._publisher)
        elif source is not None:
            self._feed = LogFeed(
                self, given, source, self._stream, self._publisher, on_end=self._end_with_log
            )

    def on_stop(self) -> None:
        """Close the log or the port."""
        self._feed.close()

    def _end_with_log(self) -> None:
        """Report the counts of a log that was read to its end, and end."""
        self.get_logger().info(f"end of {self.parameters.port}: {self.counts()}")
        self.publish_diagnostics()
        self.finish()

    def counts(self) -> dict[str, int]:
        """Return the counts of published and omitted events and of the stream, without zeros."""
        stream = dataclasses.asdict(self._stream.counters)
        counts = {**self._publisher.published, **self._feed.counts(), **stream}
        return {name: count for name, count in counts.items() if count}

    def awaited_inputs(self) -> list[str]:
        """Return what the receiver still lacks to deliver."""
        level, text, _, _ = self._feed.state()
        device = [] if level == diagnostics.OK else [f"{self.parameters.port} ({text})"]
        return [*super().awaited_inputs(), *device]

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report the connection, decoded and damaged logs, and the newest epoch."""
        counters = self._stream.counters
        damaged = counters.frames_crc_bad + counters.frames_truncated + counters.logs_malformed
        new_damage, self._damaged_reported = damaged - self._damaged_reported, damaged
        level, text, values, hardware_id = self._feed.state()
        if self.problem:
            level, text = diagnostics.ERROR, self.problem
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
