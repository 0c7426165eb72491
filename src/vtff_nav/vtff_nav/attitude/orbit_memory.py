"""The orbit of the last minutes, as attitude needs it at the ends of its periods."""

from __future__ import annotations

import numpy as np

from vtff_dynamics.attitude.magnetic_field import magnetic_field_gcrf
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.propagator import Propagator
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray

__all__ = ["OrbitMemory", "OrbitPoint"]

_STEP = 5.0  # s


class OrbitPoint:
    """Orbit and field of the model (IGRF) at a time."""

    def __init__(self, stamp_nanoseconds: int, state_gcrf: FloatArray) -> None:
        self.stamp_nanoseconds = stamp_nanoseconds
        self.state_gcrf = state_gcrf
        self._field: FloatArray | None = None

    @property
    def field_gcrf(self) -> FloatArray:
        """Field, T, shape (3,)."""
        if self._field is None:
            time = GpsTime.from_unix_nanoseconds(self.stamp_nanoseconds)
            self._field = magnetic_field_gcrf(time, self.state_gcrf[:3])
        return self._field


class OrbitMemory:
    """States by stamp; a time without one is predicted from the state before it.

    Parameters
    ----------
    longest_prediction : float
        s after which an orbit is no longer predicted.
    force_model : ForceModel, optional
        Forces of the prediction; JGM-3 8x8 by default.
    kept : int
        Number of states that are kept, the newest.
    """

    def __init__(
        self,
        longest_prediction: float = 6000.0,
        force_model: ForceModel | None = None,
        kept: int = 64,
    ) -> None:
        self._kept = kept
        self._longest = longest_prediction
        self._force_model = force_model
        self._points: dict[int, OrbitPoint] = {}

    def add(self, stamp_nanoseconds: int, state_gcrf: FloatArray) -> None:
        """Keep a state, m and m/s, shape (6,); one that is not finite is ignored."""
        state = np.array(state_gcrf, dtype=float)
        if state.shape == (6,) and np.isfinite(state).all():
            self._points[stamp_nanoseconds] = OrbitPoint(stamp_nanoseconds, state)
        while len(self._points) > self._kept:
            del self._points[min(self._points)]

    def has(self, stamp_nanoseconds: int) -> bool:
        """Return whether there is a state of exactly this time."""
        return stamp_nanoseconds in self._points

    def at(self, stamp_nanoseconds: int) -> OrbitPoint | None:
        """Return the orbit at a time; None if it is not known and cannot be predicted."""
        point = self._points.get(stamp_nanoseconds)
        if point is not None:
            return point
        earlier = [stamp for stamp in self._points if stamp < stamp_nanoseconds]
        if not earlier:
            return None
        start = max(earlier)
        span = (stamp_nanoseconds - start) / NANOSECONDS_PER_SECOND
        if span > self._longest:
            return None
        steps = max(1, round(span / _STEP))
        propagator = Propagator(
            GpsTime.from_unix_nanoseconds(start),
            self._points[start].state_gcrf,
            self._force_model,
            step=span / steps,
        )
        for _ in range(steps):
            propagator.advance()
        predicted = OrbitPoint(stamp_nanoseconds, np.array(propagator.state_gcrf))
        self._points[stamp_nanoseconds] = predicted
        return predicted
