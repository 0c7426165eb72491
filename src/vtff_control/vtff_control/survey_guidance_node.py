"""Node `survey_guidance`: where walls of plasma are, and formations that sample them."""

from __future__ import annotations

import dataclasses
import functools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future

from vtff_control.guidance.requests import ModeRequest, ReconfigurationRequest, RequestError
from vtff_control.guidance_conversions import MODE_NAMES, formation_state
from vtff_control.survey.goals import SurveyGoal, TimedGoal, read_goals
from vtff_control.survey.prediction import PredictedCrossing
from vtff_control.survey.survey_guidance import SurveyGuidance, SurveyParameters
from vtff_msgs.action import Reconfigure, Survey
from vtff_msgs.msg import (
    FormationGuidance,
    IrregularityBoundary,
    RelativeState,
    Scintillation,
)
from vtff_msgs.msg import SurveyGuidance as SurveyGuidanceMessage
from vtff_msgs.srv import SetGuidanceMode
from vtff_node import diagnostics
from vtff_node.epoch_join import EpochJoin, JoinedEpoch
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import REQUIRED, ParameterError, parameter
from vtff_node.stamps import StampOrder, to_nanoseconds, to_stamp

_GUIDANCE = "/formation/guidance"
#: Phase, reason, passes, and whether there are predictions, before the first message.
_NOTHING_SHOWN = ("", "", -1, False)


@dataclass(frozen=True)
class SurveyGuidanceNodeParameters(SurveyParameters):
    """Parameters of `survey_guidance`."""

    chief: str = parameter("chief", "name of the chief")
    deputies: list[str] = parameter(REQUIRED, "names of the deputies")
    relative_state: str = parameter(
        "relative_state", "topic of the relative state in the namespace of each deputy"
    )
    timeline: list[str] = parameter(
        [""], "goals, each 'TIME KIND [name=value ...]', time in s after the first states"
    )
    wait: float = parameter(
        0.3, "outside lockstep, longest wait for a late state", unit="s", minimum=0.0
    )


@dataclass(eq=False)
class _RunningGoal:
    """A goal of an action client that is under way."""

    handle: Any
    future: Future
    goal: SurveyGoal


