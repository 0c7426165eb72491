"""Rotation of a rigid body against closed solutions and conserved quantities."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from vtff_dynamics.attitude.quaternion import from_rotation_vector, rotation_matrix
from vtff_dynamics.attitude.rigid_body import AttitudeState, OrbitInterval, check_inertia
from vtff_dynamics.attitude.spacecraft import AttitudePropagator, SpacecraftBody, TorqueWindow
from vtff_dynamics.constants import GM_EARTH

FAR = np.full((3, 3), 1e12)
"""A position at which the gravity gradient is nothing."""
UNIT = np.array([0.0, 0.0, 0.0, 1.0])


def interval(duration=5.0, field=(0.0, 0.0, 0.0), position=None, drag=(0.0, 0.0, 0.0)):
    positions = FAR if position is None else np.tile(position, (3, 1))
    return OrbitInterval(duration, np.tile(field, (3, 1)), positions, np.array(drag))


def momentum_gcrf(propagator):
    state, body = propagator.state, propagator.body
    momentum = body.inertia @ state.rate_body + state.wheel_momentum * body.wheel_axis
    return state.rotation_gcrf_from_body @ momentum


def test_free_rotation_follows_the_elliptic_functions_of_jacobi():
    """Landau and Lifshitz, Mechanics, section 37; energy above that of the middle axis."""
    moments = np.array([0.04, 0.05, 0.06])
    rate = np.array([0.02, 0.0, 0.05])
    propagator = AttitudePropagator(SpacecraftBody(inertia=moments), AttitudeState(UNIT, rate))
    doubled, square = float(moments @ rate**2), float(moments**2 @ rate**2)
    a, b, c = moments
    assert square > doubled * b
    speed = math.sqrt((c - b) * (square - doubled * a) / (a * b * c))
    modulus = (b - a) * (doubled * c - square) / ((c - b) * (square - doubled * a))
    worst = 0.0
    for number in range(1, 101):
        propagator.advance(interval())
        sn, cn, dn, _ = ellipj(speed * 5.0 * number, modulus)
        expected = [
            math.sqrt((doubled * c - square) / (a * (c - a))) * cn,
            math.sqrt((doubled * c - square) / (b * (c - b))) * sn,
            math.sqrt((square - doubled * a) / (c * (c - a))) * dn,
        ]
        worst = max(worst, np.abs(propagator.state.rate_body - expected).max())
    assert worst < 1e-10
    assert 500.0 * speed > 2.0 * ellipk(modulus)  # the test saw more than half a period


def test_tumble_with_wheel_keeps_momentum_and_energy():
    body = SpacecraftBody(inertia=[[0.05, 1e-3, -2e-3], [1e-3, 0.06, 5e-4], [-2e-3, 5e-4, 0.055]])
    start = AttitudeState(from_rotation_vector(np.array([0.3, -1.0, 0.4])), [0.3, -0.4, 0.1], 2e-3)
    propagator = AttitudePropagator(body, start)
    before = momentum_gcrf(propagator)
    energy = start.rate_body @ body.inertia @ start.rate_body
    for _ in range(200):
        propagator.advance(interval())
    after = propagator.state
    np.testing.assert_allclose(momentum_gcrf(propagator), before, rtol=0.0, atol=3e-6 * 0.03)
    assert after.rate_body @ body.inertia @ after.rate_body == pytest.approx(energy, rel=3e-6)
    assert np.linalg.norm(after.quaternion_gcrf) == pytest.approx(1.0, abs=1e-14)


def test_wheel_torque_moves_momentum_between_wheel_and_body():
    propagator = AttitudePropagator(SpacecraftBody(), AttitudeState(UNIT, np.zeros(3)))
    propagator.advance(interval(), wheel_torque=2e-4)
    state = propagator.state
    assert state.wheel_momentum == pytest.approx(1e-3, rel=1e-12)
    np.testing.assert_allclose(state.rate_body, [0.0, -1e-3 / 0.058, 0.0], atol=1e-12)
    np.testing.assert_allclose(momentum_gcrf(propagator), 0.0, atol=1e-15)
    for _ in range(30):
        propagator.advance(interval(), wheel_torque=1.0)
    assert propagator.state.wheel_momentum == pytest.approx(0.01, rel=1e-9)


@pytest.mark.parametrize(
    ("axis", "moments", "factor"),
    # Pitch and roll of a spacecraft with its z axis down: 3 n^2 (I_x - I_z) / I_y and the like.
    [(1, (0.06, 0.07, 0.03), (0.06 - 0.03) / 0.07), (0, (0.06, 0.07, 0.03), (0.07 - 0.03) / 0.06)],
)
def test_gravity_gradient_libration(axis, moments, factor):
    """In a fixed position (no orbit), the pendulum of the gravity gradient alone."""
    radius = 7.082e6
    angle = 1e-3
    vector = np.zeros(3)
    vector[axis] = angle
    start = AttitudeState(from_rotation_vector(vector), np.zeros(3))
    propagator = AttitudePropagator(SpacecraftBody(inertia=moments, longest_step=1.0), start)
    frequency = math.sqrt(3.0 * GM_EARTH / radius**3 * factor)
    for number in range(1, 801):
        propagator.advance(interval(position=[0.0, 0.0, -radius]))
        turned = 2.0 * propagator.state.quaternion_gcrf[axis]
        assert turned == pytest.approx(angle * math.cos(frequency * 5.0 * number), abs=2e-6)


def test_compass_needle_is_the_pendulum():
    """Period of a finite swing: 4 K(sin^2(angle / 2)) / omega."""
    field, dipole, moment, angle = 32.5e-6, 0.2, 0.058, math.radians(100.0)
    body = SpacecraftBody(inertia=(moment, moment, moment), dipole=(0.0, 0.0, -dipole))
    start = AttitudeState(from_rotation_vector(np.array([0.0, angle, 0.0])), np.zeros(3))
    propagator = AttitudePropagator(body, start)
    frequency = math.sqrt(field * dipole / moment)
    assert frequency == pytest.approx(0.0106, abs=5e-5)  # the paper's, ten swings an orbit
    period = 4.0 * ellipk(math.sin(0.5 * angle) ** 2) / frequency
    cycles = round(period * 3.0 / 5.0)
    last = interval(3.0 * period - 5.0 * cycles + 5.0, field=(0.0, 0.0, -field))
    for _ in range(cycles - 1):
        propagator.advance(interval(field=(0.0, 0.0, -field)))
    propagator.advance(last)
    state = propagator.state
    assert 2.0 * math.atan2(state.quaternion_gcrf[1], state.quaternion_gcrf[3]) == pytest.approx(
        angle, abs=1e-5
    )
    assert np.abs(state.rate_body).max() < 1e-6


def test_kick_of_the_paper_has_the_peak_of_the_pendulum():
    """0.19 mN m for 3 s in compass mode: 2 asin(omega / 2 omega_d) = 55.3 deg, paper 55."""
    body = SpacecraftBody(dipole=(0.0, 0.0, -0.2))
    propagator = AttitudePropagator(body, AttitudeState(UNIT, np.zeros(3)))
    thruster = TorqueWindow.of_thruster(1.0, 4.0, [0.0, 0.0, 0.05], [0.0038, 0.0, 0.0])
    np.testing.assert_allclose(thruster.torque_body, [0.0, -1.9e-4, 0.0])
    kicked = interval(field=(0.0, 0.0, -32.5e-6))
    propagator.advance(kicked, windows=[thruster])
    largest = 0.0
    for _ in range(60):
        propagator.advance(kicked)
        quaternion = propagator.state.quaternion_gcrf
        largest = max(largest, 2.0 * math.asin(np.linalg.norm(quaternion[:3])))
    assert math.degrees(largest) == pytest.approx(55.3, abs=0.5)


def test_moment_of_torquers_acts_crosswise_for_as_long_as_the_pulse():
    field = 30e-6
    body = SpacecraftBody(inertia=(0.06, 0.06, 0.06))
    propagator = AttitudePropagator(body, AttitudeState(UNIT, np.zeros(3)))
    propagator.advance(interval(field=(0.0, 0.0, field)), pulses=(1.23, 0.0, 2.0))
    # x cross z is -y; the moment along the field does nothing. It turns by 0.1 mrad meanwhile.
    expected = -0.127 * field * 1.23 / 0.06
    np.testing.assert_allclose(propagator.state.rate_body, [0.0, expected, 0.0], atol=2e-4 * 8e-5)
    coupled = dataclasses.replace(
        body, torquer_coupling=[[1.0, 0.0, 0.1], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    )
    np.testing.assert_allclose(
        AttitudePropagator(coupled, AttitudeState(UNIT, np.zeros(3))).torquer_moment(
            (1.0, 0.0, -2.0), 0.5
        ),
        [0.127 * 0.9, 0.0, -0.127],
    )


def test_drag_turns_about_its_lever_arm():
    body = SpacecraftBody(inertia=(0.06, 0.06, 0.06), drag_point=(0.0, 0.0, 0.02))
    propagator = AttitudePropagator(body, AttitudeState(UNIT, np.zeros(3)))
    propagator.advance(interval(drag=(-1e-6, 0.0, 0.0)))
    np.testing.assert_allclose(propagator.state.rate_body, [0.0, -1e-7 / 0.06, 0.0], atol=1e-11)


def test_dipole_changes_by_the_day():
    body = SpacecraftBody(dipole=(0.1, 0.0, 0.0), dipole_rate=(0.0, 0.864, 0.0))
    propagator = AttitudePropagator(body, AttitudeState(UNIT, np.zeros(3)))
    for _ in range(20):
        propagator.advance(interval())
    np.testing.assert_allclose(propagator.dipole, [0.1, 1e-3, 0.0], rtol=1e-12)


def test_free_flight_is_the_same_whoever_stops_it():
    """Stops at whole steps change no bit: the ADCS period is no part of the truth."""
    start = AttitudeState(UNIT, [0.02, -0.01, 0.005])
    body = SpacecraftBody(dipole=(0.05, 0.0, -0.1))
    whole, pieces = AttitudePropagator(body, start), AttitudePropagator(body, start)
    flight = interval(field=(1e-5, 2e-5, -2e-5))
    whole.advance(flight)
    pieces.advance(flight, end=2.0)
    pieces.advance(flight, start=2.0)
    np.testing.assert_allclose(pieces.state.to_array(), whole.state.to_array(), atol=1e-14)


def test_rotation_is_that_of_its_rate():
    """Half a turn about z moves x to -x: the sense of the kinematics."""
    rate = math.pi / 2.0 / 5.0
    propagator = AttitudePropagator(
        SpacecraftBody(inertia=(0.06, 0.06, 0.06)), AttitudeState(UNIT, [0.0, 0.0, rate])
    )
    propagator.advance(interval())
    matrix = rotation_matrix(propagator.state.quaternion_gcrf)
    np.testing.assert_allclose(matrix @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-8)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"inertia": (0.05, 0.06, -0.01)}, "inertia: expected a positive definite"),
        ({"inertia": (0.05, 0.06, 0.12)}, "inertia: no body has these principal moments"),
        ({"inertia": [[1, 2, 0], [0, 1, 0], [0, 0, 1]]}, "inertia: expected a symmetric"),
        ({"inertia": (0.05, 0.06)}, "inertia: expected 3 or 3 x 3"),
        ({"dipole": (0.1, float("nan"), 0.0)}, "dipole: expected 3 finite numbers"),
        ({"wheel_axis": (0.0, 0.0, 0.0)}, "wheel_axis: expected a vector that is not zero"),
        ({"torquer_moment": 0.0}, "torquer_moment: expected a positive"),
        ({"torquer_coupling": (1.0, 1.0, 1.0)}, "torquer_coupling: expected 3 x 3"),
    ],
)
def test_bad_bodies_are_refused_in_one_line(changes, message):
    with pytest.raises(ValueError, match=message) as caught:
        SpacecraftBody(**changes)
    assert "\n" not in str(caught.value)


def test_bad_states_are_refused():
    with pytest.raises(ValueError, match="wheel_momentum: the wheel turns with at most 5000"):
        AttitudePropagator(SpacecraftBody(), AttitudeState(UNIT, np.zeros(3), 0.011))
    with pytest.raises(ValueError, match="quaternion_gcrf: expected a length of 1"):
        AttitudeState([0.0, 0.0, 0.0, 2.0], np.zeros(3))
    with pytest.raises(ValueError, match="wheel speed: expected at most 5000 rpm"):
        SpacecraftBody().wheel_momentum(-6000.0)
    with pytest.raises(ValueError, match=r"inertia_kgm2: .* positive definite"):
        check_inertia("inertia_kgm2", np.zeros((3, 3)))
