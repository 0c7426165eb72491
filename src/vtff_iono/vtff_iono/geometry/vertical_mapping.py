"""Mapping of many rays of a receiver to the vertical: factors and pierce points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_iono.geometry.mapping import (
    GROUND_SHELL_HEIGHT,
    LOWEST_ORBIT,
    distinct_positions,
    mapping_factor,
    pierce_point,
    shell_height,
)

__all__ = ["VerticalMapping", "vertical_mapping"]

# Stands in for an unknown position, so that no conversion fails; its results are not used.
_PLACEHOLDER_POSITION = np.array([1e7, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class VerticalMapping:
    """Mapping of rays; arrays of shape (n,), NaN where position or direction is unknown.

    Parameters
    ----------
    factor : ndarray
        Slant over vertical content above the receiver's altitude.
    pierce_latitude, pierce_longitude : ndarray
        Pierce point at the thin shell, or at half the shell height above an orbit, rad.
    """

    factor: FloatArray
    pierce_latitude: FloatArray
    pierce_longitude: FloatArray


def vertical_mapping(
    position_itrf: FloatArray, direction_itrf: FloatArray, elevation: FloatArray
) -> VerticalMapping:
    """Return the mapping of rays to the vertical.

    Parameters
    ----------
    position_itrf, direction_itrf : ndarray, shape (n, 3)
        Positions of the receiver, m, and unit vectors to the satellites; NaN where unknown.
    elevation : ndarray, shape (n,)
        Elevations of the satellites, rad.
    """
    has_position = np.asarray(np.isfinite(position_itrf).all(axis=-1))
    position = np.where(has_position[:, np.newaxis], position_itrf, _PLACEHOLDER_POSITION)
    positions, number = distinct_positions(position)
    altitude = geodetic_from_itrf(positions)[number, 2]
    factor = mapping_factor(elevation, np.linalg.norm(position, axis=-1), altitude)
    pierce_altitude = np.where(
        altitude < LOWEST_ORBIT, GROUND_SHELL_HEIGHT, altitude + 0.5 * shell_height(altitude)
    )
    point = pierce_point(position, direction_itrf, pierce_altitude)
    has_point = np.asarray(has_position & np.isfinite(point).all(axis=-1))
    geodetic = geodetic_from_itrf(np.where(has_point[:, np.newaxis], point, _PLACEHOLDER_POSITION))
    return VerticalMapping(
        factor=np.where(has_position, factor, np.nan),
        pierce_latitude=np.where(has_point, geodetic[:, 0], np.nan),
        pierce_longitude=np.where(has_point, geodetic[:, 1], np.nan),
    )
