"""Compiled free flight against another integrator and other equations."""

import numpy as np
import pytest
from j2_truth import fly

from vtff_dynamics.orbit.elements import ClassicalElements
from vtff_dynamics.orbit.free_flight import free_flight

STATES = [
    ClassicalElements(7.0e6, 0.01, 1.0, 0.2, 0.3, 0.4).to_state(),
    ClassicalElements(7.1e6, 0.0, 1.7, 0.2, 0.3, 0.4).to_state(),
]


def test_one_orbit_agrees_with_scipy():
    times = np.arange(0.0, 6001.0, 10.0)
    true = fly(STATES, times)
    flown = free_flight(STATES, times)
    assert np.abs(flown[..., :3] - true[..., :3]).max() < 0.02
    # The motion between two close spacecraft is far better than that of each.
    near = np.array([STATES[0], STATES[0] + [50.0, -80.0, 30.0, 0.05, 0.02, -0.03]])
    true, flown = fly(near, times), free_flight(near, times)
    error = np.diff(flown, axis=1) - np.diff(true, axis=1)
    assert np.abs(error[..., :3]).max() < 1e-5


@pytest.mark.parametrize(("states", "times"), [(STATES[0], [0.0, 1.0]), (STATES, [[0.0]])])
def test_wrong_shapes_are_named(states, times):
    with pytest.raises(ValueError, match="shape"):
        free_flight(states, times)
