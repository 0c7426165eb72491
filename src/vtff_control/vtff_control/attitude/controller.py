"""Attitude controller of one spacecraft: from tumbling to pointing, one command for each period.

Modes: `off`, `detumble` (B-dot), `thomson` (Y-Thomson spin), `compass` (rates damped, the dipole
follows the field), `acquire` (wheel started, momentum brought to the orbit normal), `point`. A
controller that is asked for `point` goes there by itself, mode by mode, as far as rates and the
sigma of the attitude allow, and back when it loses them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from vtff_control.attitude.compensation import check_compensation, compensate_dipole
from vtff_control.attitude.detumble import (
    ThomsonGains,
    b_dot_moment,
    thomson_moment,
)
from vtff_control.attitude.pointing import (
    MomentumGains,
    PitchGains,
    PointingErrors,
    momentum_moment,
    pitch_wheel_torque,
    pointing_errors,
)
from vtff_control.attitude.torquers import TorquerLimits, shift_along_field
from vtff_dynamics.attitude.field_motion import FieldMotion, field_motion
from vtff_dynamics.attitude.quaternion import rotation_matrix
from vtff_dynamics.attitude.rigid_body import check_inertia
from vtff_dynamics.checks import check_vector
from vtff_dynamics.vectors import FloatArray, cross, norm

__all__ = [
    "MODES",
    "AttitudeCommand",
    "AttitudeControlConfiguration",
    "AttitudeController",
    "AttitudeKnowledge",
    "ControlMode",
]

ControlMode = Literal["off", "detumble", "thomson", "compass", "acquire", "point"]
MODES: tuple[ControlMode, ...] = ("off", "detumble", "thomson", "compass", "acquire", "point")
"""Accepted modes."""

_RATE_OF_RPM = 2.0 * math.pi / 60.0


@dataclass(frozen=True)
class AttitudeControlConfiguration:
    """What the controller knows and how it steers.

    Parameters
    ----------
    inertia : array_like, shape (3, 3) or (3,)
        kg m2.
    wheel_axis : array_like, shape (3,)
    wheel_inertia, wheel_largest_torque : float
        kg m2, N m.
    limits : TorquerLimits
    compensation : {"none", "fixed", "estimated"}
        Biased pulses against the dipole while pointing: none, `fixed_compensation`, or minus the
        estimated dipole.
    fixed_compensation : array_like, shape (3,)
        A m2.
    shifts_along_field : bool
        Add moment along the field where a rod would be beyond its duty.
    pointing_wheel_rpm, compass_wheel_rpm : float
        Speeds of the wheel.
    wheel_ramp_rpm : float
        Change of the speed in a period while the wheel is started, rpm.
    settling_time : float
        Time in which the pitch comes within 2 % of its reference, s.
    pitch_reference : float
        rad.
    b_dot_gain, compass_gain : float
        Torque over rate across the field, N m s.
    turn_of_a_pulse : float
        Angle by which the body may turn during a pulse while it tumbles, rad.
    thomson : ThomsonGains
    thomson_spin : float
        Reference of the spin, rad/s.
    momentum : MomentumGains
        While pointing.
    acquisition : MomentumGains
        While the momentum is brought to the orbit normal.
    detumbled_rate : float
        Rate across the field below which the body no longer tumbles, rad/s.
    settled_periods : int
        Periods for which a condition must hold before the mode changes.
    dipole_sigma : float
        Largest sigma of the dipole with which the wheel is started, A m2.
    lost_periods : int
        Periods without attitude after which `acquire` and `point` are given up for `detumble`.
    wheel_band_rpm : float
        Largest difference of the wheel from its pointing speed that pitch control may command, rpm.
    pointing_cone, lost_cone : float
        Angle of the momentum from the orbit normal below which pitch is captured, and attitude
        error beyond which pointing is given up, rad.

    Raises
    ------
    ValueError
        One line that names the parameter.
    """

    inertia: npt.ArrayLike = (0.055, 0.058, 0.056)
    wheel_axis: npt.ArrayLike = (0.0, 1.0, 0.0)
    wheel_inertia: float = 0.01 / (5000.0 * _RATE_OF_RPM)
    wheel_largest_torque: float = 1e-3
    limits: TorquerLimits = TorquerLimits()
    compensation: Literal["none", "fixed", "estimated"] = "estimated"
    fixed_compensation: npt.ArrayLike = (0.0, 0.0, 0.0)
    shifts_along_field: bool = True
    pointing_wheel_rpm: float = -2700.0
    compass_wheel_rpm: float = 0.0
    wheel_ramp_rpm: float = 2.5
    settling_time: float = 120.0
    pitch_reference: float = 0.0
    b_dot_gain: float = 2e-3
    compass_gain: float = 2e-4
    turn_of_a_pulse: float = 1.0
    thomson: ThomsonGains = ThomsonGains()
    thomson_spin: float = -0.0106
    momentum: MomentumGains = MomentumGains()
    acquisition: MomentumGains = MomentumGains(nutation=2e-3, wheel=0.0, direction=1e-3)
    detumbled_rate: float = 0.02
    settled_periods: int = 60
    dipole_sigma: float = 5e-3
    lost_periods: int = 240
    wheel_band_rpm: float = 1200.0
    pointing_cone: float = math.radians(15.0)
    lost_cone: float = math.radians(60.0)

    def __post_init__(self) -> None:
        """Check the parameters."""
        object.__setattr__(self, "inertia", check_inertia("inertia", self.inertia))
        object.__setattr__(
            self, "wheel_axis", check_vector("wheel_axis", self.wheel_axis, 3, "axis in the body")
        )
        if self.compensation not in ("none", "fixed", "estimated"):
            raise ValueError(
                f"compensation: one of none, fixed, estimated expected, got {self.compensation!r}"
            )
        object.__setattr__(
            self,
            "fixed_compensation",
            check_compensation("fixed_compensation", self.fixed_compensation, self.limits),
        )
        for name in (
            "wheel_inertia",
            "wheel_largest_torque",
            "wheel_ramp_rpm",
            "settling_time",
            "turn_of_a_pulse",
            "detumbled_rate",
            "dipole_sigma",
        ):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name}: expected a positive number; got {getattr(self, name)!r}")


@dataclass(frozen=True)
class AttitudeKnowledge:
    """What the controller is told at the end of a period.

    Attributes
    ----------
    samples_body
        Samples of the magnetometer of this period, T, shape (count, 3); empty from a silent one.
    sample_interval
        Time between the first and the last of them, s.
    wheel_speed_rpm
        rpm.
    wheel_follows
        False if the wheel does not do what it is told.
    attitude_is_valid
        True if what follows may steer.
    quaternion_gcrf, rate_body, dipole
        Estimates: body to GCRF (4,), rad/s (3,), A m2 (3,).
    dipole_sigma
        Largest sigma of an axis of the dipole, A m2.
    state_gcrf
        Position and velocity, m and m/s, shape (6,).
    field_is_valid
        False if the samples cannot be true.
    """

    samples_body: FloatArray
    sample_interval: float
    wheel_speed_rpm: float
    wheel_follows: bool
    attitude_is_valid: bool
    quaternion_gcrf: FloatArray
    rate_body: FloatArray
    dipole: FloatArray
    dipole_sigma: float
    state_gcrf: FloatArray
    field_is_valid: bool = True


@dataclass(frozen=True)
class AttitudeCommand:
    """What the module shall do in the next period.

    Attributes
    ----------
    pulse_steps
        Steps of the pulses of the rods, with the sign of the moment.
    wheel_speed_rpm
        Speed at the end of the period.
    mode
        Mode that gave the command.
    reason
        Why the controller is not in the mode that it is asked for, one line; else empty.
    """

    pulse_steps: tuple[int, int, int]
    wheel_speed_rpm: float
    mode: ControlMode
    reason: str = ""


class AttitudeController:
    """The controller; `command` once in a period.

    Parameters
    ----------
    configuration : AttitudeControlConfiguration
    requested : str
        Mode that it is asked for; `request` changes it.
    first : str
        Mode that it starts in.
    """

    def __init__(
        self,
        configuration: AttitudeControlConfiguration,
        requested: ControlMode = "point",
        first: ControlMode = "detumble",
    ) -> None:
        self._configuration = configuration
        self._inertia = np.asarray(configuration.inertia, dtype=float)
        self._wheel_axis = np.asarray(configuration.wheel_axis, dtype=float)
        self._wheel_moment = float(self._wheel_axis @ self._inertia @ self._wheel_axis)
        self._pitch_gains = PitchGains.for_settling_time(
            configuration.settling_time, configuration.limits.period
        )
        self._requested = requested
        self._mode: ControlMode = first
        self._settled = 0
        self._lost = 0
        self.pitch_reference = configuration.pitch_reference

    @property
    def mode(self) -> ControlMode:
        """Mode now."""
        return self._mode

    def request(self, mode: ControlMode) -> None:
        """Ask for a mode.

        Raises
        ------
        ValueError
            If there is no such mode.
        """
        if mode not in MODES:
            raise ValueError(f"mode: one of {', '.join(MODES)} expected, got {mode!r}")
        self._requested = mode
        self._settled = 0
        if mode in ("off", "detumble", "thomson") or self._mode in ("off", "thomson"):
            self._mode = "detumble" if mode in ("compass", "acquire", "point") else mode

    def command(self, knowledge: AttitudeKnowledge) -> AttitudeCommand:
        """Return the command of the next period. Never raises on what it is told."""
        errors = None
        if knowledge.attitude_is_valid:
            errors = pointing_errors(
                rotation_matrix(knowledge.quaternion_gcrf),
                knowledge.rate_body,
                knowledge.state_gcrf,
            )
        motion = self._field_motion(knowledge)
        reason = self._choose_mode(knowledge, errors, motion)
        if not knowledge.wheel_follows:
            reason = "wheel does not follow its command"
        moment = np.zeros(3)
        longest = None
        wheel = knowledge.wheel_speed_rpm
        settings = self._configuration
        if self._mode in ("detumble", "thomson", "compass") and motion is not None:
            moment = self._moment_without_attitude(motion)
            longest = settings.turn_of_a_pulse / max(motion.rate_across, 1e-6)
            wheel = settings.compass_wheel_rpm
            wheel = self._ramp(knowledge.wheel_speed_rpm, wheel, 4.0 * settings.wheel_ramp_rpm)
        elif self._mode in ("acquire", "point") and errors is not None and motion is not None:
            moment, wheel = self._steer(knowledge, errors, motion)
        elif self._mode in ("acquire", "point") and settings.compensation == "fixed":
            # A given compensation needs no attitude, and less dipole is less drift meanwhile.
            moment = np.asarray(settings.fixed_compensation, dtype=float)
        return AttitudeCommand(
            settings.limits.pulse_steps(moment, longest), wheel, self._mode, reason
        )

    @staticmethod
    def _field_motion(knowledge: AttitudeKnowledge) -> FieldMotion | None:
        samples = knowledge.samples_body
        if not knowledge.field_is_valid or len(samples) == 0 or not norm(samples[-1]) > 0.0:
            return None
        if len(samples) < 2:
            return FieldMotion(samples[-1], np.zeros(3), 0.0, 0.0)
        return field_motion(samples[0], samples[-1], knowledge.sample_interval)

    def _choose_mode(
        self,
        knowledge: AttitudeKnowledge,
        errors: PointingErrors | None,
        motion: FieldMotion | None,
    ) -> str:
        """Change the mode where the next is allowed or this one is lost; return why not there."""
        settings = self._configuration
        mode, wanted = self._mode, self._requested
        if mode == wanted and mode not in ("acquire", "point"):
            return ""
        if mode == "detumble" and wanted in ("compass", "acquire", "point"):
            slow = motion is not None and motion.rate_across < settings.detumbled_rate
            return self._advance_when(slow, "compass", "still tumbling")
        if mode == "compass" and wanted in ("acquire", "point"):
            known = errors is not None and knowledge.dipole_sigma <= settings.dipole_sigma
            return self._advance_when(known, "acquire", "attitude or dipole not yet known")
        if mode in ("acquire", "point"):
            if errors is None:
                self._lost += 1
                if self._lost >= settings.lost_periods:
                    self._mode, self._settled, self._lost = "detumble", 0, 0
                    return "attitude lost: detumbling"
                return "attitude not known: wheel held, no steering"
            self._lost = 0
            tilt = self._momentum_tilt(knowledge, errors)
            if mode == "acquire" and wanted == "point":
                slow = norm(errors.rate_body) < 4.0 * errors.orbit_rate
                running = abs(knowledge.wheel_speed_rpm - settings.pointing_wheel_rpm) < 0.2 * abs(
                    settings.pointing_wheel_rpm
                )
                ready = tilt < settings.pointing_cone and slow and running
                return self._advance_when(ready, "point", "momentum not yet at the orbit normal")
            off = math.acos(max(-1.0, min(1.0, float(errors.rotation_body_from_orbit[1, 1]))))
            if mode == "point" and off > settings.lost_cone:
                self._mode = "acquire"
                self._settled = 0
                return "pointing lost"
        return ""

    def _advance_when(self, condition: bool, mode: ControlMode, otherwise: str) -> str:
        self._settled = self._settled + 1 if condition else 0
        if self._settled < self._configuration.settled_periods:
            return otherwise
        self._mode = mode
        self._settled = 0
        return ""

    def _momentum_tilt(self, knowledge: AttitudeKnowledge, errors: PointingErrors) -> float:
        """Return the angle between the spin axis and the orbit normal, rad."""
        normal = -errors.rotation_body_from_orbit[:, 1]
        momentum = self._inertia @ knowledge.rate_body + self._momentum(knowledge) * (
            self._wheel_axis
        )
        return math.acos(max(-1.0, min(1.0, float(normal @ momentum) / max(norm(momentum), 1e-12))))

    def _momentum(self, knowledge: AttitudeKnowledge) -> float:
        return self._configuration.wheel_inertia * knowledge.wheel_speed_rpm * _RATE_OF_RPM

    def _moment_without_attitude(self, motion: FieldMotion) -> FloatArray:
        settings = self._configuration
        if self._mode == "thomson":
            return thomson_moment(motion, settings.thomson_spin, settings.thomson)
        gain = settings.b_dot_gain if self._mode == "detumble" else settings.compass_gain
        return b_dot_moment(motion, gain)

    @staticmethod
    def _ramp(now: float, wanted: float, most: float) -> float:
        return now + min(max(wanted - now, -most), most)

    def _steer(
        self, knowledge: AttitudeKnowledge, errors: PointingErrors, motion: FieldMotion
    ) -> tuple[FloatArray, float]:
        """Return the moment and the speed of the wheel for `acquire` and `point`."""
        settings = self._configuration
        momentum = self._momentum(knowledge)
        reference = settings.wheel_inertia * settings.pointing_wheel_rpm * _RATE_OF_RPM
        if not knowledge.wheel_follows:
            reference = momentum  # a torque for a wheel that does not take it up spins the body
        pointing = self._mode == "point"
        period = settings.limits.period
        if pointing:
            torque = pitch_wheel_torque(
                math.remainder(float(errors.angles[1]) - self.pitch_reference, 2.0 * math.pi),
                float(self._wheel_axis @ errors.rate_body),
                self._wheel_moment,
                self._pitch_gains,
                settings.wheel_largest_torque,
            )
            speed = (momentum + torque * period) / settings.wheel_inertia / _RATE_OF_RPM
            lowest = settings.pointing_wheel_rpm - settings.wheel_band_rpm
            highest = settings.pointing_wheel_rpm + settings.wheel_band_rpm
            speed = min(max(speed, lowest), highest)
            gains = settings.momentum
        else:
            speed = self._ramp(
                knowledge.wheel_speed_rpm, settings.pointing_wheel_rpm, settings.wheel_ramp_rpm
            )
            gains = settings.acquisition
        moment = momentum_moment(
            errors, self._inertia, momentum, reference, self._wheel_axis, motion.field_body, gains
        )
        if not pointing or not knowledge.wheel_follows:
            # The start of the wheel, and a wheel that is stuck, leave the body turning about its
            # axis; the torquers take that up too.
            spin = float(self._wheel_axis @ errors.rate_body)
            wanted = -gains.nutation * self._wheel_moment * spin * self._wheel_axis
            square = float(motion.field_body @ motion.field_body)
            moment = moment + cross(motion.field_body, wanted) / square
        if settings.compensation == "fixed":
            moment = moment + np.asarray(settings.fixed_compensation)
        elif settings.compensation == "estimated":
            if settings.shifts_along_field:
                moment = shift_along_field(
                    moment - knowledge.dipole,
                    motion.field_body,
                    settings.limits.largest_mean_moment,
                )
            else:
                moment = moment + compensate_dipole(knowledge.dipole, settings.limits).moment
        return moment, speed
