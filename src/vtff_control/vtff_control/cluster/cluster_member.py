"""Guidance of one chaser of a cluster, from its own fix and its own sensor and nothing else.

It tracks what its sensor sees, climbs the potential of the neighbours that it follows, of places
at rest (`vtff_control.cluster.potential_field`) or of orbits (`elements_field`), and leaves alone
the one that leaves the station.

A chaser that sees nobody any more waits where orbits hold the cluster. At rest it is held at a
place where it does not stay without thrust. It stops to hold, and gives its orbit the period of the
station, a parameter of the mission: it goes round in an ellipse instead of drifting away, until its
sensor sees the others again. A radial velocity moves the ellipse off the places where the others
were seen last.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_control.cluster.elements_field import ElementsField
from vtff_control.cluster.neighbour_tracker import NeighbourTracker, Track, fly_neighbours
from vtff_control.cluster.potential_field import PotentialField
from vtff_dynamics.frames.rtn import angular_velocity_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.mean_elements import elements_from_state, mean_elements, secular_rates
from vtff_dynamics.relative.motion import hcw_input_matrix
from vtff_dynamics.vectors import FloatArray, cross, norm

__all__ = ["ClusterMember", "MemberSetting"]

_NORTH = np.array([0.0, 0.0, 1.0])
_DETECTIONS = 3  # after which a track has a velocity
# m in an orbit: twice the size of the cluster. Harmonics beyond J2 move a station by half a
# kilometre from one orbit to the next.
_LARGEST_DRIFT = 2e3
_SMALLEST_CHANGE = 1e-3  # m/s
_BLIND_AFTER = 120.0  # s without any detection; held neighbours have left their tracks by 20 m then
_CLEAR_DISTANCE = 700.0  # m: 500 m, and what the others move meanwhile
_RADIAL_SPEEDS = np.array(sorted(np.linspace(-2.5, 2.5, 51), key=abs))  # m/s
_PHASES = np.linspace(0.0, 2.0 * math.pi, 73)


@dataclass(frozen=True)
class MemberSetting:
    """Engine and rhythm of a chaser.

    Parameters
    ----------
    step
        Length of a thrust, s.
    delay
        From a look of the sensor to the start of the thrust that answers it, s.
    decision_interval
        Between two thrusts, s.
    largest_acceleration
        On each axis, m/s2.

    Raises
    ------
    ValueError
        If a value is out of its range; the message names it.
    """

    step: float = 10.0
    delay: float = 10.0
    decision_interval: float = 30.0
    largest_acceleration: float = 1.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not (self.step > 0.0 and self.largest_acceleration > 0.0):
            raise ValueError("step and largest_acceleration: more than 0 expected")
        if not self.delay >= 0.0:
            raise ValueError(f"delay: 0 s or more expected, got {self.delay:g}")
        if self.decision_interval < self.step:
            raise ValueError(
                f"decision_interval: at least the step of {self.step:g} s expected, "
                f"got {self.decision_interval:g}"
            )

    def limited(self, acceleration: FloatArray) -> FloatArray:
        """Return an acceleration with its direction that the engine can give, m/s2, (3,)."""
        cap = self.largest_acceleration
        share = min(1.0, cap / max(float(np.abs(acceleration).max()), 1e-12))
        # The product may be above the limit by what it is rounded.
        return np.clip(share * acceleration, -cap, cap)


class ClusterMember:
    """One chaser; call `step` with every look of the sensor.

    Parameters
    ----------
    tracker
        Tracks of the neighbours, of its own.
    station_period
        Nodal period of the station, s.
    field
        Potential that it climbs at first.
    watch_from
        Time after which a neighbour that leaves the station is followed no more, s; before,
        members still come from afar. Infinite: never.
    setting
        Its engine and its rhythm.

    Attributes
    ----------
    field
        Potential that it climbs; with None it looks on and does not thrust.
    """

    def __init__(
        self,
        tracker: NeighbourTracker,
        station_period: float,
        field: PotentialField | ElementsField | None,
        watch_from: float = math.inf,
        setting: MemberSetting | None = None,
    ) -> None:
        self._tracker = tracker
        self._station_period = station_period
        self.field = field
        self._watch_from = watch_from
        self._setting = MemberSetting() if setting is None else setting
        self._time = math.nan
        self._own_gcrf: FloatArray = np.zeros(6)
        self._decided = math.nan
        self._joins = math.nan
        self._is_coasting = False
        self._thrusts: list[tuple[float, FloatArray]] = []  # start, acceleration; each for a step
        self._last_field: PotentialField | ElementsField | None = None
        self._last_change = np.zeros(3)
        self._thrust_density = PotentialField.acceleration_density
        self._held_thrust = PotentialField.held_thrust

    @property
    def followed(self) -> int:
        """Number of neighbours with a track that has a velocity."""
        return len(self._known_tracks())

    @property
    def is_blind(self) -> bool:
        """Whether no neighbour has been seen for two minutes."""
        return all(track.age > _BLIND_AFTER for track in self._tracker.tracks)

    def step(self, time: float, own_gcrf: FloatArray, positions: npt.ArrayLike) -> FloatArray:
        """Take what the sensor sees and return the thrust.

        Parameters
        ----------
        time
            s.
        own_gcrf
            Own fix, m and m/s, shape (6,).
        positions
            Relative positions in the own RTN frame, m, shape (k, 3), in any order.

        Returns
        -------
        ndarray, shape (3,)
            Acceleration in the own RTN frame over the step that begins `MemberSetting.delay` after
            this time, m/s2.
        """
        field = self._acting_field(time)
        if math.isnan(self._time):
            self._decided = time
        else:
            # Until it decides anew, the others do as they did.
            before = self._last_field or field
            if before is not None:
                self._thrust_density = before.thrust_density(
                    self._last_change, self._setting.decision_interval
                )
                self._held_thrust = before.held_thrust
            self._tracker.predict(
                time - self._time,
                self._own_gcrf,
                self._thrust_density,
                self._held_thrust,
                *self._own_change(self._time, time),
            )
        self._time, self._own_gcrf = time, own_gcrf
        self._tracker.detect(positions)
        acceleration = np.zeros(3)
        is_due = time - self._decided >= self._setting.decision_interval - 1e-6
        if field is not None and is_due:
            self._decided = time
            wanted = self._decide(own_gcrf, field)
            acceleration = self._setting.limited(wanted / self._setting.step)
            self._last_change = self._setting.step * acceleration
            self._thrusts.append((time + self._setting.delay, acceleration))
        self._thrusts = [
            thrust for thrust in self._thrusts if thrust[0] + self._setting.step > time
        ]
        return acceleration

    def _acting_field(self, time: float) -> PotentialField | ElementsField | None:
        """Return the field that is climbed now: orbits are joined from places for it at rest."""
        if not isinstance(self.field, ElementsField):
            self._joins = math.nan
            return self.field
        if math.isnan(self._joins):
            self._joins = time + self.field.spreading_time
        return self.field if time >= self._joins else self.field.at_rest

    def _known_tracks(self) -> list[Track]:
        return [track for track in self._tracker.tracks if track.detections >= _DETECTIONS]

    def _own_change(self, begin: float, end: float) -> tuple[FloatArray, FloatArray]:
        """Return how far and how fast the own thrust has moved the chaser, m and m/s."""
        moved, gained = np.zeros(3), np.zeros(3)
        for start, acceleration in self._thrusts:
            first, last = max(begin, start), min(end, start + self._setting.step)
            if last > first:
                change = (last - first) * acceleration
                gained += change
                moved += (end - 0.5 * (first + last)) * change
        return moved, gained

    def _decide(self, own_gcrf: FloatArray, field: PotentialField | ElementsField) -> FloatArray:
        """Return the velocity change that is wanted now, m/s, shape (3,)."""
        tracks = self._known_tracks()
        # Where they are in the middle of the thrust.
        ahead = self._setting.delay + 0.5 * self._setting.step
        own = np.concatenate(self._own_change(self._time, self._time + ahead))
        fallen = fly_neighbours(own_gcrf, [track.state for track in tracks], ahead)
        effect = hcw_input_matrix(float(angular_velocity_rtn(own_gcrf)[2]), ahead)
        states = [
            state + effect @ track.thrust - own for state, track in zip(fallen, tracks, strict=True)
        ]
        if self.is_blind and field.stays_without_thrust:
            return np.zeros(3)
        if self.is_blind:
            return self._coast(own_gcrf, [state[:3] for state in states])
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
        thrusts = [track.thrust for track in tracks]
        is_new, self._last_field = field is not self._last_field, field
        if is_new and isinstance(field, ElementsField):
            return field.join(states, own_gcrf, followed, thrusts)
        interval = self._setting.decision_interval
        return field.impulse(states, own_gcrf, interval, followed, thrusts)

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


def _latitude(position: FloatArray, own: FloatArray) -> float:
    """Return the argument of latitude of a position in the orbital plane of a state, rad."""
    normal = cross(own[:3], own[3:])
    node = cross(_NORTH, normal)
    across = cross(normal, node)
    return math.atan2(float(position @ across) / norm(across), float(position @ node) / norm(node))
