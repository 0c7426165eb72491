"""WGS-84 geodetic coordinates, and the local east, north and up axes."""

from __future__ import annotations

import brahe
import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import WGS84_FLATTENING, WGS84_SEMI_MAJOR_AXIS
from vtff_dynamics.frames.earth_environment import brahe_constants
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "geodetic_from_itrf",
    "itrf_from_geodetic",
    "rotation_itrf_to_enu",
    "rotation_to_enu_at",
]

# brahe has the longitude first.
_LATITUDE_FIRST = np.array([1, 0, 2])


def geodetic_from_itrf(position_itrf: npt.ArrayLike) -> FloatArray:
    """Return WGS-84 latitude, longitude (rad) and height (m) of ITRF positions.

    Parameters
    ----------
    position_itrf : array_like, shape (..., 3)
        Positions in ITRF, m.

    Returns
    -------
    ndarray, shape (..., 3)
        Latitude, longitude east in (-pi, pi], height above the ellipsoid.
    """
    geodetic = np.asarray(
        brahe.position_ecef_to_geodetic(
            np.asarray(position_itrf, dtype=float), brahe_constants.AngleFormat.RADIANS
        )
    )
    ordered: FloatArray = geodetic.take(_LATITUDE_FIRST, axis=-1)
    return ordered


def itrf_from_geodetic(geodetic: npt.ArrayLike) -> FloatArray:
    """Return ITRF positions (m) of WGS-84 latitude, longitude (rad) and height (m).

    Parameters
    ----------
    geodetic : array_like, shape (..., 3)
        Latitude, longitude, height; the inverse of `geodetic_from_itrf`.

    Returns
    -------
    ndarray, shape (..., 3)
        Positions in ITRF, m.
    """
    latitude, longitude, height = np.moveaxis(np.asarray(geodetic, dtype=float), -1, 0)
    eccentricity_squared = WGS84_FLATTENING * (2.0 - WGS84_FLATTENING)
    curvature = WGS84_SEMI_MAJOR_AXIS / np.sqrt(1.0 - eccentricity_squared * np.sin(latitude) ** 2)
    equatorial = (curvature + height) * np.cos(latitude)
    polar = (curvature * (1.0 - eccentricity_squared) + height) * np.sin(latitude)
    return np.stack(
        (equatorial * np.cos(longitude), equatorial * np.sin(longitude), polar), axis=-1
    )


def rotation_itrf_to_enu(position_itrf: npt.ArrayLike) -> FloatArray:
    """Return the rotation matrix R with ``baseline_enu = R @ baseline_itrf``.

    Parameters
    ----------
    position_itrf : array_like, shape (3,)
        Origin of the local axes, m.

    Returns
    -------
    ndarray, shape (3, 3)
        Rows: east, north, and up along the normal of the WGS-84 ellipsoid.
    """
    latitude, longitude, _ = geodetic_from_itrf(position_itrf)
    return rotation_to_enu_at(float(latitude), float(longitude))


def rotation_to_enu_at(latitude: float, longitude: float) -> FloatArray:
    """Return the rotation matrix of `rotation_itrf_to_enu` at a geodetic place, rad."""
    sine, cosine = float(np.sin(longitude)), float(np.cos(longitude))
    up_normal, up_equatorial = float(np.sin(latitude)), float(np.cos(latitude))
    # Written out: for three numbers np.cross takes longer than all the rest.
    east = (-sine, cosine, 0.0)
    up = (up_equatorial * cosine, up_equatorial * sine, up_normal)
    north = (
        up[1] * east[2] - up[2] * east[1],
        up[2] * east[0] - up[0] * east[2],
        up[0] * east[1] - up[1] * east[0],
    )
    return np.array((east, north, up))
