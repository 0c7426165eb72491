"""Node `adcs_can`: the ADCS module of a spacecraft on a CAN bus."""

from __future__ import annotations

import dataclasses
import math
import time
from dataclasses import dataclass

import can
import numpy as np
from rosgraph_msgs.msg import Clock

from vtff_control.adcs.frames import AdcsAnswer, AdcsFrames, AdcsModuleReport
from vtff_control.adcs.log import AdcsLogWriter
from vtff_control.adcs.module_link import AdcsLink
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_msgs.msg import AdcsCommand, AdcsReport
from vtff_node import diagnostics
from vtff_node.can_bus.node_bus import (
    CanBusParameters,
    bus_status,
    connect_first,
    read_database,
)
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import ParameterError, parameter
from vtff_node.stamps import to_nanoseconds, to_stamp

# All times in s of wall time.
BLOCKING_WAIT = 0.1  # in a callback; what takes longer is waited for between callbacks
WATCH_INTERVAL = 0.05  # between looks at what is awaited
SILENT_TIMEOUT = 0.2  # for a module that was silent before
SILENCE_LOG_INTERVAL = 10.0  # from one line on a silence to the next


@dataclass(frozen=True)
class AdcsCanParameters(CanBusParameters):
    """Parameters of `adcs_can`."""

    channel: str = parameter("239.74.163.3", "bus of that interface, as can0 or a multicast group")
    spacecraft: str = parameter("spacecraft", "spacecraft of the module")
    period: float = parameter(5.0, "period of the module", unit="s", minimum=0.01)
    pulse_step: float = parameter(0.01, "length of a step of a pulse", unit="s", minimum=1e-4)
    sample_times: list[float] = parameter(
        [0.8, 0.0], "times of the samples before the end of a period, falling", unit="s"
    )
    report_timeout: float = parameter(
        4.0, "longest wait for a report or an answer (wall time)", unit="s", minimum=0.001
    )
    start_timeout: float = parameter(
        20.0, "the same for the first report in lockstep (wall time)", unit="s", minimum=0.001
    )
    log_file: str = parameter(
        "", "file for all frames, candump format, stamped with scenario time; empty: none"
    )


@dataclass(frozen=True)
class _Awaited:
    """A frame that is awaited: the report of a stamp, or the answer to a command."""

    stamp: int  # ns
    started: float  # time.perf_counter()
    deadline: float
    command: AdcsCommand | None = None


