"""Phases noisier than their receivers say: scintillation, seen in the residuals of the filter.

A signal that crosses irregular plasma fluctuates by millimetres to centimetres from one epoch to
the next, differently at two receivers that pass the same place at different times. That is neither
motion nor a cycle slip. Each signal has an excess variance here, zero while the stated one fits;
it is found and followed with the residual of the phase against all other measurements (adaptive
estimation of the measurement covariance from innovations: Mehra 1970, IEEE Trans. Autom. Control
15, 175).

What separates scatter from a slip is a quarter of a cycle: receivers slip by multiples of half a
cycle.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.signals import SignalKey
from vtff_nav.relative.cdgps.state import Innovation
from vtff_nav.relative.common.measurements import SingleDifferences

__all__ = ["SLIP_CYCLES", "PhaseScatter", "epochs_to_average"]

SLIP_CYCLES = 0.25
"""A residual beyond is nearer to a slip, of half a cycle at least, than to none."""

# Epochs over which a variance is averaged: its error is then a third of it.
_MEMORY_EPOCHS = 10
# Mean of as many normalised squares from which on the stated variance is not believed; without
# scatter less likely than 1e-4.
_LARGEST_MEAN_SQUARE = 4.0
# A signal not seen for as long (s) is believed anew.
_LONGEST_ABSENCE = 60.0


@dataclasses.dataclass
class _Signal:
    """What is known of the scatter of a signal.

    Parameters
    ----------
    last_seen : GpsTime
    variance : float
        In excess of the stated one, m2.
    mean_square : float
        Mean of the square of half differences of residuals over the stated variance.
    residual : float
        Of the last epoch, m; NaN if it told nothing.
    """

    last_seen: GpsTime
    variance: float = 0.0
    mean_square: float = 1.0
    residual: float = math.nan

    def follow(self, residual: float, stated: float, is_fault: bool) -> None:
        """Use the residual of an epoch, m; `stated` is the variance that the receivers state."""
        # From successive differences (von Neumann 1941): motion or plasma that is not what was
        # predicted changes residuals slowly, and is not to pass for noise.
        square = 0.5 * (residual - self.residual) ** 2
        self.residual = residual
        if math.isfinite(square):
            self.mean_square += (square / stated - self.mean_square) / _MEMORY_EPOCHS
        if is_fault:
            self.variance = max(self.variance, residual**2 - stated)
        elif self.variance > 0.0 and math.isfinite(square):
            self.variance += (square - stated - self.variance) / _MEMORY_EPOCHS
        elif self.mean_square > _LARGEST_MEAN_SQUARE:
            self.variance = (self.mean_square - 1.0) * stated
        # Below the stated variance it is no more than the error of its own estimate.
        if 0.0 < self.variance < stated:
            self.variance, self.mean_square = 0.0, 1.0


class PhaseScatter:
    """Excess variances of the phases of all signals."""

    def __init__(self) -> None:
        self._signals: dict[SignalKey, _Signal] = {}

    def variance(self, key: SignalKey) -> float:
        """Return the excess variance of the single-differenced phase of a signal, m2."""
        signal = self._signals.get(key)
        return 0.0 if signal is None else signal.variance

    def scattered(self, measured: SingleDifferences) -> npt.NDArray[np.bool_]:
        """Return which phases are noisier than stated, shape (n,)."""
        return np.array([self.variance(key) > 0.0 for key in measured.keys], dtype=bool)

    def with_scatter(self, measured: SingleDifferences) -> SingleDifferences:
        """Return single differences with the variances that their phases really have."""
        excess = np.array([self.variance(key) for key in measured.keys])
        if not excess.any():
            return measured
        return dataclasses.replace(measured, phase_variance=measured.phase_variance + excess)

    def learn(
        self,
        time: GpsTime,
        stated: SingleDifferences,
        innovation: Innovation,
        is_phase_fault: npt.NDArray[np.bool_],
    ) -> dict[SignalKey, float]:
        """Follow the scatter with the residuals of an epoch.

        Parameters
        ----------
        time : GpsTime
        stated : SingleDifferences
            With the variances that the receivers state.
        innovation : Innovation
            Of n codes and n phases, as used.
        is_phase_fault : ndarray of bool, shape (n,)
            Phases that did not fit before their variance was raised.

        Returns
        -------
        dict
            Signals whose excess variance has been too small so far, and by how much, m2: what was
            concluded from their phases is as much less certain.
        """
        risen: dict[SignalKey, float] = {}
        count = len(stated)
        phases = slice(count, 2 * count)
        residual, variance = (column[phases] for column in innovation.leave_one_out)
        # What the phase itself adds to its residual. Where the rest is larger, as with ambiguities
        # that nothing tells yet, the residual says nothing.
        noise = innovation.noise[phases]
        is_telling = innovation.is_used[phases] & (variance < 2.0 * noise)
        for row, key in enumerate(stated.keys):
            signal = self._signals.setdefault(key, _Signal(time))
            signal.last_seen = time
            if not is_telling[row]:
                signal.residual = math.nan
                continue
            before, is_fault = signal.variance, bool(is_phase_fault[row])
            signal.follow(float(residual[row]), float(stated.phase_variance[row]), is_fault)
            if signal.variance > before and (is_fault or before == 0.0):
                risen[key] = signal.variance - before
        gone = [k for k, s in self._signals.items() if time - s.last_seen > _LONGEST_ABSENCE]
        for key in gone:
            del self._signals[key]
        return risen


def epochs_to_average(phase_variance: float, wavelength: float, sigma_cycles: float) -> int:
    """Return how many epochs bring the mean of a phase to `sigma_cycles`."""
    return math.ceil(phase_variance / (sigma_cycles * wavelength) ** 2)
