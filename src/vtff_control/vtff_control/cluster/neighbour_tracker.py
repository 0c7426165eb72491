"""Tracks of neighbours from an on-board sensor of range and direction, without any message."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.relative.motion import hcw_transition_matrix
from vtff_dynamics.vectors import FloatArray, norm

__all__ = ["NeighbourTracker", "Track"]


class Track:
    """One neighbour in the chaser's RTN frame.

    Attributes
    ----------
    state
        m and m/s, shape (6,).
    covariance
        Shape (6, 6).
    age
        Time since the last detection, s.
    detections
        Their number.
    """

    def __init__(self, position: FloatArray, noise: FloatArray, speed_sigma: float) -> None:
        self.state = np.concatenate((position, np.zeros(3)))
        self.covariance = np.zeros((6, 6))
        self.covariance[:3, :3] = noise
        self.covariance[3:, 3:] = speed_sigma**2 * np.eye(3)
        self.age = 0.0
        self.detections = 1
        self.latitudes: list[tuple[float, float]] = []

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
        self.tracks: list[Track] = []

    def predict(
        self,
        duration: float,
        mean_motion: float,
        acceleration_density: float,
        own_displacement: npt.ArrayLike = (0.0, 0.0, 0.0),
        own_velocity_change: npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Carry all tracks on by a time.

        Parameters
        ----------
        duration
            s.
        mean_motion
            rad/s.
        acceleration_density
            Root of the spectral density of a neighbour's thrust, m/s^1.5.
        own_displacement, own_velocity_change
            How far and how fast the chaser's own thrust has moved it in this time, m and m/s in
            its RTN frame, shape (3,).
        """
        own = np.concatenate((own_displacement, own_velocity_change))
        transition = hcw_transition_matrix(mean_motion, duration)
        noise = np.zeros((6, 6))
        noise[:3, :3] = duration**3 / 3.0 * np.eye(3)
        noise[:3, 3:] = noise[3:, :3] = duration**2 / 2.0 * np.eye(3)
        noise[3:, 3:] = duration * np.eye(3)
        for track in self.tracks:
            track.state = transition @ track.state - own
            track.covariance = transition @ track.covariance @ transition.T
            track.covariance += acceleration_density**2 * noise
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
                self.tracks.append(Track(position, noise, self._largest_speed))
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


def _correct(track: Track, position: FloatArray, noise: FloatArray) -> None:
    gain = np.linalg.solve(track.covariance[:3, :3] + noise, track.covariance[:3]).T
    track.state = track.state + gain @ (position - track.state[:3])
    rest = np.eye(6)
    rest[:, :3] -= gain
    track.covariance = rest @ track.covariance @ rest.T + gain @ noise @ gain.T
    track.age = 0.0
    track.detections += 1
