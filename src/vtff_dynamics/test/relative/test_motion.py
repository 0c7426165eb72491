"""HCW, the state-dependent form and the holding acceleration against exact motion."""

import math

import numpy as np
import pytest
from dynamics_scenarios import EPOCH, remote_sensing_elements, rk4
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.frames.rtn import deputy_state_gcrf, relative_state_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.elements import ClassicalElements
from vtff_dynamics.orbit.gravity import gravity_acceleration, gravity_jerk, gravity_jerks
from vtff_dynamics.orbit.propagator import ForceModel, Propagator
from vtff_dynamics.relative.motion import (
    frame_rates_rtn,
    hcw_input_matrix,
    hcw_state_matrix,
    hcw_transition_matrix,
    holding_acceleration,
    relative_acceleration,
    state_dependent_matrix,
)

TWO_BODY = ForceModel(gravity="two_body")
MEAN_MOTION = 1.1e-3
component = st.floats(-1.0, 1.0)
vectors = st.tuples(component, component, component).map(np.array)


@given(st.floats(1e-4, 2e-3), st.floats(-2e4, 2e4))
def test_hcw_transition_is_the_exponential_of_the_state_matrix(mean_motion, duration):
    expected = expm(hcw_state_matrix(mean_motion) * duration)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(
        hcw_transition_matrix(mean_motion, duration) / scale, expected / scale, atol=1e-9
    )


@given(st.floats(5e-4, 2e-3), st.floats(5.0, 2e4))
def test_hcw_input_is_the_integral_of_the_transition(mean_motion, duration):
    joint = np.zeros((9, 9))
    joint[:6, :6] = hcw_state_matrix(mean_motion)
    joint[3:6, 6:] = np.eye(3)
    expected = expm(joint * duration)[:6, 6:]
    scale = np.abs(expected).max(axis=1, keepdims=True)
    np.testing.assert_allclose(
        hcw_input_matrix(mean_motion, duration) / scale, expected / scale, atol=1e-8
    )


