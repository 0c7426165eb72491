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

import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.signals import SignalKey
from vtff_nav.relative.cdgps.state import Innovation
from vtff_nav.relative.common.columns import with_columns
from vtff_nav.relative.common.measurements import SingleDifferences
from vtff_nav.relative.common.signal_set import SignalPlaces, SignalSet, with_places
from vtff_nav.relative.kernels.phases import MEMORY_EPOCHS, forget_scatter, learn_scatter

__all__ = ["SLIP_CYCLES", "PhaseScatter", "SlipRate", "epochs_to_average"]

SLIP_CYCLES = 0.25
"""A larger residual is nearer to a slip, of half a cycle at least, than to no slip."""

# The scatter of a signal that was not seen for longer (s) is forgotten.
_LONGEST_ABSENCE = 60.0
# The excess of a signal is known for so long, s, and so many known ones tell of the others.
_KNOWN_TIME, _FEWEST_KNOWN = 10.0, 2
# Time over which slips are counted, s; phases times seconds that a rate needs at least; and the
# rate up to which a slip is rare enough to be found alone, 1/s.
_SLIP_MEMORY, _LEAST_EXPOSURE, _RARE_SLIPS = 30.0, 30.0, 0.02


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
        self._places = SignalPlaces()
        # Places of the signals that are known, in the order in which they were first seen.
        self._known_places = np.zeros(0, dtype=np.int64)
        # By place: see `learn_scatter`.
        self._seen_times = np.full(0, -1, dtype=np.int64)
        self._known_times = np.full(0, -1, dtype=np.int64)
        self._numbers = np.zeros((3, 0))
        # Excess of signals whose own cannot be seen, m2.
        self._unseen = 0.0
        # Without scintillation no signal has an excess.
        self._has_excess = False

    def _places_of(self, signals: SignalSet) -> npt.NDArray[np.int64]:
        """Return the place of each signal, shape (n,), which all columns have."""
        places = self._places.of(signals)
        if len(self._places) > len(self._seen_times):
            self._seen_times = with_places(self._seen_times, self._places, -1)
            self._known_times = with_places(self._known_times, self._places, -1)
            self._numbers = with_places(self._numbers, self._places)
        return places

    @property
    def is_common(self) -> bool:
        """Whether most signals scintillate, so far as that is seen."""
        return self._unseen > 0.0

    @property
    def common_sigma(self) -> float:
        """Sigma of the scatter of most signals, m; 0 unless most scintillate."""
        return math.sqrt(self._unseen)

    @property
    def has_excess(self) -> bool:
        """Whether any phase is noisier than stated."""
        return self._has_excess

    def variance(self, key: SignalKey) -> float:
        """Return the excess variance of the single-differenced phase of a signal, m2."""
        return self._numbers.item(0, self._places[key]) if key in self._places else 0.0

    def variances(self, measured: SingleDifferences) -> FloatArray:
        """Return the excess variances of all phases, m2, shape (n,)."""
        if not self._has_excess:
            return np.zeros(len(measured))
        places = self._places_of(measured.keys)  # before the column, which may grow
        variances: FloatArray = self._numbers[0, places]
        return variances

    def is_scattered(self, measured: SingleDifferences) -> npt.NDArray[np.bool_]:
        """Return whether each phase is noisier than stated, shape (n,)."""
        if not self._has_excess:
            return np.zeros(len(measured), dtype=bool)
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
        signals = stated.keys
        places = self._places_of(signals)
        residual, variance = innovation.leave_one_out
        if self._unseen > 0.0:
            phases = slice(len(stated), 2 * len(stated))
            is_precise = variance[phases] < 2.0 * innovation.noise[phases]
            is_precise &= innovation.is_used[phases]
            self._follow_unseen(stated, residual[phases], variance[phases], ~is_precise)
        missing, new = learn_scatter(
            places,
            time.nanoseconds,
            residual,
            variance,
            innovation.noise,
            stated.phase_variance,
            innovation.is_used,
            is_phase_fault,
            self._unseen,
            2.0,
            self._seen_times,
            self._known_times,
            self._numbers,
        )
        if new:
            is_new = ~np.isin(places, self._known_places)
            self._known_places = np.append(self._known_places, places[is_new])
        forgotten, self._has_excess = forget_scatter(
            self._known_places, time.nanoseconds, _LONGEST_ABSENCE, self._seen_times, self._numbers
        )
        if forgotten:
            self._known_places = self._known_places[self._seen_times[self._known_places] >= 0]
        if self._is_orbital and (self._has_excess or self._unseen > 0.0):
            self._expect_unseen(time)
        return {key: value for key, value in zip(signals, missing.tolist(), strict=True) if value}

    def _expect_unseen(self, time: GpsTime) -> None:
        """Set the excess of signals whose own cannot be seen to the mean of the others."""
        places = self._known_places
        known_times, variances = self._known_times[places], self._numbers[0, places]
        known = [
            variance
            for last, variance in zip(known_times.tolist(), variances.tolist(), strict=True)
            if last >= 0 and (time.nanoseconds - last) / NANOSECONDS_PER_SECOND <= _KNOWN_TIME
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
        factor = 1.0 + min(mean_square - 1.0, 1.0) / MEMORY_EPOCHS
        self._unseen *= factor
        self._numbers[0, self._places_of(stated.keys)[is_sample]] *= factor


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
