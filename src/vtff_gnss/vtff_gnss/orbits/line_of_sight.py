"""Lines of sight from receivers to satellites: light time, range, direction, visibility."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import (
    SPEED_OF_LIGHT,
    WGS84_FLATTENING,
    WGS84_SEMI_MAJOR_AXIS,
)
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import EARTH_ROTATION_RATE_BROADCAST
from vtff_gnss.orbits.broadcast_orbit import SatelliteStates
from vtff_gnss.orbits.satellite_table import SatelliteTable

__all__ = [
    "LineOfSight",
    "earth_obstructs",
    "elevation_azimuth",
    "ellipsoid_normal",
    "lines_of_sight",
]

# Satellite states are evaluated once, this long before reception, and carried to the time of
# transmission by a parabola; 0.03 s away from it the third derivative makes 4e-10 m.
_TYPICAL_TRAVEL_TIME = 0.075
_NEWTON_ITERATIONS = 2
# The Earth turns by this angle in the meantime.
_ANGLE_IN_FLIGHT = EARTH_ROTATION_RATE_BROADCAST * _TYPICAL_TRAVEL_TIME
_COSINE_IN_FLIGHT, _SINE_IN_FLIGHT = math.cos(_ANGLE_IN_FLIGHT), math.sin(_ANGLE_IN_FLIGHT)


@dataclass(frozen=True, eq=False, kw_only=True)
class LineOfSight:
    """Geometry of the signals received by receivers, leading axes (..., n satellites).

    Parameters
    ----------
    travel_time : ndarray, shape (..., n)
        Reception less transmission in GPS time, s; geometric, in vacuum.
    range : ndarray, shape (..., n)
        m; ``travel_time`` times the speed of light.
    range_rate : ndarray, shape (..., n)
        m/s; the derivative of the range with respect to the time of reception.
    direction_itrf : ndarray, shape (..., n, 3)
        Unit vectors from receiver to satellite, in the Earth-fixed axes of reception.
    elevation : ndarray, shape (..., n)
        rad; above the plane normal to the zenith direction.
    azimuth : ndarray, shape (..., n)
        rad; clockwise from north in [0, 2 pi).
    position_satellite_itrf, velocity_satellite_itrf : ndarray, shape (..., n, 3)
        At transmission, m and m/s, in the Earth-fixed axes of reception. The velocity is that
        seen from the Earth at transmission.
    clock_offset_satellite, clock_drift_satellite : ndarray, shape (..., n)
        At transmission, s and s/s, as in `SatelliteStates`.
    """

    travel_time: FloatArray
    range: FloatArray
    range_rate: FloatArray
    direction_itrf: FloatArray
    elevation: FloatArray
    azimuth: FloatArray
    position_satellite_itrf: FloatArray
    velocity_satellite_itrf: FloatArray
    clock_offset_satellite: FloatArray
    clock_drift_satellite: FloatArray


def lines_of_sight(
    table: SatelliteTable,
    time: GpsTime,
    offset: npt.ArrayLike,
    position_receiver_itrf: npt.ArrayLike,
    velocity_receiver_itrf: npt.ArrayLike,
    zenith_itrf: npt.ArrayLike | None = None,
) -> LineOfSight:
    """Solve the light-time equation of all satellites, receivers and times.

    Parameters
    ----------
    table : SatelliteTable
        n satellites.
    time : GpsTime
        Reference of `offset`.
    offset : array_like, shape that broadcasts with (...)
        GPS times of reception less `time`, s. Satellites are evaluated in this shape only: with
        receivers as the first axis of the positions and times as the last one, give (times,).
    position_receiver_itrf, velocity_receiver_itrf : array_like, shape (..., 3)
        Antenna phase centre at reception, m, and Earth-fixed velocity, m/s.
    zenith_itrf : array_like, shape (..., 3), optional
        Unit vectors that elevation is counted from, for example the boresight of the antenna;
        the ellipsoid normal if absent.

    Notes
    -----
    The equation is solved in the non-rotating axes that coincide with the Earth-fixed ones at
    reception; so the rotation during the flight (Sagnac effect) is exact. The axis of rotation is
    the z axis, as in the interface documents. The gravitational delay (below 20 mm) is not in it.

    References
    ----------
    IS-GPS-200, 20.3.3.4.3.4 (geometric range).
    """
    receiver_itrf = np.asarray(position_receiver_itrf, dtype=float)
    reception = np.asarray(offset, dtype=float)[..., np.newaxis]
    zenith = (
        ellipsoid_normal(receiver_itrf)
        if zenith_itrf is None
        else np.asarray(zenith_itrf, dtype=float)
    )
    states = table.states(time, reception - _TYPICAL_TRAVEL_TIME)
    axes = max(receiver_itrf.ndim, states.clock_offset.ndim)
    position_0, position_1, position_2 = _motion_in_axes_of_reception(states, axes)
    receiver = _components(receiver_itrf[..., np.newaxis, :], axes)
    relative_0 = position_0 - receiver
    delay = np.zeros(relative_0.shape[1:])
    for _ in range(_NEWTON_ITERATIONS):
        relative = relative_0 + delay * (position_1 + (0.5 * delay) * position_2)
        distance = np.sqrt(_dot(relative, relative))
        change = _dot(relative, position_1 + delay * position_2) / distance
        excess = distance - SPEED_OF_LIGHT * (_TYPICAL_TRAVEL_TIME + delay)
        delay = delay + excess / (SPEED_OF_LIGHT - change)
    relative = relative_0 + delay * (position_1 + (0.5 * delay) * position_2)
    travel_time = _TYPICAL_TRAVEL_TIME + delay
    distance = SPEED_OF_LIGHT * travel_time
    direction = relative / distance

    # Velocities in the non-rotating axes; position_1 is the derivative by the travel time.
    velocity_satellite = -(position_1 + delay * position_2)
    velocity_receiver = _add_rotation(
        receiver,
        _components(np.asarray(velocity_receiver_itrf, dtype=float)[..., np.newaxis, :], axes),
    )
    closing = _dot(direction, velocity_satellite - velocity_receiver)
    range_rate = closing / (1.0 + _dot(direction, velocity_satellite) / SPEED_OF_LIGHT)

    position_satellite = relative + receiver
    direction_itrf = _vectors(direction)
    elevation, azimuth = elevation_azimuth(direction_itrf, zenith[..., np.newaxis, :])
    return LineOfSight(
        travel_time=travel_time,
        range=distance,
        range_rate=range_rate,
        direction_itrf=direction_itrf,
        elevation=elevation,
        azimuth=azimuth,
        position_satellite_itrf=_vectors(position_satellite),
        velocity_satellite_itrf=_vectors(
            _add_rotation(position_satellite, velocity_satellite, -1.0)
        ),
        clock_offset_satellite=states.clock_offset - delay * states.clock_drift,
        clock_drift_satellite=np.broadcast_to(states.clock_drift, delay.shape),
    )


def ellipsoid_normal(position_itrf: npt.ArrayLike) -> FloatArray:
    """Return the upward unit normals of the WGS-84 ellipsoid at positions (..., 3)."""
    geodetic = geodetic_from_itrf(position_itrf)
    latitude, longitude = geodetic[..., 0], geodetic[..., 1]
    return np.stack(
        (
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ),
        axis=-1,
    )


def elevation_azimuth(
    direction_itrf: npt.ArrayLike, zenith_itrf: npt.ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return elevation and azimuth of directions, rad.

    Parameters
    ----------
    direction_itrf, zenith_itrf : array_like, shapes that broadcast to (..., 3)
        Unit vectors.

    Returns
    -------
    elevation, azimuth : ndarray, shape (...)
        Elevation above the plane normal to the zenith direction; azimuth in [0, 2 pi) from
        north (the z axis projected into that plane) over east. For a zenith along the z axis,
        north is the direction of decreasing x, as on the zero meridian.
    """
    direction = np.asarray(direction_itrf, dtype=float)
    zenith = np.asarray(zenith_itrf, dtype=float)
    equatorial = np.hypot(zenith[..., 0], zenith[..., 1])
    is_polar = equatorial < 1e-12
    scale = 1.0 / np.where(is_polar, 1.0, equatorial)
    cosine = np.where(is_polar, 1.0, zenith[..., 0] * scale)
    sine = np.where(is_polar, 0.0, zenith[..., 1] * scale)
    x, y, z = direction[..., 0], direction[..., 1], direction[..., 2]
    outward = cosine * x + sine * y
    east = cosine * y - sine * x
    north = equatorial * z - zenith[..., 2] * outward
    up = equatorial * outward + zenith[..., 2] * z
    # Near the zenith the arc sine loses half the digits; this does not.
    elevation = np.arctan2(up, np.hypot(east, north))
    return elevation, np.arctan2(east, north) % (2.0 * np.pi)


