"""Mean relative elements from relative states, smoothed by a Kalman filter.

One relative state gives the relative semi-major axis with some centimetres of error where the
velocity is good to 10 um/s; an orbit of them gives it to a millimetre.
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


class ElementsEstimator:
    """Filter of the mean relative elements of one deputy.

    Parameters
    ----------
    model_position_sigma, model_velocity_sigma
        What mean elements under J2 alone leave out of a relative state, m and m/s; added to every
        covariance, and all there is for a state without one.
    acceleration_density
        Root of the spectral density of unknown differential accelerations, m/s^1.5.
    thrust_share
        Sigma of the thrust as a share of it.
    """

    def __init__(
        self,
        model_position_sigma: float = 2e-3,
        model_velocity_sigma: float = 2e-6,
        acceleration_density: float = 1e-8,
        thrust_share: float = 0.05,
    ) -> None:
        self._floor = np.diag([model_position_sigma**2] * 3 + [model_velocity_sigma**2] * 3)
        self._density = acceleration_density
        self._thrust_share = thrust_share
        self.time = math.nan
        self.chief_mean: FloatArray = np.zeros(6)
        self.elements: FloatArray = np.zeros(6)
        self.covariance: FloatArray = np.zeros((6, 6))

    @property
    def mean_motion(self) -> float:
        """Mean motion of the chief, rad/s."""
        return math.sqrt(GM_EARTH / float(self.chief_mean[0]) ** 3)

    def restart(self) -> None:
        """Forget what was known; the next state is the first."""
        self.time = math.nan

    def update(
        self,
        time: float,
        state_chief_gcrf: npt.ArrayLike,
        relative_state: npt.ArrayLike,
        covariance: npt.ArrayLike | None = None,
    ) -> None:
        """Take a relative state.

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
        if math.isnan(self.time):
            self.elements, self.covariance = measured, noise
        else:
            self._predict(time - self.time)
            gain = np.linalg.solve(self.covariance + noise, self.covariance).T
            self.elements = self.elements + gain @ (measured - self.elements)
            rest = np.eye(6) - gain
            self.covariance = rest @ self.covariance @ rest.T + gain @ noise @ gain.T
        self.time, self.chief_mean = time, chief

    def _predict(self, duration: float) -> None:
        transition = j2_transition_matrix(self.chief_mean, duration)
        self.elements = transition @ self.elements
        self.covariance = transition @ self.covariance @ transition.T
        effect = control_matrix(self.mean_motion, float(self.chief_mean[1]))
        self.covariance += self._density**2 * duration * effect @ effect.T

    def add_thrust(
        self, acceleration_rtn: npt.ArrayLike, duration: float, elapsed: float = 0.0
    ) -> None:
        """Take thrust that acts before the next update, for a short time.

        Parameters
        ----------
        acceleration_rtn
            m/s2, shape (3,).
        duration
            s.
        elapsed
            From the last update to the middle of the thrust, s.
        """
        velocity = duration * np.asarray(acceleration_rtn, dtype=float)
        if not velocity.any() or math.isnan(self.time):
            return
        latitude = float(self.chief_mean[1]) + self.mean_motion * elapsed
        effect = control_matrix(self.mean_motion, latitude) @ velocity
        if elapsed:
            # The next prediction begins at the last update.
            effect = j2_transition_matrix(self.chief_mean, -elapsed) @ effect
        self.elements = self.elements + effect
        self.covariance = self.covariance + self._thrust_share**2 * np.outer(effect, effect)
