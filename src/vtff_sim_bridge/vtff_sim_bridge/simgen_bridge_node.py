"""Node `simgen_bridge`: moves the spacecraft, drives SimGEN, and paces the run."""

from __future__ import annotations

import dataclasses
import functools
import math
import pathlib
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from geometry_msgs.msg import AccelStamped
from rosgraph_msgs.msg import Clock

from vtff_dynamics.time.timescales import GpsTime
from vtff_msgs.msg import OrbitState, RelativeState, SimulatorStatus, StepDone
from vtff_node import diagnostics
from vtff_node.lockstep import StepCoordinator
from vtff_node.main import EXIT_FAILURE, run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import REQUIRED, ParameterError, parameter
from vtff_node.stamps import to_nanoseconds, to_stamp
from vtff_sim_bridge.bridge.simgen_link import SimGenLink
from vtff_sim_bridge.bridge.thrust_buffer import ThrustBuffer
from vtff_sim_bridge.simremote.client import SimRemoteClient, SimRemoteError
from vtff_sim_bridge.truth.scenario import Scenario, ScenarioError, load_scenario

START_POLL = 0.05  # s
SETTLE_TIME = 0.5  # s between the graph being complete and a realtime run
REALTIME_POLL = 0.002  # s, resolution of the wall-clock pacing
SIMGEN_MARGIN = 60  # s SimGEN is told to run longer, so that it takes the last motion
WATCH_INTERVAL = 0.25  # s of wall time between looks for missing participants


@dataclass(frozen=True)
class SimgenBridgeParameters:
    """Parameters of `simgen_bridge`."""

    scenario_file: str = parameter(REQUIRED, "scenario: orbits, epoch, force model, target")
    duration: float = parameter(0.0, "length of the run, 0 = as the scenario says", unit="s")
    seed: int = parameter(-1, "seed of the run, -1 = as the scenario says")
    integrator: str = parameter(
        "scenario", "integrator of the truth", choices=("scenario", "rk4", "euler")
    )
    simgen_host: str = parameter("127.0.0.1", "address of SimGEN; empty runs without it")
    simgen_port: int = parameter(15650, "TCP port of SimREMOTE", minimum=1, maximum=65535)
    simgen_scenario: str = parameter(
        "", "SimGEN scenario file to select (SC), empty = <name of the scenario>.scn"
    )
    simgen_timeout: float = parameter(2.0, "longest wait for a reply", unit="s", minimum=0.01)
    lockstep_participants: list[str] = parameter(
        [], "fully qualified nodes that must acknowledge each step"
    )
    lockstep_side_branches: list[str] = parameter(
        [], "nodes that must acknowledge but may lag (recorder, viewer)"
    )
    lockstep_preparing: list[str] = parameter(
        [], "fully qualified nodes that must report ready before SimGEN is started, in any pacing"
    )
    expected_nodes: list[str] = parameter(
        [], "fully qualified nodes of the system; absent ones are named when a step hangs"
    )
    maximum_lag: int = parameter(50, "steps a side branch may lag", minimum=0, maximum=500)
    coasting: list[str] = parameter(
        [], "deputies without a thruster: no step waits for their thrust"
    )
    start_timeout: float = parameter(
        30.0, "wall time for all participants to finish the first step", unit="s", minimum=0.1
    )
    step_timeout: float = parameter(
        5.0, "wall time for all participants to finish a later step", unit="s", minimum=0.1
    )


