"""Node `relative_ekf`: state of a deputy relative to its chief from the epochs of both."""

from __future__ import annotations

import contextlib
import functools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from geometry_msgs.msg import AccelStamped
from rosgraph_msgs.msg import Clock

from vtff_dynamics.orbit.force_model import GRAVITY_MODELS, ForceModel
from vtff_dynamics.orbit.propagator import INTEGRATORS
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.antex import AntexError, read_antex
from vtff_msgs.msg import (
    AmbiguityStatus,
    AttitudeState,
    GnssEphemeris,
    GnssObservations,
    LaserRange,
    RelativeState,
    SlantTec,
    StepDone,
)
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.common.antenna_correction import (
    ATTITUDE_FRAMES,
    UNCALIBRATED,
    Antenna,
    AntennaPair,
)
from vtff_nav.relative.common.body_attitude import BodyAttitude
from vtff_nav.relative.common.dynamics import DYNAMICS, Dynamics
from vtff_nav.relative.common.estimator_inputs import EstimatorInputs
from vtff_nav.relative.common.estimator_setting import EstimatorSetting
from vtff_nav.relative.common.measurements import MeasurementNoise
from vtff_nav.relative.common.signal_bands import parse_bands
from vtff_nav.relative.common.solution import (
    SOLUTION_FIXED,
    SOLUTION_NAMES,
    SOLUTION_NONE,
    RelativeEstimator,
    RelativeSolution,
    check_solution,
)
from vtff_nav.relative.synthetic_epochs import process_synthetic_epochs
from vtff_nav.relative_conversions import (
    ambiguities_to_message,
    differential_tec_to_message,
    laser_from_message,
    relative_state_to_message,
)
from vtff_node import diagnostics
from vtff_node.conversions.gnss import ephemeris_from_message, observations_from_message
from vtff_node.epoch_join import EpochJoin, JoinedEpoch
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import ParameterError, parameter
from vtff_node.plugins.groups import ESTIMATORS
from vtff_node.plugins.loading import PluginError, plugin_names
from vtff_node.stamps import StampOrder, to_nanoseconds, to_stamp

JOIN_INTERVAL = 0.01  # s of wall time between looks at epochs that wait for a receiver
SETTLE_TIME = 0.3  # s of wall time between discovery of a publisher and its first message
LASER = "laser"


