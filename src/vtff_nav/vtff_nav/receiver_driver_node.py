"""Node `receiver_driver`: a NovAtel receiver's bytes in, observations and ephemerides out."""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass

from rosgraph_msgs.msg import Clock

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.timescales import GpsTime
from vtff_gnss.ephemeris import BroadcastEphemeris, GlonassEphemeris
from vtff_gnss.fix import Fix
from vtff_gnss.novatel import Event, RawLog, ReceiverLogStream
from vtff_gnss.observations import ObservationEpoch
from vtff_msgs.msg import GlonassEphemeris as GlonassEphemerisMessage
from vtff_msgs.msg import GnssEphemeris, GnssFix, GnssObservations, ReceiverLog, StepDone
from vtff_nav.conversions import (
    ephemeris_to_message,
    fix_to_message,
    glonass_ephemeris_to_message,
    observations_to_message,
    raw_log_to_message,
)
from vtff_nav.log_replay import LogReplay, WallClockPacer, whole_second
from vtff_nav.log_source import SourceError, open_source
from vtff_node import diagnostics
from vtff_node.lockstep import StepCoordinator
from vtff_node.main import EXIT_FAILURE, run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import REQUIRED, ParameterError, parameter
from vtff_node.stamps import to_nanoseconds, to_stamp

PUMP_INTERVAL = 0.001  # s
PUMP_DURATION = 0.02  # s; a callback must leave the executor to others, and Ctrl-C, now and then