def earth_obstructs(
    position_receiver_itrf: npt.ArrayLike,
    position_satellite_itrf: npt.ArrayLike,
    height: float = 0.0,
    semi_major_axis: float = WGS84_SEMI_MAJOR_AXIS,
    flattening: float = WGS84_FLATTENING,
) -> npt.NDArray[np.bool_]:
    """Return whether straight lines of sight pass below a height above the Earth.

    Parameters
    ----------
    position_receiver_itrf, position_satellite_itrf : array_like, shapes that broadcast to (..., 3)
        Both in the same Earth-fixed axes, m.
    height : float
        m; may be negative. The surface is the ellipsoid whose half axes are longer by `height`.
    semi_major_axis, flattening : float
        WGS-84 by default; flattening 0 for a sphere.

    Returns
    -------
    ndarray of bool, shape (...)
        A line that only rises from a receiver below the surface is not obstructed.

    Raises
    ------
    ValueError
        If the surface has no volume.
    """
    equatorial = semi_major_axis + height
    polar = semi_major_axis * (1.0 - flattening) + height
    if not (equatorial > 0.0 and polar > 0.0):
        raise ValueError(f"height {height}: the obstructing surface would have no volume")
    # In stretched coordinates the surface is the unit sphere, and lines stay lines.
    stretch = np.array([1.0 / equatorial, 1.0 / equatorial, 1.0 / polar])
    stretched = np.asarray(position_receiver_itrf, dtype=float) * stretch
    difference = np.asarray(position_satellite_itrf, dtype=float) * stretch - stretched
    stretched = np.broadcast_to(stretched, difference.shape)
    receiver, along = np.moveaxis(stretched, -1, 0), np.moveaxis(difference, -1, 0)
    length_squared = _dot(along, along)
    fraction = -_dot(receiver, along) / length_squared
    closest_squared = _dot(receiver, receiver) - fraction**2 * length_squared
    obstructed: npt.NDArray[np.bool_] = (
        (fraction > 0.0) & (fraction < 1.0) & (closest_squared < 1.0)
    )
    return obstructed


