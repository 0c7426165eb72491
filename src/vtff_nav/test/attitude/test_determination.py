"""Determination of the attitude through faults of the sensor, and its new start."""

from __future__ import annotations

import copy
import itertools

import numpy as np
import pytest
from attitude_support import DIPOLE, EPOCH, MeasuredFlight

from vtff_dynamics.attitude.quaternion import conjugate, multiply, rotation_vector
from vtff_dynamics.attitude.spacecraft import TorqueWindow
from vtff_nav.attitude.configuration import AttitudeFilterConfiguration, BodyModel
from vtff_nav.attitude.determination import AttitudeDetermination, DeterminationConfiguration
from vtff_nav.attitude.wheel_observer import WheelObserver, WheelObserverConfiguration
from vtff_nav.relative.common.body_attitude import BodyAttitude


@pytest.fixture(scope="module")
def converged():
    """A flight of twenty minutes and its determination."""
    flight = MeasuredFlight(3)
    determination = AttitudeDetermination(BodyModel(), AttitudeFilterConfiguration())
    for number in range(240):
        status = determination.process(*flight.fly())
        assert number > 0 or not status.valid
    assert status.valid and status.used and not status.reason
    return flight, determination


def test_faulty_samples_are_named_and_bridged(converged):
    flight, determination = converged
    period, sample = flight.fly()
    assert determination.process(period, None).reason == "magnetometer silent"
    period, sample = flight.fly()
    status = determination.process(period, np.array([60e-6, 1e-6, 1e-6]))
    assert status.reason == "magnetometer saturated" and not status.used and status.valid
    for _ in range(4):
        status = determination.process(flight.fly()[0], sample)
    assert status.reason == "magnetometer stuck: 4 equal samples"
    period, sample = flight.fly()
    assert "uT where the field has" in determination.process(period, 0.5 * sample).reason
    period, sample = flight.fly()
    assert "finite" in determination.process(period, [np.nan, 0.0, 0.0]).reason
    for _ in range(20):
        status = determination.process(*flight.fly())
    assert status.valid and status.used and not status.reason and status.restarts == 0
    assert np.degrees(np.linalg.norm(flight.errors(determination.estimate)[:3])) < 1.0


def test_corrections_are_what_samples_have_turned_and_no_pulses_of_the_torquers():
    """Pulses at the start of a period: the mean of the rates at both ends is none of the period."""
    flight = MeasuredFlight(3)
    known = AttitudeFilterConfiguration(
        initial_rotation_sigma_deg=0.01,
        initial_rate_sigma=1e-6,
        initial_dipole=DIPOLE,
        initial_dipole_sigma=1e-4,
    )
    determination = AttitudeDetermination(BodyModel(), known)
    assert np.isnan(determination.correction).all()
    determination.expect(flight.state.quaternion_gcrf, flight.state.rate_body)
    attitudes, corrections = [], []
    for _ in range(30):
        predicting = copy.deepcopy(determination)
        period, sample = flight.fly((2.0, 0.0, -1.0))
        predicting.process(period, None)
        np.testing.assert_array_equal(predicting.correction, 0.0)
        determination.process(period, sample)
        estimate = determination.estimate
        predicted = conjugate(predicting.estimate.quaternion_gcrf)
        turned = rotation_vector(multiply(predicted, estimate.quaternion_gcrf))
        np.testing.assert_allclose(determination.correction, turned, atol=1e-12)
        attitudes.append(
            BodyAttitude(
                EPOCH + 5.0 * flight.number,
                estimate.quaternion_gcrf,
                estimate.rate_body,
                estimate.covariance[:3, :3],
            )
        )
        corrections.append(determination.correction)
    turns = [later.turn_from(one, later.time) for one, later in itertools.pairwise(attitudes)]
    assert np.linalg.norm(np.sum(turns, axis=0)) > 5e-3
    assert np.linalg.norm(np.sum(corrections[1:], axis=0)) < 1e-3
    assert np.linalg.norm(corrections[-1]) > 0.0


def test_a_filter_that_does_not_explain_the_samples_starts_anew():
    flight, other = MeasuredFlight(3), MeasuredFlight(5)
    determination = AttitudeDetermination(
        BodyModel(), AttitudeFilterConfiguration(), DeterminationConfiguration(window=30)
    )
    for _ in range(160):
        other.fly()
        status = determination.process(*flight.fly())
    assert status.valid
    # From here on the samples are those of another attitude, rate and history.
    statuses, are_known = [], []
    for _ in range(240):
        statuses.append(determination.process(*other.fly()))
        are_known.append(bool(np.isfinite(determination.correction).all()))
    reasons = [status.reason for status in statuses]
    first = next(number for number, reason in enumerate(reasons) if "starts anew" in reason)
    assert all(are_known[:first]) and not any(are_known[first : first + 2]) and are_known[-1]
    assert "starts anew: the filter did not explain the samples" in reasons
    assert statuses[-1].restarts >= 1 and statuses[-1].valid
    assert np.degrees(np.linalg.norm(other.errors(determination.estimate)[:3])) < 2.0


def test_a_solution_may_steer_once_it_has_explained_samples():
    """A filter that is sure of a wrong attitude says so by its innovations alone."""
    flight, other = MeasuredFlight(3), MeasuredFlight(5)
    determination = AttitudeDetermination(BodyModel(), AttitudeFilterConfiguration())
    reason = ""
    while not reason.startswith("attitude not confirmed"):
        other.fly()
        status = determination.process(*flight.fly())
        assert not status.valid
        reason = status.reason
    # Sure, and not yet confirmed: what follows are samples of another attitude.
    statuses = [determination.process(*other.fly()) for _ in range(50)]
    assert not any(status.valid for status in statuses)
    assert np.degrees(determination.estimate.rotation_sigma) < 5.0


