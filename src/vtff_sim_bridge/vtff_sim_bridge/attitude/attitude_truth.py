"""True attitude of a spacecraft along its orbit, step by step, with its ADCS module."""

from __future__ import annotations

import math
import zlib

import numpy as np

from vtff_dynamics.attitude.magnetic_field import (
    DrawnFieldError,
    check_field_year,
    magnetic_field_gcrf,
)
from vtff_dynamics.attitude.rigid_body import AttitudeState, OrbitInterval
from vtff_dynamics.attitude.spacecraft import AttitudePropagator, TorqueWindow
from vtff_dynamics.constants import EARTH_ROTATION_RATE
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray, norm
from vtff_sim_bridge.attitude.adcs_module import AdcsCommand, AdcsModule, AdcsReport
from vtff_sim_bridge.attitude.attitude_setting import AttitudeSetting
from vtff_sim_bridge.attitude.magnetometer import Magnetometer

__all__ = ["AttitudeTruth"]


class AttitudeTruth:
    """Attitude and module of one spacecraft, advanced with its orbit.

    Parameters
    ----------
    setting : AttitudeSetting
    spacecraft : str
        Name; with the seed it draws what is drawn.
    seed : int
        Seed of the run.
    epoch : GpsTime
    state_gcrf : ndarray, shape (6,)
        Orbit at the epoch, m and m/s.
    step : float
        Step of the simulation, s.

    Attributes
    ----------
    report
        Report of the module on the period that has just ended; before the first, on none.

    Raises
    ------
    ValueError
        One line that names the field: epoch outside the field model, wheel, period.
    """

    def __init__(
        self,
        setting: AttitudeSetting,
        spacecraft: str,
        seed: int,
        epoch: GpsTime,
        state_gcrf: FloatArray,
        step: float,
    ) -> None:
        check_field_year("epoch", epoch)
        self.setting = setting
        self._steps_of_a_period = setting.period_in_steps(step)
        self._step = step
        self._number = 0
        self._epoch = epoch
        self._state_gcrf = np.array(state_gcrf, dtype=float)
        address = (seed, zlib.crc32(spacecraft.encode()))
        sigma = setting.environment.field_error_sigma
        self._field_error = (
            DrawnFieldError(sigma, zlib.crc32(repr(address).encode()), norm(state_gcrf[:3]))
            if sigma > 0.0
            else None
        )
        start = setting.start.state(
            setting.body, self._state_gcrf, np.random.default_rng((*address, 0))
        )
        self._spacecraft = AttitudePropagator(setting.body, start)
        self._magnetometer = Magnetometer(setting.magnetometer, (*address, 1))
        self._module = AdcsModule(
            setting.module, self._spacecraft, self._magnetometer, (*address, 2)
        )
        self._field = magnetic_field_gcrf(epoch, self._state_gcrf[:3], self._field_error)
        speed = setting.body.wheel_speed_rpm(start.wheel_momentum)
        self.report = AdcsReport(np.empty((0, 3)), speed, (0, 0, 0), speed)

    @property
    def state(self) -> AttitudeState:
        """Attitude now."""
        return self._spacecraft.state

    @property
    def dipole(self) -> FloatArray:
        """Residual moment now, A m2, body axes, shape (3,)."""
        return self._spacecraft.dipole

    @property
    def wheel_speed_rpm(self) -> float:
        """Speed of the wheel now."""
        return self.setting.body.wheel_speed_rpm(self.state.wheel_momentum)

    @property
    def begins_period(self) -> bool:
        """Whether a period begins with the next step, so that its command is due."""
        return self._number % self._steps_of_a_period == 0

    @property
    def period_done(self) -> float:
        """Length of the period that `report` is about, s; 0 before the first."""
        return self.setting.period if self._number else 0.0

    def begin_period(
        self,
        command: AdcsCommand | None,
        firing_start: float = 0.0,
        firing_duration: float = 0.0,
    ) -> None:
        """Take the command of the period that begins now.

        Parameters
        ----------
        command : AdcsCommand or None
            None: the module was told nothing; the rods are off, and the wheel holds its speed.
        firing_start, firing_duration : float
            Firing of the thruster, s from the start of the period.
        """
        time = self._number * self._step
        faults = {fault.kind for fault in self.setting.faults if fault.holds_at(time)}
        of_magnetometer = [kind for kind in faults if kind.startswith("magnetometer_")]
        self._magnetometer.fault = (
            min(of_magnetometer).removeprefix("magnetometer_") if of_magnetometer else "none"
        )
        self._module.wheel_is_stuck = "wheel_stuck" in faults
        if command is None:
            command = AdcsCommand((0, 0, 0), self.wheel_speed_rpm)
        windows = []
        thruster = self.setting.thruster
        if firing_duration > 0.0:
            windows = [
                TorqueWindow.of_thruster(
                    firing_start,
                    min(firing_start + firing_duration, self.setting.period),
                    thruster.force_body,
                    thruster.point_body,
                )
            ]
        self._module.begin_period(self.setting.period, command, windows)

    def advance(self, state_gcrf: FloatArray, accelerations: FloatArray | None = None) -> None:
        """Advance by a step of the simulation.

        Parameters
        ----------
        state_gcrf : ndarray, shape (6,)
            Orbit at the end of the step, m and m/s.
        accelerations : ndarray, shape (3, 3), optional
            What the thrusters of the body's axes give in this step, m/s2, see
            `vtff_sim_bridge.attitude.attitude_setting.BodyThrusters.torque`.
        """
        torque = None
        if accelerations is not None and self.setting.propulsion is not None:
            torque = self.setting.propulsion.torque(accelerations)
        before, after, step = self._state_gcrf, np.array(state_gcrf, dtype=float), self._step
        time = self._epoch + self._number * step
        # The cubic through both states: 1e-5 m over 5 s.
        middle = 0.5 * (before[:3] + after[:3]) + 0.125 * step * (before[3:] - after[3:])
        velocity = 1.5 * (after[:3] - before[:3]) / step - 0.25 * (before[3:] + after[3:])
        field_middle = magnetic_field_gcrf(time + 0.5 * step, middle, self._field_error)
        field_after = magnetic_field_gcrf(time + step, after[:3], self._field_error)
        air = velocity - EARTH_ROTATION_RATE * np.array([-middle[1], middle[0], 0.0])
        pressure = self.setting.environment.drag_pressure
        self._module.advance(
            OrbitInterval(
                step,
                np.array([self._field, field_middle, field_after]),
                np.array([before[:3], middle, after[:3]]),
                -pressure * math.sqrt(float(air @ air)) * air,
            ),
            torque,
        )
        self._state_gcrf, self._field = after, field_after
        self._number += 1
        if self.begins_period:
            self.report = self._module.end_period()
