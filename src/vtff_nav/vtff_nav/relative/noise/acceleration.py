"""Unmodelled accelerations as the estimates themselves show them."""

from __future__ import annotations

import math

from vtff_dynamics.vectors import FloatArray
from vtff_nav.relative.common.dynamics import MotionNoise

__all__ = ["AccelerationMonitor"]

# Limits of the factor of the a priori sigma, and the time over which it is learnt, s.
_FACTORS = (0.05, 20.0)
_MEMORY = 150.0
# Share of the variance that measurements must explain for the factor to be learnt at half that
# pace, and the share below which the estimate is that which was assumed.
_HALF_PACE, _SMALLEST_SHARE = 0.2, 0.01
# Share from which an estimate tells whether the sigma is right, and how much larger than at the
# start that may have become.
_TELLING_SHARE, _BORNE_OUT_FACTOR = 0.1, 1.05
# Largest square of an estimate, as a multiple of its variance, that counts.
_LARGEST_SQUARE = 6.0


class AccelerationMonitor:
    """Adapts the sigma of empirical accelerations to their estimates.

    If the process was assumed rightly, the variance of an estimated acceleration is that of the
    process less that of the error of the estimate (law of total variance). The logarithm of the
    variance follows the ratio of both step by step (Robbins and Monro 1951), as fast as the
    measurements say something of the acceleration.

    Parameters
    ----------
    noise : MotionNoise
        A priori noise.
    factor : float
        Factor of its sigma at the start.
    smallest_factor : float
        The factor does not fall below it: what minutes show says little of the rest of an orbit
        where the accelerations change along it, as drag does from night to day.

    Attributes
    ----------
    is_borne_out : bool
        Whether measurements tell something of the acceleration, and it is as small as assumed.
    """

    def __init__(
        self, noise: MotionNoise, factor: float = 1.0, smallest_factor: float = _FACTORS[0]
    ) -> None:
        self._noise = noise
        self._variance: list[float] | None = None
        self.is_borne_out = False
        self._smallest_factor = smallest_factor
        self.factor = self._first_factor = min(max(factor, smallest_factor), _FACTORS[1])

    def sigma(self, distance: float) -> FloatArray:
        """Return the present sigmas (R, T, N) of the accelerations over a distance (m), m/s2."""
        return self._noise.at_distance(distance, self.factor).sigma

    def learn(
        self, mean: FloatArray, covariance: FloatArray, distance: float, interval: float
    ) -> None:
        """Adapt the factor to the estimate of an epoch.

        Parameters
        ----------
        mean, covariance : ndarray, shape (n,) and (n, n)
            State that begins with position, velocity and empirical acceleration.
        distance : float
            Distance of the two antennas, m; 0 for the motion of one antenna.
        interval : float
            Since the last epoch, s.
        """
        sigmas, times = self._noise.numbers_at_distance(distance, self.factor)
        count = (sigmas[0] > 0.0) + (sigmas[1] > 0.0) + (sigmas[2] > 0.0)
        if count == 0:
            return
        variances, share, square = [], 0.0, 0.0
        for axis in range(3):
            steady = sigmas[axis] ** 2
            # Variance of the process, which follows a change of distance or factor slowly.
            kept = math.exp(-2.0 * interval / times[axis])
            before = steady if self._variance is None else self._variance[axis]
            variance = kept * before + (1.0 - kept) * steady
            variances.append(variance)
            if variance > 0.0:
                share += (1.0 - covariance.item(6 + axis, 6 + axis) / variance) / count
                square += mean.item(6 + axis) ** 2 / variance / count
        self._variance = variances
        if share < _SMALLEST_SHARE:
            return
        square /= share
        is_as_assumed = self.factor < _BORNE_OUT_FACTOR * self._first_factor
        self.is_borne_out = share > _TELLING_SHARE and square < _LARGEST_SQUARE and is_as_assumed
        pace = -math.expm1(-interval / _MEMORY) * share / (share + _HALF_PACE)
        factor = self.factor * math.exp(0.5 * pace * (min(square, _LARGEST_SQUARE) - 1.0))
        self.factor = min(max(factor, self._smallest_factor), _FACTORS[1])
