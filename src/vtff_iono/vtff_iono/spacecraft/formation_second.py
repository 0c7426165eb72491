"""What a formation has measured in a second, and how its spacecraft moved meanwhile."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray
from vtff_iono.spacecraft.spacecraft_ionosphere import ObservationBlock

__all__ = ["FormationSecond", "Group", "Integers", "Track"]

Group = tuple[int, int, int]
"""System, band and attribute."""

Integers = Mapping[tuple[Group, int], float]
"""Integers, cycles relative to a reference satellite of each group, by group and satellite."""


@dataclass(frozen=True, eq=False)
class FormationSecond:
    """What is known of a second when it ends.

    Parameters
    ----------
    time : int
        Its end, GPS time, ns since 1980-01-06.
    observations : tuple of ObservationBlock
        Of chief and deputy: all epochs since the last second.
    states_itrf : tuple of ndarray or None, shape (6,)
        Of chief and deputy at `time`: position and Earth-fixed velocity; None where unknown.
    integers : Integers
        Fixed integers at `time`, deputy less chief.
    """

    time: int
    observations: tuple[ObservationBlock, ObservationBlock]
    states_itrf: tuple[FloatArray | None, FloatArray | None]
    integers: Integers


class Track:
    """Motion of a spacecraft between its last two states."""

    def __init__(self, states: Sequence[tuple[int, FloatArray]] = ()) -> None:
        self._states = states

    def followed_by(self, time: int, state_itrf: FloatArray | None) -> Track:
        """Return the track with the next state; an empty one if that is unknown."""
        return Track(() if state_itrf is None else (*self._states[-1:], (time, state_itrf)))

    def positions(self, time: npt.NDArray[np.int64]) -> FloatArray:
        """Return the positions at times (n,), shape (n, 3); NaN where nothing is known."""
        if not self._states:
            return np.full((len(time), 3), np.nan)
        end, last = self._states[-1]
        seconds = (time - end) / NANOSECONDS_PER_SECOND
        if len(self._states) == 1:
            return np.asarray(last[:3] + seconds[:, np.newaxis] * last[3:])
        begin, first = self._states[0]
        return _between(seconds, (begin - end) / NANOSECONDS_PER_SECOND, first, last)


def _between(seconds: FloatArray, begin: float, first: FloatArray, last: FloatArray) -> FloatArray:
    """Return the positions of the cubic through two states, at `begin` and at 0 s, shape (n, 3)."""
    place = 1.0 - seconds / begin  # 0 at the first state, 1 at the last one
    rest = 1.0 - place
    weights = (
        rest**2 * (1.0 + 2.0 * place),
        place**2 * (1.0 + 2.0 * rest),
        -begin * place * rest**2,
        begin * place**2 * rest,
    )
    return np.stack(weights, axis=-1) @ np.stack((first[:3], last[:3], first[3:], last[3:]))
