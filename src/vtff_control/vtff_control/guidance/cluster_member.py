"""Guidance of one chaser of a cluster, from its own fix and its own sensor and nothing else.

It tracks what its sensor sees, climbs the potential of the neighbours that it follows
(`vtff_control.guidance.potential_field`), and leaves alone the one that leaves the station.

A chaser that sees nobody any more is held at a place where it does not stay without thrust. It
stops to hold, and gives its orbit the period of the station, a parameter of the mission: it goes
round in an ellipse instead of drifting away, until its sensor sees the others again. A radial
velocity moves the ellipse off the places where the others were seen last.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from vtff_control.guidance.neighbour_tracker import NeighbourTracker
from vtff_control.guidance.potential_field import PotentialField
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.orbit.mean_elements import elements_from_state, mean_elements, secular_rates
from vtff_dynamics.vectors import FloatArray, norm

__all__ = ["ClusterMember"]

_DETECTIONS = 3  # after which a track has a velocity
_LARGEST_DRIFT = 1e3  # m in an orbit: the size of the cluster
_SMALLEST_CHANGE = 1e-3  # m/s
_BLIND_AFTER = 120.0  # s without any detection; held neighbours have left their tracks by 20 m then
_CLEAR_DISTANCE = 700.0  # m: 500 m, and what the others move meanwhile
_RADIAL_SPEEDS = np.array(sorted(np.linspace(-2.5, 2.5, 51), key=abs))  # m/s
_PHASES = np.linspace(0.0, 2.0 * math.pi, 73)


class ClusterMember:
    """One chaser; call `detect` with every look of the sensor, `impulse` when it is to decide.

    Parameters
    ----------
    tracker
        Tracks of the neighbours, of its own.
    station_period
        Nodal period of the station, s.
    field
        Potential that it climbs.
    watch_from
        Time after which a neighbour that leaves the station is followed no more, s; before,
        members still come from afar. Infinite: never.
    """

    def __init__(
        self,
        tracker: NeighbourTracker,
        station_period: float,
        field: PotentialField | None = None,
        watch_from: float = math.inf,
    ) -> None:
        self._tracker = tracker
        self._station_period = station_period
        self._field = PotentialField() if field is None else field
        self._watch_from = watch_from
        self._time = math.nan
        self._is_coasting = False

    def detect(self, time: float, own_gcrf: FloatArray, positions: npt.ArrayLike) -> None:
        """Take what the sensor sees.

        Parameters
        ----------
        time
            s.
        own_gcrf
            Own fix, m and m/s, shape (6,).
        positions
            Relative positions in the own RTN frame, m, shape (k, 3), in any order.
        """
        if not math.isnan(self._time):
            self._tracker.predict(time - self._time, _mean_motion(own_gcrf))
        self._time = time
        self._tracker.detect(positions)

    def impulse(self, own_gcrf: FloatArray) -> FloatArray:
        """Return the velocity change at the time of the last look, m/s in the own RTN frame, (3,).

        Parameters
        ----------
        own_gcrf
            Own fix, m and m/s, shape (6,).
        """
        tracks = [track for track in self._tracker.tracks if track.detections >= _DETECTIONS]
        if all(track.age > _BLIND_AFTER for track in self._tracker.tracks):
            return self._coast(own_gcrf, [track.state[:3] for track in tracks])
        self._is_coasting = False
        to_gcrf = rotation_gcrf_to_rtn(own_gcrf).T
        # All are asked, because each notes its latitude.
        leaves = [
            track.leaves_station(
                self._time,
                _latitude(own_gcrf[:3] + to_gcrf @ track.state[:3], own_gcrf),
                self._station_period,
                _LARGEST_DRIFT / norm(own_gcrf[:3]),
            )
            for track in tracks
        ]
        is_watched = self._time >= self._watch_from
        followed = [not (leaving and is_watched) for leaving in leaves]
        return self._field.impulse(
            [track.state for track in tracks], _mean_motion(own_gcrf), followed
        )

    def add_impulse(self, velocity_rtn: npt.ArrayLike) -> None:
        """Take the velocity change that was given, m/s in the own RTN frame, shape (3,)."""
        self._tracker.add_impulse(velocity_rtn)

    def _coast(self, own_gcrf: FloatArray, neighbours: list[FloatArray]) -> FloatArray:
        """Return the change that leads to an ellipse with the period of the station, m/s, (3,)."""
        mean = mean_elements(elements_from_state(own_gcrf))
        mean_motion = float(secular_rates(mean)[1])
        axis_change = (
            (2.0 / 3.0) * float(mean[0]) * (self._station_period * mean_motion / math.tau - 1)
        )
        # On an orbit that is nearly a circle dv = n da / 2.
        along = 0.5 * mean_motion * axis_change
        radial = 0.0
        if not self._is_coasting:
            # Held at rest above the station by a quarter of what its axis is too large.
            radial = _clear_radial_speed(-0.25 * axis_change, mean_motion, neighbours)
        self._is_coasting = True
        return np.array([radial, along if abs(along) >= _SMALLEST_CHANGE else 0.0, 0.0])


def _clear_radial_speed(height: float, mean_motion: float, neighbours: list[FloatArray]) -> float:
    """Return the smallest radial speed whose ellipse stays clear of the neighbours, m/s.

    Parameters
    ----------
    height
        Height of the chaser above the station, m; it has no velocity relative to the neighbours.
    mean_motion
        rad/s.
    neighbours
        Their positions relative to the chaser in its RTN frame, which they hold, m, shape (3,).
    """
    if not neighbours:
        return 0.0
    sine, cosine = np.sin(_PHASES), np.cos(_PHASES)
    clearances = []
    for speed in _RADIAL_SPEEDS.tolist():
        size = speed / mean_motion
        # Clohessy-Wiltshire without drift, from (height, 0).
        path = np.stack(
            (
                height * (cosine - 1.0) + size * sine,
                2.0 * size * (cosine - 1.0) - 2.0 * height * sine,
                np.zeros(len(_PHASES)),
            ),
            axis=1,
        )
        distances = np.linalg.norm(path[:, np.newaxis] - np.array(neighbours), axis=2)
        clearances.append(float(distances.min()))
        if clearances[-1] >= _CLEAR_DISTANCE:
            break
    return float(_RADIAL_SPEEDS[int(np.argmax(clearances))])


def _mean_motion(own_gcrf: FloatArray) -> float:
    """Return the rate at which the own RTN frame turns, rad/s."""
    return norm(np.cross(own_gcrf[:3], own_gcrf[3:])) / float(own_gcrf[:3] @ own_gcrf[:3])


def _latitude(position: FloatArray, own: FloatArray) -> float:
    """Return the argument of latitude of a position in the orbital plane of a state, rad."""
    normal = np.cross(own[:3], own[3:])
    node = np.cross([0.0, 0.0, 1.0], normal)
    across = np.cross(normal, node)
    return math.atan2(float(position @ across) / norm(across), float(position @ node) / norm(node))
