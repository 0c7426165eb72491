"""Node `receiver_driver`: a NovAtel receiver's bytes in, observations and ephemerides out."""

from __future__ import annotations

import dataclasses
import time
from collections import deque
from dataclasses import dataclass

from rosgraph_msgs.msg import Clock

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.timescales import GpsTime
from vtff_gnss.ephemeris import BroadcastEphemeris, GlonassEphemeris
from vtff_gnss.fix import Fix
from vtff_gnss.novatel import Event, RawLog, ReceiverLogStream
from vtff_gnss.observations import ObservationEpoch
from vtff_msgs.msg import GnssEphemeris, GnssFix, GnssObservations, ReceiverLog, StepDone
from vtff_nav.conversions import (
    ephemeris_to_message,
    fix_to_message,
    observations_to_message,
    raw_log_to_message,
)
from vtff_nav.log_source import SourceError, open_source
from vtff_node import diagnostics
from vtff_node.lockstep import StepCoordinator
from vtff_node.main import EXIT_FAILURE, run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import REQUIRED, ParameterError, parameter
from vtff_node.stamps import to_nanoseconds, to_stamp

PUMP_INTERVAL = 0.001  # s
STEPS_PER_PUMP = 20  # a callback must leave the executor to others now and then


@dataclass(frozen=True)
class ReceiverDriverParameters:
    """Parameters of `receiver_driver`."""

    port: str = parameter(REQUIRED, "where the bytes come from: file://<receiver log>")
    frame_id: str = parameter("", "frame of the observations, empty = <namespace>/gnss_antenna")
    publish_raw: bool = parameter(False, "publish every log as received on gnss/raw")
    publish_clock: bool = parameter(
        False, "publish the time of the log on /clock (one driver of a system at most)"
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
    maximum_lag: int = parameter(50, "seconds a side branch may lag", minimum=0, maximum=500)
    start_timeout: float = parameter(
        30.0, "wall time for all participants to take the first second", unit="s", minimum=0.1
    )
    step_timeout: float = parameter(
        5.0, "wall time for all participants to take a later second", unit="s", minimum=0.1
    )


class ReceiverDriverNode(VtffNode):
    """Driver of one NovAtel receiver, run in the namespace of its spacecraft.

    Publishes gnss/high_rate (every epoch) and gnss/epoch (whole seconds) as
    vtff_msgs/GnssObservations, gnss/ephemeris (latched), gnss/fix, and gnss/raw if asked for.
    A log file is read as fast as the participants follow; its end ends the node.
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
        self._frame_id = given.frame_id or (
            f"{self.get_namespace().strip('/') or 'receiver'}/gnss_antenna"
        )
        self._events: deque[Event] = deque()
        self._at_end = False
        self._problem = ""
        self._published = {"epochs": 0, "fixes": 0, "ephemerides": 0, "raw logs": 0}
        self._left_out = {"epochs repeated": 0, "GLONASS ephemerides": 0}
        self._last_epoch: GpsTime | None = None
        self._satellites = 0
        self._second = -1
        self._step_began = time.monotonic()
        self._coordinator = StepCoordinator(
            given.lockstep_participants, given.lockstep_side_branches, given.maximum_lag
        )
        self._clock_publisher = self.publisher(Clock, "/clock") if given.publish_clock else None
        self._high_rate = self.publisher(GnssObservations, "gnss/high_rate")
        self._epoch = self.publisher(GnssObservations, "gnss/epoch")
        self._ephemeris = self.publisher(GnssEphemeris, "gnss/ephemeris")
        self._fix = self.publisher(GnssFix, "gnss/fix")
        self._raw = self.publisher(ReceiverLog, "gnss/raw") if given.publish_raw else None
        if self.lockstep:
            self.subscribe(StepDone, "/sim/step_done", self._on_step_done)
        self.create_timer(PUMP_INTERVAL, self._pump, clock=self.steady_clock)

    # ---- reading -----------------------------------------------------------------------------

    def _pump(self) -> None:
        """Publish what the participants are ready for; read more when it runs out."""
        if self.finished:
            return
        steps_left = STEPS_PER_PUMP
        while steps_left > 0:
            if not self._events and not self._read_more():
                self._end()
                return
            if not self._events:
                continue
            second = _second_of(self._events[0])
            if second is not None and second > self._second:
                if self._second >= 0 and not self._may_go_on():
                    return
                self._begin_second(second)
                steps_left -= 1
            self._publish(self._events.popleft())

    def _read_more(self) -> bool:
        """Fill the queue; return False when there is nothing more to come."""
        if self._at_end:
            return False
        try:
            chunk = self._source.read()
        except SourceError as error:
            self._fail(str(error))
            return False
        if chunk:
            self._events.extend(self._stream.feed(chunk))
        else:
            self._at_end = True
            self._events.extend(self._stream.close())
        shown = {"unit": "kB"}
        self.report_progress(self._source.position / 1e3, self._source.size / 1e3, **shown)
        return True

    def _begin_second(self, second: int) -> None:
        self._second = second
        stamp_nanoseconds = GpsTime(second * NANOSECONDS_PER_SECOND).to_unix_nanoseconds()
        self.scenario_nanoseconds = stamp_nanoseconds
        self._step_began = time.monotonic()
        self._coordinator.begin(stamp_nanoseconds)
        if self._clock_publisher is not None:
            self._clock_publisher.publish(Clock(clock=to_stamp(stamp_nanoseconds)))

    def _may_go_on(self) -> bool:
        if not self.lockstep or self._coordinator.complete:
            return True
        first = self._coordinator.step == 0
        patience = self.parameters.start_timeout if first else self.parameters.step_timeout
        if time.monotonic() - self._step_began > patience:
            names = ", ".join(self._coordinator.missing())
            absent = ", ".join(self.absent_nodes(self.parameters.expected_nodes))
            self._fail(
                f"no acknowledgement within {patience:.0f} s; waiting for {names}"
                + (f"; not in the graph: {absent}" if absent else "")
            )
        return False

    def _on_step_done(self, message: StepDone) -> None:
        stamp = to_nanoseconds(message.header.stamp)
        if self._coordinator.acknowledge(message.node, stamp):
            self._pump()

    def _end(self) -> None:
        if self.finished:
            return
        self._source.close()
        if not any(self._published.values()):
            self._fail(f"no NovAtel log that vtff reads was found in {self.parameters.port}")
            return
        counters = dataclasses.asdict(self._stream.counters)
        notable = {name: count for name, count in counters.items() if count}
        self.get_logger().info(
            f"end of {self.parameters.port}: published {self._published}, "
            f"left out {self._left_out}, stream {notable}"
        )
        self.finish()

    def _fail(self, problem: str) -> None:
        self._problem = problem
        self.get_logger().error(problem)
        self.finish(EXIT_FAILURE)

    # ---- publishing --------------------------------------------------------------------------

    def _publish(self, event: Event) -> None:
        if isinstance(event, ObservationEpoch):
            self._publish_observations(event)
        elif isinstance(event, Fix):
            self._published["fixes"] += 1
            self._fix.publish(fix_to_message(event))
        elif isinstance(event, BroadcastEphemeris):
            self._published["ephemerides"] += 1
            self._ephemeris.publish(ephemeris_to_message(event))
        elif isinstance(event, GlonassEphemeris):
            # The message holds Keplerian elements; a GLONASS ephemeris is a state vector.
            self._left_out["GLONASS ephemerides"] += 1
        elif isinstance(event, RawLog) and self._raw is not None:
            self._published["raw logs"] += 1
            self._raw.publish(raw_log_to_message(event, self._frame_id))

    def _publish_observations(self, epoch: ObservationEpoch) -> None:
        if epoch.time == self._last_epoch:
            # The same epoch in a second format, e.g. RANGE and RANGECMP in one log.
            self._left_out["epochs repeated"] += 1
            return
        self._last_epoch = epoch.time
        self._published["epochs"] += 1
        self._satellites = len(set(zip(epoch.system.tolist(), epoch.prn.tolist(), strict=True)))
        message = observations_to_message(epoch, self._frame_id)
        self._high_rate.publish(message)
        if epoch.time.nanoseconds % NANOSECONDS_PER_SECOND == 0:
            self._epoch.publish(message)

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report what was decoded, what was damaged, and the satellites of the last epoch."""
        return [
            diagnostics.status(
                f"{self.get_name()}: stream",
                diagnostics.ERROR if self._problem else diagnostics.OK,
                self._problem or "reading",
                {
                    **self._published,
                    **self._left_out,
                    **dataclasses.asdict(self._stream.counters),
                    "satellites": self._satellites,
                },
                hardware_id=self.parameters.port,
            )
        ]


def _second_of(event: Event) -> int | None:
    """Return the whole second (GPS) that an event belongs to: its own or the next one."""
    if not isinstance(event, ObservationEpoch):
        return None
    return -(-event.time.nanoseconds // NANOSECONDS_PER_SECOND)


NODE_CLASS = ReceiverDriverNode


def main() -> None:
    """Run the node."""
    run_node(ReceiverDriverNode)
