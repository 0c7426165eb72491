"""Waves of the plasma above the spacecraft, smaller than the sky that a receiver sees.

Receivers kilometres apart see each satellite through plasma of its own: no gradient over the whole
sky stands for a wave whose length is that of the distances between the rays. So each satellite has
its differential content, as in Kroes (2006, section 5.3), here with a sigma that is learnt.
"""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.vectors import FloatArray

__all__ = ["PlasmaWaves"]

# Content beyond which waves are states, TECU: 0.3 mm on L1.
_SMALLEST_CONTENT = 0.002
# Variances that are weighed, as multiples of the stated one (large disturbances on the ground have
# ten times its sigma); by how many decades that is uncertain; and the time over which estimates are
# forgotten, s.
_FACTORS = 10.0 ** np.arange(-3.0, 2.25, 0.25)
_STATED_DECADES, _MEMORY = 1.0, 120.0
# Share of the variance that an estimate must explain to count, and sigmas of the widest model
# beyond which it is no sample.
_SMALLEST_SHARE, _LARGEST_SIGMAS = 1e-4, 5.0


class PlasmaWaves:
    """Sigma of the vertical content of waves, deputy less chief, as the estimates show it.

    Parameters
    ----------
    sigma_tecu : float
        A priori sigma of the vertical content at one place, TECU.
    length : float
        Distance over which it stays alike, m: covariances are ``exp(-d^2 / (2 length^2))``.
    correlation_time : float
        Time over which the content that a ray meets stays alike, s.
    """

    def __init__(self, sigma_tecu: float, length: float, correlation_time: float) -> None:
        self._sigma_tecu = sigma_tecu
        self._length = length
        self._correlation_time = correlation_time
        self._log_prior = -0.5 * (np.log10(_FACTORS) / _STATED_DECADES) ** 2
        self._log_likelihood = np.zeros(len(_FACTORS))
        self._factor = 1.0

    def are_felt(self, distance: float) -> bool:
        """Return whether waves as large as stated tell in phases over a distance, m."""
        return self._stated_sigma_tecu(distance) > _SMALLEST_CONTENT

    def sigma_tecu(self, distance: float) -> float:
        """Return the sigma of the vertical content at two places less each other, TECU."""
        return math.sqrt(self._factor) * self._stated_sigma_tecu(distance)

    def learn_changes(
        self, score: FloatArray, information: FloatArray, distance: float, interval: float
    ) -> None:
        """Weigh variances with the innovation of an epoch.

        Parameters
        ----------
        score : ndarray, shape (n,)
            h' S^-1 v of n satellites, 1/TECU: v is the innovation, S its covariance, and h its
            derivatives by the vertical content.
        information : ndarray, shape (n,)
            h' S^-1 h, 1/TECU^2: the variance of the content that the innovation tells is its
            inverse, and holds what the content has changed by with the present variance.
        distance : float
            Distance of both antennas, m.
        interval : float
            Since the last epoch, s.
        """
        is_told = information > 0.0
        score, information = score[is_told], information[is_told]
        changed = -math.expm1(-2.0 * interval / self._correlation_time)
        changed *= self._stated_sigma_tecu(distance) ** 2
        noise = np.maximum(1.0 / information - self._factor * changed, 0.0)
        self._weigh((score / information) ** 2, noise, changed, 1.0, interval)

    def learn(
        self, mean: FloatArray, variance: FloatArray, distance: float, interval: float
    ) -> None:
        """Weigh variances with the content that was estimated at an epoch.

        An estimate x with the variance P, where the process has the variance s, is that of a
        measurement x / k with the noise s (1 - k) / k, with k = 1 - P / s.

        Parameters
        ----------
        mean, variance : ndarray, shape (n,)
            Estimates of the vertical content of n satellites, TECU, and their variances.
        distance : float
            Distance of both antennas, m.
        interval : float
            Since the last epoch, s.
        """
        steady = self.sigma_tecu(distance) ** 2
        share = 1.0 - variance / steady
        is_told = share > _SMALLEST_SHARE
        share = share[is_told]
        # Estimates that follow each other are hardly new.
        new = -math.expm1(-interval / self._correlation_time)
        self._weigh(
            (mean[is_told] / share) ** 2,
            steady * (1.0 - share) / share,
            self._stated_sigma_tecu(distance) ** 2,
            new,
            0.0,
        )

    def _weigh(
        self, square: FloatArray, noise: FloatArray, stated: float, new: float, elapsed: float
    ) -> None:
        """Weigh the models with squares of measured content (multiple models: Magill 1965).

        Its variance is the sum of that of the noise and of the stated one times the factor. What is
        not a number, or has a negative variance of its noise, as rounding makes where an estimate
        explains all of the variance, is no sample: it would spoil the likelihoods for good.
        """
        is_number = np.isfinite(square) & np.isfinite(noise) & (noise >= 0.0)
        square, noise = square[is_number], noise[is_number]
        total = _FACTORS[:, None] * stated + noise
        is_sample = square < _LARGEST_SIGMAS**2 * total[-1]
        self._log_likelihood *= math.exp(-elapsed / _MEMORY)
        self._log_likelihood -= 0.5 * new * ((np.log(total) + square / total) @ is_sample)
        self._log_likelihood -= self._log_likelihood.max()
        exponent = self._log_prior + self._log_likelihood
        weight = np.exp(exponent - exponent.max())
        self._factor = math.exp(float(weight @ np.log(_FACTORS)) / float(weight.sum()))

    def _stated_sigma_tecu(self, distance: float) -> float:
        unlike = -math.expm1(-0.5 * (distance / self._length) ** 2)
        return self._sigma_tecu * math.sqrt(2.0 * unlike)
