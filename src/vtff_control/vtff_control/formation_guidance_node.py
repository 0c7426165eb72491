"""Node `formation_guidance`: what every spacecraft of a formation shall do, the chief too."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import AccelStamped
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future

from vtff_control.guidance.formation_guidance import Reconfiguration
from vtff_control.guidance.formations import read_formations
from vtff_control.guidance.interface import (
    Guidance,
    GuidanceResult,
    GuidanceSetting,
    SpacecraftTarget,
    check_guidance_result,
)
from vtff_control.guidance.keeping import T5_ENGINE, KeepingEngine
from vtff_control.guidance.requests import (
    ModeRequest,
    ReconfigurationRequest,
    Request,
    RequestError,
    read_timeline,
)
from vtff_control.guidance_conversions import MODE_NUMBERS, formation_state
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray
from vtff_msgs.action import Reconfigure
from vtff_msgs.msg import FormationGuidance, RelativeState
from vtff_msgs.srv import SetGuidanceMode
from vtff_node import diagnostics
from vtff_node.epoch_join import EpochJoin, JoinedEpoch
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import REQUIRED, ParameterError, parameter
from vtff_node.plain_yaml import parse_yaml
from vtff_node.plugins.groups import GUIDANCES
from vtff_node.plugins.loading import PluginError, plugin_names
from vtff_node.stamps import StampOrder, to_nanoseconds, to_stamp

_OBJECTIVES = {
    Reconfigure.Goal.OBJECTIVE_NORMS: "norms",
    Reconfigure.Goal.OBJECTIVE_AXES: "axes",
    Reconfigure.Goal.OBJECTIVE_ENERGY: "energy",
}


@dataclass(frozen=True)
class FormationGuidanceNodeParameters:
    """Parameters of `formation_guidance`."""

    chief: str = parameter("chief", "name of the chief")
    deputies: list[str] = parameter(REQUIRED, "names of the deputies")
    guidance: str = parameter(
        "formation",
        "guidance, shipped or of an installed package (docs/plugins.md)",
        choices=plugin_names(GUIDANCES.name),
    )
    relative_state: str = parameter(
        "relative_state", "topic of the relative state in the namespace of each deputy"
    )
    formations: str = parameter(
        "", "file with the relative elements of each formation; empty: none has a name"
    )
    timeline: list[str] = parameter(
        [""],
        "requests, each 'TIME MODE [FORMATION] [name=value ...]', time in s after the first states",
    )
    commands_thrust: bool = parameter(
        False, "send the feedforward to the thrusters; otherwise controllers add it to theirs"
    )
    sample_time: float = parameter(
        GuidanceSetting.sample_time, "interval between states", unit="s", minimum=0.001
    )
    delay_steps: int = parameter(
        GuidanceSetting.delay_steps,
        "samples between a state and the start of the thrust that answers it",
        minimum=0,
        maximum=100,
    )
    mass: float = parameter(GuidanceSetting.mass, "of each spacecraft", unit="kg", minimum=1e-3)
    largest_thrust: float = parameter(
        T5_ENGINE.largest, "largest thrust on an axis", unit="N", minimum=1e-9
    )
    smallest_thrust: float = parameter(
        T5_ENGINE.smallest, "smallest thrust on an axis but none", unit="N", minimum=1e-9
    )
    thrust_step: float = parameter(
        T5_ENGINE.step, "smallest change of the thrust", unit="N", minimum=1e-12
    )
    wait: float = parameter(
        0.3, "outside lockstep, longest wait for a late state", unit="s", minimum=0.0
    )
    compute_limit: float = parameter(
        10.0, "longest wall time of one step of the guidance", unit="s", minimum=0.001
    )
    planning_limit: float = parameter(
        30.0, "longest wall time in which a request is answered", unit="s", minimum=0.001
    )


class FormationGuidanceNode(VtffNode):
    """Guidance of a formation: one target and one feedforward thrust for every spacecraft and step.

    Subscribes to /<deputy>/relative_state of all deputies. Publishes /<spacecraft>/target
    (RelativeState, relative to the chief), /<spacecraft>/control/feedforward (AccelStamped, m/s2 in
    <chief>/rtn) and /formation/guidance, stamped with the time of the states they answer; with
    commands_thrust also /<spacecraft>/control/thrust_command. The service /formation/guidance/mode
    sets the mode, the action /formation/guidance/reconfigure brings the formation into another one,
    and the parameter timeline asks for both at given times. Where a state is missing there is no
    thrust. A guidance that fails, is too slow or answers with something unusable is named, its
    thrust is zero and the node ends.
    """

    Parameters = FormationGuidanceNodeParameters
    Plugins = GUIDANCES

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("formation_guidance", **node_arguments)
        given: FormationGuidanceNodeParameters = self.parameters
        if not given.deputies:
            raise ParameterError("parameter 'deputies': at least one name expected")
        self._setting = _setting(given)
        self.plugin.call_limit = given.compute_limit
        self.plugin.sample_time = given.sample_time
        self._planner = dataclasses.replace(self.plugin, call_limit=given.planning_limit)
        self._guidance: Guidance = self.plugin.make(self._setting, self.plugin_parameters)
        self._timeline = self._read_timeline(given.timeline)
        self._entries = list(self._timeline)
        self._first: int | None = None
        self._newest = 0
        self._join = EpochJoin(
            given.deputies, math.inf if self.lockstep else given.wait, waits_for_closing=False
        )
        self._goals: dict[int, tuple[Any, Future, Reconfiguration]] = {}
        self._result: GuidanceResult | None = None
        self._reason = "no relative states yet"
        self._velocity_changes = dict.fromkeys(self._setting.spacecraft, 0.0)
        self._create_interfaces(given)

    def _create_interfaces(self, given: FormationGuidanceNodeParameters) -> None:
        names = self._setting.spacecraft
        self._targets = {name: self.publisher(RelativeState, f"/{name}/target") for name in names}
        topics = ["control/feedforward"]
        if given.commands_thrust:
            topics.append("control/thrust_command")
        self._thrusts = {
            name: [self.publisher(AccelStamped, f"/{name}/{topic}") for topic in topics]
            for name in names
        }
        self._publisher = self.publisher(FormationGuidance, "/formation/guidance")
        for name in given.deputies:
            self.subscribe(
                RelativeState,
                f"/{name}/{given.relative_state}",
                functools.partial(self._on_state, name),
            )
        self.create_service(SetGuidanceMode, "/formation/guidance/mode", self._on_mode)
        self._action_server = ActionServer(
            self,
            Reconfigure,
            "/formation/guidance/reconfigure",
            execute_callback=self._execute,
            goal_callback=lambda goal: GoalResponse.ACCEPT,
            cancel_callback=self._on_cancel,
        )
        if not self.lockstep:
            self.create_timer(0.5 * given.wait or 0.1, self._step_complete, clock=self.steady_clock)

    def _read_timeline(self, lines: list[str]) -> list[Any]:
        try:
            entries = read_timeline(lines)
            for entry in entries:
                self._check(entry.request)
        except RequestError as error:
            raise ParameterError(f"parameter 'timeline': {error}") from error
        return entries

    def _check(self, request: Request) -> None:
        check = getattr(self._guidance, "check", None)
        if check is None:
            raise RequestError(f"guidance '{self.parameters.guidance}' takes no requests")
        check(request)

    # ---- requests ----------------------------------------------------------------------------

    def _ask(self, request: Request) -> Reconfiguration | None:
        """Ask the guidance for something; raises RequestError or PluginError."""
        self._check(request)

        def ask() -> tuple[Reconfiguration | None, RequestError | None]:
            try:
                return self._guidance.request(request), None  # type: ignore[attr-defined]
            except RequestError as error:
                return None, error

        answer, refusal = self._planner.call(ask)
        if refusal is not None:
            raise refusal
        if answer is not None and (warning := answer.flight.unsafe_losses_text()):
            self.get_logger().warning(f"reconfiguration to '{answer.flight.formation}': {warning}")
        return answer

    def _ask_due(self, stamp: int) -> None:
        """Ask for what the timeline has by now."""
        if self._first is None:
            self._first = stamp
        elapsed = (stamp - self._first) / NANOSECONDS_PER_SECOND
        while self._entries and self._entries[0].time <= elapsed + 1e-6:
            entry = self._entries.pop(0)
            try:
                self._ask(entry.request)
            except RequestError as error:
                self.get_logger().error(f"timeline, {entry.time:g} s: {error}")
            if isinstance(entry.request, ModeRequest) and entry.request.mode == "abort":
                self._entries.clear()

    def _on_mode(
        self, request: SetGuidanceMode.Request, response: SetGuidanceMode.Response
    ) -> SetGuidanceMode.Response:
        try:
            self._ask(
                ModeRequest(request.mode, request.formation, request.angle_deg, request.orbits)
            )
        except RequestError as error:
            response.message = str(error)
            return response
        except PluginError as error:
            response.message = str(error)
            self.fail(str(error))
            return response
        if request.mode == "abort":
            self._entries.clear()
        self.get_logger().info(f"mode {request.mode} {request.formation}".rstrip())
        response.success = True
        return response

    async def _execute(self, goal_handle: Any) -> Reconfigure.Result:
        goal = goal_handle.request
        try:
            request = ReconfigurationRequest(
                goal.formation,
                goal.duration,
                goal.closest_approach,
                goal.acceleration_cap,
                goal.axes or "RTN",
                _OBJECTIVES.get(goal.objective, str(goal.objective)),
                goal.passive_safety_orbits,
                goal.preempt,
                _designs(goal),
            )
            goal_handle.publish_feedback(Reconfigure.Feedback(phase="planning"))
            followed = self._ask(request)
        except (RequestError, PluginError) as error:
            goal_handle.abort()
            if isinstance(error, PluginError):
                self.fail(str(error))
            return Reconfigure.Result(message=str(error))
        assert followed is not None
        goal_handle.publish_feedback(
            Reconfigure.Feedback(
                phase="planned", closest_approach=followed.flight.plan.closest_approach
            )
        )
        future: Future = Future()
        self._goals[id(goal_handle)] = (goal_handle, future, followed)
        await future
        if followed.success:
            goal_handle.succeed()
        elif goal_handle.is_cancel_requested:
            goal_handle.canceled()
        else:
            goal_handle.abort()
        return Reconfigure.Result(
            success=followed.success,
            message=followed.message,
            spacecraft=list(followed.velocity_changes),
            velocity_change=list(followed.velocity_changes.values()),
            closest_approach=followed.flight.closest_seen,
        )

    def _on_cancel(self, goal_handle: Any) -> CancelResponse:
        if id(goal_handle) not in self._goals:
            return CancelResponse.REJECT
        with contextlib.suppress(RequestError):
            self._ask(ModeRequest("free_drift"))
        return CancelResponse.ACCEPT

    def _tell_goals(self, result: GuidanceResult | None) -> None:
        for key, (goal_handle, future, followed) in list(self._goals.items()):
            if followed.finished:
                del self._goals[key]
                future.set_result(None)
            elif result is not None:
                left = result.velocity_changes_left
                goal_handle.publish_feedback(
                    Reconfigure.Feedback(
                        phase="manoeuvre",
                        time_left=result.time_left,
                        closest_approach=result.closest_approach,
                        spacecraft=list(left),
                        velocity_change_left=list(left.values()),
                    )
                )

    # ---- steps -------------------------------------------------------------------------------

    def _on_state(self, name: str, message: RelativeState) -> None:
        if self.finished or not self.is_of_deputy(message, name, self.parameters.relative_state):
            return
        stamp = to_nanoseconds(message.header.stamp)
        if self._newest - stamp >= StampOrder.JUMP_BACK:
            self._restart()
        self._newest = stamp
        self._join.add(name, stamp, message, time.monotonic())
        self._step_complete()

    def _restart(self) -> None:
        self._join.restart()
        self._first, self._entries = None, list(self._timeline)
        self._velocity_changes = dict.fromkeys(self._setting.spacecraft, 0.0)
        for _, _, followed in self._goals.values():
            followed.end(False, "time has jumped back")
        self._tell_goals(None)
        self.plugin.call(self._guidance.reset)

    def _step_complete(self) -> None:
        epoch = self._join.take(time.monotonic())
        while epoch is not None and not self.finished:
            self._step(epoch)
            epoch = self._join.take(time.monotonic())

    def _step(self, epoch: JoinedEpoch) -> None:
        started = time.perf_counter()
        stamp = epoch.stamp_nanoseconds
        problem = ""
        result: GuidanceResult | None = None
        state, self._reason = formation_state(epoch, self._setting.deputies)
        try:
            if state is not None:
                result = self.plugin.call(
                    self._guidance.step,
                    state,
                    check=lambda answer: check_guidance_result(answer, self._setting.spacecraft),
                )
                self._result = result
        except PluginError as error:
            problem = self._reason = str(error)
            result = None
        self._publish(epoch, result)
        self._tell_goals(result)
        try:
            # After the answer, because a plan may take longer than a step.
            if result is not None:
                self._ask_due(stamp)
        except PluginError as error:
            problem = str(error)
        if problem:
            self.fail(problem)
            return
        self.acknowledge_step(to_stamp(stamp), started)

    def _publish(self, epoch: JoinedEpoch, result: GuidanceResult | None) -> None:
        """Publish a result; without one there is no thrust and targets are those of before."""
        stamp = to_stamp(epoch.stamp_nanoseconds)
        frame = f"{self._setting.chief}/rtn"
        shown = result or self._result
        targets = dict(shown.targets) if shown is not None else {}
        report = FormationGuidance(
            mode=MODE_NUMBERS.get(shown.mode, FormationGuidance.MODE_PLUGIN) if shown else 0,
            formation=shown.formation if shown else "",
            reason=self._reason or (shown.reason if shown else ""),
            time_left=shown.time_left if shown else math.inf,
            closest_approach=shown.closest_approach if shown else math.nan,
        )
        report.header.stamp, report.header.frame_id = stamp, frame
        for name in self._setting.spacecraft:
            target = targets.get(name, SpacecraftTarget(np.zeros(6), np.zeros(3)))
            thrust = np.zeros(3)
            if result is not None:
                thrust = np.asarray(target.acceleration_rtn, dtype=float) + 0.0
            self._velocity_changes[name] += float(
                np.linalg.norm(thrust) * self._setting.sample_time
            )
            report.spacecraft.append(name)
            report.position.extend(target.relative_state[:3])
            report.velocity.extend(target.relative_state[3:])
            report.acceleration.extend(thrust)
            report.velocity_change.append(self._velocity_changes[name])
            left = shown.velocity_changes_left if shown is not None else {}
            report.velocity_change_left.append(left.get(name, 0.0))
            self._publish_thrust(name, thrust, stamp, frame)
            if name in targets:
                self._publish_target(name, target, epoch)
        self._publisher.publish(report)

    def _publish_thrust(self, name: str, thrust: FloatArray, stamp: Any, frame: str) -> None:
        message = AccelStamped()
        message.header.stamp, message.header.frame_id = stamp, frame
        linear = message.accel.linear
        linear.x, linear.y, linear.z = thrust.tolist()
        for publisher in self._thrusts[name]:
            publisher.publish(message)

    def _publish_target(self, name: str, target: SpacecraftTarget, epoch: JoinedEpoch) -> None:
        message = RelativeState(child_frame_id=name, solution=RelativeState.SOLUTION_PREDICTED)
        message.header.stamp = to_stamp(epoch.stamp_nanoseconds)
        message.header.frame_id = f"{self._setting.chief}/rtn"
        message.position = np.asarray(target.relative_state[:3], dtype=float)
        message.velocity = np.asarray(target.relative_state[3:], dtype=float)
        measured = epoch.measured.get(self._setting.deputies[0])
        if measured is not None:
            message.position_chief_gcrf = measured.position_chief_gcrf
            message.velocity_chief_gcrf = measured.velocity_chief_gcrf
        self._targets[name].publish(message)

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report the mode, or why there is no thrust."""
        result = self._result
        text = f"no thrust: {self._reason}"
        if not self._reason and result is not None:
            text = f"{result.mode} {result.formation}".rstrip()
            if result.reason:
                text += f"; {result.reason}"
        return [
            diagnostics.status(
                f"{self.get_name()}: mode",
                diagnostics.WARN if self._reason else diagnostics.OK,
                text,
                {
                    "guidance": self.parameters.guidance,
                    **{
                        f"velocity change of {name}, m/s": change
                        for name, change in self._velocity_changes.items()
                    },
                },
                hardware_id=self._setting.chief,
            )
        ]


