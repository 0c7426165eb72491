"""Node `simgen_bridge`: moves the spacecraft, drives SimGEN, and paces the run."""

from __future__ import annotations

import dataclasses
import functools
import math
import pathlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from geometry_msgs.msg import AccelStamped
from rosgraph_msgs.msg import Clock

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_msgs.msg import (
    AdcsCommand,
    AdcsReport,
    AttitudeState,
    OrbitState,
    RelativeState,
    SimulatorStatus,
)
from vtff_node import diagnostics
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import REQUIRED, ParameterError, parameter
from vtff_node.stamps import to_nanoseconds, to_stamp
from vtff_node.step_source import StepSource, StepSourceParameters
from vtff_sim_bridge.attitude import adcs_module
from vtff_sim_bridge.attitude.attitude_motion import attitude_motion
from vtff_sim_bridge.bridge.lateness import Lateness
from vtff_sim_bridge.bridge.simgen_link import SimGenLink
from vtff_sim_bridge.bridge.thrust_buffer import ThrustBuffer
from vtff_sim_bridge.simremote.client import SimRemoteClient, SimRemoteError
from vtff_sim_bridge.simremote.language import DEFAULT_PORT
from vtff_sim_bridge.truth.scenario import Scenario, ScenarioError, load_scenario

START_POLL = 0.05  # s
SETTLE_TIME = 0.5  # s from the moment at which the graph is complete to the start in real time
REALTIME_POLL = 0.002  # s of wall time, shortest wait until a step is looked at
SIMGEN_MARGIN = 60  # s by which the run of SimGEN is longer, so that it takes the last motion
REPLY_SHARE = 0.4  # of a step, within which SimGEN replies in real time or counts as cut off
WATCH_INTERVAL = 0.25  # s of wall time between looks for missing participants


@dataclass(frozen=True)
class SimgenBridgeParameters(StepSourceParameters):
    """Parameters of `simgen_bridge`."""

    scenario_file: str = parameter(REQUIRED, "scenario: orbits, epoch, force model, target")
    duration: float | None = parameter(
        None, "length of the run; without it as the scenario says", unit="s"
    )
    seed: int = parameter(-1, "seed of the run, -1 = as the scenario says")
    integrator: str = parameter(
        "scenario", "integrator of the truth", choices=("scenario", "rk4", "euler")
    )
    simgen_host: str = parameter("127.0.0.1", "address of SimGEN; empty runs without it")
    simgen_port: int = parameter(DEFAULT_PORT, "TCP port of SimREMOTE", minimum=1, maximum=65535)
    simgen_scenario: str = parameter(
        "", "SimGEN scenario file to select (SC), empty = <name of the scenario>.scn"
    )
    simgen_timeout: float = parameter(2.0, "longest wait for a reply", unit="s", minimum=0.01)
    simgen_reconnect_timeout: float = parameter(
        10.0, "in lockstep, longest wait for a lost connection to SimGEN", unit="s", minimum=0.1
    )
    simgen_steps_together: int = parameter(
        1,
        "in lockstep, steps whose motion SimGEN gets in one packet; 1 where it has receivers",
        minimum=1,
        maximum=100,
    )
    lockstep_preparing: list[str] = parameter(
        [], "fully qualified nodes that must report ready before the run starts, in any pacing"
    )
    max_lag: float = parameter(
        2.0,
        "in real time, steps that the run may be late before it stops; 0 = no limit",
        minimum=0.0,
    )
    coasting: list[str] = parameter(
        [], "deputies without a thruster: no step waits for their thrust"
    )
    turning_free: list[str] = parameter(
        [], "spacecraft with an attitude in the scenario and without a controller of it"
    )
    chief_thrusts: bool = parameter(
        False, "the chief has a thruster too: each step waits for its thrust"
    )
    number_of_deputies: int = parameter(
        0,
        "deputies that the scenario's entry with 'repeat' makes, 0 = as the scenario says",
        minimum=0,
    )


