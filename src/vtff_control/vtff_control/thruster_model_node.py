"""Node `thruster_model`: a thruster without a bus, with delay, cap and quantum (impulse bit)."""

from __future__ import annotations

import time
from dataclasses import dataclass

from geometry_msgs.msg import AccelStamped

from vtff_control.thruster.isolation import isolated_axes, isolated_text
from vtff_control.thruster.late_commands import LateCommands
from vtff_control.thruster.thruster import Thruster
from vtff_msgs.msg import ThrusterIsolation
from vtff_node import diagnostics
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import parameter
from vtff_node.stamps import StampOrder, to_nanoseconds, to_stamp


@dataclass(frozen=True)
class ThrusterModelParameters:
    """Parameters of `thruster_model`."""

    acceleration_cap: float = parameter(
        1.0, "largest acceleration on each axis", unit="m/s^2", minimum=1e-9
    )
    quantum: float = parameter(
        0.0, "smallest change of the acceleration, 0 = continuous", unit="m/s^2", minimum=0.0
    )
    delay_steps: int = parameter(
        1, "whole steps between a command's stamp and its start", minimum=0, maximum=100
    )
    step: float = parameter(1.0, "length of a step", unit="s", minimum=0.001)
    stuck_acceleration: list[float] = parameter(
        [0.0, 0.0, 0.0],
        "a fault: what R, T, N give whatever is commanded; an axis of 0 is healthy",
        unit="m/s^2",
    )
    stuck_after: float = parameter(
        0.0, "when that fault begins, after the first thrust", unit="s", minimum=0.0
    )

    def __post_init__(self) -> None:
        """Check the length of the vector."""
        if len(self.stuck_acceleration) != 3:
            raise ValueError("parameter 'stuck_acceleration' needs three numbers (R, T, N)")


class ThrusterModelNode(VtffNode):
    """Thruster of one spacecraft, run in its namespace.

    Subscribes to control/thrust_command and publishes propulsion/thrust_applied (both
    geometry_msgs/AccelStamped, m/s^2 in chief/rtn). The stamp of thrust_applied is the time at
    which the thrust starts; it acts for one step. Without a command there is no thrust. In real
    time a command whose step is over when it comes is refused.
    """

    Parameters = ThrusterModelParameters

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("thruster", **node_arguments)
        given: ThrusterModelParameters = self.parameters
        self._thruster = Thruster(
            given.acceleration_cap,
            given.quantum,
            given.delay_steps,
            given.step,
            given.stuck_acceleration,
            given.stuck_after,
        )
        self._applied = AccelStamped()
        self._commands = 0
        self._saturated = 0
        self._refused = 0
        self._order = StampOrder()
        # After its step a command could only act in place of a newer one.
        self._late_commands = LateCommands((given.delay_steps + 1) * given.step)
        self._reason = ""
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

    def _on_isolation(self, message: ThrusterIsolation) -> None:
        self._thruster.isolated = isolated_axes(message.axes)

    def _on_command(self, message: AccelStamped) -> None:
        started = time.perf_counter()
        stamp = to_nanoseconds(message.header.stamp)
        if not self._order.accepts(stamp):
            return
        if not self.lockstep and self._late_commands.is_too_late(stamp):
            return
        wanted = message.accel.linear
        thrust = self._thruster.command(stamp, (wanted.x, wanted.y, wanted.z))
        self._commands += 1
        self._saturated += thrust.saturated
        self._refused += bool(thrust.reason)
        self._reason = thrust.reason
        linear = self._applied.accel.linear
        linear.x, linear.y, linear.z = thrust.acceleration_rtn.tolist()
        self._applied.header.frame_id = message.header.frame_id
        self._applied.header.stamp = to_stamp(thrust.start_stamp)
        self._publisher.publish(self._applied)
        self.acknowledge_step(message.header.stamp, started)

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report commands, saturation and refusals."""
        refused = self._order.refused_since_last_look()
        out_of_order = "commands came out of order" if refused else ""
        if self._thruster.isolated.any():
            out_of_order = f"axes isolated: {isolated_text(self._thruster.isolated)}"
        return [
            diagnostics.status(
                f"{self.get_name()}: thrust",
                diagnostics.WARN if self._reason or out_of_order else diagnostics.OK,
                self._reason or out_of_order or self._state(),
                {
                    "commands": self._commands,
                    "saturated": self._saturated,
                    "refused": self._refused,
                    "out of order": self._order.refused,
                    "too late": self._late_commands.refused,
                },
                hardware_id=self.get_namespace().strip("/"),
            )
        ]

    def _state(self) -> str:
        return "thrusting" if self._commands else "no command yet"


NODE_CLASS = ThrusterModelNode


def main() -> None:
    """Run the node."""
    run_node(ThrusterModelNode)
