"""A spacecraft that turns: its inertia, wheel, torquers and dipole, and its attitude in time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.attitude.rigid_body import (
    AttitudeState,
    OrbitInterval,
    check_inertia,
    integrate_rotation,
)
from vtff_dynamics.checks import check_vector
from vtff_dynamics.constants import SECONDS_PER_DAY
from vtff_dynamics.vectors import FloatArray, cross

__all__ = ["AttitudePropagator", "SpacecraftBody", "TorqueWindow", "rpm_from_rate"]

_RATE_OF_RPM = 2.0 * math.pi / 60.0
_TIME_RESOLUTION = 1e-9  # s; edges that are closer are one


def rpm_from_rate(rate: float) -> float:
    """Return revolutions per minute of a rate in rad/s."""
    return rate / _RATE_OF_RPM


@dataclass(frozen=True)
class SpacecraftBody:
    """What turns, and what turns it; the defaults are SNAP-1 (Steyn and Hashida 2001, table 1).

    Parameters
    ----------
    inertia : array_like, shape (3, 3) or (3,)
        Inertia without the spin of the wheel, kg m2. The paper gives one number, 0.058; that of the
        pitch axis here. The others are assumed; pitch is the largest, as a Y-Thomson spin needs.
    wheel_axis : array_like, shape (3,)
        Axis of the wheel in the body.
    wheel_inertia : float
        Momentum over rate of the wheel, kg m2: 0.01 N m s at 5000 rpm.
    wheel_largest_speed_rpm, wheel_largest_torque : float
        rpm and N m; the torque is assumed.
    torquer_moment : float
        Moment of a rod that is on, A m2.
    torquer_coupling : array_like, shape (3, 3)
        Moment of the spacecraft over the moments of the rods: the cores of the others, and rods
        that are not quite along the axes. The unit matrix has no coupling.
    dipole : array_like, shape (3,)
        Residual moment at the epoch, A m2.
    dipole_rate : array_like, shape (3,)
        Its change, A m2 in a day.
    drag_point : array_like, shape (3,)
        Centre of pressure from the centre of mass, m.
    longest_step : float
        Longest step of the integration, s.

    Raises
    ------
    ValueError
        One line that names the parameter.
    """

    inertia: npt.ArrayLike = (0.055, 0.058, 0.056)
    wheel_axis: npt.ArrayLike = (0.0, 1.0, 0.0)
    wheel_inertia: float = 0.01 / (5000.0 * _RATE_OF_RPM)
    wheel_largest_speed_rpm: float = 5000.0
    wheel_largest_torque: float = 1e-3
    torquer_moment: float = 0.127
    torquer_coupling: npt.ArrayLike = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    dipole: npt.ArrayLike = (0.0, 0.0, 0.0)
    dipole_rate: npt.ArrayLike = (0.0, 0.0, 0.0)
    drag_point: npt.ArrayLike = (0.0, 0.0, 0.0)
    longest_step: float = 0.1

    def __post_init__(self) -> None:
        """Check the parameters and turn them into arrays."""
        object.__setattr__(self, "inertia", check_inertia("inertia", self.inertia))
        axis = check_vector("wheel_axis", self.wheel_axis, 3, "axis in the body")
        length = math.sqrt(float(axis @ axis))
        if not length > 0.0:
            raise ValueError("wheel_axis: expected a vector that is not zero")
        object.__setattr__(self, "wheel_axis", axis / length)
        for name in (
            "wheel_inertia",
            "wheel_largest_speed_rpm",
            "wheel_largest_torque",
            "torquer_moment",
            "longest_step",
        ):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise ValueError(f"{name}: expected a positive number; got {value!r}")
        coupling = np.array(self.torquer_coupling, dtype=float)
        if coupling.shape != (3, 3) or not np.isfinite(coupling).all():
            raise ValueError("torquer_coupling: expected 3 x 3 finite numbers")
        object.__setattr__(self, "torquer_coupling", coupling)
        for name, unit in (
            ("dipole", "A m2"),
            ("dipole_rate", "A m2 per day"),
            ("drag_point", "m"),
        ):
            object.__setattr__(self, name, check_vector(name, getattr(self, name), 3, unit))

    def wheel_momentum(self, speed_rpm: float) -> float:
        """Return the momentum of the wheel at a speed, N m s.

        Raises
        ------
        ValueError
            If the wheel does not reach the speed.
        """
        if not abs(speed_rpm) <= self.wheel_largest_speed_rpm:
            raise ValueError(
                f"wheel speed: expected at most {self.wheel_largest_speed_rpm:g} rpm either way; "
                f"got {speed_rpm:g} rpm"
            )
        return self.wheel_inertia * speed_rpm * _RATE_OF_RPM

    def wheel_speed_rpm(self, momentum: float) -> float:
        """Return the speed of the wheel with a momentum, rpm."""
        return rpm_from_rate(momentum / self.wheel_inertia)


@dataclass(frozen=True)
class TorqueWindow:
    """A torque that acts for a while, that of a thruster for example.

    Attributes
    ----------
    start, end
        s within the interval.
    torque_body
        N m, shape (3,).
    """

    start: float
    end: float
    torque_body: FloatArray

    @staticmethod
    def of_thruster(
        start: float, end: float, force_body: npt.ArrayLike, point_body: npt.ArrayLike
    ) -> TorqueWindow:
        """Return the torque of a force (3,), N, at a point (3,), m, from the centre of mass.

        A misalignment is a force that is not along its axis, an offset a point that is not behind
        the centre of mass.
        """
        return TorqueWindow(start, end, cross(point_body, force_body))


class AttitudePropagator:
    """Attitude of one spacecraft, advanced by intervals of its orbit.

    Steps begin at the start of an interval and at every edge of a pulse, so that a pulse of any
    length acts exactly as long as it is; free flight does not depend on who asks in which period,
    as long as the intervals are the same.

    Parameters
    ----------
    body : SpacecraftBody
    state : AttitudeState

    Raises
    ------
    ValueError
        If the wheel turns faster than it can.
    """

    def __init__(self, body: SpacecraftBody, state: AttitudeState) -> None:
        speed = body.wheel_speed_rpm(state.wheel_momentum)
        if not abs(speed) <= body.wheel_largest_speed_rpm * (1.0 + 1e-9):
            raise ValueError(
                f"wheel_momentum: the wheel turns with at most {body.wheel_largest_speed_rpm:g} "
                f"rpm; got {speed:.1f} rpm"
            )
        self.body = body
        self._state = state.to_array()
        self._elapsed = 0.0
        self._inertia = np.ascontiguousarray(body.inertia, dtype=float)
        self._inverse_inertia = np.linalg.inv(self._inertia)
        self._dipole = np.asarray(body.dipole, dtype=float)
        self._dipole_rate = np.asarray(body.dipole_rate, dtype=float)
        self._coupling = np.asarray(body.torquer_coupling, dtype=float)
        self._wheel_axis = np.asarray(body.wheel_axis, dtype=float)
        self._drag_point = np.asarray(body.drag_point, dtype=float)
        self._largest_momentum = body.wheel_momentum(body.wheel_largest_speed_rpm)

    @property
    def state(self) -> AttitudeState:
        """Attitude now."""
        return AttitudeState.from_array(self._state)

    @property
    def elapsed(self) -> float:
        """Time since the start, s."""
        return self._elapsed

    @property
    def dipole(self) -> FloatArray:
        """Residual moment now, A m2, shape (3,)."""
        days = self._elapsed / SECONDS_PER_DAY
        moment: FloatArray = self._dipole + days * self._dipole_rate
        return moment

    def torquer_moment(self, pulses: npt.ArrayLike, time: float) -> FloatArray:
        """Return the moment of the torquers at a time within an interval, A m2, shape (3,).

        Parameters
        ----------
        pulses : array_like, shape (3,)
            On-times from the start of the interval, s, with the sign of the moment.
        time : float
            s within the interval.
        """
        on_times = np.asarray(pulses, dtype=float)
        rods = np.where(
            np.abs(on_times) > time + _TIME_RESOLUTION,
            np.sign(on_times) * self.body.torquer_moment,
            0.0,
        )
        moment: FloatArray = self._coupling @ rods
        return moment

    def advance(
        self,
        interval: OrbitInterval,
        pulses: npt.ArrayLike = (0.0, 0.0, 0.0),
        wheel_torque: float = 0.0,
        windows: Sequence[TorqueWindow] = (),
        start: float = 0.0,
        end: float | None = None,
    ) -> None:
        """Advance through an interval, or from `start` to `end` within it.

        Parameters
        ----------
        interval : OrbitInterval
        pulses : array_like, shape (3,)
            On-times of the torquers from the start of the interval, s, with the sign of the moment.
        wheel_torque : float
            Torque of the motor on the wheel, N m; the body gets the opposite. Limited to what the
            motor gives, and zero where the wheel is as fast as it can be.
        windows : sequence of TorqueWindow
            Other torques.
        start, end : float
            s within the interval; by default all of it.
        """
        last = interval.duration if end is None else end
        on_times = np.abs(np.asarray(pulses, dtype=float))
        edges = {start, last}
        edges.update(float(edge) for edge in on_times if start < edge < last)
        for window in windows:
            edges.update(edge for edge in (window.start, window.end) if start < edge < last)
        limit = self.body.wheel_largest_torque
        motor = min(max(wheel_torque, -limit), limit)
        ordered = sorted(edges)
        for left, right in zip(ordered, ordered[1:], strict=False):
            if right - left < _TIME_RESOLUTION:
                continue
            torque = np.zeros(3)
            for window in windows:
                if window.start <= left and right <= window.end:
                    torque = torque + window.torque_body
            motor = self._wheel_within_limits(motor, right - left)
            integrate_rotation(
                self._state,
                left,
                right,
                math.ceil((right - left) / self.body.longest_step - 1e-9),
                interval.duration,
                interval.field_gcrf,
                interval.position_gcrf,
                self._inertia,
                self._inverse_inertia,
                self._wheel_axis,
                motor,
                self.dipole + self.torquer_moment(pulses, left),
                interval.drag_force_gcrf,
                self._drag_point,
                torque,
            )
            self._elapsed += right - left

    def _wheel_within_limits(self, torque: float, duration: float) -> float:
        """Return the torque that leaves the wheel within its speed at the end of a step."""
        momentum = float(self._state[7])
        highest = (self._largest_momentum - momentum) / duration
        lowest = (-self._largest_momentum - momentum) / duration
        return min(max(torque, lowest), highest)
