"""RTN frame: axes, inverses, derivatives and rotation."""

import numpy as np
import pytest
from dynamics_scenarios import EPOCH
from hypothesis import given
from hypothesis import strategies as st

from vtff_dynamics.frames.rtn import (
    angular_velocity_rtn,
    deputy_state_gcrf,
    relative_state_rtn,
    rotation_gcrf_to_rtn,
)
from vtff_dynamics.orbit.propagator import Propagator

STATE = np.array([4.2e6, -3.1e6, 4.5e6, 3.9e3, 6.1e3, 0.7e3])
component = st.floats(-1.0, 1.0)
vectors = st.tuples(component, component, component).map(np.array)
seconds = st.integers(-(10**8), 10**8)


@given(vectors, vectors)
def test_rtn_axes_are_orthonormal_and_along_radius_and_momentum(position, velocity):
    momentum = np.cross(position, velocity)
    if np.linalg.norm(momentum) < 1e-3:
        return
    rotation = rotation_gcrf_to_rtn(np.concatenate((7e6 * position, 8e3 * velocity)))
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(
        rotation @ position, [np.linalg.norm(position), 0, 0], rtol=1e-12, atol=1e-12
    )
    np.testing.assert_allclose(rotation[2] * np.linalg.norm(momentum), momentum, atol=1e-12)
    assert rotation[1] @ velocity > 0.0


@given(vectors, vectors, st.booleans())
def test_relative_and_deputy_states_are_inverse(position, velocity, with_acceleration):
    relative = np.concatenate((1e5 * position, 100.0 * velocity))
    acceleration = np.array([-4.0, 3.0, -4.1]) if with_acceleration else None
    deputy = deputy_state_gcrf(STATE, relative, acceleration)
    back = relative_state_rtn(STATE, deputy, acceleration)
    np.testing.assert_allclose(back[:3], relative[:3], atol=1e-8)
    np.testing.assert_allclose(back[3:], relative[3:], atol=1e-10)


def test_relative_velocity_with_the_true_acceleration_is_the_derivative_of_relative_position():
    step = 1.0
    chief = Propagator(EPOCH, STATE, step=step)
    deputy = Propagator(
        EPOCH, deputy_state_gcrf(STATE, [-1000, -15000, 2000, 0.1, -0.3, 0.2]), step=step
    )
    history = []
    for _ in range(3):
        pair = (chief.state_gcrf, deputy.state_gcrf)
        history.append(
            (
                relative_state_rtn(*pair, chief.acceleration_gcrf()),
                relative_state_rtn(*pair),
            )
        )
        chief.advance()
        deputy.advance()
    derivative = (history[2][0][:3] - history[0][0][:3]) / (2 * step)
    exact, usual = (state[3:] for state in history[1])
    np.testing.assert_allclose(exact, derivative, atol=5e-6)
    # Neglecting the rotation about R: only R is unaffected, and the bound of the docstring holds.
    assert usual[0] == pytest.approx(exact[0], abs=1e-9)
    assert 1e-4 < abs(usual[2] - exact[2]) < 15 * 2e-3


def test_rtn_turns_about_r_by_the_force_along_n():
    momentum = np.cross(STATE[:3], STATE[3:])
    normal = momentum / np.linalg.norm(momentum)
    rates = angular_velocity_rtn(STATE, 0.01 * normal)
    assert rates[0] == pytest.approx(
        0.01 * np.linalg.norm(STATE[:3]) / np.linalg.norm(momentum), rel=1e-12
    )
    assert rates[1] == 0.0
    assert rates[2] == angular_velocity_rtn(STATE)[2]


def test_no_orbital_plane_is_an_error():
    with pytest.raises(ValueError, match="orbital plane"):
        rotation_gcrf_to_rtn([7e6, 0, 0, 1e3, 0, 0])
