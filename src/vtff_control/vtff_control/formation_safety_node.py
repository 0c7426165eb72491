"""Node `formation_safety`: stands between controllers and thrusters of a formation."""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from geometry_msgs.msg import AccelStamped

from vtff_control.safety.formation_safety import (
    MODE_EVADE,
    MODE_HOLD,
    MODE_WATCH,
    FormationSafety,
    SafetySetting,
    SafetyStep,
    SpacecraftDecision,
    SpacecraftInput,
    judge_synthetic_formation,
)
from vtff_control.thruster.isolation import isolation_bits
from vtff_dynamics.vectors import FloatArray, is_finite
from vtff_msgs.msg import FormationSafety as FormationSafetyMessage
from vtff_msgs.msg import RelativeState, ThrusterIsolation
from vtff_msgs.srv import ResetSafety
from vtff_node import diagnostics
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import REQUIRED, ParameterError, parameter
from vtff_node.stamps import StampOrder, to_nanoseconds, to_stamp

WATCH_INTERVAL = 0.05  # s of wall time between looks at a step that is not complete
START_WAIT = 25.0  # s of wall time in lockstep for the first step, in which nodes still prepare


@dataclass(frozen=True)
class FormationSafetyParameters:
    """Parameters of `formation_safety`."""

    chief: str = parameter("chief", "name of the chief")
    deputies: list[str] = parameter(REQUIRED, "names of the deputies")
    chief_thrusts: bool = parameter(
        False, "the chief has a thruster too: its commands are judged and its reports heard"
    )
    relative_state: str = parameter(
        "relative_state", "topic of the relative state in the namespace of each deputy"
    )
    hard_radius: float = parameter(
        SafetySetting.hard_radius, "no pair may come nearer", unit="m", minimum=0.001
    )
    margin: float = parameter(
        SafetySetting.margin, "added to it for the expected distance", unit="m", minimum=0.0
    )
    probability: float = parameter(
        SafetySetting.probability,
        "largest probability of a pair to be inside the hard radius",
        minimum=1e-15,
        maximum=0.4,
    )
    orbits: float = parameter(
        SafetySetting.orbits, "length of the prediction with thrust off", minimum=0.01
    )
    acceleration_cap: float = parameter(
        SafetySetting.acceleration_cap,
        "largest acceleration of the thrusters on each axis",
        unit="m/s^2",
        minimum=1e-9,
    )
    smallest_thrust: float = parameter(
        SafetySetting.smallest_thrust,
        "smallest acceleration of a thruster along an axis of the body, if its axes turn with it",
        unit="m/s^2",
        minimum=0.0,
    )
    velocity_limit: float = parameter(
        SafetySetting.velocity_limit,
        "largest change of the velocity by one evasive manoeuvre, on an axis",
        unit="m/s",
        minimum=0.0,
    )
    reaction_time: float = parameter(
        SafetySetting.reaction_time,
        "how much later than the next command an evasive manoeuvre must still work",
        unit="s",
        minimum=0.0,
    )
    thrust_share: float = parameter(
        SafetySetting.thrust_share,
        "share of the cap with which an evasive manoeuvre counts",
        minimum=0.01,
        maximum=1.0,
    )
    navigation_sigma: float = parameter(
        SafetySetting.navigation_sigma,
        "error of a position that covariances do not contain",
        unit="m",
        minimum=0.0,
    )
    thrust_sigma: float = parameter(
        SafetySetting.thrust_sigma,
        "relative error of reported thrust in a prediction without navigation",
        minimum=0.0,
    )
    step: float = parameter(SafetySetting.step, "length of a step", unit="s", minimum=0.001)
    delay_steps: int = parameter(
        SafetySetting.delay_steps,
        "whole steps between a command's stamp and its start",
        minimum=0,
        maximum=100,
    )
    wait: float = parameter(
        0.3,
        "outside lockstep, longest wait for a state or command of a step (wall time)",
        unit="s",
        minimum=0.0,
    )
    lockstep_wait: float = parameter(
        10.0,
        "the same in lockstep, where a node may be slow and nothing happens meanwhile; a third of "
        "it from the second step in a row on that lacks something",
        unit="s",
        minimum=0.0,
    )


