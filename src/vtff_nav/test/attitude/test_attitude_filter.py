"""The multiplicative filter: its linear model, convergence, honesty, options."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from attitude_support import DIPOLE as TRUE_DIPOLE
from attitude_support import TRACK, MeasuredFlight

from vtff_dynamics.attitude.quaternion import (
    conjugate,
    from_rotation_vector,
    multiply,
    rotation_vector,
)
from vtff_dynamics.attitude.spacecraft import TorqueWindow
from vtff_nav.attitude.attitude_filter import AttitudeFilter
from vtff_nav.attitude.configuration import AttitudeFilterConfiguration, BodyModel
from vtff_nav.attitude.field_error import FIELD_STATES, FieldErrorModel
from vtff_nav.attitude.filter_bank import AttitudeFilterBank
from vtff_nav.attitude.kernels import (
    BIAS,
    DIPOLE,
    DRIFT,
    FIELD,
    INERTIA,
    OFFSETS,
    RATE,
    TORQUE,
    WHEEL,
    predict_attitude,
)

STATES = FIELD + FIELD_STATES + OFFSETS
STILL = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0])
"""No noise; times of a second, in which what is not there does not change."""
NO_FORCE = np.zeros((1, 3))
FORCES = np.array([[2e-4, -1e-4, 5e-5], [-1e-4, 3e-4, 0.0], [0.0, 0.0, 1e-4], [4e-5, 0.0, -3e-4]])
"""N; the equal parts of a period end within the steps of the filter."""
FIELD_PARTIAL = np.random.default_rng(5).standard_normal((3, FIELD_STATES))


def predicted(change, covariance):
    """Predict over a period from a state with an error; pulses, wheel and field error act."""
    inertia = np.diag([0.055, 0.058, 0.056])
    quaternion = from_rotation_vector(np.array([0.3, -0.8, 0.5]))
    quaternion = multiply(quaternion, from_rotation_vector(change[:3]))
    mean = np.concatenate(([0.01, -0.02, 0.005], [0.1, 0.05, -0.2], np.zeros(STATES - RATE - 6)))
    mean += change[3:]
    state = TRACK.state_gcrf(0)
    predict_attitude(
        quaternion, mean, covariance, 5.0, 20, TRACK.field_gcrf(0), TRACK.field_gcrf(1),
        state[:3], 1e-3, 1.1e-3, np.array([0.0, 1.0, 0.0]), inertia,
        np.array([2.0, -1.0, 4.0]), 0.127, np.eye(3), STILL, FIELD_PARTIAL, np.zeros(FIELD_STATES),
        FORCES,
    )  # fmt: skip
    return quaternion, mean[:3]


def test_linear_model_is_the_derivative_of_the_motion():
    """Each column of the transition against a central difference of the prediction."""
    parts = (
        (1e-4, 3), (1e-5, 3), (1e-4, 3), (1e-9, 3), (1e-4, 3), (1e-6, 3), (1e-6, 1),
        (1e-6, 3), (1e-8, FIELD_STATES), (1e-3, OFFSETS),
    )  # fmt: skip
    scale = np.concatenate([[value] * count for value, count in parts])
    centre, _ = predicted(np.zeros(STATES), np.zeros((STATES, STATES)))
    for column in [
        *range(BIAS),
        *range(INERTIA, DRIFT),
        *range(WHEEL, FIELD + 20),
        *range(STATES - OFFSETS, STATES),
    ]:
        change = np.zeros(STATES)
        change[column] = scale[column]
        ends = []
        for sign in (1.0, -1.0):
            quaternion, rate = predicted(sign * change, np.zeros((STATES, STATES)))
            turned = rotation_vector(multiply(conjugate(centre), quaternion))
            ends.append(np.concatenate((turned, rate)))
        numeric = (ends[0] - ends[1]) / (2.0 * scale[column])
        covariance = np.zeros((STATES, STATES))
        covariance[column, column] = 1.0
        predicted(np.zeros(STATES), covariance)
        # With a single variance the predicted covariance is the square of the column.
        sign = np.sign(numeric[np.argmax(np.abs(numeric))])
        biggest = int(np.argmax(np.abs(numeric)))
        analytic = sign * covariance[:6, biggest] / math.sqrt(covariance[biggest, biggest])
        np.testing.assert_allclose(analytic, numeric, atol=2e-3 * np.abs(numeric).max())
    assert BIAS - DIPOLE == DRIFT - INERTIA == WHEEL - DRIFT == FIELD - TORQUE == RATE == 3


def at_rest(mean, covariance, noise, variances):
    """Predict a minute of a body at rest without field."""
    state = TRACK.state_gcrf(0)
    predict_attitude(
        np.array([0.0, 0.0, 0.0, 1.0]), mean, covariance, 60.0, 1, np.zeros(3), np.zeros(3),
        state[:3], 0.0, 0.0, np.array([0.0, 1.0, 0.0]), np.eye(3),
        np.zeros(3), 0.127, np.eye(3), noise, np.zeros((3, len(variances))), variances,
        NO_FORCE,
    )  # fmt: skip


def test_coefficients_of_the_field_keep_their_covariance():
    """In a prediction from the steady state; what was learned is forgotten in their time."""
    variances = FieldErrorModel(3e-7).variances
    states = FIELD + FIELD_STATES
    covariance, mean = np.zeros((states, states)), np.zeros(states - RATE)
    covariance[FIELD:, FIELD:] = np.diag(variances)
    mean[FIELD - RATE :] = 1e-7
    at_rest(mean, covariance, np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 600.0, 0.0, 1.0]), variances)
    np.testing.assert_allclose(mean[FIELD - RATE :], 1e-7 * math.exp(-0.1), rtol=1e-12)
    np.testing.assert_allclose(covariance[FIELD:, FIELD:], np.diag(variances), rtol=1e-12)


def test_a_dipole_follows_its_drift():
    covariance, mean = np.zeros((FIELD, FIELD)), np.zeros(FIELD - RATE)
    covariance[DRIFT:WHEEL, DRIFT:WHEEL] = 4.0 * np.eye(3)
    mean[DRIFT - RATE : WHEEL - RATE] = (1.0, -2.0, 3.0)
    noise = np.array([0.0, 2.0, 600.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0])
    at_rest(mean, covariance, noise, np.zeros(0))
    np.testing.assert_allclose(mean[DIPOLE - RATE : BIAS - RATE], (60.0, -120.0, 180.0))
    kept = math.exp(-0.1)
    np.testing.assert_allclose(mean[DRIFT - RATE : WHEEL - RATE], kept * np.array((1, -2, 3)))
    np.testing.assert_allclose(covariance[DIPOLE:BIAS, DIPOLE:BIAS], 14400.0 * np.eye(3))
    np.testing.assert_allclose(covariance[DIPOLE:BIAS, DRIFT:WHEEL], 240.0 * kept * np.eye(3))
    np.testing.assert_allclose(covariance[DRIFT:WHEEL, DRIFT:WHEEL], 4.0 * np.eye(3), rtol=1e-12)


def test_the_wheel_takes_back_what_it_gave():
    """Its error is bounded: the doubt of the rate does not grow from period to period."""
    covariance, mean = np.zeros((FIELD, FIELD)), np.zeros(FIELD - RATE)
    noise = np.array([0.0, 0.0, 1.0, 0.0, 2e-7, 0.0, 1.0, 0.0, 1.0])
    for _ in range(5):
        at_rest(mean, covariance, noise, np.zeros(0))
        assert covariance[RATE + 1, RATE + 1] == pytest.approx(4e-14, rel=1e-9)
        assert covariance[RATE + 1, WHEEL] == pytest.approx(-4e-14, rel=1e-9)
        assert covariance[RATE, RATE] == 0.0


def test_from_37_degrees_the_attitude_and_the_dipole_are_found():
    flight = MeasuredFlight(2)
    axis = flight.generator.standard_normal(3)
    off = from_rotation_vector(math.radians(37.0) * axis / np.linalg.norm(axis))
    running = AttitudeFilter(
        BodyModel(), AttitudeFilterConfiguration(), multiply(flight.state.quaternion_gcrf, off)
    )
    errors = []
    for _ in range(300):
        period, sample = flight.fly()
        running.predict(period)
        assert running.update(sample, period.field_end_gcrf)
        errors.append(np.degrees(np.linalg.norm(flight.errors(running.estimate)[:3])))
    assert max(errors[90:]) < 5.0
    assert max(errors[-60:]) < 0.6
    assert np.abs(flight.errors(running.estimate)[6:]).max() < 1e-3
    assert running.estimate.dipole_sigma.max() < 1e-3


def test_bank_finds_the_attitude_from_nothing_and_comes_down_to_one():
    flight = MeasuredFlight(5)
    first = flight.sample()
    bank = AttitudeFilterBank.about_field(
        BodyModel(), AttitudeFilterConfiguration(), first, TRACK.field_gcrf(0)
    )
    assert bank.members == 24
    for _ in range(240):
        period, sample = flight.fly()
        bank.predict(period)
        bank.update(sample, period.field_end_gcrf)
    assert bank.members == 1
    errors = flight.errors(bank.estimate)
    assert np.degrees(np.linalg.norm(errors[:3])) < 1.0
    nees = errors @ np.linalg.solve(bank.estimate.covariance[:9, :9], errors) / 9.0
    assert nees < 3.0


def test_pulses_of_the_torquers_are_known_to_the_filter():
    """The same flight, with pulses that the filter is not told of, is not explained."""
    flight = MeasuredFlight(6)
    settings = AttitudeFilterConfiguration(
        initial_rotation_sigma_deg=1.0,
        initial_rate_sigma=1e-4,
        estimates_dipole=False,
        initial_dipole=TRUE_DIPOLE,
    )
    state = flight.state
    filters = [
        AttitudeFilter(BodyModel(), settings, state.quaternion_gcrf, state.rate_body)
        for _ in range(2)
    ]
    mean = np.zeros(2)
    for number in range(60):
        period, sample = flight.fly((1.5, -3.0 * (number % 2), 2.0))
        blind = type(period)(**{**vars(period), "pulses": np.zeros(3)})
        for index, told in enumerate((period, blind)):
            filters[index].predict(told)
            filters[index].update(sample, period.field_end_gcrf)
            mean[index] += filters[index].normalised_innovation_squared / 180.0
    assert mean[0] < 1.5
    assert mean[1] > 3.0 * mean[0]


def test_a_pulse_that_ends_within_a_step_acts_as_long_as_it_is():
    """Against the truth, whose steps are ten times shorter; a mean over the step is 3e-7 off."""
    flight = MeasuredFlight(8, wheel_rpm=-2700.0)
    settings = AttitudeFilterConfiguration(initial_dipole=TRUE_DIPOLE)
    for pulses in ((3.37, -1.52, 2.81), (0.0, 0.46, -4.0), (-2.5, 2.5, 2.5)):
        state = flight.state
        known = AttitudeFilter(BodyModel(), settings, state.quaternion_gcrf, state.rate_body)
        period, _ = flight.fly(pulses)
        known.predict(period)
        errors = flight.errors(known.estimate)
        np.testing.assert_allclose(errors[:3], 0.0, atol=1e-7)
        np.testing.assert_allclose(errors[3:6], 0.0, atol=1e-8)


def thrusting(offset_sigma, offsets, told=True, seed=9, periods=400):
    """Fly with thrusters that miss the centre of mass; return flight, filter, mean innovation."""
    flight = MeasuredFlight(seed, wheel_rpm=-2700.0, rate=1e-3)
    state = flight.state
    settings = AttitudeFilterConfiguration(
        initial_rotation_sigma_deg=1.0,
        initial_rate_sigma=2e-4,
        thruster_offset_sigma=offset_sigma,
    )
    known = AttitudeFilter(BodyModel(), settings, state.quaternion_gcrf, state.rate_body)
    forces = np.random.default_rng((seed, 1)).uniform(-1e-4, 1e-4, (periods, 5, 3))
    # A thruster fires for a while, and then the other way.
    forces = forces + 5e-5 * np.sign(np.sin(0.05 * np.arange(periods)))[:, None, None]
    torques = []
    for row in forces:
        torques.append([])
        for force in row:
            arms = np.zeros((3, 3))
            for axis in range(3):
                arms[axis, [(axis + 1) % 3, (axis + 2) % 3]] = offsets[axis]
            torques[-1].append(np.cross(arms, np.diag(force)).sum(axis=0))
    squares = []
    for row, torque in zip(forces, torques, strict=True):
        windows = [
            TorqueWindow(float(second), second + 1.0, value) for second, value in enumerate(torque)
        ]
        period, sample = flight.fly(windows=windows)
        period = replace(period, thruster_forces=row if told else NO_FORCE)
        known.predict(period)
        known.update(sample, period.field_end_gcrf)
        squares.append(known.normalised_innovation_squared / 3.0)
    return flight, known, float(np.mean(squares[20:]))


def test_offsets_of_thrusters_are_found_from_what_these_report():
    """Five millimetres, of which the filter is not told before, and their sigma is true."""
    offsets = np.array([[0.005, -0.005], [-0.004, 0.005], [0.003, 0.005]])
    flight, known, innovation = thrusting(0.005, offsets)
    found = known.estimate.thruster_offsets
    sigma = np.sqrt(np.diag(known.estimate.covariance)[-OFFSETS:]).reshape(3, 2)
    assert sigma.max() < 0.002
    assert (np.abs(found - offsets) < 4.0 * sigma).all()
    assert 0.8 < innovation < 1.2
    errors = flight.errors(known.estimate)[:3]
    assert errors @ np.linalg.solve(known.estimate.covariance[:3, :3], errors) < 16.3
    _, blind, unexplained = thrusting(0.0, offsets)
    assert unexplained > 1.3
    assert not blind.estimate.thruster_offsets.any()


def test_without_reports_of_thrust_offsets_are_not_learnt():
    offsets = np.full((3, 2), 0.004)
    _, known, _ = thrusting(0.005, offsets, told=False, periods=40)
    sigma = np.sqrt(np.diag(known.estimate.covariance)[-OFFSETS:])
    np.testing.assert_allclose(sigma, 0.005, rtol=1e-9)


def test_rods_that_give_a_tenth_more_are_explained_where_they_may_be_wrong():
    weak = BodyModel(torquer_moment=0.9 * BodyModel.torquer_moment)
    told = {
        "initial_rotation_sigma_deg": 1.0,
        "initial_rate_sigma": 1e-4,
        "estimates_dipole": False,
        "initial_dipole": TRUE_DIPOLE,
    }
    mean = {}
    for sigma in (0.0, 0.1):
        flight = MeasuredFlight(6)
        settings = AttitudeFilterConfiguration(torquer_sigma=sigma, **told)
        state = flight.state
        known = AttitudeFilter(weak, settings, state.quaternion_gcrf, state.rate_body)
        squares = []
        for number in range(60):
            period, sample = flight.fly((1.5, -3.0 * (number % 2), 2.0))
            known.predict(period)
            known.update(sample, period.field_end_gcrf)
            squares.append(known.normalised_innovation_squared / 3.0)
        mean[sigma] = np.mean(squares)
    assert mean[0.1] < 1.5
    assert mean[0.0] > 2.0


def test_bias_is_estimated_where_asked_and_its_place_stays_zero_where_not():
    bias = np.array([0.4e-6, -0.3e-6, 0.2e-6])
    flight = MeasuredFlight(7)
    state = flight.state
    settings = AttitudeFilterConfiguration(
        initial_rotation_sigma_deg=5.0, initial_rate_sigma=1e-3, bias_sigma=0.5e-6
    )
    asked = AttitudeFilter(BodyModel(), settings, state.quaternion_gcrf, state.rate_body)
    plain = AttitudeFilter(
        BodyModel(), AttitudeFilterConfiguration(), state.quaternion_gcrf, state.rate_body
    )
    for _ in range(400):
        period, sample = flight.fly()
        for running in (asked, plain):
            running.predict(period)
            running.update(sample + bias, period.field_end_gcrf)
    estimate = asked.estimate
    sigma = np.sqrt(np.diag(estimate.covariance)[BIAS:INERTIA])
    assert (np.abs(estimate.magnetometer_bias - bias) < 4.0 * sigma).all()
    assert sigma.max() < 0.1e-6
    assert not plain.estimate.magnetometer_bias.any()
    assert not plain.estimate.covariance[BIAS:DRIFT, :].any()


def test_outliers_are_gated_and_bad_numbers_refused():
    flight = MeasuredFlight(8)
    settings = AttitudeFilterConfiguration(
        gate=30.0, initial_rotation_sigma_deg=0.5, initial_rate_sigma=1e-4
    )
    running = AttitudeFilter(
        BodyModel(), settings, flight.state.quaternion_gcrf, flight.state.rate_body
    )
    period, sample = flight.fly()
    running.predict(period)
    before = running.estimate
    assert not running.update(sample + 5e-6, period.field_end_gcrf)
    np.testing.assert_array_equal(running.estimate.covariance, before.covariance)
    assert running.update(sample, period.field_end_gcrf)
    with pytest.raises(ValueError, match="torque_noise: expected 0 or more"):
        AttitudeFilterConfiguration(torque_noise=-1.0)
    with pytest.raises(ValueError, match="inertia: no body has these"):
        BodyModel(inertia=(0.1, 0.1, 0.3))
