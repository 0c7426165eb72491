"""Thrust messages of one deputy, kept until the step in which they act."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND

#: Age, in steps, up to which the newest thrust is used again when no newer one came (real time).
STALE_AFTER_STEPS = 2


class ThrustBuffer:
    """Keeps the scheduled thrust of one deputy by the time at which it starts.

    Parameters
    ----------
    step
        Length of a step in s; each thrust acts for one step.

    Attributes
    ----------
    received
        Number of messages so far.
    late
        Number of steps, after the first message, that had to use an older thrust or none
        (real time).
    is_stale
        Whether the newest step got no thrust, because the newest message is too old (real time).
    """

    def __init__(self, step: float) -> None:
        self._stale_after = STALE_AFTER_STEPS * round(step * NANOSECONDS_PER_SECOND)
        self._scheduled: dict[int, npt.NDArray[np.float64]] = {}
        self.received = 0
        self.late = 0
        self.is_stale = False

    def add(self, start_nanoseconds: int, acceleration_rtn: Sequence[float]) -> None:
        """Schedule an acceleration, m/s^2, in the RTN axes of the chief at its start."""
        self.received += 1
        self._scheduled[start_nanoseconds] = np.asarray(acceleration_rtn, dtype=float)

    def starting_at(
        self, stamp_nanoseconds: int, *, exactly: bool
    ) -> npt.NDArray[np.float64] | None:
        """Return the thrust of the step that starts at a stamp, and forget stale thrust.

        Parameters
        ----------
        stamp_nanoseconds
            Start of the step.
        exactly
            True (lockstep): return only the thrust that is scheduled for this very step.
            False (real time): if there is none, return the newest earlier thrust that is not stale.

        Returns
        -------
        ndarray, shape (3,), or None
            Acceleration, m/s^2; None for no thrust.
        """
        thrust = self._scheduled.get(stamp_nanoseconds)
        if thrust is None and not exactly:
            earlier = [start for start in self._scheduled if start < stamp_nanoseconds]
            newest = max(earlier, default=None)
            self.late += self.received > 0
            if newest is not None and stamp_nanoseconds - newest <= self._stale_after:
                thrust = self._scheduled[newest]
        self.is_stale = thrust is None and self.received > 0 and not exactly
        oldest_kept = stamp_nanoseconds - self._stale_after
        for start in [start for start in self._scheduled if start < oldest_kept]:
            del self._scheduled[start]
        return thrust
