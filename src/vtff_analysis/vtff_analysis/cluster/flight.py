"""Flight of a cluster in which every chaser decides alone, against nonlinear motion under J2."""

from __future__ import annotations

import dataclasses
import itertools
import math
from dataclasses import dataclass

import numpy as np

from vtff_analysis.cluster.cluster_flight import LEAD_RADIUS, ClusterFlight
from vtff_control.cluster.cluster_member import ClusterMember, MemberSetting
from vtff_control.cluster.elements_field import ElementsField
from vtff_control.cluster.neighbour_tracker import NeighbourTracker
from vtff_control.cluster.potential_field import PotentialField
from vtff_dynamics.constants import GM_EARTH, NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.rtn import deputy_state_gcrf, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.elements import ClassicalElements
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.orbit.mean_elements import elements_from_state, mean_elements, secular_rates
from vtff_dynamics.vectors import FloatArray, norm
from vtff_sim_bridge.on_board.own_fix import FixErrors, OwnFixEmulation
from vtff_sim_bridge.on_board.range_sensor import RangeSensor, RangeSensorEmulation

__all__ = [
    "Decay",
    "draw_starts",
    "fly_cluster",
]

_STEP = 10.0  # s between detections
_WATCH_FROM = 2.0  # orbits; before, members still come from afar


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
    fix: FixErrors | None = None,
    orbits_from: float = math.inf,
    held: ElementsField | None = None,
) -> ClusterFlight:
    """Fly a cluster; every chaser starts on a circular orbit of its own radius, as in the paper.

    Parameters
    ----------
    starts_rtn
        Positions about the lead, m, shape (m, 3).
    orbits
        Length.
    sensor
        Sensor by which a chaser sees the others; the first chaser's alone has its outage.
    guidance
        Guidance of every chaser.
    seed
        Seed of sensors and fixes.
    decay
        Failure of the last chaser; default none.
    fix
        Errors of the own fix of every chaser.
    orbits_from
        Time from which the cluster is held by its orbits and not at rest, s.
    held
        Guidance of every chaser from then on.
    """
    held = ElementsField() if held is None else held
    eye = RangeSensor() if sensor is None else sensor
    fix = FixErrors() if fix is None else fix
    lead = ClassicalElements(LEAD_RADIUS, 0.0, math.radians(51.6), 0.0, 0.0, 0.0).to_state()
    states = np.array([lead, *(_circular(lead, position) for position in starts_rtn)])
    count = int(orbits * 2.0 * math.pi * math.sqrt(LEAD_RADIUS**3 / GM_EARTH) / _STEP)
    positions = np.empty((count, len(states), 3))
    impulses = np.zeros((count + 1, len(starts_rtn), 3))
    rates = secular_rates(mean_elements(elements_from_state(lead)))
    station_period = 2.0 * math.pi / float(rates[1])
    is_watched = decay is None or decay.watched
    names = ["lead", *(f"chaser {number}" for number in range(1, len(states)))]
    chasers = []
    for number, name in enumerate(names[1:]):
        seeing = eye if number == 0 else dataclasses.replace(eye, outage=(math.inf, math.inf))
        chasers.append(
            (
                ClusterMember(
                    NeighbourTracker(eye.range_sigma, eye.direction_sigma),
                    station_period,
                    PotentialField() if guidance is None else guidance,
                    _WATCH_FROM * station_period if is_watched else math.inf,
                    MemberSetting(step=_STEP, delay=_STEP),
                ),
                RangeSensorEmulation(seeing, name, seed),
                OwnFixEmulation(fix, name, seed),
            )
        )
    for index in range(count):
        time = _STEP * index
        nanoseconds = round(time * NANOSECONDS_PER_SECOND)
        positions[index] = (states[:, :3] - states[0, :3]) @ rotation_gcrf_to_rtn(states[0]).T
        named = dict(zip(names, states, strict=True))
        for craft, (member, seen, own_fix) in enumerate(chasers, start=1):
            others = {name: state for name, state in named.items() if name != names[craft]}
            own = own_fix.measure(nanoseconds, states[craft])
            if time >= orbits_from:
                member.field = held
            detections = seen.detect(nanoseconds, states[craft], others)
            impulses[index + 1, craft - 1] = _STEP * member.step(time, own, detections)
        if decay is not None and time >= decay.time:
            impulses[index : index + 2, -1] = 0.0
            motion = states[-1, 3:] / norm(states[-1, 3:])
            states[-1, 3:] -= _STEP * decay.deceleration * motion
        # A thrust over the step moves a chaser as its halves at both ends.
        halves = [
            0.5 * rotation_gcrf_to_rtn(state).T @ impulse
            for state, impulse in zip(states[1:], impulses[index], strict=True)
        ]
        states[1:, 3:] += halves
        states = free_flight(states, [0.0, _STEP])[-1]
        states[1:, 3:] += halves
    return ClusterFlight(_STEP * np.arange(count, dtype=float), positions, impulses[:count])


def _circular(lead: FloatArray, position: FloatArray) -> FloatArray:
    """Return the state on a circular orbit, in the direction of the lead's, at a position."""
    place = deputy_state_gcrf(lead, np.concatenate((position, np.zeros(3))))[:3]
    normal = np.cross(lead[:3], lead[3:])
    along = np.cross(normal, place)
    return np.concatenate((place, math.sqrt(GM_EARTH / norm(place)) * along / norm(along)))
