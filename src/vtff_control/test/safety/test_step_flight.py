"""A compiled step of flight has the numbers of the functions that it stands for."""

import numpy as np
import pytest
from safety_samples import CHIEF

from vtff_control.safety.step_flight import advance_deputy, fly_chief
from vtff_dynamics.frames.rtn import deputy_state_gcrf, relative_state_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.free_flight import add_thrust
from vtff_dynamics.orbit.gravity import predict_state


def fly(state, chief, acceleration_rtn, step):
    after = predict_state(state, step)
    add_thrust(after, rotation_gcrf_to_rtn(chief).T @ acceleration_rtn, step)
    return after


@pytest.mark.parametrize("step", [1.0, 0.3, 10.0])
def test_numbers_are_those_of_single_functions(step):
    generator = np.random.default_rng(1)
    for _ in range(200):
        chief = CHIEF * generator.uniform(0.98, 1.1, 6)
        thrusts = generator.standard_normal((2, 3)) * 10.0 ** generator.integers(-6, 1)
        states = fly_chief(chief, thrusts, step)
        after = fly(chief, chief, thrusts[0], step)
        expected = [chief, after, fly(after, after, thrusts[1], step)]
        np.testing.assert_allclose(states, expected, rtol=1e-14)
        relative = generator.standard_normal(6) * 10.0 ** generator.uniform(-3.0, 4.0, 6)
        deputy = fly(deputy_state_gcrf(chief, relative), chief, thrusts[1], step)
        np.testing.assert_allclose(
            advance_deputy(relative, chief, after, thrusts[1], step),
            relative_state_rtn(after, deputy),
            rtol=1e-12,
            atol=1e-8,
        )


def test_a_chief_that_falls_straight_down_has_no_axes():
    with pytest.raises(ValueError, match="orbital plane"):
        fly_chief(np.array([7e6, 0.0, 0.0, -7e3, 0.0, 0.0]), np.zeros((1, 3)), 1.0)
