"""Unmodelled accelerations as the estimates themselves show them."""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.vectors import FloatArray
from vtff_nav.relative.common.dynamics import DYNAMIC_STATES, MotionNoise

__all__ = ["AccelerationMonitor"]

# Limits of the factor of the a priori sigma, and the time over which it is learnt, s.
_FACTORS = (0.2, 20.0)
_MEMORY = 300.0


class AccelerationMonitor:
    """Adapts the sigma of empirical accelerations to their estimates.

    The expected square of an estimated acceleration, its mean squared and its variance, is the
    steady-state variance of its process if that was assumed rightly (expectation maximisation:
    Dempster, Laird and Rubin 1977); where measurements tell nothing, it is what was assumed.

    Parameters
    ----------
    noise : MotionNoise
        A priori noise.
    """

    def __init__(self, noise: MotionNoise) -> None:
        self._noise = noise
        self.factor = 1.0

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
        sigma = self._noise.at_distance(distance).empirical_sigma
        if sigma == 0.0:
            return
        acceleration = slice(6, DYNAMIC_STATES)
        square = mean[acceleration] ** 2 + np.diagonal(covariance)[acceleration]
        share = -math.expm1(-interval / _MEMORY)
        variance = (1.0 - share) * self.factor**2 + share * float(np.mean(square)) / sigma**2
        self.factor = min(max(math.sqrt(variance), _FACTORS[0]), _FACTORS[1])
