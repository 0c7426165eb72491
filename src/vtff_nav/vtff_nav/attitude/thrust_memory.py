"""What the thrusters of a body have reported in the last minutes, as forces over a period."""

from __future__ import annotations

import numpy as np

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray

__all__ = ["ThrustMemory"]

_KEPT = 256


class ThrustMemory:
    """Thrusts by the time at which they start; each acts for one step.

    Parameters
    ----------
    mass : float
        Mass of the spacecraft, kg: thrusts are told as accelerations.
    step : float
        Time for which each acts, s.
    """

    def __init__(self, mass: float, step: float) -> None:
        self._mass = mass
        self._step_nanoseconds = round(step * NANOSECONDS_PER_SECOND)
        self._accelerations: dict[int, FloatArray] = {}

    def add(self, start_nanoseconds: int, acceleration_body: FloatArray) -> None:
        """Keep a thrust, m/s2, body axes, shape (3,); one that is not finite is ignored."""
        acceleration = np.array(acceleration_body, dtype=float)
        if acceleration.shape == (3,) and np.isfinite(acceleration).all():
            self._accelerations[start_nanoseconds] = acceleration
        while len(self._accelerations) > _KEPT:
            del self._accelerations[min(self._accelerations)]

    def reaches(self, end_nanoseconds: int) -> bool:
        """Return whether the thrust of the step that ends at a time has been told."""
        return end_nanoseconds - self._step_nanoseconds in self._accelerations

    def forces(self, start_nanoseconds: int, end_nanoseconds: int) -> FloatArray:
        """Return the forces of the steps between two times, N, body axes, shape (steps, 3).

        A step without a report counts as one without thrust.
        """
        nothing = np.zeros(3)
        starts = range(start_nanoseconds, end_nanoseconds, self._step_nanoseconds)
        told = [self._accelerations.get(start, nothing) for start in starts]
        return self._mass * np.array(told or [nothing])
