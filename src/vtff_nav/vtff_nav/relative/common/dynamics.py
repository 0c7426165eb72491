"""Motion of two antennas between epochs: orbital, kinematic or static, with covariance.

The state of each filter begins with nine numbers: position (3), velocity (3) and empirical
acceleration (3). Those of the relative filter are deputy less chief. Positions and velocities are
in the navigation axes: GCRF for orbital motion, ITRF for receivers on the ground.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.frames.frames import (
    rotation_gcrf_to_itrf,
    rotation_gcrf_to_rtn,
    state_gcrf_to_itrf,
)
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.propagator import INTEGRATORS, Propagator
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "DYNAMIC_STATES",
    "DYNAMICS",
    "Dynamics",
    "MotionNoise",
    "OrbitalMotion",
    "Prediction",
    "ThrustInterval",
    "TerrestrialMotion",
]

Dynamics = Literal["orbital", "kinematic", "static"]
DYNAMICS: tuple[Dynamics, ...] = ("orbital", "kinematic", "static")

DYNAMIC_STATES = 9
"""Position, velocity, empirical acceleration."""


@dataclass(frozen=True, eq=False)
class ThrustInterval:
    """Thrust acceleration of the deputy over an interval.

    Parameters
    ----------
    start : GpsTime
    duration : float
        s.
    acceleration_rtn : ndarray, shape (3,)
        m/s2, in the chief's RTN axes at `start`, held inertially.
    """

    start: GpsTime
    duration: float
    acceleration_rtn: FloatArray

    @property
    def end(self) -> GpsTime:
        """End of the interval."""
        return self.start + self.duration


@dataclass(frozen=True)
class MotionNoise:
    """Process noise of the motion of one antenna, or of the difference of two.

    Parameters
    ----------
    empirical_sigma : float
        Steady-state sigma of the Gauss-Markov empirical acceleration on each RTN axis, m/s2.
    empirical_time : float
        Its correlation time, s.
    kinematic_acceleration : float
        Root of the spectral density of white acceleration in kinematic motion, m/s2/sqrt(Hz).
    """

    empirical_sigma: float
    empirical_time: float = 900.0
    kinematic_acceleration: float = 10.0


@dataclass(frozen=True, eq=False)
class Prediction:
    """States of chief and difference at a later time, and how their errors develop.

    Parameters
    ----------
    chief, relative : ndarray, shape (6,)
        Position and velocity in the navigation axes.
    transition_chief, transition_relative : ndarray, shape (9, 9)
    noise_chief, noise_relative : ndarray, shape (9, 9)
    """

    chief: FloatArray
    relative: FloatArray
    transition_chief: FloatArray
    transition_relative: FloatArray
    noise_chief: FloatArray
    noise_relative: FloatArray


class OrbitalMotion:
    """Nonlinear propagation of chief and deputy with one force model (navigation axes: GCRF).

    Parameters
    ----------
    force_model : ForceModel
        Forces on both spacecraft.
    noise_chief, noise_relative : MotionNoise
    thrust_relative_sigma : float
        Error of the known thrust, relative to its magnitude, on each axis.
    force_model_deputy : ForceModel, optional
        Where the deputy differs (mass, cross-section); that of the chief by default.
    integrator : str
        See `vtff_dynamics.orbit.propagator.Propagator`; ``euler`` for motion that is simulated so.
    longest_step : float
        Longest step of integration, s. A Runge-Kutta step of 5 s is exact to 1e-7 m in low orbit,
        the transition matrix to 1e-6. For ``euler`` that of the simulation: its error is part of
        the motion.

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
        thrust_relative_sigma: float,
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
        self._thrust_relative_sigma = thrust_relative_sigma

    def predict(
        self,
        time: GpsTime,
        duration: float,
        chief: FloatArray,
        relative: FloatArray,
        thrust: Sequence[ThrustInterval] = (),
    ) -> Prediction:
        """Go on by `duration` seconds.

        Parameters
        ----------
        time : GpsTime
            Of the states given.
        duration : float
            s, not negative.
        chief, relative : ndarray, shape (9,)
            Position, velocity (GCRF) and empirical acceleration (RTN of the chief); that of the
            deputy is the sum of both.
        thrust : sequence of ThrustInterval
        """
        chief, relative = np.array(chief, dtype=float), np.array(relative, dtype=float)
        phi_chief = phi_relative = np.eye(DYNAMIC_STATES)
        noise_chief = np.zeros((DYNAMIC_STATES, DYNAMIC_STATES))
        noise_relative = noise_chief.copy()
        axes: dict[GpsTime, FloatArray] = {}
        for start, step in _steps(time, duration, thrust, self._longest_step):
            to_gcrf = rotation_gcrf_to_rtn(chief[:6]).T
            acceleration = np.zeros(3)
            for interval in thrust:
                if interval.start <= start < interval.end:
                    # The axes are those at the start of the interval, not of the step.
                    fixed = axes.setdefault(interval.start, to_gcrf)
                    acceleration = acceleration + fixed @ interval.acceleration_rtn
            phi = transition_matrix(chief[:3], to_gcrf, step, self._noise_chief.empirical_time)
            noise = empirical_noise(self._noise_chief, to_gcrf, step)
            phi_chief, noise_chief = phi @ phi_chief, phi @ noise_chief @ phi.T + noise
            middle = chief[:3] + 0.5 * relative[:3]
            phi = transition_matrix(middle, to_gcrf, step, self._noise_relative.empirical_time)
            noise = empirical_noise(self._noise_relative, to_gcrf, step)
            error = self._thrust_relative_sigma * float(np.linalg.norm(acceleration))
            if error > 0.0:
                noise = noise + _white_acceleration(error, step)
            phi_relative = phi @ phi_relative
            noise_relative = phi @ noise_relative @ phi.T + noise
            self._step(start, step, chief, relative, to_gcrf, acceleration)
        return Prediction(chief, relative, phi_chief, phi_relative, noise_chief, noise_relative)

    def _step(
        self,
        time: GpsTime,
        step: float,
        chief: FloatArray,
        relative: FloatArray,
        to_gcrf: FloatArray,
        thrust: FloatArray,
    ) -> None:
        """Advance both states in place by one step."""
        empirical_chief = to_gcrf @ chief[6:9]
        empirical_deputy = empirical_chief + to_gcrf @ relative[6:9]
        deputy = chief[:6] + relative[:6]
        chief[:6] = self._advanced(time, chief[:6], self._model, step, empirical_chief)
        relative[:6] = (
            self._advanced(time, deputy, self._model_deputy, step, empirical_deputy + thrust)
            - chief[:6]
        )
        chief[6:9] *= math.exp(-step / self._noise_chief.empirical_time)
        relative[6:9] *= math.exp(-step / self._noise_relative.empirical_time)

    def _advanced(
        self,
        time: GpsTime,
        state: FloatArray,
        model: ForceModel,
        step: float,
        acceleration: FloatArray,
    ) -> FloatArray:
        """Return a state one step later."""
        return Propagator(time, state, model, self._integrator, step).advance(acceleration)

    @staticmethod
    def to_itrf(time: GpsTime) -> FloatArray:
        """Return the rotation matrix from the navigation axes to ITRF."""
        return rotation_gcrf_to_itrf(time)

    @staticmethod
    def state_itrf(time: GpsTime, state: FloatArray) -> FloatArray:
        """Return position and Earth-fixed velocity of a state (6,) in the navigation axes."""
        return state_gcrf_to_itrf(time, state)


