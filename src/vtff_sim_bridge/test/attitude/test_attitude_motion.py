"""Attitude in motion commands, against what the emulator makes of them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vtff_dynamics.attitude.quaternion import from_rotation_vector, multiply, rotation_matrix
from vtff_dynamics.frames.earth import kinematics_itrf, rotation_gcrf_to_itrf
from vtff_dynamics.orbit.elements import ClassicalElements
from vtff_dynamics.time.timescales import parse_epoch
from vtff_sim_bridge.attitude.attitude_motion import attitude_motion
from vtff_sim_bridge.bridge.simgen_link import motion_state
from vtff_sim_bridge.gnss.vehicle_track import vehicle_track
from vtff_sim_bridge.simremote.motion import VehicleMotion

TIME = parse_epoch("2023-03-20T12:00:00 UTC")
LEVER_ARM = np.array([0.1, -0.3, -0.4])


def flown(seed, rate_body):
    """Return a drawn attitude in a drawn place, and the track of its antenna over a second."""
    generator = np.random.default_rng(seed)
    elements = ClassicalElements(7.0e6, 0.01, 1.0, *generator.uniform(0.0, 6.28, 3))
    state = elements.to_state()
    quaternion = Rotation.random(random_state=seed).as_quat()
    acceleration = -3.986004418e14 * state[:3] / np.linalg.norm(state[:3]) ** 3
    motion = kinematics_itrf(TIME, state[:3], state[3:], acceleration, np.zeros(3))
    turning = attitude_motion(TIME, state, quaternion, rate_body)
    vehicle = VehicleMotion()
    vehicle.command(0, motion_state(np.concatenate((motion, turning))))
    centre = vehicle_track(vehicle, 1, slice(0, 20))
    return quaternion, centre, vehicle_track(vehicle, 1, slice(0, 20), LEVER_ARM)


@pytest.mark.parametrize("rate", [0.0, 0.002, 0.05])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_antenna_is_where_the_turning_body_has_it(seed, rate):
    """Through angles to the horizon and the extrapolation of the emulator, over a second."""
    rate_body = rate * np.array([0.6, -0.64, 0.48])
    quaternion, centre, antenna = flown(seed, rate_body)
    for row in range(20):
        after = 0.05 * (row + 1)
        turned = multiply(quaternion, from_rotation_vector(after * rate_body))
        to_itrf = rotation_gcrf_to_itrf(TIME + after) @ rotation_matrix(turned)
        arm = antenna.position_itrf[row] - centre.position_itrf[row]
        np.testing.assert_allclose(arm, to_itrf @ LEVER_ARM, atol=2e-5)
        np.testing.assert_allclose(antenna.boresight_itrf[row], -to_itrf[:, 2], atol=1e-4)


def test_a_body_along_the_horizon_has_no_angles_and_turns_with_it():
    state = ClassicalElements(7.0e6, 0.01, 1.0, 0.3, 0.4, 0.5).to_state()
    first = attitude_motion(TIME, state, np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3))
    heading, elevation, bank = first[0]
    to_ned = Rotation.from_euler("ZYX", [heading, elevation, bank])
    level = (Rotation.from_quat([0.0, 0.0, 0.0, 1.0]) * to_ned.inv()).as_quat()
    angles, rate, acceleration, jerk = attitude_motion(TIME, state, level, np.zeros(3))
    np.testing.assert_allclose(angles, 0.0, atol=1e-9)
    # Against GCRF it does not turn; the horizon does, about its own north and east.
    assert 0.9e-3 < np.linalg.norm(rate) < 1.4e-3
    assert np.linalg.norm(acceleration) < 1e-5 and not jerk.any()
