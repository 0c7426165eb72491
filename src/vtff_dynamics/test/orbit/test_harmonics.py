"""Compiled gravity and its Runge-Kutta step against those of brahe."""

from __future__ import annotations

import brahe
import numpy as np
import pytest

from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf
from vtff_dynamics.frames.earth_environment import jgm3_gravity_model
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.harmonics import (
    advance_under_gravity,
    gravity_terms,
    harmonic_acceleration,
)
from vtff_dynamics.orbit.propagator import Propagator
from vtff_dynamics.time.timescales import GpsTime

TIME = GpsTime(1_000_000_000_500_000_000)
STATES = [
    np.array([3.0e6, 5.0e6, 3.6e6, -4.0e3, 1.0e3, 5.5e3]),
    np.array([-2.0e6, 1.0e5, -6.6e6, 7.0e3, 2.0e3, -1.5e3]),
]
ACCELERATION = np.array([1e-3, 2e-3, -5e-2])


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize(("degree", "order"), [(2, 0), (8, 8), (20, 20), (50, 3), (70, 70)])
def test_harmonics_are_those_of_brahe(state, degree, order):
    to_itrf = rotation_gcrf_to_itrf(TIME)
    expected = brahe.accel_gravity_spherical_harmonics(
        state[:3], to_itrf, jgm3_gravity_model(), degree, order
    )
    found = harmonic_acceleration(to_itrf @ state[:3], *gravity_terms(degree, order))
    np.testing.assert_allclose(to_itrf.T @ found, expected, rtol=0, atol=1e-13)


def test_no_harmonics_are_the_point_mass():
    position = STATES[0][:3]
    expected = -3.986004415e14 * position / np.linalg.norm(position) ** 3
    found = harmonic_acceleration(position, *gravity_terms(0, 0))
    np.testing.assert_allclose(found, expected, rtol=1e-14)


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("step", [0.25, 1.0, 5.0])
@pytest.mark.parametrize("degree", [2, 20, 50])
def test_a_step_is_that_of_the_propagator(state, step, degree):
    """Thrust included; nanometres and nanometres a second."""
    model = ForceModel(degree=degree, order=degree)
    expected = Propagator(TIME, state, model, step=step).advance(ACCELERATION)
    found = advance_under_gravity(
        state, ACCELERATION, rotation_gcrf_to_itrf(TIME), step, *gravity_terms(degree, degree)
    )
    np.testing.assert_allclose(found[:3], expected[:3], rtol=0, atol=5e-9)
    np.testing.assert_allclose(found[3:], expected[3:], rtol=0, atol=1e-10)
