"""Jumps of the phases of a satellite that no receiver tells, from the changes between epochs."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack
from scipy.special import gammaincc

from vtff_dynamics.vectors import FloatArray
from vtff_gnss.signals import SignalKey
from vtff_nav.relative.common.columns import are_all
from vtff_nav.relative.common.signal_set import SignalSet
from vtff_nav.relative.kernels.phases import change_phases

__all__ = ["JumpSearch", "PhaseChanges", "PhaseJumpDetector"]

# Changes are inconsistent below the first probability, and consistent again without the satellites
# at fault above the second. Satellites without which they are above the third are suspect.
_DETECTION_PROBABILITY = 1e-7
_EXPLANATION_PROBABILITY = 1e-4
_ALTERNATIVE_PROBABILITY = 1e-6
_MOST_SATELLITES_AT_FAULT = 2
# What changes besides noise: multipath, and plasma and troposphere between the receivers, m, m/s.
_CHANGE_SIGMA, _CHANGE_RATE_SIGMA = 0.003, 0.001
# Error of the predicted displacement where the receivers may move, and where they do not, m.
_MOTION_SIGMA, _REST_SIGMA = 10.0, 0.003
_CLOCK_SIGMA = 1e5
# Error of the time of reception while the clocks run on, s.
_TIME_SIGMA = 1e-6
# A satellite that has jumped stays out for so many epochs: some jump again and again. In orbit the
# prediction tells its next integers as soon as the plasma above is known, which at the start, under
# a steep gradient, takes some ten epochs.
_EPOCHS_OUT, _EPOCHS_OUT_IN_ORBIT = 300, 30
# Over more seconds plasma and troposphere change too much to tell.
_LONGEST_INTERVAL = 60.0


@dataclass(frozen=True, eq=False)
class PhaseChanges:
    """Phases of an epoch against their prediction; n signals.

    Parameters
    ----------
    keys : SignalSet
        Any other sequence of signals becomes a set.
    residual : ndarray, shape (n,)
        Single difference of the phase less predicted range and ambiguity, m; its ambiguity is
        that of the arc, whatever it is.
    variance : ndarray, shape (n,)
        m2.
    direction : ndarray, shape (n, 3)
        Unit vectors to the satellites.
    clock_rate : ndarray, shape (n,)
        Derivative of the single difference by the clock of the deputy, near 1.
    clock : float
        Clock of the deputy less that of the chief, s.
    """

    keys: SignalSet
    residual: FloatArray
    variance: FloatArray
    direction: FloatArray
    clock_rate: FloatArray
    clock: float

    def __post_init__(self) -> None:
        """Have the signals as a set."""
        if not isinstance(self.keys, SignalSet):
            object.__setattr__(self, "keys", SignalSet(self.keys))


@dataclass(frozen=True)
class JumpSearch:
    """Result of a search for jumps.

    Parameters
    ----------
    satellites : frozenset of tuple of int
        System and number of the satellites whose phases have jumped, or may have.
    is_unexplained : bool
        Whether phases have jumped, and not of one or two satellites only.
    """

    satellites: frozenset[tuple[int, int]] = frozenset()
    is_unexplained: bool = False


class PhaseJumpDetector:
    """Compares the phases of consecutive epochs.

    Between two epochs the single-differenced phases change by the motion, by the clocks, and by
    noise; biases and ambiguities cancel. Motion and clocks are estimated from all satellites. If
    the residuals are too large, the one or two satellites without which they are not are at fault.
    An arc in which the loss of lock was told has no change.

    Parameters
    ----------
    is_static : bool
        Whether the receivers are known to be at rest.
    is_orbital : bool
        Whether their motion is predicted by the dynamics of an orbit.
    """

    def __init__(self, is_static: bool, is_orbital: bool = False) -> None:
        self._epochs_of_absence = _EPOCHS_OUT_IN_ORBIT if is_orbital else _EPOCHS_OUT
        sigma = _REST_SIGMA if is_static else _MOTION_SIGMA
        self._motion_sigma = sigma
        self._last_clock = 0.0
        self._last_keys = SignalSet()
        self._last_residual, self._last_variance = np.zeros(0), np.zeros(0)
        self._epochs_out: dict[tuple[int, int], int] = {}

    def excluded(self, satellites: Iterable[tuple[int, int]]) -> set[tuple[int, int]]:
        """Return which of some satellites stay out, and count an epoch for each."""
        if not self._epochs_out:
            return set()
        out = self._epochs_out.keys() & set(satellites)
        for satellite in out:
            self._epochs_out[satellite] -= 1
            if self._epochs_out[satellite] == 0:
                del self._epochs_out[satellite]
        return out

    def search(self, changes: PhaseChanges, interval: float) -> JumpSearch:
        """Search for jumps since the last recorded epoch, `interval` s ago."""
        rows, last_rows = self._find_common(changes.keys)
        if not len(rows) or interval > _LONGEST_INTERVAL:
            return JumpSearch()
        further = _CHANGE_SIGMA**2 + (_CHANGE_RATE_SIGMA * interval) ** 2
        change, variance, design, weighted = change_phases(
            rows,
            last_rows,
            changes.residual,
            self._last_residual,
            changes.variance,
            self._last_variance,
            changes.direction,
            changes.clock_rate,
            further,
        )
        # Where a clock has jumped, the time of reception is in doubt by as much.
        jump = max(abs(changes.clock - self._last_clock), _TIME_SIGMA)
        sigmas = np.array([self._motion_sigma] * 3 + [_CLOCK_SIGMA, jump])
        signals = changes.keys
        if len(rows) < len(signals):
            signals = signals.select(rows)
        result = self._find(_SatelliteSums(signals, design, weighted, change, variance, sigmas))
        for satellite in result.satellites:
            self._epochs_out[satellite] = self._epochs_of_absence
        return result

    def record(
        self, changes: PhaseChanges, correction: FloatArray, used: npt.NDArray[np.bool_]
    ) -> None:
        """Keep the residuals of an epoch after its update.

        Parameters
        ----------
        changes : PhaseChanges
            Residuals before the update.
        correction : ndarray, shape (n,)
            What the update of the position adds to them, m.
        used : ndarray of bool, shape (n,)
            Signals that were used in the update.
        """
        self._last_clock = changes.clock
        self._last_keys = changes.keys
        self._last_residual = changes.residual + correction
        self._last_variance = changes.variance
        if not are_all(used):
            self._keep(np.flatnonzero(used))

    def _keep(self, rows: npt.NDArray[np.intp]) -> None:
        """Keep some of the residuals only."""
        self._last_keys = self._last_keys.select(rows)
        self._last_residual = self._last_residual[rows]
        self._last_variance = self._last_variance[rows]

    def forget(self, keys: Iterable[SignalKey]) -> None:
        """Forget signals whose arc has ended."""
        ended = self._last_keys.rows.keys() & set(keys)
        if ended:
            kept = [row for key, row in self._last_keys.rows.items() if key not in ended]
            self._keep(np.array(kept, dtype=np.intp))

    def _find_common(self, keys: SignalSet) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        """Return the rows of the signals that the last epoch had too, here and there."""
        if keys == self._last_keys:
            rows = np.arange(len(keys))
            return rows, rows
        last_row = self._last_keys.rows
        found = [row for row, key in enumerate(keys) if key in last_row]
        last = [last_row[keys[row]] for row in found]
        return np.array(found, dtype=np.intp), np.array(last, dtype=np.intp)

    def _find(self, sums: _SatelliteSums) -> JumpSearch:
        if sums.probability(()) > _DETECTION_PROBABILITY:
            return JumpSearch()
        for count in range(1, _MOST_SATELLITES_AT_FAULT + 1):
            probabilities = {
                chosen: sums.probability(chosen)
                for chosen in itertools.combinations(range(len(sums.names)), count)
            }
            if max(probabilities.values(), default=0.0) < _EXPLANATION_PROBABILITY:
                continue
            # Where others explain the changes too, all of them are out.
            suspects = {
                index
                for chosen, probability in probabilities.items()
                if probability > _ALTERNATIVE_PROBABILITY
                for index in chosen
            }
            return JumpSearch(frozenset(sums.names[index] for index in suspects))
        return JumpSearch(is_unexplained=True)


class _SatelliteSums:
    """Normal equations of the changes, one share for each satellite.

    `design` and `weighted`, which is over the variance, have the columns motion (3), clock and time
    of reception; `sigmas` are a priori.
    """

    def __init__(
        self,
        signals: SignalSet,
        design: FloatArray,
        weighted: FloatArray,
        change: FloatArray,
        variance: FloatArray,
        sigmas: FloatArray,
    ) -> None:
        self.names = signals.ordered_satellites
        self._signals, self._design, self._change = signals, design, change
        self._variance, self._weighted = variance, weighted
        self._prior = 1.0 / sigmas**2
        # Unknowns that the satellites have to tell; the others are known well enough.
        self._unknowns = 1 + 3 * int(sigmas[0] > 1.0) + int(sigmas[4] > _TIME_SIGMA)

    @functools.cached_property
    def _shares(self) -> tuple[FloatArray, FloatArray, FloatArray, npt.NDArray[np.intp]]:
        """Matrices, right sides, sums of squares and numbers of signals of each satellite."""
        index = self._signals.satellite_rows
        count, unknowns = len(self.names), self._design.shape[1]
        normal = np.zeros((count, unknowns, unknowns))
        right, square = np.zeros((count, unknowns)), np.zeros(count)
        np.add.at(normal, index, self._design[:, :, None] * self._weighted[:, None, :])
        np.add.at(right, index, self._weighted * self._change[:, None])
        np.add.at(square, index, self._change**2 / self._variance)
        return normal, right, square, np.bincount(index, minlength=count)

    def probability(self, left_out: tuple[int, ...]) -> float:
        """Return the probability of residuals as large without some satellites; 1 if undecidable.

        The answer is 0 where too few satellites are left to tell: they explain nothing.
        """
        out = list(left_out)
        if len(self.names) - len(out) <= self._unknowns:
            return 0.0 if out else 1.0
        normal = self._design.T @ self._weighted
        normal.reshape(-1)[:: len(self._prior) + 1] += self._prior
        right = self._weighted.T @ self._change
        square = float(self._change @ (self._change / self._variance))
        freedom = len(self._change) - self._unknowns
        if out:
            of_normal, of_right, of_square, signals = self._shares
            normal -= of_normal[out].sum(axis=0)
            right -= of_right[out].sum(axis=0)
            square -= float(of_square[out].sum())
            freedom -= int(signals[out].sum())
        # `numpy.linalg.solve` takes three times as long on so few unknowns.
        _, _, solution, info = lapack.dgesv(normal, right)
        if info != 0:
            raise np.linalg.LinAlgError("the changes of the phases do not tell the motion")
        squared_norm = square - float(right @ solution)
        return float(gammaincc(0.5 * freedom, 0.5 * max(squared_norm, 0.0)))
