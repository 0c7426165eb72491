"""Noise of the single differences of both receivers, learnt epoch by epoch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.signals import SignalKey
from vtff_nav.relative.common.columns import with_columns
from vtff_nav.relative.common.measurements import SingleDifferences
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
        self._last: dict[SignalKey, tuple[GpsTime, float, float]] = {}
        self._codes: dict[SignalKey, tuple[GpsTime, int]] = {}

    def weigh(
        self, time: GpsTime, interval: float, measured: SingleDifferences
    ) -> SingleDifferences:
        """Return single differences with the variances that their white noise has.

        Codes have slow errors as part of their variances; those of the phases are states.
        """
        # The components are those of a signal whose noise has not grown.
        power = measured.noise_growth**2
        white = self.code.white_factor * measured.code_variance / power
        epochs = []
        for key in measured.keys:
            last, count = self._codes.get(key, (time, 0))
            count = count + 1 if time - last <= _LONGEST_ABSENCE else 1
            self._codes[key] = time, count
            epochs.append(count)
        return with_columns(
            measured,
            code_variance=power
            * white_equivalent_variance(white, self.code.slow, np.array(epochs), interval),
            phase_variance=self.phase.white_factor * measured.phase_variance,
        )

    def learn(self, time: GpsTime, interval: float, epoch: EpochResiduals) -> None:
        """Update all components with the residuals of an epoch."""
        measured = epoch.measured
        code_level = measured.code - epoch.predicted
        phase_level = measured.phase - epoch.predicted
        code_change, phase_change = self._changes(time, interval, measured, code_level, phase_level)
        phase_change[~epoch.is_phase_continued] = np.nan
        growth = measured.noise_growth
        common, plasma = epoch.common / growth[:, None], epoch.plasma / growth[:, None]
        self._learn_kind(
            self.code,
            time,
            interval,
            measured.keys,
            np.column_stack((code_change, code_level)) / growth[:, None],
            measured.code_variance / growth**2,
            common,
            np.zeros(common.shape[1]),
            epoch.is_code_sample,
        )
        fixed = phase_level - epoch.integer_cycles * measured.wavelength
        self._learn_kind(
            self.phase,
            time,
            interval,
            measured.keys,
            np.column_stack((phase_change, fixed)) / growth[:, None],
            measured.phase_variance / growth**2,
            np.hstack((common, plasma)),
            np.repeat((0.0, 1.0), (common.shape[1], plasma.shape[1])),
            epoch.is_phase_sample,
        )

    def _changes(
        self,
        time: GpsTime,
        interval: float,
        measured: SingleDifferences,
        code_level: FloatArray,
        phase_level: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the changes of code and phase since the last epoch, NaN for what was not there."""
        code_change = np.full(len(measured), np.nan)
        phase_change = code_change.copy()
        now = {}
        levels = zip(measured.keys, code_level.tolist(), phase_level.tolist(), strict=True)
        for row, (key, code, phase) in enumerate(levels):
            last = self._last.get(key)
            if last is not None and time - last[0] < 1.5 * interval:
                code_change[row], phase_change[row] = code - last[1], phase - last[2]
            now[key] = time, code, phase
        self._last = now
        return code_change, phase_change

    @staticmethod
    def _learn_kind(
        components: NoiseComponents,
        time: GpsTime,
        interval: float,
        keys: list[SignalKey],
        values: FloatArray,
        variance: FloatArray,
        design: FloatArray,
        prior: FloatArray,
        is_sample: npt.NDArray[np.bool_],
    ) -> None:
        """Update the components of one kind; `values` are changes and levels, NaN if unknown."""
        has_values = np.isfinite(values)
        groups: list[tuple[npt.NDArray[np.intp], tuple[int, ...]]]
        if has_values.all():
            groups = [(np.arange(len(values)), (0, 1))]
        else:
            groups = [(np.flatnonzero(has_values[:, column]), (column,)) for column in (0, 1)]
        white = components.white_factor
        for rows, columns in groups:
            if len(rows) <= 4:
                continue
            redundancy = Redundancy.of(
                values[np.ix_(rows, np.array(columns))],
                np.sqrt(variance[rows]),
                design[rows],
                prior * white,
            )
            number = np.where(is_sample[rows], redundancy.number, 0.0)
            for column in columns:
                residual = redundancy.residual[:, columns.index(column)]
                if column == 0:
                    components.add_changes(residual, number, variance[rows], interval)
                else:
                    components.add_residuals(
                        time, [keys[row] for row in rows.tolist()], residual, number, variance[rows]
                    )