class AdcsCanNode(VtffNode):
    """ADCS module of one spacecraft on its CAN bus, run in its namespace.

    Publishes what the module reports at the end of each period on adcs/report
    (vtff_msgs/AdcsReport), takes adcs/command (vtff_msgs/AdcsCommand), sends it over the bus, and
    publishes what the module has accepted on adcs/actuation. In lockstep /clock says when a report
    is due, and a step is acknowledged when its command is answered. A module that says nothing
    leaves a report with `heard` false and an actuation with `accepted` false: rods off, wheel held.
    """

    Parameters = AdcsCanParameters

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("adcs_can", **node_arguments)
        given: AdcsCanParameters = self.parameters
        times = given.sample_times
        if not times or list(times) != sorted(set(times), reverse=True) or min(times) < 0.0:
            raise ParameterError(
                f"parameter 'sample_times': falling times of 0 s or more expected; got {times}"
            )
        frames = read_database(AdcsFrames, given.dbc_file)
        self._log: AdcsLogWriter | None = None
        if given.log_file:
            try:
                self._log = AdcsLogWriter(given.log_file)
            except OSError as error:
                raise ParameterError(
                    f"parameter 'log_file': {given.log_file}: {error.strerror or error}"
                ) from error
        self._link = AdcsLink(frames, given.open_bus, self._write_to_log)
        connect_first(self._link.bus.connect)
        self._period = round(given.period * NANOSECONDS_PER_SECOND)
        self._first_stamp = -1
        self._log_stamp = 0
        self._due: list[_Awaited] = []
        self._silent = False
        self._silence_logged_at = -math.inf
        self._refused = 0
        self._newest = AdcsReport()  # a silent module is taken to be as it was
        self._pulses_accepted = (0, 0, 0)
        self._report_publisher = self.publisher(AdcsReport, "adcs/report")
        self._actuation_publisher = self.publisher(AdcsCommand, "adcs/actuation")
        self.subscribe(AdcsCommand, "adcs/command", self._on_command)
        if self.lockstep:
            self.subscribe(Clock, "/clock", self._on_clock)
        self.create_timer(WATCH_INTERVAL, self._watch, clock=self.steady_clock)
        self.report_ready()  # frames that were sent before the bus is open would be lost

    # ---- reports -----------------------------------------------------------------------------

    def _on_clock(self, message: Clock) -> None:
        started = time.perf_counter()
        stamp = self._log_stamp = to_nanoseconds(message.clock)
        if self._first_stamp < 0:
            self._first_stamp = stamp
        if (stamp - self._first_stamp) % self._period:
            self.acknowledge_step(message.clock, started)
            return
        timeout = self._timeout()
        if stamp == self._first_stamp:
            timeout = self.parameters.start_timeout
        self._due.append(_Awaited(stamp, started, started + timeout))
        self._wait()

    def _publish_report(self, stamp: int, report: AdcsModuleReport | None) -> None:
        message, newest = AdcsReport(), self._newest
        given: AdcsCanParameters = self.parameters
        message.header.stamp = to_stamp(stamp)
        message.header.frame_id = f"{given.spacecraft}/body"
        message.child_frame_id = given.spacecraft
        message.pulse_step = given.pulse_step
        message.heard = report is not None
        if report is None:
            self._link.counters.missed_reports += 1
            message.period = given.period if stamp != self._first_stamp else 0.0
            message.wheel_speed_rpm = newest.wheel_speed_rpm
            message.wheel_command_rpm = newest.wheel_command_rpm
            message.pulse_steps = self._pulses_accepted
        else:
            message.period = report.period
            message.wheel_speed_rpm = report.wheel_speed_rpm
            message.wheel_command_rpm = report.wheel_command_rpm
            message.pulse_steps = report.pulse_steps
            count = len(report.field_body)
            message.sample_times = list(given.sample_times[:count])
            message.field_body = report.field_body[: len(given.sample_times)].ravel()
        self._newest = message
        self._report_publisher.publish(message)

    # ---- commands ----------------------------------------------------------------------------

    def _on_command(self, message: AdcsCommand) -> None:
        started = time.perf_counter()
        stamp = self._log_stamp = to_nanoseconds(message.header.stamp)
        x, y, z = (int(steps) for steps in message.pulse_steps)
        try:
            self._link.send_command(
                (x, y, z),
                message.wheel_speed_rpm,
                message.mode,
                (message.firing_start_steps, message.firing_steps),
            )
        except ValueError as error:
            self._refused += 1
            self.get_logger().warning(
                f"command refused, rods off, wheel held: {error}", throttle_duration_sec=5.0
            )
            self._publish_actuation(message, None)
            self.acknowledge_step(message.header.stamp, started)
            return
        timeout = self._timeout()
        if self.lockstep and not self._newest.heard:
            # Time stands still in lockstep: what has not reported cannot have come back since, and
            # every wait for it would be wall time that the whole run waits for nothing.
            timeout = 0.0
        self._due.append(_Awaited(stamp, started, started + timeout, message))
        self._wait()

    def _publish_actuation(self, command: AdcsCommand, answer: AdcsAnswer | None) -> None:
        actuation = AdcsCommand(
            header=command.header,
            child_frame_id=command.child_frame_id,
            mode=command.mode,
            reason=command.reason,
            accepted=answer is not None,
            wheel_speed_rpm=self._newest.wheel_speed_rpm,
        )
        if answer is None:
            actuation.reason = "the ADCS module did not answer: rods off, wheel held"
            self._pulses_accepted = (0, 0, 0)
        else:
            actuation.pulse_steps = self._pulses_accepted = answer.pulse_steps
            actuation.wheel_speed_rpm = answer.wheel_speed_rpm
            if answer.fires:
                actuation.firing_start_steps = command.firing_start_steps
                actuation.firing_steps = command.firing_steps
        self._actuation_publisher.publish(actuation)

    # ---- waiting -----------------------------------------------------------------------------

    def _timeout(self) -> float:
        # A module that has gone must not stretch every step to the full wait.
        timeout: float = self.parameters.report_timeout
        return SILENT_TIMEOUT if self._silent else timeout

    def _wait(self) -> None:
        """Wait for what is due, as long as a callback may."""
        while self._due:
            due = self._due[0]
            remaining = min(BLOCKING_WAIT, due.deadline - time.perf_counter())
            if due.command is not None:
                answer = self._link.wait_for_answer(max(remaining, 0.0))
                if answer is None and time.perf_counter() < due.deadline:
                    return
                self._due.pop(0)
                if answer is None:
                    self._link.give_up()
                self._note_silence(answer is None)
                self._publish_actuation(due.command, answer)
                self.acknowledge_step(due.command.header.stamp, due.started)
                continue
            seconds = GpsTime.from_unix_nanoseconds(due.stamp).time_of_week_nanoseconds / 1e9
            report = self._link.wait_for_report(max(remaining, 0.0), seconds)
            if report is None and time.perf_counter() < due.deadline:
                return
            self._due.pop(0)
            self._note_silence(report is None)
            self._publish_report(due.stamp, report)

    def _watch(self) -> None:
        """Go on waiting; without lockstep the module says when a period ends."""
        self._wait()
        if self.lockstep or self._due:
            return
        report = self._link.wait_for_report(0.0)
        if report is not None:
            self._publish_report(self._stamp_of(report), report)

    def _stamp_of(self, report: AdcsModuleReport) -> int:
        """Return the stamp of a report; its frames hold no week, so the clock of the day does."""
        now = self.get_clock().now().nanoseconds
        time_of_week = GpsTime.from_unix_nanoseconds(now).time_of_week_nanoseconds / 1e9
        before = math.remainder(time_of_week - report.time_of_week, 604800.0)
        return round((now / 1e9 - before) * 100.0) * 10_000_000

    def _note_silence(self, is_silent: bool) -> None:
        if is_silent and not self._silent:
            now = time.monotonic()
            if now >= self._silence_logged_at + SILENCE_LOG_INTERVAL:
                self._silence_logged_at = now
                bus = self.parameters.bus_name
                self.get_logger().warning(
                    f"{bus}: nothing from the ADCS module: rods off, wheel held till then"
                )
        self._silent = is_silent

    def _write_to_log(self, frame: can.Message) -> None:
        if self._log is not None:
            self._log.write(frame, self._log_stamp)

    def on_stop(self) -> None:
        """Switch the rods off."""
        if self._link.counters.commands:
            speed = float(np.clip(self._newest.wheel_speed_rpm, -5000.0, 5000.0))
            self._link.send_command((0, 0, 0), speed)
        self._link.close()
        if self._log is not None:
            self._log.close()

    # ---- diagnostics -------------------------------------------------------------------------

    def awaited_inputs(self) -> list[str]:
        """Return the topics without a publisher, and the bus on which no module was heard."""
        if self._link.heard_at is not None:
            return super().awaited_inputs()
        return [*super().awaited_inputs(), f"the ADCS module on {self.parameters.bus_name}"]

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report the link to the module."""
        link = self._link
        state = diagnostics.OK, "connected"
        if link.heard_at is None:
            state = diagnostics.WARN, "nothing heard from the ADCS module yet"
        elif self._silent:
            state = diagnostics.ERROR, "nothing from the ADCS module: rods off, wheel held"
        values = {
            name.replace("_", " "): count
            for name, count in dataclasses.asdict(link.counters).items()
        }
        values |= {"bus errors": link.bus.errors, "commands refused": self._refused}
        subject = f"{self.get_name()}: CAN link"
        return [bus_status(subject, self.parameters, link.bus.problem, state, values)]


NODE_CLASS = AdcsCanNode


def main() -> None:
    """Run the node."""
    run_node(AdcsCanNode)
