"""Where and when the spacecraft of a formation next cross walls of drifting plasma.

The orbits are flown under J2 with the Earth turning below; a wall moves with its drift.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_control.survey.walls import Wall
from vtff_dynamics.constants import EARTH_ROTATION_RATE
from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray

__all__ = ["GroundTrack", "PredictedCrossing", "fly_ground_track", "predict_crossings"]


@dataclass(frozen=True, eq=False)
class GroundTrack:
    """Coming motion of the spacecraft without thrust.

    Attributes
    ----------
    times
        s, shape (n,).
    names
        Spacecraft, the chief first; m of them.
    states_gcrf
        m and m/s, shape (n, m, 6).
    longitudes
        rad, unwrapped, shape (n, m).
    """

    times: FloatArray
    names: tuple[str, ...]
    states_gcrf: FloatArray
    longitudes: FloatArray


@dataclass(frozen=True)
class PredictedCrossing:
    """A crossing to come.

    Attributes
    ----------
    wall
        Number of the wall.
    is_entry
        Whether the irregularity begins there, seen along the flight.
    spacecraft
        Name.
    time, time_sigma
        s.
    longitude
        rad, not wrapped.
    mean_latitude
        Argument of latitude of the spacecraft then, rad in [-pi, pi].
    """

    wall: int
    is_entry: bool
    spacecraft: str
    time: float
    time_sigma: float
    longitude: float
    mean_latitude: float


def fly_ground_track(
    states_gcrf: Mapping[str, npt.ArrayLike],
    moment: GpsTime,
    time: float,
    horizon: float,
    step: float = 20.0,
) -> GroundTrack:
    """Return the coming motion of spacecraft over the turning Earth.

    Parameters
    ----------
    states_gcrf
        State of each spacecraft now, m and m/s, shape (6,).
    moment
        Now.
    time
        Now as s in the time scale of the survey.
    horizon
        How far ahead, s.
    step
        Step of the integration, s.
    """
    elapsed = np.arange(0.0, horizon + step, step)
    states = free_flight(np.array(list(states_gcrf.values()), dtype=float), elapsed)
    fixed = states[..., :3] @ rotation_gcrf_to_itrf(moment).T
    # The pole moves by metres in a night; the Earth turns evenly.
    longitudes = np.arctan2(fixed[..., 1], fixed[..., 0]) - EARTH_ROTATION_RATE * elapsed[:, None]
    return GroundTrack(time + elapsed, tuple(states_gcrf), states, np.unwrap(longitudes, axis=0))


def predict_crossings(track: GroundTrack, walls: Mapping[int, Wall]) -> list[PredictedCrossing]:
    """Return all crossings of walls along a motion, in order of time.

    Parameters
    ----------
    track
        Coming motion of the spacecraft.
    walls
        Walls by their numbers.
    """
    crossings = []
    for number, wall in walls.items():
        places = np.array([wall.longitude_at(time) for time in track.times.tolist()])
        for craft, name in enumerate(track.names):
            ahead = (track.longitudes[:, craft] - places) / (2.0 * math.pi)
            turns = np.floor(ahead)
            for index in np.flatnonzero(np.diff(turns)).tolist():
                part = (turns[index + 1] - ahead[index]) / (ahead[index + 1] - ahead[index])
                crossings.append(_crossing(track, wall, number, craft, name, index + float(part)))
    return sorted(crossings, key=lambda crossing: (crossing.time, crossing.spacecraft))


def _crossing(
    track: GroundTrack, wall: Wall, number: int, craft: int, name: str, place: float
) -> PredictedCrossing:
    index = int(place)
    part = place - index
    step = float(track.times[index + 1] - track.times[index])
    time = float(track.times[index]) + part * step
    rate = float(track.longitudes[index + 1, craft] - track.longitudes[index, craft]) / step
    speed = abs(rate * wall.radius - wall.drift)
    return PredictedCrossing(
        number,
        wall.is_entry,
        name,
        time,
        wall.sigma_at(time) / speed,
        wall.longitude_at(time),
        _argument_of_latitude(track.states_gcrf[index, craft], part * step),
    )


def _argument_of_latitude(state: FloatArray, elapsed: float) -> float:
    """Return the argument of latitude some seconds after a state, rad."""
    position, velocity = state[:3], state[3:]
    normal = np.cross(position, velocity)
    radius_squared = float(position @ position)
    rate = float(np.linalg.norm(normal)) / radius_squared
    normal = normal / np.linalg.norm(normal)
    node = np.array([-normal[1], normal[0], 0.0])
    node /= np.linalg.norm(node)
    argument = math.atan2(float(position @ np.cross(normal, node)), float(position @ node))
    turned = argument + rate * elapsed
    return (turned + math.pi) % (2.0 * math.pi) - math.pi
