"""Rotation between the inertial frame GCRF and the Earth-fixed frame ITRF, and states in both.

- gcrf: geocentric celestial frame, inertial.
- itrf: Earth-fixed frame; velocities and higher derivatives are those seen in that rotating frame.

The rotation is the IERS one (IAU 2000B precession-nutation, Bulletin A).
"""

from __future__ import annotations

import functools
import math

import brahe
import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import (
    EARTH_ROTATION_RATE,
    NANOSECONDS_PER_SECOND,
    SECONDS_PER_DAY,
    UNIX_TIME_OF_GPS_EPOCH,
)
from vtff_dynamics.frames.earth_environment import ensure_earth_orientation
from vtff_dynamics.time.timescales import GpsTime, leap_seconds, leap_seconds_at_unix
from vtff_dynamics.vectors import FloatArray, cross, skew

__all__ = [
    "earth_rotation_angle",
    "kinematic_matrix",
    "kinematics_itrf",
    "right_ascension_from_longitude",
    "rotation_gcrf_to_itrf",
    "state_gcrf_to_itrf",
    "state_itrf_to_gcrf",
]

# The last few epochs are enough for all spacecraft of one simulation step to share them.
_CACHED_EPOCHS = 16

_GPS_EPOCH_MJD = 44244
# 2000-01-01 12:00 counted from 1980-01-06 00:00 in days of 86400 s.
_J2000_NOON_NANOSECONDS = (7300 * 2 + 1) * (SECONDS_PER_DAY // 2) * NANOSECONDS_PER_SECOND


@functools.lru_cache(maxsize=_CACHED_EPOCHS)
def rotation_gcrf_to_itrf(time: GpsTime) -> FloatArray:
    """Return the rotation matrix R with ``position_itrf = R @ position_gcrf``.

    Parameters
    ----------
    time : GpsTime
        Time of the rotation.

    Returns
    -------
    ndarray, shape (3, 3)
        Read-only, because it is shared by all callers that ask for the same time.

    Notes
    -----
    The Earth rotation angle is formed here from integer nanoseconds. That of brahe has steps of
    2e-11 rad (0.15 mm in low orbit), which would show in velocities, and is wrong by up to 1 s of
    rotation on days that end with a leap second.

    References
    ----------
    IERS Conventions (2010), chapter 5, with IAU 2000B precession-nutation.
    """
    ensure_earth_orientation()
    celestial_pole = brahe.bias_precession_nutation(time.to_brahe_epoch())
    rotation: FloatArray = _polar_motion(time) @ np.array(_turn(time)) @ celestial_pole
    rotation.flags.writeable = False
    return rotation


def _turn(time: GpsTime) -> list[list[float]]:
    """Return the rows of the rotation by the Earth rotation angle."""
    angle = earth_rotation_angle(time)
    cosine, sine = math.cos(angle), math.sin(angle)
    return [[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]]


def earth_rotation_angle(time: GpsTime) -> float:
    """Return the Earth rotation angle, rad in [0, 2 pi).

    References
    ----------
    IERS Conventions (2010), eq. (5.15).
    """
    day = SECONDS_PER_DAY * NANOSECONDS_PER_SECOND
    offset = round(_ut1_minus_gps(time) * NANOSECONDS_PER_SECOND)
    # UT1 since 2000-01-01 12:00; its whole days are taken off before the loss of digits.
    days, rest = divmod(time.nanoseconds + offset - _J2000_NOON_NANOSECONDS, day)
    fraction = rest / day
    revolutions = 0.7790572732640 + fraction + 0.00273781191135448 * (days + fraction)
    return 2.0 * math.pi * (revolutions % 1.0)


def _ut1_minus_gps(time: GpsTime) -> float:
    """Return UT1 - GPS, s: continuous through leap seconds, unlike UT1 - UTC."""
    utc = time.nanoseconds - leap_seconds(time) * NANOSECONDS_PER_SECOND
    day, rest = divmod(utc, SECONDS_PER_DAY * NANOSECONDS_PER_SECOND)
    fraction = rest / (SECONDS_PER_DAY * NANOSECONDS_PER_SECOND)
    start, end = _ut1_minus_gps_at_midnight(day), _ut1_minus_gps_at_midnight(day + 1)
    return start + fraction * (end - start)


@functools.lru_cache(maxsize=_CACHED_EPOCHS)
def _ut1_minus_gps_at_midnight(day: int) -> float:
    """Return UT1 - GPS, s, at 00:00 UTC of a day counted from 1980-01-06."""
    ensure_earth_orientation()
    unix = (UNIX_TIME_OF_GPS_EPOCH + day * SECONDS_PER_DAY) * NANOSECONDS_PER_SECOND
    ut1_minus_utc = float(brahe.get_global_ut1_utc(float(_GPS_EPOCH_MJD + day)))
    return ut1_minus_utc - leap_seconds_at_unix(unix)


@functools.lru_cache(maxsize=_CACHED_EPOCHS)
def _polar_motion(time: GpsTime) -> FloatArray:
    """Return the rotation from the terrestrial intermediate frame to ITRF, shape (3, 3)."""
    ensure_earth_orientation()
    return np.asarray(brahe.polar_motion(time.to_brahe_epoch()))


@functools.lru_cache(maxsize=_CACHED_EPOCHS)
def _angular_velocity_earth_itrf(time: GpsTime) -> FloatArray:
    """Return the angular velocity of the Earth in ITRF, rad/s, shape (3,), read-only.

    Polar motion tilts the axis by up to 3e-6 rad (1.5 mm/s at 7000 km) and is applied. Neglected:
    precession-nutation (8e-12 rad/s, 0.06 mm/s) and length of day (2e-12 rad/s, 0.02 mm/s).
    """
    angular_velocity: FloatArray = EARTH_ROTATION_RATE * _polar_motion(time)[:, 2]
    angular_velocity.flags.writeable = False
    return angular_velocity


@functools.lru_cache(maxsize=_CACHED_EPOCHS)
def kinematic_matrix(time: GpsTime) -> FloatArray:
    """Return the matrix that carries stacked derivatives 0 to 3 of a position from GCRF to ITRF.

    With R(t) = exp(-S t) R(0), S the skew matrix of a constant angular velocity, Leibniz' rule
    gives the n-th derivative as the sum over k of C(n, k) (-S)^k R(0) d^(n-k).

    Parameters
    ----------
    time : GpsTime
        Time of the rotation.

    Returns
    -------
    ndarray, shape (12, 12)
        Read-only, because it is shared by all callers that ask for the same time.
    """
    minus_skew = -skew(_angular_velocity_earth_itrf(time))
    powers = [rotation_gcrf_to_itrf(time)]
    for _ in range(3):
        powers.append(minus_skew @ powers[-1])
    matrix = np.zeros((12, 12))
    for n in range(4):
        for k in range(n + 1):
            column = 3 * (n - k)
            matrix[3 * n : 3 * n + 3, column : column + 3] = math.comb(n, k) * powers[k]
    matrix.flags.writeable = False
    return matrix


def kinematics_itrf(
    time: GpsTime,
    position_gcrf: npt.ArrayLike,
    velocity_gcrf: npt.ArrayLike,
    acceleration_gcrf: npt.ArrayLike,
    jerk_gcrf: npt.ArrayLike,
) -> FloatArray:
    """Return position, velocity, acceleration and jerk as seen in the rotating ITRF.

    Parameters
    ----------
    time : GpsTime
        Time of the state.
    position_gcrf, velocity_gcrf, acceleration_gcrf, jerk_gcrf : array_like, shape (3,)
        The state and its inertial derivatives in GCRF, m, m/s, m/s2, m/s3.

    Returns
    -------
    ndarray, shape (4, 3)
        Rows position, velocity, acceleration, jerk in ITRF; each row is the time derivative of
        the one before it for an observer fixed to the Earth.
    """
    stacked = np.concatenate((position_gcrf, velocity_gcrf, acceleration_gcrf, jerk_gcrf))
    kinematics: FloatArray = (kinematic_matrix(time) @ stacked).reshape(4, 3)
    return kinematics


def state_gcrf_to_itrf(time: GpsTime, state_gcrf: npt.ArrayLike) -> FloatArray:
    """Return position and Earth-fixed velocity in ITRF, shape (6,), of a GCRF state (6,)."""
    return np.asarray(kinematic_matrix(time)[:6, :6] @ np.asarray(state_gcrf, dtype=float))


def state_itrf_to_gcrf(time: GpsTime, state_itrf: npt.ArrayLike) -> FloatArray:
    """Return the GCRF state (6,) of position and Earth-fixed velocity in ITRF (6,)."""
    state = np.asarray(state_itrf, dtype=float)
    to_gcrf = rotation_gcrf_to_itrf(time).T
    velocity = state[3:] + cross(_angular_velocity_earth_itrf(time), state[:3])
    return np.concatenate((to_gcrf @ state[:3], to_gcrf @ velocity))


def right_ascension_from_longitude(time: GpsTime, longitude: float) -> float:
    """Return the right ascension in GCRF of an Earth-fixed longitude, rad in [0, 2 pi).

    Parameters
    ----------
    time : GpsTime
        Time at which the Earth-fixed longitude is read.
    longitude : float
        Longitude east of the ITRF meridian, rad.

    Notes
    -----
    The Greenwich angle added is that of the ITRF meridian measured in GCRF (193.705 deg at
    2016-03-21 01:00 GPS). Sidereal time is larger by the precession in right ascension since 2000.
    """
    rotation = rotation_gcrf_to_itrf(time)
    return (longitude + math.atan2(rotation[0, 1], rotation[0, 0])) % (2.0 * math.pi)
