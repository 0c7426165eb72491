"""Node `attitude_estimator`: attitude, rate and dipole of a spacecraft from its magnetometer."""

from __future__ import annotations

import contextlib
import math
import time
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import AccelStamped

from vtff_dynamics.attitude.magnetic_field import check_field_year
from vtff_dynamics.attitude.orbit_axes import (
    orbit_rate,
    quaternion_from_roll_pitch_yaw,
    rotation_gcrf_to_orbit,
)
from vtff_dynamics.attitude.quaternion import rotation_matrix
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.rtn import deputy_state_gcrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import is_finite
from vtff_msgs.msg import AdcsReport, AttitudeState, OrbitState, RelativeState
from vtff_nav.attitude.configuration import AttitudeFilterConfiguration, BodyModel
from vtff_nav.attitude.determination import DeterminationConfiguration
from vtff_nav.attitude.observability import dipole_observability
from vtff_nav.attitude.onboard import (
    ModuleReport,
    OnboardAttitude,
    OnboardAttitudeEstimator,
    process_synthetic_samples,
)
from vtff_nav.attitude.orbit_memory import OrbitMemory, OrbitPoint
from vtff_nav.attitude.thrust_memory import ThrustMemory
from vtff_node import diagnostics
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import ParameterError, parameter
from vtff_node.stamps import StampOrder, to_nanoseconds

_FILTER = AttitudeFilterConfiguration
_WATCH = DeterminationConfiguration
_BODY = BodyModel()


@dataclass(frozen=True)
class AttitudeEstimatorParameters:
    """Parameters of `attitude_estimator`: what it believes of spacecraft and sensor."""

    spacecraft: str = parameter("spacecraft", "spacecraft whose attitude is estimated")
    orbit_source: str = parameter(
        "orbit",
        "what tells where the spacecraft is; navigation: its relative_state",
        choices=("orbit", "navigation"),
    )
    inertia: list[float] = parameter(
        np.diag(_BODY.inertia_matrix).tolist(), "principal moments, x y z", unit="kg m^2"
    )
    wheel_axis: list[float] = parameter(
        np.asarray(_BODY.wheel_axis).tolist(), "axis of the wheel in the body"
    )
    wheel_inertia: float = parameter(BodyModel.wheel_inertia, "momentum over rate", unit="kg m^2")
    torquer_moment: float = parameter(BodyModel.torquer_moment, "of a rod that is on", unit="A m^2")
    torquer_sigma: float = parameter(
        _FILTER.torquer_sigma, "share by which the moment of a pulse may be wrong", minimum=0.0
    )
    magnetometer_sigma: float = parameter(
        _FILTER.magnetometer_sigma, "white noise of each axis", unit="T"
    )
    magnetometer_range: float = parameter(
        _WATCH.largest_field, "a sample there is saturated", unit="T", minimum=1e-9
    )
    initial_rotation_sigma_deg: float | None = parameter(
        None,
        "sigma of a known attitude at the first report; without it the attitude is not known",
        unit="deg",
        minimum=0.0,
    )
    initial_roll_pitch_yaw_deg: list[float] = parameter(
        [0.0, 0.0, 0.0], "that attitude, to the orbit axes, with which it turns", unit="deg"
    )
    initial_rate_sigma: float = parameter(
        _FILTER.initial_rate_sigma, "of each axis at the start", unit="rad/s", minimum=0.0
    )
    initial_dipole: list[float] = parameter([0.0, 0.0, 0.0], "at the start", unit="A m^2")
    initial_dipole_sigma: float = parameter(
        _FILTER.initial_dipole_sigma, "of each axis", unit="A m^2", minimum=0.0
    )
    dipole_drift_sigma: float = parameter(
        _FILTER.dipole_drift_sigma,
        "change of the dipole in time, each axis; 0: it is constant",
        unit="A m^2/s",
        minimum=0.0,
    )
    dipole_drift_time: float = parameter(
        _FILTER.dipole_drift_time, "time over which that change stays alike", unit="s", minimum=1.0
    )
    torque_noise: float = parameter(
        _FILTER.torque_noise, "white torque that no model knows", unit="N m sqrt(s)", minimum=0.0
    )
    torque_sigma: float = parameter(
        _FILTER.torque_sigma,
        "torque that lasts, as that of drag, each axis of the body; 0: not estimated",
        unit="N m",
        minimum=0.0,
    )
    torque_time: float = parameter(
        _FILTER.torque_time, "time over which that torque stays alike", unit="s", minimum=1.0
    )
    thruster_offset_sigma: float = parameter(
        _FILTER.thruster_offset_sigma,
        "by how much the force of each thruster may miss the centre of mass; 0: not estimated, and "
        "thrust does not turn the spacecraft",
        unit="m",
        minimum=0.0,
    )
    mass: float = parameter(
        6.5, "of the spacecraft: thrust is told as acceleration", unit="kg", minimum=1e-3
    )
    thrust_duration: float = parameter(
        1.0, "time for which each thrust_body acts", unit="s", minimum=0.001
    )
    bias_sigma: float = parameter(
        _FILTER.bias_sigma, "magnetometer bias; 0: not estimated", unit="T", minimum=0.0
    )
    bias_walk: float = parameter(
        _FILTER.bias_walk, "random walk of the bias", unit="T/sqrt(s)", minimum=0.0
    )
    inertia_sigma: float = parameter(
        _FILTER.inertia_sigma,
        "share by which each principal moment may be wrong; 0: not estimated",
        minimum=0.0,
    )
    field_sigma: float = parameter(
        _FILTER.field_sigma,
        "error of the field model on each axis; 0: the model is perfect",
        unit="T",
        minimum=0.0,
    )
    field_time: float = parameter(
        _FILTER.field_time, "time over which that error stays alike", unit="s", minimum=1.0
    )
    converged_deg: float = parameter(
        _WATCH.converged_deg, "sigma up to which an attitude may steer", unit="deg", minimum=1e-3
    )
    starting_rate: float = parameter(
        _WATCH.starting_rate, "rate up to which a start is tried", unit="rad/s", minimum=0.0
    )


