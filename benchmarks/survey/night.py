"""Nights of drifting bubbles, drawn by seed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.constants import GM_EARTH, WGS84_SEMI_MAJOR_AXIS
from vtff_dynamics.frames.earth import earth_rotation_angle
from vtff_dynamics.orbit.mean_elements import osculating_elements, state_from_elements
from vtff_dynamics.time.timescales import GpsTime, parse_epoch
from vtff_dynamics.vectors import FloatArray
from vtff_sim_bridge.atmosphere.irregularity import IrregularityRegion

ORBITS = 4


@dataclass(frozen=True, eq=False)
class Night:
    """A night.

    Attributes
    ----------
    start
        Epoch.
    chief_mean
        Mean elements of the chief, m and rad, shape (6,).
    regions
        True bubbles.
    seed
        Of everything drawn.
    """

    start: GpsTime
    chief_mean: FloatArray
    regions: tuple[IrregularityRegion, ...]
    seed: int

    @property
    def period(self) -> float:
        """Period of the orbit, s."""
        return 2.0 * math.pi * math.sqrt(float(self.chief_mean[0]) ** 3 / GM_EARTH)

    @property
    def duration(self) -> float:
        """Duration of the survey, s."""
        return ORBITS * self.period

    def state_chief_gcrf(self) -> FloatArray:
        """Return the state of the chief at the start, m and m/s, shape (6,)."""
        return state_from_elements(osculating_elements(self.chief_mean))


def draw_night(seed: int, bubbles: int = 3) -> Night:
    """Return a night with some bubbles between 20 and 1 h local time; orbit and plasma drawn."""
    random = np.random.default_rng(np.random.SeedSequence((seed, 2019)))
    start = parse_epoch("2016-03-21T01:00:00 GPS") + 60.0 * float(random.integers(0, 1440))
    altitude = random.uniform(380e3, 450e3)
    inclination = math.radians(random.uniform(8.0, 14.0))
    node = random.uniform(0.0, 2.0 * math.pi)
    # Greenwich and Sun: the chief begins two hours of local time before the bubbles.
    first_hour = random.uniform(20.0, 20.6)
    longitude_sun = _longitude_of_hour(start, first_hour - 2.0)
    inertial = longitude_sun + earth_rotation_angle(start)
    chief = np.array(
        [WGS84_SEMI_MAJOR_AXIS + altitude, inertial - node, 0.0, 0.0, inclination, node]
    )
    # A tenth of a percent of eccentricity, anywhere.
    chief[2:4] = 1e-3 * random.uniform(-1.0, 1.0, 2)
    drift = random.uniform(40.0, 140.0)
    regions = []
    hour = first_hour
    for number in range(bubbles):
        width = random.uniform(0.3, 0.7)
        regions.append(
            IrregularityRegion(
                f"bubble_{number + 1}",
                math.radians(-20.0),
                math.radians(20.0),
                hour % 24.0,
                (hour + width) % 24.0,
                250e3,
                600e3,
                float(random.uniform(0.35, 0.7)),
                0.5,
                drift_east=float(drift + random.normal(0.0, 4.0)),
            )
        )
        hour += width + random.uniform(0.5, 1.2)
    return Night(start, chief, tuple(regions), seed)


def _longitude_of_hour(time: GpsTime, hour: float) -> float:
    day = 86_400 * 10**9
    universal = time.to_unix_nanoseconds() % day / day * 24.0
    return (hour - universal) * math.pi / 12.0
