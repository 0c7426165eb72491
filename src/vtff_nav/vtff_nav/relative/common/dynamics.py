"""Motion of two antennas between epochs: orbital, kinematic or static, with covariance.

The state of each filter begins with nine numbers: position (3), velocity (3) and empirical
acceleration (3). The numbers of the relative filter are deputy less chief. Positions and velocities
are in the navigation axes: GCRF for orbital motion, ITRF for receivers on the ground. Empirical
accelerations are in the chief's RTN axes.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf, state_gcrf_to_itrf
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.propagator import INTEGRATORS, Propagator
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray, norm, skew
from vtff_nav.relative.kernels.motion import (
    advance_errors_of_pair,
    white_acceleration_noise,
)

__all__ = [
    "DYNAMIC_STATES",
    "DYNAMICS",
    "AccelerationNoise",
    "Dynamics",
    "MotionNoise",
    "OrbitalMotion",
    "Prediction",
    "THRUST_ERRORS",
    "ThrustInterval",
    "TerrestrialMotion",
]

Dynamics = Literal["orbital", "kinematic", "static"]
DYNAMICS: tuple[Dynamics, ...] = ("orbital", "kinematic", "static")

DYNAMIC_STATES = 9
"""Number of states of the motion: position, velocity, empirical acceleration."""

_IDENTITY = np.eye(DYNAMIC_STATES)

CHIEF_THRUST_SIGMA = 0.05
"""White error of the chief's thrust on each axis, relative to its magnitude (assumed)."""

THRUST_ERRORS = 4
"""Number of errors of a thrust: scale, and misalignment about three axes."""


@dataclass(frozen=True, eq=False)
class ThrustInterval:
    """Thrust acceleration of a spacecraft over an interval.

    Parameters
    ----------
    start : GpsTime
    duration : float
        s.
    acceleration_rtn : ndarray, shape (3,)
        m/s2, in the chief's RTN axes at `start`, held inertially.
    is_of_chief : bool
        Whether the chief thrusts, not the deputy.
    """

    start: GpsTime
    duration: float
    acceleration_rtn: FloatArray
    is_of_chief: bool = False

    @functools.cached_property
    def end(self) -> GpsTime:
        """End of the interval, not part of it."""
        return self.start + self.duration