def _motion_in_axes_of_reception(
    states: SatelliteStates, axes: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return position at the typical travel time, first and second derivative by travel time.

    Components first, with `axes` further axes. The axes of the components do not rotate and
    coincide with the Earth-fixed ones at reception.
    """
    position = _components(states.position_itrf, axes)
    velocity = _components(states.velocity_itrf, axes)
    velocity_fixed = _add_rotation(position, velocity)
    # Coriolis and centrifugal terms: the operator d/dt + omega x applied twice.
    acceleration_fixed = _add_rotation(
        velocity_fixed,
        _add_rotation(velocity, _components(states.acceleration_itrf, axes)),
    )
    fixed = np.array((position, -velocity_fixed, acceleration_fixed))
    x, y = fixed[:, 0], fixed[:, 1]
    turned = np.array(
        (_COSINE_IN_FLIGHT * x + _SINE_IN_FLIGHT * y, _COSINE_IN_FLIGHT * y - _SINE_IN_FLIGHT * x)
    )
    fixed[:, 0], fixed[:, 1] = turned
    return fixed[0], fixed[1], fixed[2]


def _components(vectors: FloatArray, axes: int) -> FloatArray:
    """Return vectors (..., n, 3) as (3, ..., n) with as many leading axes as to make `axes`.

    Arithmetic on a last axis of three is several times slower.
    """
    missing = (1,) * (axes + 1 - vectors.ndim)
    first = vectors.transpose(vectors.ndim - 1, *range(vectors.ndim - 1))
    return np.ascontiguousarray(first).reshape(3, *missing, *vectors.shape[:-1])


def _vectors(components: FloatArray) -> FloatArray:
    """Return a view of vectors (3, ...) as (..., 3)."""
    return np.asarray(components.transpose(*range(1, components.ndim), 0))


def _add_rotation(position: FloatArray, velocity: FloatArray, sign: float = 1.0) -> FloatArray:
    """Return ``velocity + sign * (omega x position)`` for the rotation of the Earth, (3, ...)."""
    rate = sign * EARTH_ROTATION_RATE_BROADCAST
    first = velocity[0] - rate * position[1]
    total = np.empty((3, *first.shape))
    total[0] = first
    np.add(velocity[1], rate * position[0], out=total[1])
    total[2] = velocity[2]
    return total


def _dot(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the scalar products of vectors (3, ...)."""
    return np.asarray(np.add.reduce(left * right, axis=0))