class AttitudeEstimatorNode(VtffNode):
    """Attitude of one spacecraft, run in its namespace.

    Subscribes to adcs/report (vtff_msgs/AdcsReport) and to orbit (vtff_msgs/OrbitState, in GCRF) or
    relative_state (vtff_msgs/RelativeState); for each report it publishes attitude
    (vtff_msgs/AttitudeState) with the same stamp, once the orbit of that time is there. An orbit
    that does not come by the next report, and one without navigation, is predicted.

    Where thrusters may miss the centre of mass (``thruster_offset_sigma``) it also subscribes to
    propulsion/thrust_body (geometry_msgs/AccelStamped, m/s^2, body axes) and waits for the thrusts
    of the period; one that has not come by the next report counts as none.
    """

    Parameters = AttitudeEstimatorParameters

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("attitude_estimator", **node_arguments)
        given: AttitudeEstimatorParameters = self.parameters
        try:
            body, configuration = self._models()
        except ValueError as error:
            raise ParameterError(f"parameter {error}") from error
        watch = DeterminationConfiguration(
            largest_field=given.magnetometer_range,
            converged_deg=given.converged_deg,
            starting_rate=given.starting_rate,
        )
        self._estimator = OnboardAttitudeEstimator(body, configuration, watch)
        self._orbit = OrbitMemory()
        self._orbit_stamp = -1
        self._thrust = (
            ThrustMemory(given.mass, given.thrust_duration)
            if given.thruster_offset_sigma > 0.0
            else None
        )
        self._order = StampOrder()
        self._waiting: list[AdcsReport] = []
        if len(given.initial_roll_pitch_yaw_deg) != 3:
            raise ParameterError("parameter 'initial_roll_pitch_yaw_deg': three angles expected")
        self._is_told = given.initial_rotation_sigma_deg is not None
        self._known: OnboardAttitude | None = None
        self._was_valid = False
        self._counts = {"reports": 0, "without a report": 0, "orbits predicted": 0}
        self._publisher = self.publisher(AttitudeState, "attitude")
        if given.orbit_source == "orbit":
            self.subscribe(OrbitState, "orbit", self._on_orbit)
        else:
            self.subscribe(RelativeState, "relative_state", self._on_relative_state)
        self.subscribe(AdcsReport, "adcs/report", self._on_report)
        if self._thrust is not None:
            self.subscribe(AccelStamped, "propulsion/thrust_body", self._on_thrust)

    def warm_up(self) -> None:
        """Process synthetic samples with another estimator of the same setting."""
        with contextlib.suppress(ValueError):  # which the constructor names
            process_synthetic_samples(OnboardAttitudeEstimator(*self._models()))

    def _models(self) -> tuple[BodyModel, AttitudeFilterConfiguration]:
        """Return the parameters as models of body and filter; ValueError names a wrong one."""
        given: AttitudeEstimatorParameters = self.parameters
        body = BodyModel(given.inertia, given.wheel_axis, given.wheel_inertia, given.torquer_moment)
        configuration = AttitudeFilterConfiguration(
            magnetometer_sigma=given.magnetometer_sigma,
            initial_rotation_sigma_deg=(
                _FILTER.initial_rotation_sigma_deg
                if given.initial_rotation_sigma_deg is None
                else given.initial_rotation_sigma_deg
            ),
            initial_rate_sigma=given.initial_rate_sigma,
            initial_dipole=given.initial_dipole,
            initial_dipole_sigma=given.initial_dipole_sigma,
            dipole_drift_sigma=given.dipole_drift_sigma,
            dipole_drift_time=given.dipole_drift_time,
            torquer_sigma=given.torquer_sigma,
            torque_noise=given.torque_noise,
            torque_sigma=given.torque_sigma,
            torque_time=given.torque_time,
            bias_sigma=given.bias_sigma,
            bias_walk=given.bias_walk,
            inertia_sigma=given.inertia_sigma,
            field_sigma=given.field_sigma,
            field_time=given.field_time,
            thruster_offset_sigma=given.thruster_offset_sigma,
        )
        return body, configuration

    def _on_orbit(self, message: OrbitState) -> None:
        self._orbit_stamp = to_nanoseconds(message.header.stamp)
        self._orbit.add(self._orbit_stamp, np.concatenate((message.position, message.velocity)))
        self._work()

    def _on_relative_state(self, message: RelativeState) -> None:
        """Take the orbit of the deputy; a message without a solution says that none comes."""
        if not self.is_of_deputy(message, self.parameters.spacecraft, "relative_state"):
            return
        self._orbit_stamp = to_nanoseconds(message.header.stamp)
        chief = np.concatenate((message.position_chief_gcrf, message.velocity_chief_gcrf))
        relative = np.concatenate((message.position, message.velocity))
        if message.solution != RelativeState.SOLUTION_NONE and is_finite(chief) and chief.any():
            self._orbit.add(self._orbit_stamp, deputy_state_gcrf(chief, relative))
        self._work()

    def _on_report(self, message: AdcsReport) -> None:
        if not self.is_of_deputy(message, self.parameters.spacecraft, "adcs/report"):
            return
        if not self._order.accepts(to_nanoseconds(message.header.stamp)):
            return
        self._waiting.append(message)
        self._work()

    def _on_thrust(self, message: AccelStamped) -> None:
        assert self._thrust is not None
        given = message.accel.linear
        thrust = np.array([given.x, given.y, given.z])
        self._thrust.add(to_nanoseconds(message.header.stamp), thrust)
        self._work()

    def _work(self) -> None:
        """Process the reports whose orbit and thrusts have been told; the last waits for them."""
        while self._waiting:
            stamp = to_nanoseconds(self._waiting[0].header.stamp)
            # Before the first period nothing has been commanded.
            is_told = self._orbit_stamp >= stamp and (
                self._thrust is None
                or not self._waiting[0].period > 0.0
                or self._thrust.reaches(stamp)
            )
            if not is_told and len(self._waiting) < 2:
                return
            self._counts["orbits predicted"] += not self._orbit.has(stamp)
            self._process(self._waiting.pop(0))

    def _process(self, message: AdcsReport) -> None:
        started = time.perf_counter()
        stamp = to_nanoseconds(message.header.stamp)
        end = self._orbit.at(stamp)
        start = self._orbit.at(stamp - round(message.period * NANOSECONDS_PER_SECOND))
        answer = AttitudeState(
            child_frame_id=message.child_frame_id, source=AttitudeState.SOURCE_ESTIMATE
        )
        answer.header.stamp = message.header.stamp
        answer.header.frame_id = "gcrf"
        answer.quaternion = np.array([0.0, 0.0, 0.0, 1.0])
        answer.normalised_innovation_squared = math.nan
        answer.correction = np.full(3, math.nan)
        answer.wheel_speed_rpm = message.wheel_speed_rpm
        answer.wheel_follows = True
        self._counts["reports"] += 1
        self._counts["without a report"] += not message.heard
        if start is None or end is None:
            answer.reason = "orbit not known"
        else:
            self._fill(answer, message, start, end)
        self._was_valid = answer.valid
        self._publisher.publish(answer)
        self.acknowledge_step(message.header.stamp, started)

    def _fill(
        self, answer: AttitudeState, message: AdcsReport, start: OrbitPoint, end: OrbitPoint
    ) -> None:
        """Process a report and write what is known into the message."""
        try:
            check_field_year("orbit", GpsTime.from_unix_nanoseconds(end.stamp_nanoseconds))
        except ValueError as error:
            answer.reason = str(error)
            return
        report = ModuleReport(
            message.period,
            np.array(message.field_body).reshape(-1, 3),
            tuple(message.sample_times),
            message.wheel_speed_rpm,
            message.wheel_command_rpm,
            message.pulse_step * np.array(message.pulse_steps, dtype=float),
            message.heard,
        )
        if self._is_told:
            self._is_told = False
            self._expect_told_attitude(start)
        forces = None
        if self._thrust is not None:
            forces = self._thrust.forces(start.stamp_nanoseconds, end.stamp_nanoseconds)
        known = self._estimator.process(
            report, start.state_gcrf, start.field_gcrf, end.field_gcrf, forces
        )
        self._known = known
        answer.position_gcrf, answer.velocity_gcrf = end.state_gcrf[:3], end.state_gcrf[3:]
        answer.valid = known.status.valid
        answer.wheel_speed_rpm = known.wheel_speed_rpm
        answer.wheel_follows = known.wheel_follows
        answer.field_valid = known.field_is_valid
        answer.normalised_innovation_squared = known.status.normalised_innovation_squared
        answer.restarts = known.status.restarts
        answer.reason = known.status.reason
        estimate = known.estimate
        if estimate is not None:
            answer.quaternion = estimate.quaternion_gcrf
            answer.rate_body = estimate.rate_body
            answer.dipole = estimate.dipole
            answer.covariance = np.ascontiguousarray(estimate.covariance[:9, :9]).ravel()
            answer.magnetometer_bias = estimate.magnetometer_bias
            if self._was_valid:  # who leaves invalid attitudes out misses no correction
                answer.correction = known.correction

    def _expect_told_attitude(self, start: OrbitPoint) -> None:
        """Begin with the attitude of the parameters, which turns with the orbit."""
        roll, pitch, yaw = np.radians(self.parameters.initial_roll_pitch_yaw_deg)
        to_orbit = rotation_gcrf_to_orbit(start.state_gcrf)
        quaternion = quaternion_from_roll_pitch_yaw(roll, pitch, yaw, to_orbit)
        rate_gcrf = -orbit_rate(start.state_gcrf) * to_orbit[1]
        self._estimator.expect(quaternion, rotation_matrix(quaternion).T @ rate_gcrf)

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report attitude, dipole and wheel."""
        known = self._known
        name = self.get_name()
        level, text, values = diagnostics.WARN, "no report yet", dict(self._counts)
        if known is None or known.estimate is None:
            text = known.status.reason if known is not None else text
            craft = self.parameters.spacecraft
            return [diagnostics.status(f"{name}: attitude", level, text, values, hardware_id=craft)]
        estimate, status = known.estimate, known.status
        level, text = diagnostics.OK, "attitude known"
        if status.reason or not status.valid:
            level, text = diagnostics.WARN, status.reason
        dipole = dipole_observability(
            estimate.covariance[6:9, 6:9], self.parameters.initial_dipole_sigma
        )
        return [
            diagnostics.status(
                f"{name}: attitude",
                level,
                text,
                {
                    **values,
                    "sigma (deg)": round(math.degrees(estimate.rotation_sigma), 3),
                    "starts left": status.members,
                    "new starts": status.restarts,
                },
                hardware_id=self.parameters.spacecraft,
            ),
            diagnostics.status(
                f"{name}: dipole",
                diagnostics.WARN if dipole.reason else diagnostics.OK,
                dipole.reason or "dipole known",
                {
                    f"{axis} (mA m2)": f"{1e3 * value:.1f} +- {1e3 * sigma:.1f}"
                    for axis, value, sigma in zip("xyz", estimate.dipole, dipole.sigma, strict=True)
                },
                hardware_id=self.parameters.spacecraft,
            ),
            diagnostics.status(
                f"{name}: wheel",
                diagnostics.OK if known.wheel_follows else diagnostics.ERROR,
                "follows" if known.wheel_follows else "wheel does not follow its command",
                {"speed (rpm)": round(known.wheel_speed_rpm, 1)},
                hardware_id=self.parameters.spacecraft,
            ),
        ]


NODE_CLASS = AttitudeEstimatorNode


def main() -> None:
    """Run the node."""
    run_node(AttitudeEstimatorNode)
