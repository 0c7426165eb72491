"""Momentum of the wheel from what it was told and what its tachometer shows.

The tachometer is coarse (5 rpm are 1e-5 N m s, more torque than any disturbance gives in a period),
while the wheel follows its command well: the command is believed, and slowly corrected by the
tachometer. A wheel that does not follow is named, and then only the tachometer is believed.
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
    correction : float
        Share of the tachometer's difference that is taken over in a period.
    largest_difference_rpm : float
        Difference beyond which the wheel does not follow, rpm.
    """

    inertia: float = 0.01 / (5000.0 * _RATE_OF_RPM)
    largest_torque: float = 1e-3
    correction: float = 0.01
    largest_difference_rpm: float = 30.0


class WheelObserver:
    """The observer; `predict` with the command of a period, then `update` at its end."""

    def __init__(self, configuration: WheelObserverConfiguration, speed_rpm: float) -> None:
        self._configuration = configuration
        self._speed_rpm = speed_rpm
        self._follows = True
        self._expected_rpm = speed_rpm

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
        change = min(max(command_rpm - self._speed_rpm, -most), most)
        self._expected_rpm = self._speed_rpm + change
        if self._follows:
            self._speed_rpm = self._expected_rpm
        return self.momentum

    def update(self, measured_rpm: float) -> None:
        """Take the tachometer at the end of a period."""
        difference = measured_rpm - self._expected_rpm
        largest = self._configuration.largest_difference_rpm
        if abs(difference) > largest:
            self._follows = False
        elif not self._follows and abs(difference) < 0.5 * largest:
            self._follows = True
            self._speed_rpm = self._expected_rpm
        if self._follows:
            self._speed_rpm += self._configuration.correction * difference
        else:
            self._speed_rpm = measured_rpm
