"""The emulated ADCS module: quiet window, limits, samples, faults."""

from __future__ import annotations

import numpy as np
import pytest

from vtff_dynamics.attitude.rigid_body import AttitudeState, OrbitInterval
from vtff_dynamics.attitude.spacecraft import AttitudePropagator, SpacecraftBody
from vtff_sim_bridge.attitude.adcs_module import AdcsCommand, AdcsModule, AdcsModuleModel
from vtff_sim_bridge.attitude.magnetometer import Magnetometer, MagnetometerModel

FIELD = np.array([10e-6, -5e-6, 30e-6])
FLIGHT = OrbitInterval(5.0, np.tile(FIELD, (3, 1)), np.full((3, 3), 1e12), np.zeros(3))
START = AttitudeState(np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3))


def module(model=None, magnetometer=None, seed=1, start=START, **body):
    return AdcsModule(
        model or AdcsModuleModel(),
        AttitudePropagator(SpacecraftBody(**body), start),
        Magnetometer(magnetometer or MagnetometerModel(), seed),
        seed,
    )


def test_sample_in_the_quiet_window_does_not_see_the_torquers():
    quiet = module(AdcsModuleModel(sample_times=(0.8, 0.0)))
    report = quiet.run_period(FLIGHT, AdcsCommand((900, 900, 900)))
    assert report.pulse_steps == (400, 400, 400)  # no longer than the window leaves
    assert report.field_body.shape == (2, 3)
    np.testing.assert_allclose(report.field_body, np.tile(FIELD, (2, 1)), atol=0.6e-6)
    early = module(AdcsModuleModel(sample_times=(1.5,)))
    seen = early.run_period(FLIGHT, AdcsCommand((-400, 0, 0))).field_body[0] - FIELD
    np.testing.assert_allclose(seen, [-4e-4 * 0.127, -1e-4 * 0.127, 0.0], atol=0.6e-6)


def test_pulses_are_counted_in_steps_of_ten_milliseconds():
    steps = module(inertia=(0.06, 0.06, 0.06))
    steps.run_period(FLIGHT, AdcsCommand((0, 123, 0)))
    rate = steps.spacecraft.state.rate_body
    expected = np.cross([0.0, 0.127, 0.0], FIELD) * 1.23 / 0.06
    np.testing.assert_allclose(rate, expected, rtol=2e-3, atol=2e-8)


def test_wheel_reaches_its_speed_within_its_torque():
    wheel = module()
    report = wheel.run_period(FLIGHT, AdcsCommand(wheel_speed_rpm=-1000.0))
    assert report.wheel_speed_rpm == pytest.approx(-1000.0, abs=5.01)
    for _ in range(3):
        report = wheel.run_period(FLIGHT, AdcsCommand(wheel_speed_rpm=9000.0))
    assert report.wheel_speed_rpm <= 5005.01
    wheel.wheel_is_stuck = True
    before = wheel.spacecraft.state.wheel_momentum
    wheel.run_period(FLIGHT, AdcsCommand(wheel_speed_rpm=0.0))
    assert wheel.spacecraft.state.wheel_momentum == before


def test_faults_of_the_magnetometer():
    faulty = module()
    good = faulty.run_period(FLIGHT, AdcsCommand()).field_body[-1]
    faulty.magnetometer.fault = "stuck"
    np.testing.assert_array_equal(faulty.run_period(FLIGHT, AdcsCommand()).field_body, [good, good])
    faulty.magnetometer.fault = "saturated"
    assert (faulty.run_period(FLIGHT, AdcsCommand()).field_body == 60e-6).all()
    faulty.magnetometer.fault = "silent"
    assert len(faulty.run_period(FLIGHT, AdcsCommand()).field_body) == 0
    faulty.magnetometer.fault = "none"
    assert len(faulty.run_period(FLIGHT, AdcsCommand()).field_body) == 2
    with pytest.raises(ValueError, match="fault: one of none, stuck"):
        faulty.magnetometer.fault = "broken"


def test_two_modules_of_one_seed_are_equal_to_the_byte():
    commands = [AdcsCommand((100, -50, 7 * k), -20.0 * k) for k in range(20)]
    reports = [
        [unit.run_period(FLIGHT, command).field_body.tobytes() for command in commands]
        for unit in (module(), module(), module(seed=2))
    ]
    assert reports[0] == reports[1] != reports[2]


def test_range_bias_and_resolution():
    model = MagnetometerModel(noise=0.0, bias=(1e-6, 0.0, 0.0), resolution=1e-7)
    sensor = Magnetometer(model, 1)
    shown = sensor.sample(np.array([70e-6, 1.234e-6, -80e-6]), np.zeros(3))
    np.testing.assert_allclose(shown, [60e-6, 1.2e-6, -60e-6], atol=1e-12)
    with pytest.raises(ValueError, match="bias: expected 3 finite numbers"):
        MagnetometerModel(bias=(1.0, 2.0))
    with pytest.raises(ValueError, match="sample_times: expected falling times"):
        AdcsModuleModel(sample_times=(0.0, 0.8))
