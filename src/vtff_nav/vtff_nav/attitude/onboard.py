"""The estimator as it runs on board: reports of the ADCS module in, attitude, dipole and wheel out.

Joins `AttitudeDetermination` with the observer of the wheel. What a report does not tell, the orbit
and the field of the model there, the caller gives.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.attitude.field_motion import field_motion
from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.vectors import FloatArray
from vtff_nav.attitude.attitude_filter import AttitudeEstimate, FilterPeriod
from vtff_nav.attitude.configuration import AttitudeFilterConfiguration, BodyModel
from vtff_nav.attitude.determination import (
    AttitudeDetermination,
    DeterminationConfiguration,
    DeterminationStatus,
)
from vtff_nav.attitude.wheel_observer import WheelObserver, WheelObserverConfiguration

__all__ = [
    "ModuleReport",
    "OnboardAttitude",
    "OnboardAttitudeEstimator",
    "process_synthetic_samples",
]


@dataclass(frozen=True)
class ModuleReport:
    """Report of the ADCS module at the end of a period, as the estimator uses it.

    Attributes
    ----------
    period
        s; 0 before the first period.
    field_body
        Samples of the magnetometer, T, shape (count, 3), in the order of time.
    sample_times
        Times of the samples before the end of the period, s, falling.
    wheel_speed_rpm, wheel_command_rpm
        Measured speed, and the speed that the wheel was told to have now.
    pulses
        On-times of the torquers from the start of the period, s, with the sign of the moment,
        shape (3,).
    heard
        False if the module said nothing: the wheel is then taken as told, the rods as off.
    """

    period: float
    field_body: FloatArray
    sample_times: tuple[float, ...]
    wheel_speed_rpm: float
    wheel_command_rpm: float
    pulses: FloatArray
    heard: bool = True

    @property
    def rate_across(self) -> float:
        """Rate of the body across the field, rad/s, that two samples show; else 0."""
        if len(self.field_body) < 2:
            return 0.0
        interval = self.sample_times[0] - self.sample_times[-1]
        return field_motion(self.field_body[0], self.field_body[-1], interval).rate_across


@dataclass(frozen=True)
class OnboardAttitude:
    """Estimate on board at the end of a period.

    Attributes
    ----------
    status
        Verdict on the sample.
    estimate
        None before the first sample.
    wheel_speed_rpm
        Speed that the observer gives.
    wheel_follows
        False if the wheel does not do what it is told.
    field_is_valid
        False if the samples cannot be true.
    correction
        See `AttitudeDetermination.correction`, rad, body axes, shape (3,).
    """

    status: DeterminationStatus
    estimate: AttitudeEstimate | None
    wheel_speed_rpm: float
    wheel_follows: bool
    field_is_valid: bool
    correction: FloatArray


class OnboardAttitudeEstimator:
    """The estimator; `process` once in a period.

    Parameters
    ----------
    body : BodyModel
    filter_configuration : AttitudeFilterConfiguration
    configuration : DeterminationConfiguration, optional
    wheel_speed_rpm : float, optional
        Speed of the wheel at the start; by default that of the first report.
    """

    def __init__(
        self,
        body: BodyModel,
        filter_configuration: AttitudeFilterConfiguration,
        configuration: DeterminationConfiguration | None = None,
        wheel_speed_rpm: float | None = None,
    ) -> None:
        self._wheel_configuration = WheelObserverConfiguration(body.wheel_inertia)
        self._wheel = (
            None
            if wheel_speed_rpm is None
            else WheelObserver(self._wheel_configuration, wheel_speed_rpm)
        )
        self._determination = AttitudeDetermination(body, filter_configuration, configuration)

    def expect(self, quaternion_gcrf: FloatArray, rate_body: FloatArray) -> None:
        """Take it that the spacecraft has an attitude, see `AttitudeDetermination.expect`."""
        self._determination.expect(quaternion_gcrf, rate_body)

    def process(
        self,
        report: ModuleReport,
        state_start_gcrf: FloatArray,
        field_start_gcrf: FloatArray,
        field_end_gcrf: FloatArray,
        thruster_forces: FloatArray | None = None,
    ) -> OnboardAttitude:
        """Take the report of a period.

        Parameters
        ----------
        report : ModuleReport
        state_start_gcrf : ndarray, shape (6,)
            Position and velocity at the start of the period, m and m/s.
        field_start_gcrf, field_end_gcrf : ndarray, shape (3,)
            Field of the model at start and end of the period, T.
        thruster_forces : ndarray, shape (parts, 3), optional
            Forces of thrusters along the axes of the body in equal parts of the period, N.
        """
        if self._wheel is None:
            self._wheel = WheelObserver(self._wheel_configuration, report.wheel_speed_rpm)
        wheel = self._wheel
        if not report.period > 0.0:
            known = self._determination
            return OnboardAttitude(
                known.status,
                known.estimate,
                wheel.speed_rpm,
                wheel.follows,
                False,
                np.full(3, math.nan),
            )
        wheel_start = wheel.momentum
        wheel_end = wheel.predict(report.wheel_command_rpm, report.period)
        status = self._determination.process(
            FilterPeriod(
                report.period,
                field_start_gcrf,
                field_end_gcrf,
                state_start_gcrf[:3] + 0.5 * report.period * state_start_gcrf[3:],
                wheel_start,
                wheel_end,
                np.asarray(report.pulses, dtype=float),
                np.zeros((1, 3)) if thruster_forces is None else thruster_forces,
            ),
            report.field_body[-1] if len(report.field_body) else None,
            report.rate_across,
        )
        if report.heard:
            surprise = wheel.update(report.wheel_speed_rpm)
            if surprise:
                self._determination.note_wheel(surprise)
        return OnboardAttitude(
            status,
            self._determination.estimate,
            wheel.speed_rpm,
            wheel.follows,
            not status.reason.startswith("magnetometer"),
            self._determination.correction,
        )


def process_synthetic_samples(estimator: OnboardAttitudeEstimator) -> None:
    """Process samples of a slowly turning field with an estimator; the first ones compile.

    Parameters
    ----------
    estimator : OnboardAttitudeEstimator
        An estimator that is used for nothing else.
    """
    radius = 7.0e6
    state = np.array([radius, 0.0, 0.0, 0.0, math.sqrt(GM_EARTH / radius), 0.0])
    strength = 3e-5  # T
    for number in range(3):
        angle = 0.01 * number
        field = strength * np.array([math.cos(angle), math.sin(angle), 0.1])
        samples = np.array([field, field])
        report = ModuleReport(5.0, samples, (0.8, 0.0), 0.0, 0.0, np.array([0.1, -0.2, 0.3]))
        estimator.process(report, state, field, field)
