"""Node `thruster_can`: a thruster on a CAN bus."""

from __future__ import annotations

import dataclasses
import math
import time
from dataclasses import dataclass

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import AccelStamped

from vtff_control.thruster.can_frames import MODE_OFF, MODE_THRUST, ThrusterFrames, ThrustReport
from vtff_control.thruster.can_thruster import ThrusterLink
from vtff_control.thruster.isolation import isolated_axes, isolated_text
from vtff_control.thruster.late_commands import LateCommands
from vtff_control.thruster.thruster import AppliedThrust, Thruster
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_msgs.msg import ThrusterIsolation
from vtff_node import diagnostics
from vtff_node.can_bus.node_bus import (
    CanBusParameters,
    bus_status,
    connect_first,
    read_database,
)
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import parameter
from vtff_node.stamps import StampOrder, to_nanoseconds, to_stamp
from vtff_node.step_moments import COMMAND_SENT, StepMoments

# All times in s of wall time.
BLOCKING_WAIT = 0.1  # in a callback; a report that takes longer is waited for between callbacks
WATCH_INTERVAL = 0.25  # between looks at the open command, the watchdog and heartbeats
SILENT_AFTER = 3.0  # without a frame of the thruster
SILENCE_LOG_INTERVAL = 10.0  # from one line on a silence to the next: a bus may come and go
SILENT_TIMEOUT = 0.2  # for the report of a thruster that did not answer the command before


@dataclass(frozen=True)
class ThrusterCanParameters(CanBusParameters):
    """Parameters of `thruster_can`."""

    channel: str = parameter("239.74.163.2", "bus of that interface, as can0 or a multicast group")
    delay_steps: int = parameter(
        1, "whole steps between a command's stamp and its start", minimum=0, maximum=100
    )
    step: float = parameter(1.0, "length of a step", unit="s", minimum=0.001)
    watchdog_timeout: float = parameter(
        2.0, "time without a command after which there is no thrust", unit="s", minimum=0.001
    )
    report_timeout: float = parameter(
        4.0,
        "longest wait for a report (wall time); in real time at most half a step",
        unit="s",
        minimum=0.001,
    )
    start_timeout: float = parameter(
        20.0, "the same for the first command in lockstep (wall time)", unit="s", minimum=0.001
    )


@dataclass(frozen=True)
class OpenCommand:
    """A command whose report has not come.

    Attributes
    ----------
    thrust
        What was sent.
    stamp
        Stamp of the step to acknowledge, None for a command of the watchdog.
    started, deadline
        ``time.perf_counter()`` at the start of the work on it, and when to give it up.
    """

    thrust: AppliedThrust
    stamp: Time | None
    started: float
    deadline: float


