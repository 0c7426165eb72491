"""Observer of a deputy's deviation from its target and of the acceleration that disturbs it.

A Kalman filter with the state (deviation of position, of velocity, disturbance), which knows the
commands that act and takes the navigated state as a measurement with its own covariance. White
errors of navigation average out, and a constant force that no model has (drag, a bias of the
thruster) becomes known and is compensated: integral action that cannot wind up, because the
observer counts what was commanded within the cap, and a prediction with a large sigma teaches it
nothing (Franklin, Powell and Workman 1998, Digital Control of Dynamic Systems, section 8.5.2).
"""

from __future__ import annotations

import numpy as np

from vtff_control.tracking.riccati import discretise
from vtff_dynamics.relative.motion import hcw_state_matrix
from vtff_dynamics.vectors import FloatArray, norm

__all__ = ["DeviationObserver"]

POSITION_FLOOR = 2e-5
VELOCITY_FLOOR = 2e-5
"""Sigma that is added to every state, m and m/s. Velocities are reported in a frame that turns
about N alone; the turn about R is known to a per cent, which 15 km away is some 1e-4 m/s. So
velocities count less than what positions say in a few seconds."""

THRUST_SIGMA = 0.05
"""Error of a thrust in proportion to it, each axis: before a calibration in flight."""

MODEL_SIGMA = 0.3
"""Error of the acceleration by the deviation from the target, in n^2 times that deviation: the
HCW equations at an eccentricity of some per cent."""

ACCELERATION_SIGMA = 1e-7
"""Error of the model on the target in every sample, m/s2: gravity above J2, drag."""

DISTURBANCE_SIGMA = 1e-5
"""Sigma of the disturbance at the start, m/s2."""

DISTURBANCE_WALK = 3e-9
"""Change of the disturbance, m/s2 per square root of a second: 1e-7 m/s2 in 1000 s."""


_FLOOR = np.diag([POSITION_FLOOR**2] * 3 + [VELOCITY_FLOOR**2] * 3)


class DeviationObserver:
    """Estimates deviation and disturbance of one deputy; see the module.

    Parameters
    ----------
    sample_time
        Interval between states, s.
    """

    def __init__(self, sample_time: float) -> None:
        self._sample_time = sample_time
        self._mean_motion = 0.0
        self._transition: FloatArray = np.eye(9)
        self._input: FloatArray = np.zeros((9, 3))
        self._square_of_input = self._input @ self._input.T
        self._walk = DISTURBANCE_WALK**2 * sample_time * np.eye(3)
        self._state: FloatArray = np.zeros(9)
        self._covariance: FloatArray = np.zeros((9, 9))
        self._covariance[6:, 6:] = DISTURBANCE_SIGMA**2 * np.eye(3)
        self._is_started = False

    @property
    def disturbance_rtn(self) -> FloatArray:
        """Estimated disturbing acceleration, m/s2, shape (3,)."""
        return np.array(self._state[6:])

    def restart(self) -> None:
        """Forget the deviation, not the disturbance: commands were lost or time has jumped."""
        self._is_started = False

    def update(self, deviation_rtn: FloatArray, covariance_rtn: FloatArray | None) -> FloatArray:
        """Take a navigated deviation and return the estimated one, m and m/s, shape (6,).

        Parameters
        ----------
        deviation_rtn
            Navigated relative state less the target, shape (6,); the velocity is the derivative of
            the position.
        covariance_rtn
            Covariance of the navigated state, shape (6, 6); None for the truth.
        """
        noise = _FLOOR if covariance_rtn is None else _FLOOR + covariance_rtn
        if not self._is_started:
            self._is_started = True
            self._state[:6] = deviation_rtn
            self._covariance[:6] = 0.0
            self._covariance[:, :6] = 0.0
            self._covariance[:6, :6] = noise
            return np.array(deviation_rtn)
        innovation_covariance = self._covariance[:6, :6] + noise
        gain = np.linalg.solve(innovation_covariance, self._covariance[:6]).T
        self._state = self._state + gain @ (deviation_rtn - self._state[:6])
        covariance = self._covariance - gain @ self._covariance[:6]
        self._covariance = 0.5 * (covariance + covariance.T)
        return np.array(self._state[:6])

    def predict(self, acceleration_rtn: FloatArray, mean_motion: float) -> None:
        """Carry the estimate over the coming sample.

        Parameters
        ----------
        acceleration_rtn
            Commanded acceleration that acts in it, less what holds the target, m/s2, shape (3,).
        mean_motion
            Mean motion of the chief, rad/s.
        """
        self._set_mean_motion(mean_motion)
        model = MODEL_SIGMA * mean_motion * mean_motion * norm(self._state[:3])
        thrust = THRUST_SIGMA * norm(acceleration_rtn)
        variance = thrust * thrust + model * model + ACCELERATION_SIGMA**2
        self._state = self._transition @ self._state + self._input @ acceleration_rtn
        self._covariance = self._transition @ self._covariance @ self._transition.T + variance * (
            self._square_of_input
        )
        self._covariance[6:, 6:] += self._walk

    def _set_mean_motion(self, mean_motion: float) -> None:
        """Sample the HCW equations anew if the mean motion has changed by more than a per mille."""
        if abs(mean_motion - self._mean_motion) <= 1e-3 * self._mean_motion:
            return
        self._mean_motion = mean_motion
        transition, effect = discretise(hcw_state_matrix(mean_motion), self._sample_time)
        self._transition[:6, :6] = transition
        self._transition[:6, 6:] = effect
        self._input[:6] = effect
        self._square_of_input = self._input @ self._input.T
