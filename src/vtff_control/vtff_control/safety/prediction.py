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
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from vtff_control.safety.probability import (
    encounter_probability,
    instantaneous_probability,
    sigma_bound_probability,
)
from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.frames.rtn import deputy_state_gcrf, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.vectors import FloatArray, cross, skew

__all__ = [
    "ChiefMotion",
    "FreeMotion",
    "PairApproach",
    "PairPrediction",
    "hermite_position",
    "predict_chief_motion",
    "prediction_times",
    "sigmas_outside",
]

_DISPLACEMENTS = np.array([10.0] * 3 + [0.01] * 3)  # m and m/s
_CERTAIN = 8.0  # sigma: a probability beyond is given as its bound, 6e-16
_SHORT_ENCOUNTER = 0.02  # of an orbit: a fly-by that lasts longer is not straight


def prediction_times(period: float, orbits: float) -> FloatArray:
    """Return the moments of a prediction, s: every 2 s, 10 s after a minute, 30 s after ten."""
    return np.concatenate(
        (
            np.arange(0.0, 60.0, 2.0),
            np.arange(60.0, 600.0, 10.0),
            np.arange(600.0, max(orbits * period, 600.0) + 30.0, 30.0),
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
    sigmas, sigmas_time
        Smallest number of sigma between the pair and the hard radius, and when.
    violation_time
        When the pair is first not clear; infinite if it always is.
    approach
        The motion that this is told of.
    """

    first: str
    second: str
    separation: float
    separation_time: float
    radial_normal: float
    sigmas: float
    sigmas_time: float
    violation_time: float
    approach: PairApproach = field(repr=False, compare=False)

    @functools.cached_property
    def probability(self) -> float:
        """Return the probability that the pair comes inside the hard radius.

        It is the larger of the largest instantaneous one and that of a short encounter. Decisions
        rest on sigmas: commands do not wait until this is computed.
        """
        if not self.sigmas < _CERTAIN:
            return sigma_bound_probability(self.sigmas)
        approach = self.approach
        times, radius = approach.times, approach.hard_radius
        index = int(np.searchsorted(times, self.sigmas_time))
        position = _position_at(times, approach.relative, self.sigmas_time)
        nearest = int(np.searchsorted(times, self.separation_time))
        return max(
            instantaneous_probability(position, approach.covariance[index], radius),
            _probability_of_encounter(
                approach.separation_state, approach.covariance[nearest], radius
            ),
        )


class PairApproach(NamedTuple):
    """Motion of one spacecraft relative to another one with all thrust off.

    Attributes
    ----------
    times
        s from now, shape (n,).
    relative
        Difference in GCRF axes, m and m/s, shape (n, 6).
    covariance
        Covariances of its positions, m2, shape (n, 3, 3).
    separation_state
        Difference when the pair is nearest, shape (6,).
    hard_radius
        m.
    """

    times: FloatArray
    relative: FloatArray
    covariance: FloatArray
    separation_state: FloatArray
    hard_radius: float


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
        Covariances of the positions to the chief, shape (m, n, 3, 3); zero for the chief.
    chief
        Motion of the chief.
    """

    times: FloatArray
    names: tuple[str, ...]
    relative: FloatArray
    covariances: FloatArray
    chief: ChiefMotion

    @property
    def transition(self) -> FloatArray:
        """From a difference at the start to one later, shape (n, 6, 6)."""
        return self.chief.transition

    @property
    def rotation(self) -> FloatArray:
        """From GCRF to the chief's RTN axes, shape (n, 3, 3)."""
        return self.chief.rotation

    def pair_covariance(self, first: int, second: int) -> FloatArray:
        """Return the covariance of the position between two spacecraft, shape (n, 3, 3).

        The errors of two deputies that share a chief are correlated positively; their correlation
        is not known here, and to leave it out makes the covariance of the difference larger.
        """
        return np.asarray(self.covariances[first] + self.covariances[second])

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
        relative = np.ascontiguousarray(self.relative[second] - self.relative[first])
        covariance = self.pair_covariance(first, second)
        result, separation_state = _scan(
            self.times,
            relative,
            covariance,
            self.rotation,
            hard_radius,
            clear_radius,
            clear_sigmas,
        )
        separation, separation_time, radial_normal, sigmas, sigmas_time, violation = result
        return PairPrediction(
            self.names[first],
            self.names[second],
            float(separation),
            float(separation_time),
            float(radial_normal),
            float(sigmas),
            float(sigmas_time),
            float(violation),
            PairApproach(self.times, relative, covariance, separation_state, hard_radius),
        )


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

    def position_covariances(self, covariance_rtn: FloatArray) -> FloatArray:
        """Return the covariances of a relative position, m2, GCRF axes, shape (n, 3, 3).

        Parameters
        ----------
        covariance_rtn
            Covariance of the relative state at the start, shape (6, 6).
        """
        to_position = self.position_from_relative
        # One product of all rows: a product for each moment would take four times as long.
        times_covariance = (to_position.reshape(-1, 6) @ covariance_rtn).reshape(-1, 3, 6)
        return np.asarray(times_covariance @ np.swapaxes(to_position, 1, 2))

    def formation(
        self,
        names: Sequence[str],
        relative_states_rtn: Sequence[FloatArray],
        position_covariances: Sequence[FloatArray],
    ) -> FreeMotion:
        """Return the motion of a formation about this chief.

        Parameters
        ----------
        names
            The chief, then the deputies.
        relative_states_rtn
            Relative state of each deputy at the start (m, m/s, shape (6,); the frame turns about N
            alone).
        position_covariances
            Covariances of the positions of each deputy, by `position_covariances`.
        """
        count, samples = len(relative_states_rtn), len(self.times)
        relative = np.zeros((count + 1, samples, 6))
        covariances = np.zeros((count + 1, samples, 3, 3))
        if count:
            chief = self.states_gcrf[0]
            deputies = [deputy_state_gcrf(chief, state) for state in relative_states_rtn]
            flown = free_flight(np.array(deputies), self.times)
            relative[1:] = np.swapaxes(flown - self.states_gcrf[:, np.newaxis], 0, 1)
            covariances[1:] = position_covariances
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
    axis = 1.0 / (2.0 / np.linalg.norm(chief[:3]) - float(chief[3:] @ chief[3:]) / GM_EARTH)
    period = 2.0 * math.pi * math.sqrt(float(axis) ** 3 / GM_EARTH)
    times = prediction_times(period, orbits)
    # Eight flights take half the time of seven: the last one is there for that.
    flown = free_flight(np.array([chief, *(chief + np.diag(_DISPLACEMENTS)), chief]), times)
    rotation_start = rotation_gcrf_to_rtn(chief)
    momentum = cross(chief[:3], chief[3:])
    rate = np.array([0.0, 0.0, np.linalg.norm(momentum) / float(chief[:3] @ chief[:3])])
    to_gcrf = np.zeros((6, 6))
    to_gcrf[:3, :3] = to_gcrf[3:, 3:] = rotation_start.T
    to_gcrf[3:, :3] = rotation_start.T @ skew(rate)
    states, rotation, positions = _describe_flights(flown, _DISPLACEMENTS)
    to_position = (positions.reshape(-1, 6) @ to_gcrf).reshape(-1, 3, 6)
    return ChiefMotion(times, flown, states, rotation, to_position)


@compiled
def _describe_flights(
    flown: FloatArray, displacements: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return states and axes of a chief, and the positions of its transition.

    Parameters
    ----------
    flown
        As of `ChiefMotion`, shape (n, 8, 6).
    displacements
        Displacements of the flights, m and m/s, shape (6,).

    Returns
    -------
    states
        Chief, m and m/s, shape (n, 6).
    rotation
        Rows R, T, N of the chief in GCRF, shape (n, 3, 3).
    positions
        From a difference at the start to its position later, GCRF axes, shape (n, 3, 6).
    """
    count = len(flown)
    states, rotation = np.empty((count, 6)), np.empty((count, 3, 3))
    positions = np.empty((count, 3, 6))
    for index in range(count):
        x, y, z = flown[index, 0, 0], flown[index, 0, 1], flown[index, 0, 2]
        vx, vy, vz = flown[index, 0, 3], flown[index, 0, 4], flown[index, 0, 5]
        for k in range(6):
            states[index, k] = flown[index, 0, k]
            for axis in range(3):
                difference = flown[index, k + 1, axis] - flown[index, 0, axis]
                positions[index, axis, k] = difference / displacements[k]
        radius = math.sqrt(x * x + y * y + z * z)
        rx, ry, rz = x / radius, y / radius, z / radius
        nx, ny, nz = y * vz - z * vy, z * vx - x * vz, x * vy - y * vx
        size = math.sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx / size, ny / size, nz / size
        rotation[index, 0, 0], rotation[index, 0, 1], rotation[index, 0, 2] = rx, ry, rz
        rotation[index, 1, 0] = ny * rz - nz * ry
        rotation[index, 1, 1] = nz * rx - nx * rz
        rotation[index, 1, 2] = nx * ry - ny * rx
        rotation[index, 2, 0], rotation[index, 2, 1], rotation[index, 2, 2] = nx, ny, nz
    return states, rotation, positions


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
    """Return six figures of a pair, as in `PairPrediction`, and the state when it is nearest."""
    pieces = 4
    position, later, velocity = np.empty(3), np.empty(3), np.empty(3)
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
            distance = math.sqrt(position[0] ** 2 + position[1] ** 2 + position[2] ** 2)
            # The nearest point of the straight piece that follows.
            if count > 1:
                if piece + 1 < pieces:
                    hermite_position(
                        relative[index], relative[index + 1], step, (piece + 1) / pieces, later
                    )
                else:
                    for k in range(3):
                        later[k] = relative[index + 1, k]
                length2, along = 0.0, 0.0
                for k in range(3):
                    velocity[k] = later[k] - position[k]
                    length2 += velocity[k] * velocity[k]
                    along -= velocity[k] * position[k]
                if length2 > 0.0 and 0.0 < along < length2:
                    share = along / length2
                    for k in range(3):
                        position[k] += share * velocity[k]
                    moment += share * step / pieces
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
