"""Motion of a vehicle: extrapolation against independent references, and which command holds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from vtff_dynamics.frames.geodetic import itrf_from_geodetic
from vtff_sim_bridge.simremote import motion
from vtff_sim_bridge.simremote.motion import (
    GeodeticMotionState,
    MotionError,
    MotionState,
    VehicleMotion,
)

small = st.floats(-10.0, 10.0)
vectors = st.tuples(small, small, small)
SECOND = 1_000_000_000


def body_to_ned(heading_elevation_bank: tuple[float, float, float]) -> Rotation:
    return Rotation.from_euler("ZYX", heading_elevation_bank)


@given(st.lists(vectors, min_size=4, max_size=4), st.floats(-5.0, 5.0))
def test_position_is_the_taylor_polynomial(parts: list, seconds: float) -> None:
    state = MotionState(*parts).extrapolate(seconds)
    for axis in range(3):
        # numpy wants the highest power first: position + v t + a t2/2 + j t3/6.
        factors = [1.0 / math.factorial(order) for order in (3, 2, 1, 0)]
        polynomial = np.poly1d([factor * parts[3 - i][axis] for i, factor in enumerate(factors)])
        for order in range(4):
            expected = polynomial.deriv(order)(seconds) if order else polynomial(seconds)
            assert state[order][axis] == pytest.approx(expected, rel=1e-12, abs=1e-10)


@given(vectors, vectors, st.floats(-2.0, 2.0))
def test_constant_rate_turns_exactly(angles: tuple, rate: tuple, seconds: float) -> None:
    angles = (angles[0] / 3.2, angles[1] / 7.0, angles[2] / 3.2)
    state = MotionState((0.0, 0.0, 0.0), heading_elevation_bank=angles, angular_velocity_body=rate)
    turned = body_to_ned(state.extrapolate(seconds).heading_elevation_bank)
    expected = body_to_ned(angles) * Rotation.from_rotvec(np.multiply(rate, seconds))
    # Near +-90 deg elevation the arc sine loses half of the digits.
    assert (turned.inv() * expected).magnitude() < 1e-5
    heading, elevation, bank = state.extrapolate(seconds).heading_elevation_bank
    assert abs(heading) <= math.pi and abs(elevation) <= math.pi / 2 and abs(bank) <= math.pi


def test_changing_rate_is_followed_to_third_order() -> None:
    rate, acceleration, jerk = (0.3, -0.2, 0.5), (0.4, 0.6, -0.3), (0.2, -0.1, 0.3)
    start = (0.3, 0.2, -0.4)
    state = MotionState(
        *[(0.0, 0.0, 0.0)] * 4,
        heading_elevation_bank=start,
        angular_velocity_body=rate,
        angular_acceleration_body=acceleration,
        angular_jerk_body=jerk,
    )

    def derivative(time: float, matrix: np.ndarray) -> np.ndarray:
        w = np.array(rate) + time * np.array(acceleration) + time**2 / 2 * np.array(jerk)
        cross = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        return (matrix.reshape(3, 3) @ cross).ravel()

    errors = []
    for seconds in (0.2, 0.1):
        exact = solve_ivp(
            derivative,
            (0.0, seconds),
            body_to_ned(start).as_matrix().ravel(),
            rtol=1e-12,
            atol=1e-13,
        ).y[:, -1]
        turned = body_to_ned(state.extrapolate(seconds).heading_elevation_bank)
        errors.append(np.abs(turned.as_matrix().ravel() - exact).max())
        assert state.extrapolate(seconds).angular_velocity_body == pytest.approx(
            np.array(rate) + seconds * np.array(acceleration) + seconds**2 / 2 * np.array(jerk)
        )
    # A third-order method: half the time leaves a sixteenth of the error.
    assert errors[0] / errors[1] > 12.0
    assert errors[1] < 1e-5


def test_vertical_attitude_has_no_bank() -> None:
    state = MotionState(
        *[(0.0, 0.0, 0.0)] * 4,
        heading_elevation_bank=(0.4, 0.0, 0.0),
        angular_velocity_body=(0.0, math.pi / 2.0, 0.0),
    )
    assert state.extrapolate(1.0).heading_elevation_bank == pytest.approx((0.4, math.pi / 2, 0.0))


def test_rotation_that_is_not_finite_is_refused() -> None:
    state = MotionState((0.0, 0.0, 0.0), angular_velocity_body=(1e308, 1e308, 0.0))
    with pytest.raises(MotionError, match="not finite"):
        state.extrapolate(100.0)


@given(
    st.floats(-math.pi / 2, math.pi / 2),
    st.floats(-math.pi, math.pi),
    st.floats(-1e3, 1e6),
    vectors,
)
def test_geodetic_motion_in_earth_axes(
    latitude: float, longitude: float, height: float, velocity: tuple
) -> None:
    geodetic = (latitude, longitude, height)
    state = GeodeticMotionState(geodetic, velocity, velocity, velocity).to_earth_fixed()
    assert np.allclose(state.position_itrf, itrf_from_geodetic(geodetic), rtol=0.0, atol=1e-6)
    # North-east-down to Earth-fixed axes: longitude about z, then 90 deg + latitude about -y.
    turn = Rotation.from_euler("ZY", [longitude, -(math.pi / 2 + latitude)])
    for vector in state[1:4]:
        assert vector == pytest.approx(turn.apply(velocity), abs=1e-12)


def test_the_newest_command_not_after_the_time_holds() -> None:
    vehicle = VehicleMotion()
    with pytest.raises(MotionError, match="no motion command holds at 0.000 s"):
        vehicle.at(0)
    vehicle.command(0, MotionState((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    vehicle.command(2 * SECOND, MotionState((20.0, 0.0, 0.0), (2.0, 0.0, 0.0)))
    vehicle.command(SECOND, MotionState((10.0, 0.0, 0.0), (3.0, 0.0, 0.0)))
    assert vehicle.at(SECOND // 2).position_itrf[0] == 0.5
    assert vehicle.at(SECOND).position_itrf[0] == 10.0
    assert vehicle.at(2 * SECOND - 1).position_itrf[0] == pytest.approx(13.0)
    assert vehicle.at(5 * SECOND).position_itrf[0] == 26.0
    vehicle.command(SECOND, MotionState((11.0, 0.0, 0.0)))
    assert len(vehicle) == 3 and vehicle.at(SECOND).position_itrf[0] == 11.0
    assert vehicle.command_times_after(0) == [SECOND, 2 * SECOND]
    assert vehicle.has_command_at(SECOND) and not vehicle.has_command_at(SECOND + 1)


@given(st.lists(st.integers(0, 50), min_size=1), st.integers(0, 60), st.integers(0, 60))
def test_forgetting_changes_nothing_later(times: list[int], now: int, later: int) -> None:
    kept, pruned = VehicleMotion(), VehicleMotion()
    for time in times:
        for vehicle in (kept, pruned):
            vehicle.command(time, MotionState((float(time), 0.0, 0.0)))
    pruned.forget_before(now)
    if now + later >= min(times):
        assert pruned.at(now + later) == kept.at(now + later)
    assert len(pruned) == len([t for t in set(times) if t > now]) + any(t <= now for t in times)


def test_waiting_commands_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motion, "MAXIMUM_STORED_COMMANDS", 3)
    vehicle = VehicleMotion()
    for time in range(3):
        vehicle.command(time, MotionState((0.0, 0.0, 0.0)))
    with pytest.raises(MotionError, match="3 motion commands"):
        vehicle.command(3, MotionState((0.0, 0.0, 0.0)))
    vehicle.command(2, MotionState((1.0, 0.0, 0.0)))
