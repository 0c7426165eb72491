"""Flight of a cluster in which every chaser decides alone, against nonlinear motion under J2."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field

import numpy as np

from vtff_control.guidance.cluster_member import ClusterMember
from vtff_control.guidance.neighbour_tracker import NeighbourTracker
from vtff_control.guidance.potential_field import PotentialField, equilibrium_distance
from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.frames.rtn import deputy_state_gcrf, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.elements import ClassicalElements
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.orbit.mean_elements import elements_from_state, mean_elements, secular_rates
from vtff_dynamics.relative.separation import closest_on_path
from vtff_dynamics.vectors import FloatArray, norm

__all__ = [
    "LEAD_RADIUS",
    "ClusterFlight",
    "Decay",
    "RangeSensor",
    "draw_starts",
    "fly_cluster",
]

LEAD_RADIUS = 6678e3  # m, table 1 of the paper
_STEP = 10.0  # s between detections
_REPLAN = 30.0  # s, of the paper
_WATCH_FROM = 2.0  # orbits; before, members still come from afar


@dataclass(frozen=True)
class RangeSensor:
    """Emulated sensor of range and direction.

    Parameters
    ----------
    range_limit
        m.
    range_sigma
        m.
    direction_sigma
        rad.
    dropout
        Probability that a detection is missing.
    outage
        Start and end, s, of a failure of the sensor of the first chaser.
    """

    range_limit: float = 10e3
    range_sigma: float = 0.3
    direction_sigma: float = 2e-4
    dropout: float = 0.05
    outage: tuple[float, float] = (math.inf, math.inf)


@dataclass(frozen=True)
class Decay:
    """A failure of the last chaser, which thrusts no more and decays.

    Parameters
    ----------
    time
        s.
    deceleration
        Against its motion, m/s2.
    watched
        Whether the others watch for members that leave the station.
    """

    time: float
    deceleration: float
    watched: bool = True


@dataclass(frozen=True, eq=False)
class ClusterFlight:
    """Flight of a lead, which never thrusts, and chasers.

    Attributes
    ----------
    times
        s, shape (k,).
    positions
        In the RTN frame of the lead, which is the first, m, shape (k, m, 3).
    impulses
        Velocity changes of the chasers, m/s, shape (k, m - 1, 3).
    """

    times: FloatArray
    positions: FloatArray
    impulses: FloatArray
    period: float = field(default=2.0 * math.pi * math.sqrt(LEAD_RADIUS**3 / GM_EARTH))

    @property
    def sides(self) -> FloatArray:
        """Distances of all pairs, m, shape (k, pairs)."""
        pairs = itertools.combinations(range(self.positions.shape[1]), 2)
        sides: FloatArray = np.array(
            [np.linalg.norm(self.positions[:, j] - self.positions[:, i], axis=1) for i, j in pairs]
        ).T
        return sides

    @property
    def closest(self) -> float:
        """Smallest distance of a pair, m."""
        pairs = itertools.combinations(range(self.positions.shape[1]), 2)
        return min(closest_on_path(self.positions[:, j] - self.positions[:, i]) for i, j in pairs)

    @property
    def last_orbit(self) -> slice:
        """Samples of the last orbit."""
        return slice(int(np.searchsorted(self.times, self.times[-1] - self.period)), None)

    def settling_time(self, share: float = 0.025) -> float:
        """Return the time after which all sides stay within a share of the equilibrium, s."""
        wanted = equilibrium_distance()
        outside = np.flatnonzero((np.abs(self.sides / wanted - 1.0) > share).any(axis=1))
        if not len(outside):
            return 0.0
        last = int(outside[-1]) + 1
        return float(self.times[last]) if last < len(self.times) else math.inf

    def velocity_change(self, start: float, end: float) -> FloatArray:
        """Return the sum of the impulses of each chaser in a span, m/s, shape (m - 1,)."""
        chosen = (self.times >= start) & (self.times < end)
        change: FloatArray = np.linalg.norm(self.impulses[chosen], axis=2).sum(axis=0)
        return change


def draw_starts(
    seed: int, chasers: int = 2, extent: float = 3e3, least: float = 1e3, dimensions: int = 2
) -> FloatArray:
    """Draw positions of chasers about the lead, m, shape (chasers, 3).

    Parameters
    ----------
    seed
        Seed of the draw.
    chasers
        Their number.
    extent
        Largest distance from the lead, m.
    least
        Smallest distance of any two, m.
    dimensions
        2 for the orbital plane, 3 for all of space.
    """
    generator = np.random.default_rng(seed)
    while True:
        positions = np.zeros((chasers + 1, 3))
        positions[1:, :dimensions] = generator.uniform(-extent, extent, (chasers, dimensions))
        pairs = itertools.combinations(positions, 2)
        inside = np.linalg.norm(positions, axis=1).max() <= extent
        if inside and min(norm(b - a) for a, b in pairs) >= least:
            return positions[1:]


def fly_cluster(
    starts_rtn: FloatArray,
    orbits: float = 4.0,
    sensor: RangeSensor | None = None,
    guidance: PotentialField | None = None,
    seed: int = 0,
    decay: Decay | None = None,
) -> ClusterFlight:
    """Fly a cluster; every chaser starts on a circular orbit of its own radius, as in the paper.

    Parameters
    ----------
    starts_rtn
        Positions about the lead, m, shape (m, 3).
    orbits
        Length.
    sensor
        Sensor by which a chaser sees the others; default: true positions, also every 10 s.
    guidance
        Guidance of every chaser.
    seed
        Seed of the sensors.
    decay
        Failure of the last chaser; default none.
    """
    exact = sensor is None
    eye = RangeSensor(1e9, 1e-3, 1e-7, 0.0) if sensor is None else sensor
    generator = np.random.default_rng(seed)
    lead = ClassicalElements(LEAD_RADIUS, 0.0, math.radians(51.6), 0.0, 0.0, 0.0).to_state()
    states = np.array([lead, *(_circular(lead, position) for position in starts_rtn)])
    count = int(orbits * 2.0 * math.pi * math.sqrt(LEAD_RADIUS**3 / GM_EARTH) / _STEP)
    positions = np.empty((count, len(states), 3))
    impulses = np.zeros((count, len(starts_rtn), 3))
    rates = secular_rates(mean_elements(elements_from_state(lead)))
    station_period = 2.0 * math.pi / float(rates[1])
    is_watched = decay is not None and decay.watched
    members = [
        ClusterMember(
            NeighbourTracker(eye.range_sigma, eye.direction_sigma),
            station_period,
            guidance,
            _WATCH_FROM * station_period if is_watched else math.inf,
        )
        for _ in starts_rtn
    ]
    every = round(_REPLAN / _STEP)
    for index in range(count):
        time = _STEP * index
        rotation = rotation_gcrf_to_rtn(states[0])
        positions[index] = (states[:, :3] - states[0, :3]) @ rotation.T
        for craft, member in enumerate(members, start=1):
            own = states[craft]
            blind = craft == 1 and eye.outage[0] <= time < eye.outage[1]
            to_rtn = rotation_gcrf_to_rtn(own)
            seen = [] if blind else _detections(states, craft, to_rtn, eye, exact, generator)
            member.detect(time, own, np.array(seen))
            if index % every == 0 and index:
                impulses[index, craft - 1] = member.impulse(own)
        if decay is not None and time >= decay.time:
            impulses[index, -1] = 0.0
            motion = states[-1, 3:] / norm(states[-1, 3:])
            states[-1, 3:] -= _STEP * decay.deceleration * motion
        for craft, member in enumerate(members, start=1):
            impulse = impulses[index, craft - 1]
            if impulse.any():
                states[craft, 3:] += rotation_gcrf_to_rtn(states[craft]).T @ impulse
                member.add_impulse(impulse)
        states = free_flight(states, [0.0, _STEP])[-1]
    return ClusterFlight(_STEP * np.arange(count, dtype=float), positions, impulses)


def _circular(lead: FloatArray, position: FloatArray) -> FloatArray:
    """Return the state on a circular orbit, in the direction of the lead's, at a position."""
    place = deputy_state_gcrf(lead, np.concatenate((position, np.zeros(3))))[:3]
    normal = np.cross(lead[:3], lead[3:])
    along = np.cross(normal, place)
    return np.concatenate((place, math.sqrt(GM_EARTH / norm(place)) * along / norm(along)))


def _detections(
    states: FloatArray,
    craft: int,
    to_rtn: FloatArray,
    sensor: RangeSensor,
    exact: bool,
    generator: np.random.Generator,
) -> list[FloatArray]:
    """Return the positions that a chaser sees in its RTN frame, m."""
    seen = []
    for other in range(len(states)):
        if other == craft:
            continue
        position = to_rtn @ (states[other, :3] - states[craft, :3])
        distance = norm(position)
        if exact:
            seen.append(position)
            continue
        # All is drawn for every neighbour, so that a dropout changes nothing of later draws.
        dropped = generator.random() < sensor.dropout
        error = generator.standard_normal(4)
        if dropped or distance > sensor.range_limit:
            continue
        turned = position / distance + sensor.direction_sigma * error[:3]
        length = distance + sensor.range_sigma * float(error[3])
        seen.append(length * turned / norm(turned))
    return seen