@dataclass(frozen=True)
class RelativeEkfParameters:
    """Parameters of `relative_ekf`."""

    estimator: str = parameter(
        "cdgps",
        "cdgps: code and phase of all signals, with integers; paper: 8 states, phase of one "
        "signal; or that of an installed package (docs/plugins.md)",
        choices=plugin_names(ESTIMATORS.name),
    )
    chief: str = parameter("chief", "spacecraft whose RTN frame is used")
    deputy: str = parameter("deputy", "spacecraft whose relative state is estimated")
    thrust_duration: float = parameter(
        1.0, "time for which each thrust_applied acts", unit="s", minimum=0.001
    )
    dynamics: str = parameter(
        "orbital",
        "cdgps: motion of the deputy; where it is not in orbit, the chief stands still",
        choices=DYNAMICS,
    )
    signals: list[str] = parameter(
        [],
        "system letter and RINEX frequency digit of the signals used, as G1, G2, E5; empty = all "
        "of GPS and Galileo (cdgps), G1 (paper)",
    )
    elevation_mask_deg: float = parameter(
        CdgpsConfiguration.elevation_mask_deg,
        "satellites below are not used",
        unit="deg",
        minimum=-90.0,
        maximum=90.0,
    )
    gravity: str = parameter(
        "spherical_harmonics", "gravity of the filter's motion model", choices=GRAVITY_MODELS
    )
    gravity_degree: int = parameter(
        0,
        "degree of the harmonics; 0: that of the estimator, 50 (cdgps) or 8 (paper)",
        minimum=0,
        maximum=70,
    )
    gravity_order: int = parameter(
        70, "order of the harmonics; at most the degree", minimum=0, maximum=70
    )
    integrator: str = parameter(
        CdgpsConfiguration.integrator,
        "cdgps: how the motion is stepped; euler where the simulator steps so, which no force "
        "explains",
        choices=INTEGRATORS,
    )
    longest_step: float = parameter(
        CdgpsConfiguration.longest_step,
        "cdgps: longest step of integration; with euler that of the simulator",
        unit="s",
        minimum=0.001,
    )
    code_sigma: float = parameter(
        MeasurementNoise.code_sigma,
        "noise of the pseudorange where the receiver states none",
        unit="m",
        minimum=1e-3,
    )
    phase_sigma: float = parameter(
        MeasurementNoise.phase_sigma,
        "noise of the phase where the receiver states none",
        unit="m",
        minimum=1e-5,
    )
    use_receiver_sigmas: bool = parameter(True, "take the sigmas that the receiver states")
    empirical_acceleration_sigma: float = parameter(
        CdgpsConfiguration.noise_relative.empirical_sigma,
        "cdgps: unmodelled relative acceleration along the track, Gauss-Markov",
        unit="m/s^2",
        minimum=0.0,
    )
    empirical_across_sigma: float = parameter(
        EstimatorSetting.empirical_across_sigma,
        "cdgps: the same on the radial and on the normal axis",
        unit="m/s^2",
        minimum=0.0,
    )
    empirical_gradient_sigma: float = parameter(
        CdgpsConfiguration.noise_relative.gradient_sigma,
        "cdgps: what is added to it for each metre of separation, by gradients of forces that the "
        "motion model leaves out",
        unit="1/s^2",
        minimum=0.0,
    )
    thrust_sigma: float = parameter(
        CdgpsConfiguration.thrust_relative_sigma,
        "cdgps: white error of the thrust as a part of its magnitude at the start; it is estimated",
        minimum=0.0,
        maximum=1.0,
    )
    thrust_scale_sigma: float = parameter(
        CdgpsConfiguration.thrust_scale_sigma,
        "cdgps: a priori sigma of the scale of the thrust, which is estimated",
        minimum=0.0,
        maximum=1.0,
    )
    thrust_misalignment_sigma_deg: float = parameter(
        CdgpsConfiguration.thrust_misalignment_sigma_deg,
        "cdgps: a priori sigma of the misalignment of the thrust on each axis, which is estimated",
        unit="deg",
        minimum=0.0,
        maximum=45.0,
    )
    deputy_thrust_axes: str = parameter(
        "rtn",
        "cdgps: axes in which the deputy's thrusters are fixed; body: the error of its estimated "
        "attitude turns the thrust",
        choices=("rtn", "body"),
    )
    slow_phase_sigma: float = parameter(
        CdgpsConfiguration.slow_phase_sigma,
        "cdgps: slow errors of the phase of a receiver, such as multipath, until it is estimated",
        unit="m",
        minimum=1e-5,
        maximum=0.05,
    )
    slow_code_sigma: float = parameter(
        CdgpsConfiguration.slow_code_sigma,
        "cdgps: slow errors of the code of a receiver until it is estimated",
        unit="m",
        minimum=1e-3,
        maximum=10.0,
    )
    slow_error_time: float = parameter(
        CdgpsConfiguration.slow_error_time,
        "cdgps: correlation time of slow errors until it is estimated",
        unit="s",
        minimum=1.0,
    )
    plasma_gradient_sigma: float = parameter(
        CdgpsConfiguration.plasma_gradient_sigma_tecu_per_deg,
        "cdgps: horizontal gradient of the vertical TEC above the spacecraft",
        unit="TECU/deg",
        minimum=1e-3,
    )
    success_rate: float = parameter(
        CdgpsConfiguration.success_rate,
        "cdgps: success rate that integers must have",
        minimum=0.9,
        maximum=0.999999,
    )
    antex_file: str = parameter(
        "", "cdgps: ANTEX file with the phase centres of the antennas; empty = none are corrected"
    )
    chief_antenna: str = parameter("", "type and radome of the chief's antenna in antex_file")
    deputy_antenna: str = parameter("", "type and radome of the deputy's antenna in antex_file")
    lever_arm_frame: str = parameter(
        "", "axes of the lever arms; they must be named where one is given", choices=("", "body")
    )
    chief_lever_arm: list[float] = parameter(
        list(Antenna.lever_arm_body),
        "cdgps: from the centre of mass to the reference point of the chief's antenna",
        unit="m",
    )
    deputy_lever_arm: list[float] = parameter(
        list(Antenna.lever_arm_body), "cdgps: the same of the deputy", unit="m"
    )
    chief_lever_arm_sigma: float = parameter(
        Antenna.lever_arm_sigma,
        "cdgps: error of the chief's lever arm on each axis; with more than 0 it is estimated",
        unit="m",
        minimum=0.0,
    )
    deputy_lever_arm_sigma: float = parameter(
        Antenna.lever_arm_sigma, "cdgps: the same of the deputy", unit="m", minimum=0.0
    )
    chief_phase_map_sigma: float = parameter(
        UNCALIBRATED.phase_map_sigma,
        "cdgps: error of the chief's phase centres in a range; 0 for an ideal antenna",
        unit="m",
        minimum=0.0,
    )
    deputy_phase_map_sigma: float = parameter(
        UNCALIBRATED.phase_map_sigma, "cdgps: the same of the deputy", unit="m", minimum=0.0
    )
    chief_attitude_frame: str = parameter(
        Antenna.attitude_frame,
        "axes to which the chief's body is fixed: local horizon, own orbit, or inertial space; "
        "estimated: as /<chief>/attitude says",
        choices=ATTITUDE_FRAMES,
    )
    deputy_attitude_frame: str = parameter(
        Antenna.attitude_frame, "the same of the deputy", choices=ATTITUDE_FRAMES
    )
    chief_quaternion: list[float] = parameter(
        list(Antenna.quaternion), "x, y, z, w from the chief's body axes to chief_attitude_frame"
    )
    deputy_quaternion: list[float] = parameter(list(Antenna.quaternion), "the same of the deputy")
    longest_prediction: float = parameter(
        CdgpsConfiguration.longest_prediction,
        "time without measurements after which navigation starts anew",
        unit="s",
        minimum=1.0,
    )
    use_laser: bool = parameter(False, "use laser_range (cdgps)")
    receiver_nodes: list[str] = parameter(
        [],
        "in lockstep, the nodes that publish the epochs of chief and deputy, and the laser ranges: "
        "an epoch is processed without them once they have finished the step",
    )
    patience: float = parameter(
        0.3,
        "without lockstep, wall time that an epoch waits for the other receiver",
        unit="s",
        minimum=0.0,
    )
    lockstep_patience: float = parameter(
        0.05,
        "in lockstep, wall time that an epoch waits for observations which the end of their step "
        "has overtaken; more where the link to a receiver's node loses packets",
        unit="s",
        minimum=0.0,
    )
    compute_limit: float = parameter(
        10.0, "longest wall time of one call of the estimator", unit="s", minimum=0.001
    )

    def check(self) -> None:
        """Check what values tell together; ValueError with the name of the parameter."""
        antenna_pair(self)


