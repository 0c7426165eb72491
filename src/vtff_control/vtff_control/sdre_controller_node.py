"""Node `sdre_controller`: relative state in, thrust command out."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from geometry_msgs.msg import AccelStamped
from rosgraph_msgs.msg import Clock

from vtff_control.tracking.controller import (
    Controller,
    ControllerSetting,
    ControlResult,
    check_control_result,
    takes_covariance,
)
from vtff_control.tracking.feedforward import target_acceleration, velocity_at_rest
from vtff_control.tracking.navigation_bounds import sigma_reason, usable_covariance
from vtff_control.tracking.sdre import (
    DEFAULT_OPTIONS,
    DEFAULT_WEIGHTS,
    FEEDFORWARD_GRAVITY,
    SdreController,
    SdreDesign,
    stale_state_reason,
)
from vtff_dynamics.vectors import FloatArray
from vtff_msgs.msg import RelativeState
from vtff_node import diagnostics
from vtff_node.epoch_join import EpochJoin
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import parameter
from vtff_node.plugins.groups import CONTROLLERS
from vtff_node.plugins.loading import PluginError, plugin_names
from vtff_node.stamps import StampOrder, to_nanoseconds

SMALLEST_WEIGHT = 1e-12  # the Riccati equation needs positive weights
GUIDANCE_WAIT = 0.3  # s of wall time, outside lockstep
REFUSED = ControlResult(np.zeros(3), False, False)


def describe_weight(name: str) -> str:
    """Return the description of a weight of the cost, with the default of each design."""
    defaults = ", ".join(f"{d} {getattr(w, name):g}" for d, w in DEFAULT_WEIGHTS.items())
    quantity = "command" if name == "control" else f"{name} error"
    return f"weight of the {quantity} in the cost; without it that of the design ({defaults})"


def describe_option(name: str, meaning: str) -> str:
    """Return the description of an option of the designs, with those that have it."""
    defaults = (f"{d} {getattr(o, name):g}" for d, o in DEFAULT_OPTIONS.items() if getattr(o, name))
    return f"{meaning}; without it that of the design ({', '.join(defaults)}; others 0)"


@dataclass(frozen=True)
class SdreControllerParameters:
    """Parameters of `sdre_controller`."""

    deputy: str = parameter("deputy", "name of the spacecraft to control")
    design: str = parameter(
        SdreDesign.design,
        "controller, shipped or of an installed package (docs/plugins.md)",
        choices=plugin_names(CONTROLLERS.name),
    )
    feedforward: bool = parameter(
        SdreDesign.feedforward,
        "add the acceleration that holds the target in the eccentric, nonlinear frame",
    )
    feedforward_gravity: str = parameter(
        SdreDesign.feedforward_gravity,
        "gravity of the feedforward; should match the truth",
        choices=FEEDFORWARD_GRAVITY,
    )
    acceleration_cap: float = parameter(
        SdreDesign.acceleration_cap, "largest command on each axis", unit="m/s^2", minimum=1e-9
    )
    position_weight: float | None = parameter(
        None, describe_weight("position"), unit="1/m^2", minimum=SMALLEST_WEIGHT
    )
    velocity_weight: float | None = parameter(
        None, describe_weight("velocity"), unit="s^2/m^2", minimum=SMALLEST_WEIGHT
    )
    control_weight: float | None = parameter(
        None, describe_weight("control"), unit="s^4/m^2", minimum=SMALLEST_WEIGHT
    )
    sample_time: float = parameter(
        SdreDesign.sample_time, "interval between states", unit="s", minimum=0.001
    )
    delay_steps: int = parameter(
        SdreDesign.delay_steps,
        "samples between a state and the start of its thrust",
        minimum=0,
        maximum=100,
    )
    target_position_rtn: list[float] = parameter(
        [0.0, 100.0, 0.0], "wanted position until the topic target says otherwise", unit="m"
    )
    target_velocity_rtn: list[float] = parameter(
        [0.0, 0.0, 0.0], "wanted velocity in the rotating frame", unit="m/s"
    )
    tolerated_deviation: float | None = parameter(
        None,
        describe_option("tolerated_deviation", "deviation tolerated with perfect navigation"),
        unit="m",
        minimum=0.0,
    )
    braking_share: float | None = parameter(
        None,
        describe_option("braking_share", "share of the cap with which a far target is approached"),
        minimum=0.0,
        maximum=1.0,
    )
    quantum: float | None = parameter(
        None,
        describe_option("quantum", "smallest change of the thruster's acceleration"),
        unit="m/s^2",
        minimum=0.0,
    )
    maximum_sigma: float = parameter(
        SdreDesign.maximum_sigma,
        "largest sigma of a position that is tracked; beyond, the deputy brakes",
        unit="m",
        minimum=0.0,
    )
    maximum_sigma_ratio: float = parameter(
        SdreDesign.maximum_sigma_ratio,
        "the same in proportion to the distance from the chief",
        minimum=0.0,
    )
    maximum_lag: float = parameter(
        1.5,
        "outside lockstep, oldest state by /clock that is still acted on",
        unit="s",
        minimum=0.0,
    )
    guided: bool = parameter(
        False, "wait for the target and the feedforward that formation_guidance has for each state"
    )
    compute_limit: float = parameter(
        10.0, "longest wall time of one call of the controller", unit="s", minimum=0.001
    )

    def __post_init__(self) -> None:
        """Check the lengths of the target vectors."""
        for name in ("target_position_rtn", "target_velocity_rtn"):
            if len(getattr(self, name)) != 3:
                raise ValueError(f"parameter '{name}' needs three numbers (R, T, N)")


class SdreControllerNode(VtffNode):
    """Formation controller (SDRE): one command for every relative state.

    Stands in the namespace of its deputy. Subscribes to relative_state and target
    (vtff_msgs/RelativeState); publishes control/thrust_command (geometry_msgs/AccelStamped, m/s^2
    in chief/rtn, stamped with the time of the state it answers). A state that is stale, not finite
    or marked unusable gives zero thrust and a diagnostic; one that is repeated or out of order has
    been answered already and is reported. With guided:=true each state is answered with the target
    and the control/feedforward of its own time, which is added to the command. A prediction is
    acted on as far as its covariance allows. After a jump back in time control starts anew. A
    controller that fails, is too slow or answers with something unusable is named, its command is
    zero thrust and the node ends.
    """

    Parameters = SdreControllerParameters
    Plugins = CONTROLLERS

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("sdre_controller", **node_arguments)
        given: SdreControllerParameters = self.parameters
        self.plugin.call_limit = given.compute_limit
        self.plugin.sample_time = given.sample_time
        self._controller: Controller = self.plugin.make(
            ControllerSetting(
                sample_time=given.sample_time,
                delay_steps=given.delay_steps,
                acceleration_cap=given.acceleration_cap,
                feedforward=given.feedforward,
                feedforward_gravity=given.feedforward_gravity,
                position_weight=given.position_weight,
                velocity_weight=given.velocity_weight,
                control_weight=given.control_weight,
                tolerated_deviation=given.tolerated_deviation,
                braking_share=given.braking_share,
                quantum=given.quantum,
                maximum_sigma=given.maximum_sigma,
                maximum_sigma_ratio=given.maximum_sigma_ratio,
            ),
            self.plugin_parameters,
        )
        self._takes_covariance = takes_covariance(self._controller)
        if not self._takes_covariance:
            self.get_logger().info(
                f"design '{given.design}' takes no covariance: thrust is zero where sigma is above "
                f"{given.maximum_sigma:g} m or {given.maximum_sigma_ratio:g} of the distance"
            )
        self._target = np.array([*given.target_position_rtn, *given.target_velocity_rtn])
        self._result = REFUSED
        self._reason = "no relative state yet"
        self._refused = 0
        self._order = StampOrder()
        self._frame = ""  # that of the relative states
        self._now_nanoseconds: int | None = None
        self._command = AccelStamped()
        self._publisher = self.publisher(AccelStamped, "control/thrust_command")
        self._guided: EpochJoin | None = None
        self._newest_guided = 0
        if given.guided:
            patience = math.inf if self.lockstep else GUIDANCE_WAIT
            self._guided = EpochJoin(("state", "target", "feedforward"), patience)
            self.subscribe(AccelStamped, "control/feedforward", self._on_feedforward)
            if not self.lockstep:
                self.create_timer(GUIDANCE_WAIT, self._answer_guided, clock=self.steady_clock)
        self.subscribe(RelativeState, "relative_state", self._on_relative_state)
        # Without a publisher the target stays that of the parameters.
        self.subscribe(RelativeState, "target", self._on_target, required=given.guided)
        if not self.lockstep:
            # In lockstep no state can be old: nobody goes on before it is answered.
            self.subscribe(Clock, "/clock", self._on_clock)

    def warm_up(self) -> None:
        """Compute a feedforward, which all shipped controllers do."""
        chief = np.array([7.0e6, 0.0, 0.0, 0.0, 7.5e3, 0.0])
        target_acceleration(chief, np.zeros(6), 1, 1.0, 0.0)
        velocity_at_rest(chief, np.zeros(3), 0.0)

    def _on_clock(self, message: Clock) -> None:
        self._now_nanoseconds = to_nanoseconds(message.clock)

    def _on_target(self, message: RelativeState) -> None:
        if self._guided is None:
            self._take_target(message)
        else:
            self._join("target", message)

    def _on_feedforward(self, message: AccelStamped) -> None:
        self._join("feedforward", message)

    def _join(self, source: str, message: Any) -> None:
        """Keep what belongs to a state until all of it is here."""
        assert self._guided is not None
        stamp = to_nanoseconds(message.header.stamp)
        if self._newest_guided - stamp >= StampOrder.JUMP_BACK:
            self._guided.restart()
        self._newest_guided = stamp
        self._guided.add(source, stamp, message, time.monotonic())
        self._answer_guided()

    def _answer_guided(self) -> None:
        """Answer the states whose target and feedforward are here, or awaited in vain."""
        assert self._guided is not None
        while (epoch := self._guided.take(time.monotonic())) is not None:
            measured = epoch.measured
            if "target" in measured:
                self._take_target(measured["target"])
            thrust = None
            if "feedforward" in measured:
                linear = measured["feedforward"].accel.linear
                thrust = np.array([linear.x, linear.y, linear.z])
            if "state" in measured:
                self._answer(measured["state"], thrust)

    def _take_target(self, message: RelativeState) -> None:
        if not self.is_of_deputy(message, self.parameters.deputy, "target"):
            return
        target = np.concatenate((message.position, message.velocity))
        frame = message.header.frame_id
        if not frame.endswith("/rtn") or (self._frame and frame != self._frame):
            self.get_logger().warning(
                f"target of {self.parameters.deputy} is in frame '{frame}', not in "
                f"'{self._frame or '<chief>/rtn'}': ignored",
                throttle_duration_sec=5.0,
            )
        elif np.all(np.isfinite(target)):
            self._target = target
        else:
            self.get_logger().warning("ignored a target that is not finite")

    def _on_relative_state(self, message: RelativeState) -> None:
        if self._guided is None:
            self._answer(message, None)
        else:
            self._join("state", message)

    def _answer(self, message: RelativeState, feedforward: FloatArray | None) -> None:
        """Publish the command for a state, with a feedforward in RTN, m/s2, shape (3,)."""
        started = time.perf_counter()
        deputy = self.parameters.deputy
        if self.finished or not self.is_of_deputy(message, deputy, "relative_state"):
            return
        self._frame = message.header.frame_id
        stamp = to_nanoseconds(message.header.stamp)
        if not self._order.accepts(stamp):
            return
        plugin_problem = ""
        try:
            self._result, self._reason = self._control(message, stamp)
        except PluginError as error:
            plugin_problem = str(error)
            self._result, self._reason = REFUSED, plugin_problem
        self._refused += not self._result.valid
        linear = self._command.accel.linear
        command = self._result.acceleration_rtn
        if self._result.valid and feedforward is not None and feedforward.any():
            cap = self.parameters.acceleration_cap
            command = np.clip(command + feedforward, -cap, cap)
        linear.x, linear.y, linear.z = command.tolist()
        self._command.header.stamp = message.header.stamp
        self._command.header.frame_id = message.header.frame_id
        self._publisher.publish(self._command)
        if plugin_problem:
            self.fail(plugin_problem)
            return
        self.acknowledge_step(message.header.stamp, started)

    def _control(self, message: RelativeState, stamp: int) -> tuple[ControlResult, str]:
        if message.solution == RelativeState.SOLUTION_NONE:
            self._reset()
            return REFUSED, "navigation has no solution"
        if self._now_nanoseconds is not None:
            maximum_lag = self.parameters.maximum_lag
            reason = stale_state_reason(stamp, self._now_nanoseconds, maximum_lag)
            if reason:
                self._reset()
                return REFUSED, reason
        relative_state = np.concatenate((message.position, message.velocity))
        covariance: list[FloatArray | None] = [None]
        if message.solution != RelativeState.SOLUTION_TRUTH:
            covariance = [np.array(message.covariance).reshape(6, 6)]
        if not self._takes_covariance:
            reason = self._bounds_reason(relative_state, *covariance)
            if reason:
                self._reset()
                return REFUSED, reason
            covariance = []
        result = self.plugin.call(
            self._controller.control,
            relative_state,
            np.concatenate((message.position_chief_gcrf, message.velocity_chief_gcrf)),
            self._target,
            stamp,
            *covariance,
            check=check_control_result,
        )
        return result, result.reason

    def _bounds_reason(self, relative_state: FloatArray, covariance: FloatArray | None) -> str:
        """Return why a controller that knows no covariance may not act; empty if it may."""
        if covariance is None:
            return ""
        given = self.parameters
        try:
            return sigma_reason(
                relative_state,
                usable_covariance(covariance),
                given.maximum_sigma,
                given.maximum_sigma_ratio,
            )
        except ValueError as error:
            return str(error)

    def _reset(self) -> None:
        self.plugin.call(self._controller.reset)

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report whether commands are valid, and why not."""
        valid = self._result.valid
        text = "controlling" if valid else f"zero thrust: {self._reason}"
        if self._result.degraded:
            valid, text = False, f"braking, not tracking: {self._result.degraded}"
        if self._order.refused_since_last_look():
            valid, text = False, f"states came out of order; {text}"
        return [
            diagnostics.status(
                "sdre_controller: command",
                diagnostics.OK if valid else diagnostics.WARN,
                text,
                {
                    "design": self.parameters.design,
                    "saturated": self._result.saturated,
                    "states refused": self._refused,
                    "states out of order": self._order.refused,
                    **(
                        {"gain solutions": self._controller.gain_solutions}
                        if isinstance(self._controller, SdreController)
                        else {}
                    ),
                },
                hardware_id=self.parameters.deputy,
            )
        ]


NODE_CLASS = SdreControllerNode


def main() -> None:
    """Run the node."""
    run_node(SdreControllerNode)
