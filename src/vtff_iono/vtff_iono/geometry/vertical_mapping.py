"""How the rays of a receiver map to the vertical: factors and pierce points, many at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_iono.geometry.mapping import (
    GROUND_SHELL_HEIGHT,
    LOWEST_ORBIT,
    mapping_factor,
    pierce_point,
    shell_height,
)

__all__ = ["VerticalMapping", "vertical_mapping"]

# Stands in for an unknown position, so that no conversion fails.
_SOMEWHERE = np.array([1e7, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class VerticalMapping:
    """Of rays; arrays of shape (n,), NaN where position or direction is unknown.

    Parameters
    ----------
    factor : ndarray
        Slant over vertical content above the receiver's altitude.
    pierce_latitude, pierce_longitude : ndarray
        rad; at the thin shell, or at half the shell height above an orbit.
    """

    factor: FloatArray
    pierce_latitude: FloatArray
    pierce_longitude: FloatArray

    def part(self, start: int, end: int) -> VerticalMapping:
        """Return rays `start` to `end` (not included)."""
        here = slice(start, end)
        return VerticalMapping(
            self.factor[here], self.pierce_latitude[here], self.pierce_longitude[here]
        )


def vertical_mapping(
    position_itrf: FloatArray, direction_itrf: FloatArray, elevation: FloatArray
) -> VerticalMapping:
    """Return how rays map to the vertical.

    Parameters
    ----------
    position_itrf, direction_itrf : ndarray, shape (n, 3)
        Of the receiver, m, and unit vectors to the satellites; NaN where unknown.
    elevation : ndarray, shape (n,)
        rad.
    """
    known = np.asarray(np.isfinite(position_itrf).all(axis=-1))
    place = np.where(known[:, np.newaxis], position_itrf, _SOMEWHERE)
    altitude = geodetic_from_itrf(place)[:, 2]
    factor = mapping_factor(elevation, np.linalg.norm(place, axis=-1), altitude)
    above = np.where(
        altitude < LOWEST_ORBIT, GROUND_SHELL_HEIGHT, altitude + 0.5 * shell_height(altitude)
    )
    point = pierce_point(place, direction_itrf, above)
    is_nowhere = np.asarray(~(known & np.isfinite(point).all(axis=-1)))
    pierced = geodetic_from_itrf(np.where(is_nowhere[:, np.newaxis], _SOMEWHERE, point))
    return VerticalMapping(
        factor=np.where(known, factor, np.nan),
        pierce_latitude=np.where(is_nowhere, np.nan, pierced[:, 0]),
        pierce_longitude=np.where(is_nowhere, np.nan, pierced[:, 1]),
    )
