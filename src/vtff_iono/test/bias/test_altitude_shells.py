"""Shells of altitude: paths against integrals through a sphere, and the expected topside."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from iono_test_support import examples

from vtff_dynamics.constants import WGS84_SEMI_MAJOR_AXIS
from vtff_dynamics.frames.geodetic import geodetic_from_itrf, itrf_from_geodetic
from vtff_iono.bias.altitude_shells import (
    TopsideModel,
    log_density_prior,
    shell_edges,
    shell_middles,
    shell_paths,
    vertical_contents,
)
from vtff_iono.geometry.mapping import distance_to_altitude, profile_content


def eastward(elevation):
    """Return directions in the plane of the equator, seen from longitude zero."""
    elevation = np.asarray(elevation)
    return np.stack((np.sin(elevation), np.cos(elevation), 0.0 * elevation), axis=-1)


def test_paths_are_the_integrals_of_a_spherical_ionosphere():
    """In the plane of the equator ellipsoids are circles, which `profile_content` integrates."""
    edges = shell_edges(230e3, 700e3)
    middle = shell_middles(edges)
    density = 1e12 * np.exp(-((np.log(middle / 350e3)) ** 2))
    elevation = np.radians([10.0, 30.0, 60.0, 90.0])
    for altitude in (231e3, 402.5e3, 699e3):
        receiver = np.tile(itrf_from_geodetic([0.0, 0.0, altitude]), (4, 1))
        paths = shell_paths(receiver, eastward(elevation), np.full(4, altitude), edges)
        # Steps of a metre at the edges make the table piecewise constant.
        table = np.stack((edges[:-1] + 0.5, edges[1:] - 0.5), axis=1).ravel()
        expected = profile_content(
            elevation, WGS84_SEMI_MAJOR_AXIS + altitude, table, np.repeat(density, 2)
        )
        assert paths @ density == pytest.approx(expected, rel=2e-4)
        (vertical,) = vertical_contents(np.array([altitude]), edges, density)
        assert vertical == pytest.approx(paths[3] @ density, rel=1e-9)


def test_receivers_outside_the_shells_have_all_or_nothing_above_them():
    edges, density = np.array([100e3, 200e3, 400e3]), np.array([1e12, 2e12])
    contents = vertical_contents(np.array([0.0, 100e3, 300e3, 400e3, 500e3]), edges, density)
    assert contents == pytest.approx([50.0, 50.0, 20.0, 0.0, 0.0], rel=1e-12)


@given(
    latitude=st.floats(-1.5, 1.5),
    altitude=st.floats(200e3, 800e3),
    azimuth=st.floats(0.0, 6.28),
    elevation=st.floats(0.1, 1.57),
)
@examples(50)
def test_paths_end_where_the_altitude_says(latitude, altitude, azimuth, elevation):
    receiver = itrf_from_geodetic([latitude, 0.3, altitude])
    up = itrf_from_geodetic([latitude, 0.3, altitude + 1.0]) - receiver
    east = np.cross([0.0, 0.0, 1.0], up)
    east /= np.linalg.norm(east)
    level = math.sin(azimuth) * east + math.cos(azimuth) * np.cross(up, east)
    direction = math.sin(elevation) * up + math.cos(elevation) * level
    edges = shell_edges(200e3, 800e3)
    paths = shell_paths(receiver[np.newaxis], direction[np.newaxis], np.array([altitude]), edges)
    assert (paths >= 0.0).all()
    assert (paths[0, edges[1:] < altitude] == 0.0).all()
    distance = distance_to_altitude(receiver, direction, 1000e3)
    assert geodetic_from_itrf(receiver + distance * direction)[2] == pytest.approx(1000e3, abs=30.0)


def test_edges_cover_the_orbit_and_reach_the_satellites():
    edges = shell_edges(233e3, 741e3)
    assert edges[0] == 230e3
    assert np.diff(edges)[edges[:-1] < 741e3].max() == 5e3
    assert edges[-1] >= 20.2e6
    assert (np.diff(np.diff(edges)) >= -1e-6).all()
    # An orbit below the peak of the layer has thin shells up to where the peak may be.
    assert np.diff(shell_edges(200e3, 300e3))[50] == 5e3


def test_topside_falls_with_its_exponent():
    edges = shell_edges(230e3, 700e3)
    middle = shell_middles(edges)
    topside = TopsideModel(exponent=4.0, exponent_sigma=1.0)
    precision, vector = log_density_prior(edges, 700e3, topside)
    mean = np.linalg.solve(precision, vector)
    above = middle > 705e3
    slope = np.diff(mean[above]) / np.diff(np.log(middle[above]))
    assert slope == pytest.approx(-4.0, rel=1e-4)
    covariance = np.linalg.inv(precision)
    one, other = np.flatnonzero(above)[5:7]
    rise = math.log(middle[other] / middle[one])
    variance = covariance[one, one] + covariance[other, other] - 2.0 * covariance[one, other]
    assert math.sqrt(variance) == pytest.approx(1.0 * rise, rel=1e-3)


def test_prior_matrix_is_that_of_the_precision_of_neighbours():
    """A prior D' Q D of the logarithms, with the differences D of neighbours, and of their mean."""
    edges, topside = shell_edges(240e3, 300e3), TopsideModel()
    middle = shell_middles(edges)
    precision, vector = log_density_prior(edges, 300e3, topside)
    differences, above = np.diff(np.eye(len(middle)), axis=0), middle[1:] > 500e3
    rise = np.diff(np.log(middle))
    distance = np.abs(np.subtract.outer(*2 * [np.log(middle[1:][above])]))
    covariance = np.eye(len(rise))
    of_exponent = topside.exponent_sigma**2 * np.exp(-distance / topside.correlation_length)
    covariance[np.ix_(above, above)] = of_exponent * np.outer(rise[above], rise[above])
    inverse = np.linalg.inv(covariance)
    level = 1e-4 / len(middle)
    expected = differences.T @ inverse @ differences + level * np.eye(len(middle))
    assert precision == pytest.approx(expected, rel=1e-9, abs=1e-9 * expected.max())
    mean = -topside.exponent * rise * above
    of_mean = differences.T @ inverse @ mean + level * math.log(1e11)
    assert vector == pytest.approx(of_mean, rel=1e-9, abs=1e-9 * np.abs(of_mean).max())
