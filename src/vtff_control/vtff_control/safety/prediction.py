"""Free motion of a formation over orbits, with covariance: how near every pair comes.

The relative states are carried by nonlinear flight under J2 (`vtff_dynamics.orbit.free_flight`),
their covariance by the transition about the chief, taken from six displaced flights: any
eccentricity and any distance. Differences of states are in GCRF axes.

A pair is *clear* at a moment if its expected distance is at least a radius, and its position is
outside the hard radius by so many sigma. The sigma are those across a plane that separates the
position from the sphere, the better one of two: across the line of sight, and across the direction
P^-1 d, which looks past an uncertainty that grows in-track. For any such plane the probability of
being inside the sphere is at most that of being beyond the plane.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vtff_control.safety.probability import (
    encounter_probability,
    instantaneous_probability,
    sigma_bound_probability,
)
from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.frames.rtn import (
    angular_velocity_rtn,
    deputy_state_gcrf,
    rotation_gcrf_to_rtn,
)
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.vectors import FloatArray, skew

__all__ = [
    "ChiefMotion",
    "FreeMotion",
    "PairPrediction",
    "hermite_position",
    "move_to_nearest",
    "predict_chief_motion",
    "prediction_times",
    "sigmas_outside",
]

_DISPLACEMENTS = np.array([10.0] * 3 + [0.01] * 3)  # m and m/s
# The chief and its displaced flights. Eight flights take half the time of seven: the last one is
# there for that.
_DISPLACED = np.vstack((np.zeros(6), np.diag(_DISPLACEMENTS), np.zeros(6)))
_CERTAIN = 8.0  # sigma: a probability beyond is given as its bound, 6e-16
_SHORT_ENCOUNTER = 0.02  # of an orbit: a fly-by that lasts longer is not straight


def prediction_times(period: float, orbits: float) -> FloatArray:
    """Return the moments of a prediction, s: every 2 s, 10 s after a minute, 30 s after ten."""
    count = math.ceil((max(orbits * period, 600.0) + 30.0 - 600.0) / 30.0)
    return np.array(_times_with_end(count))


@functools.lru_cache(maxsize=4)
def _times_with_end(count: int) -> FloatArray:
    """Return the moments of a prediction with so many of them from ten minutes on.

    An orbit changes their number once in many steps.
    """
    return np.concatenate(
        (
            np.arange(0.0, 60.0, 2.0),
            np.arange(60.0, 600.0, 10.0),
            600.0 + 30.0 * np.arange(count),
        )
    )


@dataclass(frozen=True)
class PairPrediction:
    """What is predicted of two spacecraft with all thrust off; lengths in m, times in s from now.

    Attributes
    ----------
    first, second
        Names.
    separation, separation_time
        Smallest expected distance, and when.
    radial_normal
        Smallest expected distance in the R-N plane of the chief.
    sigmas
        Smallest number of sigma between the pair and the hard radius.
    violation_time
        When the pair is first not clear; infinite if it always is.
    probability
        That the pair comes inside the hard radius: the larger of the largest instantaneous one and
        that of a short encounter.
    """

    first: str
    second: str
    separation: float
    separation_time: float
    radial_normal: float
    sigmas: float
    violation_time: float
    probability: float


def _probability_of_encounter(state: FloatArray, covariance: FloatArray, radius: float) -> float:
    """Return the probability of a short encounter; zero if the fly-by is too slow to be one."""
    speed = float(np.linalg.norm(state[3:]))
    extent = radius + math.sqrt(max(float(np.linalg.eigvalsh(covariance)[-1]), 0.0))
    if not extent < speed * _SHORT_ENCOUNTER * 5600.0:
        return 0.0
    return encounter_probability(state[:3], state[3:], covariance, radius)


@dataclass(frozen=True, eq=False)
class FreeMotion:
    """Motion of all deputies about the chief without thrust.

    Attributes
    ----------
    times
        s from the start, shape (n,).
    names
        Chief and deputies.
    relative
        Difference to the chief in GCRF axes, m and m/s, shape (m, n, 6); zero for the chief.
    covariances
        Covariances of the positions to the chief, m of shape (n, 3, 3); zero for the chief.
    chief
        Motion of the chief.
    """

    times: FloatArray
    names: tuple[str, ...]
    relative: FloatArray
    covariances: tuple[FloatArray, ...]
    chief: ChiefMotion

    @property
    def transition(self) -> FloatArray:
        """From a difference at the start to one later, shape (n, 6, 6)."""
        return self.chief.transition

    @property
    def rotation(self) -> FloatArray:
        """From GCRF to the chief's RTN axes, shape (n, 3, 3)."""
        return self.chief.rotation

    def pair_covariance(self, first: int, second: int, samples: slice = slice(None)) -> FloatArray:
        """Return the covariance of the position between two spacecraft, shape (n, 3, 3).

        The errors of two deputies that share a chief are correlated positively; their correlation
        is not known here, and to leave it out makes the covariance of the difference larger.
        """
        return np.asarray(self.covariances[first][samples] + self.covariances[second][samples])

    def predict_pair(
        self, first: int, second: int, hard_radius: float, clear_radius: float, clear_sigmas: float
    ) -> PairPrediction:
        """Return how near two spacecraft come.

        Parameters
        ----------
        first, second
            Indices into `names`.
        hard_radius
            m.
        clear_radius, clear_sigmas
            Expected distance (m), and sigma between pair and hard radius, of a clear pair.
        """
        figures, nearest = self._scan(first, second, hard_radius, clear_radius, clear_sigmas)
        separation, separation_time, radial_normal, sigmas, sigmas_time, violation = figures
        if sigmas < _CERTAIN:
            relative = self.relative[second] - self.relative[first]
            covariance = self.pair_covariance(first, second)
            at_sigmas, at_separation = np.searchsorted(self.times, (sigmas_time, separation_time))
            position = _position_at(self.times, relative, sigmas_time)
            probability = max(
                instantaneous_probability(position, covariance[at_sigmas], hard_radius),
                _probability_of_encounter(nearest, covariance[at_separation], hard_radius),
            )
        else:
            probability = sigma_bound_probability(sigmas)
        return PairPrediction(
            self.names[first],
            self.names[second],
            separation,
            separation_time,
            radial_normal,
            sigmas,
            violation,
            probability,
        )

    def violation_time(
        self, first: int, second: int, hard_radius: float, clear_radius: float, clear_sigmas: float
    ) -> float:
        """Return when a pair is first not clear, as in `PairPrediction`; see `predict_pair`."""
        return self._scan(first, second, hard_radius, clear_radius, clear_sigmas)[0][-1]

    def _scan(
        self, first: int, second: int, hard_radius: float, clear_radius: float, clear_sigmas: float
    ) -> tuple[list[float], FloatArray]:
        """Return the figures of a pair and its nearest state, as `_scan` does."""
        figures, nearest = _scan(
            self.times,
            self.relative[second] - self.relative[first],
            self.pair_covariance(first, second),
            self.rotation,
            hard_radius,
            clear_radius,
            clear_sigmas,
        )
        return figures.tolist(), nearest


