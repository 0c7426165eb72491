"""A step of flight against an integration with thrust and gravity in every stage."""

import numpy as np
import pytest
from safety_samples import CHIEF
from scipy.integrate import solve_ivp

from vtff_control.safety.step_flight import advance_deputy, fly_chief
from vtff_dynamics.frames.rtn import deputy_state_gcrf, relative_state_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.gravity import gravity_acceleration


def fly(state, chief, acceleration_rtn, step):
    thrust = rotation_gcrf_to_rtn(chief).T @ acceleration_rtn

    def rates(_time, state):
        return np.concatenate((state[3:], gravity_acceleration(state[:3]) + thrust))

    return solve_ivp(rates, (0.0, step), state, method="DOP853", rtol=1e-13, atol=1e-9).y[:, -1]


@pytest.mark.parametrize("step", [1.0, 0.3])
def test_a_step_is_the_integrated_one(step):
    generator = np.random.default_rng(1)
    for _ in range(20):
        chief = CHIEF * generator.uniform(0.98, 1.1, 6)
        thrusts = 0.3 * generator.standard_normal((2, 3))
        states = fly_chief(chief, thrusts, step)
        after = fly(chief, chief, thrusts[0], step)
        expected = [chief, after, fly(after, after, thrusts[1], step)]
        np.testing.assert_allclose(states, expected, rtol=0.0, atol=1e-6)
        relative = generator.standard_normal(6) * 10.0 ** generator.uniform(-3.0, 3.0, 6)
        deputy = fly(deputy_state_gcrf(chief, relative), chief, thrusts[1], step)
        np.testing.assert_allclose(
            advance_deputy(relative, chief, after, thrusts[1], step),
            relative_state_rtn(after, deputy),
            rtol=0.0,
            atol=1e-6,
        )


def test_a_chief_that_falls_straight_down_has_no_axes():
    with pytest.raises(ValueError, match="orbital plane"):
        fly_chief(np.array([7e6, 0.0, 0.0, -7e3, 0.0, 0.0]), np.zeros((1, 3)), 1.0)
