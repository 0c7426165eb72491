"""Physical and geodetic constants, each with its source; the only place where they stand."""

from __future__ import annotations

import math

GM_EARTH = 3.986004415e14
"""Gravitational parameter of the Earth, m3/s2 (JGM-3; Tapley et al. 1996, JGR 101, B12)."""

RADIUS_EARTH_JGM3 = 6378136.3
"""Reference radius of the JGM-3 harmonic coefficients, m (Tapley et al. 1996)."""

J2_EARTH = 0.000484169548456 * math.sqrt(5.0)
"""Unnormalised second zonal coefficient of JGM-3, tide system as published (-C20)."""

EARTH_ROTATION_RATE = 2.0 * math.pi * 1.00273781191135448 / 86400.0
"""Rate of the Earth rotation angle, rad/s of UT1 (IERS Conventions 2010, eq. 5.15)."""

WGS84_SEMI_MAJOR_AXIS = 6378137.0
"""Equatorial radius of the WGS-84 ellipsoid, m (NGA.STND.0036, 2014)."""

WGS84_FLATTENING = 1.0 / 298.257223563
"""Flattening of the WGS-84 ellipsoid (NGA.STND.0036, 2014)."""

SPEED_OF_LIGHT = 299792458.0
"""Speed of light in vacuum, m/s (exact, SI)."""

SECONDS_PER_DAY = 86400
"""Seconds in a day of a uniform time scale."""

SECONDS_PER_WEEK = 604800
"""Seconds in a GPS week (IS-GPS-200, section 3.3.4)."""

NANOSECONDS_PER_SECOND = 1_000_000_000
"""Nanoseconds in a second."""

NANOSECONDS_PER_MILLISECOND = 1_000_000
"""Nanoseconds in a millisecond."""

TT_MINUS_GPS_NANOSECONDS = 51_184_000_000
"""TT - GPS, ns: 19 s (TAI - GPS) and 32.184 s (TT - TAI, IAU 1991)."""

UNIX_TIME_OF_GPS_EPOCH = 315_964_800
"""Unix time of 1980-01-06 00:00:00 UTC, s (3657 days of 86400 s; POSIX.1)."""