@dataclass(frozen=True)
class MotionNoise:
    """Process noise of the motion of one antenna, or of the difference of two.

    Parameters
    ----------
    empirical_sigma : float
        Steady-state sigma of the Gauss-Markov empirical acceleration on each RTN axis, m/s2.
    empirical_time : float
        Correlation time of the empirical acceleration, s.
    gradient_sigma : float
        Sigma that the empirical acceleration has in addition for each metre between both antennas,
        1/s2: gradients of forces that the model leaves out. For a difference only.
    gradient_time : float
        Correlation time of these gradients, s. Harmonics of degree n stay alike over an angle of
        about 1.75 / n rad (where the Bessel function J0 is 1/e), those of the degrees 9 to 30 for
        some 100 s in low orbit.
    across_sigma : float or None
        `empirical_sigma` across the track (radial and normal), m/s2, where another holds there:
        what the drag of two spacecraft differs by acts along the track.
    kinematic_acceleration : float
        Root of the spectral density of white acceleration in kinematic motion, m/s2/sqrt(Hz).
    """

    empirical_sigma: float
    empirical_time: float = 900.0
    gradient_sigma: float = 0.0
    gradient_time: float = 100.0
    across_sigma: float | None = None
    kinematic_acceleration: float = 10.0

    def at_distance(self, distance: float, factor: float = 1.0) -> AccelerationNoise:
        """Return the empirical acceleration of the difference of two antennas.

        On each axis it is one process with the variance and the spectral density of the sum of
        what acts there at any distance and of the gradient.

        Parameters
        ----------
        distance : float
            Distance of the antennas, m; 0 for the motion of one antenna.
        factor : float
            Factor of all sigmas.
        """
        return AccelerationNoise(*map(np.array, self.numbers_at_distance(distance, factor)))

    def numbers_at_distance(
        self, distance: float, factor: float = 1.0
    ) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Return the fields of `at_distance` as numbers, on which numpy takes ten times as long."""
        gradient = self.gradient_sigma * distance
        along, time_along = self._process(self.empirical_sigma, gradient)
        if self.across_sigma is None or self.across_sigma == self.empirical_sigma:
            across, time_across = along, time_along
        else:
            across, time_across = self._process(self.across_sigma, gradient)
        along, across = factor * along, factor * across
        return (across, along, across), (time_across, time_along, time_across)

    def _process(self, steady: float, gradient: float) -> tuple[float, float]:
        """Return sigma and correlation time of the sum of two processes of given sigmas."""
        sigma = math.hypot(steady, gradient)
        rate = steady**2 / self.empirical_time + gradient**2 / self.gradient_time
        return sigma, sigma**2 / rate if rate > 0.0 else self.empirical_time


@dataclass(frozen=True, eq=False)
class AccelerationNoise:
    """Gauss-Markov empirical acceleration on the axes R, T and N.

    Parameters
    ----------
    sigma : ndarray, shape (3,)
        Steady-state sigma, m/s2.
    time : ndarray, shape (3,)
        Correlation time, s.
    """

    sigma: FloatArray
    time: FloatArray


@dataclass(frozen=True, eq=False)
class Prediction:
    """States of the chief and of the difference at a later time, and the growth of their errors.

    Parameters
    ----------
    chief, relative : ndarray, shape (9,)
        Position and velocity in the navigation axes, and empirical acceleration.
    transition_chief, transition_relative : ndarray, shape (9, 9)
        Derivatives by the states at the start.
    noise_chief, noise_relative : ndarray, shape (9, 9)
        Process noise.
    thrust_coupling : ndarray, shape (9, 4)
        Derivatives of the difference by the errors of the thrust: its scale, and its misalignment
        (rotation vector in the RTN axes of the thrust, rad). `relative` is without such errors.
    """

    chief: FloatArray
    relative: FloatArray
    transition_chief: FloatArray
    transition_relative: FloatArray
    noise_chief: FloatArray
    noise_relative: FloatArray
    thrust_coupling: FloatArray


class OrbitalMotion:
    """Nonlinear propagation of chief and deputy with one force model (navigation axes: GCRF).

    Parameters
    ----------
    force_model : ForceModel
        Forces on both spacecraft.
    noise_chief, noise_relative : MotionNoise
    force_model_deputy : ForceModel, optional
        Forces on the deputy where they differ (mass, cross-section); `force_model` by default.
    integrator : str
        See `vtff_dynamics.orbit.propagator.Propagator`; ``euler`` where the motion is simulated
        with explicit Euler steps.
    longest_step : float
        Longest step of integration, s. A Runge-Kutta step of 5 s is exact to 1e-7 m in low orbit,
        the transition matrix to 1e-6. With ``euler`` the step of the simulation, whose error is
        part of the motion.

    Raises
    ------
    ValueError
        If the integrator is unknown or the step not positive.
    """

    def __init__(
        self,
        force_model: ForceModel,
        noise_chief: MotionNoise,
        noise_relative: MotionNoise,
        force_model_deputy: ForceModel | None = None,
        integrator: str = "rk4",
        longest_step: float = 5.0,
    ) -> None:
        if integrator not in INTEGRATORS:
            raise ValueError(f"integrator {integrator!r}: one of {', '.join(INTEGRATORS)} expected")
        if not longest_step > 0.0:
            raise ValueError(f"longest_step {longest_step}: more than 0 s expected")
        self._integrator = integrator
        self._longest_step = longest_step
        self._model = force_model
        self._model_deputy = force_model_deputy or force_model
        self._noise_chief = noise_chief
        self._noise_relative = noise_relative

    def predict(
        self,
        time: GpsTime,
        duration: float,
        chief: FloatArray,
        relative: FloatArray,
        thrust: Sequence[ThrustInterval] = (),
        thrust_sigma: float = 0.0,
        noise_factors: tuple[float, float] = (1.0, 1.0),
    ) -> Prediction:
        """Propagate both states by `duration` seconds.

        Parameters
        ----------
        time : GpsTime
            Time of the states.
        duration : float
            s, not negative.
        chief, relative : ndarray, shape (9,)
            Position and velocity (GCRF) and empirical acceleration (RTN of the chief). The
            empirical acceleration of the deputy is the sum of both.
        thrust : sequence of ThrustInterval
            Thrust of deputy and chief; intervals outside the time propagated have no effect.
        thrust_sigma : float
            White error of the deputy's thrust on each axis, relative to its magnitude. That of the
            chief is `CHIEF_THRUST_SIGMA`.
        noise_factors : tuple of 2 float
            Factors of the sigmas of empirical accelerations, of the chief and of the difference.
        """
        chief, relative = np.array(chief, dtype=float), np.array(relative, dtype=float)
        phi_chief, phi_relative = _IDENTITY.copy(), _IDENTITY.copy()
        noise_chief = np.zeros((DYNAMIC_STATES, DYNAMIC_STATES))
        noise_relative = noise_chief.copy()
        coupling = np.zeros((DYNAMIC_STATES, THRUST_ERRORS))
        noise_of_chief = self._noise_chief.at_distance(0.0, noise_factors[0])
        noise_of_relative = self._noise_relative.at_distance(norm(relative[:3]), noise_factors[1])
        thrust_axes: dict[GpsTime, FloatArray] = {}
        for start, step in _steps(time, duration, thrust, self._longest_step):
            to_gcrf = rotation_gcrf_to_rtn(chief[:6]).T
            thrust_gcrf, by_error = np.zeros(3), np.zeros((3, THRUST_ERRORS))
            thrust_chief_gcrf = np.zeros(3)
            for interval in thrust:
                if interval.start <= start < interval.end:
                    # The axes of the first step of the interval are kept for all its steps.
                    axes = thrust_axes.setdefault(interval.start, to_gcrf)
                    if interval.is_of_chief:
                        thrust_chief_gcrf = thrust_chief_gcrf + axes @ interval.acceleration_rtn
                        continue
                    thrust_gcrf = thrust_gcrf + axes @ interval.acceleration_rtn
                    by_error[:, 0] = thrust_gcrf
                    by_error[:, 1:] -= axes @ skew(interval.acceleration_rtn)
            chief_error = CHIEF_THRUST_SIGMA * norm(thrust_chief_gcrf)
            phi = advance_errors_of_pair(
                chief,
                relative,
                to_gcrf,
                step,
                noise_of_chief.sigma,
                noise_of_chief.time,
                noise_of_relative.sigma,
                noise_of_relative.time,
                chief_error,
                math.hypot(thrust_sigma * norm(thrust_gcrf), chief_error),
                phi_chief,
                noise_chief,
                phi_relative,
                noise_relative,
            )
            if thrust:
                coupling = phi @ coupling
                coupling[:3] += 0.5 * step**2 * by_error
                coupling[3:6] += step * by_error
            self._advance(start, step, chief, relative, to_gcrf, thrust_gcrf, thrust_chief_gcrf)
            chief[6:9] *= np.exp(-step / noise_of_chief.time)
            relative[6:9] *= np.exp(-step / noise_of_relative.time)
        return Prediction(
            chief, relative, phi_chief, phi_relative, noise_chief, noise_relative, coupling
        )

    def _advance(
        self,
        time: GpsTime,
        step: float,
        chief: FloatArray,
        relative: FloatArray,
        to_gcrf: FloatArray,
        thrust_gcrf: FloatArray,
        thrust_chief_gcrf: FloatArray,
    ) -> None:
        """Advance positions and velocities of both in place by one step."""
        empirical_chief = to_gcrf @ chief[6:9]
        empirical_deputy = empirical_chief + to_gcrf @ relative[6:9]
        deputy = chief[:6] + relative[:6]
        chief[:6] = self._propagate(
            time, chief[:6], self._model, step, empirical_chief + thrust_chief_gcrf
        )
        deputy = self._propagate(
            time, deputy, self._model_deputy, step, empirical_deputy + thrust_gcrf
        )
        relative[:6] = deputy - chief[:6]

    def _propagate(
        self,
        time: GpsTime,
        state: FloatArray,
        model: ForceModel,
        step: float,
        acceleration_gcrf: FloatArray,
    ) -> FloatArray:
        """Return a state one step later, under the forces and a constant acceleration."""
        return Propagator(time, state, model, self._integrator, step).advance(acceleration_gcrf)

    @staticmethod
    def to_itrf(time: GpsTime) -> FloatArray:
        """Return the rotation matrix from the navigation axes to ITRF."""
        return rotation_gcrf_to_itrf(time)

    @staticmethod
    def state_itrf(time: GpsTime, state: FloatArray) -> FloatArray:
        """Return position and Earth-fixed velocity of a state (6,) in the navigation axes."""
        return state_gcrf_to_itrf(time, state)


class TerrestrialMotion:
    """Motion of antennas on the ground (navigation axes: ITRF): static or free.

    Parameters
    ----------
    chief, relative : str
        ``static`` or ``kinematic``: motion of the chief and of the difference.
    noise_chief, noise_relative : MotionNoise
        Only `MotionNoise.kinematic_acceleration` is used.
    """

    def __init__(
        self,
        chief: Dynamics,
        relative: Dynamics,
        noise_chief: MotionNoise,
        noise_relative: MotionNoise,
    ) -> None:
        self._models = (
            (chief == "kinematic", noise_chief),
            (relative == "kinematic", noise_relative),
        )

    def predict(
        self,
        time: GpsTime,
        duration: float,
        chief: FloatArray,
        relative: FloatArray,
        thrust: Sequence[ThrustInterval] = (),
        thrust_sigma: float = 0.0,
        noise_factors: tuple[float, float] = (1.0, 1.0),
    ) -> Prediction:
        """Propagate by `duration` seconds; see `OrbitalMotion.predict`, without its forces."""
        states, transitions, noises = [], [], []
        for state, (is_moving, noise) in zip((chief, relative), self._models, strict=True):
            phi = np.eye(DYNAMIC_STATES)
            process = np.zeros((DYNAMIC_STATES, DYNAMIC_STATES))
            if is_moving:
                phi[:3, 3:6] = duration * np.eye(3)
                process = white_acceleration_noise(noise.kinematic_acceleration, duration)
            states.append(phi @ state)
            transitions.append(phi)
            noises.append(process)
        return Prediction(
            chief=states[0],
            relative=states[1],
            transition_chief=transitions[0],
            transition_relative=transitions[1],
            noise_chief=noises[0],
            noise_relative=noises[1],
            thrust_coupling=np.zeros((DYNAMIC_STATES, THRUST_ERRORS)),
        )

    @staticmethod
    def to_itrf(_time: GpsTime) -> FloatArray:
        """Return the rotation matrix from the navigation axes to ITRF."""
        return np.eye(3)

    @staticmethod
    def state_itrf(_time: GpsTime, state: FloatArray) -> FloatArray:
        """Return position and Earth-fixed velocity of a state (6,) in the navigation axes."""
        return state


def _steps(
    time: GpsTime, duration: float, thrust: Sequence[ThrustInterval], longest_step: float
) -> list[tuple[GpsTime, float]]:
    """Return start and length of the steps of integration; a step ends where the thrust changes."""
    start, end = time.nanoseconds, (time + duration).nanoseconds
    changes = {start, end}
    for interval in thrust:
        limits = (interval.start.nanoseconds, interval.end.nanoseconds)
        changes.update(limit for limit in limits if start < limit < end)
    steps = []
    for first, last in itertools.pairwise(sorted(changes)):
        count = math.ceil((last - first) / NANOSECONDS_PER_SECOND / longest_step - 1e-9)
        nanoseconds = (last - first) // count
        for index in range(count):
            begin = first + index * nanoseconds
            finish = last if index == count - 1 else begin + nanoseconds
            begin_time = time if begin == start else GpsTime(begin)
            steps.append((begin_time, (finish - begin) / NANOSECONDS_PER_SECOND))
    return steps
