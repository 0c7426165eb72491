"""Linearised relative motion, against HCW and against nonlinear flight."""

import math

import numpy as np
import pytest

from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.frames.rtn import deputy_state_gcrf, relative_state_rtn
from vtff_dynamics.orbit.elements import ClassicalElements
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.relative.linearised import linearise_motion
from vtff_dynamics.relative.motion import hcw_transition_matrix

AXIS = 7.0e6
MEAN_MOTION = math.sqrt(GM_EARTH / AXIS**3)


def reference(eccentricity=0.0):
    return ClassicalElements(AXIS, eccentricity, 1.1, 0.3, 0.7, 0.4).to_state()


def test_circular_orbit_without_j2_is_hcw():
    motion = linearise_motion(reference(), 60.0, 40, j2=0.0)
    scale = np.array([1.0] * 3 + [MEAN_MOTION] * 3)
    for index in (1, 17, 40):
        expected = hcw_transition_matrix(MEAN_MOTION, 60.0 * index)
        error = (motion.from_start[index] - expected) / scale[:, np.newaxis] * scale
        assert np.abs(error).max() < 1e-6
    # Closed form of the integral of the transition over a held acceleration.
    times = np.linspace(0.0, 60.0, 20001)
    response = np.array([hcw_transition_matrix(MEAN_MOTION, 60.0 - t)[:, 3:] for t in times])
    expected = np.trapezoid(response, times, axis=0)
    np.testing.assert_allclose(motion.effects[7], expected, rtol=1e-6, atol=1e-5)
    np.testing.assert_array_equal(motion.within_effects[:, -1], motion.effects)


@pytest.mark.parametrize("eccentricity", [0.0, 0.05])
def test_nonlinear_flight_under_j2(eccentricity):
    state = reference(eccentricity)
    relative = np.array([20.0, -30.0, 15.0, 0.01, -0.03, 0.02])
    motion = linearise_motion(state, 97.0, 60)
    times = np.arange(0.0, 97.0 * 60 + 1.0, 9.7)
    flown = free_flight([state, deputy_state_gcrf(state, relative)], times)
    true = np.array([relative_state_rtn(first, second) for first, second in flown])
    none = np.zeros((1, 60, 3))
    modelled = motion.fly(relative[np.newaxis], none)[0]
    # What is left out is of the second order in the distance.
    left_out = np.linalg.norm(true[:, :3], axis=1).max() ** 2 / AXIS
    assert np.abs(modelled[:, :3] - true[::10, :3]).max() < left_out
    within = motion.fly_within(relative[np.newaxis], none)[0]
    assert within.shape[1] == 11
    np.testing.assert_allclose(within[1:, 0], within[:-1, -1], atol=1e-9)
    assert np.abs(within[:, 3] - true[3::10, :3]).max() < left_out


def test_first_steps_and_bad_steps():
    motion = linearise_motion(reference(), 30.0, 4)
    assert motion.first(3).count == 3
    assert len(motion.first(3).from_start) == 4
    with pytest.raises(ValueError, match="step, count"):
        linearise_motion(reference(), 0.0, 3)
