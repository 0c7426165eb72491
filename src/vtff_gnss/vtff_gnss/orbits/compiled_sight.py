"""Lines of sight to satellites of broadcast ephemerides, compiled.

The formulas are those of `vtff_gnss.orbits.broadcast_orbit` and `vtff_gnss.orbits.line_of_sight`,
which stay the reference (tests compare them). They are some hundred array operations, which on
the dozen satellites of one epoch cost twenty times what the arithmetic does. `rays_to_motion` has
the order of the reference, so that it is equal to the last bit.
"""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import (
    NANOSECONDS_PER_SECOND,
    SPEED_OF_LIGHT,
    WGS84_FLATTENING,
    WGS84_SEMI_MAJOR_AXIS,
)
from vtff_gnss.constants import EARTH_ROTATION_RATE_BROADCAST

__all__ = ["interpolation_powers", "rays_to_motion", "sights_of_receivers"]

_RATE = EARTH_ROTATION_RATE_BROADCAST
_ECCENTRICITY_SQUARED = WGS84_FLATTENING * (2.0 - WGS84_FLATTENING)
_POLAR_AXIS = WGS84_SEMI_MAJOR_AXIS * (1.0 - WGS84_FLATTENING)
_SECOND_ECCENTRICITY_SQUARED = _ECCENTRICITY_SQUARED / (1.0 - _ECCENTRICITY_SQUARED)
_TWO_PI = 2.0 * math.pi


@compiled
def sights_of_receivers(  # type: ignore[no-untyped-def]
    elements, toe, toc, time, offset, position, velocity, travel_time, iterations, tolerance
):
    """Return the lines of sight of receivers to satellites.

    Parameters
    ----------
    elements : ndarray, shape (n, 20)
        Elements of the satellites in the order of `EphemerisTable.elements`.
    toe, toc : ndarray of int64, shape (n,)
        Reference times of orbit and clock, ns since 1980-01-06.
    time : int
        Time of reception, GPS, ns, but for
    offset : ndarray, shape (m,)
        the rest of it for each receiver, s.
    position, velocity : ndarray, shape (m, 3)
        Antenna at reception, ITRF, m and m/s.
    travel_time : float
        Satellite states are evaluated so long before reception, s.
    iterations : int
        Most iterations of Kepler's equation.
    tolerance : float
        Its last correction, rad.

    Returns
    -------
    ndarray, shape (16, m, n)
        Travel time, range, range rate, direction (3), elevation, position (3) and velocity (3) of
        the satellite, its clock offset and drift, azimuth; units as in `LineOfSight`.
    """
    receivers, satellites = len(offset), len(toe)
    result = np.empty((16, receivers, satellites))
    angle = _RATE * travel_time
    flight = math.cos(angle), math.sin(angle)
    orbit = np.empty(9)
    for m in range(receivers):
        receiver = _receiver_motion(position[m], velocity[m])
        axes = _ellipsoid_normal(position[m, 0], position[m, 1], position[m, 2])
        for s in range(satellites):
            since_toe = (time - toe[s]) / NANOSECONDS_PER_SECOND + (offset[m] - travel_time)
            since_toc = (time - toc[s]) / NANOSECONDS_PER_SECOND + (offset[m] - travel_time)
            clock, drift = _satellite_state(
                elements[s], since_toe, since_toc, iterations, tolerance, orbit
            )
            east, north, up = _write_ray(
                result, m, s, orbit, clock, drift, receiver, axes, travel_time, flight
            )
            result[6, m, s] = math.atan2(up, math.sqrt(east * east + north * north))
            result[15, m, s] = math.atan2(east, north) % _TWO_PI
    return result


@compiled
def interpolation_powers(since, offset, interval):  # type: ignore[no-untyped-def]
    """Return what polynomials of degree 5 are multiplied with to get values and derivatives.

    Parameters
    ----------
    since : float
        Time since the beginning of the interval, s, but for
    offset : ndarray, shape (k,)
        the rest of it, s.
    interval : float
        Length of the interval, which is the unit of the argument of the polynomials, s.

    Returns
    -------
    ndarray, shape (3 k, 6)
        Powers 0 to 5 of the k times; first derivatives of these; second derivatives.
    """
    count = len(offset)
    powers = np.zeros((3 * count, 6))
    for k in range(count):
        s = (since + offset[k]) / interval
        powers[k, 0] = 1.0
        powers[k, 1] = s
        for exponent in range(2, 6):
            powers[k, exponent] = powers[k, exponent - 1] * s
        for exponent in range(1, 6):
            factor = exponent / interval
            powers[count + k, exponent] = powers[k, exponent - 1] * factor
            powers[2 * count + k, exponent] = powers[count + k, exponent - 1] * factor
    return powers


