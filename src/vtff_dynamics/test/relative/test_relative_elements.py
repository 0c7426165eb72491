"""Relative elements as lengths: inverse pairs, the linear map, and impulses."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vtff_dynamics.orbit.mean_elements import (
    elements_from_state,
    osculating_elements,
    state_from_elements,
)
from vtff_dynamics.relative.relative_elements import (
    control_matrix,
    linear_map_rtn,
    mean_relative_elements,
    relative_elements_rtn,
    relative_state_of_elements,
    relative_state_of_mean_elements,
)

CHIEF_MEAN = np.array([7.1e6, 0.7, 3e-3, -2e-3, 1.1, 0.4])
CHIEF = state_from_elements(osculating_elements(CHIEF_MEAN))
CIRCULAR = np.array([7.1e6, 0.7, 0.0, 0.0, 1.1, 0.4])
MEAN_MOTION = math.sqrt(3.986004415e14 / 7.1e6**3)
lengths = st.lists(st.floats(-2e3, 2e3), min_size=6, max_size=6).map(np.array)


@given(lengths)
def test_states_and_osculating_elements_are_inverse(relative):
    state = relative_state_of_elements(CHIEF, relative)
    np.testing.assert_allclose(relative_elements_rtn(CHIEF, state), relative, atol=1e-5)


@given(lengths)
def test_states_and_mean_elements_are_inverse(relative):
    state = relative_state_of_mean_elements(CHIEF_MEAN, relative)
    np.testing.assert_allclose(mean_relative_elements(CHIEF, state), relative, atol=1e-5)


@pytest.mark.parametrize("latitude", [0.0, 0.7, 2.5, 4.0])
def test_linear_map_is_the_derivative_of_the_exact_one(latitude):
    chief = CIRCULAR.copy()
    chief[1] = latitude
    matrix = linear_map_rtn(MEAN_MOTION, latitude)
    state = state_from_elements(chief)
    for column in range(6):
        step = np.zeros(6)
        step[column] = 10.0
        exact = relative_state_of_elements(state, step)
        np.testing.assert_allclose(matrix[:3] @ step, exact[:3], atol=1e-4)
        np.testing.assert_allclose(matrix[3:] @ step, exact[3:], atol=1e-7)


@pytest.mark.parametrize("latitude", [0.0, 0.7, 2.5, 4.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_control_matrix_is_the_effect_of_an_impulse(latitude, axis):
    chief = CIRCULAR.copy()
    chief[1] = latitude
    velocity = np.zeros(6)
    velocity[3 + axis] = 0.01
    exact = relative_elements_rtn(state_from_elements(chief), velocity)
    linear = control_matrix(MEAN_MOTION, latitude)[:, axis] * 0.01
    np.testing.assert_allclose(linear, exact, atol=2e-4)


def test_linear_map_undoes_the_control_matrix():
    product = linear_map_rtn(MEAN_MOTION, 1.3) @ control_matrix(MEAN_MOTION, 1.3)
    np.testing.assert_allclose(product, np.vstack((np.zeros((3, 3)), np.eye(3))), atol=1e-9)


def test_mean_and_osculating_relative_elements_differ():
    state = relative_state_of_mean_elements(CHIEF_MEAN, [0.0, 0.0, 500.0, 0.0, 500.0, 0.0])
    difference = relative_elements_rtn(CHIEF, state) - mean_relative_elements(CHIEF, state)
    assert np.abs(difference).max() > 0.5
    np.testing.assert_allclose(elements_from_state(CHIEF)[0], 7.1e6, atol=2e4)
