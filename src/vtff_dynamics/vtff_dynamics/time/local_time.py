"""Local time of a longitude."""

from __future__ import annotations

import math

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND, SECONDS_PER_DAY
from vtff_dynamics.time.timescales import GpsTime

__all__ = ["mean_solar_local_time_hours"]


def mean_solar_local_time_hours(time: GpsTime, longitude: float) -> float:
    """Return the mean solar time at a longitude (rad, east positive), hours in [0, 24).

    It is UTC plus longitude / 15 deg per hour; UT1 - UTC (below 0.9 s) is neglected.
    """
    day = SECONDS_PER_DAY * NANOSECONDS_PER_SECOND
    return (time.to_unix_nanoseconds() % day / day * 24.0 + longitude * 12.0 / math.pi) % 24.0
