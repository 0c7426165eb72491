"""Node `on_board_emulator`: what a spacecraft sees by itself, emulated from the truth."""

from __future__ import annotations

import dataclasses
import functools
import math
import time
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion

from vtff_dynamics.time.timescales import GpsTime
from vtff_msgs.msg import GnssFix, OrbitState
from vtff_node import diagnostics
from vtff_node.conversions.gnss import fix_to_message
from vtff_node.epoch_join import EpochJoin, JoinedEpoch
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import REQUIRED, ParameterError, parameter
from vtff_node.stamps import StampOrder, to_nanoseconds, to_stamp
from vtff_sim_bridge.on_board.own_fix import FixErrors, OwnFixEmulation
from vtff_sim_bridge.on_board.range_sensor import RangeSensor, RangeSensorEmulation

_PATIENCE = 0.3  # s of wall time for a late truth, outside lockstep


@dataclass(frozen=True)
class OnBoardEmulatorParameters:
    """Parameters of `on_board_emulator`."""

    spacecraft: str = parameter(REQUIRED, "spacecraft that carries the sensors")
    chief: str = parameter("chief", "name of the chief")
    deputies: list[str] = parameter(REQUIRED, "names of the deputies")
    seed: int = parameter(1, "seed of the errors", minimum=0)
    range_limit: float = parameter(
        RangeSensor.range_limit, "no neighbour is seen from further away", unit="m", minimum=0.0
    )
    range_sigma: float = parameter(
        RangeSensor.range_sigma, "white noise of a range", unit="m", minimum=0.0
    )
    direction_sigma: float = parameter(
        RangeSensor.direction_sigma,
        "white noise of a direction on each axis",
        unit="rad",
        minimum=0.0,
    )
    dropout: float = parameter(
        RangeSensor.dropout, "probability that a detection is missing", minimum=0.0, maximum=1.0
    )
    misalignment_sigma: float = parameter(
        RangeSensor.misalignment_sigma,
        "slow error of the attitude that directions refer to, on each axis",
        unit="rad",
        minimum=0.0,
    )
    misalignment_time: float = parameter(
        RangeSensor.misalignment_time, "its correlation time", unit="s", minimum=1e-3
    )
    outage: list[float] = parameter(
        [], "start and end of a failure of the sensor after the start; empty for none", unit="s"
    )
    emulates_fix: bool = parameter(True, "publish gnss/fix too, where no receiver does")
    fix_position_sigma: float = parameter(
        FixErrors.position_sigma, "slow error of the fix on each axis", unit="m", minimum=0.0
    )
    fix_correlation_time: float = parameter(
        FixErrors.correlation_time, "its correlation time", unit="s", minimum=1e-3
    )
    fix_velocity_sigma: float = parameter(
        FixErrors.velocity_sigma,
        "white noise of the velocity of the fix on each axis",
        unit="m/s",
        minimum=0.0,
    )

    def __post_init__(self) -> None:
        """Check the length of the list."""
        if len(self.outage) not in (0, 2):
            raise ValueError("parameter 'outage' needs two numbers (start, end) or none")


class OnBoardEmulatorNode(VtffNode):
    """Sensors of one spacecraft that hears no message of the others; stands in its namespace.

    Subscribes to /<spacecraft>/truth/orbit of all spacecraft. Publishes neighbours
    (geometry_msgs/PoseArray in <spacecraft>/rtn: the positions that a sensor of range and direction
    detects, nearest first and without names; orientations mean nothing) and, with emulates_fix,
    gnss/fix (GnssFix), both with the stamp of the truth. A sensor that has failed publishes an
    empty array.
    """

    Parameters = OnBoardEmulatorParameters

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("on_board_emulator", **node_arguments)
        given: OnBoardEmulatorParameters = self.parameters
        names = (given.chief, *given.deputies)
        if given.spacecraft not in names:
            raise ParameterError(
                f"parameter 'spacecraft': one of {', '.join(names)} expected, "
                f"got '{given.spacecraft}'"
            )
        values = {
            field.name: getattr(given, field.name)
            for field in dataclasses.fields(RangeSensor)
            if field.name != "outage"
        }
        if given.outage:
            values["outage"] = tuple(given.outage)
        sensor = RangeSensor(**values)
        errors = FixErrors(
            given.fix_position_sigma, given.fix_correlation_time, given.fix_velocity_sigma
        )
        self._sensor = RangeSensorEmulation(sensor, given.spacecraft, given.seed)
        self._fix = OwnFixEmulation(errors, given.spacecraft, given.seed)
        self._start: int | None = None
        self._newest = 0
        self._counts = {"looks": 0, "detections": 0}
        self._join = EpochJoin(names, math.inf if self.lockstep else _PATIENCE)
        self._neighbours = self.publisher(PoseArray, "neighbours")
        self._fixes = self.publisher(GnssFix, "gnss/fix") if given.emulates_fix else None
        for name in names:
            self.subscribe(
                OrbitState, f"/{name}/truth/orbit", functools.partial(self._on_orbit, name)
            )

    def _on_orbit(self, name: str, message: OrbitState) -> None:
        stamp = to_nanoseconds(message.header.stamp)
        if self._newest - stamp >= StampOrder.JUMP_BACK:
            self._join.restart()
            self._start = None
        self._newest = stamp
        self._join.add(name, stamp, message, time.monotonic())
        epoch = self._join.take(time.monotonic())
        while epoch is not None:
            self._look(epoch)
            epoch = self._join.take(time.monotonic())

    def _look(self, epoch: JoinedEpoch) -> None:
        started = time.perf_counter()
        stamp = epoch.stamp_nanoseconds
        if self._start is None:
            self._start = stamp
        elapsed = stamp - self._start
        others = {
            name: np.concatenate((message.position, message.velocity))
            for name, message in epoch.measured.items()
        }
        own = others.pop(self.parameters.spacecraft, None)
        if own is not None:
            seen = self._sensor.detect(elapsed, own, others)
            self._counts["looks"] += 1
            self._counts["detections"] += len(seen)
            # The fix first: who waits for both has it when the detections come.
            if self._fixes is not None:
                fix = self._fix.fix(GpsTime.from_unix_nanoseconds(stamp), elapsed, own)
                self._fixes.publish(fix_to_message(fix))
            message = PoseArray(
                poses=[
                    Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(w=1.0))
                    for x, y, z in seen.tolist()
                ]
            )
            message.header.stamp = to_stamp(stamp)
            message.header.frame_id = f"{self.parameters.spacecraft}/rtn"
            self._neighbours.publish(message)
        self.acknowledge_step(to_stamp(stamp), started)

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report how often the sensor has looked, and what it has seen."""
        return [
            diagnostics.status(
                f"{self.get_name()}: sensor",
                diagnostics.OK,
                "emulated from the truth",
                dict(self._counts),
                hardware_id=self.parameters.spacecraft,
            )
        ]


NODE_CLASS = OnBoardEmulatorNode


def main() -> None:
    """Run the node."""
    run_node(OnBoardEmulatorNode)
