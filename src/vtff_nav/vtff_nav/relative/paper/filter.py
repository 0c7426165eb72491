"""The extended Kalman filter of the VTFF testbed paper: eight states, carrier phase only.

References
----------
Peng and others, sections 3.3 and 3.4, equations 5 and 6.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from filterpy.kalman import ExtendedKalmanFilter

from vtff_dynamics.constants import EARTH_ROTATION_RATE, GM_EARTH
from vtff_dynamics.vectors import FloatArray, skew

__all__ = [
    "CLOCK",
    "CLOCK_RATE",
    "MOTION",
    "POSITION",
    "STATES",
    "VELOCITY",
    "CarrierPhaseFilter",
    "process_noise",
    "state_jacobian",
]

STATES = 8
POSITION, CLOCK, VELOCITY, CLOCK_RATE = slice(0, 3), 3, slice(4, 7), 7
"""Indices of the states, deputy less chief; position (m) and velocity (m/s) are Earth-fixed."""

MOTION = (0, 1, 2, 4, 5, 6)
"""Indices of position and velocity."""


def state_jacobian(position_gcrf: npt.ArrayLike, to_itrf: FloatArray) -> FloatArray:
    """Return F = df/dX of the eight states, shape (8, 8), 1/s.

    Parameters
    ----------
    position_gcrf : array_like, shape (3,)
        Position at which the gravity gradient of a point mass is taken, m.
    to_itrf : ndarray, shape (3, 3)
        Rotation from GCRF to ITRF.

    References
    ----------
    Peng and others, section 3.4: F(t0) = df/dX, Phi = expm(F dt); here in the rotating axes of the
    Earth, with the Coriolis and centrifugal terms.
    """
    position = to_itrf @ np.asarray(position_gcrf, dtype=float)
    squared = float(position @ position)
    gradient = GM_EARTH / squared**1.5 * (3.0 * np.outer(position, position) / squared - np.eye(3))
    rotation = skew(np.array([0.0, 0.0, EARTH_ROTATION_RATE]))
    jacobian = np.zeros((STATES, STATES))
    jacobian[POSITION, VELOCITY] = np.eye(3)
    jacobian[CLOCK, CLOCK_RATE] = 1.0
    jacobian[VELOCITY, POSITION] = gradient - rotation @ rotation
    jacobian[VELOCITY, VELOCITY] = -2.0 * rotation
    return jacobian


def process_noise(
    duration: float, acceleration_noise: float, clock_noise: float, clock_rate_noise: float
) -> FloatArray:
    """Return Q (8, 8): white acceleration, white and random-walk frequency of the clocks.

    Parameters
    ----------
    duration : float
        s.
    acceleration_noise, clock_noise, clock_rate_noise : float
        Roots of spectral densities: m/s2/sqrt(Hz), m/sqrt(s), m/s/sqrt(s).
    """
    density, rate_density = acceleration_noise**2, clock_rate_noise**2
    noise = np.zeros((STATES, STATES))
    identity = np.eye(3)
    noise[POSITION, POSITION] = density * duration**3 / 3.0 * identity
    noise[POSITION, VELOCITY] = density * duration**2 / 2.0 * identity
    noise[VELOCITY, POSITION] = density * duration**2 / 2.0 * identity
    noise[VELOCITY, VELOCITY] = density * duration * identity
    noise[CLOCK, CLOCK] = clock_noise**2 * duration + rate_density * duration**3 / 3.0
    noise[CLOCK, CLOCK_RATE] = noise[CLOCK_RATE, CLOCK] = rate_density * duration**2 / 2.0
    noise[CLOCK_RATE, CLOCK_RATE] = rate_density * duration
    return noise


class CarrierPhaseFilter(ExtendedKalmanFilter):  # type: ignore[misc]
    """Filter of filterpy with a nonlinear prediction that the caller computes.

    All vectors are one-dimensional: with a column state filterpy broadcasts one-dimensional
    measurements into a matrix. Every update has an R of its own, because its size changes.

    Parameters
    ----------
    mean : ndarray, shape (8,)
    covariance : ndarray, shape (8, 8)
    """

    def __init__(self, mean: FloatArray, covariance: FloatArray) -> None:
        super().__init__(dim_x=STATES, dim_z=1)
        self.x = mean
        self.P = covariance
        self._predicted = mean

    def predict_to(self, mean: FloatArray, transition: FloatArray, noise: FloatArray) -> None:
        """Predict with a mean that was propagated by the dynamics."""
        self._predicted, self.F, self.Q = mean, transition, noise
        self.predict()

    def predict_x(self, u: object = 0) -> None:
        """Set the state to the mean of `predict_to` instead of F x; filterpy calls this."""
        self.x = self._predicted

    def release_clock(self, jump: float, sigma: float) -> None:
        """Add `jump` to the clock difference and set its sigma, m, without correlations."""
        self.x[CLOCK] += jump
        self.P[CLOCK, :] = self.P[:, CLOCK] = 0.0
        self.P[CLOCK, CLOCK] = sigma**2

    def update_phases(
        self, residual: FloatArray, direction: FloatArray, variances: FloatArray
    ) -> None:
        """Update with carrier phases, Joseph form.

        Parameters
        ----------
        residual : ndarray, shape (n,)
            Measured less predicted, m.
        direction : ndarray, shape (n, 3)
            Derivatives by the relative position, ITRF.
        variances : ndarray, shape (n,)
            m2.
        """
        design = np.zeros((len(residual), STATES))
        design[:, POSITION] = direction
        design[:, CLOCK] = 1.0
        # `residual` is already measured less predicted, so that h(x) is zero.
        self.update(
            residual,
            lambda _state: design,
            lambda _state: np.zeros(len(residual)),
            R=np.diag(variances),
        )
        self.P = 0.5 * (self.P + self.P.T)

    @property
    def innovation(self) -> tuple[float, int]:
        """Normalised innovation squared of the last update and its degrees of freedom."""
        return float(self.y @ self.SI @ self.y), len(self.y)
