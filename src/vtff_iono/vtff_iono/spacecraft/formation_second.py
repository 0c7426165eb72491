"""The measurements of a formation in one second, and the motion of its spacecraft meanwhile."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.signals import SignalKey
from vtff_iono.spacecraft.spacecraft_ionosphere import ObservationBlock

__all__ = ["FormationSecond", "PairSecond", "Track"]


@dataclass(frozen=True, eq=False)
class PairSecond:
    """The measurements of chief and one deputy in a second.

    Parameters
    ----------
    time : int
        End of the second, GPS time, ns since 1980-01-06.
    observations : tuple of ObservationBlock
        All epochs of chief and deputy since the second before.
    integers : mapping of SignalKey to float
        Integers of single differences, deputy less chief, that are fixed at `time`, cycles
        relative to a reference satellite of each group of signals.
    relative_sigma : float
        Sigma of the position of the deputy relative to the chief, m; infinite where that is not
        of relative navigation.
    """

    time: int
    observations: tuple[ObservationBlock, ObservationBlock]
    integers: Mapping[SignalKey, float]
    relative_sigma: float


@dataclass(frozen=True, eq=False)
class FormationSecond:
    """The measurements of a formation in a second.

    Parameters
    ----------
    time : int
        End of the second, GPS time, ns since 1980-01-06.
    observations : tuple of ObservationBlock
        All epochs of the chief and each deputy since the second before.
    states_itrf : tuple of ndarray or None, shape (6,)
        States of the chief and each deputy at `time`, position (m) and Earth-fixed velocity (m/s);
        None where unknown.
    integers : tuple of mapping of SignalKey to float
        For each deputy as in `PairSecond`.
    relative_sigmas : tuple of float, optional
        For each deputy as in `PairSecond`; by default no state is of relative navigation.
    """

    time: int
    observations: tuple[ObservationBlock, ...]
    states_itrf: tuple[FloatArray | None, ...]
    integers: tuple[Mapping[SignalKey, float], ...]
    relative_sigmas: tuple[float, ...] = ()

    def pair(self, deputy: int) -> PairSecond:
        """Return the measurements of the chief and a deputy, counted from 0."""
        return PairSecond(
            self.time,
            (self.observations[0], self.observations[deputy + 1]),
            self.integers[deputy],
            self.relative_sigmas[deputy] if self.relative_sigmas else math.inf,
        )


class Track:
    """Motion of a spacecraft between its last two states.

    Parameters
    ----------
    states : sequence of (int, ndarray)
        At most two: time, ns, and position and Earth-fixed velocity, m and m/s, shape (6,).
    """

    def __init__(self, states: Sequence[tuple[int, FloatArray]] = ()) -> None:
        self._states = states
        # Both positions, then both velocities.
        self._both: FloatArray | None = None
        if len(states) > 1:
            first, last = states[0][1], states[-1][1]
            self._both = np.array((first[:3], last[:3], first[3:], last[3:]))

    def followed_by(self, time: int, state_itrf: FloatArray | None) -> Track:
        """Return the track with the next state; an empty track if that state is unknown."""
        return Track(() if state_itrf is None else (*self._states[-1:], (time, state_itrf)))

    def positions(self, time: npt.NDArray[np.int64]) -> FloatArray:
        """Return the positions (m) at times (ns), shapes (n, 3) and (n,); NaN without a state."""
        if not self._states:
            return np.full((len(time), 3), np.nan)
        end, last = self._states[-1]
        if self._both is None:
            seconds = (time - end) / NANOSECONDS_PER_SECOND
            return np.asarray(last[:3] + seconds[:, np.newaxis] * last[3:])
        return np.asarray(_cubic_weights(time, self._states[0][0], end) @ self._both)


@compiled
def _cubic_weights(time, begin, end):  # type: ignore[no-untyped-def]
    """Return the weights of two states in the cubic through them, shape (n, 4).

    They are those of both positions and of both velocities at times (n,), ns; the states are those
    at `begin` and `end`, ns.
    """
    weights = np.empty((len(time), 4))
    first = (begin - end) / NANOSECONDS_PER_SECOND
    for row in range(len(time)):
        if row > 0 and time[row] == time[row - 1]:
            weights[row] = weights[row - 1]
            continue
        # 0 at the first state, 1 at the last one.
        to_last = 1.0 - (time[row] - end) / NANOSECONDS_PER_SECOND / first
        to_first = 1.0 - to_last
        weights[row, 0] = to_first * to_first * (1.0 + 2.0 * to_last)
        weights[row, 1] = to_last * to_last * (1.0 + 2.0 * to_first)
        weights[row, 2] = -first * to_last * (to_first * to_first)
        weights[row, 3] = first * (to_last * to_last) * to_first
    return weights