def antenna_pair(given: RelativeEkfParameters) -> AntennaPair | None:
    """Return what the parameters tell of the antennas; None for ideal ones.

    Raises
    ------
    ValueError
        If a value is not possible, or needs another one that is not given; the text names it.
    """
    pair = AntennaPair(*(_antenna(given, craft) for craft in ("chief", "deputy")))
    if given.antex_file and not (given.chief_antenna or given.deputy_antenna):
        raise ValueError("antex_file: chief_antenna or deputy_antenna is needed with it")
    return None if pair == AntennaPair() else pair


def _antenna(given: RelativeEkfParameters, craft: str) -> Antenna:
    """Return the antenna of chief or deputy."""
    name, lever_arm = getattr(given, f"{craft}_antenna"), getattr(given, f"{craft}_lever_arm")
    quaternion = getattr(given, f"{craft}_quaternion")
    if any(lever_arm) and not given.lever_arm_frame:
        raise ValueError(f"lever_arm_frame: {craft}_lever_arm needs the name of its axes: body")
    phase_centre = None
    if name:
        if not given.antex_file:
            raise ValueError(f"antex_file: the file that has {craft}_antenna {name!r} is needed")
        try:
            phase_centre = read_antex(given.antex_file, name)
        except OSError as error:
            raise ValueError(f"antex_file: {given.antex_file}: {error.strerror}") from None
        except AntexError as error:
            raise ValueError(f"{craft}_antenna: {error}") from None
    try:
        return Antenna(
            lever_arm_body=tuple(lever_arm),  # type: ignore[arg-type]
            lever_arm_sigma=getattr(given, f"{craft}_lever_arm_sigma"),
            phase_centre=phase_centre,
            phase_map_sigma=getattr(given, f"{craft}_phase_map_sigma"),
            attitude_frame=getattr(given, f"{craft}_attitude_frame"),
            quaternion=tuple(quaternion),  # type: ignore[arg-type]
        )
    except ValueError as error:
        raise ValueError(f"{craft}_{error}") from None