class TerrestrialMotion:
    """Antennas on the ground (navigation axes: ITRF): static, or moving freely.

    Parameters
    ----------
    chief, relative : str
        ``static`` or ``kinematic``.
    noise_chief, noise_relative : MotionNoise
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
    ) -> Prediction:
        """Go on by `duration` seconds; see `OrbitalMotion.predict`. Thrust means nothing here."""
        states, transitions, noises = [], [], []
        for state, (is_moving, noise) in zip((chief, relative), self._models, strict=True):
            phi = np.eye(DYNAMIC_STATES)
            process = np.zeros((DYNAMIC_STATES, DYNAMIC_STATES))
            if is_moving:
                phi[:3, 3:6] = duration * np.eye(3)
                process = _white_acceleration(noise.kinematic_acceleration, duration)
            states.append(phi @ state)
            transitions.append(phi)
            noises.append(process)
        return Prediction(*states, *transitions, *noises)

    @staticmethod
    def to_itrf(_time: GpsTime) -> FloatArray:
        """Return the rotation matrix from the navigation axes to ITRF."""
        return np.eye(3)

    @staticmethod
    def state_itrf(_time: GpsTime, state: FloatArray) -> FloatArray:
        """Return position and Earth-fixed velocity of a state (6,) in the navigation axes."""
        return state


def transition_matrix(
    position_gcrf: npt.ArrayLike, to_gcrf: FloatArray, step: float, empirical_time: float
) -> FloatArray:
    """Return the transition matrix (9, 9) of a short step in the field of a point mass.

    Parameters
    ----------
    position_gcrf : array_like, shape (3,)
        Where the gravity gradient is taken, m.
    to_gcrf : ndarray, shape (3, 3)
        From the axes of the empirical acceleration (RTN) to GCRF.
    step : float
        s.
    empirical_time : float
        Correlation time of the empirical acceleration, s.

    Notes
    -----
    Third order in the step. J2 changes the gradient by 0.3 %, which matters to a covariance as
    little as it does; the states themselves are propagated with all forces.
    """
    r = np.asarray(position_gcrf, dtype=float)
    squared = float(r @ r)
    gradient = GM_EARTH / squared**1.5 * (3.0 * np.outer(r, r) / squared - np.eye(3))
    phi = np.eye(DYNAMIC_STATES)
    identity = np.eye(3)
    phi[:3, :3] += 0.5 * step**2 * gradient
    phi[:3, 3:6] = step * (identity + step**2 / 6.0 * gradient)
    phi[3:6, :3] = step * gradient
    phi[3:6, 3:6] += 0.5 * step**2 * gradient
    phi[:3, 6:9] = 0.5 * step**2 * to_gcrf
    phi[3:6, 6:9] = step * to_gcrf
    phi[6:9, 6:9] *= math.exp(-step / empirical_time)
    return phi


def empirical_noise(noise: MotionNoise, to_gcrf: FloatArray, step: float) -> FloatArray:
    """Return the process noise (9, 9) of a Gauss-Markov empirical acceleration over a step."""
    spectral_density = 2.0 * noise.empirical_sigma**2 / noise.empirical_time
    process = np.zeros((DYNAMIC_STATES, DYNAMIC_STATES))
    identity = np.eye(3)
    # White noise integrated once, twice and three times; blocks are isotropic, so that only the
    # mixed ones with the acceleration depend on its axes.
    process[:3, :3] = spectral_density * step**5 / 20.0 * identity
    process[:3, 3:6] = process[3:6, :3] = spectral_density * step**4 / 8.0 * identity
    process[3:6, 3:6] = spectral_density * step**3 / 3.0 * identity
    process[:3, 6:9] = spectral_density * step**3 / 6.0 * to_gcrf
    process[3:6, 6:9] = spectral_density * step**2 / 2.0 * to_gcrf
    process[6:9, :3] = process[:3, 6:9].T
    process[6:9, 3:6] = process[3:6, 6:9].T
    process[6:9, 6:9] = spectral_density * step * identity
    return process


def _white_acceleration(root_density: float, step: float) -> FloatArray:
    """Return the process noise (9, 9) of white acceleration over a step."""
    density = root_density**2
    process = np.zeros((DYNAMIC_STATES, DYNAMIC_STATES))
    process[:3, :3] = density * step**3 / 3.0 * np.eye(3)
    process[:3, 3:6] = process[3:6, :3] = density * step**2 / 2.0 * np.eye(3)
    process[3:6, 3:6] = density * step * np.eye(3)
    return process


def _steps(
    time: GpsTime, duration: float, thrust: Sequence[ThrustInterval], longest_step: float
) -> list[tuple[GpsTime, float]]:
    """Return start and length of steps that end wherever the thrust changes."""
    end = time + duration
    marks = {time, end}
    for interval in thrust:
        marks.update(mark for mark in (interval.start, interval.end) if time < mark < end)
    ordered = sorted(marks)
    steps = []
    for start, stop in zip(ordered[:-1], ordered[1:], strict=True):
        count = math.ceil((stop - start) / longest_step - 1e-9)
        nanoseconds = (stop.nanoseconds - start.nanoseconds) // count
        for index in range(count):
            begin = GpsTime(start.nanoseconds + index * nanoseconds)
            finish = stop if index == count - 1 else GpsTime(begin.nanoseconds + nanoseconds)
            steps.append((begin, finish - begin))
    return steps
