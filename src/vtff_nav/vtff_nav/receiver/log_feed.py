"""Feed of the receiver driver from a log file: pace, /clock, lockstep, end of the log."""

from __future__ import annotations

import time
from collections.abc import Callable

from rosgraph_msgs.msg import Clock

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.ephemeris import BroadcastEphemeris, GlonassEphemeris
from vtff_gnss.novatel import Event, ReceiverLogStream
from vtff_nav.receiver.driver_parameters import ReceiverDriverParameters
from vtff_nav.receiver.event_publisher import EventPublisher
from vtff_nav.receiver.log_replay import LogReplay, WallClockPacer, whole_second
from vtff_nav.receiver.log_source import FileSource, SourceError
from vtff_nav.receiver.stream_statistics import StreamStatistics
from vtff_node import diagnostics
from vtff_node.node import VtffNode
from vtff_node.stamps import to_nanoseconds, to_stamp
from vtff_node.step_source import StepSource

__all__ = ["LogFeed"]

PUMP_INTERVAL = 0.001  # s
PUMP_DURATION = 0.02  # s; then the callback returns, so that the executor can serve others and end


class LogFeed:
    """Publishes the seconds of a receiver log as the pace allows.

    Parameters
    ----------
    node : VtffNode
        The driver; it fails when the log cannot be read or a participant does not answer.
    parameters : ReceiverDriverParameters
    source : FileSource
    stream : ReceiverLogStream
    publisher : EventPublisher
    on_end : callable
        Called when the last second is done, unless the log follows the /clock of another node.
    """

    def __init__(
        self,
        node: VtffNode,
        parameters: ReceiverDriverParameters,
        source: FileSource,
        stream: ReceiverLogStream,
        publisher: EventPublisher,
        on_end: Callable[[], None],
    ) -> None:
        self._node = node
        self._parameters = parameters
        self._on_end = on_end
        self._source = source
        self._publisher = publisher
        self._log = LogReplay(source, stream)
        self.statistics = StreamStatistics()
        self._before_clock = 0
        self._jumps_back = 0
        self._is_follower = node.lockstep and not parameters.publish_clock
        self._clock_first: int | None = None  # s since 1980-01-06 (GPS)
        self._clock_newest = 0
        self._clock_to_acknowledge: Clock | None = None
        self._pacer = WallClockPacer(parameters.replay_rate)
        self._started = time.monotonic()
        self._clock_publisher = (
            node.publisher(Clock, "/clock") if parameters.publish_clock else None
        )
        self._step_source: StepSource | None = None
        if self._is_follower:
            node.subscribe(Clock, "/clock", self._on_clock)
        elif node.lockstep:
            self._step_source = StepSource(node, parameters, self._continue_when_complete)
        node.create_timer(PUMP_INTERVAL, self.pump, clock=node.steady_clock)

    @property
    def at_end(self) -> bool:
        """Whether all bytes have been read."""
        return self._log.at_end

    # ---- reading -----------------------------------------------------------------------------

    def pump(self) -> None:
        """Read and publish as far as the pace allows, for `PUMP_DURATION` at most."""
        deadline = time.monotonic() + PUMP_DURATION
        try:
            while not self._node.finished and self._advance() and time.monotonic() < deadline:
                pass
        except SourceError as error:
            self._node.fail(str(error))
        except ValueError as error:  # a time that no stamp can hold
            self._node.fail(f"{self._parameters.port}: {error}")

    def _advance(self) -> bool:
        """Read a chunk or publish an event; return False when the log has to wait."""
        if not self._log.has_next:
            if self._log.at_end:
                self._end()
                return False
            self._log.read_more()
            position, size = self._source.position, self._source.size
            self._node.report_progress(position / 1e3, size / 1e3, unit="kB")
            return True
        second = self._log.next_second()
        if second is not None:
            if not self._may_begin(second):
                return False
            self._begin_second(second)
        self._publish(self._log.take())
        return True

    def _begin_second(self, second: int) -> None:
        if self._log.second is not None and second < self._log.second:
            self._jumps_back += 1
            self._node.get_logger().warning(
                f"the time of the log jumps back by {self._log.second - second} s",
                throttle_duration_sec=1.0,
            )
        stamp_nanoseconds = GpsTime(second * NANOSECONDS_PER_SECOND).to_unix_nanoseconds()
        self._node.scenario_nanoseconds = stamp_nanoseconds
        if self._step_source is not None:
            self._step_source.begin(stamp_nanoseconds)
        if self._clock_publisher is not None:
            self._clock_publisher.publish(Clock(clock=to_stamp(stamp_nanoseconds)))

    def _publish(self, event: Event) -> None:
        is_early = (self._log.second or 0) < (self._clock_first or 0)
        if is_early and not isinstance(event, (BroadcastEphemeris, GlonassEphemeris)):
            # The followers of /clock cannot use what was measured before its first second.
            self._before_clock += 1
            return
        self.statistics.add(0, (event,))
        self._publisher.publish(event)

    def _end(self) -> None:
        """End once the last second is done; a log that follows /clock does not end the node."""
        if not any(self._publisher.published.values()) and not self._left_out():
            undated = self._log.undated_count
            reason = f" ({undated} logs or answers without a time)" if undated else ""
            self._node.fail(
                f"no NovAtel log that vtff reads was found in {self._parameters.port}{reason}"
            )
        elif self._is_follower:
            self._acknowledge_clock()
        elif self._last_step_is_done():
            self._on_end()

    def close(self) -> None:
        """Close the log."""
        self._source.close()

    # ---- pace --------------------------------------------------------------------------------

    def _may_begin(self, second: int) -> bool:
        """Return whether the next second of the log may be published."""
        if not self._node.lockstep:
            return self._pacer.may_begin(second, time.monotonic())
        if not self._is_follower:
            return self._log.second is None or self._last_step_is_done()
        if self._clock_first is None:
            patience = self._parameters.start_timeout
            if time.monotonic() - self._started > patience:
                self._node.fail(f"no /clock to follow within {patience:.0f} s")
            return False
        if second <= self._clock_newest:
            return True
        self._acknowledge_clock()
        return False

    def _last_step_is_done(self) -> bool:
        """Return whether the next second need not wait; fail when a participant does not answer."""
        if self._step_source is None or self._step_source.is_complete:
            return True
        problem = self._step_source.describe_hanging_step()
        if problem:
            self._node.fail(problem)
        return False

    def _continue_when_complete(self) -> None:
        if self._step_source is not None and self._step_source.is_complete:
            self.pump()

    def _on_clock(self, message: Clock) -> None:
        self._clock_newest = whole_second(
            GpsTime.from_unix_nanoseconds(to_nanoseconds(message.clock))
        )
        if self._clock_first is None:
            self._clock_first = self._clock_newest
        self._clock_to_acknowledge = message
        self.pump()

    def _acknowledge_clock(self) -> None:
        """Acknowledge the newest /clock: every event up to it has been published."""
        if self._clock_to_acknowledge is not None:
            self._node.acknowledge_step(self._clock_to_acknowledge.clock, time.perf_counter())
            self._clock_to_acknowledge = None

    # ---- health ------------------------------------------------------------------------------

    def counts(self) -> dict[str, int]:
        """Return the number of events that were not published, by reason, and of jumps back."""
        return {**self._left_out(), "jumps back in time": self._jumps_back}

    def _left_out(self) -> dict[str, int]:
        left_out = {**self._publisher.left_out, "before /clock": self._before_clock}
        return {f"left out: {name}": count for name, count in left_out.items() if count}

    def state(self) -> tuple[bytes, str, dict[str, str], str]:
        """Return level, text, values and hardware id for /diagnostics."""
        text = "end of log" if self._log.at_end else "reading"
        return diagnostics.OK, text, {}, self._parameters.port
