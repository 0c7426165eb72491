"""Mean relative elements from relative states, smoothed by a Kalman filter.

One relative state gives the relative semi-major axis with some centimetres of error where the
velocity is good to 10 um/s; an orbit of them gives it to a millimetre.

An engine gives some percent more or less than it reports, some degrees aside, and does so in every
pulse. A pulse of 0.2 mm/s that is 5 % off leaves two centimetres of semi-major axis, nine in half
an orbit. So the filter estimates the errors of both engines with the elements: a reconfiguration of
centimetres per second teaches them to a part of a percent.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.orbit.mean_elements import elements_from_state, mean_elements
from vtff_dynamics.relative.relative_elements import (
    control_matrix,
    linear_map_rtn,
    mean_relative_elements,
)
from vtff_dynamics.relative.transition import j2_transition_matrix
from vtff_dynamics.vectors import FloatArray

__all__ = ["ElementsEstimator"]

_ELEMENTS, _OWN, _CHIEF = slice(0, 6), slice(6, 15), slice(15, 24)
_SIZE = 24
_LARGEST_MISFIT = 100.0
"""Squared misfit of a state, with 6 degrees of freedom, that no error of navigation makes: thrust
that nobody noted does. A stated sigma of a third of the true one makes 54."""


class ElementsEstimator:
    """Filter of the mean relative elements of one deputy and of the engines that move it.

    Parameters
    ----------
    model_position_sigma, model_velocity_sigma
        What mean elements under J2 alone leave out of a relative state, m and m/s; added to every
        covariance, and all there is for a state without one.
    acceleration_density
        Root of the spectral density of unknown differential accelerations, m/s^1.5.
    thrust_noise
        Sigma of each thrust on each axis as a share of it, drawn anew in every step.
    engine_sigma
        Sigma of each entry of the matrix by which true thrust exceeds the reported one.
    correlation_time
        Correlation time of the errors of relative states, s: those of navigation by carrier phases
        turn with multipath and antennas, in minutes. States in between bring little that is new.
    """

    def __init__(
        self,
        model_position_sigma: float = 2e-3,
        model_velocity_sigma: float = 2e-6,
        acceleration_density: float = 1e-8,
        thrust_noise: float = 0.02,
        engine_sigma: float = 0.05,
        correlation_time: float = 300.0,
    ) -> None:
        self._floor = np.diag([model_position_sigma**2] * 3 + [model_velocity_sigma**2] * 3)
        self._density = acceleration_density
        self._thrust_noise = thrust_noise
        self._engine_sigma = engine_sigma
        self._correlation_time = correlation_time
        self.time = math.nan
        self.chief_mean: FloatArray = np.zeros(6)
        self._estimate: FloatArray = np.zeros(_SIZE)
        self._covariance: FloatArray = np.zeros((_SIZE, _SIZE))

    @property
    def mean_motion(self) -> float:
        """Mean motion of the chief, rad/s."""
        return math.sqrt(GM_EARTH / float(self.chief_mean[0]) ** 3)

    @property
    def elements(self) -> FloatArray:
        """Mean relative elements, m, shape (6,)."""
        return self._estimate[_ELEMENTS]

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the elements, m2, shape (6, 6)."""
        return self._covariance[_ELEMENTS, _ELEMENTS]

    @property
    def engine_errors(self) -> FloatArray:
        """Matrix by which true thrust exceeds the reported one, of the deputy, shape (3, 3)."""
        return self._estimate[_OWN].reshape(3, 3)

    @property
    def engine_errors_chief(self) -> FloatArray:
        """Matrix by which true thrust exceeds the reported one, of the chief, shape (3, 3)."""
        return self._estimate[_CHIEF].reshape(3, 3)

    def update(
        self,
        time: float,
        state_chief_gcrf: npt.ArrayLike,
        relative_state: npt.ArrayLike,
        covariance: npt.ArrayLike | None = None,
    ) -> None:
        """Take a relative state; one that the thrust noted so far cannot explain begins anew.

        Parameters
        ----------
        time
            s, not before that of the last update.
        state_chief_gcrf
            m and m/s, shape (6,).
        relative_state
            Relative state of the deputy in RTN, m and m/s, shape (6,).
        covariance
            Covariance of the relative state, shape (6, 6).
        """
        measured = mean_relative_elements(state_chief_gcrf, relative_state)
        chief = mean_elements(elements_from_state(state_chief_gcrf))
        inverse = np.linalg.inv(
            linear_map_rtn(math.sqrt(GM_EARTH / float(chief[0]) ** 3), float(chief[1]))
        )
        noise = self._floor if covariance is None else self._floor + np.asarray(covariance)
        noise = inverse @ noise @ inverse.T
        is_first = math.isnan(self.time)
        if not is_first:
            self._predict(time - self.time)
            missing = measured - self.elements
            misfit = float(missing @ np.linalg.solve(self.covariance + noise, missing))
            is_first = misfit > _LARGEST_MISFIT
        if is_first:
            self._estimate = np.zeros(_SIZE)
            self._estimate[_ELEMENTS] = measured
            self._covariance = self._engine_sigma**2 * np.eye(_SIZE)
            self._covariance[_ELEMENTS, _ELEMENTS] = noise
        else:
            noise = noise * self._share_of_old(time - self.time)
            gain = np.linalg.solve(self.covariance + noise, self._covariance[_ELEMENTS]).T
            self._estimate = self._estimate + gain @ missing
            rest = np.eye(_SIZE)
            rest[:, _ELEMENTS] -= gain
            self._covariance = rest @ self._covariance @ rest.T + gain @ noise @ gain.T
        self.time, self.chief_mean = time, chief

    def _share_of_old(self, interval: float) -> float:
        """Return by what to enlarge the noise of states whose errors are correlated."""
        if not self._correlation_time:
            return 1.0
        kept = math.exp(-interval / self._correlation_time)
        return (1.0 + kept) / max(1.0 - kept, 1e-6)

    def _predict(self, duration: float) -> None:
        transition = np.eye(_SIZE)
        transition[_ELEMENTS, _ELEMENTS] = j2_transition_matrix(self.chief_mean, duration)
        self._estimate = transition @ self._estimate
        self._covariance = transition @ self._covariance @ transition.T
        effect = control_matrix(self.mean_motion, float(self.chief_mean[1]))
        self._covariance[_ELEMENTS, _ELEMENTS] += self._density**2 * duration * effect @ effect.T

    def add_thrust(
        self,
        acceleration_rtn: npt.ArrayLike,
        duration: float,
        elapsed: float = 0.0,
        acceleration_chief_rtn: npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Take thrust that acts before the next update, for a short time.

        Parameters
        ----------
        acceleration_rtn
            Thrust of the deputy as it is reported, m/s2, shape (3,).
        duration
            s.
        elapsed
            From the last update to the middle of the thrust, s.
        acceleration_chief_rtn
            Thrust of the chief in the same axes, m/s2, shape (3,).
        """
        own = duration * np.asarray(acceleration_rtn, dtype=float)
        chief = duration * np.asarray(acceleration_chief_rtn, dtype=float)
        if not (own.any() or chief.any()) or math.isnan(self.time):
            return
        latitude = float(self.chief_mean[1]) + self.mean_motion * elapsed
        effect = control_matrix(self.mean_motion, latitude)
        if elapsed:
            # The next prediction begins at the last update.
            effect = j2_transition_matrix(self.chief_mean, -elapsed) @ effect
        moved = np.eye(_SIZE)
        moved[_ELEMENTS, _OWN] = effect @ np.kron(np.eye(3), own)
        moved[_ELEMENTS, _CHIEF] = -effect @ np.kron(np.eye(3), chief)
        self._estimate = moved @ self._estimate
        self._estimate[_ELEMENTS] += effect @ (own - chief)
        self._covariance = moved @ self._covariance @ moved.T
        drawn = self._thrust_noise**2 * float(own @ own + chief @ chief)
        self._covariance[_ELEMENTS, _ELEMENTS] += drawn * effect @ effect.T