@dataclass(frozen=True, eq=False)
class ChiefMotion:
    """Motion of a chief without thrust, and how differences to it grow.

    Attributes
    ----------
    times
        s from the start, shape (n,).
    flown
        Chief, and the chief displaced by `_DISPLACEMENTS` at the start, m and m/s, shape (n, 8, 6);
        the last one is of no meaning.
    states_gcrf
        Chief, m and m/s, shape (n, 6).
    rotation
        From GCRF to the chief's RTN axes, shape (n, 3, 3).
    position_from_relative
        From a relative state in RTN axes at the start to the position of a difference later, GCRF
        axes, shape (n, 3, 6).
    """

    times: FloatArray
    flown: FloatArray
    states_gcrf: FloatArray
    rotation: FloatArray
    position_from_relative: FloatArray

    @functools.cached_property
    def transition(self) -> FloatArray:
        """From a difference at the start to one later, GCRF axes, shape (n, 6, 6).

        Only a search for a manoeuvre needs it.
        """
        differences = self.flown[:, 1:7] - self.flown[:, :1]
        return np.asarray(np.swapaxes(differences, 1, 2) / _DISPLACEMENTS)

    def _position_covariances(self, covariance_rtn: FloatArray) -> FloatArray:
        """Return the covariances of a relative position, m2, GCRF axes, shape (n, 3, 3)."""
        to_position = self.position_from_relative
        # One product of all rows: a product for each moment would take four times as long.
        times_covariance = (to_position.reshape(-1, 6) @ covariance_rtn).reshape(-1, 3, 6)
        return np.asarray(times_covariance @ np.swapaxes(to_position, 1, 2))

    def formation(
        self,
        names: Sequence[str],
        relative_states_rtn: Sequence[FloatArray],
        covariances_rtn: Sequence[FloatArray],
    ) -> FreeMotion:
        """Return the motion of a formation about this chief.

        Parameters
        ----------
        names
            The chief, then the deputies.
        relative_states_rtn
            Relative state of each deputy at the start (m, m/s, shape (6,); the frame turns about N
            alone).
        covariances_rtn
            Covariance of the relative state of each deputy at the start, shape (6, 6).
        """
        samples = len(self.times)
        relative = np.zeros((len(names), samples, 6))
        if len(relative_states_rtn):
            chief = self.states_gcrf[0]
            deputies = [deputy_state_gcrf(chief, state) for state in relative_states_rtn]
            flown = free_flight(deputies, self.times)
            relative[1:] = np.swapaxes(flown - self.states_gcrf[:, np.newaxis], 0, 1)
        covariances = (np.zeros((samples, 3, 3)), *map(self._position_covariances, covariances_rtn))
        return FreeMotion(self.times, tuple(names), relative, covariances, self)


