"""The compiled feedforward has the numbers of the functions that tell its formulas."""

import numpy as np
import pytest

from vtff_control.tracking.feedforward import target_acceleration, velocity_at_rest
from vtff_dynamics.constants import J2_EARTH
from vtff_dynamics.frames.rtn import angular_velocity_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.elements import ClassicalElements
from vtff_dynamics.orbit.gravity import gravity_acceleration, predict_state
from vtff_dynamics.relative.motion import holding_acceleration
from vtff_dynamics.vectors import cross


def test_a_chief_that_falls_has_no_plane():
    falling = np.array([7.0e6, 0.0, 0.0, -100.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="orbital plane"):
        velocity_at_rest(falling, np.ones(3), J2_EARTH)
    with pytest.raises(ValueError, match="orbital plane"):
        target_acceleration(falling, np.ones(6), 1, 1.0, J2_EARTH)


@pytest.mark.parametrize("j2", [J2_EARTH, 0.0])
@pytest.mark.parametrize(("delay_steps", "sample_time"), [(1, 1.0), (0, 0.3), (3, 10.0)])
def test_numbers_are_those_of_single_functions(j2, delay_steps, sample_time):
    generator = np.random.default_rng(2)
    for _ in range(50):
        chief = ClassicalElements(
            generator.uniform(6.8e6, 8e6),
            generator.uniform(0.0, 0.05),
            *generator.uniform(0.1, 3.0, 4),
        ).to_state()
        target = generator.standard_normal(6) * np.array([1e3] * 3 + [1.0] * 3)
        start = predict_state(chief, delay_steps * sample_time, j2)
        middle = predict_state(start, 0.5 * sample_time, j2)
        position = target[:3] + (delay_steps + 0.5) * sample_time * target[3:]
        gravity = gravity_acceleration(middle[:3], j2=j2) if j2 else None
        held = holding_acceleration(position, middle, gravity)
        held += 2.0 * cross(angular_velocity_rtn(middle, gravity), target[3:])
        turn = rotation_gcrf_to_rtn(start) @ rotation_gcrf_to_rtn(middle).T
        np.testing.assert_allclose(
            target_acceleration(chief, target, delay_steps, sample_time, j2),
            turn @ held,
            rtol=1e-12,
            atol=1e-14,
        )
        gravity = gravity_acceleration(chief[:3], j2=j2) if j2 else None
        rate = angular_velocity_rtn(chief, gravity)[0]
        np.testing.assert_allclose(
            velocity_at_rest(chief, position, j2),
            cross((rate, 0.0, 0.0), position),
            rtol=1e-12,
            atol=1e-20,
        )
