"""The emulated ADCS module of a spacecraft: commands in, samples out, once in a period.

The module switches the rods on at the start of a period for as many steps of 10 ms as it was told,
runs the wheel to the commanded speed by the end of the period, and samples the magnetometer in the
quiet window. It guards its limits itself, as the hardware does: no pulse is longer than the window
leaves, whatever the command.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.attitude.rigid_body import OrbitInterval
from vtff_dynamics.attitude.spacecraft import AttitudePropagator, TorqueWindow
from vtff_dynamics.vectors import FloatArray
from vtff_sim_bridge.attitude.magnetometer import Magnetometer

__all__ = ["AdcsCommand", "AdcsModule", "AdcsModuleModel", "AdcsReport"]

_TIME_RESOLUTION = 1e-9  # s; times that are closer are one


@dataclass(frozen=True)
class AdcsModuleModel:
    """Properties of the module; the defaults are SNAP-1's.

    Parameters
    ----------
    pulse_step : float
        Length of a step of a pulse, s.
    quiet_window : float
        Time at the end of a period in which no rod is on, s.
    sample_times : tuple of float
        Times before the end of the period at which the magnetometer is sampled, s, the first
        largest. Two of them give the rate of the field while the spacecraft tumbles.
    wheel_speed_error_rpm : float
        Half width of the uniform error of the measured speed, rpm.
    """

    pulse_step: float = 0.01
    quiet_window: float = 1.0
    sample_times: tuple[float, ...] = (0.8, 0.0)
    wheel_speed_error_rpm: float = 5.0

    def __post_init__(self) -> None:
        """Check the properties."""
        if not self.pulse_step > 0.0:
            raise ValueError(f"pulse_step: expected a positive number (s); got {self.pulse_step!r}")
        if not self.quiet_window >= 0.0:
            raise ValueError(f"quiet_window: expected 0 or more (s); got {self.quiet_window!r}")
        times = self.sample_times
        if not times or min(times) < 0.0 or list(times) != sorted(set(times), reverse=True):
            raise ValueError(
                "sample_times: expected falling times before the end of the period (s), 0 or more; "
                f"got {list(times)}"
            )


@dataclass(frozen=True)
class AdcsCommand:
    """What the module is told for a period.

    Attributes
    ----------
    pulse_steps
        Steps of 10 ms for which each rod is on, with the sign of its moment, shape (3,).
    wheel_speed_rpm
        Speed that the wheel shall have at the end of the period.
    """

    pulse_steps: tuple[int, int, int] = (0, 0, 0)
    wheel_speed_rpm: float = 0.0


@dataclass(frozen=True)
class AdcsReport:
    """What the module says at the end of a period.

    Attributes
    ----------
    field_body
        Samples of the magnetometer, T, shape (count, 3), in the order of time; empty from a silent
        one.
    wheel_speed_rpm
        Measured speed.
    pulse_steps
        Pulses that it gave.
    wheel_command_rpm
        Speed that the wheel was told to have now.
    """

    field_body: FloatArray
    wheel_speed_rpm: float
    pulse_steps: tuple[int, int, int]
    wheel_command_rpm: float


class AdcsModule:
    """One module and the spacecraft that it turns.

    Parameters
    ----------
    model : AdcsModuleModel
    spacecraft : AttitudePropagator
    magnetometer : Magnetometer
    seed : int or tuple of int
        Seed of the error of the wheel's speed.
    """

    def __init__(
        self,
        model: AdcsModuleModel,
        spacecraft: AttitudePropagator,
        magnetometer: Magnetometer,
        seed: int | tuple[int, ...],
    ) -> None:
        self.model = model
        self.spacecraft = spacecraft
        self.magnetometer = magnetometer
        self.wheel_is_stuck = False
        self._generator = np.random.default_rng(seed)
        self._period = self._elapsed = 0.0
        self._command = AdcsCommand()
        self._windows: tuple[TorqueWindow, ...] = ()
        self._steps = (0, 0, 0)
        self._motor_torque = 0.0
        self._samples: list[FloatArray] = []
        self._sample_times: list[float] = []

    def limit_pulses(self, pulse_steps: npt.ArrayLike, period: float) -> tuple[int, int, int]:
        """Return pulses that leave the quiet window free."""
        longest = math.floor((period - self.model.quiet_window) / self.model.pulse_step + 1e-9)
        x, y, z = np.clip(np.asarray(pulse_steps, dtype=int), -longest, longest).tolist()
        return x, y, z

    def run_period(
        self,
        interval: OrbitInterval,
        command: AdcsCommand,
        windows: Sequence[TorqueWindow] = (),
    ) -> AdcsReport:
        """Fly through a period and return what the module says at its end.

        Parameters
        ----------
        interval : OrbitInterval
            The period.
        command : AdcsCommand
        windows : sequence of TorqueWindow
            Torques of thrusters and others.
        """
        self.begin_period(interval.duration, command, windows)
        self.advance(interval)
        return self.end_period()

    def begin_period(
        self, period: float, command: AdcsCommand, windows: Sequence[TorqueWindow] = ()
    ) -> None:
        """Take the command of a period, s, which begins now.

        Parameters
        ----------
        period : float
            s.
        command : AdcsCommand
        windows : sequence of TorqueWindow
            Torques of thrusters and others, from the start of the period.
        """
        self._period, self._elapsed = period, 0.0
        self._command = command
        self._windows = tuple(windows)
        self._steps = self.limit_pulses(command.pulse_steps, period)
        body = self.spacecraft.body
        largest = body.wheel_largest_speed_rpm
        wanted = body.wheel_momentum(min(max(command.wheel_speed_rpm, -largest), largest))
        self._motor_torque = (wanted - self.spacecraft.state.wheel_momentum) / period
        self._samples = []
        self._sample_times = [period - before_end for before_end in self.model.sample_times]

    def advance(self, interval: OrbitInterval, torque_body: FloatArray | None = None) -> None:
        """Fly through an interval of the period, which may be a part of it or all of it.

        Parameters
        ----------
        interval : OrbitInterval
        torque_body : ndarray, shape (3,), optional
            Torque that acts throughout the interval besides those of the windows, N m.
        """
        torque = 0.0 if self.wheel_is_stuck else self._motor_torque
        begin, end = self._elapsed, self._elapsed + interval.duration
        pulses = self.model.pulse_step * np.array(self._steps, dtype=float)
        left = np.sign(pulses) * np.maximum(np.abs(pulses) - begin, 0.0)
        windows = [
            TorqueWindow(window.start - begin, window.end - begin, window.torque_body)
            for window in self._windows
        ]
        if torque_body is not None:
            windows.append(TorqueWindow(0.0, interval.duration, torque_body))
        time = 0.0
        while self._sample_times and self._sample_times[0] <= end + _TIME_RESOLUTION:
            at = min(max(self._sample_times.pop(0) - begin, time), interval.duration)
            self.spacecraft.advance(interval, left, torque, windows, start=time, end=at)
            time = at
            sample = self.magnetometer.sample(
                self.field_body(interval, at), self.spacecraft.torquer_moment(left, at)
            )
            if sample is not None:
                self._samples.append(sample)
        if time < interval.duration:
            self.spacecraft.advance(
                interval, left, torque, windows, start=time, end=interval.duration
            )
        self._elapsed = end

    def end_period(self) -> AdcsReport:
        """Return what the module says at the end of its period."""
        error = self.model.wheel_speed_error_rpm
        speed = self.spacecraft.body.wheel_speed_rpm(self.spacecraft.state.wheel_momentum)
        measured = speed + error * self._generator.uniform(-1.0, 1.0)
        return AdcsReport(
            np.array(self._samples).reshape(-1, 3),
            measured,
            self._steps,
            self._command.wheel_speed_rpm,
        )

    def field_body(self, interval: OrbitInterval, time: float) -> FloatArray:
        """Return the field of the Earth at a time of an interval, T, body axes, shape (3,)."""
        share = time / interval.duration
        first, middle, last = interval.field_gcrf
        field = (
            (1.0 - share) * (1.0 - 2.0 * share) * first
            + 4.0 * share * (1.0 - share) * middle
            + share * (2.0 * share - 1.0) * last
        )
        body: FloatArray = self.spacecraft.state.rotation_gcrf_from_body.T @ field
        return body