def predict_chief_motion(state_chief_gcrf: FloatArray, orbits: float) -> ChiefMotion:
    """Return the motion of a chief without thrust.

    Parameters
    ----------
    state_chief_gcrf
        m and m/s, shape (6,).
    orbits
        Length of the prediction.
    """
    chief = np.asarray(state_chief_gcrf, dtype=float)
    x, y, z, vx, vy, vz = chief.tolist()
    axis = 1.0 / (2.0 / math.sqrt(x * x + y * y + z * z) - (vx * vx + vy * vy + vz * vz) / GM_EARTH)
    period = 2.0 * math.pi * math.sqrt(axis**3 / GM_EARTH)
    times = prediction_times(period, orbits)
    flown = free_flight(chief + _DISPLACED, times)
    states = flown[:, 0]
    rotation = rotation_gcrf_to_rtn(states)
    differences = flown[:, 1:7, :3] - flown[:, :1, :3]
    to_position = np.swapaxes(differences, 1, 2) / _DISPLACEMENTS
    # From a relative state in axes that turn about N to a difference in GCRF axes.
    to_gcrf = np.zeros((6, 6))
    to_gcrf[:3, :3] = to_gcrf[3:, 3:] = rotation[0].T
    to_gcrf[3:, :3] = rotation[0].T @ skew(angular_velocity_rtn(chief))
    return ChiefMotion(
        times, flown, states, rotation, (to_position.reshape(-1, 6) @ to_gcrf).reshape(-1, 3, 6)
    )


@compiled
def hermite_position(
    start: FloatArray, end: FloatArray, step: float, fraction: float, position: FloatArray
) -> None:
    """Write the position at a fraction of a step between two states (6,)."""
    f = fraction
    h00 = (1.0 + 2.0 * f) * (1.0 - f) * (1.0 - f)
    h10 = f * (1.0 - f) * (1.0 - f) * step
    h01 = f * f * (3.0 - 2.0 * f)
    h11 = f * f * (f - 1.0) * step
    for k in range(3):
        position[k] = h00 * start[k] + h10 * start[k + 3] + h01 * end[k] + h11 * end[k + 3]


@compiled
def move_to_nearest(position: FloatArray, later: FloatArray) -> float:
    """Move a position (3,) to where the straight way to a later one is nearest to zero.

    Returns
    -------
    float
        Share of the way up to there; 0 where no point between the two is nearer than both.
    """
    length2, along = 0.0, 0.0
    for k in range(3):
        way = later[k] - position[k]
        length2 += way * way
        along -= way * position[k]
    if not 0.0 < along < length2:
        return 0.0
    share = along / length2
    for k in range(3):
        position[k] += share * (later[k] - position[k])
    return share


