"""Slow errors of differential contents, measured from how satellites disagree with each other.

Multipath, variations of phase centres and what a mapping leaves out are of centimetres, other for
each satellite, and change within minutes. Their size and correlation time are not assumed: what is
left of the contents of a second when everything that all satellites share is removed shows both.
Seconds that follow each other have nearly the same errors, so that minutes of them are few samples:
the sigma contains that it is known from few.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_iono.density import kernels

__all__ = ["SlowErrors"]

# What is taken to be until it is measured: sigma, TECU (1.5 mm on each of four phases), and
# correlation time, s, and as how many satellite-seconds of measurements they count; those of the
# sigma count less and less, over a time of `_FORGOTTEN`, s. At first the sigma is known as from
# `_FIRST_SAMPLES` samples that are independent, each of which lasts for the correlation time, and
# that time as from six.
_FIRST_SIGMA, _FIRST_TIME = 0.03, 100.0
_FIRST_WEIGHT, _FIRST_WEIGHT_OF_TIME = 50.0, 600.0
_FIRST_SAMPLES = 4.0
_FORGOTTEN = 30.0
# From fewer independent samples than this no variance is known any better.
_FEWEST_SAMPLES = 3.0
# s; over which the measurements are averaged.
_MEMORY = 900.0
# s; correlation is measured over this time.
_LAG = 20.0
_SHORTEST_TIME, _LONGEST_TIME = 20.0, 1000.0
_FEWEST_DEGREES = 0.5
# A residual counts at most as this many sigmas: one wrong integer is no multipath.
_LARGEST_SIGMAS = 4.0
_SMALLEST_SIGMA = 1e-4  # TECU


class SlowErrors:
    """Sigma and correlation time of the slow error of a satellite, the same for all of them.

    Attributes
    ----------
    sigma : float
        TECU: root of the expected variance, known from few independent samples.
    correlation_time : float
        Time after which the correlation is 1/e, s.
    """

    def __init__(self) -> None:
        self._first_weight = _FIRST_WEIGHT
        self._square = self._weight = 0.0
        self._of_product = _FIRST_WEIGHT_OF_TIME * _FIRST_SIGMA**2
        self._product = self._of_product * math.exp(-_LAG / _FIRST_TIME)
        self._recent: deque[tuple[float, dict[int, float]]] = deque()
        self._last_time: float | None = None
        self._renew()

    def _renew(self) -> None:
        """Compute sigma and correlation time anew from the sums of measurements."""
        self.correlation_time = self._expected_time()
        self.sigma = self._expected_sigma()

    def _expected_sigma(self) -> float:
        """Return the sigma, TECU: root of the expected variance, known from few samples."""
        square = max(0.0, self._square) + self._first_weight * _FIRST_SIGMA**2
        weight = self._weight + self._first_weight
        # An exponential correlation makes of a time as many independent squares (Bartlett 1946).
        samples = weight / self.correlation_time
        samples += _FIRST_SAMPLES * self._first_weight / _FIRST_WEIGHT
        # Mean of the inverse gamma distribution of a variance (Gelman and others, Bayesian Data
        # Analysis, section 2.6).
        samples = max(samples, _FEWEST_SAMPLES)
        variance = square / weight * samples / (samples - 2.0)
        return max(math.sqrt(variance), _SMALLEST_SIGMA)

    def _expected_time(self) -> float:
        """Return the time after which the correlation is 1/e, s."""
        correlation = self._product / max(self._of_product, 1e-12)
        if not 0.0 < correlation < 1.0:
            return _SHORTEST_TIME if correlation <= 0.0 else _LONGEST_TIME
        return min(max(-_LAG / math.log(correlation), _SHORTEST_TIME), _LONGEST_TIME)

    def add(
        self,
        time: float,
        satellites: npt.NDArray[np.int64],
        observed: FloatArray,
        common: FloatArray,
        common_sigma: FloatArray,
        fast_variance: FloatArray,
    ) -> None:
        """Add an epoch.

        Parameters
        ----------
        time : float
            s, increasing.
        satellites : ndarray of int, shape (n,)
        observed : ndarray, shape (n,)
            Contents, TECU.
        common : ndarray, shape (n, p)
            Derivatives with respect to what all satellites share, and is removed. What is estimated
            from the contents belongs to it: it takes part of the slow errors with it.
        common_sigma : ndarray, shape (p,)
            Sigma of what is shared before any content; infinite for what only the contents tell.
        fast_variance : ndarray, shape (n,)
            Variance of the errors that are independent from epoch to epoch, TECU^2.
        """
        elapsed = 0.0 if self._last_time is None else max(0.0, time - self._last_time)
        self._last_time = time
        is_determined, weight, residual, freedom = kernels.slow_residuals(
            observed, common, common_sigma, fast_variance, self.sigma**2
        )
        if not is_determined or freedom.sum() < _FEWEST_DEGREES:
            return
        residual = np.minimum(np.maximum(residual, -_LARGEST_SIGMAS), _LARGEST_SIGMAS) / weight
        kept = math.exp(-elapsed / _MEMORY)
        self._forget(kept)
        self._first_weight *= math.exp(-elapsed / _FORGOTTEN)
        self._renew()
        # Satellites that fluctuate fast tell little about slow errors, and where they fluctuate by
        # more than these, only how well the sigma of the fluctuations is known.
        trust = (self.sigma**2 * weight**2) ** 2 + 1e-3
        trust[fast_variance > max(self.sigma, _FIRST_SIGMA) ** 2] = 0.0
        self._square += float(trust @ (residual**2 - freedom * fast_variance))
        self._weight += float(trust @ freedom)
        self._add_products(time, satellites, residual, freedom * fast_variance, trust)
        self._renew()

    def _forget(self, kept: float) -> None:
        self._square *= kept
        self._weight *= kept
        self._product *= kept
        self._of_product *= kept

    def _add_products(
        self,
        time: float,
        satellites: npt.NDArray[np.int64],
        residual: FloatArray,
        fast: FloatArray,
        trust: FloatArray,
    ) -> None:
        """Add products of residuals now and a lag before, which tell the correlation."""
        now = dict(zip(satellites.tolist(), residual.tolist(), strict=True))
        self._recent.append((time, now))
        before: Mapping[int, float] = {}
        while self._recent and time - self._recent[0][0] >= _LAG:
            before = self._recent.popleft()[1]
        rows = zip(satellites.tolist(), fast.tolist(), trust.tolist(), strict=True)
        for satellite, variance, weight in rows:
            if satellite in before:
                self._product += weight * now[satellite] * before[satellite]
                squares = 0.5 * (now[satellite] ** 2 + before[satellite] ** 2)
                self._of_product += weight * max(squares - variance, 0.0)
