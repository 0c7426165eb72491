"""Feed of the receiver driver from a live port: reading, lockstep, commands, recovery."""

from __future__ import annotations

import functools
import math
import select
import time

from rosgraph_msgs.msg import Clock

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.novatel import ReceiverLogStream
from vtff_msgs.srv import SendCommand
from vtff_nav.receiver.driver_parameters import ReceiverDriverParameters
from vtff_nav.receiver.event_publisher import EventPublisher
from vtff_nav.receiver.live_port import LivePort, PortAddress, open_port
from vtff_nav.receiver.live_receiver import LiveReceiver
from vtff_nav.receiver.log_replay import whole_second
from vtff_nav.receiver.port_watch import PortWatch
from vtff_nav.receiver.receiver_session import ReceiverSession, SessionSettings
from vtff_nav.receiver.second_watch import SecondWatch
from vtff_nav.receiver.stream_statistics import StreamStatistics
from vtff_node import diagnostics
from vtff_node.node import VtffNode
from vtff_node.stamps import to_nanoseconds
from vtff_node.step_moments import SECOND_RECEIVED, StepMoments

__all__ = ["LiveFeed"]

PUMP_INTERVAL = 0.01  # s; a timer is needed for time-outs only, as arriving bytes wake the node
REST_INTERVAL = 0.2  # s without a read after which the timer reads also between seconds of lockstep
SERVICE_TIMEOUT = 2.0  # s that send_command waits for the answer; meanwhile it reads the port
SERVICE_POLL = 0.01  # s between two reads of the port while send_command waits


