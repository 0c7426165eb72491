"""Thrust along the axes of a body: what an attitude that is known, wrong or missing makes of it."""

import math

import numpy as np
import pytest

from vtff_control.thruster.body_axes import BodyAxes, KnownAttitude
from vtff_dynamics.attitude.quaternion import (
    conjugate,
    from_rotation_vector,
    multiply,
    rotation_matrix,
    turned_at_rate,
)
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.propagator import Propagator
from vtff_dynamics.time.timescales import GpsTime

SECOND = 10**9
STAMP = 1_458_521_983 * SECOND
CHIEF = np.array([6928137.0, 0.0, 0.0, 0.0, 3792.54427, 6568.87936])
RATE = np.array([2e-4, -1.1e-3, 3e-4])
QUATERNION = np.array([0.1, -0.5, 0.3, 0.8]) / math.sqrt(0.99)


def known(stamp: int, quaternion=QUATERNION, *, is_valid: bool = True) -> KnownAttitude:
    return KnownAttitude(stamp, is_valid, quaternion, RATE)


def test_the_rotation_is_that_of_attitude_and_orbit_at_the_start_of_the_thrust() -> None:
    axes = BodyAxes()
    axes.add_attitude(known(STAMP - 5 * SECOND))
    axes.add_chief(STAMP, CHIEF)
    rotation = axes.rotation_from_rtn(STAMP, STAMP + SECOND)
    chief = Propagator(GpsTime.from_unix_nanoseconds(STAMP), CHIEF, ForceModel(), step=1.0)
    chief.advance()
    to_rtn = rotation_gcrf_to_rtn(chief.state_gcrf)
    body = rotation_matrix(turned_at_rate(QUATERNION, RATE, 6.0))
    # The harmonics, which the prediction leaves out, turn the orbit by 1e-9 rad in a second.
    np.testing.assert_allclose(rotation, (to_rtn @ body).T, atol=1e-8)
    assert axes.reason == ""


def test_an_error_of_the_attitude_turns_the_thrust_by_its_angle() -> None:
    """The thrust of the body, turned back by the true attitude, is off by the error's angle."""
    error = math.radians(2.0) * np.array([0.0, 0.6, 0.8])
    wrong = multiply(QUATERNION, conjugate(from_rotation_vector(error)))
    axes = BodyAxes()
    axes.add_attitude(KnownAttitude(STAMP - SECOND, True, wrong, np.zeros(3)))
    axes.add_chief(STAMP, CHIEF)
    wanted = np.array([1e-5, 0.0, 0.0])
    body = axes.rotation_from_rtn(STAMP, STAMP) @ wanted
    flown = rotation_gcrf_to_rtn(CHIEF) @ rotation_matrix(QUATERNION) @ body
    assert np.linalg.norm(flown) == pytest.approx(1e-5)
    axis = rotation_gcrf_to_rtn(CHIEF) @ rotation_matrix(QUATERNION) @ (error / 2.0)
    np.testing.assert_allclose(flown - wanted, np.cross(2.0 * axis, wanted), atol=1e-8)


def test_an_attitude_of_the_time_of_a_command_does_not_count() -> None:
    axes = BodyAxes()
    axes.add_chief(STAMP, CHIEF)
    axes.add_attitude(known(STAMP - SECOND))
    before = axes.rotation_from_rtn(STAMP, STAMP + SECOND)
    axes.add_attitude(known(STAMP, np.array([0.0, 0.0, 0.0, 1.0])))
    np.testing.assert_array_equal(axes.rotation_from_rtn(STAMP, STAMP + SECOND), before)
    assert (axes.rotation_from_rtn(STAMP + SECOND, STAMP + 2 * SECOND) != before).any()


@pytest.mark.parametrize(
    ("attitude", "chief_age", "reason"),
    [
        (None, 0, "no attitude yet"),
        (known(STAMP - SECOND, is_valid=False), 0, "attitude not valid"),
        (known(STAMP - 61 * SECOND), 0, "attitude is 61 s old"),
        (known(STAMP - SECOND), None, "orbit of the chief not known"),
        (known(STAMP - SECOND), 90, "orbit of the chief is 90 s old"),
    ],
)
def test_what_is_missing_is_said(attitude, chief_age, reason: str) -> None:
    axes = BodyAxes()
    if attitude is not None:
        axes.add_attitude(attitude)
    if chief_age is not None:
        axes.add_chief(STAMP - chief_age * SECOND, CHIEF)
    assert axes.rotation_from_rtn(STAMP, STAMP) is None
    assert axes.reason == reason
