"""Mapping to the vertical and pierce points, against a numerical integral through PyIRI."""

import csv

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from iono_test_support import examples
from shared_data import require_shared

from vtff_dynamics.frames.geodetic import geodetic_from_itrf, itrf_from_geodetic
from vtff_gnss.orbits.line_of_sight import elevation_azimuth, ellipsoid_normal
from vtff_iono.geometry.mapping import (
    foelsche_kirchengast_mapping,
    mapping_factor,
    pierce_point,
    profile_content,
    shell_height,
    thin_shell_mapping,
)

RADIUS = 6378137.0
ALTITUDE = np.arange(80e3, 2000e3, 500.0)
CHAPMAN = 1.3e12 * np.exp(
    0.5 * (1.0 - (ALTITUDE - 375e3) / 60e3 - np.exp(-(ALTITUDE - 375e3) / 60e3))
)


def pyiri_profile():
    path = require_shared("data/ionosphere/model/pyiri_jicamarca_20160321T01.csv")
    with path.open() as file:
        rows = [row for row in csv.reader(file) if row and not row[0].startswith("#")]
    return rows[0], np.array(rows[1:], dtype=float)


def slant_by_quadrature(elevation, altitude, table_altitude, table_density):
    """Integrate along the ray, not along the radius as the module does."""
    start = RADIUS + altitude

    def density(distance):
        radius = np.sqrt(start**2 + distance**2 + 2.0 * start * distance * np.sin(elevation))
        return np.interp(radius - RADIUS, table_altitude, table_density, right=0.0)

    # Gauss-Legendre in short pieces: the table has kinks every 500 m.
    edges = np.concatenate((np.arange(0.0, 4000e3, 250.0), np.arange(4000e3, 8000e3, 1e3)))
    nodes, weights = np.polynomial.legendre.leggauss(3)
    half = 0.5 * np.diff(edges)[:, None]
    places = edges[:-1, None] + half * (1.0 + nodes)
    return (density(places) * weights * half).sum() / 1e16


def profile_mapping(elevation, radius, altitude, density):
    """Return slant over vertical content of a spherical ionosphere."""
    slant = profile_content(elevation, radius, altitude, density)
    return slant / profile_content(0.5 * np.pi, radius, altitude, density)


@pytest.mark.parametrize("altitude", [0.0, 236e3, 300e3, 480e3, 567e3])
def test_profile_content_is_the_integral_along_the_ray(altitude):
    for elevation_deg in (5.0, 20.0, 45.0, 90.0):
        elevation = np.radians(elevation_deg)
        expected = slant_by_quadrature(elevation, altitude, ALTITUDE, CHAPMAN)
        content = profile_content(elevation, RADIUS + altitude, ALTITUDE, CHAPMAN)
        assert content == pytest.approx(expected, rel=1e-5)


def test_shell_height_keeps_the_error_below_the_stated_bound():
    names, rows = pyiri_profile()
    table_altitude = rows[:, 0] * 1e3
    density = rows[:, names.index("90_SH URSI SHU2015")]
    elevation = np.radians([20.0, 30.0, 50.0, 70.0])
    for altitude in (200e3, 250e3, 300e3, 350e3, 400e3, 470e3, 550e3, 700e3):
        truth = profile_mapping(elevation, RADIUS + altitude, table_altitude, density)
        mapped = mapping_factor(elevation, RADIUS + altitude, altitude)
        fixed = foelsche_kirchengast_mapping(elevation, RADIUS + altitude, 400e3)
        error, fixed_error = (np.abs(m / truth - 1.0).max() for m in (mapped, fixed))
        assert error <= 0.015, altitude
        assert error <= fixed_error + 1e-12, altitude


@examples(60)
@given(st.floats(0.05, 1.5), st.floats(0.0, 700e3))
def test_mapping_falls_with_elevation_and_is_one_at_the_zenith(elevation, altitude):
    radius = RADIUS + altitude
    for function in (
        lambda e: foelsche_kirchengast_mapping(e, radius, shell_height(altitude)),
        lambda e: thin_shell_mapping(e, radius, 450e3),
        lambda e: mapping_factor(e, radius, altitude),
    ):
        assert function(0.5 * np.pi) == pytest.approx(1.0)
        assert function(elevation) > function(elevation + 0.05) >= 1.0


@examples(60)
@given(
    st.floats(-1.5, 1.5),
    st.floats(-3.1, 3.1),
    st.floats(0.0, 400e3),
    st.floats(0.0, 1.5),
    st.floats(0.0, 6.2),
)
def test_pierce_point_lies_on_the_ray_and_on_the_shell(latitude, longitude, height, up, azimuth):
    receiver = itrf_from_geodetic([latitude, longitude, height])
    zenith = ellipsoid_normal(receiver)
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    north = np.cross(zenith, east)
    direction = np.sin(up) * zenith + np.cos(up) * (
        np.cos(azimuth) * north + np.sin(azimuth) * east
    )
    point = pierce_point(receiver, direction, 450e3)
    assert geodetic_from_itrf(point)[2] == pytest.approx(450e3, abs=6.0)
    along = (point - receiver) / np.linalg.norm(point - receiver)
    assert along == pytest.approx(direction, abs=1e-9)
    assert elevation_azimuth(along, zenith)[0] == pytest.approx(up, abs=1e-8)


def test_no_pierce_point_above_the_shell():
    receiver = itrf_from_geodetic([0.0, 0.0, 500e3])
    assert np.isnan(pierce_point(receiver, ellipsoid_normal(receiver), 320e3)).all()
    assert profile_content(1.0, RADIUS + 2100e3, ALTITUDE, CHAPMAN) == 0.0


def test_contents_of_several_densities_are_those_of_each():
    elevation = np.radians([[5.0, 30.0], [60.0, 90.0]])
    densities = np.array([CHAPMAN, 0.3 * CHAPMAN, np.gradient(CHAPMAN)])
    together = profile_content(elevation, RADIUS + 350e3, ALTITUDE, densities)
    assert together.shape == (3, 2, 2)
    for content, density in zip(together, densities, strict=True):
        alone = profile_content(elevation, RADIUS + 350e3, ALTITUDE, density)
        np.testing.assert_allclose(content, alone, rtol=1e-12)