@dataclass(frozen=True)
class ReceiverDriverParameters:
    """Parameters of `receiver_driver`."""

    port: str = parameter(REQUIRED, "where the bytes come from: file://<receiver log>")
    frame_id: str = parameter("", "frame of the observations, empty = <namespace>/gnss_antenna")
    publish_raw: bool = parameter(False, "publish every log as received on gnss/raw")
    publish_clock: bool = parameter(
        False,
        "publish the time of the log on /clock (one node of a system at most); "
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
    gnss/fix, and gnss/raw if asked for.
    In lockstep a log is read as fast as the participants follow, or as /clock goes where another
    node publishes it; otherwise by the wall clock. The end of the log ends a node that does not
    follow /clock.
    """

    Parameters = ReceiverDriverParameters

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("receiver_driver", **node_arguments)
        given: ReceiverDriverParameters = self.parameters
        try:
            self._source = open_source(given.port)
        except SourceError as error:
            raise ParameterError(str(error)) from error
        self._stream = ReceiverLogStream(raw_logs="all" if given.publish_raw else "none")
        self._log = LogReplay(self._source, self._stream)
        self._frame_id = given.frame_id or (
            f"{self.get_namespace().strip('/') or 'receiver'}/gnss_antenna"
        )
        self._problem = ""
        self._published = {"epochs": 0, "fixes": 0, "ephemerides": 0, "raw logs": 0}
        self._left_out = {"epochs repeated": 0, "before /clock": 0}
        self._jumps_back = 0
        self._damaged_reported = 0
        self._last_epoch: ObservationEpoch | None = None
        self._satellites = 0
        self._is_follower = self.lockstep and not given.publish_clock
        self._clock_first: int | None = None  # s since 1980-01-06 (GPS)
        self._clock_newest = 0
        self._clock_to_acknowledge: Clock | None = None
        self._pacer = WallClockPacer(given.replay_rate)
        self._step_began = time.monotonic()
        self._coordinator = StepCoordinator(
            given.lockstep_participants, given.lockstep_side_branches, given.maximum_lag
        )
        self._clock_publisher = self.publisher(Clock, "/clock") if given.publish_clock else None
        self._high_rate = self.publisher(GnssObservations, "gnss/high_rate")
        self._epoch = self.publisher(GnssObservations, "gnss/epoch")
        self._ephemeris = self.publisher(GnssEphemeris, "gnss/ephemeris")
        self._glonass_ephemeris = self.publisher(GlonassEphemerisMessage, "gnss/glonass_ephemeris")
        self._fix = self.publisher(GnssFix, "gnss/fix")
        self._raw = self.publisher(ReceiverLog, "gnss/raw") if given.publish_raw else None
        if self._is_follower:
            self.subscribe(Clock, "/clock", self._on_clock)
        elif self.lockstep:
            self.subscribe(StepDone, "/sim/step_done", self._on_step_done)
        self.create_timer(PUMP_INTERVAL, self._pump, clock=self.steady_clock)

    # ---- reading -----------------------------------------------------------------------------

    def _pump(self) -> None:
        """Read and publish as far as the pace allows, for `PUMP_DURATION` at most."""
        deadline = time.monotonic() + PUMP_DURATION
        try:
            while not self.finished and self._advance() and time.monotonic() < deadline:
                pass
        except SourceError as error:
            self._fail(str(error))
        except ValueError as error:  # a time that no stamp can hold
            self._fail(f"{self.parameters.port}: {error}")

    def _advance(self) -> bool:
        """Read a chunk or publish an event; return False when there is nothing to do now."""
        if not self._log.has_next:
            if self._log.at_end:
                self._end()
                return False
            self._log.read_more()
            self.report_progress(self._source.position / 1e3, self._source.size / 1e3, unit="kB")
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
            self.get_logger().warning(
                f"the time of the log jumps back by {self._log.second - second} s",
                throttle_duration_sec=1.0,
            )
        stamp_nanoseconds = GpsTime(second * NANOSECONDS_PER_SECOND).to_unix_nanoseconds()
        self.scenario_nanoseconds = stamp_nanoseconds
        self._step_began = time.monotonic()
        self._coordinator.begin(stamp_nanoseconds)
        if self._clock_publisher is not None:
            self._clock_publisher.publish(Clock(clock=to_stamp(stamp_nanoseconds)))

    def _end(self) -> None:
        """Report the end once the last second is done; a follower of /clock stays."""
        if not any(self._published.values()) and not any(self._left_out.values()):
            undated = self._log.undated_count
            reason = f" ({undated} logs or answers without a time)" if undated else ""
            self._fail(
                f"no NovAtel log that vtff reads was found in {self.parameters.port}{reason}"
            )
        elif self._is_follower:
            self._acknowledge_clock()
        elif not self.lockstep or self._last_step_is_done():
            self.get_logger().info(f"end of {self.parameters.port}: {self._counts()}")
            self.publish_diagnostics()
            self.finish()

    def _fail(self, problem: str) -> None:
        self._problem = problem
        self.get_logger().error(problem)
        self.publish_diagnostics()
        self.finish(EXIT_FAILURE)

    def on_stop(self) -> None:
        """Close the log."""
        self._source.close()

    # ---- pace --------------------------------------------------------------------------------

    def _may_begin(self, second: int) -> bool:
        """Whether the next second of the log may be published."""
        if not self.lockstep:
            return self._pacer.may_begin(second, time.monotonic())
        if not self._is_follower:
            return self._log.second is None or self._last_step_is_done()
        if self._clock_first is None:
            patience = self.parameters.start_timeout
            if time.monotonic() - self._step_began > patience:
                self._fail(f"no /clock to follow within {patience:.0f} s")
            return False
        if second <= self._clock_newest:
            return True
        self._acknowledge_clock()
        return False

    def _last_step_is_done(self) -> bool:
        if self._coordinator.complete:
            return True
        first = self._coordinator.step == 0
        patience = self.parameters.start_timeout if first else self.parameters.step_timeout
        if time.monotonic() - self._step_began > patience:
            missing = ", ".join(
                f"{name} (" + (f"last did second {step}" if step >= 0 else "never answered") + ")"
                for name, step in self._coordinator.missing().items()
            )
            absent = ", ".join(self.absent_nodes(self.parameters.expected_nodes))
            self._fail(
                f"no acknowledgement within {patience:.0f} s; waiting for {missing}"
                + (f"; not in the graph: {absent}" if absent else "")
            )
        return False

    def _on_step_done(self, message: StepDone) -> None:
        stamp = to_nanoseconds(message.header.stamp)
        if self._coordinator.acknowledge(message.node, stamp):
            self._pump()

    def _on_clock(self, message: Clock) -> None:
        self._clock_newest = whole_second(
            GpsTime.from_unix_nanoseconds(to_nanoseconds(message.clock))
        )
        if self._clock_first is None:
            self._clock_first = self._clock_newest
        self._clock_to_acknowledge = message
        self._pump()

    def _acknowledge_clock(self) -> None:
        """Tell the step source that everything up to its clock is published."""
        if self._clock_to_acknowledge is not None:
            self.acknowledge_step(self._clock_to_acknowledge.clock, time.perf_counter())
            self._clock_to_acknowledge = None

    # ---- publishing --------------------------------------------------------------------------

    def _publish(self, event: Event) -> None:
        is_early = (self._log.second or 0) < (self._clock_first or 0)
        if is_early and not isinstance(event, (BroadcastEphemeris, GlonassEphemeris)):
            # Whoever follows /clock has no use for what was measured before it began.
            self._left_out["before /clock"] += 1
        elif isinstance(event, ObservationEpoch):
            self._publish_observations(event)
        elif isinstance(event, Fix):
            self._published["fixes"] += 1
            self._fix.publish(fix_to_message(event))
        elif isinstance(event, BroadcastEphemeris):
            self._published["ephemerides"] += 1
            self._ephemeris.publish(ephemeris_to_message(event))
        elif isinstance(event, GlonassEphemeris):
            self._published["ephemerides"] += 1
            self._glonass_ephemeris.publish(glonass_ephemeris_to_message(event))
        elif isinstance(event, RawLog) and self._raw is not None:
            self._published["raw logs"] += 1
            self._raw.publish(raw_log_to_message(event, self._frame_id))

    def _publish_observations(self, epoch: ObservationEpoch) -> None:
        last = self._last_epoch
        if last is not None and epoch.time == last.time and len(last) > 0:
            # The same epoch in a second format, e.g. RANGE and RANGECMP in one log. One without
            # signals does not count: RANGECMP4 cannot be decoded without its reference.
            self._left_out["epochs repeated"] += 1
            return
        self._last_epoch = epoch
        self._published["epochs"] += 1
        self._satellites = len(set(zip(epoch.system.tolist(), epoch.prn.tolist(), strict=True)))
        message = observations_to_message(epoch, self._frame_id)
        self._high_rate.publish(message)
        if epoch.time.nanoseconds % NANOSECONDS_PER_SECOND == 0:
            self._epoch.publish(message)

    # ---- health ------------------------------------------------------------------------------

    def _counts(self) -> dict[str, int]:
        """Return what was published, left out and met in the stream, without the zeros."""
        stream = dataclasses.asdict(self._stream.counters)
        left_out = {f"left out: {name}": count for name, count in self._left_out.items()}
        counts = {**self._published, **left_out, "jumps back in time": self._jumps_back, **stream}
        return {name: count for name, count in counts.items() if count}

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report what was decoded, what was damaged, and the satellites of the last epoch."""
        counters = self._stream.counters
        damaged = counters.frames_crc_bad + counters.frames_truncated + counters.logs_malformed
        new_damage, self._damaged_reported = damaged - self._damaged_reported, damaged
        if self._problem:
            level, text = diagnostics.ERROR, self._problem
        elif new_damage:
            level, text = diagnostics.WARN, f"{new_damage} damaged logs since the last report"
        else:
            level, text = diagnostics.OK, "end of log" if self._log.at_end else "reading"
        return [
            diagnostics.status(
                f"{self.get_name()}: stream",
                level,
                text,
                {**self._counts(), "satellites": self._satellites},
                hardware_id=self.parameters.port,
            )
        ]


NODE_CLASS = ReceiverDriverNode


def main() -> None:
    """Run the node."""
    run_node(ReceiverDriverNode)
