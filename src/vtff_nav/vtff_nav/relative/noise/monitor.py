"""Noise of the single differences of both receivers, learnt epoch by epoch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_nav.relative.common.columns import are_all, with_columns
from vtff_nav.relative.common.measurements import SingleDifferences
from vtff_nav.relative.common.signal_set import SignalPlaces, SignalSet, with_places
from vtff_nav.relative.kernels.noise import collect_residuals, count_codes
from vtff_nav.relative.noise.components import (
    NoiseComponents,
    Redundancy,
    SlowError,
    white_equivalent_variance,
)

__all__ = ["EpochResiduals", "NoiseMonitor", "NoisePrior"]

# Sigmas of the slow components that are weighed, of a single difference, m, and their times, s.
# Steps of a tenth of a decade: with coarser ones the estimate is up to a third off, and the
# covariance of the position by two thirds.
_PHASE_SIGMAS = tuple((0.25e-3 * 10.0 ** (np.arange(19) / 10.0)).tolist())
_CODE_SIGMAS = tuple((0.04 * 10.0 ** (np.arange(19) / 10.0)).tolist())
_TIMES = (30.0, 100.0, 300.0)
# Residuals of so few signals tell nothing.
_FEWEST_ROWS = 4
# A signal that was not seen for longer (s) comes back with other slow errors.
_LONGEST_ABSENCE = 300.0


@dataclass(frozen=True)
class NoisePrior:
    """Slow errors that are assumed before the measurements show them.

    Parameters
    ----------
    phase_sigma, code_sigma : float
        Sigmas at one receiver, m.
    correlation_time : float
        s.
    """

    phase_sigma: float
    code_sigma: float
    correlation_time: float


@dataclass(frozen=True, eq=False)
class EpochResiduals:
    """The n single differences of an epoch against a prediction.

    Parameters
    ----------
    measured : SingleDifferences
        With the variances that the receivers state.
    predicted : ndarray, shape (n,)
        Predicted single differences without clocks, biases, ambiguities and plasma, m.
    integer_cycles : ndarray, shape (n,)
        Cycles to take off the phases; NaN where they are not known.
    is_phase_continued : ndarray of bool, shape (n,)
        Whether the ambiguity of the phase is that of the last epoch.
    common : ndarray, shape (n, p)
        Derivatives of codes and phases by unknown position, clock and biases.
    plasma : ndarray, shape (n, q)
        Derivatives of the phases by the plasma, in units of its a priori sigma.
    is_code_sample, is_phase_sample : ndarray of bool, shape (n,)
        False for what is faulty or scintillates.
    """

    measured: SingleDifferences
    predicted: FloatArray
    integer_cycles: FloatArray
    is_phase_continued: npt.NDArray[np.bool_]
    common: FloatArray
    plasma: FloatArray
    is_code_sample: npt.NDArray[np.bool_]
    is_phase_sample: npt.NDArray[np.bool_]


class NoiseMonitor:
    """White and slow components of the single differences of codes and of phases.

    Parameters
    ----------
    prior : NoisePrior
    memory : float
        Time over which slow components are forgotten, s.
    """

    def __init__(self, prior: NoisePrior, memory: float) -> None:
        time = prior.correlation_time
        # A single difference has the errors of two receivers.
        self.phase = NoiseComponents(
            SlowError(np.sqrt(2.0) * prior.phase_sigma, time), _PHASE_SIGMAS, _TIMES, memory
        )
        self.code = NoiseComponents(
            SlowError(np.sqrt(2.0) * prior.code_sigma, time), _CODE_SIGMAS, _TIMES, memory
        )
        # By place: last epoch of a code and number of its epochs; last epoch from which noise was
        # learnt (GPS, ns; -1 before), and the levels of code and phase at it, m.
        self._places = SignalPlaces()
        self._code_times = np.full(0, -1, dtype=np.int64)
        self._code_counts = np.zeros(0, dtype=np.int64)
        self._level_times = np.full(0, -1, dtype=np.int64)
        self._levels = np.zeros((2, 0))
        self._last_time = -1

    def _places_of(self, signals: SignalSet) -> npt.NDArray[np.int64]:
        """Return the place of each signal, shape (n,), which all columns have."""
        places = self._places.of(signals)
        if len(self._places) > len(self._code_times):
            self._code_times = with_places(self._code_times, self._places, -1)
            self._code_counts = with_places(self._code_counts, self._places)
            self._level_times = with_places(self._level_times, self._places, -1)
            self._levels = with_places(self._levels, self._places)
        return places

    def weigh(
        self, time: GpsTime, interval: float, measured: SingleDifferences
    ) -> SingleDifferences:
        """Return single differences with the variances that their white noise has.

        Codes have slow errors as part of their variances; those of the phases are states.
        """
        # The components are those of a signal whose noise has not grown.
        (power, white, phase_variance), epochs = count_codes(
            self._places_of(measured.keys),
            time.nanoseconds,
            _LONGEST_ABSENCE,
            measured.noise_growth,
            measured.code_variance,
            measured.phase_variance,
            self.code.white_factor,
            self.phase.white_factor,
            self._code_times,
            self._code_counts,
        )
        variance = white_equivalent_variance(white, self.code.slow, epochs, interval)
        return with_columns(measured, code_variance=power * variance, phase_variance=phase_variance)

    def learn(self, time: GpsTime, interval: float, epoch: EpochResiduals) -> None:
        """Update all components with the residuals of an epoch."""
        measured = epoch.measured
        values, variances, common, unknowns = collect_residuals(
            self._places_of(measured.keys),
            time.nanoseconds,
            self._last_time,
            1.5 * interval,
            measured.code,
            measured.phase,
            measured.code_variance,
            measured.phase_variance,
            epoch.predicted,
            epoch.integer_cycles,
            measured.wavelength,
            epoch.is_phase_continued,
            measured.noise_growth,
            epoch.common,
            epoch.plasma,
            self._level_times,
            self._levels,
        )
        self._last_time = time.nanoseconds
        prior = np.zeros(unknowns.shape[1])
        prior[common.shape[1] :] = 1.0
        for components, kind, design, is_sample in (
            (self.code, 0, common, epoch.is_code_sample),
            (self.phase, 1, unknowns, epoch.is_phase_sample),
        ):
            self._learn_kind(
                components,
                time,
                interval,
                measured.keys,
                values[kind],
                variances[kind],
                design,
                prior[: design.shape[1]],
                is_sample,
            )

    @staticmethod
    def _learn_kind(
        components: NoiseComponents,
        time: GpsTime,
        interval: float,
        signals: SignalSet,
        values: FloatArray,
        variance: FloatArray,
        design: FloatArray,
        prior: FloatArray,
        is_sample: npt.NDArray[np.bool_],
    ) -> None:
        """Update the components of one kind; `values` are changes and levels, NaN if unknown."""
        prior = prior * components.white_factor
        has_values = np.isfinite(values)
        if are_all(has_values):
            if len(values) > _FEWEST_ROWS:
                redundancy = Redundancy.of(values, np.sqrt(variance), design, prior)
                number = np.where(is_sample, redundancy.number, 0.0)
                changes, levels = redundancy.residual.T.copy()
                components.add_changes(changes, number, variance, interval)
                components.add_residuals(time, signals, levels, number, variance)
            return
        for column in (0, 1):
            rows = np.flatnonzero(has_values[:, column])
            if len(rows) <= _FEWEST_ROWS:
                continue
            of_rows = variance[rows]
            redundancy = Redundancy.of(
                values[rows, column][:, None], np.sqrt(of_rows), design[rows], prior
            )
            number = np.where(is_sample[rows], redundancy.number, 0.0)
            residual = redundancy.residual[:, 0]
            if column == 0:
                components.add_changes(residual, number, of_rows, interval)
            else:
                components.add_residuals(time, signals.select(rows), residual, number, of_rows)
