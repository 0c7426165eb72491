"""Start of a carrier-phase filter: relative position from the mean of code differences.

Code less carrier phase is constant but for noise, so that its mean over a minute levels the phase,
however the spacecraft move meanwhile. Position and clock difference of an epoch follow from the
levelled phases by least squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.orbits.satellite_table import SatelliteTable
from vtff_gnss.signals import SignalKey
from vtff_nav.relative.common.measurements import SingleDifferences, compute_geometry

__all__ = ["CodeMean", "LevelledPosition", "StartEpoch"]

_ITERATIONS = 6
_UNKNOWNS = 4


@dataclass(frozen=True, eq=False)
class StartEpoch:
    """Single differences of an epoch before the filter runs, and the state of the chief.

    Parameters
    ----------
    time : GpsTime
    table : SatelliteTable
        Ephemerides of all satellites in `differences`.
    differences : SingleDifferences
    state_chief_itrf : ndarray, shape (6,)
        Position and Earth-fixed velocity, m and m/s.
    offsets : ndarray, shape (2,)
        Time tags of chief and deputy less `time`, less the clock of the chief, s.
    """

    time: GpsTime
    table: SatelliteTable
    differences: SingleDifferences
    state_chief_itrf: FloatArray
    offsets: FloatArray


@dataclass(frozen=True, eq=False)
class LevelledPosition:
    """Position and clock, deputy less chief, from levelled phases.

    Parameters
    ----------
    position_itrf : ndarray, shape (3,)
        m.
    clock : float
        Receiver clock difference, m.
    covariance : ndarray, shape (4, 4)
        Covariance of position and clock, m2.
    """

    position_itrf: FloatArray
    clock: float
    covariance: FloatArray


class CodeMean:
    """Mean of code less phase of each signal in common view."""

    def __init__(self) -> None:
        self._means: dict[SignalKey, tuple[int, float]] = {}

    def add(self, differences: SingleDifferences) -> None:
        """Add the differences of an epoch to the means."""
        code_less_phase = differences.code - differences.phase
        for key, value in zip(differences.keys, code_less_phase.tolist(), strict=True):
            count, mean = self._means.get(key, (0, 0.0))
            self._means[key] = (count + 1, mean + (value - mean) / (count + 1))

    def forget(self, key: SignalKey) -> None:
        """Forget the mean of a signal whose phase has slipped."""
        self._means.pop(key, None)

    def solve(self, epoch: StartEpoch) -> LevelledPosition | None:
        """Return the relative position at an epoch; None with too few signals or bad geometry."""
        differences = epoch.differences
        rows = [row for row, key in enumerate(differences.keys) if key in self._means]
        if len(rows) < _UNKNOWNS:
            return None
        counts, means = np.array([self._means[differences.keys[row]] for row in rows]).T
        levelled = differences.phase[rows] + means
        sigma = np.sqrt(differences.code_variance[rows] / counts)
        position, clock = np.zeros(3), 0.0
        for _ in range(_ITERATIONS):
            deputy = epoch.state_chief_itrf + np.concatenate((position, np.zeros(3)))
            offsets = epoch.offsets - np.array([0.0, clock / SPEED_OF_LIGHT])
            states = np.array([epoch.state_chief_itrf, deputy])
            seen = compute_geometry(epoch.table, epoch.time, offsets, states, np.eye(3))
            columns = seen.columns(differences.satellite[rows])
            distance = (seen.range - seen.clock)[:, columns]
            residual = levelled - (distance[1] - distance[0] + clock)
            design = np.hstack((-seen.direction[1, columns], np.ones((len(rows), 1))))
            weighted = design / sigma[:, None]
            normal = weighted.T @ weighted
            if np.linalg.cond(normal) > 1e8:
                return None
            change = np.linalg.solve(normal, weighted.T @ (residual / sigma))
            position, clock = position + change[:3], clock + float(change[3])
            if float(np.abs(change).max()) < 1e-5:
                break
        return LevelledPosition(position, clock, np.linalg.inv(normal))