class LiveFeed:
    """Publishes what a live receiver sends, and keeps it configured.

    Parameters
    ----------
    node : VtffNode
        The driver.
    parameters : ReceiverDriverParameters
    address : PortAddress
    stream : ReceiverLogStream
    publisher : EventPublisher
    """

    def __init__(
        self,
        node: VtffNode,
        parameters: ReceiverDriverParameters,
        address: PortAddress,
        stream: ReceiverLogStream,
        publisher: EventPublisher,
    ) -> None:
        self._node = node
        self._port_name = parameters.port
        self._publisher = publisher
        self._watch = PortWatch(self._wake)
        self._port: LivePort | None = None
        self._session = ReceiverSession(
            functools.partial(open_port, address, parameters.baud),
            stream,
            SessionSettings(
                commands=tuple(parameters.commands),
                searches_baud=parameters.searches_baud,
                # In lockstep silence of wall time is no fault: scenario time may stand still.
                receiver_timeout=math.inf if node.lockstep else parameters.receiver_timeout,
            ),
            report=self._report,
            on_port=self._on_port,
        )
        self._receiver = LiveReceiver(
            self._session, SecondWatch(parameters.end_of_second_log, parameters.silence_timeout)
        )
        self._clock_to_acknowledge: Clock | None = None
        self._clock_received = 0.0
        self._is_reported_ready = False
        self._is_closed = False
        self._pumped_at = -math.inf
        self._second_received = -1  # s since 1980-01-06 (GPS)
        self._seconds_received = StepMoments()
        if node.lockstep:
            node.subscribe(Clock, "/clock", self._on_clock)
        node.create_service(SendCommand, "send_command", self._on_send_command)
        node.create_timer(PUMP_INTERVAL, self._on_timer, clock=node.steady_clock)

    @property
    def statistics(self) -> StreamStatistics:
        """Rates and newest epoch of the observations."""
        return self._receiver.statistics

    # ---- reading -----------------------------------------------------------------------------

    def pump(self) -> None:
        """Read the port, publish the decoded events, and acknowledge a second that is done."""
        if self._is_closed:
            return
        now = self._pumped_at = time.monotonic()
        try:
            for event in self._receiver.advance(now):
                self._publisher.publish(event)
            self._publisher.release_epoch(
                None if self._receiver.is_quiet(now) else self._receiver.newest_end
            )
        except ValueError as error:  # a time that no stamp can hold
            self._node.fail(f"{self._port_name}: {error}")
            return
        if not self._node.lockstep and self._receiver.newest_end > self._second_received:
            self._second_received = self._receiver.newest_end
            end = GpsTime(self._second_received * NANOSECONDS_PER_SECOND)
            self._seconds_received.note(end.to_unix_nanoseconds(), now)
        if not self._is_reported_ready and self._session.is_running:
            self._is_reported_ready = True
            self._node.report_ready()
        if self._clock_to_acknowledge is not None:
            if self._receiver.second_is_done(now):
                self._publisher.release_epoch()
                self._node.acknowledge_step(self._clock_to_acknowledge.clock, self._clock_received)
                self._clock_to_acknowledge = None
        elif not self._node.lockstep:
            self._node.scenario_nanoseconds = self.statistics.newest_nanoseconds
        if self._port is not None and self._awaits_bytes():
            self._watch.arm()

    def _awaits_bytes(self) -> bool:
        """Return whether arriving bytes have to be read at once.

        In lockstep all bytes of a second are sent before /clock names it. Until then they wait in
        the port for one read of them all; the timer reads what waits longer.
        """
        return (
            not self._node.lockstep
            or self._clock_to_acknowledge is not None
            or not self._session.is_running
        )

    def _on_timer(self) -> None:
        """Look at the time-outs, and read what has waited in the port for long."""
        if self._awaits_bytes() or time.monotonic() - self._pumped_at >= REST_INTERVAL:
            self.pump()

    def _wake(self) -> None:
        """Let the executor read the port; called in the thread of the watch."""
        executor = self._node.executor
        if executor is not None:
            executor.create_task(self.pump)

    def _on_port(self, port: LivePort | None) -> None:
        self._port = port
        self._watch.watch(None if port is None else port.fileno())

    def _on_clock(self, message: Clock) -> None:
        time_gps = GpsTime.from_unix_nanoseconds(to_nanoseconds(message.clock))
        self._clock_to_acknowledge = message
        self._clock_received = time.perf_counter()
        self._receiver.begin_second(whole_second(time_gps), time.monotonic())
        self.pump()

    def close(self) -> None:
        """Close the port."""
        self._is_closed = True
        self._session.close()
        self._watch.close()

    # ---- commands ----------------------------------------------------------------------------

    def _on_send_command(
        self, request: SendCommand.Request, response: SendCommand.Response
    ) -> SendCommand.Response:
        command = request.command.strip()
        if not command or not command.isascii() or not command.isprintable():
            response.response = "one command of printable ASCII characters is expected"
            return response
        # A service of rclpy must answer within its callback, so the callback itself reads the port.
        pending = self._session.request(command, time.monotonic() + SERVICE_TIMEOUT)
        while not pending.is_over and not self._node.finished:
            self.pump()
            if not pending.is_over:
                select.select([] if self._port is None else [self._port], [], [], SERVICE_POLL)
        if pending.answer is None:
            reason = f" ({self._session.problem})" if self._session.problem else ""
            response.response = (
                f"no answer within {SERVICE_TIMEOUT:g} s; {self._session.state.value}{reason}"
            )
            return response
        response.success = pending.answer.is_ok
        response.response = pending.answer.text
        return response

    # ---- health ------------------------------------------------------------------------------

    def _report(self, is_problem: bool, text: str) -> None:
        line = f"{self._port_name}: {text}"
        # rclpy ties a severity to the line of the call.
        if is_problem:
            self._node.get_logger().warning(line)
        else:
            self._node.get_logger().info(line)

    def counts(self) -> dict[str, int]:
        """Return the number of events that were not published, by reason."""
        left_out = self._publisher.left_out
        return {f"left out: {name}": count for name, count in left_out.items() if count}

    def state(self) -> tuple[bytes, str, dict[str, str], str]:
        """Return level, text, values and hardware id for /diagnostics."""
        session = self._session
        level, text = diagnostics.OK, session.state.value
        if session.problem:
            level, text = diagnostics.ERROR, session.problem
        elif not session.is_running:
            level = diagnostics.WARN
        elif shortage := self._receiver.shortage(time.monotonic(), is_lockstep=self._node.lockstep):
            level, text = diagnostics.WARN, shortage
        values = {
            "connection": session.state.value,
            "reconnects": str(session.reconnects),
            "configured": str(session.configurations),
            "last problem": session.last_problem,
            **({} if session.baud is None else {"baud": str(session.baud)}),
            **self.statistics.line_values(session.baud),
            **self._seconds_received.values(SECOND_RECEIVED),
        }
        hardware_id = self._port_name
        if session.version is not None:
            hardware_id += f" {session.version.model} {session.version.serial_number}"
            values["firmware"] = session.version.software_version
        return level, text, values, hardware_id
