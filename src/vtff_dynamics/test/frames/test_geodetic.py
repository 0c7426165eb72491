"""Geodetic coordinates and local axes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vtff_dynamics.frames.geodetic import (
    geodetic_from_itrf,
    itrf_from_geodetic,
    rotation_itrf_to_enu,
)
from vtff_dynamics.vectors import norm

STATE = np.array([4.2e6, -3.1e6, 4.5e6, 3.9e3, 6.1e3, 0.7e3])
component = st.floats(-1.0, 1.0)
vectors = st.tuples(component, component, component).map(np.array)
seconds = st.integers(-(10**8), 10**8)


@given(
    st.floats(-math.pi / 2, math.pi / 2),
    st.floats(-math.pi, math.pi, exclude_min=True),
    st.floats(-5e3, 4e7),
)
def test_geodetic_and_itrf_are_inverse(latitude, longitude, height):
    position = itrf_from_geodetic([latitude, longitude, height])
    back = geodetic_from_itrf(position)
    np.testing.assert_allclose(itrf_from_geodetic(back), position, atol=1e-6)
    assert back[2] == pytest.approx(height, abs=1e-6)


def test_geodetic_of_known_points_and_of_arrays():
    points = np.array([[0.0, 0.0, 0.0], [math.pi / 2, 0.0, 0.0], [0.0, math.pi / 2, 1000.0]])
    expected = np.array([[6378137.0, 0.0, 0.0], [0.0, 0.0, 6356752.314245], [0.0, 6379137.0, 0.0]])
    np.testing.assert_allclose(itrf_from_geodetic(points), expected, atol=1e-6)
    geodetic = geodetic_from_itrf(expected)
    assert geodetic.shape == (3, 3)
    np.testing.assert_allclose(geodetic[[0, 2]], points[[0, 2]], atol=1e-6)
    np.testing.assert_allclose(geodetic[1, [0, 2]], [math.pi / 2, 0.0], atol=1e-6)


@given(st.floats(-1.5, 1.5), st.floats(-3.1, 3.1), st.floats(-100.0, 1e6))
def test_enu_axes_are_the_derivatives_of_geodetic_coordinates(latitude, longitude, height):
    geodetic = np.array([latitude, longitude, height])
    rotation = rotation_itrf_to_enu(itrf_from_geodetic(geodetic))
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-14)
    for row, step in enumerate(([0.0, 1e-6, 0.0], [1e-6, 0.0, 0.0], [0.0, 0.0, 10.0])):
        change = itrf_from_geodetic(geodetic + step) - itrf_from_geodetic(geodetic - step)
        assert rotation @ change / norm(change) == pytest.approx(np.eye(3)[row], abs=1e-8)
