"""Node `laser_emulator`: the laser range between two spacecraft, from their true motion."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

from vtff_msgs.msg import LaserRange, RelativeState
from vtff_node import diagnostics
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import parameter
from vtff_node.stamps import to_nanoseconds
from vtff_sim_bridge.laser.laser_ranging import LaserRanging


@dataclass(frozen=True)
class LaserEmulatorParameters:
    """Parameters of `laser_emulator`."""

    deputy: str = parameter("deputy", "spacecraft at the other end of the laser")
    latency: float = parameter(
        -5.15e-3, "kappa of paper 004: measured = range + latency * range rate", unit="s"
    )
    range_sigma: float = parameter(1e-4, "white noise", unit="m", minimum=0.0)
    maximum_range: float = parameter(20e3, "no echo from further away", unit="m", minimum=0.0)
    seed: int = parameter(1, "seed of the noise", minimum=0)


class LaserEmulatorNode(VtffNode):
    """Laser ranging instrument between the chief and one deputy, as in paper 004.

    Stands in the namespace of the deputy: subscribes to relative_state_truth
    (vtff_msgs/RelativeState) and publishes laser_range (vtff_msgs/LaserRange) with the same stamp.
    """

    Parameters = LaserEmulatorParameters

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("laser_emulator", **node_arguments)
        given: LaserEmulatorParameters = self.parameters
        self._laser = LaserRanging(
            given.latency, given.range_sigma, given.maximum_range, given.seed, given.deputy
        )
        self._measured = {"ranges": 0, "without echo": 0}
        self._publisher = self.publisher(LaserRange, "laser_range")
        self.subscribe(RelativeState, "relative_state_truth", self._on_truth)

    def _on_truth(self, message: RelativeState) -> None:
        if not self.is_of_deputy(message, self.parameters.deputy, "relative_state_truth"):
            return
        started = time.perf_counter()
        stamp = to_nanoseconds(message.header.stamp)
        measured = self._laser.measure(stamp, message.position, message.velocity)
        valid = math.isfinite(measured)
        self._measured["ranges" if valid else "without echo"] += 1
        self._publisher.publish(
            LaserRange(
                header=message.header,
                range=measured,
                range_sigma=self._laser.range_sigma,
                valid=valid,
                child_frame_id=message.child_frame_id,
            )
        )
        self.acknowledge_step(message.header.stamp, started)

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report how many ranges were measured."""
        return [
            diagnostics.status(
                f"{self.get_name()}: laser", diagnostics.OK, "ranging", dict(self._measured)
            )
        ]


NODE_CLASS = LaserEmulatorNode


def main() -> None:
    """Run the node."""
    run_node(LaserEmulatorNode)
