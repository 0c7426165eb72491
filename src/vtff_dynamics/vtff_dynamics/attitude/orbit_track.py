"""An orbit as attitude needs it: position, field and drag at equal times, computed once.

Every spacecraft, filter and drawn case on the same orbit can share one track.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.attitude.magnetic_field import (
    FieldError,
    check_field_year,
    magnetic_field_gcrf,
)
from vtff_dynamics.attitude.rigid_body import OrbitInterval
from vtff_dynamics.constants import EARTH_ROTATION_RATE
from vtff_dynamics.orbit.propagator import ForceModel, Propagator
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray

__all__ = ["OrbitTrack"]


class OrbitTrack:
    """Positions and fields along an orbit at every half of an interval; grows as it is asked.

    Parameters
    ----------
    epoch : GpsTime
        Start.
    state_gcrf : array_like, shape (6,)
        Position and velocity at the start, m and m/s.
    period : float
        Length of an interval, s.
    force_model : ForceModel, optional
        Forces on the orbit; JGM-3 8x8 by default.
    field_error : FieldError, optional
        True field less IGRF. None: the field is IGRF.
    drag_pressure : float
        Drag force over the square of the speed against the air, N s2/m2: rho C_D A / 2.

    Raises
    ------
    ValueError
        If the field model does not cover the epoch, or a parameter is out of range.
    """

    def __init__(
        self,
        epoch: GpsTime,
        state_gcrf: npt.ArrayLike,
        period: float = 5.0,
        force_model: ForceModel | None = None,
        field_error: FieldError | None = None,
        drag_pressure: float = 0.0,
    ) -> None:
        check_field_year("epoch", epoch)
        if not 0.0 <= drag_pressure < math.inf:
            raise ValueError(f"drag_pressure: 0 or more (N s2/m2) expected; got {drag_pressure}")
        self.epoch = epoch
        self.period = period
        self._propagator = Propagator(epoch, state_gcrf, force_model, step=0.5 * period)
        self._field_error = field_error
        self._drag_pressure = drag_pressure
        self._states: list[FloatArray] = []
        self._fields: list[FloatArray] = []
        self._true_fields: list[FloatArray] = []
        self._append_node()

    def _append_node(self) -> None:
        if self._states:
            self._propagator.advance()
        state = self._propagator.state_gcrf
        time = self._propagator.time
        field = magnetic_field_gcrf(time, state[:3])
        self._states.append(state)
        self._fields.append(field)
        if self._field_error is None:
            self._true_fields.append(field)
        else:
            self._true_fields.append(magnetic_field_gcrf(time, state[:3], self._field_error))

    def _need(self, number: int) -> None:
        while len(self._states) <= number:
            self._append_node()

    def time(self, number: int) -> GpsTime:
        """Return the time of the start of an interval."""
        return self.epoch + number * self.period

    def state_gcrf(self, number: int) -> FloatArray:
        """Return position and velocity at the start of an interval, m and m/s, shape (6,)."""
        self._need(2 * number)
        return self._states[2 * number]

    def field_gcrf(self, number: int) -> FloatArray:
        """Return the field by IGRF at the start of an interval, T, shape (3,)."""
        self._need(2 * number)
        return self._fields[2 * number]

    def true_field_gcrf(self, number: int) -> FloatArray:
        """Return IGRF and the error at the start of an interval, T, shape (3,)."""
        self._need(2 * number)
        return self._true_fields[2 * number]

    def interval(self, number: int) -> OrbitInterval:
        """Return what the orbit does to the attitude in an interval, counted from 0."""
        first = 2 * number
        self._need(first + 2)
        position, velocity = self._states[first + 1][:3], self._states[first + 1][3:]
        air = velocity - EARTH_ROTATION_RATE * np.array([-position[1], position[0], 0.0])
        return OrbitInterval(
            self.period,
            np.array(self._true_fields[first : first + 3]),
            np.array([state[:3] for state in self._states[first : first + 3]]),
            -self._drag_pressure * math.sqrt(float(air @ air)) * air,
        )
