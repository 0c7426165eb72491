"""Node `reference_orbit`: where a chief with a thruster is relative to its virtual orbit."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.time.timescales import GpsTime
from vtff_msgs.msg import RelativeState
from vtff_nav.relative.reference_orbit import ReferenceOrbit
from vtff_node import diagnostics
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import ParameterError, parameter
from vtff_node.stamps import to_nanoseconds


@dataclass(frozen=True)
class ReferenceOrbitParameters:
    """Parameters of `reference_orbit`."""

    chief: str = parameter("chief", "spacecraft that keeps its place on the orbit")
    deputies: list[str] = parameter(
        ["deputy"], "deputies; the relative navigation of the first tells the state of the chief"
    )
    settling_time: float = parameter(
        60.0, "time of navigation before the orbit begins", unit="s", minimum=0.0
    )
    gravity_degree: int = parameter(
        30, "degree and order of the orbit's gravity", minimum=2, maximum=70
    )
    position_sigma: float = parameter(
        0.5, "sigma of the chief's absolute position on each axis", unit="m", minimum=1e-6
    )
    velocity_sigma: float = parameter(
        5e-3, "sigma of the chief's absolute velocity on each axis", unit="m/s", minimum=1e-9
    )


class ReferenceOrbitNode(VtffNode):
    """State of the chief relative to a virtual orbit, for the controller of the chief.

    Stands in the namespace of the chief. Subscribes to /<deputy>/relative_state, which tells the
    absolute state of the chief; publishes reference_state (RelativeState: the chief relative to the
    orbit, in its RTN axes, named <chief>/rtn because the two differ by less than a microradian
    for each 7 m; position_chief_gcrf and velocity_chief_gcrf are those of the orbit). Before the
    orbit begins, and where navigation has no solution, the solution is SOLUTION_NONE.
    """

    Parameters = ReferenceOrbitParameters

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("reference_orbit", **node_arguments)
        given: ReferenceOrbitParameters = self.parameters
        if not given.deputies:
            raise ParameterError("parameter 'deputies': at least one name expected")
        self._deputy = given.deputies[0]
        model = ForceModel("spherical_harmonics", given.gravity_degree, given.gravity_degree)
        try:
            self._orbit = ReferenceOrbit(model, given.settling_time)
        except ValueError as error:
            raise ParameterError(str(error)) from error
        sigmas = [given.position_sigma] * 3 + [given.velocity_sigma] * 3
        self._covariance = np.diag(np.square(sigmas)).ravel()
        self._distance = float("nan")
        self._publisher = self.publisher(RelativeState, "reference_state")
        self.subscribe(RelativeState, f"/{self._deputy}/relative_state", self._on_relative_state)

    def _on_relative_state(self, message: RelativeState) -> None:
        started = time.perf_counter()
        given: ReferenceOrbitParameters = self.parameters
        if not self.is_of_deputy(message, self._deputy, "relative_state"):
            return
        answer = RelativeState(child_frame_id=given.chief, solution=RelativeState.SOLUTION_NONE)
        answer.header = message.header
        chief = np.concatenate((message.position_chief_gcrf, message.velocity_chief_gcrf))
        if message.solution != RelativeState.SOLUTION_NONE and np.isfinite(chief).all():
            stamp = GpsTime.from_unix_nanoseconds(to_nanoseconds(message.header.stamp))
            followed = self._orbit.follow(stamp, chief)
            if followed is not None:
                state, orbit = followed
                self._distance = float(np.linalg.norm(state[:3]))
                answer.position, answer.velocity = state[:3], state[3:]
                answer.position_chief_gcrf, answer.velocity_chief_gcrf = orbit[:3], orbit[3:]
                answer.covariance = self._covariance
                answer.solution, answer.age = message.solution, message.age
        self._publisher.publish(answer)
        self.acknowledge_step(message.header.stamp, started)

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report how far the chief is from the orbit."""
        has_begun = np.isfinite(self._distance)
        return [
            diagnostics.status(
                f"{self.get_name()}: distance",
                diagnostics.OK,
                f"{self._distance:.2f} m from the orbit" if has_begun else "not yet begun",
                {"distance, m": self._distance},
                hardware_id=self.parameters.chief,
            )
        ]


NODE_CLASS = ReferenceOrbitNode


def main() -> None:
    """Run the node."""
    run_node(ReferenceOrbitNode)