class ThrusterCanNode(VtffNode):
    """Thruster of one spacecraft on its CAN bus, run in its namespace.

    Subscribes to control/thrust_command, sends each command over the bus, and publishes what the
    thruster reports on propulsion/thrust_applied (both geometry_msgs/AccelStamped, m/s^2 in
    chief/rtn). The stamp of thrust_applied is the time at which the thrust starts; it acts for
    one step. Cap and quantum are the thruster's own. A step is acknowledged when the report has
    come; a command without a report, and a missing command, mean zero thrust. In real time a
    command whose step is over when it comes is refused.
    """

    Parameters = ThrusterCanParameters

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("thruster", **node_arguments)
        given: ThrusterCanParameters = self.parameters
        frames = read_database(ThrusterFrames, given.dbc_file)
        # Limits and rounds to what a frame can hold; the thruster itself is on the bus.
        self._scheduler = Thruster(
            frames.largest_acceleration, frames.resolution, given.delay_steps, given.step
        )
        self._link = ThrusterLink(frames, given.open_bus)
        connect_first(self._link.connect)
        self._watchdog = round(given.watchdog_timeout * NANOSECONDS_PER_SECOND)
        self._applied = AccelStamped()
        self._counts = {"saturated": 0, "refused": 0, "out of order": 0, "too late": 0}
        self._counts["watchdog trips"] = 0
        self._reason = ""
        self._open: OpenCommand | None = None
        self._isolated = isolated_axes(0)
        self._silent = False
        self._silence_logged = False
        self._silence_logged_at = -math.inf
        self._tripped = False
        self._order = StampOrder()
        self._commands_sent = StepMoments()
        # After its step a command could only act in place of a newer one.
        self._late_commands = LateCommands((given.delay_steps + 1) * given.step)
        self._last_stamp = -1
        self._last_start = -1
        self._last_command_at = 0.0
        self._publisher = self.publisher(AccelStamped, "propulsion/thrust_applied")
        self.subscribe(AccelStamped, "control/thrust_command", self._on_command)
        # formation_safety sends isolations; without that node nothing is ever isolated.
        self.subscribe(
            ThrusterIsolation,
            "propulsion/isolation",
            self._on_isolation,
            latched=True,
            required=False,
        )
        self.create_timer(WATCH_INTERVAL, self._watch, clock=self.steady_clock)

    def _on_isolation(self, message: ThrusterIsolation) -> None:
        """Pass an isolation command on to the bus."""
        self._isolated = isolated_axes(message.axes)
        self._link.isolate(self._isolated)

    def _on_command(self, message: AccelStamped) -> None:
        started = time.perf_counter()
        stamp = to_nanoseconds(message.header.stamp)
        if not self._order.accepts(stamp):
            self._counts["out of order"] = self._order.refused
            return
        if not self.lockstep and self._late_commands.is_too_late(stamp):
            self._counts["too late"] = self._late_commands.refused
            return
        if self.lockstep and 0 <= self._last_stamp < stamp - self._watchdog:
            # There is nothing to cut: a thrust acts for one step only.
            self._counts["watchdog trips"] += 1
        self._last_stamp = stamp
        self._last_command_at = time.monotonic()
        self._tripped = False
        wanted = message.accel.linear
        thrust = self._scheduler.command(stamp, (wanted.x, wanted.y, wanted.z))
        self._counts["refused"] += bool(thrust.reason)
        self._applied.header.frame_id = message.header.frame_id
        mode = MODE_OFF if thrust.reason else MODE_THRUST
        self._send(thrust, mode, message.header.stamp, started)
        if not self.lockstep:
            self._commands_sent.note(stamp)
        self._wait_for_report()

    def _send(self, thrust: AppliedThrust, mode: int, stamp: Time | None, started: float) -> None:
        """Send a command; one that is still open ends without a report."""
        if self._open is not None:
            self._end_without_report(self._open)
        self._last_start = thrust.start_stamp
        self._link.send_command(
            GpsTime.from_unix_nanoseconds(thrust.start_stamp), thrust.acceleration_rtn, mode
        )
        deadline = time.perf_counter() + self._report_timeout()
        self._open = OpenCommand(thrust, stamp, started, deadline)

    def _wait_for_report(self) -> None:
        """Wait for the report of the open command as long as a callback may."""
        command = self._open
        assert command is not None
        remaining = command.deadline - time.perf_counter()
        report = self._link.wait_for_report(min(BLOCKING_WAIT, remaining))
        if report is not None:
            self._end_with_report(command, report)
        elif time.perf_counter() >= command.deadline:
            self._end_without_report(command)

    def _end_with_report(self, command: OpenCommand, report: ThrustReport) -> None:
        if self._silent:
            self._silent = False
            self._log_end_of_silence()
        self._counts["saturated"] += report.saturated or command.thrust.saturated
        refusal = "the thruster refused a command" if report.fault else ""
        self._reason = command.thrust.reason or refusal
        self._end(command, report.acceleration_rtn)

    def _end_without_report(self, command: OpenCommand) -> None:
        self._link.give_up()
        if not self._silent:
            self._silent = True
            self._log_silence()
        self._reason = "no report from the thruster"
        self._end(command, np.zeros(3))

    def _log_silence(self) -> None:
        now = time.monotonic()
        self._silence_logged = now >= self._silence_logged_at + SILENCE_LOG_INTERVAL
        if self._silence_logged:
            self._silence_logged_at = now
            bus = self.parameters.bus_name
            self.get_logger().warning(f"{bus}: no report from the thruster: zero thrust till then")

    def _log_end_of_silence(self) -> None:
        if self._silence_logged:
            timeouts = self._link.counters.timeouts
            self.get_logger().warning(
                f"the thruster reports again; {timeouts} commands of this run had no report"
            )

    def _end(self, command: OpenCommand, acceleration_rtn: FloatArray) -> None:
        """Publish the thrust of a command and acknowledge its step."""
        self._open = None
        linear = self._applied.accel.linear
        linear.x, linear.y, linear.z = acceleration_rtn.tolist()
        self._applied.header.stamp = to_stamp(command.thrust.start_stamp)
        self._publisher.publish(self._applied)
        if command.stamp is not None:
            self.acknowledge_step(command.stamp, command.started)

    def _report_timeout(self) -> float:
        given: ThrusterCanParameters = self.parameters
        if not self.lockstep:
            return min(given.report_timeout, 0.5 * given.step)
        if self._link.counters.commands == 1:
            return given.start_timeout
        # A thruster that has gone must not stretch every step to the full wait.
        return SILENT_TIMEOUT if self._silent else given.report_timeout

    def _watch(self) -> None:
        """Go on waiting, take heartbeats, and guard the commands in real time."""
        if self._open is not None:
            self._wait_for_report()
            return
        self._link.poll()
        if self.lockstep or self._tripped or self._last_stamp < 0:
            return
        elapsed = time.monotonic() - self._last_command_at
        if elapsed >= self.parameters.watchdog_timeout:
            self._trip(elapsed)

    def _trip(self, elapsed: float) -> None:
        """Switch the thruster off: there has been no command for too long."""
        self._tripped = True
        self._counts["watchdog trips"] += 1
        step = round(self.parameters.step * NANOSECONDS_PER_SECOND)
        # From the next step on, and never in place of a thrust that has been published.
        next_step = self._last_stamp + math.ceil(elapsed / self.parameters.step) * step
        start_stamp = max(next_step, self._last_start + step)
        self._send(
            AppliedThrust(start_stamp, np.zeros(3), False), MODE_OFF, None, time.perf_counter()
        )
        self._wait_for_report()

    def on_stop(self) -> None:
        """Switch the thruster off."""
        if self._last_start >= 0:
            self._link.send_command(
                GpsTime.from_unix_nanoseconds(self._last_start), np.zeros(3), MODE_OFF
            )
        self._link.close()

    # ---- diagnostics -------------------------------------------------------------------------

    def awaited_inputs(self) -> list[str]:
        """Return the topics without a publisher, and the bus on which no thruster was heard."""
        if self._link.heard_at is not None:
            return super().awaited_inputs()
        return [*super().awaited_inputs(), f"the thruster on {self.parameters.bus_name}"]

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report thrust, link and the thruster's own state."""
        return [self._thrust_health(), self._link_health()]

    def _thrust_health(self) -> diagnostics.DiagnosticStatus:
        level, text = diagnostics.OK, "thrusting"
        if self._last_stamp < 0:
            text = "no command yet"
        elif self._reason:
            level, text = diagnostics.WARN, f"zero thrust: {self._reason}"
        elif self._isolated.any():
            level, text = diagnostics.WARN, f"axes isolated: {isolated_text(self._isolated)}"
        elif self._tripped:
            limit = self.parameters.watchdog_timeout
            level, text = diagnostics.WARN, f"zero thrust: no command for more than {limit:g} s"
        return diagnostics.status(
            f"{self.get_name()}: thrust",
            level,
            text,
            {
                "commands": self._link.counters.commands,
                **self._counts,
                **self._commands_sent.values(COMMAND_SENT),
            },
            hardware_id=self.get_namespace().strip("/"),
        )

    def _link_health(self) -> diagnostics.DiagnosticStatus:
        link, heartbeat = self._link, self._link.heartbeat
        state = diagnostics.OK, "connected"
        if link.heard_at is None:
            state = diagnostics.WARN, "nothing heard from the thruster yet"
        elif (silence := time.monotonic() - link.heard_at) > SILENT_AFTER:
            state = diagnostics.ERROR, f"nothing heard from the thruster for {silence:.0f} s"
        values = {
            name.replace("_", " "): count
            for name, count in dataclasses.asdict(link.counters).items()
        }
        values["thruster watchdog trips"] = link.watchdog_trips
        if heartbeat is not None:
            values |= {
                "thruster state": heartbeat.state,
                "thruster uptime (s)": heartbeat.uptime,
                "thruster rejected frames": heartbeat.rejected_frames,
                "thruster sequence gaps": heartbeat.sequence_gaps,
            }
        subject = f"{self.get_name()}: CAN link"
        return bus_status(subject, self.parameters, link.problem, state, values)


NODE_CLASS = ThrusterCanNode


def main() -> None:
    """Run the node."""
    run_node(ThrusterCanNode)
