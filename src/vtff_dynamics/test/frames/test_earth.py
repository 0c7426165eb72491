"""Earth-fixed frame: orthogonality, inverses, derivatives, leap seconds, the Greenwich angle."""

import math

import brahe
import numpy as np
import pytest
from dynamics_scenarios import EPOCH
from hypothesis import given
from hypothesis import strategies as st

from vtff_dynamics.constants import EARTH_ROTATION_RATE
from vtff_dynamics.frames.earth import (
    earth_rotation_angle,
    kinematics_itrf,
    right_ascension_from_longitude,
    rotation_gcrf_to_itrf,
    state_gcrf_to_itrf,
    state_itrf_to_gcrf,
)
from vtff_dynamics.orbit.propagator import ForceModel, Propagator
from vtff_dynamics.time.timescales import leap_seconds, parse_epoch

STATE = np.array([4.2e6, -3.1e6, 4.5e6, 3.9e3, 6.1e3, 0.7e3])
component = st.floats(-1.0, 1.0)
vectors = st.tuples(component, component, component).map(np.array)
seconds = st.integers(-(10**8), 10**8)


@given(seconds)
def test_rotation_to_itrf_is_orthonormal_and_right_handed(offset):
    rotation = rotation_gcrf_to_itrf(EPOCH + offset)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(rotation) == pytest.approx(1.0, abs=1e-14)


@given(seconds, vectors, vectors)
def test_itrf_states_are_inverse(offset, position, velocity):
    state = np.concatenate((7e6 * position, 8e3 * velocity))
    back = state_itrf_to_gcrf(EPOCH + offset, state_gcrf_to_itrf(EPOCH + offset, state))
    np.testing.assert_allclose(back[:3], state[:3], atol=1e-8)
    np.testing.assert_allclose(back[3:], state[3:], atol=1e-11)


def test_itrf_velocity_is_the_derivative_of_the_itrf_position():
    step = 1.0
    fixed = STATE[:3]
    before, after = (rotation_gcrf_to_itrf(EPOCH + s) @ fixed for s in (-step, step))
    velocity = state_gcrf_to_itrf(EPOCH, np.concatenate((fixed, np.zeros(3))))[3:]
    # The third derivative leaves step2 w3 r / 6 = 0.5 um/s; precession and length of day 0.02 mm/s.
    np.testing.assert_allclose((after - before) / (2 * step), velocity, atol=3e-5)


def test_a_point_at_rest_on_the_earth_has_no_derivatives():
    position_itrf = np.array([6e6, 2e6, 1e6])
    state = state_itrf_to_gcrf(EPOCH, np.concatenate((position_itrf, np.zeros(3))))
    to_itrf = rotation_gcrf_to_itrf(EPOCH)
    # The axis follows from the motion itself: w = r x v / r2 corrected for the part along r.
    axis = to_itrf.T @ np.array([0.0, 0.0, EARTH_ROTATION_RATE])
    acceleration = np.cross(axis, state[3:])
    jerk = np.cross(axis, acceleration)
    derivatives = kinematics_itrf(EPOCH, state[:3], state[3:], acceleration, jerk)
    np.testing.assert_allclose(derivatives[0], position_itrf, atol=1e-8)
    np.testing.assert_allclose(derivatives[1], 0.0, atol=1e-11)
    # Polar motion (2e-6 rad), neglected in this test, times w2 r = 0.03 m/s2.
    np.testing.assert_allclose(derivatives[2], 0.0, atol=2e-7)
    np.testing.assert_allclose(derivatives[3], 0.0, atol=2e-11)


@pytest.mark.parametrize("gravity", ["two_body", "spherical_harmonics"])
@pytest.mark.parametrize("thrust", [(0.0, 0.0, 0.0), (0.8, -0.9, 0.7)])
def test_extrapolating_one_second_in_itrf_is_within_a_millimetre(gravity, thrust):
    propagator = Propagator(EPOCH, STATE, ForceModel(gravity=gravity))
    thrust = np.array(thrust)
    for _ in range(300):
        time, state = propagator.time, propagator.state_gcrf
        acceleration = propagator.acceleration_gcrf() + thrust
        position, velocity, acceleration, jerk = kinematics_itrf(
            time, state[:3], state[3:], acceleration, propagator.jerk_gcrf()
        )
        propagator.advance(thrust)
        truth = state_gcrf_to_itrf(propagator.time, propagator.state_gcrf)
        extrapolated = position + velocity + acceleration / 2 + jerk / 6
        assert np.linalg.norm(extrapolated - truth[:3]) < 5e-5
        assert np.linalg.norm(velocity + acceleration + jerk / 2 - truth[3:]) < 2e-5


def test_kinematics_agree_with_the_state_transformation():
    derivatives = kinematics_itrf(EPOCH, STATE[:3], STATE[3:], np.ones(3), np.zeros(3))
    np.testing.assert_allclose(derivatives[:2].ravel(), state_gcrf_to_itrf(EPOCH, STATE))


@given(seconds)
def test_rotation_agrees_with_brahe_away_from_leap_seconds(offset):
    time = EPOCH + offset
    day_ends_with_leap_second = leap_seconds(time) != leap_seconds(time + 86400)
    if day_ends_with_leap_second:
        return
    expected = brahe.rotation_eci_to_ecef(time.to_brahe_epoch())
    np.testing.assert_allclose(rotation_gcrf_to_itrf(time), expected, atol=1e-10)


def test_trap_brahe_turns_the_earth_wrongly_before_a_leap_second_and_this_library_does_not():
    noon = parse_epoch("2016-12-31T12:00:00 UTC")
    ours, theirs = rotation_gcrf_to_itrf(noon), brahe.rotation_eci_to_ecef(noon.to_brahe_epoch())
    error = math.asin((ours @ np.asarray(theirs).T)[0, 1])
    assert abs(error) == pytest.approx(0.5 * EARTH_ROTATION_RATE, rel=0.01)
    # The Earth turns evenly through the night of the leap second.
    times = [noon + hours * 3600 for hours in range(25)]
    angles = np.unwrap([earth_rotation_angle(time) for time in times])
    np.testing.assert_allclose(np.diff(angles) / 3600, EARTH_ROTATION_RATE, rtol=1e-7)
    second = parse_epoch("2016-12-31T23:59:59 UTC")
    angles = np.unwrap([earth_rotation_angle(second + quarter / 4) for quarter in range(13)])
    np.testing.assert_allclose(np.diff(angles) * 4, EARTH_ROTATION_RATE, rtol=1e-7)


def test_greenwich_angle_at_the_epoch_of_paper_000():
    assert math.degrees(right_ascension_from_longitude(EPOCH, 0.0)) == pytest.approx(
        193.705, abs=1e-3
    )
    longitude = math.radians(67.489)
    direction = rotation_gcrf_to_itrf(EPOCH).T @ [math.cos(longitude), math.sin(longitude), 0.0]
    expected = math.atan2(direction[1], direction[0]) % (2 * math.pi)
    # The equator of ITRF is tilted to that of GCRF by the precession since 2000, 1.6 mrad.
    assert right_ascension_from_longitude(EPOCH, longitude) == pytest.approx(expected, abs=3e-6)


def test_shared_rotation_cannot_be_overwritten():
    with pytest.raises(ValueError, match="read-only"):
        rotation_gcrf_to_itrf(EPOCH)[0, 0] = 0.0