@compiled
def rays_to_motion(motion, position, velocity, geodetic, travel_time):  # type: ignore[no-untyped-def]
    """Return the rays from receivers to satellites whose motion is known near to transmission.

    Parameters
    ----------
    motion : ndarray, shape (4, 3 k, n)
        Position (3, m) and clock offset (s) of n satellites, so long before the k receptions as
    travel_time : float
        tells, s; then first and second derivatives (see `interpolation_powers`).
    position, velocity : ndarray, shape (k, 3)
        Antenna at reception, ITRF, m and m/s.
    geodetic : ndarray, shape (k, 3)
        Geodetic latitude and longitude (rad) of the antenna, and its height.

    Returns
    -------
    ndarray, shape (15, k, n)
        Rows of `sights_of_receivers` but for the azimuth, which is the last.
    """
    count, satellites = len(position), motion.shape[2]
    result = np.empty((15, count, satellites))
    angle = _RATE * travel_time
    flight = math.cos(angle), math.sin(angle)
    orbit = np.empty(9)
    for k in range(count):
        receiver = _receiver_motion(position[k], velocity[k])
        latitude, longitude = geodetic[k, 0], geodetic[k, 1]
        zx = math.cos(latitude) * math.cos(longitude)
        zy = math.cos(latitude) * math.sin(longitude)
        equatorial = math.hypot(zx, zy)
        cosine_lon, sine_lon = 1.0, 0.0
        if equatorial >= 1e-12:
            scale = 1.0 / equatorial
            cosine_lon, sine_lon = zx * scale, zy * scale
        axes = equatorial, math.sin(latitude), cosine_lon, sine_lon
        for s in range(satellites):
            for component in range(3):
                orbit[component] = motion[component, k, s]
                orbit[3 + component] = motion[component, count + k, s]
                orbit[6 + component] = motion[component, 2 * count + k, s]
            clock, drift = motion[3, k, s], motion[3, count + k, s]
            east, north, up = _write_ray(
                result, k, s, orbit, clock, drift, receiver, axes, travel_time, flight
            )
            result[6, k, s] = math.atan2(up, math.hypot(east, north))
    return result


@compiled
def _receiver_motion(position, velocity):  # type: ignore[no-untyped-def]
    """Return position, and velocity in axes that do not rotate, of a receiver as six numbers."""
    x, y, z = position[0], position[1], position[2]
    return x, y, z, velocity[0] - _RATE * y, velocity[1] + _RATE * x, velocity[2]


