"""Tracks of neighbours from an on-board sensor of range and direction, without any message.

A neighbour that holds a place at rest thrusts against the tide, by the same acceleration for as
long as it stays there: 3 n^2 x, some mm/s2 at a kilometre. A filter that takes it to fall freely is
wrong in its velocity by centimetres per second, and a cluster of chasers that do so stands one
percent too wide. So that acceleration is estimated with each track.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from vtff_dynamics.frames.rtn import angular_velocity_rtn, deputy_state_gcrf, relative_state_rtn
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.relative.motion import hcw_input_matrix, hcw_transition_matrix
from vtff_dynamics.vectors import FloatArray, norm

__all__ = ["NeighbourTracker", "Track", "fly_neighbours"]

_HELD_TIME = 3e4  # s: a place is held for orbits; the pulses that hold it are averaged over minutes
_STATE, _THRUST = slice(0, 6), slice(6, 9)


class Track:
    """One neighbour in the chaser's RTN frame.

    Attributes
    ----------
    estimate
        State, m and m/s, and mean thrust, m/s2; shape (9,).
    covariance
        Shape (9, 9).
    age
        Time since the last detection, s.
    detections
        Their number.
    """

    def __init__(
        self, position: FloatArray, noise: FloatArray, speed_sigma: float, thrust_sigma: float
    ) -> None:
        self.estimate = np.concatenate((position, np.zeros(6)))
        self.covariance = np.diag([0.0] * 3 + [speed_sigma**2] * 3 + [thrust_sigma**2] * 3)
        self.covariance[:3, :3] = noise
        self.age = 0.0
        self.detections = 1
        self.latitudes: list[tuple[float, float]] = []

    @property
    def state(self) -> FloatArray:
        """Relative state, m and m/s, shape (6,)."""
        return self.estimate[_STATE]

    @property
    def thrust(self) -> FloatArray:
        """Mean thrust of the neighbour, m/s2, shape (3,)."""
        return self.estimate[_THRUST]

    def leaves_station(
        self, time: float, latitude: float, period: float, largest_drift: float
    ) -> bool:
        """Take the argument of latitude, and tell whether the neighbour leaves the station.

        A member of the cluster gains nothing on the station over an orbit, wherever it is held; one
        that decays does, and J2 takes no part in that.

        Parameters
        ----------
        time
            s.
        latitude
            Argument of latitude of the neighbour, from the chaser's own fix and the track, rad.
        period
            Nodal period of the station, s.
        largest_drift
            rad in an orbit.
        """
        self.latitudes.append((time, latitude))
        earlier = [entry for entry in self.latitudes if entry[0] <= time - period]
        if not earlier:
            return False
        self.latitudes = self.latitudes[len(earlier) - 1 :]
        begin, before = earlier[-1]
        expected = 2.0 * math.pi * (time - begin) / period
        gained = (latitude - before - expected + math.pi) % (2.0 * math.pi) - math.pi
        return abs(gained) > largest_drift


class NeighbourTracker:
    """Kalman filters of neighbours; a detection belongs to the nearest track.

    Parameters
    ----------
    range_sigma
        Standard deviation of the sensor's range, m.
    direction_sigma
        Standard deviation of the sensor's direction, rad.
    largest_speed
        Largest speed of a neighbour relative to the chaser, m/s: first sigma of a track.
    gate
        Largest distance of a detection from a prediction in sigmas, and at least 50 m.
    longest_age
        s without detection after which a track ends.
    """

    def __init__(
        self,
        range_sigma: float,
        direction_sigma: float,
        largest_speed: float = 8.0,
        gate: float = 6.0,
        longest_age: float = 600.0,
    ) -> None:
        self._sigmas = (range_sigma, direction_sigma)
        self._largest_speed = largest_speed
        self._gate = gate
        self._longest_age = longest_age
        self._held_thrust = 0.0
        self.tracks: list[Track] = []

    def predict(
        self,
        duration: float,
        own_gcrf: FloatArray,
        acceleration_density: float,
        held_thrust: float,
        own_displacement: npt.ArrayLike = (0.0, 0.0, 0.0),
        own_velocity_change: npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Carry all tracks on by a time.

        Parameters
        ----------
        duration
            s.
        own_gcrf
            The chaser's own fix at the start, m and m/s, shape (6,).
        acceleration_density
            Root of the spectral density of a neighbour's thrust about its mean, m/s^1.5.
        held_thrust
            Sigma of the mean thrust of a neighbour on each axis, m/s2; 0 where none is needed, and
            what was estimated of it is forgotten.
        own_displacement, own_velocity_change
            How far and how fast the chaser's own thrust has moved it in this time, m and m/s in
            its RTN frame, shape (3,).
        """
        own = np.concatenate((own_displacement, own_velocity_change, np.zeros(3)))
        decay = math.exp(-duration / _HELD_TIME) if held_thrust else 0.0
        mean_motion = float(angular_velocity_rtn(own_gcrf)[2])
        transition = np.zeros((9, 9))
        transition[_STATE, _STATE] = hcw_transition_matrix(mean_motion, duration)
        if held_thrust:
            transition[_STATE, _THRUST] = hcw_input_matrix(mean_motion, duration)
        transition[_THRUST, _THRUST] = decay * np.eye(3)
        density = acceleration_density**2
        noise = np.zeros((9, 9))
        noise[:3, :3] = density * duration**3 / 3.0 * np.eye(3)
        noise[:3, 3:6] = noise[3:6, :3] = density * duration**2 / 2.0 * np.eye(3)
        noise[3:6, 3:6] = density * duration * np.eye(3)
        noise[_THRUST, _THRUST] = held_thrust**2 * (1.0 - decay**2) * np.eye(3)
        self._held_thrust = held_thrust
        fallen = fly_neighbours(own_gcrf, [track.state for track in self.tracks], duration)
        for track, state in zip(self.tracks, fallen, strict=True):
            moved = transition[:, _THRUST] @ track.thrust
            moved[_STATE] += state
            track.estimate = moved - own
            track.covariance = transition @ track.covariance @ transition.T + noise
            track.age += duration
        self.tracks = [track for track in self.tracks if track.age <= self._longest_age]

    def detect(self, positions: npt.ArrayLike) -> None:
        """Take the detections of one moment.

        Parameters
        ----------
        positions
            Relative positions in the chaser's RTN frame, m, shape (k, 3), in any order.
        """
        free = list(self.tracks)
        for position in np.asarray(positions, dtype=float).reshape(-1, 3):
            noise = self._noise(position)
            best, least = None, math.inf
            for track in free:
                innovation = track.covariance[:3, :3] + noise
                difference = position - track.state[:3]
                sigmas = math.sqrt(float(difference @ np.linalg.solve(innovation, difference)))
                if (sigmas <= self._gate or norm(difference) < 50.0) and sigmas < least:
                    best, least = track, sigmas
            if best is None:
                self.tracks.append(Track(position, noise, self._largest_speed, self._held_thrust))
                continue
            free.remove(best)
            _correct(best, position, noise)

    def _noise(self, position: FloatArray) -> FloatArray:
        distance = norm(position)
        direction = position / distance
        along = np.outer(direction, direction)
        across = (distance * self._sigmas[1]) ** 2 * (np.eye(3) - along)
        noise: FloatArray = self._sigmas[0] ** 2 * along + across
        return noise


def fly_neighbours(
    own_gcrf: FloatArray, states: Sequence[FloatArray], duration: float
) -> list[FloatArray]:
    """Return the relative states of neighbours after a free flight of all, m and m/s, each (6,).

    J2 and the curvature of the orbit change relative velocities by millimetres per second within
    the memory of the tracks: more than the thrust that holds a cluster by its orbits.

    Parameters
    ----------
    own_gcrf
        Own state at the start, m and m/s, shape (6,).
    states
        Relative states in the own RTN frame, m and m/s, each of shape (6,).
    duration
        s.
    """
    craft = [own_gcrf, *(deputy_state_gcrf(own_gcrf, state) for state in states)]
    flown = free_flight(craft, [0.0, duration])[-1]
    return [relative_state_rtn(flown[0], state) for state in flown[1:]]


def _correct(track: Track, position: FloatArray, noise: FloatArray) -> None:
    gain = np.linalg.solve(track.covariance[:3, :3] + noise, track.covariance[:3]).T
    track.estimate = track.estimate + gain @ (position - track.estimate[:3])
    rest = np.eye(9)
    rest[:, :3] -= gain
    track.covariance = rest @ track.covariance @ rest.T + gain @ noise @ gain.T
    track.age = 0.0
    track.detections += 1