@given(st.floats(-6e3, 6e3), st.floats(-6e3, 6e3))
def test_hcw_transitions_compose(first, second):
    product = hcw_transition_matrix(MEAN_MOTION, first) @ hcw_transition_matrix(MEAN_MOTION, second)
    expected = hcw_transition_matrix(MEAN_MOTION, first + second)
    np.testing.assert_allclose(product, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_state_dependent_matrix_is_hcw_at_the_chief_of_a_circle():
    radius = (GM_EARTH / MEAN_MOTION**2) ** (1 / 3)
    matrix = state_dependent_matrix(np.zeros(6), radius, MEAN_MOTION, 0.0)
    np.testing.assert_allclose(matrix, hcw_state_matrix(MEAN_MOTION), rtol=1e-12, atol=1e-20)


def literal_relative_acceleration(state, radius, rate, rate_change):
    """Alfriend et al. (2010), eqs. (4.14)-(4.16), as printed, in extended precision."""
    x, y, z, vx, vy, _ = np.asarray(state, dtype=np.longdouble)
    r, w, dw = (np.longdouble(value) for value in (radius, rate, rate_change))
    gm = np.longdouble(GM_EARTH)
    distance_cubed = np.sqrt((r + x) ** 2 + y**2 + z**2) ** 3
    return np.array(
        [
            2 * w * vy + dw * y + w**2 * x - gm * (r + x) / distance_cubed + gm / r**2,
            -2 * w * vx - dw * x + w**2 * y - gm * y / distance_cubed,
            -gm * z / distance_cubed,
        ],
        dtype=float,
    )


@given(
    vectors,
    vectors,
    st.floats(6.5e6, 4e7),
    st.floats(1e-4, 2e-3),
    st.floats(-1e-6, 1e-6),
    st.floats(-3.0, 6.0),
)
def test_state_dependent_form_is_the_exact_acceleration(p, v, radius, rate, rate_change, decade):
    state = np.concatenate((10**decade * p, 10 ** (decade - 3) * v))
    matrix = state_dependent_matrix(state, radius, rate, rate_change)
    expected = literal_relative_acceleration(state, radius, rate, rate_change)
    derivative = matrix @ state
    np.testing.assert_array_equal(derivative[:3], state[3:])
    # Rounding is relative to the terms that enter; the literal form itself cancels to 1e-19 g.
    terms = np.abs(matrix[3:]) @ np.abs(state)
    assert np.all(np.abs(derivative[3:] - expected) <= 1e-14 * terms + 1e-17)
    np.testing.assert_allclose(
        relative_acceleration(state, radius, rate, rate_change), derivative[3:], rtol=1e-15
    )


def test_relative_motion_equals_the_difference_of_two_propagated_orbits():
    chief, deputy = (elements.to_state() for elements in remote_sensing_elements())
    start = relative_state_rtn(chief, deputy)
    radius = np.linalg.norm(chief[:3])
    initial = np.concatenate((start, [radius, chief[:3] @ chief[3:] / radius]))
    momentum = np.linalg.norm(np.cross(chief[:3], chief[3:]))

    def derivative(_time, state):
        r, radial_velocity = state[6:]
        rate = momentum / r**2
        rate_change = -2 * rate * radial_velocity / r
        relative = state_dependent_matrix(state[:6], r, rate, rate_change) @ state[:6]
        radial_acceleration = momentum**2 / r**3 - GM_EARTH / r**2
        return np.concatenate((relative, [radial_velocity, radial_acceleration]))

    predicted = rk4(derivative, initial, 0.0, 2.0, 1800)
    propagators = [Propagator(EPOCH, state, TWO_BODY) for state in (chief, deputy)]
    for propagator in propagators:
        for _ in range(3600):
            propagator.advance()
    truth = relative_state_rtn(*(propagator.state_gcrf for propagator in propagators))
    np.testing.assert_allclose(predicted[:3], truth[:3], atol=1e-5)
    np.testing.assert_allclose(predicted[3:6], truth[3:], atol=1e-8)


def test_gravity_and_its_jerk_against_the_harmonics_and_differences():
    chief = remote_sensing_elements()[0].to_state()
    chief[2] += 3e6
    exact = Propagator(EPOCH, chief, ForceModel(degree=2, order=0)).acceleration_gcrf()
    # The pole of date lies 1.6 mrad from the GCRF z axis.
    np.testing.assert_allclose(gravity_acceleration(chief[:3]), exact, atol=1e-4)
    for j2 in (0.0, 1.08e-3):
        step = 0.5
        forward, backward = (
            gravity_acceleration(chief[:3] + sign * step * chief[3:], j2=j2) for sign in (1, -1)
        )
        np.testing.assert_allclose(
            gravity_jerk(chief, j2=j2), (forward - backward) / (2 * step), atol=1e-8
        )
    states, coefficients = np.array([chief, -2.0 * chief]), np.array([0.0, 1.08e-3])
    singly = [
        gravity_jerk(*each) for each in ((states[0], GM_EARTH, 0.0), (states[1], GM_EARTH, 1.08e-3))
    ]
    np.testing.assert_allclose(gravity_jerks(states, coefficients), singly, rtol=1e-14)


@pytest.mark.parametrize("gravity", ["two_body", "spherical_harmonics"])
def test_frame_rates_against_differences_of_the_axes(gravity):
    state = ClassicalElements(6.9e6, 0.044, 1.1, 0.4, 1.0, 0.7).to_state()
    step = 0.5
    propagator = Propagator(EPOCH, state, ForceModel(gravity=gravity), step=step)
    rotations, velocities = [], []
    for index in range(3):
        with_force = gravity == "spherical_harmonics"
        acceleration = propagator.acceleration_gcrf() if with_force else None
        rates = frame_rates_rtn(propagator.state_gcrf, acceleration)
        if index == 1:
            middle = rates
        velocities.append(rates.angular_velocity_rtn)
        rotations.append(rotation_gcrf_to_rtn(propagator.state_gcrf))
        propagator.advance()
    spin = -((rotations[2] - rotations[0]) / (2 * step)) @ rotations[1].T
    vee = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
    np.testing.assert_allclose(middle.angular_velocity_rtn, vee, atol=1e-9)
    change = (velocities[2] - velocities[0]) / (2 * step)
    # The jerk is that of J2 about the GCRF z axis; neglected harmonics give 1e-11 rad/s2.
    np.testing.assert_allclose(middle.angular_acceleration_rtn, change, atol=3e-11)
    if gravity == "two_body":
        assert abs(middle.angular_velocity_rtn[0]) < 1e-20


def test_frame_rates_of_a_chief_with_strong_forces_of_its_own():
    """Forces along T and N together, many times those of gravity, on a curve of third order."""
    position, velocity = np.array([7e6, 1e6, -2e6]), np.array([-800.0, 5e3, 5.5e3])
    acceleration, jerk = np.array([-5.0, 8.0, -9.0]), np.array([0.02, -0.03, 0.05])

    def rates_at(time):
        state = np.concatenate(
            (
                position + time * (velocity + time * (acceleration / 2 + time * jerk / 6)),
                velocity + time * (acceleration + time * jerk / 2),
            )
        )
        return frame_rates_rtn(state, acceleration + time * jerk, jerk)

    step = 0.05
    before, rates, after = (rates_at(time) for time in (-step, 0.0, step))
    change = (after.angular_velocity_rtn - before.angular_velocity_rtn) / (2 * step)
    assert abs(rates.angular_velocity_rtn[0]) > 1e-4
    np.testing.assert_allclose(rates.angular_acceleration_rtn, change, rtol=1e-6, atol=1e-15)


def drift_of_held_target(target, force, with_acceleration, duration):
    """Return the final and the largest distance from the target, m, of a deputy held there.

    Chief and deputy are integrated together; the control is evaluated in every stage.
    """
    chief = remote_sensing_elements()[0].to_state()
    first = force(chief[:3])
    initial = deputy_state_gcrf(
        chief, np.concatenate((target, np.zeros(3))), first if with_acceleration else None
    )

    def derivative(_time, state):
        chief_now, deputy_now = state[:6], state[6:]
        acceleration = force(chief_now[:3])
        control = rotation_gcrf_to_rtn(chief_now).T @ holding_acceleration(
            target, chief_now, acceleration if with_acceleration else None
        )
        return np.concatenate(
            (chief_now[3:], acceleration, deputy_now[3:], force(deputy_now[:3]) + control)
        )

    state = np.concatenate((chief, initial))
    largest = 0.0
    for index in range(10):
        state = rk4(derivative, state, index * duration / 10, 10.0, int(duration / 100))
        distance = np.linalg.norm(relative_state_rtn(state[:6], state[6:])[:3] - target)
        largest = max(largest, distance)
    return largest


TARGET = np.array([-1000.0, -15000.0, 0.0])


def test_holding_acceleration_keeps_the_target_in_the_eccentric_orbit():
    drift = drift_of_held_target(
        TARGET, lambda position: gravity_acceleration(position, j2=0.0), False, 3600.0
    )
    assert drift < 1e-3


def test_holding_acceleration_keeps_the_target_under_j2_with_the_true_acceleration():
    target = TARGET + [0.0, 0.0, 3000.0]
    assert drift_of_held_target(target, gravity_acceleration, True, 3600.0) < 5e-3
    # Without it the target is lost by far: the test can fail.
    assert drift_of_held_target(target, gravity_acceleration, False, 3600.0) > 10.0


@pytest.mark.parametrize(
    ("target", "expected"),
    [((1000.0, 0.0, 0.0), (-3.0, 0.0, 0.0)), ((0.0, 0.0, 10.0), (0.0, 0.0, 1.0))],
)
def test_holding_acceleration_on_a_circle_is_that_of_hcw(target, expected):
    elements = ClassicalElements(6928137.0, 0.0, 1.0, 0.0, 0.0, 0.3)
    control = holding_acceleration(target, elements.to_state())
    linear = np.array(expected) * elements.mean_motion**2 * max(target)
    np.testing.assert_allclose(control, linear, atol=2e-3 * np.linalg.norm(linear))


def test_holding_acceleration_cancels_the_state_dependent_acceleration():
    chief = ClassicalElements(6.9e6, 0.044, 0.2, 0.0, 1.0, 2.0).to_state()
    rates = frame_rates_rtn(chief)
    free = relative_acceleration(
        np.concatenate((TARGET, np.zeros(3))),
        float(np.linalg.norm(chief[:3])),
        rates.angular_velocity_rtn[2],
        rates.angular_acceleration_rtn[2],
    )
    np.testing.assert_allclose(holding_acceleration(TARGET, chief), -free, atol=1e-14)


def test_deputy_at_the_centre_of_the_earth_is_an_error():
    with pytest.raises(ValueError, match="centre of the Earth"):
        state_dependent_matrix([-7e6, 0, 0, 0, 0, 0], 7e6, math.nan, 0.0)
