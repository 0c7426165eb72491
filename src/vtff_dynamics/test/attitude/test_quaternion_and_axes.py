"""Quaternions against scipy, inverse pairs, and the angles to the orbit axes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vtff_dynamics.attitude.orbit_axes import (
    orbit_rate,
    quaternion_from_roll_pitch_yaw,
    roll_pitch_yaw,
    rotation_gcrf_to_orbit,
)
from vtff_dynamics.attitude.quaternion import (
    check_quaternion,
    conjugate,
    from_rotation_matrix,
    from_rotation_vector,
    multiply,
    rotation_matrix,
    rotation_vector,
)
from vtff_dynamics.constants import GM_EARTH

STATE = np.array([7.0e6, 1.0e5, -2.0e5, 100.0, 1500.0, 7300.0])


def drawn(count, seed=1):
    return Rotation.random(count, random_state=seed).as_quat()


def test_quaternions_are_those_of_scipy():
    for p, q in zip(drawn(40), drawn(40, 2), strict=True):
        np.testing.assert_allclose(
            rotation_matrix(p), Rotation.from_quat(p).as_matrix(), atol=1e-14
        )
        product = Rotation.from_quat(p) * Rotation.from_quat(q)
        np.testing.assert_allclose(rotation_matrix(multiply(p, q)), product.as_matrix(), atol=1e-14)
        np.testing.assert_allclose(
            rotation_vector(p), Rotation.from_quat(p).as_rotvec(), atol=1e-13
        )


def test_inverse_pairs():
    for q in drawn(40, 3):
        np.testing.assert_allclose(multiply(q, conjugate(q)), [0.0, 0.0, 0.0, 1.0], atol=1e-15)
        same = from_rotation_matrix(rotation_matrix(q))
        np.testing.assert_allclose(np.sign(same[3]) * same, np.sign(q[3]) * q, atol=1e-14)
        vector = rotation_vector(q)
        np.testing.assert_allclose(
            rotation_vector(from_rotation_vector(vector)), vector, atol=1e-13
        )
    for small in (0.0, 1e-13, 1e-9, 1e-5):
        vector = np.array([small, -2.0 * small, 0.5 * small])
        np.testing.assert_allclose(
            rotation_vector(from_rotation_vector(vector)), vector, rtol=1e-12
        )
    for axis in range(3):  # half turns, where the scalar is zero
        vector = np.zeros(3)
        vector[axis] = math.pi
        matrix = rotation_matrix(from_rotation_vector(vector))
        np.testing.assert_allclose(
            rotation_matrix(from_rotation_matrix(matrix)), matrix, atol=1e-15
        )


def test_orbit_axes_look_forward_against_the_normal_and_down():
    rotation = rotation_gcrf_to_orbit(STATE)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    down = rotation[2]
    np.testing.assert_allclose(down, -STATE[:3] / np.linalg.norm(STATE[:3]), atol=1e-14)
    assert rotation[0] @ STATE[3:] > 7000.0
    assert rotation[1] @ np.cross(STATE[:3], STATE[3:]) < 0.0
    circular = np.array([7.082e6, 0.0, 0.0, 0.0, math.sqrt(GM_EARTH / 7.082e6), 0.0])
    assert orbit_rate(circular) == pytest.approx(2.0 * math.pi / 5931.0, rel=1e-4)


@pytest.mark.parametrize("angles", [(0.1, -0.2, 0.3), (-1.2, 2.8, -3.0), (0.0, 0.0, 0.0)])
def test_roll_pitch_yaw_and_back(angles):
    rotation = rotation_gcrf_to_orbit(STATE)
    quaternion = quaternion_from_roll_pitch_yaw(*angles, rotation)
    body_from_orbit = rotation_matrix(quaternion).T @ rotation.T
    np.testing.assert_allclose(roll_pitch_yaw(body_from_orbit), angles, atol=1e-12)


def test_positive_pitch_lifts_the_nose():
    """A positive turn about y (against the normal) brings x up, away from the Earth."""
    quaternion = quaternion_from_roll_pitch_yaw(0.0, 0.1, 0.0, rotation_gcrf_to_orbit(STATE))
    nose = rotation_matrix(quaternion) @ [1.0, 0.0, 0.0]
    assert nose @ STATE[:3] > 0.0
    right_down = rotation_matrix(
        quaternion_from_roll_pitch_yaw(0.1, 0.0, 0.0, rotation_gcrf_to_orbit(STATE))
    ) @ [0.0, 1.0, 0.0]
    assert right_down @ STATE[:3] < 0.0


def test_bad_quaternions_are_refused():
    with pytest.raises(ValueError, match="attitude: expected four finite numbers"):
        check_quaternion("attitude", [1.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="attitude: expected a length of 1; got 0"):
        check_quaternion("attitude", np.zeros(4))
