"""Potential field of neighbours: where a chaser goes that decides alone (paper 001, corrected).

Each neighbour is a well with a ring of high potential about it. A chaser climbs the sum of the
potentials in steps, each reached by the first of two Clohessy-Wiltshire impulses, and plans again
before it arrives. An impulse leads to the place on the step where the next one is due: one that led
to the end of the step would count on falling on after the next impulse, and a chaser that holds a
place against the tide would hold it some metres off. Distances in the potential are kilometres, as
in the paper.

References
----------
Paper 001: a potential-field program for clusters of satellites, equations (1) to (4) and the
appendix, whose constants (3 exp(-r/2), r0 = 0.5 km) are used; its text has 6 exp(-r/2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from vtff_dynamics.frames.rtn import angular_velocity_rtn
from vtff_dynamics.relative.motion import hcw_input_matrix, hcw_transition_matrix
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "PotentialField",
    "climb",
    "equilibrium_distance",
    "first_impulse",
    "potential",
    "potential_gradient",
    "shortened",
    "stiffness",
]

_AVOIDED_RADIUS = 0.5  # km, r of potential_field in the appendix
_AVOIDANCE = (4.0 - _AVOIDED_RADIUS**2) * _AVOIDED_RADIUS**6  # km^6
_ATTRACTION = 3.0
_LENGTH = 2.0  # km
_KILOMETRE = 1e3  # m


def potential(positions_neighbours: npt.ArrayLike, position: npt.ArrayLike) -> float:
    """Return the potential at a position.

    Parameters
    ----------
    positions_neighbours
        m, shape (k, d), d = 2 or 3.
    position
        m, shape (d,).
    """
    away = np.asarray(position, dtype=float) - np.asarray(positions_neighbours, dtype=float)
    r = np.linalg.norm(away, axis=1) / _KILOMETRE
    return float((-_AVOIDANCE / r**6 + _ATTRACTION * np.exp(-r / _LENGTH)).sum())


def potential_gradient(positions_neighbours: npt.ArrayLike, position: npt.ArrayLike) -> FloatArray:
    """Return the gradient of the potential, 1/km, shape (d,); parameters as in `potential`."""
    away = np.asarray(position, dtype=float) - np.asarray(positions_neighbours, dtype=float)
    r = np.linalg.norm(away, axis=1, keepdims=True) / _KILOMETRE
    slope = 6.0 * _AVOIDANCE / r**7 - _ATTRACTION / _LENGTH * np.exp(-r / _LENGTH)
    gradient: FloatArray = (slope * away / (_KILOMETRE * r)).sum(axis=0)
    return gradient


def equilibrium_distance() -> float:
    """Return the distance of highest potential about one neighbour, m."""

    def slope(r: float) -> float:
        return 6.0 * _AVOIDANCE / r**7 - _ATTRACTION / _LENGTH * math.exp(-r / _LENGTH)

    return _KILOMETRE * float(brentq(slope, 0.6, 1.5, xtol=1e-15))


def first_impulse(
    relative_state: npt.ArrayLike,
    position_wanted: npt.ArrayLike,
    mean_motion: float,
    time: float,
    acceleration: npt.ArrayLike = (0.0, 0.0, 0.0),
) -> FloatArray:
    """Return the velocity change that leads to a relative position in a time, m/s, shape (3,).

    Parameters
    ----------
    relative_state
        m and m/s in RTN, shape (6,).
    position_wanted
        m, shape (3,).
    mean_motion
        rad/s.
    time
        s.
    acceleration
        Relative thrust that acts meanwhile, m/s2, shape (3,).
    """
    state = np.asarray(relative_state, dtype=float)
    transition = hcw_transition_matrix(mean_motion, time)
    fallen = transition[:3, :3] @ state[:3]
    fallen += hcw_input_matrix(mean_motion, time)[:3] @ np.asarray(acceleration, dtype=float)
    missing = np.asarray(position_wanted, dtype=float) - fallen
    impulse: FloatArray = np.linalg.solve(transition[:3, 3:], missing) - state[3:]
    return impulse


@dataclass(frozen=True)
class PotentialField:
    """Guidance of one chaser.

    Parameters
    ----------
    transfer_time
        In which a step is made, s.
    longest_step
        m.
    gain
        Step for a unit gradient, km^2.
    acceleration_density
        Root of the spectral density of a neighbour's thrust about its mean, m/s^1.5.
    held_thrust
        Sigma on each axis of the mean thrust by which a neighbour holds its place, m/s2.
    """

    transfer_time: float = 60.0
    longest_step: float = 100.0
    gain: float = 0.07
    acceleration_density: float = 0.005
    held_thrust: float = 1e-3

    @property
    def stays_without_thrust(self) -> bool:
        """Whether the cluster stays together without thrust; see `ElementsField`."""
        return False

    def thrust_density(self, change: FloatArray, interval: float) -> float:
        """Return `acceleration_density`: thrust that holds a place is always about the same."""
        return self.acceleration_density

    def impulse(
        self,
        neighbours: npt.ArrayLike,
        own_gcrf: FloatArray,
        interval: float,
        followed: npt.ArrayLike | None = None,
        thrusts: npt.ArrayLike | None = None,
    ) -> FloatArray:
        """Return the velocity change of the chaser, m/s in its RTN frame, shape (3,).

        The chaser moves against the mean of the neighbours that it follows, so that a cluster whose
        members see only each other agrees on one velocity, that of a member that does not thrust.

        Parameters
        ----------
        neighbours
            Their states relative to the chaser in its RTN frame, m and m/s, shape (k, 6).
        own_gcrf
            State of the chaser, m and m/s, shape (6,).
        interval
            To the next such change, s.
        followed
            Which of them are followed, boolean, shape (k,); the others are only avoided. Default
            all.
        thrusts
            Mean thrusts of the neighbours, m/s2, shape (k, 3). Default none.
        """
        states = np.asarray(neighbours, dtype=float).reshape(-1, 6)
        acting = np.zeros((len(states), 3)) if thrusts is None else np.asarray(thrusts, float)
        chosen = np.ones(len(states), bool) if followed is None else np.asarray(followed, bool)
        if not chosen.any():
            return np.zeros(3)
        own = -states[chosen].mean(axis=0)
        share = min(interval / self.transfer_time, 1.0)
        place = own[:3] + share * self._step(states[:, :3], chosen)
        acceleration = -acting.reshape(-1, 3)[chosen].mean(axis=0)
        mean_motion = float(angular_velocity_rtn(own_gcrf)[2])
        return first_impulse(own, place, mean_motion, interval, acceleration)

    def _step(self, positions: FloatArray, chosen: npt.NDArray[np.bool_]) -> FloatArray:
        """Return the next step, m, shape (3,).

        Parameters
        ----------
        positions
            Positions of the neighbours relative to the chaser, m, shape (k, 3).
        chosen
            Which of them are followed, shape (k,).
        """
        step = _KILOMETRE * self.gain * climb(positions, chosen)
        return shortened(step, self.longest_step)


def climb(positions: FloatArray, chosen: npt.NDArray[np.bool_]) -> FloatArray:
    """Return the gradient of the potential where the chaser is, 1/km, shape (d,).

    Parameters
    ----------
    positions
        Positions of the neighbours relative to the chaser, m, shape (k, d).
    chosen
        Which of them are followed, shape (k,); one that is not followed only repels.
    """
    gradient = potential_gradient(positions[chosen], np.zeros(positions.shape[1]))
    for other in positions[~chosen]:
        slope = potential_gradient(other[np.newaxis], np.zeros(len(other)))
        if slope @ other < 0.0:
            gradient = gradient + slope
    return gradient


def stiffness(positions: FloatArray) -> float:
    """Return by how much the gradient changes with the distances to neighbours, 1/km^2.

    Parameters
    ----------
    positions
        Positions of the neighbours relative to the chaser, m, shape (k, d).
    """
    r = np.linalg.norm(positions, axis=1) / _KILOMETRE
    slope = 42.0 * _AVOIDANCE / r**8 - _ATTRACTION / _LENGTH**2 * np.exp(-r / _LENGTH)
    return max(float(np.abs(slope).sum()), 1e-9)


def shortened(step: FloatArray, longest: float) -> FloatArray:
    """Return a step with its direction that is no longer than `longest`, m."""
    length = math.sqrt(float(step @ step))
    return step if length <= longest else step * (longest / length)
