"""Node `thrust_allocation`: commands in RTN to thrusters that are fixed in the body."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import AccelStamped

from vtff_control.thruster.body_axes import BodyAxes, KnownAttitude
from vtff_control.thruster.isolation import isolation_bits
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray, is_finite
from vtff_msgs.msg import AttitudeState, RelativeState, ThrusterIsolation
from vtff_node import diagnostics
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import parameter
from vtff_node.stamps import StampOrder, to_nanoseconds

_OPEN_THRUSTS = 120
"""Largest number of thrusts that are kept until the thruster reports them."""


class _OpenThrust(NamedTuple):
    """A thrust that was commanded and not reported yet.

    Attributes
    ----------
    command_stamp
        Stamp of its command, which names the step.
    started
        ``time.perf_counter()`` when the work on the step began.
    rotation
        From RTN to the body at its start, shape (3, 3); None without attitude.
    """

    command_stamp: Any
    started: float
    rotation: FloatArray | None


@dataclass(frozen=True)
class ThrustAllocationParameters:
    """Parameters of `thrust_allocation`."""

    spacecraft: str = parameter("deputy", "spacecraft whose thrusters these are")
    delay_steps: int = parameter(
        1, "whole steps between a command's stamp and its start, as the thruster has it", minimum=0
    )
    step: float = parameter(1.0, "length of a step", unit="s", minimum=0.001)
    longest_attitude_age: float = parameter(
        60.0, "age beyond which an attitude no longer counts", unit="s", minimum=0.0
    )


class ThrustAllocationNode(VtffNode):
    """Stands between the commands of a formation and the thrusters of a body; in its namespace.

    Subscribes to control/thrust_command (geometry_msgs/AccelStamped, m/s^2 in chief/rtn),
    relative_state (the orbit of the chief) and attitude; publishes control/thrust_command_body, the
    same along the axes of the body at the start of the thrust by the estimated attitude. What the
    thruster reports on propulsion/thrust_body goes back by the same rotation to
    propulsion/thrust_applied, in chief/rtn. Without attitude there is no thrust. An isolation of an
    axis of RTN names no thruster of a body that turns: all are isolated.
    """

    Parameters = ThrustAllocationParameters

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("thrust_allocation", **node_arguments)
        given: ThrustAllocationParameters = self.parameters
        self._delay = given.delay_steps * round(given.step * NANOSECONDS_PER_SECOND)
        self._axes = BodyAxes(given.longest_attitude_age)
        self._order = StampOrder()
        self._waiting: list[AccelStamped] = []
        self._orbit_stamp = -1
        self._open: dict[int, _OpenThrust] = {}  # by the start of the thrust, ns
        self._frame = ""
        self._counts = {"commands": 0, "without attitude": 0, "reports not understood": 0}
        self._isolated = 0
        self._command_publisher = self.publisher(AccelStamped, "control/thrust_command_body")
        self._applied_publisher = self.publisher(AccelStamped, "propulsion/thrust_applied")
        self._isolation_publisher = self.publisher(ThrusterIsolation, "propulsion/isolation_body")
        self.subscribe(AttitudeState, "attitude", self._on_attitude)
        self.subscribe(RelativeState, "relative_state", self._on_relative_state)
        self.subscribe(AccelStamped, "control/thrust_command", self._on_command)
        self.subscribe(AccelStamped, "propulsion/thrust_body", self._on_thrust)
        # formation_safety sends isolations; without that node nothing is ever isolated.
        self.subscribe(
            ThrusterIsolation,
            "propulsion/isolation",
            self._on_isolation,
            latched=True,
            required=False,
        )

    # ---- input -------------------------------------------------------------------------------

    def _on_attitude(self, message: AttitudeState) -> None:
        quaternion, rate = np.array(message.quaternion), np.array(message.rate_body)
        self._axes.add_attitude(
            KnownAttitude(
                to_nanoseconds(message.header.stamp),
                message.valid and is_finite(quaternion) and is_finite(rate),
                quaternion,
                rate,
            )
        )

    def _on_relative_state(self, message: RelativeState) -> None:
        stamp = to_nanoseconds(message.header.stamp)
        state = np.concatenate((message.position_chief_gcrf, message.velocity_chief_gcrf))
        if is_finite(state) and state[:3].any() and state[3:].any():
            self._axes.add_chief(stamp, state)
        self._orbit_stamp = stamp
        self._work()

    def _on_command(self, message: AccelStamped) -> None:
        if not self._order.accepts(to_nanoseconds(message.header.stamp)):
            return
        self._waiting.append(message)
        self._work()

    def _on_isolation(self, message: ThrusterIsolation) -> None:
        self._isolated = isolation_bits(np.ones(3)) if message.axes else 0
        self._isolation_publisher.publish(
            ThrusterIsolation(header=message.header, axes=self._isolated)
        )

    # ---- work --------------------------------------------------------------------------------

    def _work(self) -> None:
        """Turn the commands whose orbit has come; in real time the newest orbit serves."""
        while self._waiting:
            stamp = to_nanoseconds(self._waiting[0].header.stamp)
            if self.lockstep and self._orbit_stamp < stamp:
                return
            self._turn(self._waiting.pop(0), stamp)

    def _turn(self, message: AccelStamped, stamp: int) -> None:
        started = time.perf_counter()
        start = stamp + self._delay
        rotation = self._axes.rotation_from_rtn(stamp, start)
        self._open[start] = _OpenThrust(message.header.stamp, started, rotation)
        while len(self._open) > _OPEN_THRUSTS:
            del self._open[next(iter(self._open))]
        self._counts["commands"] += 1
        self._counts["without attitude"] += rotation is None
        self._frame = message.header.frame_id
        wanted = message.accel.linear
        thrust = np.zeros(3)
        if rotation is not None:
            thrust = rotation @ np.array([wanted.x, wanted.y, wanted.z])
        frame = f"{self.parameters.spacecraft}/body"
        self._command_publisher.publish(_acceleration(message.header.stamp, frame, thrust))

    def _on_thrust(self, message: AccelStamped) -> None:
        """Publish the thrust of the body along the axes of the orbit."""
        commanded = self._open.pop(to_nanoseconds(message.header.stamp), None)
        given = message.accel.linear
        thrust = np.array([given.x, given.y, given.z])
        if commanded is not None and commanded.rotation is not None:
            thrust = commanded.rotation.T @ thrust
        elif thrust.any():
            # A thrust that nobody commanded, or a thruster that is stuck, in a direction that is
            # not known.
            self._counts["reports not understood"] += 1
            thrust = np.zeros(3)
        applied = _acceleration(message.header.stamp, self._frame, thrust)
        self._applied_publisher.publish(applied)
        if commanded is not None:
            self.acknowledge_step(commanded.command_stamp, commanded.started)

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report why there is no thrust, if there is none."""
        level, text = diagnostics.OK, "thrust along the axes of the body"
        if not self._counts["commands"]:
            text = "no command yet"
        elif self._isolated:
            level, text = diagnostics.WARN, "all thrusters isolated"
        elif self._axes.reason:
            level, text = diagnostics.WARN, f"no thrust: {self._axes.reason}"
        return [
            diagnostics.status(
                f"{self.get_name()}: thrust",
                level,
                text,
                self._counts,
                hardware_id=self.parameters.spacecraft,
            )
        ]


def _acceleration(stamp: Any, frame_id: str, acceleration: FloatArray) -> AccelStamped:
    """Return the message of an acceleration, m/s2, shape (3,)."""
    message = AccelStamped()
    message.header.stamp = stamp
    message.header.frame_id = frame_id
    linear = message.accel.linear
    linear.x, linear.y, linear.z = (acceleration + 0.0).tolist()  # no negative zeros
    return message


NODE_CLASS = ThrustAllocationNode


def main() -> None:
    """Run the node."""
    run_node(ThrustAllocationNode)