def estimator_setting(given: RelativeEkfParameters) -> EstimatorSetting:
    """Return what the parameters tell the filter.

    Raises
    ------
    ValueError
        If a value is not possible; the text names it.
    """
    if given.deputy_thrust_axes == "body" and given.deputy_attitude_frame != "estimated":
        raise ValueError(
            "deputy_thrust_axes: thrusters in the body need deputy_attitude_frame 'estimated'"
        )
    force_model = None
    if given.gravity_degree > 0:
        order = min(given.gravity_order, given.gravity_degree)
        force_model = ForceModel(given.gravity, given.gravity_degree, order)
    elif given.gravity != "spherical_harmonics":
        force_model = ForceModel(given.gravity)
    return EstimatorSetting(
        force_model=force_model,
        measurement_noise=MeasurementNoise(
            given.code_sigma, given.phase_sigma, given.use_receiver_sigmas
        ),
        bands=parse_bands(given.signals) if given.signals else None,
        elevation_mask_deg=given.elevation_mask_deg,
        longest_prediction=given.longest_prediction,
        dynamics=cast(Dynamics, given.dynamics),  # one of the choices of the parameter
        integrator=given.integrator,
        longest_step=given.longest_step,
        empirical_acceleration_sigma=given.empirical_acceleration_sigma,
        empirical_across_sigma=given.empirical_across_sigma,
        empirical_gradient_sigma=given.empirical_gradient_sigma,
        thrust_sigma=given.thrust_sigma,
        thrust_scale_sigma=given.thrust_scale_sigma,
        thrust_misalignment_sigma_deg=given.thrust_misalignment_sigma_deg,
        thrust_follows_attitude=given.deputy_thrust_axes == "body",
        slow_phase_sigma=given.slow_phase_sigma,
        slow_code_sigma=given.slow_code_sigma,
        slow_error_time=given.slow_error_time,
        plasma_gradient_sigma=given.plasma_gradient_sigma,
        success_rate=given.success_rate,
        antennas=antenna_pair(given),
    )