@compiled
def sigmas_outside(position: FloatArray, covariance: FloatArray, radius: float) -> float:
    """Return the sigma between a position and a sphere, by the better one of two planes."""
    x, y, z = position[0], position[1], position[2]
    distance = math.sqrt(x * x + y * y + z * z)
    if distance <= radius:
        return 0.0
    a, b, c = covariance[0, 0], covariance[0, 1], covariance[0, 2]
    d, e, f = covariance[1, 1], covariance[1, 2], covariance[2, 2]
    variance = (a * x * x + d * y * y + f * z * z + 2.0 * (b * x * y + c * x * z + e * y * z)) / (
        distance * distance
    )
    best = 1e9
    if variance > 0.0:
        best = min(best, (distance - radius) / math.sqrt(variance))
    # y = P^-1 d by cofactors.
    c00, c01, c02 = d * f - e * e, c * e - b * f, b * e - c * d
    c11, c12, c22 = a * f - c * c, b * c - a * e, a * d - b * b
    determinant = a * c00 + b * c01 + c * c02
    if determinant > 1e-30:
        u = (c00 * x + c01 * y + c02 * z) / determinant
        v = (c01 * x + c11 * y + c12 * z) / determinant
        w = (c02 * x + c12 * y + c22 * z) / determinant
        square = u * x + v * y + w * z
        if square > 0.0:
            along = square - radius * math.sqrt(u * u + v * v + w * w)
            best = max(best, along / math.sqrt(square))
    return best


@compiled
def _scan(
    times: FloatArray,
    relative: FloatArray,
    covariance: FloatArray,
    rotation: FloatArray,
    hard_radius: float,
    clear_radius: float,
    clear_sigmas: float,
) -> tuple[FloatArray, FloatArray]:
    """Return six figures of a pair, and its state when it is nearest.

    The figures are separation and its time, the separation across the track, sigmas and their time,
    and the time of the violation, as in `PairPrediction`.
    """
    pieces = 4
    position, later = np.empty(3), np.empty(3)
    nearest = np.zeros(6)
    separation, separation_time, radial_normal = 1e18, 0.0, 1e18
    fewest, fewest_time, violation = 1e18, 0.0, np.inf
    for index in range(len(times)):
        step, count = 0.0, 1
        if index + 1 < len(times):
            step = times[index + 1] - times[index]
            x, v = relative[index, :3], relative[index, 3:]
            reach = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2) * step
            distance = math.sqrt(x[0] ** 2 + x[1] ** 2 + x[2] ** 2)
            if distance - 1.5 * reach < max(separation, 3.0 * clear_radius):
                count = pieces
        for piece in range(count):
            if piece == 0:
                for k in range(3):
                    position[k] = relative[index, k]
            else:
                hermite_position(
                    relative[index], relative[index + 1], step, piece / pieces, position
                )
            moment = times[index] + step * piece / pieces
            if count > 1:
                hermite_position(
                    relative[index], relative[index + 1], step, (piece + 1) / pieces, later
                )
                moment += move_to_nearest(position, later) * step / pieces
            distance = math.sqrt(position[0] ** 2 + position[1] ** 2 + position[2] ** 2)
            if distance < separation:
                separation, separation_time = distance, moment
                for k in range(3):
                    nearest[k] = position[k]
                    nearest[k + 3] = relative[index, k + 3]
            radial, normal = 0.0, 0.0
            for k in range(3):
                radial += rotation[index, 0, k] * position[k]
                normal += rotation[index, 2, k] * position[k]
            radial_normal = min(radial_normal, math.sqrt(radial * radial + normal * normal))
            sigmas = sigmas_outside(position, covariance[index], hard_radius)
            if sigmas < fewest:
                fewest, fewest_time = sigmas, moment
            if violation == np.inf and (distance < clear_radius or sigmas < clear_sigmas):
                violation = moment
    figures = np.array([separation, separation_time, radial_normal, fewest, fewest_time, violation])
    return figures, nearest


def _position_at(times: FloatArray, relative: FloatArray, moment: float) -> FloatArray:
    """Return the position at a moment, between the samples, m, shape (3,)."""
    index = min(max(int(np.searchsorted(times, moment, side="right")) - 1, 0), len(times) - 2)
    step = float(times[index + 1] - times[index])
    position = np.empty(3)
    hermite_position(
        relative[index], relative[index + 1], step, (moment - times[index]) / step, position
    )
    return position
