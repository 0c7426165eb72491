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

from vtff_dynamics.timescales import GpsTime
from vtff_nav.relative.cdgps_state import Innovation
from vtff_nav.relative.measurements import SignalKey, SingleDifferences

__all__ = ["SLIP_CYCLES", "PhaseScatter", "epochs_to_average"]

SLIP_CYCLES = 0.25
"""A residual beyond is nearer to a slip, of half a cycle at least, than to none."""

# Epochs over which a variance is averaged: its error is then a third of it.
_MEMORY_EPOCHS = 10
# Mean of as many squared normalised residuals from which on the stated variance is not believed;
# without scatter less likely than 2e-5.
_LARGEST_MEAN_SQUARE = 4.0
# A signal not seen for as long (s) is believed anew.
_LONGEST_ABSENCE = 60.0


@dataclasses.dataclass
class _Signal:
    """What is known of the scatter of a signal: excess variance (m2), mean squared residual."""

    last_seen: GpsTime
    variance: float = 0.0
    mean_square: float = 1.0


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
        own = stated.phase_variance
        # What the phase itself adds to its residual. Where the rest is larger, as with ambiguities
        # that nothing tells yet, the residual says nothing.
        noise = innovation.noise[phases]
        predicted = variance - noise
        is_telling = innovation.is_used[phases] & (predicted < noise)
        square = residual**2
        for row, key in enumerate(stated.keys):
            signal = self._signals.get(key)
            if signal is None:
                signal = self._signals[key] = _Signal(time)
            signal.last_seen = time
            if is_telling[row]:
                excess = float(square[row] - predicted[row] - own[row])
                normalised = float(square[row] / (predicted[row] + own[row]))
                before = signal.variance
                is_fault = bool(is_phase_fault[row])
                _follow(signal, excess, normalised, float(own[row]), is_fault)
                if signal.variance > before and (is_fault or before == 0.0):
                    risen[key] = signal.variance - before
        gone = [k for k, s in self._signals.items() if time - s.last_seen > _LONGEST_ABSENCE]
        for key in gone:
            del self._signals[key]
        return risen


def _follow(signal: _Signal, excess: float, normalised: float, own: float, is_fault: bool) -> None:
    """Use one squared residual: what it is above the stated variance, and normalised by that."""
    signal.mean_square += (normalised - signal.mean_square) / _MEMORY_EPOCHS
    if is_fault:
        signal.variance = max(signal.variance, excess)
    elif signal.variance > 0.0:
        signal.variance += (excess - signal.variance) / _MEMORY_EPOCHS
    elif signal.mean_square > _LARGEST_MEAN_SQUARE:
        signal.variance = (signal.mean_square - 1.0) * own
    # Below the stated variance it is no more than the error of its own estimate.
    if 0.0 < signal.variance < own:
        signal.variance, signal.mean_square = 0.0, 1.0


def epochs_to_average(phase_variance: float, wavelength: float, sigma_cycles: float) -> int:
    """Return how many epochs bring the mean of a phase to `sigma_cycles`."""
    return math.ceil(phase_variance / (sigma_cycles * wavelength) ** 2)
