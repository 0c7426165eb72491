"""Node `cluster_guidance`: one chaser of a cluster, which decides alone and hears no other one."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import AccelStamped, PoseArray

from vtff_control.cluster.cluster_member import ClusterMember, MemberSetting
from vtff_control.cluster.elements_field import SHAPES, ElementsField
from vtff_control.cluster.neighbour_tracker import NeighbourTracker
from vtff_control.cluster.potential_field import PotentialField
from vtff_control.cluster.timeline import MemberTimeline
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.earth import state_itrf_to_gcrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_msgs.msg import GnssFix
from vtff_node import diagnostics
from vtff_node.epoch_join import EpochJoin, JoinedEpoch
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import REQUIRED, ParameterError, parameter
from vtff_node.stamps import StampOrder, to_nanoseconds, to_stamp

_FIX, _NEIGHBOURS = "gnss/fix", "neighbours"


@dataclass(frozen=True)
class ClusterGuidanceParameters:
    """Parameters of `cluster_guidance`."""

    chief: str = parameter("chief", "name of the chief, in whose RTN axes thrusters take commands")
    station_period: float = parameter(
        REQUIRED, "nodal period of the station that the cluster keeps", unit="s", minimum=1.0
    )
    timeline: list[str] = parameter(
        ["0 gather"],
        "modes, each 'TIME MODE', time in s after the first fix: gather (at rest in the rotating "
        "frame), orbits (held by relative orbital elements, from a cluster that has gathered), "
        "free_drift",
    )
    shape: str = parameter(
        ElementsField.shape, "in the mode orbits: how members go round each other", choices=SHAPES
    )
    sample_time: float = parameter(10.0, "interval between fixes", unit="s", minimum=0.001)
    delay_steps: int = parameter(
        1, "samples between a look and the start of the thrust that answers it", minimum=0
    )
    decision_interval: float = parameter(
        MemberSetting.decision_interval, "between two thrusts", unit="s", minimum=0.001
    )
    largest_acceleration: float = parameter(
        MemberSetting.largest_acceleration, "of the thruster on an axis", unit="m/s^2", minimum=1e-9
    )
    watch_from: float = parameter(
        10800.0,
        "after this time a neighbour that leaves the station is followed no more; before, members "
        "still come from afar",
        unit="s",
        minimum=0.0,
    )
    transfer_time: float = parameter(
        PotentialField.transfer_time, "in which a step is made", unit="s", minimum=1.0
    )
    longest_step: float = parameter(
        PotentialField.longest_step, "longest step", unit="m", minimum=1e-3
    )
    range_sigma: float = parameter(
        0.3, "noise of the sensor's range, as its maker states it", unit="m", minimum=1e-6
    )
    direction_sigma: float = parameter(
        2e-4, "noise of the sensor's direction, as its maker states it", unit="rad", minimum=1e-9
    )
    wait: float = parameter(
        0.3, "outside lockstep, longest wait for a late look", unit="s", minimum=0.0
    )


class ClusterGuidanceNode(VtffNode):
    """Guidance of one chaser of a cluster; stands in its namespace.

    Subscribes to gnss/fix (GnssFix, its own) and neighbours (geometry_msgs/PoseArray: positions
    that its own sensor detects, in the own RTN axes, without names), and to nothing of the others.
    Publishes control/thrust_command (geometry_msgs/AccelStamped, m/s2). The command is in the own
    RTN axes and sent as in those of the chief: the two differ by less than a milliradian for each
    6 km. Without a fix there is no thrust; without detections tracks go on, and after two minutes
    the chaser coasts, or waits where orbits hold the cluster.
    """

    Parameters = ClusterGuidanceParameters

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("cluster_guidance", **node_arguments)
        given: ClusterGuidanceParameters = self.parameters
        try:
            self._timeline = MemberTimeline.read(given.timeline)
            self._fields: dict[str, PotentialField | ElementsField | None] = {
                "gather": PotentialField(given.transfer_time, given.longest_step),
                "orbits": ElementsField(given.shape),
                "free_drift": None,
            }
            self._member = self._make_member()
        except ValueError as error:
            raise ParameterError(f"parameter {error}") from error
        self._first: int | None = None
        self._newest = 0
        self._reason = "no fix yet"
        self._velocity_change = 0.0
        self._join = EpochJoin((_FIX, _NEIGHBOURS), math.inf if self.lockstep else given.wait)
        self._publisher = self.publisher(AccelStamped, "control/thrust_command")
        self.subscribe(GnssFix, _FIX, lambda message: self._on_message(_FIX, message))
        self.subscribe(
            PoseArray, _NEIGHBOURS, lambda message: self._on_message(_NEIGHBOURS, message)
        )
        if not self.lockstep:
            self.create_timer(0.5 * given.wait or 0.1, self._take_epochs, clock=self.steady_clock)

    def _make_member(self) -> ClusterMember:
        given: ClusterGuidanceParameters = self.parameters
        return ClusterMember(
            NeighbourTracker(given.range_sigma, given.direction_sigma),
            given.station_period,
            self._fields[self._timeline.mode_at(0.0)],
            given.watch_from,
            MemberSetting(
                given.sample_time,
                given.delay_steps * given.sample_time,
                given.decision_interval,
                given.largest_acceleration,
            ),
        )

    def _on_message(self, source: str, message: GnssFix | PoseArray) -> None:
        stamp = to_nanoseconds(message.header.stamp)
        if self._newest - stamp >= StampOrder.JUMP_BACK:
            self._join.restart()
            self._first, self._velocity_change = None, 0.0
            self._member = self._make_member()
        self._newest = stamp
        self._join.add(source, stamp, message, time.monotonic())
        self._take_epochs()

    def _take_epochs(self) -> None:
        epoch = self._join.take(time.monotonic())
        while epoch is not None:
            self._step(epoch)
            epoch = self._join.take(time.monotonic())

    def _step(self, epoch: JoinedEpoch) -> None:
        started = time.perf_counter()
        given: ClusterGuidanceParameters = self.parameters
        stamp = epoch.stamp_nanoseconds
        acceleration = np.zeros(3)
        own = _own_state(epoch.measured.get(_FIX), stamp)
        self._reason = "" if own is not None else "no fix"
        if own is not None:
            if self._first is None:
                self._first = stamp
            elapsed = (stamp - self._first) / NANOSECONDS_PER_SECOND
            self._member.field = self._fields[self._timeline.mode_at(elapsed)]
            detected = _positions(epoch.measured.get(_NEIGHBOURS))
            acceleration = self._member.step(elapsed, own, detected)
            self._velocity_change += given.sample_time * float(np.linalg.norm(acceleration))
        command = AccelStamped()
        command.header.stamp = to_stamp(stamp)
        command.header.frame_id = f"{given.chief}/rtn"
        linear = command.accel.linear
        linear.x, linear.y, linear.z = (acceleration + 0.0).tolist()
        self._publisher.publish(command)
        self.acknowledge_step(to_stamp(stamp), started)

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report what the chaser does, or why it cannot decide."""
        text = f"no thrust: {self._reason}"
        if not self._reason:
            text, field = "drifts freely", self._member.field
            if field is not None:
                text = f"follows {self._member.followed} neighbours"
                if self._member.is_blind:
                    waits = field.stays_without_thrust
                    text = f"sees no neighbour: {'waits in its orbit' if waits else 'coasts'}"
        is_good = not self._reason and not self._member.is_blind
        return [
            diagnostics.status(
                f"{self.get_name()}: cluster",
                diagnostics.OK if is_good else diagnostics.WARN,
                text,
                {"velocity change, m/s": self._velocity_change},
                hardware_id=self.get_namespace().strip("/"),
            )
        ]


def _own_state(fix: GnssFix | None, stamp: int) -> FloatArray | None:
    """Return the state of a fix in GCRF, m and m/s, shape (6,); None without one."""
    if fix is None or fix.status == GnssFix.STATUS_NONE:
        return None
    state = np.concatenate((fix.position, fix.velocity))
    if not np.isfinite(state).all():
        return None
    return state_itrf_to_gcrf(GpsTime.from_unix_nanoseconds(stamp), state)


def _positions(message: PoseArray | None) -> FloatArray:
    """Return the detected positions that are finite, m, shape (k, 3)."""
    poses = [] if message is None else message.poses
    points = np.array([(p.position.x, p.position.y, p.position.z) for p in poses]).reshape(-1, 3)
    seen: FloatArray = points[np.isfinite(points).all(axis=1) & points.any(axis=1)]
    return seen


NODE_CLASS = ClusterGuidanceNode


def main() -> None:
    """Run the node."""
    run_node(ClusterGuidanceNode)