class SimgenBridgeNode(VtffNode):
    """Truth of all spacecraft, client of SimREMOTE, and the step source of a simulated run.

    Publishes /clock, <craft>/truth/orbit, <deputy>/relative_state_truth and sim/status once a
    step; subscribes to <deputy>/propulsion/thrust_applied and /sim/step_done. A spacecraft whose
    thrusters are fixed in its body flies <deputy>/propulsion/thrust_body instead, along the axes of
    its true attitude, which that thrust turns. Of spacecraft with an attitude it publishes
    <craft>/truth/attitude and, at the end of each period of the ADCS, the
    <craft>/adcs/module_report, and takes <craft>/adcs/actuation. With lockstep:=true
    a step begins when every participant has finished the step before; otherwise the wall clock
    begins the steps and the newest thrust is used.
    """

    Parameters = SimgenBridgeParameters

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("simgen_bridge", **node_arguments)
        given: SimgenBridgeParameters = self.parameters
        self._scenario = _scenario_in_force(given)
        self._truth = self._scenario.formation_truth()
        self._steps = round(self._scenario.duration / self._scenario.step)
        for name in given.coasting:
            if name not in self._truth.deputies:
                raise ParameterError(
                    f"parameter 'coasting': there is no deputy {name!r}; the scenario has "
                    f"{', '.join(self._truth.deputies)}"
                )
        self._thrust = {
            name: ThrustBuffer(self._scenario.step)
            for name in self._truth.names[0 if given.chief_thrusts else 1 :]
            if name not in given.coasting
        }
        self._attitudes = self._scenario.attitude_truths()
        for name in given.turning_free:
            if name not in self._attitudes:
                raise ParameterError(
                    f"parameter 'turning_free': no spacecraft {name!r} has an attitude in the "
                    "scenario"
                )
        self._thrusts_along_body = {
            name
            for name, attitude in self._attitudes.items()
            if attitude.setting.propulsion is not None
        }
        self._actuations: dict[str, dict[int, AdcsCommand]] = {
            name: {} for name in self._attitudes if name not in given.turning_free
        }
        self._simgen = self._make_link(given)
        self._thrust_in_force: dict[str, np.ndarray] = {}
        self._state = SimulatorStatus.STATE_IDLE
        self._refused_thrust = 0
        self._started = False
        self._ready_since: float | None = None
        self._wall_start = 0.0
        self._wall_lag = 0.0
        self._lateness = Lateness(self._scenario.step, given.max_lag)
        self._create_interfaces()
        self._made = time.monotonic()
        self._start_timer = self.create_timer(START_POLL, self._start, clock=self.steady_clock)

    def warm_up(self) -> None:
        """Fly another truth of the same scenario for a step."""
        scenario = _scenario_in_force(self.parameters)
        truth = scenario.formation_truth()
        for name in truth.names:
            truth.motion_itrf(name, np.zeros(3))
        truth.advance()
        for name, attitude in scenario.attitude_truths().items():
            attitude.begin_period(None)
            attitude.advance(truth.state_gcrf(name), None)

    def _create_interfaces(self) -> None:
        self._clock_publisher = self.publisher(Clock, "/clock")
        self._clock_message = Clock()
        self._orbit_messages: dict[str, tuple[Any, OrbitState]] = {}
        for name in self._truth.names:
            message = OrbitState(child_frame_id=name, source=OrbitState.SOURCE_TRUTH)
            message.header.frame_id = "gcrf"
            self._orbit_messages[name] = (
                self.publisher(OrbitState, f"{name}/truth/orbit"),
                message,
            )
        self._relative_messages: dict[str, tuple[Any, RelativeState]] = {}
        for name in self._truth.deputies:
            relative = RelativeState(child_frame_id=name, solution=RelativeState.SOLUTION_TRUTH)
            relative.header.frame_id = f"{self._truth.chief}/rtn"
            publisher = self.publisher(RelativeState, f"{name}/relative_state_truth")
            self._relative_messages[name] = (publisher, relative)
        self._attitude_messages: dict[str, tuple[Any, AttitudeState]] = {}
        self._report_messages: dict[str, tuple[Any, AdcsReport]] = {}
        for name, attitude in self._attitudes.items():
            state = AttitudeState(child_frame_id=name, source=AttitudeState.SOURCE_TRUTH)
            state.header.frame_id = "gcrf"
            state.valid = state.wheel_follows = state.field_valid = True
            state.normalised_innovation_squared = math.nan
            state.correction = np.full(3, math.nan)
            self._attitude_messages[name] = (
                self.publisher(AttitudeState, f"{name}/truth/attitude"),
                state,
            )
            report = AdcsReport(child_frame_id=name, heard=True)
            report.header.frame_id = f"{name}/body"
            report.pulse_step = attitude.setting.module.pulse_step
            report.sample_times = list(attitude.setting.module.sample_times)
            self._report_messages[name] = (
                self.publisher(AdcsReport, f"{name}/adcs/module_report"),
                report,
            )
        for name in self._actuations:
            self.subscribe(
                AdcsCommand, f"{name}/adcs/actuation", functools.partial(self._on_actuation, name)
            )
        self._status_publisher = self.publisher(SimulatorStatus, "sim/status")
        self._status = SimulatorStatus(
            scenario=self._scenario.name,
            duration=float(self._scenario.duration),
            pacing=(
                SimulatorStatus.PACING_LOCKSTEP
                if self.lockstep
                else SimulatorStatus.PACING_REALTIME
            ),
        )
        for name in self._thrust:
            self.subscribe(
                AccelStamped, self._thrust_topic(name), functools.partial(self._on_thrust, name)
            )
        self._step_source = StepSource(
            self,
            self.parameters,
            self._advance_when_complete,
            awaited_data=self._awaited_data,
            preparing=self.parameters.lockstep_preparing,
        )

    def _thrust_topic(self, name: str) -> str:
        """Return the topic of the thrust that a spacecraft flies."""
        of_body = name in self._thrusts_along_body
        return f"{name}/propulsion/{'thrust_body' if of_body else 'thrust_applied'}"

    def begin(self) -> None:
        """Say that this node begins, and wait for the others from now on.

        To make the other nodes of this process may have taken minutes: a first run compiles.
        """
        self._made = time.monotonic()
        super().begin()

    def _start(self) -> None:
        # A timer that has expired twice calls back twice, even when the first call cancels it.
        if self._started or not self._graph_is_ready():
            return
        self._started = True
        self._start_timer.cancel()
        self._wall_start = time.monotonic()
        if not self._prepare_simgen():
            return
        self._state = SimulatorStatus.STATE_RUNNING
        self._watch_timer = self.create_timer(WATCH_INTERVAL, self._watch, clock=self.steady_clock)
        if not self.lockstep:
            self._pace_timer = self.create_timer(REALTIME_POLL, self._pace, clock=self.steady_clock)
        self._publish_step()

    def _graph_is_ready(self) -> bool:
        """Return whether the run may start.

        Signals that come before a receiver is configured are lost, so the run waits for the nodes
        that prepare, and for all others to be there, which have warmed up then.
        """
        if self.count_publishers("/clock") > 1:
            self.fail(
                "another simulator publishes /clock on this ROS_DOMAIN_ID; give each run its own"
            )
            return False
        now = time.monotonic()
        if self._step_source.unprepared:
            if now - self._made > self.parameters.start_timeout:
                nodes = self._step_source.describe_unprepared_nodes()
                self.fail(f"the run did not start: {nodes}")
            return False
        absent = self.unready_nodes(self.parameters.expected_nodes)
        silent = [
            f"/{self._thrust_topic(name)}"
            for name in self._thrust
            if not self.count_publishers(self._thrust_topic(name))
        ]
        if not absent and not silent:
            # The nodes discover each other a moment after this node has discovered all of them;
            # lockstep waits for them.
            self._ready_since = self._ready_since or now
            return self.lockstep or now - self._ready_since > SETTLE_TIME
        if now - self._made > self.parameters.start_timeout:
            missing = ", ".join([*absent, *silent])
            self.fail(f"the run did not start: not in the graph: {missing}")
        return False

    def _make_link(self, given: SimgenBridgeParameters) -> SimGenLink | None:
        if not given.simgen_host:
            return None
        client = SimRemoteClient(given.simgen_host, given.simgen_port, given.simgen_timeout)
        return SimGenLink(
            client,
            self._truth.names,
            reconnect_timeout=given.simgen_reconnect_timeout if self.lockstep else None,
            patience_while_running=None if self.lockstep else REPLY_SHARE * self._scenario.step,
            steps_together=given.simgen_steps_together if self.lockstep else 1,
        )

    def _prepare_simgen(self) -> bool:
        if self._simgen is None:
            return True
        try:
            self._simgen.start(
                self.parameters.simgen_scenario or f"{self._scenario.name}.scn",
                self._scenario.epoch,
                math.ceil(self._scenario.duration) + SIMGEN_MARGIN,
                self._motions_of_now()(),
            )
            if not self.lockstep:
                self._wall_start = time.monotonic() - self._simgen.time_into_run()
        except (SimRemoteError, ValueError) as error:
            self.fail(str(error))
            return False
        return True

    # ---- steps -------------------------------------------------------------------------------

    def _publish_step(self) -> None:
        """Send the motion of the current time to SimGEN and publish its truth."""
        stamp_nanoseconds = self._truth.time.to_unix_nanoseconds()
        stamp = to_stamp(stamp_nanoseconds)
        self.scenario_nanoseconds = stamp_nanoseconds
        self._step_source.begin(stamp_nanoseconds)
        self._thrust_in_force = self._thrust_now(stamp_nanoseconds)
        self._receive_replies()
        self._send_motion()
        if self._state == SimulatorStatus.STATE_ERROR:
            return
        # The truth does not depend on SimGEN: it is published while SimGEN works.
        self._publish_orbits(stamp)
        self._publish_attitudes(stamp)
        if self.lockstep:
            # SimGEN replies when the bytes of this step are on the ports of the receivers. With
            # /clock after that, a driver never takes a slow emulator for a silent receiver.
            self._receive_replies()
        if self._state == SimulatorStatus.STATE_ERROR:
            return
        self._clock_message.clock = stamp
        self._clock_publisher.publish(self._clock_message)
        self._publish_status(stamp)
        self._show_progress()

    def _publish_orbits(self, stamp: Any) -> None:
        """Publish the true orbits and relative states."""
        for name, (publisher, message) in self._orbit_messages.items():
            state = self._truth.state_gcrf(name)
            message.header.stamp = stamp
            message.position = state[:3]
            message.velocity = state[3:]
            publisher.publish(message)
        state_chief = self._truth.state_gcrf(self._truth.chief)
        for name, (publisher, relative) in self._relative_messages.items():
            relative_state = self._truth.relative_state_rtn(name)
            relative.header.stamp = stamp
            relative.position = relative_state[:3]
            relative.velocity = relative_state[3:]
            relative.position_chief_gcrf = state_chief[:3]
            relative.velocity_chief_gcrf = state_chief[3:]
            publisher.publish(relative)

    def _publish_attitudes(self, stamp: Any) -> None:
        """Publish true attitudes, and reports of the modules whose period has ended."""
        for name, attitude in self._attitudes.items():
            publisher, message = self._attitude_messages[name]
            state = attitude.state
            message.header.stamp = stamp
            message.quaternion = state.quaternion_gcrf
            message.rate_body = state.rate_body
            message.dipole = attitude.dipole
            message.wheel_speed_rpm = attitude.wheel_speed_rpm
            orbit = self._truth.state_gcrf(name)
            message.position_gcrf, message.velocity_gcrf = orbit[:3], orbit[3:]
            publisher.publish(message)
            if not attitude.begins_period:
                continue
            publisher, message = self._report_messages[name]
            report = attitude.report
            message.header.stamp = stamp
            message.period = attitude.period_done
            message.pulse_steps = report.pulse_steps
            message.wheel_command_rpm = float(report.wheel_command_rpm)
            message.wheel_speed_rpm = report.wheel_speed_rpm
            message.field_body = report.field_body.ravel()
            publisher.publish(message)

    def _begin_periods(self) -> None:
        """Hand on the commands of the periods that begin now."""
        for name, attitude in self._attitudes.items():
            if not attitude.begins_period:
                continue
            of_name = self._actuations.get(name, {})
            message = of_name.get(self.scenario_nanoseconds)
            for stamp in [stamp for stamp in of_name if stamp <= self.scenario_nanoseconds]:
                del of_name[stamp]
            if message is None or not message.accepted:
                attitude.begin_period(None)
                continue
            pulse_step = attitude.setting.module.pulse_step
            x, y, z = (int(steps) for steps in message.pulse_steps)
            attitude.begin_period(
                adcs_module.AdcsCommand((x, y, z), message.wheel_speed_rpm),
                pulse_step * message.firing_start_steps,
                pulse_step * message.firing_steps,
            )

    def _on_actuation(self, name: str, message: AdcsCommand) -> None:
        if not math.isfinite(message.wheel_speed_rpm):
            self.get_logger().warning(
                f"actuation of {name} is not finite: none is applied", throttle_duration_sec=5.0
            )
            message.accepted = False
        self._actuations[name][to_nanoseconds(message.header.stamp)] = message
        if self.lockstep:
            self._advance_when_complete()

    def _advance(self) -> None:
        """Integrate one step with the thrust that starts now, then publish the next step."""
        if self._step_source.step >= self._steps:
            self._end()
            return
        if self.lockstep:
            # All thrust of the step has arrived by now, also that of a thruster without delay.
            self._thrust_in_force = self._thrust_now(self.scenario_nanoseconds)
        self._begin_periods()
        thrusters = {
            name: self._truth.accelerations_of_thrusters(name, self._thrust_in_force[name])
            for name in self._thrusts_along_body & self._thrust_in_force.keys()
        }
        self._truth.advance(self._thrust_in_force, self._body_rotations())
        for name, attitude in self._attitudes.items():
            attitude.advance(self._truth.state_gcrf(name), thrusters.get(name))
        self._publish_step()

    def _body_rotations(self) -> dict[str, np.ndarray]:
        """Return the rotations from the body to GCRF of spacecraft that thrust along its axes."""
        return {
            name: self._attitudes[name].state.rotation_gcrf_from_body
            for name in self._thrusts_along_body
        }

    def _thrust_now(self, stamp_nanoseconds: int) -> dict[str, np.ndarray]:
        applied = {}
        for name, buffer in self._thrust.items():
            was_stale = buffer.is_stale
            thrust = buffer.starting_at(stamp_nanoseconds, exactly=self.lockstep)
            if buffer.is_stale and not was_stale:
                self.get_logger().warning(f"no new thrust of {name}: none is applied")
            if thrust is not None:
                applied[name] = thrust
        return applied

    def _on_thrust(self, name: str, message: AccelStamped) -> None:
        linear = message.accel.linear
        acceleration = linear.x, linear.y, linear.z
        if not all(map(math.isfinite, acceleration)):
            self._refused_thrust += 1
            self.get_logger().warning(
                f"thrust of {name} is not finite: none is applied", throttle_duration_sec=5.0
            )
            acceleration = 0.0, 0.0, 0.0
        self._thrust[name].add(to_nanoseconds(message.header.stamp), acceleration)
        if self.lockstep:
            self._advance_when_complete()

    def _awaited_data(self) -> Iterator[str]:
        """Yield the topics on which data of the current step have not come yet.

        Topics are not ordered among each other: an acknowledgement may overtake the data.
        """
        step = self._step_source.step
        for name, buffer in self._thrust.items():
            if buffer.received <= step:
                yield f"thrust on /{self._thrust_topic(name)}"
        for name, actuations in self._actuations.items():
            if self._attitudes[name].begins_period and self.scenario_nanoseconds not in actuations:
                yield f"actuation on /{name}/adcs/actuation"

    def _advance_when_complete(self) -> None:
        if self._state == SimulatorStatus.STATE_RUNNING:
            self._step_source.advance(self._advance)

    def _pace(self) -> None:
        if self._state != SimulatorStatus.STATE_RUNNING:
            return
        due = self._wall_start + (self._step_source.step + 1) * self._scenario.step
        now = time.monotonic()
        if now < due:
            self._pace_again(due)
            return
        step = self._step_source.step + 1
        self._wall_lag = now - due
        begins_late = self._lateness.note(self._wall_lag)
        if self._lateness.exceeds_limit(self._wall_lag):
            self.fail(
                f"step {step} began {self._wall_lag:.1f} s late, more than max_lag "
                f"({self.parameters.max_lag:g} steps): the run stops, with zero thrust"
            )
            return
        if begins_late:
            self.get_logger().warning(f"step {step} began {self._wall_lag:.1f} s late")
        self._advance()
        self._pace_again(due + self._scenario.step)

    def _pace_again(self, due: float) -> None:
        """Have the next step looked at when it is due, in s of the monotonic clock."""
        wait = max(due - time.monotonic(), REALTIME_POLL)
        self._pace_timer.timer_period_ns = round(wait * NANOSECONDS_PER_SECOND)
        self._pace_timer.reset()

    def _end(self) -> None:
        self._complete_simgen()
        if self._state == SimulatorStatus.STATE_ERROR:
            return
        self._state = SimulatorStatus.STATE_ENDED
        self._publish_status(to_stamp(self.scenario_nanoseconds))
        self.finish()

    # ---- SimGEN ------------------------------------------------------------------------------

    def _motions_of_now(self) -> Callable[[], dict[str, np.ndarray]]:
        """Return a function that computes the motion of each spacecraft at this step, also later.

        It has the attitude of those that have one.
        """
        orbit_motions = self._truth.motions_of_now(self._thrust_in_force, self._body_rotations())
        turning = {
            name: attitude_motion(
                self._truth.time,
                self._truth.state_gcrf(name),
                attitude.state.quaternion_gcrf,
                attitude.state.rate_body,
            )
            for name, attitude in self._attitudes.items()
        }

        def compute() -> dict[str, np.ndarray]:
            motions = orbit_motions()
            for name, of_attitude in turning.items():
                motions[name] = np.concatenate((motions[name], of_attitude))
            return motions

        return compute

    def _send_motion(self) -> None:
        if self._simgen is None:
            return
        try:
            self._simgen.send(self._time_into_run(), self._motions_of_now())
        except SimRemoteError as error:
            self.fail(str(error))

    def _receive_replies(self) -> None:
        """Take the replies of SimGEN, and wait for those that have not come yet."""
        if self._simgen is None or self._state == SimulatorStatus.STATE_ERROR:
            return
        try:
            self._simgen.receive()
        except SimRemoteError as error:
            self.fail(str(error))

    def _complete_simgen(self) -> None:
        """Give SimGEN the motion of the last steps and take its replies."""
        if self._simgen is None:
            return
        try:
            self._simgen.complete()
        except SimRemoteError as error:
            self.fail(str(error))

    def on_stop(self) -> None:
        """End the SimGEN run, so that the simulator is ready for the next one."""
        if self._simgen is None:
            return
        try:
            self._simgen.stop()
        except SimRemoteError as error:
            self.get_logger().warning(f"SimGEN did not end the run: {error}")

    # ---- reports -----------------------------------------------------------------------------

    def _time_into_run(self) -> float:
        return self._truth.time - self._scenario.epoch

    def _publish_status(self, stamp: Any) -> None:
        elapsed = time.monotonic() - self._wall_start
        status = self._status
        status.header.stamp = stamp
        status.state = self._state
        status.step = max(0, self._step_source.step)
        status.time_into_run = time_into_run = self._time_into_run()
        status.late_commands = sum(buffer.late for buffer in self._thrust.values())
        status.real_time_factor = time_into_run / elapsed if elapsed > 0.0 else 0.0
        status.wall_lag = self._wall_lag
        status.message = self.problem or (self._simgen.problem if self._simgen else "")
        self._status_publisher.publish(status)

    def _show_progress(self, *, urgent: bool = False) -> None:
        is_last = self._step_source.step >= self._steps
        if not (urgent or is_last or self.is_progress_due()):
            return
        separations = {
            name: float(message.position[1])
            for name, (_, message) in self._relative_messages.items()
        }
        lateness = {"late_steps": self._lateness.late_steps, "largest_lag": self._lateness.largest}
        self.report_progress(
            self._time_into_run(),
            self._scenario.duration,
            urgent=urgent,
            in_track=separations,
            **({} if self.lockstep else lateness),
        )

    def _watch(self) -> None:
        """Go on if nothing is awaited; fail when a step of lockstep is not finished in time."""
        if not self.lockstep or self._state != SimulatorStatus.STATE_RUNNING:
            return
        self._advance_when_complete()
        problem = self._step_source.describe_hanging_step()
        if problem:
            self.fail(problem)

    def fail(self, problem: str) -> None:
        """End the run with a failure; sim/status gives the reason."""
        self._state = SimulatorStatus.STATE_ERROR
        super().fail(problem)
        self._publish_status(to_stamp(self._truth.time.to_unix_nanoseconds()))
        self._show_progress(urgent=True)

    def awaited_inputs(self) -> list[str]:
        """Return what the run waits for before it starts."""
        if self._started:
            return []
        unprepared = [f"{name} to be ready" for name in sorted(self._step_source.unprepared)]
        absent = self.unready_nodes(self.parameters.expected_nodes)
        return [*super().awaited_inputs(), *unprepared, *(f"node {name}" for name in absent)]

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report pacing, the SimGEN connection and late commands."""
        values: dict[str, Any] = {
            "step": self._step_source.step,
            "of": self._steps,
            "late commands": sum(buffer.late for buffer in self._thrust.values()),
            "thrust refused": self._refused_thrust,
        }
        level, text = diagnostics.OK, "running"
        stale = [name for name, buffer in self._thrust.items() if buffer.is_stale]
        if not self.lockstep:
            values["late steps"] = self._lateness.late_steps
            values["largest lag (s)"] = round(self._lateness.largest, 3)
        if self._lateness.is_late:
            level, text = diagnostics.WARN, f"{self._wall_lag:.1f} s late"
        elif stale:
            level, text = diagnostics.WARN, f"no new thrust of {', '.join(stale)}: none is applied"
        if self._simgen is not None:
            values.update(dataclasses.asdict(self._simgen.counters))
            if self._simgen.problem:
                level, text = diagnostics.WARN, self._simgen.problem
        if self.problem:
            level, text = diagnostics.ERROR, self.problem
        return [
            diagnostics.status(
                "simgen_bridge: run",
                level,
                text,
                values,
                hardware_id=f"{self.parameters.simgen_host}:{self.parameters.simgen_port}",
            )
        ]


def _scenario_in_force(given: SimgenBridgeParameters) -> Scenario:
    """Load the scenario and let the parameters replace what they name."""
    try:
        scenario = load_scenario(
            pathlib.Path(given.scenario_file),
            given.seed if given.seed >= 0 else None,
            given.number_of_deputies,
        )
    except ScenarioError as error:
        raise ParameterError(str(error)) from error
    changes: dict[str, Any] = {}
    if given.duration is not None:
        changes["duration"] = given.duration
    if given.integrator != "scenario":
        changes["integrator"] = given.integrator
    try:
        scenario = dataclasses.replace(scenario, **changes)
    except ValueError as error:
        raise ParameterError(f"parameter {', '.join(changes)}: {error}") from error
    last: GpsTime = scenario.epoch + scenario.duration
    to_stamp(last.to_unix_nanoseconds())  # refuses scenarios that a ROS stamp cannot hold
    return scenario


NODE_CLASS = SimgenBridgeNode


def main() -> None:
    """Run the node."""
    run_node(SimgenBridgeNode)
