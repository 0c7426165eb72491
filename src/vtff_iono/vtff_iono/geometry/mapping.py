"""Mapping of slant to vertical electron content, and where rays pierce a shell.

The mapping factor M is slant over vertical content. There are three ways to get it:

- `thin_shell_mapping` for a receiver below the ionosphere;
- `foelsche_kirchengast_mapping` for a receiver inside the ionosphere: all electrons above it are
  taken as a slab of constant density, whose thickness is of the order of the shell height. The best
  height depends on how much of the layer is above the receiver, see `shell_height`;
- the ratio of two contents of `profile_content`, exact for spherical symmetry.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import WGS84_FLATTENING, WGS84_SEMI_MAJOR_AXIS
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU

__all__ = [
    "GROUND_SHELL_HEIGHT",
    "LOWEST_ORBIT",
    "contents_of_rays",
    "distance_of_ray",
    "distance_to_altitude",
    "distinct_positions",
    "foelsche_kirchengast_mapping",
    "mapping_factor",
    "pierce_point",
    "profile_content",
    "set_ray_weights",
    "shell_height",
    "thin_shell_mapping",
]

GROUND_SHELL_HEIGHT = 450e3
"""m; height of the thin shell of the global ionosphere maps (IONEX products of the IGS)."""

LOWEST_ORBIT = 150e3
"""m; below it a receiver is treated as a receiver on the ground: all of the E and F layers are
above."""

# Shell height above the orbit for which the Foelsche-Kirchengast factor has the smallest error
# against integrals through PyIRI profiles (Jicamarca, 2016-03-21, F10.7 = 90); the error is then
# below 1.5 %.
_ORBIT_ALTITUDE = np.array([200e3, 250e3, 300e3, 350e3, 400e3, 470e3, 550e3, 700e3])
_SHELL_HEIGHT = np.array([550e3, 430e3, 340e3, 310e3, 360e3, 550e3, 850e3, 1420e3])


def shell_height(altitude: npt.ArrayLike) -> FloatArray:
    """Return the height above the receiver, m, to be given to `foelsche_kirchengast_mapping`.

    Parameters
    ----------
    altitude : array_like
        Altitude of the receiver, m. What matters is the altitude relative to the peak of the layer
        (378 km in the underlying profile): near the peak the height is smallest, far above it the
        topside decays slowly. Outside 200 to 700 km the height is that of the nearest limit.
    """
    return np.asarray(np.interp(np.asarray(altitude, dtype=float), _ORBIT_ALTITUDE, _SHELL_HEIGHT))


def foelsche_kirchengast_mapping(
    elevation: npt.ArrayLike, radius: npt.ArrayLike, height: npt.ArrayLike
) -> FloatArray:
    """Return slant over vertical content for a receiver inside the ionosphere.

    Parameters
    ----------
    elevation : array_like
        Elevation of the satellite, rad.
    radius : array_like
        Distance of the receiver from the centre of the Earth, m.
    height : array_like
        Height of the shell above the receiver, m.

    References
    ----------
    Foelsche and Kirchengast (2002), A simple "geometric" mapping function for the hydrostatic delay
    at radio frequencies, Geophys. Res. Lett. 29(10), 1473.
    """
    radius = np.asarray(radius, dtype=float)
    ratio = (radius + height) / radius
    sine, cosine = np.sin(elevation), np.cos(elevation)
    return np.asarray((1.0 + ratio) / (sine + np.sqrt(ratio**2 - cosine**2)))


def thin_shell_mapping(
    elevation: npt.ArrayLike,
    radius: npt.ArrayLike = WGS84_SEMI_MAJOR_AXIS,
    height: npt.ArrayLike = GROUND_SHELL_HEIGHT,
) -> FloatArray:
    """Return slant over vertical content for a thin shell `height` above the receiver.

    Arguments as in `foelsche_kirchengast_mapping`; M = 1 / sqrt(1 - (r cos E / (r + h))^2).
    """
    radius = np.asarray(radius, dtype=float)
    ratio = radius / (radius + height)
    return np.asarray(1.0 / np.sqrt(1.0 - (ratio * np.cos(elevation)) ** 2))


def mapping_factor(
    elevation: npt.ArrayLike, radius: npt.ArrayLike, altitude: npt.ArrayLike
) -> FloatArray:
    """Return the factor that suits the altitude of the receiver: on the ground or in orbit.

    Parameters
    ----------
    elevation, radius : array_like
        As in `foelsche_kirchengast_mapping`.
    altitude : array_like
        Altitude of the receiver above the ellipsoid, m.
    """
    altitude = np.asarray(altitude, dtype=float)
    # Both factors are computed for all receivers; the height keeps the unused one finite.
    above = np.where(altitude < LOWEST_ORBIT, GROUND_SHELL_HEIGHT - altitude, GROUND_SHELL_HEIGHT)
    ground = thin_shell_mapping(elevation, radius, above)
    orbit = foelsche_kirchengast_mapping(elevation, radius, shell_height(altitude))
    return np.where(altitude < LOWEST_ORBIT, ground, orbit)


def profile_content(
    elevation: npt.ArrayLike, radius: npt.ArrayLike, altitude: FloatArray, density: FloatArray
) -> FloatArray:
    """Return the slant contents, TECU, of rays through densities that depend on altitude only.

    Parameters
    ----------
    elevation, radius : array_like, broadcast to shape (...)
        Elevation of the ray, rad, positive; distance of the receiver from the centre of
        symmetry, m.
    altitude : ndarray, shape (n,)
        Altitudes of the table above the sphere of radius `WGS84_SEMI_MAJOR_AXIS`, m, increasing.
    density : ndarray, shape (n,) or (k, n)
        Electrons per cubic metre; linear between the altitudes of the table, zero outside it.

    Returns
    -------
    ndarray, shape (...) or (k, ...)

    Notes
    -----
    With p = r cos E the path element is r' dr' / sqrt(r'^2 - p^2). Its integral over an interval of
    constant density is the difference of sqrt(r'^2 - p^2) at the two ends; the density of an
    interval is the mean of the densities at its ends.
    """
    perigee = np.asarray(radius * np.cos(elevation), dtype=float)
    start = np.full(perigee.shape, radius, dtype=float)
    densities = np.ascontiguousarray(np.atleast_2d(density))
    content: FloatArray = contents_of_rays(perigee.ravel(), start.ravel(), altitude, densities)
    return content.reshape(density.shape[:-1] + perigee.shape)


@compiled
def contents_of_rays(perigee, radius, altitude, density):  # type: ignore[no-untyped-def]
    """Return the contents of rays through densities that depend on altitude only, compiled.

    Parameters
    ----------
    perigee, radius : ndarray, shape (rays,)
        Smallest distance of each ray, extended backwards, from the centre, and the distance of its
        receiver, m.
    altitude, density : ndarray, shapes (n,), (k, n)
        As in `profile_content`.

    Returns
    -------
    ndarray, shape (k, rays)
        TECU.
    """
    contents = np.zeros((len(density), len(perigee)))
    weight = np.empty(len(altitude))
    for ray in range(len(perigee)):
        if set_ray_weights(perigee[ray], radius[ray], altitude, weight) == len(altitude):
            continue
        for k in range(len(density)):
            contents[k, ray] = density[k] @ weight / ELECTRONS_PER_TECU
    return contents


@compiled
def set_ray_weights(perigee, radius, altitude, weight):  # type: ignore[no-untyped-def]
    """Set what each density of a table adds to the content of a ray, m, compiled.

    Parameters
    ----------
    perigee, radius, altitude
        Values of one ray, and the table, as in `contents_of_rays`.
    weight : ndarray, shape (n,)
        Set in place.

    Returns
    -------
    int
        Row of the first density that adds anything; n for a receiver above the table.
    """
    size, square = len(altitude), perigee**2
    first = np.searchsorted(altitude, radius - WGS84_SEMI_MAJOR_AXIS)
    weight[:first] = 0.0
    if first == size:
        return size
    # Counted from zero: loops over places that might be negative are compiled to slow ones.
    above, weights = altitude[first:], weight[first:]
    count = len(above)
    # Distances of the altitudes along the ray.
    distance = np.empty(count)
    for edge in range(count):
        height = above[edge] + WGS84_SEMI_MAJOR_AXIS
        distance[edge] = math.sqrt(height * height - square)
    for edge in range(count - 2):
        weights[edge + 1] = 0.5 * (distance[edge + 2] - distance[edge])
    weights[0] = weights[count - 1] = 0.0
    if count > 1:
        weights[0] = 0.5 * (distance[1] - distance[0])
        weights[count - 1] = 0.5 * (distance[count - 1] - distance[count - 2])
    if first == 0:
        return 0
    # The interval in which the receiver lies begins at the receiver, with the density there.
    fraction = radius - WGS84_SEMI_MAJOR_AXIS - altitude[first - 1]
    fraction /= altitude[first] - altitude[first - 1]
    step = distance[0] - math.sqrt(max(radius**2 - square, 0.0))
    weight[first - 1] += 0.5 * (1.0 - fraction) * step
    weight[first] += 0.5 * (1.0 + fraction) * step
    return first - 1


def distinct_positions(position: FloatArray) -> tuple[FloatArray, npt.NDArray[np.intp]]:
    """Return the positions that differ from those of the rows before, and which each row has.

    The rows of an epoch have the same position: what depends on it alone need not be computed for
    each of them.

    Parameters
    ----------
    position : ndarray, shape (n, 3)

    Returns
    -------
    positions : ndarray, shape (k, 3)
    number : ndarray of int, shape (n,)
    """
    is_new = np.ones(len(position), dtype=bool)
    is_new[1:] = (position[1:] != position[:-1]).any(axis=1)
    return position[is_new], np.cumsum(is_new) - 1


def distance_to_altitude(
    position_receiver_itrf: npt.ArrayLike, direction_itrf: npt.ArrayLike, altitude: npt.ArrayLike
) -> FloatArray:
    """Return the distances of receivers, along rays, from the ellipsoid `altitude` above WGS-84.

    Parameters
    ----------
    position_receiver_itrf, direction_itrf : array_like, shapes that broadcast to (..., 3)
        Positions of the receivers, m, and unit vectors towards the satellites.
    altitude : array_like, shape that broadcasts with (...)
        Height of the surface, m: both half axes of WGS-84 are longer by it. At 500 km the surface
        is within 6 m of that of constant geodetic height.

    Returns
    -------
    ndarray, shape (...)
        Distances, m; NaN where the ray does not pass the surface upwards, as for a receiver above
        it.
    """
    position = np.asarray(position_receiver_itrf, dtype=float)
    direction = np.asarray(direction_itrf, dtype=float)
    altitude = np.asarray(altitude, dtype=float)
    shape = np.broadcast_shapes(position.shape[:-1], direction.shape[:-1], altitude.shape)
    vectors = (
        np.ascontiguousarray(np.broadcast_to(vector, (*shape, 3))).reshape(-1, 3)
        for vector in (position, direction)
    )
    altitudes = np.ascontiguousarray(np.broadcast_to(altitude, shape)).reshape(-1)
    distances: FloatArray = _distances_of_rays(*vectors, altitudes)
    return distances.reshape(shape)


@compiled
def _distances_of_rays(position, direction, altitude):  # type: ignore[no-untyped-def]
    """Return the distances that `distance_to_altitude` describes of n rays, shape (n,)."""
    distances = np.empty(len(altitude))
    for row in range(len(altitude)):
        distances[row] = distance_of_ray(position[row], direction[row], altitude[row])
    return distances


@compiled
def distance_of_ray(position, direction, altitude):  # type: ignore[no-untyped-def]
    """Return the distance that `distance_to_altitude` describes of a ray, compiled.

    `position` and `direction` have the shape (3,), `altitude` is a number.
    """
    equatorial = WGS84_SEMI_MAJOR_AXIS + altitude
    polar = WGS84_SEMI_MAJOR_AXIS * (1.0 - WGS84_FLATTENING) + altitude
    # In coordinates in which the ellipsoid is the unit sphere, the distance solves a quadratic
    # equation: square d^2 + 2 mixed d + excess = 0.
    square, mixed, excess = 0.0, 0.0, -1.0
    for axis in range(3):
        half_axis = polar if axis == 2 else equatorial
        start, along = position[axis] / half_axis, direction[axis] / half_axis
        square += along * along
        mixed += start * along
        excess += start * start
    if not excess <= 0.0:
        return math.nan
    return (-mixed + math.sqrt(mixed * mixed - square * excess)) / square


def pierce_point(
    position_receiver_itrf: npt.ArrayLike, direction_itrf: npt.ArrayLike, altitude: npt.ArrayLike
) -> FloatArray:
    """Return the points where rays leave the ellipsoid `altitude` above WGS-84, ITRF, m.

    Arguments as in `distance_to_altitude`. The points have shape (..., 3); they are NaN where the
    distance is NaN.
    """
    distance = distance_to_altitude(position_receiver_itrf, direction_itrf, altitude)
    receiver = np.asarray(position_receiver_itrf, dtype=float)
    direction = np.asarray(direction_itrf, dtype=float)
    point: FloatArray = receiver + distance[..., np.newaxis] * direction
    return point
