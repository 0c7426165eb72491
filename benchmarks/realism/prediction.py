"""What theory says of the errors of a filter in the world that it flies in, beside what it states.

A filter that must hold in many worlds counts errors that one of them may lack: of thrust, drag or
slow phases. Its gains are then not the best ones of that world, and its covariance is not that of
its errors. A second covariance, carried through the same gains with the noise and the disturbances
of the world, is that of its errors (Gelb 1974, Applied Optimal Estimation, section 7.2: sensitivity
of a suboptimal filter; Maybeck 1979, Stochastic Models, Estimation, and Control 1, section 6.8).
The errors of the solution itself have no part in it. The mean NEES that follows is what a filter
without mistakes shows there.

The disturbances of the motion are those of the flight: what the truth does within a second beyond
the prediction of the filter, with the thrust that the thruster reports. So thrust errors, drag and
gravity are counted as they were, not as a sigma. Lever arms, broadcast errors and the plasma have
the sigmas of the world, or of the filter where the world draws from these.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.estimator import CdgpsEstimator
from vtff_nav.relative.cdgps.output import relative_rtn
from vtff_nav.relative.cdgps.state import GaussianState, Innovation, Label
from vtff_nav.relative.common.dynamics import DYNAMIC_STATES, OrbitalMotion, ThrustInterval
from vtff_nav.relative.common.solution import RelativeSolution

from .recording import Second
from .worlds import WhiteNoise

__all__ = ["ErrorPrediction"]

# Members that are in the world as the filter takes them. Others have no error at their start but
# what measurements make: thrust, accelerations, slow phases and gradients, which the world lacks or
# which act through the motion.
_AS_STATED = ("motion", "ambiguity", "code_bias", "phase_bias", "antenna_offset", "plasma")


class ErrorPrediction:
    """Predicts the errors of a filter from its gains, epoch by epoch.

    Parameters
    ----------
    estimator : CdgpsEstimator
        The filter, whose state is replaced by one with both covariances.
    noise : WhiteNoise
    """

    def __init__(self, estimator: CdgpsEstimator, noise: WhiteNoise) -> None:
        self._estimator, self._noise = estimator, noise
        configuration: CdgpsConfiguration = estimator.configuration
        self._motion = OrbitalMotion(
            configuration.force_model, configuration.noise_chief, configuration.noise_relative
        )
        self._last: Second | None = None

    def expect(self, second: Second) -> None:
        """Take in what disturbs the motion until a second; before the filter gets its epoch."""
        last, self._last = self._last, second
        state = self._state()
        if last is not None and isinstance(state, _ErrorState):
            state.disturbance = self._disturbance(last, second)

    def nees(self, second: Second, solution: RelativeSolution) -> tuple[float, float]:
        """Return the mean NEES of position and of velocity at an epoch; NaN before the first.

        The error of the chief's orbit, which turns the axes, is that of the solution.
        """
        relative, state = self._estimator._relative, self._state()
        if relative is None or state is None:
            return float("nan"), float("nan")
        if not isinstance(state, _ErrorState):
            state = relative.state = _ErrorState(state, self._noise)
        chief = np.concatenate((solution.position_chief_gcrf, solution.velocity_chief_gcrf))
        error_chief, mean = chief - second.state_chief_gcrf, state.mean_error[:6]
        _, expected = relative_rtn(
            second.state_chief_gcrf,
            second.state_deputy_gcrf - second.state_chief_gcrf,
            np.outer(error_chief, error_chief),
            state.error_covariance[:6, :6] + np.outer(mean, mean),
            np.outer(mean, error_chief),
        )
        stated = solution.covariance_rtn
        position, velocity = (
            float(np.trace(np.linalg.solve(stated[axes, axes], expected[axes, axes]))) / 3.0
            for axes in (slice(0, 3), slice(3, 6))
        )
        return position, velocity

    def _state(self) -> GaussianState | None:
        """Return the state of the difference, where it stands alone."""
        relative = self._estimator._relative
        if relative is None or self._estimator._are_joint:
            return None
        return relative.state

    def _disturbance(self, last: Second, second: Second) -> FloatArray:
        """Return what the truth did beyond the prediction, position and velocity, GCRF, (6,)."""
        empty = np.zeros(DYNAMIC_STATES - 6)
        relative = last.state_deputy_gcrf - last.state_chief_gcrf
        thrust = [ThrustInterval(last.time, 1.0, last.thrust_rtn)] if last.thrust_rtn.any() else []
        predicted = self._motion.predict(
            last.time,
            second.time - last.time,
            np.concatenate((last.state_chief_gcrf, empty)),
            np.concatenate((relative, empty)),
            thrust,
        )
        truth = second.state_deputy_gcrf - second.state_chief_gcrf
        return np.asarray(truth - predicted.relative[:6])


class _ErrorState(GaussianState):
    """A state that carries mean and covariance of its errors in the world besides its own.

    Parameters
    ----------
    state : GaussianState
        The state after its first epoch, whose errors are as it states, but for members that the
        world lacks.
    noise : WhiteNoise

    Attributes
    ----------
    error_covariance : ndarray, shape (n, n)
        Covariance of the errors, estimate less truth, by measurements and by members of the world.
    mean_error : ndarray, shape (n,)
        What the disturbances of the motion make of the errors.
    disturbance : ndarray, shape (6,)
        That of the coming prediction.
    """

    def __init__(self, state: GaussianState, noise: WhiteNoise) -> None:
        super().__init__(state.labels, state.mean, state.covariance)
        self._noise, self._is_weighed_anew = noise, False
        self.disturbance: FloatArray = np.zeros(6)
        self.mean_error: FloatArray = np.zeros(len(state))
        is_kept = np.array([self._variance(label, 1.0) > 0.0 for label in self.labels])
        self.error_covariance: FloatArray = state.covariance * np.outer(is_kept, is_kept)

    def _variance(self, label: Label, stated: float) -> float:
        """Return the variance that a member has in the world, without measurements."""
        if label[0] == "satellite_offset":
            return self._noise.broadcast_sigma**2
        is_acceleration = label[0] == "motion" and label[1] >= 6
        return stated if label[0] in _AS_STATED and not is_acceleration else 0.0

    def add(self, label: Label, mean: float, variance: float) -> None:
        """Add a member that is independent of the others."""
        super().add(label, mean, variance)
        size = len(self.mean_error)
        grown = np.zeros((size + 1, size + 1))
        grown[:size, :size] = self.error_covariance
        grown[size, size] = self._variance(label, variance)
        self.error_covariance = grown
        self.mean_error = np.append(self.mean_error, 0.0)

    def remove(self, labels: Iterable[Label]) -> None:
        """Remove members."""
        removed = set(labels)
        kept = [index for index, label in enumerate(self.labels) if label not in removed]
        super().remove(removed)
        self.mean_error = self.mean_error[kept]
        self.error_covariance = self.error_covariance[np.ix_(kept, kept)]

    def transform(self, columns: Sequence[int], coefficients: FloatArray) -> None:
        """Replace some members by linear functions of all of them."""
        super().transform(columns, coefficients)
        whole = np.eye(len(self))
        whole[np.asarray(columns)] = coefficients
        self.mean_error = whole @ self.mean_error
        self.error_covariance = whole @ self.error_covariance @ whole.T

    def predict_gauss_markov(
        self, decay: FloatArray, steady_variance: FloatArray, growth: FloatArray
    ) -> None:
        """Propagate all members; the motion has been propagated, and was disturbed."""
        super().predict_gauss_markov(decay, steady_variance, growth)
        self.mean_error *= decay
        self.mean_error[:6] -= self.disturbance
        self.disturbance = np.zeros(6)
        in_world = [
            self._variance(label, steady)
            for label, steady in zip(self.labels, steady_variance.tolist(), strict=True)
        ]
        self.error_covariance *= decay[:, None] * decay
        self.error_covariance.flat[:: len(self) + 1] += (1.0 - decay**2) * np.array(in_world)

    def reweigh(self, labels: Sequence[Label], last: float, variance: float) -> None:
        """Give members another variance: that of members that the world lacks is known then."""
        self._is_weighed_anew = True
        super().reweigh(labels, last, variance)
        self._is_weighed_anew = False

    def update(self, innovation: Innovation) -> FloatArray:
        """Update with measurements, which have the noise of the world."""
        gain = innovation.cross_covariance @ innovation.weight
        change = super().update(innovation)
        noise = np.zeros(len(innovation.values))
        if not self._is_weighed_anew:
            count = len(noise) // 2
            noise[:count] = 2.0 * self._noise.code_sigma**2
            noise[count : 2 * count] = 2.0 * self._noise.phase_sigma**2
        self._correct(gain, innovation.design, noise)
        return change

    def constrain(self, design: FloatArray, values: FloatArray, covariance: FloatArray) -> None:
        """Fix linear functions of members to what they are in truth: integers that are right."""
        gain = np.linalg.solve(covariance, design @ self.covariance).T
        super().constrain(design, values, covariance)
        self._correct(gain, design, np.zeros(len(values)))

    def _correct(
        self, gain: FloatArray, design: FloatArray, noise: npt.NDArray[np.float64]
    ) -> None:
        remainder = np.eye(len(self)) - gain @ design
        self.mean_error = remainder @ self.mean_error
        corrected = remainder @ self.error_covariance @ remainder.T + (gain * noise) @ gain.T
        self.error_covariance = 0.5 * (corrected + corrected.T)
