"""The dip equator: where the Earth's magnetic field is level, and plasma bubbles are at home."""

from __future__ import annotations

import math

import brahe
import numpy as np

from vtff_dynamics.attitude.magnetic_field import check_field_year
from vtff_dynamics.frames.earth_environment import brahe_constants
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray

__all__ = ["dip_equator"]

#: The dip equator never leaves these latitudes, deg.
_LATITUDE_LIMIT_DEG = 35.0
_HALVINGS = 14  # of 70 deg: 0.004 deg


def dip_equator(time: GpsTime, altitude: float, count: int = 73) -> FloatArray:
    """Return points where the field of IGRF-14 has no vertical part.

    Parameters
    ----------
    time
        Time of the field.
    altitude
        Height above the ellipsoid, m.
    count
        Number of points, evenly spaced in longitude from -180 to 180 deg.

    Returns
    -------
    ndarray, shape (count, 2)
        Longitude and geodetic latitude, deg.

    Raises
    ------
    ValueError
        If IGRF-14 does not cover the time.
    """
    check_field_year("time", time)
    epoch = time.to_brahe_epoch()

    def downward(longitude: float, latitude: float) -> float:
        place = np.array([longitude, latitude, altitude])
        field = np.asarray(brahe.igrf_ecef(epoch, place, brahe_constants.AngleFormat.RADIANS))
        up = (
            math.cos(latitude) * math.cos(longitude),
            math.cos(latitude) * math.sin(longitude),
            math.sin(latitude),
        )
        return -float(np.dot(field, up))

    points = []
    for longitude_deg in np.linspace(-180.0, 180.0, count):
        south, north = -math.radians(_LATITUDE_LIMIT_DEG), math.radians(_LATITUDE_LIMIT_DEG)
        for _ in range(_HALVINGS):
            middle = 0.5 * (south + north)
            # North of the dip equator the field points into the Earth.
            if downward(math.radians(longitude_deg), middle) > 0.0:
                north = middle
            else:
                south = middle
        points.append((longitude_deg, math.degrees(0.5 * (south + north))))
    return np.array(points)