class RelativeEkfNode(VtffNode):
    """Relative navigation of one deputy.

    Stands in the namespace of its deputy. Subscribes to gnss/epoch and gnss/ephemeris of chief
    (/<chief>/gnss/...) and deputy, propulsion/thrust_applied of both, /clock, laser_range if asked
    for, and attitude of each whose attitude frame is "estimated". Publishes once an epoch
    relative_state (RelativeState, m and m/s in the chief's RTN frame), ambiguities
    (AmbiguityStatus) and differential_tec (SlantTec, TECU).
    Every epoch of /clock is answered: without measurements by a prediction, before the filter has
    started by SOLUTION_NONE. An estimator that fails, is too slow or answers with something
    unusable is named, its solution is SOLUTION_NONE and the node ends.
    """

    Parameters = RelativeEkfParameters
    Plugins = ESTIMATORS

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("relative_ekf", **node_arguments)
        given: RelativeEkfParameters = self.parameters
        self.plugin.call_limit = given.compute_limit
        self._processed_nanoseconds = 0
        try:
            setting = estimator_setting(given)
            self._estimator: RelativeEstimator = self.plugin.make(setting, self.plugin_parameters)
        except ValueError as error:
            raise ParameterError(str(error)) from error
        for name in ("chief_attitude_frame", "deputy_attitude_frame"):
            takes_attitudes = hasattr(self._estimator, "add_attitude")
            if getattr(given, name) == "estimated" and not takes_attitudes:
                raise ParameterError(
                    f"parameter '{name}': estimator '{given.estimator}' takes no attitudes"
                )
        self._namespaces = {given.chief: f"/{given.chief}/", given.deputy: ""}
        if len(self._namespaces) < 2:
            raise ParameterError(f"parameter 'deputy': {given.deputy!r} is the chief")
        self._sources = [given.chief, given.deputy, *([LASER] if given.use_laser else [])]
        self._source_of_node = self._sources_by_node(given.receiver_nodes)
        waits_for_closing = self.lockstep and bool(given.receiver_nodes)
        patience = given.lockstep_patience if waits_for_closing else given.patience
        self._join = EpochJoin(self._sources, patience, waits_for_closing)
        self._newest = -1
        self._solution: RelativeSolution | None = None
        self._epochs = {name: 0 for name in SOLUTION_NAMES.values()}
        self._compute_time = 0.0
        self._thrust_orders = {name: StampOrder() for name in self._namespaces}
        self._refused_thrust = 0
        self._inputs_since: float | None = None
        self._state_publisher = self.publisher(RelativeState, "relative_state")
        self._ambiguity_publisher = self.publisher(AmbiguityStatus, "ambiguities")
        self._tec_publisher = self.publisher(SlantTec, "differential_tec")
        self._subscribe(given)
        self.create_timer(JOIN_INTERVAL, self._check_inputs, clock=self.steady_clock)

    def warm_up(self) -> None:
        """Process synthetic epochs with another filter of the same setting."""
        # A lab's class is made once, and the constructor names what is wrong.
        if self.plugin.factory.__module__.startswith("vtff_nav."):
            with contextlib.suppress(ValueError):
                is_in_orbit = self.parameters.dynamics == "orbital"
                estimator = self.plugin.factory(estimator_setting(self.parameters))
                process_synthetic_epochs(estimator, is_in_orbit=is_in_orbit)

    def _sources_by_node(self, nodes: list[str]) -> dict[str, str]:
        if nodes and len(nodes) != len(self._sources):
            raise ParameterError(
                f"parameter 'receiver_nodes' names {len(nodes)} nodes; "
                f"it must name one for each of {', '.join(self._sources)}"
            )
        return dict(zip(nodes, self._sources, strict=False))

    def _subscribe(self, given: RelativeEkfParameters) -> None:
        for craft, namespace in self._namespaces.items():
            self.subscribe(
                GnssObservations,
                f"{namespace}gnss/epoch",
                functools.partial(self._on_epoch, craft),
            )
            self.subscribe(
                GnssEphemeris, f"{namespace}gnss/ephemeris", self._on_ephemeris, latched=True
            )
        for craft, namespace in self._namespaces.items():
            self.subscribe(
                AccelStamped,
                f"{namespace}propulsion/thrust_applied",
                functools.partial(self._on_thrust, craft),
                required=False,  # a spacecraft may coast
            )
            if getattr(given, f"{self._role(craft)}_attitude_frame") == "estimated":
                self.subscribe(
                    AttitudeState,
                    f"{namespace}attitude",
                    functools.partial(self._on_attitude, craft),
                    required=False,  # without one the lever arm is not known
                )
        if given.use_laser:
            self.subscribe(LaserRange, "laser_range", self._on_laser)
        if self._source_of_node and self.lockstep:
            self.subscribe(StepDone, "/sim/step_done", self._on_step_done)
        self.subscribe(Clock, "/clock", self._on_clock)

    # ---- input -------------------------------------------------------------------------------

    def _on_ephemeris(self, message: GnssEphemeris) -> None:
        self._tell(self._estimator.add_ephemeris, ephemeris_from_message(message))

    def _role(self, craft: str) -> str:
        """Return the prefix of the parameters of a spacecraft."""
        return "deputy" if craft == self.parameters.deputy else "chief"

    def _on_attitude(self, craft: str, message: AttitudeState) -> None:
        """Hand on an attitude that is valid; its covariance enters."""
        if not message.valid:
            return
        time = GpsTime.from_unix_nanoseconds(to_nanoseconds(message.header.stamp))
        covariance = np.array(message.covariance).reshape(9, 9)[:3, :3]
        try:
            attitude = BodyAttitude(
                time,
                np.array(message.quaternion),
                np.array(message.rate_body),
                covariance,
                np.array(message.correction),
            )
        except ValueError as error:
            self.get_logger().warning(
                f"attitude of {craft}: {error}: ignored", throttle_duration_sec=5.0
            )
            return
        # Only subscribed to where the estimator has the method.
        add_attitude = cast(EstimatorInputs, self._estimator).add_attitude
        is_of_chief = self._role(craft) == "chief"
        self._tell(functools.partial(add_attitude, is_of_chief=is_of_chief), attitude)

    def _on_thrust(self, craft: str, message: AccelStamped) -> None:
        stamp = to_nanoseconds(message.header.stamp)
        if not self._thrust_orders[craft].accepts(stamp):
            return
        linear = message.accel.linear
        acceleration = (linear.x, linear.y, linear.z)
        if not all(map(math.isfinite, acceleration)):
            self._refused_thrust += 1
            self.get_logger().warning(
                f"thrust_applied of {craft} is not finite: ignored",
                throttle_duration_sec=5.0,
            )
            return
        start = GpsTime.from_unix_nanoseconds(stamp)
        if craft == self.parameters.deputy:
            add_thrust = self._estimator.add_thrust
        elif hasattr(self._estimator, "add_chief_thrust"):
            add_thrust = self._estimator.add_chief_thrust
        else:
            if any(acceleration):
                name = self.parameters.estimator
                self.fail(f"estimator '{name}' cannot take thrust of the chief")
            return
        self._tell(add_thrust, start, self.parameters.thrust_duration, acceleration)

    def _tell(self, method: Callable[..., None], *arguments: object) -> None:
        """Call a method of the estimator; where that fails, answer the last epoch and end."""
        if self.finished:
            return
        try:
            self.plugin.call(method, *arguments)
        except PluginError as error:
            if self._newest >= 0:
                newest = GpsTime.from_unix_nanoseconds(self._newest)
                self._publish(RelativeSolution.none(newest, (str(error),)))
            self.fail(str(error))

    def _on_epoch(self, craft: str, message: GnssObservations) -> None:
        self._add(craft, to_nanoseconds(message.header.stamp), observations_from_message(message))

    def _on_laser(self, message: LaserRange) -> None:
        if self.is_of_deputy(message, self.parameters.deputy, "laser_range"):
            stamp = to_nanoseconds(message.header.stamp)
            self._add(LASER, stamp, laser_from_message(message))

    def _on_clock(self, message: Clock) -> None:
        stamp = to_nanoseconds(message.clock)
        self._restart_after_jump_back(stamp)
        self._join.expect(stamp, time.monotonic())
        self._process_complete()

    def _on_step_done(self, message: StepDone) -> None:
        source = self._source_of_node.get(message.node)
        if source is not None:
            self._join.close(source, to_nanoseconds(message.header.stamp), time.monotonic())
            self._process_complete()

    def _add(self, source: str, stamp: int, measurement: Any) -> None:
        self._restart_after_jump_back(stamp)
        self._join.add(source, stamp, measurement, time.monotonic())
        self._process_complete()

    def _restart_after_jump_back(self, stamp: int) -> None:
        """Start navigation anew when time has jumped back, as in a log that begins again."""
        if stamp < self._newest - StampOrder.JUMP_BACK:
            self.get_logger().warning("time has jumped back: navigation starts anew")
            self._tell(self._estimator.reset)
            self._join.restart()
            self._newest = -1
        self._newest = max(self._newest, stamp)

    def _check_inputs(self) -> None:
        if self.common.reports_ready and self._inputs_since != math.inf:
            self._report_when_connected()
        self._process_complete()

    def _report_when_connected(self) -> None:
        """Report readiness a moment after all inputs have publishers, so that none is missed."""
        given: RelativeEkfParameters = self.parameters
        topics = [f"{namespace}gnss/epoch" for namespace in self._namespaces.values()]
        topics += ["laser_range"] if given.use_laser else []
        if not all(self.count_publishers(topic) for topic in topics):
            return
        now = time.monotonic()
        self._inputs_since = now if self._inputs_since is None else self._inputs_since
        if now - self._inputs_since > SETTLE_TIME:
            self._inputs_since = math.inf
            self.report_ready()

    # ---- work --------------------------------------------------------------------------------

    def _process_complete(self) -> None:
        while not self.finished and (epoch := self._join.take(time.monotonic())) is not None:
            self._process(epoch)

    def _process(self, epoch: JoinedEpoch) -> None:
        started = time.perf_counter()
        given: RelativeEkfParameters = self.parameters
        measured = epoch.measured
        time_epoch = GpsTime.from_unix_nanoseconds(epoch.stamp_nanoseconds)
        plugin_problem = ""
        interval = 1e-9 * (epoch.stamp_nanoseconds - self._processed_nanoseconds)
        self.plugin.sample_time = interval if interval > 0.0 else math.inf
        self._processed_nanoseconds = epoch.stamp_nanoseconds
        try:
            solution = self.plugin.call(
                self._estimator.process,
                time_epoch,
                measured.get(given.chief),
                measured.get(given.deputy),
                measured.get(LASER),
                check=check_solution,
            )
        except PluginError as error:
            plugin_problem = str(error)
            solution = RelativeSolution.none(time_epoch, (plugin_problem,))
        self._compute_time = time.perf_counter() - started
        self._publish(solution)
        if plugin_problem:
            self.fail(plugin_problem)
            return
        self.acknowledge_step(to_stamp(epoch.stamp_nanoseconds), started)

    def _publish(self, solution: RelativeSolution) -> None:
        """Publish a solution, the state first: the controller waits for it."""
        given: RelativeEkfParameters = self.parameters
        self._solution = solution
        self._epochs[SOLUTION_NAMES[solution.solution]] += 1
        self._state_publisher.publish(
            relative_state_to_message(solution, given.chief, given.deputy)
        )
        self._ambiguity_publisher.publish(
            ambiguities_to_message(solution, given.chief, given.deputy)
        )
        self._tec_publisher.publish(
            differential_tec_to_message(solution, given.chief, given.deputy)
        )

    # ---- health ------------------------------------------------------------------------------

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report the kind of the solution and, if it is degraded, why."""
        solution = self._solution
        if solution is None:
            text, level = "no epoch yet", diagnostics.WARN
        elif solution.solution == SOLUTION_NONE:
            text, level = f"no solution: {'; '.join(solution.degraded)}", diagnostics.WARN
        else:
            is_fixed = solution.solution == SOLUTION_FIXED and not solution.degraded
            level = diagnostics.OK if is_fixed else diagnostics.WARN
            text = "; ".join([SOLUTION_NAMES[solution.solution], *solution.degraded])
        return [
            diagnostics.status(
                f"{self.get_name()}: solution",
                level,
                text,
                {
                    **{f"epochs {name}": count for name, count in self._epochs.items()},
                    **{f"epochs without {k}": n for k, n in self._join.incomplete.items()},
                    "measurements too late": self._join.late,
                    "thrust not finite": self._refused_thrust,
                    "compute time of the last epoch": self._compute_time,
                    **(_diagnostic_values(solution) if solution is not None else {}),
                },
                hardware_id=self.parameters.deputy,
            )
        ]


def _diagnostic_values(solution: RelativeSolution) -> dict[str, object]:
    """Return the values of a solution for /diagnostics; estimates that are NaN are left out."""
    estimated = {
        "laser latency, s": solution.laser_latency,
        "sigma of laser latency, s": solution.laser_latency_sigma,
        "laser residual, m": solution.laser_residual,
        "local electron density, per m3": solution.local_electron_density,
        "sigma of local electron density, per m3": solution.local_electron_density_sigma,
    }
    return {
        **{name: value for name, value in estimated.items() if math.isfinite(value)},
        "satellites": solution.satellites_used,
        "ambiguities fixed": solution.ambiguities_fixed,
        "ratio": round(solution.ratio, 2),
        "innovation rms": round(solution.innovation_rms, 3),
        "age": solution.age,
        "excluded": ", ".join(solution.excluded),
    }


NODE_CLASS = RelativeEkfNode


def main() -> None:
    """Run the node."""
    run_node(RelativeEkfNode)
