"""A virtual orbit that a chief with a thruster keeps its place on.

The orbit begins at a state of the chief that navigation has estimated, and from there obeys the
model of forces alone. Where the chief is relative to it is what its controller holds at zero.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vtff_dynamics.frames.rtn import relative_state_rtn
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.propagator import Propagator
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray

__all__ = ["ReferenceOrbit"]


class ReferenceOrbit:
    """The orbit that a chief would fly without errors of its model and without thrust.

    Parameters
    ----------
    force_model : ForceModel
        Forces on the virtual spacecraft.
    settling_time : float
        Time from the first state to that which the orbit begins at, s: the first velocities of an
        absolute filter are the worst.
    longest_step : float
        Longest step of integration, s.

    Raises
    ------
    ValueError
        If a time is not positive, or the settling time is negative.
    """

    def __init__(
        self, force_model: ForceModel, settling_time: float = 60.0, longest_step: float = 10.0
    ) -> None:
        if not settling_time >= 0.0:
            raise ValueError(f"settling_time: 0 s or more expected, got {settling_time}")
        if not longest_step > 0.0:
            raise ValueError(f"longest_step: more than 0 s expected, got {longest_step}")
        self._force_model = force_model
        self._settling_time = settling_time
        self._longest_step = longest_step
        self._first: GpsTime | None = None
        self._time: GpsTime | None = None
        self._state: FloatArray = np.full(6, np.nan)

    def follow(
        self, time: GpsTime, chief_gcrf: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return where the chief is relative to the orbit.

        Parameters
        ----------
        time : GpsTime
            Later than in the call before; after a jump back the orbit begins anew.
        chief_gcrf : array_like, shape (6,)
            Estimated position (m) and velocity (m/s) of the chief.

        Returns
        -------
        tuple of ndarray, shapes (6,), or None
            State of the chief in the RTN frame of the orbit (m, m/s in the rotating frame), and the
            state of the orbit in GCRF. None until the orbit has begun.

        Raises
        ------
        ValueError
            If the state is not six finite numbers.
        """
        chief = np.array(chief_gcrf, dtype=float)
        if chief.shape != (6,) or not np.isfinite(chief).all():
            raise ValueError("chief_gcrf: six finite numbers expected")
        if self._first is None or time < (self._time or self._first):
            self._first, self._time = time, None
        if self._time is None:
            if time - self._first < self._settling_time:
                return None
            self._time, self._state = time, chief
        self._advance(time)
        return relative_state_rtn(self._state, chief), self._state.copy()

    def _advance(self, time: GpsTime) -> None:
        assert self._time is not None
        remaining = time - self._time
        while remaining > 0.0:
            step = min(remaining, self._longest_step)
            propagator = Propagator(self._time, self._state, self._force_model, step=step)
            self._state = np.array(propagator.advance())
            self._time = self._time + step
            remaining = time - self._time