@compiled
def _write_ray(  # type: ignore[no-untyped-def]
    result, k, s, orbit, clock, drift, receiver, axes, travel_time, flight
):
    """Write the ray from a receiver to a satellite but for its angles; return its direction.

    Parameters
    ----------
    result : ndarray, shape (15 or more, m, n)
        Rows of `sights_of_receivers`, of which column `k`, `s` is written.
    orbit : ndarray, shape (9,)
        Position, velocity and acceleration of the satellite, ITRF, m, m/s, m/s2, and
    clock, drift : float
        its clock (s), so long before the reception as
    travel_time : float
        tells, s.
    receiver : tuple of 6 float
        See `_receiver_motion`.
    axes : tuple of 4 float
        See `_ellipsoid_normal`.
    flight : tuple of 2 float
        Cosine and sine of the angle by which the Earth rotates in `travel_time`.

    Returns
    -------
    east, north, up : float
        Unit vector from the receiver to the satellite.
    """
    rx, ry, rz, rvx, rvy, rvz = receiver
    equatorial, polar, cosine_lon, sine_lon = axes
    cosine_flight, sine_flight = flight
    # Derivatives in axes that do not rotate and coincide with the fixed ones at reception.
    vx, vy = orbit[3] - _RATE * orbit[1], orbit[4] + _RATE * orbit[0]
    ax, ay = orbit[6] - _RATE * orbit[4], orbit[7] + _RATE * orbit[3]
    ax, ay = ax - _RATE * vy, ay + _RATE * vx
    p0x = cosine_flight * orbit[0] + sine_flight * orbit[1] - rx
    p0y = cosine_flight * orbit[1] - sine_flight * orbit[0] - ry
    p0z = orbit[2] - rz
    p1x = -(cosine_flight * vx + sine_flight * vy)
    p1y = -(cosine_flight * vy - sine_flight * vx)
    p1z = -orbit[5]
    p2x = cosine_flight * ax + sine_flight * ay
    p2y = cosine_flight * ay - sine_flight * ax
    p2z = orbit[8]
    delay = 0.0
    for _ in range(2):
        half = 0.5 * delay
        dx = p0x + delay * (p1x + half * p2x)
        dy = p0y + delay * (p1y + half * p2y)
        dz = p0z + delay * (p1z + half * p2z)
        distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        change = dx * (p1x + delay * p2x) + dy * (p1y + delay * p2y)
        change = (change + dz * (p1z + delay * p2z)) / distance
        excess = distance - SPEED_OF_LIGHT * (travel_time + delay)
        delay += excess / (SPEED_OF_LIGHT - change)
    half = 0.5 * delay
    dx = p0x + delay * (p1x + half * p2x)
    dy = p0y + delay * (p1y + half * p2y)
    dz = p0z + delay * (p1z + half * p2z)
    distance = SPEED_OF_LIGHT * (travel_time + delay)
    ux, uy, uz = dx / distance, dy / distance, dz / distance
    svx, svy, svz = -(p1x + delay * p2x), -(p1y + delay * p2y), -(p1z + delay * p2z)
    closing = ux * (svx - rvx) + uy * (svy - rvy) + uz * (svz - rvz)
    along = ux * svx + uy * svy + uz * svz
    x, y, z = dx + rx, dy + ry, dz + rz
    result[0, k, s] = travel_time + delay
    result[1, k, s] = distance
    result[2, k, s] = closing / (1.0 + along / SPEED_OF_LIGHT)
    result[3, k, s], result[4, k, s], result[5, k, s] = ux, uy, uz
    result[7, k, s], result[8, k, s], result[9, k, s] = x, y, z
    result[10, k, s] = svx + _RATE * y
    result[11, k, s] = svy - _RATE * x
    result[12, k, s] = svz
    result[13, k, s] = clock - delay * drift
    result[14, k, s] = drift
    outward = cosine_lon * ux + sine_lon * uy
    east = cosine_lon * uy - sine_lon * ux
    north = equatorial * uz - polar * outward
    return east, north, equatorial * outward + polar * uz


@compiled
def _ellipsoid_normal(x, y, z):  # type: ignore[no-untyped-def]
    """Return cosine and sine of the geodetic latitude, and of the longitude (Bowring 1976)."""
    equatorial = math.sqrt(x * x + y * y)
    if equatorial < 1e-6:
        return 0.0, math.copysign(1.0, z), 1.0, 0.0
    tangent = z / (equatorial * (1.0 - WGS84_FLATTENING))
    across, along = z, equatorial
    for _ in range(3):
        cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
        sine = tangent * cosine
        across = z + _SECOND_ECCENTRICITY_SQUARED * _POLAR_AXIS * sine**3
        along = equatorial - _ECCENTRICITY_SQUARED * WGS84_SEMI_MAJOR_AXIS * cosine**3
        tangent = (1.0 - WGS84_FLATTENING) * across / along
    length = math.sqrt(across * across + along * along)
    return along / length, across / length, x / equatorial, y / equatorial


