"""Phases noisier than their receivers say: scintillation, seen in the residuals of the filter.

A signal that crosses irregular plasma fluctuates by millimetres to centimetres from one epoch to
the next, differently at two receivers that pass the same place at different times. That is neither
motion nor a cycle slip. Each signal has an excess variance here, which is zero while the stated
variance fits. It is estimated with the residual of the phase against all other measurements
(adaptive estimation of the measurement covariance from innovations: Mehra 1970, IEEE Trans. Autom.
Control 15, 175).

A residual of less than a quarter of a cycle is scatter, a larger one is a slip: receivers slip by
multiples of half a cycle.

In fades of the whole sky integers are lost, and most phases have no residual that is precise enough
to show either. They have the scatter and the slips of the others nevertheless: what is not seen of
a signal is taken from those where it is seen (Humphreys and others 2010, IEEE Trans. Aerosp.
Electron. Syst. 46, 1844, for slips in scintillation).
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.signals import SignalKey
from vtff_nav.relative.cdgps.state import Innovation
from vtff_nav.relative.common.columns import with_columns
from vtff_nav.relative.common.measurements import SingleDifferences

__all__ = ["SLIP_CYCLES", "PhaseScatter", "SlipRate", "epochs_to_average"]

SLIP_CYCLES = 0.25
"""A larger residual is nearer to a slip, of half a cycle at least, than to no slip."""

# Epochs over which a variance is averaged: the error of the mean is a third of it.
_MEMORY_EPOCHS = 10
# The stated variance is not believed if the mean of so many normalised squares is larger. Without
# scatter the probability of that is less than 1e-4.
_LARGEST_MEAN_SQUARE = 4.0
# The scatter of a signal that was not seen for longer (s) is forgotten.
_LONGEST_ABSENCE = 60.0
# The excess of a signal is known for so long, s, and so many known ones tell of the others.
_KNOWN_TIME, _FEWEST_KNOWN = 10.0, 2
# Time over which slips are counted, s; phases times seconds that a rate needs at least; and the
# rate up to which a slip is rare enough to be found alone, 1/s.
_SLIP_MEMORY, _LEAST_EXPOSURE, _RARE_SLIPS = 30.0, 30.0, 0.02


@dataclasses.dataclass
class _Signal:
    """Scatter of the phase of a signal.

    Parameters
    ----------
    last_seen : GpsTime
    last_known : GpsTime or None
        Last epoch with a precise residual.
    variance : float
        Excess over the stated variance, m2.
    mean_square : float
        Mean of half the squared differences of successive residuals over the stated variance.
    residual : float
        Residual of the last epoch, m; NaN if it was too imprecise.
    """

    last_seen: GpsTime
    last_known: GpsTime | None = None
    variance: float = 0.0
    mean_square: float = 1.0
    residual: float = math.nan

    def add_residual(self, residual: float, stated: float, is_fault: bool) -> None:
        """Update the variance with the residual of an epoch.

        Parameters
        ----------
        residual : float
            m.
        stated : float
            Variance that the receivers state, m2.
        is_fault : bool
            Whether the phase did not fit with the variance used so far.
        """
        # Successive differences (von Neumann 1941) leave out motion or plasma that was not
        # predicted: both change the residuals slowly.
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
        # An excess below the stated variance is not more than the error of its estimate.
        if 0.0 < self.variance < stated:
            self.variance, self.mean_square = 0.0, 1.0


class PhaseScatter:
    """Excess variances of the phases of all signals.

    Parameters
    ----------
    is_orbital : bool
        Whether most signals with an excess mean that those have it, too, where it cannot be seen.
        On the ground multipath may be larger than stated, which is no scintillation.
    """

    def __init__(self, is_orbital: bool = False) -> None:
        self._is_orbital = is_orbital
        self._signals: dict[SignalKey, _Signal] = {}
        # Excess of signals whose own cannot be seen, m2.
        self._unseen = 0.0
        # Without scintillation no signal has an excess.
        self._has_excess = False

    @property
    def is_common(self) -> bool:
        """Whether most signals scintillate, so far as that is seen."""
        return self._unseen > 0.0

    @property
    def common_sigma(self) -> float:
        """Sigma of the scatter of most signals, m; 0 unless most scintillate."""
        return math.sqrt(self._unseen)

    def variance(self, key: SignalKey) -> float:
        """Return the excess variance of the single-differenced phase of a signal, m2."""
        signal = self._signals.get(key)
        return 0.0 if signal is None else signal.variance

    def variances(self, measured: SingleDifferences) -> FloatArray:
        """Return the excess variances of all phases, m2, shape (n,)."""
        if not self._has_excess:
            return np.zeros(len(measured))
        return np.array([self.variance(key) for key in measured.keys])

    def is_scattered(self, measured: SingleDifferences) -> npt.NDArray[np.bool_]:
        """Return whether each phase is noisier than stated, shape (n,)."""
        return self.variances(measured) > 0.0

    def add_excess(self, measured: SingleDifferences) -> SingleDifferences:
        """Return single differences with the excess variances added to those of the phases."""
        if not self._has_excess:
            return measured
        variance = measured.phase_variance + self.variances(measured)
        return with_columns(measured, phase_variance=variance)

    def learn(
        self,
        time: GpsTime,
        stated: SingleDifferences,
        innovation: Innovation,
        is_phase_fault: npt.NDArray[np.bool_],
    ) -> dict[SignalKey, float]:
        """Update the excess variances with the residuals of an epoch.

        Parameters
        ----------
        time : GpsTime
        stated : SingleDifferences
            Single differences with the variances that the receivers state.
        innovation : Innovation
            Innovation of n codes and n phases, as used in the update.
        is_phase_fault : ndarray of bool, shape (n,)
            Whether a phase did not fit before its variance was raised.

        Returns
        -------
        dict of SignalKey to float
            Signals whose excess variance has been too small so far, and the missing variance, m2.
            Ambiguities that were estimated from their phases are less certain by it.
        """
        risen: dict[SignalKey, float] = {}
        count = len(stated)
        phases = slice(count, 2 * count)
        all_residuals, all_variances = innovation.leave_one_out
        variance = all_variances[phases]
        # The residual is precise if the noise of the phase itself is most of its variance. It is
        # not with ambiguities that are still unknown.
        is_precise = variance < 2.0 * innovation.noise[phases]
        is_precise &= innovation.is_used[phases]
        columns = (all_residuals[phases], stated.phase_variance, is_phase_fault, is_precise)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        if self._unseen > 0.0:
            self._follow_unseen(stated, all_residuals[phases], variance, ~is_precise)
        for key, (residual, white, is_fault, is_known) in zip(stated.keys, rows, strict=True):
            signal = self._signals.get(key)
            if signal is None:
                signal = self._signals[key] = _Signal(time)
            signal.last_seen = time
            if not is_known:
                signal.residual = math.nan
                if signal.variance < self._unseen:
                    risen[key] = self._unseen - signal.variance
                    signal.variance = self._unseen
                continue
            before, signal.last_known = signal.variance, time
            signal.add_residual(residual, white, is_fault)
            if signal.variance > before and (is_fault or before == 0.0):
                risen[key] = signal.variance - before
        for key in [
            key
            for key, signal in self._signals.items()
            if signal.last_seen is not time and time - signal.last_seen > _LONGEST_ABSENCE
        ]:
            del self._signals[key]
        self._has_excess = any(signal.variance > 0.0 for signal in self._signals.values())
        if self._is_orbital and (self._has_excess or self._unseen > 0.0):
            self._expect_unseen(time)
        return risen

    def _expect_unseen(self, time: GpsTime) -> None:
        """Set the excess of signals whose own cannot be seen to the mean of the others."""
        known = [
            signal.variance
            for signal in self._signals.values()
            if signal.last_known is not None and time - signal.last_known <= _KNOWN_TIME
        ]
        excess = [variance for variance in known if variance > 0.0]
        if len(known) >= _FEWEST_KNOWN:
            is_common = 2 * len(excess) > len(known)
            self._unseen = sum(excess) / len(excess) if is_common else 0.0

    def _follow_unseen(
        self,
        stated: SingleDifferences,
        residual: FloatArray,
        variance: FloatArray,
        is_imprecise: npt.NDArray[np.bool_],
    ) -> None:
        """Adapt the excess of unseen signals to their residuals as a whole.

        Each of these is imprecise, but when the sky is quiet again all are far too small.
        """
        is_sample = is_imprecise & (variance < (SLIP_CYCLES * stated.wavelength) ** 2)
        if not is_sample.any():
            return
        mean_square = float(np.mean(residual[is_sample] ** 2 / variance[is_sample]))
        factor = 1.0 + min(mean_square - 1.0, 1.0) / _MEMORY_EPOCHS
        self._unseen *= factor
        for row in np.flatnonzero(is_sample).tolist():
            self._signals[stated.keys[row]].variance *= factor


class SlipRate:
    """How often phases in scintillation slip by whole cycles."""

    def __init__(self) -> None:
        self._slips, self._exposure = 0.0, 0.0

    def count(self, slips: int, visible: int, interval: float) -> None:
        """Count the slips of an epoch among the phases in scintillation that would show one.

        Parameters
        ----------
        slips, visible : int
        interval : float
            Time since the last epoch, s.
        """
        decay = math.exp(-interval / _SLIP_MEMORY)
        self._slips = decay * self._slips + slips
        self._exposure = decay * self._exposure + visible * interval

    @property
    def rate(self) -> float:
        """Slips of a phase in scintillation, 1/s; 0 while they are rare."""
        rate = self._slips / max(self._exposure, _LEAST_EXPOSURE)
        return rate if rate > _RARE_SLIPS else 0.0


def epochs_to_average(phase_variance: float, wavelength: float, sigma_cycles: float) -> int:
    """Return how many epochs bring the sigma of the mean of a phase to `sigma_cycles`.

    Parameters
    ----------
    phase_variance : float
        Variance of the phase at an epoch, m2.
    wavelength : float
        m.
    sigma_cycles : float
        Sigma of the mean, cycles.
    """
    return math.ceil(phase_variance / (sigma_cycles * wavelength) ** 2)