def test_samples_of_a_stuck_sensor_do_not_move_a_filter_before_they_are_named(converged):
    """Two of them are wild before the third names the sensor."""
    flight, determination = converged
    period, sample = flight.fly()
    determination.process(period, sample)
    for _ in range(6):
        determination.process(*flight.fly())
    before = np.linalg.norm(flight.errors(determination.estimate)[:3])
    for number in range(12):
        status = determination.process(flight.fly()[0], sample)
        assert not status.used and status.reason
        assert status.reason.startswith("magnetometer stuck") == (number >= 2)
    errors = flight.errors(determination.estimate)
    covariance = determination.estimate.covariance[:9, :9]
    assert np.degrees(np.linalg.norm(errors[:3])) < np.degrees(before) + 0.5
    assert errors @ np.linalg.solve(covariance, errors) < 27.9  # 0.1 % of chi squared, 9 numbers


def test_an_attitude_that_no_longer_explains_its_samples_does_not_steer(converged):
    """Torques that nobody reports, of a size that no single sample shows."""
    flight, determination = converged
    statuses = []
    for _ in range(40):
        windows = [TorqueWindow(0.0, 5.0, np.array([2e-7, -2e-7, 2e-7]))]
        statuses.append(determination.process(*flight.fly(windows=windows)))
    lost = next(number for number, status in enumerate(statuses) if not status.valid)
    assert lost < 30
    assert statuses[lost].reason


def test_no_attitude_of_a_search_may_steer():
    """Where the field has an error, a search ends with a filter of its own; until then nothing."""
    flight = MeasuredFlight(3)
    settings = AttitudeFilterConfiguration(field_sigma=3e-7)
    determination = AttitudeDetermination(BodyModel(), settings)
    sigmas, status = [], determination.status
    while not status.valid:
        status = determination.process(*flight.fly())
        sigmas.append(determination.estimate.rotation_sigma)
    # Long sure enough to steer, by itself.
    assert np.degrees(sigmas[:-20]).min() < 1.0


def test_an_attitude_that_is_told_may_steer_at_once():
    flight = MeasuredFlight(3)
    settings = AttitudeFilterConfiguration(initial_rotation_sigma_deg=1.0, initial_rate_sigma=1e-4)
    determination = AttitudeDetermination(BodyModel(), settings)
    determination.expect(flight.state.quaternion_gcrf, flight.state.rate_body)
    assert determination.process(*flight.fly()).valid


def test_a_tumbling_spacecraft_is_not_started_on():
    flight = MeasuredFlight(4)
    determination = AttitudeDetermination(BodyModel(), AttitudeFilterConfiguration())
    status = determination.process(*flight.fly(), rate_across=0.2)
    assert status.reason == "tumbling: 0.200 rad/s across the field" and not status.valid
    assert determination.estimate is None


def test_wheel_observer_believes_the_command_and_names_a_wheel_that_does_not_follow():
    wheel = WheelObserver(WheelObserverConfiguration(), 0.0)
    generator = np.random.default_rng(1)
    worst = 0.0
    for number in range(400):
        wheel.predict(-10.0 * number, 5.0)
        wheel.update(-10.0 * number + 2.0 + generator.uniform(-5.0, 5.0))
        worst = max(worst, abs(wheel.speed_rpm + 10.0 * number - 2.0)) if number > 300 else 0.0
    assert worst < 3.0 and wheel.follows
    held = wheel.speed_rpm
    for _ in range(4):
        wheel.predict(held - 500.0, 5.0)
        wheel.update(held)
    assert not wheel.follows and wheel.speed_rpm == pytest.approx(held, abs=1.0)
    wheel.predict(held - 100.0, 5.0)
    wheel.update(held - 100.0)
    assert wheel.follows and wheel.speed_rpm == pytest.approx(held - 100.0, abs=1.0)
    # 1 mN m for 5 s gives 2500 rpm: a command beyond it is not believed.
    wheel.predict(held - 10000.0, 5.0)
    assert wheel.speed_rpm == pytest.approx(held - 100.0 - 2500.0, abs=1.0)


def test_a_search_in_a_field_with_an_error_leaves_its_solution_and_no_certainty():
    """Once, with sigmas that cover the errors of the search; the filter then goes on."""
    flight = MeasuredFlight(3)
    settings = DeterminationConfiguration(found_deg=1.0)
    configuration = AttitudeFilterConfiguration(field_sigma=3e-7)
    determination = AttitudeDetermination(BodyModel(), configuration, settings)
    before, ends = None, []
    for number in range(400):
        status = determination.process(*flight.fly())
        assert number == 0 or np.isfinite(status.normalised_innovation_squared)
        estimate = determination.estimate
        if before is not None and estimate.dipole_sigma.min() > 2.0 * before.dipole_sigma.max():
            ends.append(number)
            assert np.degrees(estimate.rotation_sigma) == pytest.approx(2.5)
            assert not estimate.field_error_gcrf.any()
            errors = flight.errors(estimate) / np.sqrt(np.diag(estimate.covariance)[:9])
            assert np.abs(errors).max() < 3.0
        before = estimate
    assert len(ends) == 1
    assert np.degrees(np.linalg.norm(flight.errors(estimate)[:3])) < 1.0
    assert determination.status.restarts == 0 and estimate.dipole_sigma.max() < 5e-3