@compiled
def _satellite_state(element, since_toe, since_toc, iterations, tolerance, orbit):  # type: ignore[no-untyped-def]
    """Fill in position, velocity and acceleration (ITRF); return clock offset and drift."""
    af0, af1, af2 = element[0], element[1], element[2]
    axis, eccentricity = element[3], element[4]
    inclination_rate = element[6]
    cuc, cus, crc = element[9], element[10], element[11]
    crs, cic, cis = element[12], element[13], element[14]
    mean_motion, amplitude, ratio = element[15], element[16], element[17]
    node_rate = element[19]

    mean_anomaly = element[8] + mean_motion * since_toe
    anomaly = mean_anomaly + eccentricity * math.sin(mean_anomaly)
    sine, cosine, correction = 0.0, 1.0, 0.0
    for _ in range(iterations):
        sine, cosine = math.sin(anomaly), math.cos(anomaly)
        correction = mean_anomaly - anomaly + eccentricity * sine
        correction /= 1.0 - eccentricity * cosine
        anomaly += correction
        if abs(correction) < tolerance:
            break
    # The last correction is so small that its first order is exact.
    sine, cosine = sine + cosine * correction, cosine - sine * correction
    inverse = 1.0 / (1.0 - eccentricity * cosine)
    anomaly_rate = mean_motion * inverse

    argument = math.atan2(ratio * sine, cosine - eccentricity) + element[7]
    rate = ratio * anomaly_rate * inverse
    acceleration = -2.0 * rate * eccentricity * sine * inverse * anomaly_rate
    sine_2, cosine_2 = math.sin(2.0 * argument), math.cos(2.0 * argument)
    # Harmonics of the argument of latitude, of the radius and of the inclination.
    du, du_1 = cus * sine_2 + cuc * cosine_2, 2.0 * (cus * cosine_2 - cuc * sine_2)
    dr, dr_1 = crs * sine_2 + crc * cosine_2, 2.0 * (crs * cosine_2 - crc * sine_2)
    di, di_1 = cis * sine_2 + cic * cosine_2, 2.0 * (cis * cosine_2 - cic * sine_2)
    square = 4.0 * rate * rate
    stretch = axis * eccentricity
    radius = axis * (1.0 - eccentricity * cosine) + dr
    radius_rate = stretch * sine * anomaly_rate + dr_1 * rate
    radius_acceleration = anomaly_rate**2 * (
        stretch * cosine - stretch * eccentricity * sine**2 * inverse
    ) + (dr_1 * acceleration - square * dr)
    latitude = argument + du
    u_rate = rate + du_1 * rate
    u_acceleration = acceleration + (du_1 * acceleration - square * du)
    inclination = element[5] + inclination_rate * since_toe + di
    i_rate = inclination_rate + di_1 * rate
    i_acceleration = di_1 * acceleration - square * di

    sine_u, cosine_u = math.sin(latitude), math.cos(latitude)
    sine_i, cosine_i = math.sin(inclination), math.cos(inclination)
    node = element[18] + node_rate * since_toe
    sine_o, cosine_o = math.sin(node), math.cos(node)
    # Components along radius and transverse in the plane, then along the node and ahead of it.
    transverse = radius * u_rate
    radial_2 = radius_acceleration - transverse * u_rate
    transverse_2 = radius * u_acceleration + 2.0 * radius_rate * u_rate
    p_0, q_0 = radius * cosine_u, radius * sine_u
    p_1 = radius_rate * cosine_u - transverse * sine_u
    q_1 = radius_rate * sine_u + transverse * cosine_u
    p_2 = radial_2 * cosine_u - transverse_2 * sine_u
    q_2 = radial_2 * sine_u + transverse_2 * cosine_u
    w_1 = q_0 * i_rate
    w_2 = 2.0 * q_1 * i_rate + q_0 * i_acceleration
    # Along the node, across it in the equator, and north; the node turns.
    across_0, north_0 = q_0 * cosine_i, q_0 * sine_i
    across_1, north_1 = q_1 * cosine_i - w_1 * sine_i, q_1 * sine_i + w_1 * cosine_i
    across_2, north_2 = q_2 * cosine_i - w_2 * sine_i, q_2 * sine_i + w_2 * cosine_i
    along_2 = p_2 - 2.0 * node_rate * across_1 - node_rate**2 * p_0
    across_2 = across_2 + 2.0 * node_rate * p_1 - node_rate**2 * across_0
    along_1, across_1 = p_1 - node_rate * across_0, across_1 + node_rate * p_0
    orbit[0] = p_0 * cosine_o - across_0 * sine_o
    orbit[1] = p_0 * sine_o + across_0 * cosine_o
    orbit[2] = north_0
    orbit[3] = along_1 * cosine_o - across_1 * sine_o
    orbit[4] = along_1 * sine_o + across_1 * cosine_o
    orbit[5] = north_1
    orbit[6] = along_2 * cosine_o - across_2 * sine_o
    orbit[7] = along_2 * sine_o + across_2 * cosine_o
    orbit[8] = north_2
    clock = af0 + since_toc * (af1 + since_toc * af2) + amplitude * sine
    return clock, af1 + 2.0 * af2 * since_toc + amplitude * cosine * anomaly_rate
