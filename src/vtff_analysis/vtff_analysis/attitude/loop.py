"""Closed loop of one spacecraft's attitude without ROS: truth, module, estimator, controller.

One call of `step` is one period of the ADCS. The parts are those of the graph: the emulated module
gives samples, `OnboardAttitudeEstimator` the attitude, `AttitudeController` the next command.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from vtff_control.attitude.controller import (
    MODES,
    AttitudeCommand,
    AttitudeControlConfiguration,
    AttitudeController,
    AttitudeKnowledge,
    ControlMode,
)
from vtff_control.attitude.pointing import pointing_errors
from vtff_dynamics.attitude.orbit_track import OrbitTrack
from vtff_dynamics.attitude.quaternion import conjugate, multiply, rotation_vector
from vtff_dynamics.attitude.rigid_body import AttitudeState
from vtff_dynamics.attitude.spacecraft import AttitudePropagator, SpacecraftBody, TorqueWindow
from vtff_dynamics.vectors import FloatArray
from vtff_nav.attitude.attitude_filter import AttitudeEstimate
from vtff_nav.attitude.configuration import AttitudeFilterConfiguration, BodyModel
from vtff_nav.attitude.determination import DeterminationConfiguration, DeterminationStatus
from vtff_nav.attitude.onboard import ModuleReport, OnboardAttitude, OnboardAttitudeEstimator
from vtff_nav.attitude.wheel_observer import WheelObserver, WheelObserverConfiguration
from vtff_sim_bridge.attitude.adcs_module import (
    AdcsCommand,
    AdcsModule,
    AdcsModuleModel,
    AdcsReport,
)
from vtff_sim_bridge.attitude.magnetometer import Magnetometer, MagnetometerModel

__all__ = ["AttitudeHistory", "AttitudeLoop", "LoopConfiguration", "LoopStep"]


@dataclass(frozen=True)
class LoopConfiguration:
    """All that a loop is made of: what is true, and what is believed.

    Attributes
    ----------
    body, magnetometer, module
        The truth.
    believed_body, filter, determination, control
        Spacecraft and settings as estimator and controller have them.
    """

    body: SpacecraftBody = field(default_factory=SpacecraftBody)
    magnetometer: MagnetometerModel = field(default_factory=MagnetometerModel)
    module: AdcsModuleModel = field(default_factory=AdcsModuleModel)
    believed_body: BodyModel = field(default_factory=BodyModel)
    filter: AttitudeFilterConfiguration = field(default_factory=AttitudeFilterConfiguration)
    determination: DeterminationConfiguration = field(default_factory=DeterminationConfiguration)
    control: AttitudeControlConfiguration = field(default_factory=AttitudeControlConfiguration)


@dataclass(frozen=True)
class LoopStep:
    """One period of a loop, at its end.

    Attributes
    ----------
    truth
        True attitude.
    report
        Sample that the ADCS module sent.
    status
        Verdict of the estimator on the sample.
    estimate
        State of the estimator; None before its first sample, or without an estimator.
    correction
        See `vtff_nav.attitude.determination.AttitudeDetermination.correction`.
    command
        Command for the next period.
    """

    truth: AttitudeState
    report: AdcsReport
    status: DeterminationStatus
    estimate: AttitudeEstimate | None
    correction: FloatArray
    command: AttitudeCommand


class AttitudeLoop:
    """The loop.

    Parameters
    ----------
    track : OrbitTrack
        The orbit; the field in it is the true one, with its error.
    configuration : LoopConfiguration
    start : AttitudeState
    seed : int
        Seed of the noise of magnetometer and tachometer.
    requested, first : str
        Modes of the controller.
    estimates : bool
        Without, there is no estimator: modes that need no attitude only.
    """

    def __init__(
        self,
        track: OrbitTrack,
        configuration: LoopConfiguration,
        start: AttitudeState,
        seed: int = 1,
        requested: ControlMode = "point",
        first: ControlMode = "detumble",
        estimates: bool = True,
    ) -> None:
        self.track = track
        self.configuration = configuration
        self.spacecraft = AttitudePropagator(configuration.body, start)
        self.magnetometer = Magnetometer(configuration.magnetometer, (seed, 1))
        self.module = AdcsModule(
            configuration.module, self.spacecraft, self.magnetometer, (seed, 2)
        )
        self.controller = AttitudeController(configuration.control, requested, first)
        speed = configuration.body.wheel_speed_rpm(start.wheel_momentum)
        self._wheel = WheelObserver(
            WheelObserverConfiguration(configuration.believed_body.wheel_inertia), speed
        )
        self.estimator = OnboardAttitudeEstimator(
            configuration.believed_body,
            configuration.filter,
            configuration.determination,
            wheel_speed_rpm=speed,
        )
        self._estimates = estimates
        self._command = AttitudeCommand((0, 0, 0), speed, first)
        self.number = 0

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return self.number * self.track.period

    def step(self, windows: Sequence[TorqueWindow] = ()) -> LoopStep:
        """Fly one period; `windows` are torques of thrusters in it."""
        number = self.number
        command = AdcsCommand(self._command.pulse_steps, self._command.wheel_speed_rpm)
        report = self.module.run_period(self.track.interval(number), command, windows)
        known = self._know(report)
        self._command = self.controller.command(self._knowledge(report, known))
        self.number = number + 1
        return LoopStep(
            self.spacecraft.state,
            report,
            known.status,
            known.estimate,
            known.correction,
            self._command,
        )

    def _know(self, report: AdcsReport) -> OnboardAttitude:
        """Return what is known on board after a report; without estimator, of the wheel alone."""
        number, track = self.number, self.track
        module = self.configuration.module
        if not self._estimates:
            self._wheel.predict(report.wheel_command_rpm, track.period)
            self._wheel.update(report.wheel_speed_rpm)
            status = DeterminationStatus(False, False, 0, 0, math.nan, "no estimator")
            wheel = self._wheel
            nothing = np.full(3, math.nan)
            return OnboardAttitude(status, None, wheel.speed_rpm, wheel.follows, True, nothing)
        return self.estimator.process(
            ModuleReport(
                track.period,
                report.field_body,
                module.sample_times,
                report.wheel_speed_rpm,
                report.wheel_command_rpm,
                module.pulse_step * np.array(report.pulse_steps, dtype=float),
            ),
            track.state_gcrf(number),
            track.field_gcrf(number),
            track.field_gcrf(number + 1),
        )

    def _knowledge(self, report: AdcsReport, known: OnboardAttitude) -> AttitudeKnowledge:
        times = self.configuration.module.sample_times
        estimate = known.estimate
        return AttitudeKnowledge(
            samples_body=report.field_body,
            sample_interval=times[0] - times[-1],
            wheel_speed_rpm=known.wheel_speed_rpm,
            wheel_follows=known.wheel_follows,
            attitude_is_valid=known.status.valid and estimate is not None,
            quaternion_gcrf=(
                np.array([0.0, 0.0, 0.0, 1.0]) if estimate is None else estimate.quaternion_gcrf
            ),
            rate_body=np.zeros(3) if estimate is None else estimate.rate_body,
            dipole=np.zeros(3) if estimate is None else estimate.dipole,
            dipole_sigma=math.inf if estimate is None else float(estimate.dipole_sigma.max()),
            state_gcrf=self.track.state_gcrf(self.number + 1),
            field_is_valid=known.field_is_valid,
        )

    def fly(self, periods: int, torques: FloatArray | None = None) -> AttitudeHistory:
        """Fly a number of periods and return their history.

        Parameters
        ----------
        periods : int
        torques : ndarray, shape (periods, 3), optional
            Torque that nobody knows of, constant in each period, N m, body axes.
        """
        history = AttitudeHistory.empty(periods, self.track.period)
        for row in range(periods):
            windows = []
            if torques is not None:
                windows = [TorqueWindow(0.0, self.track.period, torques[row])]
            history.set_row(row, self, self.step(windows))
        return history


@dataclass(frozen=True)
class AttitudeHistory:
    """Columns of a flight, one row for each period, at its end.

    Attributes
    ----------
    time
        s since the start of the loop.
    angles_deg
        True roll, pitch and yaw.
    rate_body
        True rate, rad/s.
    field_body
        Last sample of the magnetometer, T; nan without one.
    wheel_speed_rpm
        True speed.
    rotation_error
        True against estimated attitude as a rotation vector in body axes, rad.
    rate_error, dipole_error
        True less estimated, rad/s and A m2.
    covariance
        Covariance of rotation, rate and dipole, shape (rows, 9, 9).
    pulse_steps
        Pulses given.
    mode
        Mode of the controller, an index of `vtff_control.attitude.controller.MODES`.
    valid
        True where the attitude may steer.
    restarts
        New starts of the estimator.
    correction
        Rotation by which the last sample turned the estimated attitude, rad, body axes; nan if not
        known.
    """

    time: FloatArray
    angles_deg: FloatArray
    rate_body: FloatArray
    field_body: FloatArray
    wheel_speed_rpm: FloatArray
    rotation_error: FloatArray
    rate_error: FloatArray
    dipole_error: FloatArray
    covariance: FloatArray
    pulse_steps: FloatArray
    mode: FloatArray
    valid: FloatArray
    restarts: FloatArray
    correction: FloatArray

    @staticmethod
    def empty(periods: int, period: float) -> AttitudeHistory:
        """Return a history of nan; the first row is at the end of the first period."""

        def columns(*shape: int) -> FloatArray:
            return np.full((periods, *shape), math.nan)

        return AttitudeHistory(
            period * np.arange(1.0, periods + 1.0),
            columns(3),
            columns(3),
            columns(3),
            columns(),
            columns(3),
            columns(3),
            columns(3),
            columns(9, 9),
            columns(3),
            columns(),
            columns(),
            columns(),
            columns(3),
        )

    def set_row(self, row: int, loop: AttitudeLoop, step: LoopStep) -> None:
        """Fill a row with a step of a loop."""
        truth, orbit = step.truth, loop.track.state_gcrf(loop.number)
        self.time[row] = loop.time
        self.angles_deg[row] = np.degrees(
            pointing_errors(truth.rotation_gcrf_from_body, truth.rate_body, orbit).angles
        )
        self.rate_body[row] = truth.rate_body
        if len(step.report.field_body):
            self.field_body[row] = step.report.field_body[-1]
        self.wheel_speed_rpm[row] = loop.spacecraft.body.wheel_speed_rpm(truth.wheel_momentum)
        self.pulse_steps[row] = step.report.pulse_steps
        self.mode[row] = MODES.index(step.command.mode)
        self.valid[row] = step.status.valid
        self.restarts[row] = step.status.restarts
        estimate = step.estimate
        if estimate is None:
            return
        self.rotation_error[row] = rotation_vector(
            multiply(conjugate(estimate.quaternion_gcrf), truth.quaternion_gcrf)
        )
        self.rate_error[row] = truth.rate_body - estimate.rate_body
        self.dipole_error[row] = loop.spacecraft.dipole - estimate.dipole
        self.covariance[row] = estimate.covariance[:9, :9]
        self.correction[row] = step.correction

    @property
    def attitude_error_deg(self) -> FloatArray:
        """Angle of the error of the attitude, deg, one for each row."""
        angle: FloatArray = np.degrees(np.linalg.norm(self.rotation_error, axis=1))
        return angle

    def normalised_error_squared(self, first: int, count: int) -> FloatArray:
        """Return the NEES of a part of the error state, over its size, one for each row.

        Parameters
        ----------
        first, count : int
            0, 3 for the attitude; 3, 3 for the rate; 6, 3 for the dipole; 0, 9 for all.
        """
        errors = np.concatenate((self.rotation_error, self.rate_error, self.dipole_error), axis=1)
        part = slice(first, first + count)
        solved = np.linalg.solve(self.covariance[:, part, part], errors[:, part, None])[..., 0]
        nees: FloatArray = np.einsum("ij,ij->i", errors[:, part], solved) / count
        return nees