class SimgenBridgeNode(VtffNode):
    """Truth of all spacecraft, SimREMOTE client, and the only node that paces a run.

    Publishes /clock, <craft>/truth/orbit, formation/relative_state_truth and sim/status once a
    step; subscribes to <deputy>/propulsion/thrust_applied and sim/step_done. With lockstep:=true
    a step begins when every participant has finished the one before; otherwise the wall clock
    paces and the newest thrust is used.
    """

    Parameters = SimgenBridgeParameters

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("simgen_bridge", **node_arguments)
        given: SimgenBridgeParameters = self.parameters
        self._scenario = _scenario_in_force(given)
        self._truth = self._scenario.formation_truth()
        self._steps = round(self._scenario.duration / self._scenario.step)
        self._coordinator = StepCoordinator(
            given.lockstep_participants, given.lockstep_side_branches, given.maximum_lag
        )
        self._thrust = {
            name: ThrustBuffer(self._scenario.step)
            for name in self._truth.deputies
            if name not in given.coasting
        }
        self._simgen = self._make_link(given)
        self._thrust_in_force: dict[str, np.ndarray] = {}
        self._state = SimulatorStatus.STATE_IDLE
        self._problem = ""
        self._refused_thrust = 0
        self._started = False
        self._preparing = set(given.lockstep_preparing)
        self._ready_since: float | None = None
        self._wall_start = 0.0
        self._step_began = 0.0
        self._wall_lag = 0.0
        self._create_interfaces()
        self._made = time.monotonic()
        self._start_timer = self.create_timer(START_POLL, self._start, clock=self.steady_clock)

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
        self._relative_publisher = self.publisher(RelativeState, "formation/relative_state_truth")
        self._relative_messages: dict[str, RelativeState] = {}
        for name in self._truth.deputies:
            relative = RelativeState(child_frame_id=name, solution=RelativeState.SOLUTION_TRUTH)
            relative.header.frame_id = f"{self._truth.chief}/rtn"
            self._relative_messages[name] = relative
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
                AccelStamped,
                f"{name}/propulsion/thrust_applied",
                functools.partial(self._on_thrust, name),
            )
        if self.lockstep or self._preparing:
            # Latched: a node may have reported ready before this one was there.
            self.subscribe(StepDone, "sim/step_done", self._on_step_done, latched=True)

    def _start(self) -> None:
        # A timer that has expired twice calls twice, even when it is cancelled in between.
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
        """Whether the run may start.

        What happens before a receiver is configured is lost, so nodes that prepare come first.
        Lockstep then starts at once: the first step waits for everybody and its messages are kept
        for late comers. The wall clock does not wait, so all nodes must be there before it starts.
        """
        if self.count_publishers("/clock") > 1:
            self._fail(
                "another simulator publishes /clock on this ROS_DOMAIN_ID; give each run its own"
            )
            return False
        now = time.monotonic()
        if self._preparing:
            if now - self._made > self.parameters.start_timeout:
                self._fail(f"the run did not start: {self._unprepared()}")
            return False
        if self.lockstep:
            return True
        absent = self.absent_nodes(self.parameters.expected_nodes)
        silent = [
            f"/{name}/propulsion/thrust_applied"
            for name in self._thrust
            if not self.count_publishers(f"{name}/propulsion/thrust_applied")
        ]
        if not absent and not silent:
            # Nodes see each other a moment after this node has seen them all.
            self._ready_since = self._ready_since or now
            return now - self._ready_since > SETTLE_TIME
        if now - self._made > self.parameters.start_timeout:
            missing = ", ".join([*absent, *silent])
            self._fail(f"the run did not start: not in the graph: {missing}")
        return False

    def _unprepared(self) -> str:
        """Name the nodes that have not reported ready."""
        absent = self.absent_nodes(sorted(self._preparing))
        texts = [
            f"{name} " + ("is not in the graph" if name in absent else "did not report ready")
            for name in sorted(self._preparing)
        ]
        patience = self.parameters.start_timeout
        return f"within {patience:.0f} s " + " and ".join(texts) + "; its /diagnostics say why"

    def _make_link(self, given: SimgenBridgeParameters) -> SimGenLink | None:
        if not given.simgen_host:
            return None
        client = SimRemoteClient(given.simgen_host, given.simgen_port, given.simgen_timeout)
        return SimGenLink(
            client, self._truth.names, reconnect_timeout=10.0 if self.lockstep else None
        )

    def _prepare_simgen(self) -> bool:
        if self._simgen is None:
            return True
        try:
            self._simgen.start(
                self.parameters.simgen_scenario or f"{self._scenario.name}.scn",
                self._scenario.epoch,
                math.ceil(self._scenario.duration) + SIMGEN_MARGIN,
                self._motions(),
            )
            if not self.lockstep:
                self._wall_start = time.monotonic() - self._simgen.time_into_run()
        except (SimRemoteError, ValueError) as error:
            self._fail(str(error))
            return False
        return True

    # ---- steps -------------------------------------------------------------------------------

    def _publish_step(self) -> None:
        """Send the motion of the current time to SimGEN and publish its truth."""
        stamp_nanoseconds = self._truth.time.to_unix_nanoseconds()
        stamp = to_stamp(stamp_nanoseconds)
        self._step_began = time.monotonic()
        self.scenario_nanoseconds = stamp_nanoseconds
        self._coordinator.begin(stamp_nanoseconds)
        self._thrust_in_force = self._thrust_now(stamp_nanoseconds)
        self._receive_replies()
        self._send_motion()
        if self.lockstep and self.parameters.lockstep_preparing:
            # SimGEN replies when the bytes of this step are on the receivers' ports. With /clock
            # after that, a driver never takes a slow emulator for a silent receiver.
            self._receive_replies()
        if self._state == SimulatorStatus.STATE_ERROR:
            return
        self._clock_message.clock = stamp
        self._clock_publisher.publish(self._clock_message)
        for name, (publisher, message) in self._orbit_messages.items():
            state = self._truth.state_gcrf(name)
            message.header.stamp = stamp
            message.position = state[:3]
            message.velocity = state[3:]
            publisher.publish(message)
        state_chief = self._truth.state_gcrf(self._truth.chief)
        for name, relative in self._relative_messages.items():
            relative_state = self._truth.relative_state_rtn(name)
            relative.header.stamp = stamp
            relative.position = relative_state[:3]
            relative.velocity = relative_state[3:]
            relative.position_chief_gcrf = state_chief[:3]
            relative.velocity_chief_gcrf = state_chief[3:]
            self._relative_publisher.publish(relative)
        self._publish_status(stamp)
        self._show_progress()

    def _advance(self) -> None:
        """Integrate one step with the thrust that starts now, then publish the next step."""
        if self._coordinator.step >= self._steps:
            self._end()
            return
        if self.lockstep:
            # All of the step's thrust has arrived by now, also with a thruster without delay.
            self._thrust_in_force = self._thrust_now(self.scenario_nanoseconds)
        self._truth.advance(self._thrust_in_force)
        self._publish_step()

    def _thrust_now(self, stamp_nanoseconds: int) -> dict[str, np.ndarray]:
        applied = {}
        for name, buffer in self._thrust.items():
            thrust = buffer.starting_at(stamp_nanoseconds, exactly=self.lockstep)
            if thrust is not None:
                applied[name] = thrust
        return applied

    def _on_thrust(self, name: str, message: AccelStamped) -> None:
        linear = message.accel.linear
        if not all(math.isfinite(value) for value in (linear.x, linear.y, linear.z)):
            self._refused_thrust += 1
            self.get_logger().warning(
                f"thrust of {name} is not finite: none is applied", throttle_duration_sec=5.0
            )
            linear.x = linear.y = linear.z = 0.0
        self._thrust[name].add(to_nanoseconds(message.header.stamp), (linear.x, linear.y, linear.z))
        if self.lockstep:
            self._advance_when_complete()

    def _on_step_done(self, message: StepDone) -> None:
        stamp = to_nanoseconds(message.header.stamp)
        if stamp == 0:
            self._preparing.discard(message.node)
        elif self.lockstep:
            self._coordinator.acknowledge(message.node, stamp)
            self._advance_when_complete()

    def _advance_when_complete(self) -> None:
        if self._state != SimulatorStatus.STATE_RUNNING or not self._coordinator.complete:
            return
        # Topics are not ordered among each other: an acknowledgement may overtake the thrust.
        if all(buffer.received > self._coordinator.step for buffer in self._thrust.values()):
            self._advance()

    def _pace(self) -> None:
        if self._state != SimulatorStatus.STATE_RUNNING:
            return
        due = self._wall_start + (self._coordinator.step + 1) * self._scenario.step
        now = time.monotonic()
        if now >= due:
            self._wall_lag = now - due
            self._advance()

    def _end(self) -> None:
        self._receive_replies()
        if self._state == SimulatorStatus.STATE_ERROR:
            return
        self._state = SimulatorStatus.STATE_ENDED
        self._publish_status(to_stamp(self.scenario_nanoseconds))
        self.finish()

    # ---- SimGEN ------------------------------------------------------------------------------

    def _motions(self) -> dict[str, np.ndarray]:
        return {
            name: self._truth.motion_itrf(name, self._thrust_in_force.get(name))
            for name in self._truth.names
        }

    def _send_motion(self) -> None:
        if self._simgen is None:
            return
        try:
            self._simgen.send(self._time_into_run(), self._motions())
        except SimRemoteError as error:
            self._fail(str(error))

    def _receive_replies(self) -> None:
        """Take SimGEN's replies; those to the previous step wait by now, so nothing blocks."""
        if self._simgen is None or self._state == SimulatorStatus.STATE_ERROR:
            return
        try:
            self._simgen.receive()
        except SimRemoteError as error:
            self._fail(str(error))

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
        status.step = max(0, self._coordinator.step)
        status.time_into_run = self._time_into_run()
        status.late_commands = sum(buffer.late for buffer in self._thrust.values())
        status.real_time_factor = status.time_into_run / elapsed if elapsed > 0.0 else 0.0
        status.wall_lag = self._wall_lag
        status.message = self._problem or (self._simgen.problem if self._simgen else "")
        self._status_publisher.publish(status)

    def _show_progress(self) -> None:
        separations = {
            name: float(message.position[1]) for name, message in self._relative_messages.items()
        }
        self.report_progress(self._time_into_run(), self._scenario.duration, in_track=separations)

    def _watch(self) -> None:
        """Fail, naming who is missing, when a lockstep step is not completed in time."""
        if not self.lockstep or self._state != SimulatorStatus.STATE_RUNNING:
            return
        first = self._coordinator.step == 0
        patience = self.parameters.start_timeout if first else self.parameters.step_timeout
        if time.monotonic() - self._step_began > patience:
            self._fail(
                f"step {self._coordinator.step} (t = {self._time_into_run():.0f} s) was not "
                f"finished within {patience:.0f} s; waiting for {self._missing()}"
            )

    def _missing(self) -> str:
        parts = [
            f"{name} (" + (f"last did step {step}" if step >= 0 else "never answered") + ")"
            for name, step in self._coordinator.missing().items()
        ]
        parts += [
            f"thrust on /{name}/propulsion/thrust_applied"
            for name, buffer in self._thrust.items()
            if buffer.received <= self._coordinator.step
        ]
        absent = self.absent_nodes(self.parameters.expected_nodes)
        return ", ".join(parts) + (f"; not in the graph: {', '.join(absent)}" if absent else "")

    def _fail(self, problem: str) -> None:
        self._problem = problem
        self._state = SimulatorStatus.STATE_ERROR
        self.get_logger().error(problem)
        self._publish_status(to_stamp(self._truth.time.to_unix_nanoseconds()))
        self.finish(EXIT_FAILURE)

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report pacing, the SimGEN connection and late commands."""
        values: dict[str, Any] = {
            "step": self._coordinator.step,
            "of": self._steps,
            "late commands": sum(buffer.late for buffer in self._thrust.values()),
            "thrust refused": self._refused_thrust,
        }
        level, text = diagnostics.OK, "running"
        if self._simgen is not None:
            values.update(dataclasses.asdict(self._simgen.counters))
            if self._simgen.problem:
                level, text = diagnostics.WARN, self._simgen.problem
        if self._problem:
            level, text = diagnostics.ERROR, self._problem
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
        scenario = load_scenario(pathlib.Path(given.scenario_file))
    except ScenarioError as error:
        raise ParameterError(str(error)) from error
    changes: dict[str, Any] = {}
    if given.duration > 0.0:
        changes["duration"] = given.duration
    if given.seed >= 0:
        changes["seed"] = given.seed
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
