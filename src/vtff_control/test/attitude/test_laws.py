"""Laws of detumbling and pointing: each torque against what it is to remove."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vtff_control.attitude.detumble import (
    ThomsonGains,
    b_dot_moment,
    thomson_moment,
)
from vtff_control.attitude.pointing import (
    MomentumGains,
    PitchGains,
    PointingErrors,
    momentum_moment,
    pitch_to_target,
    pitch_wheel_torque,
    pointing_errors,
)
from vtff_dynamics.attitude.field_motion import field_motion
from vtff_dynamics.attitude.orbit_axes import (
    orbit_rate,
    quaternion_from_roll_pitch_yaw,
    rotation_gcrf_to_orbit,
)
from vtff_dynamics.attitude.quaternion import from_rotation_vector, rotation_matrix

STATE = np.array([7.082e6, 0.0, 0.0, 0.0, -1000.0, 7430.0])
INERTIA = np.diag([0.055, 0.058, 0.056])
Y_AXIS = np.array([0.0, 1.0, 0.0])


def seen(rate, field, interval):
    """Return two samples of a fixed field in a body that turns uniformly."""
    turn = rotation_matrix(from_rotation_vector(np.asarray(rate) * interval))
    return field, turn.T @ field


@pytest.mark.parametrize("rate", [(0.3, -0.2, 0.4), (0.0, 0.01, 0.002)])
def test_field_motion_shows_the_rates_across_the_field(rate):
    earlier, later = seen(rate, np.array([10e-6, -5e-6, 30e-6]), 0.8)
    motion = field_motion(earlier, later, 0.8)
    if np.linalg.norm(rate) < 0.1:
        np.testing.assert_allclose(motion.field_rate_body, -np.cross(rate, later), rtol=0.02)
    power = np.cross(b_dot_moment(motion, 1e-3), later) @ rate
    assert power < 0.0
    assert motion.rate_across <= np.linalg.norm(rate) * 1.001


def test_spin_about_y_is_measured_with_its_sign_and_driven_to_its_reference():
    motion = field_motion(*seen((0.0, 0.05, 0.0), np.array([20e-6, 3e-6, -20e-6]), 0.8), 0.8)
    assert motion.spin_y == pytest.approx(0.05, rel=1e-9)
    assert motion.cone_rate == pytest.approx(0.0, abs=1e-9)
    for field in ([5e-6, 0.0, 20e-6], [5e-6, 0.0, -20e-6], [20e-6, 0.0, 5e-6], [-20e-6, 0.0, 5e-6]):
        spinning = field_motion(*seen((0.0, 0.05, 0.0), np.array(field), 0.8), 0.8)
        moment = thomson_moment(spinning, 0.01, ThomsonGains())
        assert np.cross(moment, spinning.field_body)[1] < 0.0
        moment = thomson_moment(spinning, 0.09, ThomsonGains())
        assert np.cross(moment, spinning.field_body)[1] > 0.0


def test_nutation_loses_energy_to_the_y_rod():
    rate = np.array([0.02, 0.0, 0.01])
    motion = field_motion(*seen(rate, np.array([20e-6, 3e-6, 10e-6]), 0.8), 0.8)
    moment = thomson_moment(motion, motion.spin_y, ThomsonGains())
    assert moment[0] == moment[2] == 0.0
    assert np.cross(moment, motion.field_body) @ rate < 0.0


@pytest.mark.parametrize("damping", [0.6, math.sqrt(0.5), 0.8])
def test_sampled_pitch_loop_settles_in_its_time(damping):
    gains = PitchGains.for_settling_time(120.0, 5.0, damping)
    angle, rate, last = 0.2, 0.0, 0.0
    for number in range(200):
        acceleration = -pitch_wheel_torque(angle, rate, 1.0, gains, 1.0)
        for fine in range(50):  # between the samples too
            if abs(angle + fine * 0.1 * (rate + 0.05 * fine * acceleration)) > 0.004:
                last = 5.0 * number + 0.1 * fine
        angle += 5.0 * rate + 12.5 * acceleration
        rate += 5.0 * acceleration
    assert last == pytest.approx(120.0, rel=0.02)
    with pytest.raises(ValueError, match="settling_time: at least"):
        PitchGains.for_settling_time(10.0, 5.0)


def errors_of(roll=0.0, pitch=0.0, yaw=0.0, rate=(0.0, 0.0, 0.0)):
    rotation = rotation_matrix(
        quaternion_from_roll_pitch_yaw(roll, pitch, yaw, rotation_gcrf_to_orbit(STATE))
    )
    turning = -orbit_rate(STATE) * rotation.T @ rotation_gcrf_to_orbit(STATE)[1]
    return pointing_errors(rotation, turning + np.asarray(rate), STATE)


def test_pointing_errors_of_a_body_that_follows_the_orbit():
    errors = errors_of(0.02, -0.03, 0.04, (1e-3, 2e-3, 3e-3))
    np.testing.assert_allclose(errors.angles, [0.02, -0.03, 0.04], atol=1e-12)
    np.testing.assert_allclose(errors.rate_body, [1e-3, 2e-3, 3e-3], atol=1e-15)


def test_torquers_act_against_nutation_wheel_and_tilt():
    field = np.array([20e-6, 2e-6, 25e-6])

    def torque(errors: PointingErrors, wheel: float, gains: MomentumGains):
        moment = momentum_moment(errors, INERTIA, wheel, -5.4e-3, Y_AXIS, field, gains)
        assert moment @ field == pytest.approx(0.0, abs=1e-18)
        return np.cross(moment, field)

    rate = np.array([1e-3, 0.0, -2e-3])
    assert torque(errors_of(rate=rate), -5.4e-3, MomentumGains(5e-3, 0.0, 0.0)) @ rate < 0.0
    assert torque(errors_of(), -5.0e-3, MomentumGains(0.0, 1e-3, 0.0))[1] < 0.0
    assert torque(errors_of(), -5.8e-3, MomentumGains(0.0, 1e-3, 0.0))[1] > 0.0
    tilted = errors_of(roll=0.1)
    normal = tilted.rotation_body_from_orbit[:, 1]
    momentum = -5.4e-3 * Y_AXIS
    sideways = momentum - normal * (normal @ momentum)
    assert torque(tilted, -5.4e-3, MomentumGains(0.0, 0.0, 1e-3)) @ sideways < 0.0


def test_camera_looks_at_the_target():
    below = STATE[:3] * 6.378e6 / 7.082e6
    target = below + 2e5 * rotation_gcrf_to_orbit(STATE)[0] + 1e5 * rotation_gcrf_to_orbit(STATE)[1]
    pitch, roll = pitch_to_target(target, STATE)
    rotation = rotation_matrix(
        quaternion_from_roll_pitch_yaw(roll, pitch, 0.0, rotation_gcrf_to_orbit(STATE))
    )
    line = rotation.T @ (target - STATE[:3])
    np.testing.assert_allclose(line / np.linalg.norm(line), [0.0, 0.0, 1.0], atol=1e-12)
    with pytest.raises(ValueError, match="target: below the horizon"):
        pitch_to_target(-below, STATE)


@pytest.mark.parametrize("tilt_deg", [5.0, 60.0, 90.0, 120.0, 175.0])
def test_the_momentum_is_turned_to_its_goal_from_any_side(tilt_deg):
    """With the field along the axis of the turn nothing else is left, also from opposite to it."""
    wheel, tilt = -5.4e-3, math.radians(tilt_deg)
    normal = np.array([0.0, math.cos(tilt), math.sin(tilt)])  # y of the orbit axes, in the body
    rotation = np.column_stack((np.eye(3)[0], normal, np.cross(np.eye(3)[0], normal)))
    errors = PointingErrors(np.zeros(3), np.zeros(3), rotation, 0.0)
    gains = MomentumGains(nutation=0.0, wheel=0.0, direction=1e-3)
    field = 3e-5 * np.eye(3)[0]
    moment = momentum_moment(errors, INERTIA, wheel, wheel, Y_AXIS, field, gains)
    torque, momentum, goal = np.cross(moment, field), wheel * Y_AXIS, -normal
    expected = 1e-3 * abs(wheel) * (math.sin(tilt) if tilt_deg < 90.0 else 1.0)
    assert torque @ momentum == pytest.approx(0.0, abs=1e-12)
    assert torque @ (goal - momentum * (goal @ momentum) / wheel**2) > 0.0
    assert np.linalg.norm(torque) == pytest.approx(expected, rel=1e-6)