@dataclass(eq=False)
class _Pending:
    """What has come for a step."""

    since: float
    states: dict[str, RelativeState]
    commands: dict[str, AccelStamped]


class FormationSafetyNode(VtffNode):
    """Safety monitor of a formation.

    Subscribes in the namespace of each deputy to relative_state (vtff_msgs/RelativeState),
    control/thrust_command and propulsion/thrust_applied (geometry_msgs/AccelStamped); publishes
    there control/thrust_command_checked, on which the thruster is to act, and
    propulsion/isolation (vtff_msgs/ThrusterIsolation); all but the state also for a chief that
    thrusts. Publishes /formation/safety (vtff_msgs/FormationSafety) every step. A command that may
    pass on is published as it came. A step is judged when all states, commands and reports of it
    have come, or a wait is over. The service /formation/safety/reset (vtff_msgs/ResetSafety) gives
    spacecraft back.
    """

    Parameters = FormationSafetyParameters

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("formation_safety", **node_arguments)
        given: FormationSafetyParameters = self.parameters
        try:
            self._safety = FormationSafety(
                given.chief, given.deputies, self._setting(), given.chief_thrusts
            )
        except ValueError as error:
            raise ParameterError(f"parameter {error}") from error
        # Those whose commands are judged.
        self._guarded = [*given.deputies, *([given.chief] if given.chief_thrusts else [])]
        self._pending: dict[int, _Pending] = {}
        self._reports: dict[str, dict[int, FloatArray]] = {}
        self._orders: dict[tuple[str, str], StampOrder] = {}
        self._unreported: dict[str, int] = {}
        self._decisions: dict[str, SpacecraftDecision] = {}
        self._told: dict[str, tuple[int, str]] = {}
        self._axes: dict[str, int] = {}
        self._judged = -1
        self._steps = 0
        self._incomplete = 0
        self._was_incomplete = False
        self._pair_text = "no relative state yet"
        self._command_publishers = {}
        self._isolation_publishers = {}
        for name in self._guarded:
            self._reports[name] = {}
            self._unreported[name] = 0
            self._axes[name] = 0
            self._command_publishers[name] = self.publisher(
                AccelStamped, f"/{name}/control/thrust_command_checked"
            )
            self._isolation_publishers[name] = self.publisher(
                ThrusterIsolation, f"/{name}/propulsion/isolation"
            )
            handlers: list[tuple[str, type, Callable[[str, int, Any], None]]] = [
                ("control/thrust_command", AccelStamped, self._on_command),
                ("propulsion/thrust_applied", AccelStamped, self._on_applied),
            ]
            if name in given.deputies:
                handlers.append((given.relative_state, RelativeState, self._on_state))
            for topic, message_type, callback in handlers:
                self._orders[name, topic] = StampOrder()
                self.subscribe(
                    message_type, f"/{name}/{topic}", self._ordered(name, topic, callback)
                )
        self._safety_publisher = self.publisher(FormationSafetyMessage, "/formation/safety")
        self.create_service(ResetSafety, "/formation/safety/reset", self._on_reset)
        self.create_timer(WATCH_INTERVAL, self._watch, clock=self.steady_clock)

    def warm_up(self) -> None:
        """Judge a synthetic formation with other monitors of the same setting."""
        with contextlib.suppress(ValueError):  # which the constructor names
            judge_synthetic_formation(self._setting())

    def _setting(self) -> SafetySetting:
        names = [field.name for field in dataclasses.fields(SafetySetting)]
        return SafetySetting(**{name: getattr(self.parameters, name) for name in names})

    # ---- what comes --------------------------------------------------------------------------

    def _ordered(
        self, name: str, topic: str, callback: Callable[[str, int, Any], None]
    ) -> Callable[[Any], None]:
        """Return a callback that takes each stamp of a topic once and in order."""
        order = self._orders[name, topic]

        def take(message: Any) -> None:
            stamp = to_nanoseconds(message.header.stamp)
            if order.accepts(stamp):
                callback(name, stamp, message)

        return take

    def _on_state(self, deputy: str, stamp: int, message: RelativeState) -> None:
        if not self.is_of_deputy(message, deputy, self.parameters.relative_state):
            return
        pending = self._of_step(stamp)
        if pending is not None:
            pending.states[deputy] = message
            self._judge_complete()

    def _on_command(self, name: str, stamp: int, message: AccelStamped) -> None:
        pending = self._of_step(stamp)
        if pending is not None:
            pending.commands[name] = message
            self._judge_complete()

    def _on_applied(self, name: str, stamp: int, message: AccelStamped) -> None:
        linear = message.accel.linear
        self._reports[name][stamp] = np.array([linear.x, linear.y, linear.z])
        self._unreported[name] = max(self._unreported[name] - 1, 0)
        self._judge_complete()

    def _of_step(self, stamp: int) -> _Pending | None:
        """Return what has come for a step; None if it, or a later one, is judged already."""
        if stamp <= self._judged:
            if self._judged - stamp < StampOrder.JUMP_BACK:
                return None
            # The run starts anew.
            self._pending.clear()
            self._judged = -1
            self._safety.reset()
        if stamp not in self._pending:
            self._pending[stamp] = _Pending(time.monotonic(), {}, {})
        return self._pending[stamp]

    # ---- what is decided ---------------------------------------------------------------------

    def _is_complete(self, pending: _Pending) -> bool:
        return all(name in pending.states for name in self.parameters.deputies) and all(
            name in pending.commands and not self._unreported[name] for name in self._guarded
        )

    def _judge_complete(self) -> None:
        """Judge all steps up to the newest that is complete."""
        complete = [stamp for stamp, pending in self._pending.items() if self._is_complete(pending)]
        for stamp in sorted(self._pending):
            if complete and stamp <= max(complete):
                self._was_incomplete = stamp not in complete
                self._judge(stamp)

    def _watch(self) -> None:
        """Judge steps for which something is too late; without commands thrust is off anyway."""
        wait = self.parameters.wait
        if self.lockstep:
            wait = self.parameters.lockstep_wait if self._steps else START_WAIT
            if self._was_incomplete:
                wait = min(wait, self.parameters.lockstep_wait / 3.0)
        for stamp in sorted(self._pending):
            if time.monotonic() - self._pending[stamp].since >= wait:
                self._incomplete += 1
                self._was_incomplete = True
                self._judge(stamp)

    def _judge(self, stamp: int) -> None:
        started = time.perf_counter()
        if stamp <= self._judged:  # its first message came after that of a later step
            del self._pending[stamp]
            self.acknowledge_step(to_stamp(stamp), started)
            return
        pending = self._pending.pop(stamp)
        self._judged = stamp
        self._steps += 1
        result = self._safety.step(
            {name: self._input(name, stamp, pending) for name in self._guarded}
        )
        self._decisions = result.decisions
        header_stamp = to_stamp(stamp)
        for name, decision in result.decisions.items():
            self._isolate(name, decision, stamp)
            self._tell(name, decision)
            command = pending.commands.get(name)
            if decision.command_rtn is not None:
                command = AccelStamped()
                command.header.stamp = header_stamp
                command.header.frame_id = f"{self.parameters.chief}/rtn"
                linear = command.accel.linear
                linear.x, linear.y, linear.z = decision.command_rtn.tolist()
            if command is not None:
                self._unreported[name] = 1
                self._command_publishers[name].publish(command)
        self._publish(stamp, result)
        self.acknowledge_step(header_stamp, started)

    def _input(self, name: str, stamp: int, pending: _Pending) -> SpacecraftInput:
        """Return what is known of a spacecraft at a step: its state, report and command."""
        reports = self._reports[name]
        reported = reports.get(stamp)
        for old in [key for key in reports if key <= stamp]:
            del reports[old]
        command = pending.commands.get(name)
        command_rtn = None
        if command is not None:
            linear = command.accel.linear
            command_rtn = np.array([linear.x, linear.y, linear.z])
            if not is_finite(command_rtn):
                command_rtn = None
        state = pending.states.get(name)
        navigated = SpacecraftInput() if state is None else _navigated(state)
        return dataclasses.replace(navigated, reported_rtn=reported, command_rtn=command_rtn)

    def _isolate(self, name: str, decision: SpacecraftDecision, stamp: int) -> None:
        """Send the isolation command of a spacecraft where it changes."""
        axes = isolation_bits(decision.isolated)
        if axes == self._axes[name]:
            return
        self._axes[name] = axes
        message = ThrusterIsolation(axes=axes)
        message.header.stamp = to_stamp(stamp)
        self._isolation_publishers[name].publish(message)

    def _tell(self, name: str, decision: SpacecraftDecision) -> None:
        """Log a take-over, once."""
        before, _ = self._told.get(name, (0, ""))
        self._told[name] = (decision.mode, decision.reason)
        if decision.mode >= MODE_EVADE > before:
            self.get_logger().error(f"{name} taken over: {decision.reason}")

    def _publish(self, stamp: int, result: SafetyStep) -> None:
        message = FormationSafetyMessage()
        message.header.stamp = to_stamp(stamp)
        message.header.frame_id = f"{self.parameters.chief}/rtn"
        message.hard_radius = self.parameters.hard_radius
        message.spacecraft = list(result.decisions)
        decisions = list(result.decisions.values())
        message.mode = [decision.mode for decision in decisions]
        message.isolated_axes = [isolation_bits(decision.isolated) for decision in decisions]
        message.reason = [decision.reason for decision in decisions]
        pairs = result.pairs
        message.first = [pair.first for pair in pairs]
        message.second = [pair.second for pair in pairs]
        message.separation = [pair.separation for pair in pairs]
        message.separation_time = [pair.separation_time for pair in pairs]
        message.separation_radial_normal = [pair.radial_normal for pair in pairs]
        message.sigmas = [pair.sigmas for pair in pairs]
        message.probability = [pair.probability for pair in pairs]
        message.violation_time = [pair.violation_time for pair in pairs]
        self._safety_publisher.publish(message)
        if pairs:
            nearest = min(pairs, key=lambda pair: pair.separation)
            self._pair_text = (
                f"{nearest.first}-{nearest.second} stay {nearest.separation:.1f} m apart "
                "with thrust off"
            )

    def _on_reset(
        self, request: ResetSafety.Request, response: ResetSafety.Response
    ) -> ResetSafety.Response:
        name = request.spacecraft
        if name and name not in self._guarded:
            response.message = f"unknown spacecraft '{name}'; guarded: {', '.join(self._guarded)}"
            return response
        self._safety.reset(name or None)
        self.get_logger().warning(f"{name or 'all spacecraft'} given back by a reset")
        response.success = True
        return response

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report the mode of every guarded spacecraft, and why."""
        return [self._spacecraft_health(name) for name in self._guarded]

    def _spacecraft_health(self, name: str) -> diagnostics.DiagnosticStatus:
        level, text = diagnostics.OK, self._pair_text
        decision = self._decisions.get(name)
        if decision is not None and decision.mode == MODE_WATCH:
            text = f"watching: {decision.reason}"
        elif decision is not None and decision.mode in (MODE_EVADE, MODE_HOLD):
            level = diagnostics.ERROR
            doing = "evading" if decision.mode == MODE_EVADE else "thrust off until a reset"
            text = f"taken over, {doing}: {decision.reason}"
        return diagnostics.status(
            f"{self.get_name()}: {name}",
            level,
            text,
            {
                "steps": self._steps,
                "steps judged with something missing": self._incomplete,
                "isolated axes": self._axes[name],
                "messages out of order": sum(
                    order.refused for (owner, _), order in self._orders.items() if owner == name
                ),
            },
            hardware_id=name,
        )


def _navigated(state: RelativeState) -> SpacecraftInput:
    """Return what is navigated of a deputy; nothing where the state is not usable."""
    if state.solution == RelativeState.SOLUTION_NONE:
        return SpacecraftInput()
    relative = np.concatenate((state.position, state.velocity))
    chief = np.concatenate((state.position_chief_gcrf, state.velocity_chief_gcrf))
    covariance = np.array(state.covariance).reshape(6, 6)
    if not all(map(is_finite, (relative, chief, covariance))):
        return SpacecraftInput()
    is_predicted = state.solution == RelativeState.SOLUTION_PREDICTED
    return SpacecraftInput(relative, covariance, chief, is_predicted=is_predicted)


NODE_CLASS = FormationSafetyNode


def main() -> None:
    """Run the node."""
    run_node(FormationSafetyNode)
