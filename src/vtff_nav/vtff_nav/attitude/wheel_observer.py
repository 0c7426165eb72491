"""Momentum of the wheel from what it was told and what its tachometer shows.

The tachometer is coarse (5 rpm are 1e-5 N m s, more torque than any disturbance gives in a period),
while the wheel follows its command well: the command is believed. The tachometer does not correct
it, because each correction would be a torque that nobody gave to the body. A wheel that does not
follow is named, and then only the tachometer is believed, until its changes of speed prove that it
follows again. Small commands prove nothing: a stuck wheel is near them too, because its controller
starts from the measured speed.

References
----------
Page (1954), Continuous inspection schemes, Biometrika 41, 100-115: the sum of log-likelihood ratios
that is never below zero.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["WheelObserver", "WheelObserverConfiguration"]

_RATE_OF_RPM = 2.0 * math.pi / 60.0


@dataclass(frozen=True)
class WheelObserverConfiguration:
    """What is known of the wheel.

    Parameters
    ----------
    inertia : float
        kg m2.
    largest_torque : float
        N m.
    largest_difference_rpm : float
        Difference beyond which the wheel does not follow, rpm: more than the tachometer and the
        observer can be wrong together.
    tachometer_error_rpm : float
        Largest error of the tachometer, rpm.
    proof : float
        Logarithm of the likelihood of a wheel that follows over that of one that is stuck, from
        which a wheel is taken to follow again.
    """

    inertia: float = 0.01 / (5000.0 * _RATE_OF_RPM)
    largest_torque: float = 1e-3
    largest_difference_rpm: float = 12.0
    tachometer_error_rpm: float = 5.0
    proof: float = 12.0


class WheelObserver:
    """The observer; `predict` with the command of a period, then `update` at its end."""

    def __init__(self, configuration: WheelObserverConfiguration, speed_rpm: float) -> None:
        self._configuration = configuration
        self._speed_rpm = speed_rpm
        self._follows = True
        self._expected_rpm = speed_rpm
        self._measured_rpm = speed_rpm
        self._commanded_change = 0.0
        self._proof = 0.0

    @property
    def speed_rpm(self) -> float:
        """Speed now, rpm."""
        return self._speed_rpm

    @property
    def momentum(self) -> float:
        """Momentum now, N m s."""
        return self._configuration.inertia * self._speed_rpm * _RATE_OF_RPM

    @property
    def follows(self) -> bool:
        """False while the wheel does not do what it is told."""
        return self._follows

    def predict(self, command_rpm: float, period: float) -> float:
        """Return the momentum at the end of a period, N m s, for a commanded speed."""
        settings = self._configuration
        most = settings.largest_torque * period / settings.inertia / _RATE_OF_RPM
        self._commanded_change = min(max(command_rpm - self._speed_rpm, -most), most)
        self._expected_rpm = self._speed_rpm + self._commanded_change
        if self._follows:
            self._speed_rpm = self._expected_rpm
        return self.momentum

    def update(self, measured_rpm: float) -> float:
        """Take the tachometer at the end of a period.

        Returns
        -------
        float
            Momentum by which the wheel is found off when it is first seen not to follow, N m s:
            the body has the opposite, against what was believed. Else 0.
        """
        settings, believed = self._configuration, self.momentum
        difference = measured_rpm - self._expected_rpm
        change, self._measured_rpm = measured_rpm - self._measured_rpm, measured_rpm
        if self._follows and abs(difference) <= settings.largest_difference_rpm:
            return 0.0
        if self._follows:
            self._follows, self._proof = False, 0.0
            self._speed_rpm = measured_rpm
            return self.momentum - believed
        if self._is_proven(change):
            self._follows = True
            self._speed_rpm = measured_rpm
        else:
            # A wheel that is stuck keeps its speed: the error of the tachometer averages out.
            off = measured_rpm - self._speed_rpm
            is_noise = abs(off) <= 2.0 * settings.tachometer_error_rpm
            self._speed_rpm += (0.1 if is_noise else 1.0) * off
        return 0.0

    def _is_proven(self, change_rpm: float) -> bool:
        """Return whether the changes of speed so far are those of a wheel that follows."""
        settings = self._configuration
        variance = 2.0 * settings.tachometer_error_rpm**2 / 3.0  # of two uniform errors
        unanswered = change_rpm - self._commanded_change
        ratio = 0.5 * (change_rpm**2 - unanswered**2) / variance
        self._proof = max(0.0, self._proof + ratio)
        return self._proof > settings.proof