class SurveyGuidanceNode(VtffNode):
    """Learns from live S4 and edges where plasma is, and asks for formations that sample it.

    Subscribes to /<deputy>/relative_state and /<deputy>/iono/irregularity_boundary of all deputies,
    /<spacecraft>/iono/scintillation of all spacecraft, and /formation/guidance. It is a client of
    the action /formation/guidance/reconfigure and the service /formation/guidance/mode of
    `formation_guidance`. Publishes /formation/survey (SurveyGuidance) at every decision. The action
    /formation/survey/goal and the parameter timeline say what to sample. In lockstep a step ends
    when `formation_guidance` has answered, so that runs repeat.
    """

    Parameters = SurveyGuidanceNodeParameters

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("survey_guidance", **node_arguments)
        given: SurveyGuidanceNodeParameters = self.parameters
        if not given.deputies:
            raise ParameterError("parameter 'deputies': at least one name expected")
        names = [field.name for field in dataclasses.fields(SurveyParameters)]
        self._survey = SurveyGuidance(
            given.chief,
            tuple(given.deputies),
            SurveyParameters(**{name: getattr(given, name) for name in names}),
        )
        try:
            self._timeline = read_goals(given.timeline)
        except RequestError as error:
            raise ParameterError(f"parameter 'timeline': {error}") from error
        self._entries: list[TimedGoal] = list(self._timeline)
        self._running: _RunningGoal | None = None
        self._newest = 0
        self._busy = False
        self._shown = _NOTHING_SHOWN
        self._join = EpochJoin(
            [*given.deputies, _GUIDANCE],
            math.inf if self.lockstep else given.wait,
            waits_for_closing=False,
        )
        self._create_interfaces(given)

    def _create_interfaces(self, given: SurveyGuidanceNodeParameters) -> None:
        self._publisher = self.publisher(SurveyGuidanceMessage, "/formation/survey")
        self.subscribe(FormationGuidance, _GUIDANCE, functools.partial(self._on_step, _GUIDANCE))
        for name in given.deputies:
            self.subscribe(
                RelativeState,
                f"/{name}/{given.relative_state}",
                functools.partial(self._on_step, name),
            )
            self.subscribe(
                IrregularityBoundary, f"/{name}/iono/irregularity_boundary", self._on_boundary
            )
        for name in (given.chief, *given.deputies):
            self.subscribe(
                Scintillation,
                f"/{name}/iono/scintillation",
                functools.partial(self._on_scintillation, name),
            )
        self._reconfigure = ActionClient(self, Reconfigure, f"{_GUIDANCE}/reconfigure")
        self._mode_client = self.create_client(SetGuidanceMode, f"{_GUIDANCE}/mode")
        self._action_server = ActionServer(
            self,
            Survey,
            "/formation/survey/goal",
            execute_callback=self._execute,
            goal_callback=lambda goal: GoalResponse.ACCEPT,
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
        )
        if not self.lockstep:
            self.create_timer(0.5 * given.wait or 0.1, self._step_complete, clock=self.steady_clock)

    # ---- goals -------------------------------------------------------------------------------

    async def _execute(self, goal_handle: Any) -> Survey.Result:
        asked = goal_handle.request
        try:
            goal = SurveyGoal(asked.kind, asked.altitude_difference)
        except RequestError as error:
            goal_handle.abort()
            return Survey.Result(message=str(error))
        self._end_goal("replaced by another goal")
        self._entries.clear()
        running = _RunningGoal(goal_handle, Future(), goal)
        self._running, self._survey.goal = running, goal
        self.get_logger().info(f"goal {goal.kind}, {goal.altitude_difference:g} m")
        message = await running.future
        if goal_handle.is_cancel_requested:
            goal_handle.canceled()
        else:
            goal_handle.succeed()
        plans = self._survey.plans
        return Survey.Result(
            success=True,
            message=message,
            plans=len(plans),
            velocity_change=math.fsum(plan.velocity_change for plan in plans),
        )

    def _end_goal(self, message: str) -> None:
        running, self._running = self._running, None
        if running is not None:
            self._survey.goal = None
            running.future.set_result(message)

    def _take_due_goals(self, time_now: float) -> None:
        while self._entries and self._entries[0].time <= time_now + 1e-6:
            self._survey.goal = self._entries.pop(0).goal
        if self._running is not None and self._running.handle.is_cancel_requested:
            self._end_goal("cancelled")

    # ---- what is told ------------------------------------------------------------------------

    def _on_boundary(self, message: IrregularityBoundary) -> None:
        # The rate of TEC rises and falls many times within a bubble; the intensity does not.
        is_ray = message.kind == IrregularityBoundary.KIND_HORIZONTAL
        if is_ray and message.source == IrregularityBoundary.SOURCE_S4:
            self._survey.add_edge(
                to_nanoseconds(message.header.stamp),
                message.time_sigma,
                message.spacecraft,
                (message.system, message.prn),
                message.entry,
            )

    def _on_scintillation(self, name: str, message: Scintillation) -> None:
        rays = list(zip(message.system, message.prn, strict=True))
        # A satellite has several signals; the first of each is that of the edges.
        first = {ray: index for index, ray in reversed(list(enumerate(rays)))}
        s4 = [
            corrected if math.isfinite(corrected) else pseudo
            for corrected, pseudo in zip(message.s4_corrected, message.s4_pseudo, strict=True)
        ]
        self._survey.add_scintillation(
            to_nanoseconds(message.header.stamp),
            message.window,
            name,
            {ray: message.azimuth[index] for ray, index in first.items()},
            {ray: s4[index] for ray, index in first.items()},
        )

    # ---- steps -------------------------------------------------------------------------------

    def _on_step(self, source: str, message: Any) -> None:
        stamp = to_nanoseconds(message.header.stamp)
        if self._newest - stamp >= StampOrder.JUMP_BACK:
            self._join.restart()
            self._survey.reset()
            self._end_goal("time has jumped back")
            self._entries, self._shown = list(self._timeline), _NOTHING_SHOWN
        self._newest = stamp
        self._join.add(source, stamp, message, time.monotonic())
        self._step_complete()

    def _step_complete(self) -> None:
        while not self._busy and not self.finished:
            epoch = self._join.take(time.monotonic())
            if epoch is None:
                return
            self._step(epoch)

    def _step(self, epoch: JoinedEpoch) -> None:
        started = time.perf_counter()
        stamp = epoch.stamp_nanoseconds
        guidance = epoch.measured.get(_GUIDANCE)
        mode = MODE_NAMES.get(guidance.mode, "") if guidance is not None else ""
        since_first = self._survey.seconds(stamp)
        self._take_due_goals(0.0 if math.isnan(since_first) else since_first)
        state, _ = formation_state(epoch, tuple(self.parameters.deputies))
        result = self._survey.step(stamp, state, mode)

        def end() -> None:
            self._publish(stamp)
            self._busy = False
            self.acknowledge_step(to_stamp(stamp), started)

        if result.request is None:
            end()
            return
        self._busy = True

        def end_and_go_on() -> None:
            end()
            self._step_complete()

        self.get_logger().info(result.reason)
        if isinstance(result.request, ModeRequest):
            self._ask_mode(result.request, end_and_go_on)
        else:
            assert isinstance(result.request, ReconfigurationRequest)
            self._ask_reconfiguration(result.request, end_and_go_on)

    def _ask_mode(self, request: ModeRequest, end: Callable[[], None]) -> None:
        def answered(future: Any) -> None:
            answer = future.result()
            if not answer.success:
                self._survey.refused(answer.message)
            end()

        asked = SetGuidanceMode.Request(mode=request.mode)
        self._mode_client.call_async(asked).add_done_callback(answered)

    def _ask_reconfiguration(
        self, request: ReconfigurationRequest, end: Callable[[], None]
    ) -> None:
        designs = request.designs or {}
        goal = Reconfigure.Goal(
            formation=request.formation,
            spacecraft=list(designs),
            relative_elements=[float(value) for row in designs.values() for value in row],
            duration=request.duration,
            closest_approach=request.closest_approach,
            passive_safety_orbits=request.passive_safety_orbits,
        )
        is_answered = False

        def answer(refusal: str) -> None:
            nonlocal is_answered
            if is_answered:
                return
            is_answered = True
            if refusal:
                self._survey.refused(refusal)
                self.get_logger().error(f"refused: {refusal}")
            end()

        def take_feedback(message: Any) -> None:
            if message.feedback.phase == "planned":
                answer("")

        def take_result(future: Any) -> None:
            answer(future.result().result.message)

        def take_handle(future: Any) -> None:
            handle = future.result()
            if handle.accepted:
                handle.get_result_async().add_done_callback(take_result)
            else:
                answer("not accepted")

        sent = self._reconfigure.send_goal_async(goal, feedback_callback=take_feedback)
        sent.add_done_callback(take_handle)

    # ---- reports -----------------------------------------------------------------------------

    def _publish(self, stamp: int) -> None:
        survey = self._survey
        seconds = survey.seconds(stamp)
        shown = (survey.phase, survey.reason, survey.estimate.passes, bool(survey.predictions))
        if shown == self._shown:
            return
        self._shown = shown
        message = _survey_message(survey, seconds)
        message.header.stamp, message.header.frame_id = to_stamp(stamp), "earth"
        self._publisher.publish(message)
        if self._running is not None:
            coming = [c for c in survey.predictions if c.time > seconds]
            self._running.handle.publish_feedback(
                Survey.Feedback(
                    phase=survey.phase,
                    reason=survey.reason,
                    walls=len(survey.estimate.walls),
                    drift=survey.estimate.drift,
                    drift_sigma=survey.estimate.drift_sigma,
                    next_crossing=coming[0].time - seconds if coming else math.nan,
                    next_crossing_sigma=coming[0].time_sigma if coming else math.nan,
                )
            )

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report phase and reason."""
        survey = self._survey
        level = diagnostics.WARN if survey.phase == "degraded" else diagnostics.OK
        return [
            diagnostics.status(
                f"{self.get_name()}: survey",
                level,
                survey.reason,
                {"phase": survey.phase, "walls": len(survey.estimate.walls)},
            )
        ]


def _survey_message(survey: SurveyGuidance, seconds: float) -> SurveyGuidanceMessage:
    """Return the message of what a survey knows, without its header."""
    estimate, plans, goal = survey.estimate, survey.plans, survey.goal
    coming: list[PredictedCrossing] = [c for c in survey.predictions if c.time > seconds]
    message = SurveyGuidanceMessage(
        phase=survey.phase,
        reason=survey.reason,
        goal=goal.kind if goal else "",
        altitude_difference=goal.altitude_difference if goal else 0.0,
        drift=estimate.drift,
        drift_sigma=estimate.drift_sigma,
        probability=estimate.probability,
        unsupported_crossings=sum(not c.is_supported for c in survey.crossings),
        plans=len(plans),
        ellipse_size=plans[-1].size if plans else math.nan,
        ellipse_phase=plans[-1].phase if plans else math.nan,
        velocity_change=math.fsum(plan.velocity_change for plan in plans),
    )
    for wall in estimate.walls:
        message.wall_passes.append(wall.passes)
        message.wall_entry.append(wall.is_entry)
        message.wall_longitude_deg.append(_degrees(wall.longitude_at(seconds)))
        message.wall_sigma.append(wall.sigma_at(seconds))
        message.wall_drift.append(wall.drift)
        message.wall_drift_sigma.append(math.sqrt(float(wall.covariance[1, 1])))
        for crossing in wall.crossings:
            message.crossing_spacecraft.append(crossing.spacecraft)
            message.crossing_entry.append(crossing.is_entry)
            message.crossing_time.append(seconds - crossing.time)
            message.crossing_sigma.append(crossing.sigma)
            message.crossing_longitude_deg.append(_degrees(crossing.longitude))
            message.crossing_latitude_deg.append(math.degrees(crossing.latitude))
            message.crossing_altitude.append(crossing.altitude)
    for coming_crossing in coming:
        message.next_spacecraft.append(coming_crossing.spacecraft)
        message.next_wall.append(coming_crossing.wall)
        message.next_time.append(coming_crossing.time - seconds)
        message.next_sigma.append(coming_crossing.time_sigma)
    return message


def _degrees(longitude: float) -> float:
    """Return a longitude (rad) in deg, -180 to 180."""
    return (math.degrees(longitude) + 180.0) % 360.0 - 180.0


NODE_CLASS = SurveyGuidanceNode


def main() -> None:
    """Run the node."""
    run_node(SurveyGuidanceNode)
