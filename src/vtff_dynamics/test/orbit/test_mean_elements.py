"""Mean elements under J2 against nonlinear flight, and inverse pairs."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from j2_truth import fly

from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.orbit import mean_elements as module
from vtff_dynamics.orbit.mean_elements import (
    elements_from_state,
    mean_elements,
    osculating_elements,
    secular_rates,
    state_from_elements,
)

angles = st.floats(0.0, 2 * math.pi)
orbits = st.tuples(
    st.floats(6.7e6, 9e6), angles, st.floats(0.0, 0.1), angles, st.floats(0.1, 3.0), angles
).map(lambda v: np.array([v[0], v[1], v[2] * math.cos(v[3]), v[2] * math.sin(v[3]), v[4], v[5]]))
SCALE = np.array([7e6, 1.0, 1.0, 1.0, 1.0, 1.0])


@given(orbits)
def test_mean_and_osculating_elements_are_inverse(mean):
    back = mean_elements(osculating_elements(mean))
    np.testing.assert_allclose(back / SCALE, mean / SCALE, atol=2e-14)


@given(orbits)
def test_average_of_gauss_equations_is_the_secular_rate_of_the_literature(mean):
    latitude = 2.0 * math.pi * np.arange(256) / 256
    average = module._j2_rates(mean, latitude).mean(axis=1)
    expected = secular_rates(mean)
    expected[1] -= math.sqrt(GM_EARTH / mean[0] ** 3)
    np.testing.assert_allclose(average / SCALE, expected / SCALE, atol=1e-17, rtol=1e-9)


@pytest.mark.parametrize("eccentricity", [0.0, 0.01, 0.1])
def test_mean_elements_of_a_flight_are_smooth(eccentricity):
    start = np.array([7.15e6, 0.3, eccentricity * 0.8, eccentricity * 0.6, 1.2, 0.5])
    times = np.linspace(0.0, 3.0 * 6000.0, 91)
    flown = fly([state_from_elements(osculating_elements(start))], times)[:, 0]
    osculating = np.array([elements_from_state(state) for state in flown])
    mean = np.array([mean_elements(elements) for elements in osculating])
    for column, swing in ((0, 4e3), (2, 2e-4), (3, 2e-4), (4, 1e-5)):
        trend = np.polyval(np.polyfit(times, mean[:, column], 1), times)
        rest = mean[:, column] - trend
        assert np.ptp(osculating[:, column]) > swing  # there is something to remove
        assert np.abs(rest).max() < 0.006 * np.ptp(osculating[:, column])
    node = np.unwrap(mean[:, 5])
    assert np.polyfit(times, node, 1)[0] == pytest.approx(secular_rates(start)[5], rel=3e-3)


def test_large_eccentricity_is_refused():
    with pytest.raises(ValueError, match="eccentricity up to 0.5 expected, got 0.97"):
        mean_elements(np.array([6.6e6, 0.0, 0.97, 0.0, 1.0, 0.0]))
