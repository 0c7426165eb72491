"""Relative navigation that is drawn instead of flown: errors with the covariance that they have.

For studies of the control loop without receivers: outside outages the estimate is the truth plus a
Gauss-Markov error, in an outage a prediction from the last estimate with the thrust that the
thruster reports. The covariance is that of the process that makes the error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vtff_control.tracking.riccati import discretise
from vtff_dynamics.frames.rtn import deputy_state_gcrf, relative_state_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.elements import osculating_mean_motion
from vtff_dynamics.orbit.propagator import ForceModel, Propagator
from vtff_dynamics.relative.motion import hcw_state_matrix
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray

__all__ = ["DrawnNavigation", "NavigationErrorModel"]


@dataclass(frozen=True)
class NavigationErrorModel:
    """Errors of relative navigation.

    Parameters
    ----------
    position_sigma, velocity_sigma
        Sigmas of the errors of each axis, m and m/s.
    correlation_time
        Correlation time of the first-order Gauss-Markov errors, s; 0 is white noise.
    outages
        Start and end in s since the epoch of times without measurements.
    thrust_sigma
        Error of the thrust in an outage that the covariance counts with: sigma of each element of
        a constant matrix between reported and true thrust, less the unit matrix.
    seed
        Seed of the errors.

    Raises
    ------
    ValueError
        If a value is negative or not finite; the message names the parameter.
    """

    position_sigma: float = 0.001
    velocity_sigma: float = 1e-5
    correlation_time: float = 0.0
    outages: tuple[tuple[float, float], ...] = ()
    thrust_sigma: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the parameters."""
        for name in ("position_sigma", "velocity_sigma", "correlation_time", "thrust_sigma"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name}: 0 or more expected, got {getattr(self, name)}")

    def has_outage(self, time: float) -> bool:
        """Return whether there are no measurements at a time in s since the epoch."""
        return any(start <= time < end for start, end in self.outages)


class DrawnNavigation:
    """Estimates of one deputy's relative state; call `estimate` and `add_thrust` in every step.

    Parameters
    ----------
    model
        Errors.
    force_model
        Forces with which an outage is predicted.
    step
        Interval between estimates, s.
    """

    def __init__(self, model: NavigationErrorModel, force_model: ForceModel, step: float) -> None:
        self._model = model
        self._force_model = force_model
        self._step = step
        self._generator = np.random.default_rng(model.seed)
        self._sigma = np.array([model.position_sigma] * 3 + [model.velocity_sigma] * 3)
        self._error = self._sigma * self._generator.standard_normal(6)
        self._predicted: Propagator | None = None
        self._state_chief: FloatArray = np.zeros(6)
        self._relative_state: FloatArray = np.zeros(6)
        self._covariance: FloatArray = np.diag(self._sigma**2)
        self._thrust_effect: FloatArray = np.zeros((6, 9))

    def estimate(
        self, time: GpsTime, elapsed: float, state_chief_gcrf: FloatArray, relative_rtn: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the estimated relative state (m, m/s; shape (6,)) and its covariance (6, 6).

        Parameters
        ----------
        time
            Time of the states.
        elapsed
            Time since the epoch, s.
        state_chief_gcrf
            True state of the chief, m and m/s, shape (6,).
        relative_rtn
            True relative state, m and m/s, shape (6,).
        """
        decay = 0.0
        if self._model.correlation_time > 0.0:
            decay = math.exp(-self._step / self._model.correlation_time)
        draw = self._sigma * self._generator.standard_normal(6)
        self._error = decay * self._error + math.sqrt(1.0 - decay * decay) * draw
        self._state_chief = state_chief_gcrf
        if self._model.has_outage(elapsed):
            if self._predicted is not None:
                relative = relative_state_rtn(state_chief_gcrf, self._predicted.state_gcrf)
                thrust = self._model.thrust_sigma**2 * self._thrust_effect @ self._thrust_effect.T
                return relative, self._covariance + thrust
            self._start_prediction(time, state_chief_gcrf, relative_rtn + self._error)
        else:
            self._predicted = None
            self._covariance = np.diag(self._sigma**2)
            self._thrust_effect = np.zeros((6, 9))
        return relative_rtn + self._error, self._covariance

    def add_thrust(self, acceleration_rtn: FloatArray) -> None:
        """Take the thrust that the thruster reports for the coming step, m/s2, shape (3,)."""
        if self._predicted is None:
            return
        self._predicted.advance(rotation_gcrf_to_rtn(self._state_chief).T @ acceleration_rtn)
        matrix = hcw_state_matrix(osculating_mean_motion(self._state_chief))
        transition, effect = discretise(matrix, self._step)
        self._covariance = transition @ self._covariance @ transition.T
        self._thrust_effect = transition @ self._thrust_effect + effect @ np.kron(
            np.eye(3), acceleration_rtn
        )

    def _start_prediction(
        self, time: GpsTime, state_chief: FloatArray, relative: FloatArray
    ) -> None:
        state = deputy_state_gcrf(state_chief, relative)
        self._predicted = Propagator(time, state, self._force_model, step=self._step)