def _designs(goal: Reconfigure.Goal) -> dict[str, FloatArray] | None:
    """Return the relative elements of every spacecraft that a goal gives, or None."""
    if not goal.spacecraft and not goal.relative_elements:
        return None
    if len(goal.relative_elements) != 6 * len(goal.spacecraft):
        raise RequestError(
            f"relative_elements: six for each of {len(goal.spacecraft)} spacecraft expected, "
            f"got {len(goal.relative_elements)}"
        )
    elements = np.array(goal.relative_elements).reshape(-1, 6)
    return dict(zip(goal.spacecraft, elements, strict=True))


def _setting(given: FormationGuidanceNodeParameters) -> GuidanceSetting:
    spacecraft = (given.chief, *given.deputies)
    formations: Mapping[str, Mapping[str, FloatArray]] = {}
    try:
        engine = KeepingEngine(given.largest_thrust, given.smallest_thrust, given.thrust_step)
        if given.formations:
            text = Path(given.formations).read_text(encoding="utf-8")
            formations = read_formations(parse_yaml(text), given.formations, spacecraft)
    except OSError as error:
        raise ParameterError(f"parameter 'formations': {error}") from error
    except ValueError as error:
        raise ParameterError(str(error)) from error
    return GuidanceSetting(
        given.chief,
        tuple(given.deputies),
        given.sample_time,
        given.delay_steps,
        engine,
        given.mass,
        formations,
    )


NODE_CLASS = FormationGuidanceNode


def main() -> None:
    """Run the node."""
    run_node(FormationGuidanceNode)
