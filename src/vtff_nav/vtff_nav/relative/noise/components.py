"""Noise of code and phase as the measurements themselves show it: white and slow components.

Receivers state a sigma of white noise. True errors are larger than stated, and part of them,
multipath above all, changes over minutes. The residuals of the single differences of an epoch
against position, clock, biases and plasma show both components, because an epoch has more
measurements than it has unknowns (estimation of variance components: Teunissen and Amiri-Simkooei
2008, Journal of Geodesy 82, 65). Differences of successive residuals give the white component
(von Neumann 1941). The slow one is a first-order Gauss-Markov process whose sigma and correlation
time are weighed on a grid by their likelihood (multiple models: Magill 1965, IEEE Transactions on
Automatic Control 10, 434). That there is no slow component is one of the models.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_nav.relative.common.signal_set import SignalSet
from vtff_nav.relative.kernels.noise import (
    adjust,
    equivalent_variances,
    expect_slow_error,
    ratios_of_means,
    update_models,
)

__all__ = ["NoiseComponents", "Redundancy", "SlowError", "white_equivalent_variance"]

# A residual that is larger by this factor than its model says is no sample of it.
_LARGEST_NORMALISED_RESIDUAL = 5.0
# Fewer redundant measurements than this tell nothing, neither does a residual that holds less of
# the error of its own measurement.
_FEWEST_REDUNDANT = 2.0
_SMALLEST_REDUNDANCY = 0.15
# Differences of residuals that the white factor needs before the slow component is weighed.
_FEWEST_CHANGES = 20.0
# The factor of the stated variance stays 1 until it is off by so many of its sigmas.
_SIGNIFICANT_SIGMAS = 4.0
# Change of the white factor after which the slow component is weighed anew.
_LARGEST_FACTOR_CHANGE = 1.5
# Time over which the white component is averaged while it is learnt at every epoch, s.
_WHITE_MEMORY = 300.0
# The slow component comes and goes with these probabilities that there is none.
_NONE_BEGINS, _NONE_ENDS = 0.5, 0.05


@dataclass(frozen=True)
class SlowError:
    """Slow component of the error of a single difference: a first-order Gauss-Markov process.

    Parameters
    ----------
    sigma : float
        Steady-state sigma, m; 0 where there is none.
    correlation_time : float
        s.
    """

    sigma: float
    correlation_time: float


@dataclass(frozen=True, eq=False)
class Redundancy:
    """Residuals of n measurements of an epoch against what they all depend on.

    Parameters
    ----------
    residual : ndarray, shape (n, k)
        Residuals of k sets of values, over the root of the redundancy number, m: their variance is
        that of a measurement.
    number : ndarray, shape (n,)
        Redundancy numbers (Baarda 1968): the part of an error that its own residual shows.
    """

    residual: FloatArray
    number: FloatArray

    @classmethod
    def of(
        cls, values: FloatArray, sigma: FloatArray, design: FloatArray, prior: FloatArray
    ) -> Redundancy:
        """Return the residuals of a least-squares adjustment.

        Parameters
        ----------
        values : ndarray, shape (n, k)
            Measured less predicted, k sets, m.
        sigma : ndarray, shape (n,)
            Sigmas of the measurements, m.
        design : ndarray, shape (n, p)
            Derivatives by the unknowns.
        prior : ndarray, shape (p,)
            Weights of the unknowns' a priori value of 0, inverse variances; 0 for free ones.
        """
        return cls(*adjust(values, sigma, design, prior))


class NoiseComponents:
    """White and slow component of one kind of measurement, code or phase, of all signals.

    Parameters
    ----------
    prior : SlowError
        Slow component that is assumed before the measurements have told.
    grid_sigmas : sequence of float
        Sigmas of the slow component that are weighed, m.
    grid_times : sequence of float
        Correlation times that are weighed, s.
    memory : float
        Time over which measurements are forgotten, s.
    """

    def __init__(
        self,
        prior: SlowError,
        grid_sigmas: Sequence[float],
        grid_times: Sequence[float],
        memory: float,
    ) -> None:
        self._prior = prior
        self._memory = memory
        sigma, correlation_time = np.meshgrid(grid_sigmas, grid_times, indexing="ij")
        # The first model has no slow component; it and the others together are equally likely.
        self._sigma = np.concatenate(([0.0], sigma.ravel()))
        self._time = np.concatenate(([1.0], correlation_time.ravel()))
        models = len(self._sigma)
        self._log_prior = np.full(models, -math.log(models - 1.0))
        self._log_prior[0] = 0.0
        self._log_likelihood = np.zeros(models)
        self._mean = np.zeros((models, 0))
        self._variance = np.zeros((models, 0))
        self._keys = SignalSet()
        self._weighed_at = GpsTime(0)
        self._changes = 0.0
        self._squares = 0.0
        self._samples = 0.0
        self.white_factor = 1.0
        self._weighed_factor = 1.0
        self.slow = prior

    def add_changes(
        self,
        residual: FloatArray,
        number: FloatArray,
        white_variance: FloatArray,
        interval: float,
    ) -> None:
        """Update the white factor with the changes of the residuals since the last epoch.

        Parameters
        ----------
        residual : ndarray, shape (n,)
            Residuals of the changes of the measurements, m; see `Redundancy.residual`.
        number : ndarray, shape (n,)
            Redundancy numbers; 0 for what is no sample.
        white_variance : ndarray, shape (n,)
            Stated variances of a measurement, m2.
        interval : float
            Time between both epochs, s.
        """
        square = residual**2 / (2.0 * white_variance)
        if self._changes >= _FEWEST_CHANGES:
            limit = _LARGEST_NORMALISED_RESIDUAL**2 * self._factor()
            number = np.where(square < limit, number, 0.0)
        freedom = float(number.sum())
        if freedom < _FEWEST_REDUNDANT:
            return
        if self._samples > 0.0:
            slow = self.slow
            moved = -(slow.sigma**2) * math.expm1(-interval / slow.correlation_time)
            square = square - moved / white_variance
        decay = math.exp(-interval / _WHITE_MEMORY)
        self._changes = decay * self._changes + freedom
        self._squares = decay * self._squares + float(number @ square)
        factor = self._factor()
        # Successive changes share a residual, which raises the variance of their mean by half.
        limit = 1.0 + _SIGNIFICANT_SIGMAS * math.sqrt(3.0 / self._changes)
        factor = factor if factor > limit else 1.0
        if (
            not 1.0 / _LARGEST_FACTOR_CHANGE
            < factor / self._weighed_factor
            < _LARGEST_FACTOR_CHANGE
        ):
            # The models were weighed with wrong noise.
            self._log_likelihood[:] = 0.0
            self._weighed_factor = factor
        self.white_factor = factor

    def _factor(self) -> float:
        return max(self._squares / self._changes, 1.0) if self._changes > 0.0 else 1.0

    def add_residuals(
        self,
        time: GpsTime,
        keys: SignalSet,
        residual: FloatArray,
        number: FloatArray,
        white_variance: FloatArray,
    ) -> None:
        """Weigh the models of the slow component with the residuals of an epoch.

        Parameters
        ----------
        time : GpsTime
        keys : SignalSet
            Signals without unknown ambiguities.
        residual, number : ndarray, shape (n,)
            See `Redundancy`; 0 as the number of what is no sample.
        white_variance : ndarray, shape (n,)
            Stated variances of a measurement, m2.
        """
        freedom = float(number.sum())
        if freedom < _FEWEST_REDUNDANT or self._changes < _FEWEST_CHANGES:
            return
        gaps = self._align(time, keys)
        if self._samples > 0.0:
            self._log_likelihood *= math.exp(-float(gaps.max()) / self._memory)
        has_sample = update_models(
            self._mean,
            self._variance,
            self._log_likelihood,
            self._sigma,
            self._time,
            gaps,
            residual,
            number,
            self.white_factor * white_variance,
            _LARGEST_NORMALISED_RESIDUAL,
            _SMALLEST_REDUNDANCY,
        )
        if has_sample:
            self._samples += freedom
        self._weigh()

    def _align(self, time: GpsTime, keys: SignalSet) -> FloatArray:
        """Have the slow errors of these signals; return the times since they were weighed, s."""
        if self._keys == keys:
            gaps = np.full(len(keys), time - self._weighed_at)
        else:
            column = self._keys.rows
            mean = np.zeros((len(self._sigma), len(keys)))
            variance = np.repeat(self._sigma[:, None] ** 2, len(keys), axis=1)
            gaps = np.zeros(len(keys))
            for row, key in enumerate(keys):
                index = column.get(key)
                if index is not None:
                    mean[:, row] = self._mean[:, index]
                    variance[:, row] = self._variance[:, index]
                    gaps[row] = time - self._weighed_at
            self._keys, self._mean, self._variance = keys, mean, variance
        self._weighed_at = time
        return gaps

    def _weigh(self) -> None:
        """Set the slow component from the likelihoods of the models."""
        none, sigma, correlation_time = expect_slow_error(
            self._log_prior + self._log_likelihood, self._sigma, self._time
        )
        has_none = self._samples > 0.0 and self.slow.sigma == 0.0
        if none > (_NONE_ENDS if has_none else _NONE_BEGINS):
            self.slow = SlowError(0.0, self._prior.correlation_time)
            return
        self.slow = SlowError(sigma, correlation_time)


def white_equivalent_variance(
    white: FloatArray, slow: SlowError, epochs: npt.NDArray[np.int64], interval: float
) -> FloatArray:
    """Return the variances with which measurements with slow errors may count as independent.

    Parameters
    ----------
    white : ndarray, shape (n,)
        Variances of the white component, m2.
    slow : SlowError
    epochs : ndarray of int64, shape (n,)
        Number of the measurement since the signal came into view, from 1.
    interval : float
        Time between measurements, s.

    Returns
    -------
    ndarray, shape (n,)
        m2. So many independent measurements tell of a constant what the mean of the real ones
        tells: 1 / v_k = I_k - I_(k-1), I_k being the inverse variance of the mean of k.
    """
    if slow.sigma == 0.0:
        return white
    ratios = ratios_of_means(epochs, interval, slow.correlation_time)
    largest = 4.0 * slow.sigma**2 * max(1.0, 2.0 * slow.correlation_time / interval)
    variances: FloatArray = equivalent_variances(
        white, slow.sigma**2, epochs, ratios, np.expm1(-ratios), largest
    )
    return variances
