"""The short step of the closed-form gravity, and the mean motion that it keeps."""

import math

import numpy as np
import pytest
from dynamics_scenarios import EPOCH

from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.orbit.elements import ClassicalElements, osculating_mean_motion
from vtff_dynamics.orbit.gravity import gravity_acceleration, predict_state
from vtff_dynamics.orbit.propagator import ForceModel, Propagator

ORBIT = ClassicalElements(7.0e6, 0.044, math.radians(50.0), 1.0, 0.5, 0.3)
STATE = ORBIT.to_state()


@pytest.mark.parametrize("duration", [-5.0, 1.0, 20.0])
def test_predicted_two_body_state_is_that_of_kepler(duration):
    mean_motion = math.sqrt(GM_EARTH / ORBIT.semi_major_axis**3)
    moved = Propagator(EPOCH, STATE, ForceModel(gravity="two_body"), step=1.0)
    predicted = predict_state(STATE, duration, j2=0.0)
    if duration > 0.0:
        for _ in range(round(duration)):
            moved.advance()
        np.testing.assert_allclose(predicted[:3], moved.state_gcrf[:3], rtol=0.0, atol=1e-3)
        np.testing.assert_allclose(predicted[3:], moved.state_gcrf[3:], rtol=0.0, atol=1e-4)
    back = predict_state(predicted, -duration, j2=0.0)
    np.testing.assert_allclose(back[:3], STATE[:3], rtol=0.0, atol=2e-3)
    assert osculating_mean_motion(predicted) == pytest.approx(mean_motion, rel=1e-9)


def test_a_second_under_j2_is_that_of_a_fine_integration():
    state, count = STATE.copy(), 1000
    for _ in range(count):
        # Leapfrog: second order, but of 1 ms steps.
        half = state[3:] + 0.5 / count * gravity_acceleration(state[:3])
        position = state[:3] + half / count
        state = np.concatenate((position, half + 0.5 / count * gravity_acceleration(position)))
    predicted = predict_state(STATE, 1.0)
    np.testing.assert_allclose(predicted[:3], state[:3], rtol=0.0, atol=1e-5)
    np.testing.assert_allclose(predicted[3:], state[3:], rtol=0.0, atol=1e-6)
    assert np.linalg.norm(predicted[:3] - predict_state(STATE, 1.0, j2=0.0)[:3]) > 1e-3


def test_mean_motion_needs_an_ellipse():
    fast = np.concatenate((STATE[:3], 2.0 * STATE[3:]))
    with pytest.raises(ValueError, match="not on an elliptic orbit"):
        osculating_mean_motion(fast)
