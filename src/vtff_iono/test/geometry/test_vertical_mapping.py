"""Factors and pierce points of many rays: the same as of single rays, NaN where unknown."""

import numpy as np
import pytest

from vtff_dynamics.frames.geodetic import itrf_from_geodetic
from vtff_gnss.orbits.line_of_sight import ellipsoid_normal
from vtff_iono.geometry.mapping import mapping_factor, shell_height
from vtff_iono.geometry.vertical_mapping import vertical_mapping

LATITUDE, LONGITUDE = 0.3, -1.2


def rays(altitude, elevation=0.6, azimuth=0.0):
    """Return position and direction of a receiver; azimuth from north through east."""
    position = itrf_from_geodetic([LATITUDE, LONGITUDE, altitude])
    up = ellipsoid_normal(position)
    east = np.array([-np.sin(LONGITUDE), np.cos(LONGITUDE), 0.0])
    level = np.cos(azimuth) * np.cross(up, east) + np.sin(azimuth) * east
    return position, np.sin(elevation) * up + np.cos(elevation) * level


@pytest.mark.parametrize(
    ("altitude", "pierce_altitude"),
    [(20.0, 450e3), (149e3, 450e3), (151e3, 426e3), (400e3, 580e3), (700e3, 1410e3)],
)
def test_pierce_points_lie_at_their_altitude(altitude, pierce_altitude):
    """On the ground the thin shell, in orbit half the shell height above: 360 km at 400 km."""
    elevation = 0.6
    expected = []
    for azimuth in (0.0, 0.5 * np.pi):
        position, direction = rays(altitude, elevation, azimuth)
        mapping = vertical_mapping(position[None], direction[None], np.array([elevation]))
        # Triangle of the centre of a sphere, receiver and pierce point.
        radius = np.linalg.norm(position)
        ratio = radius / (radius + pierce_altitude - altitude)
        angle = 0.5 * np.pi - elevation - np.arcsin(ratio * np.cos(elevation))
        north = mapping.pierce_latitude[0] - LATITUDE
        east = (mapping.pierce_longitude[0] - LONGITUDE) * np.cos(mapping.pierce_latitude[0])
        expected.append((angle, north, east))
    (angle, north, east), (angle_east, _, longitude) = expected
    assert (north, east) == pytest.approx((angle, 0.0), abs=0.01 * angle)
    assert longitude == pytest.approx(angle_east, rel=0.02)
    factor = mapping_factor(elevation, radius, altitude)
    assert mapping.factor[0] == pytest.approx(float(factor), rel=1e-6)
    if altitude > 150e3:
        assert pierce_altitude - altitude == pytest.approx(0.5 * float(shell_height(altitude)))


def test_what_is_unknown_is_nan():
    position, direction = rays(400e3)
    positions, directions = np.tile(position, (4, 1)), np.tile(direction, (4, 1))
    positions[1] = np.nan
    directions[2] = np.nan
    elevation = np.array([0.6, 0.6, 0.6, np.nan])
    mapping = vertical_mapping(positions, directions, elevation)
    assert np.isnan(mapping.factor).tolist() == [False, True, False, True]
    for angle in (mapping.pierce_latitude, mapping.pierce_longitude):
        assert np.isnan(angle).tolist() == [False, True, True, False]
    assert mapping.pierce_latitude[3] == mapping.pierce_latitude[0]
