"""The evasive manoeuvre restores the bound, flown with finite burns and nonlinear truth."""

import math

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st
from safety_samples import CHIEF, predict_formation, relative

from vtff_control.safety.escape import ClearBounds, find_escape
from vtff_dynamics.frames.rtn import deputy_state_gcrf, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.free_flight import free_flight

BOUNDS = ClearBounds(30.0, 32.0, 3.7)
CAP = 1.4


def fly(state, escape, start, acceleration, duration):
    """Return the smallest distance from the chief of a deputy that burns as told."""
    burn = max(np.abs(escape) / acceleration)
    states = np.array([CHIEF, deputy_state_gcrf(CHIEF, state)])
    distances = []
    thrust = None
    for second in np.arange(0.0, duration, 0.5):
        if burn and start <= second < start + burn:
            if thrust is None:
                thrust = rotation_gcrf_to_rtn(states[0]).T @ escape / burn
            share = min(start + burn - second, 0.5)
            states[1, :3] += 0.5 * 0.5 * share * thrust
            states[1, 3:] += share * thrust
        states = free_flight(states, [0.0, 0.5])[-1]
        distances.append(np.linalg.norm(states[1, :3] - states[0, :3]))
    return min(distances)


@settings(max_examples=15, deadline=None)
@given(
    st.floats(250.0, 1500.0),
    st.floats(0.0, 2.0 * math.pi),
    st.floats(-0.4, 0.4),
    st.floats(1.0, 22.0),
    st.floats(-30.0, 30.0),
)
@example(1465.0, 0.0, 0.0, 19.0, -5.0)  # nearest between two samples
def test_escape_restores_the_bound(distance, side, height, speed, miss):
    """A deputy is on its way to the chief, from any side, and passes within 30 m."""
    sight = np.array([math.cos(side) * math.cos(height), math.sin(side) * math.cos(height),
                      math.sin(height)])  # fmt: skip
    across = np.cross(sight, [0.0, 0.0, 1.0])
    state = np.concatenate((distance * sight + miss * across, -speed * sight))
    motion = predict_formation([state])
    escape = find_escape(motion, 1, BOUNDS, np.full(3, CAP), 50.0, 2.0, 600.0)
    assert escape is not None
    assert np.abs(escape).max() <= 50.0
    # Burns of seconds are taken as impulses in their middle: a metre.
    assert fly(state, escape, 2.0, CAP, 600.0) > 30.5


def test_drift_is_stopped_where_that_is_enough():
    motion = predict_formation([relative(t=900.0, vt=-20.0)])
    escape = find_escape(motion, 1, BOUNDS, np.full(3, CAP), 50.0, 2.0, 600.0)
    np.testing.assert_allclose(escape[1], 20.0, atol=0.5)


def test_axes_without_thrust_are_not_used():
    available = np.array([CAP, 0.0, CAP])
    escape = find_escape(
        predict_formation([relative(t=400.0, vt=-20.0)]), 1, BOUNDS, available, 50.0, 2.0, 600.0
    )
    assert escape[1] == 0.0
    assert np.linalg.norm(escape) > 1.0


def test_a_deputy_that_cannot_is_told():
    available = np.full(3, 1e-4)
    motion = predict_formation([relative(t=200.0, vt=-5.0)])
    assert find_escape(motion, 1, BOUNDS, available, 50.0, 2.0, 600.0) is None


def test_other_deputies_are_kept_clear_of_too():
    """Another deputy stands where a braked one would come to rest: the way round it is taken."""
    state = relative(t=700.0, vt=-30.0)
    alone = find_escape(predict_formation([state]), 1, BOUNDS, np.full(3, CAP), 50.0, 2.0, 600.0)
    np.testing.assert_allclose(alone[1], 30.0, atol=0.5)
    motion = predict_formation([state, relative(t=300.0)])
    around = find_escape(motion, 1, BOUNDS, np.full(3, CAP), 50.0, 2.0, 600.0)
    assert np.abs(around[[0, 2]]).max() > 1.0


def test_a_small_evasion_turns_the_relative_vectors():
    """A follower that drifts towards the chief over an orbit: centimetres per second do."""
    motion = predict_formation([relative(t=300.0, vt=0.0, r=-10.0, vr=0.0)])
    horizon = float(motion.times[-1])
    escape = find_escape(motion, 1, BOUNDS, np.full(3, CAP), 50.0, 0.0, horizon)
    assert 0.0 < np.linalg.norm(escape) < 0.2
