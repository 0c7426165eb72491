"""Attitude in scenarios: what a file may say, and its truth against the propagator alone."""

from __future__ import annotations

import pathlib

import numpy as np
import pytest

from vtff_dynamics.attitude.orbit_track import OrbitTrack
from vtff_dynamics.attitude.quaternion import conjugate, multiply, rotation_vector
from vtff_dynamics.attitude.spacecraft import AttitudePropagator
from vtff_node.plain_yaml import parse_yaml
from vtff_sim_bridge.attitude.adcs_module import AdcsCommand
from vtff_sim_bridge.truth.scenario import Scenario, ScenarioError, read_scenario

SCENARIO = pathlib.Path(__file__).resolve().parents[4] / "config" / "scenario" / "snap1.yaml"


def scenario(**changes: object) -> Scenario:
    """Return the SNAP-1 scenario with fields, named as a__b__c, replaced."""
    fields = parse_yaml(SCENARIO.read_text(encoding="utf-8"))
    for path, value in changes.items():
        *folders, last = path.split("__")
        place = fields if path in ("epoch", "step", "duration") else fields["spacecraft"][0]
        for name in folders:
            place = place.setdefault(name, {})
        place[last] = value
    return read_scenario(fields, "snap1.yaml")


def flown(of_scenario: Scenario, seconds: float, command: AdcsCommand | None = None):
    """Return the attitude after a time; every period has the same command."""
    orbit, attitude = of_scenario.formation_truth(), of_scenario.attitude_truths()["snap1"]
    for _ in range(round(seconds / of_scenario.step)):
        if attitude.begins_period:
            attitude.begin_period(command)
        orbit.advance({})
        attitude.advance(orbit.state_gcrf("snap1"))
    return attitude


def angle(first, second) -> float:
    return float(
        np.linalg.norm(
            rotation_vector(multiply(conjugate(first.quaternion_gcrf), second.quaternion_gcrf))
        )
    )


def test_truth_is_that_of_the_propagator_on_a_track_of_its_own():
    """The track integrates the orbit with half the step, and takes its field at each node."""
    free = scenario(attitude__environment__field_error_sigma=0.0)
    attitude = flown(free, 1800.0)
    alone = AttitudePropagator(free.chief.attitude.body, free.attitude_truths()["snap1"].state)
    track = OrbitTrack(free.epoch, free.chief.state_gcrf, 5.0, free.force_model)
    for number in range(360):
        alone.advance(track.interval(number))
    assert angle(attitude.state, alone.state) < 1e-5
    np.testing.assert_allclose(attitude.state.rate_body, alone.state.rate_body, atol=1e-8)


def test_truth_does_not_depend_on_the_step_of_the_simulation():
    command = AdcsCommand((217, -33, 0), -50.0)
    every, fine = (flown(scenario(step=step, duration=step), 300.0, command) for step in (5.0, 1.0))
    assert fine.period_done == every.period_done == 5.0
    assert angle(every.state, fine.state) < 1e-5
    np.testing.assert_allclose(every.report.field_body, fine.report.field_body, atol=1e-10)
    assert every.report.pulse_steps == fine.report.pulse_steps == (217, -33, 0)
    assert every.wheel_speed_rpm == pytest.approx(-50.0, abs=1e-6)


def test_a_firing_turns_the_spacecraft_by_its_torque():
    given = {"force_body": [0.0, 0.0, 0.05], "point_body": [0.0038, 0.0, 0.0]}
    states = []
    for duration in (0.0, 3.0):
        orbit_scenario = scenario(attitude__thruster=given, attitude__start={"tumble_rpm": 0.0})
        attitude = orbit_scenario.attitude_truths()["snap1"]
        orbit = orbit_scenario.formation_truth()
        attitude.begin_period(None, 1.0, duration)
        orbit.advance({})
        attitude.advance(orbit.state_gcrf("snap1"))
        states.append(attitude.state.rate_body)
    change = states[1] - states[0]  # -0.19 mN m for 3 s about y, inertia 0.058
    assert change[1] == pytest.approx(-1.9e-4 * 3.0 / 0.058, rel=1e-3)


def test_thrusters_that_miss_the_centre_of_mass_turn_the_spacecraft():
    """Thrust along x that acts 5 mm beside the centre of mass, for four of five steps."""
    propulsion = {"mass": 6.5, "points_body": [[0.0, 0.005, 0.0], [0.0] * 3, [0.0] * 3]}
    rates = []
    for given in ({}, {"attitude__propulsion": propulsion}):
        of_scenario = scenario(step=1.0, duration=5.0, attitude__start={"tumble_rpm": 0.0}, **given)
        orbit, attitude = of_scenario.formation_truth(), of_scenario.attitude_truths()["snap1"]
        attitude.begin_period(None)
        for second in range(5):
            orbit.advance({})
            thrust = np.diag([1e-3 if second != 2 else 0.0, 0.0, 0.0])
            attitude.advance(orbit.state_gcrf("snap1"), thrust)
        rates.append(attitude.state.rate_body)
    change = rates[1] - rates[0]  # -0.005 m * 6.5 mN for 4 s about z, inertia 0.056
    assert change[2] == pytest.approx(-0.005 * 6.5e-3 * 4.0 / 0.056, rel=1e-3)
    np.testing.assert_allclose(change[:2], 0.0, atol=1e-6)


def test_faults_hold_while_they_are_said_to():
    faults = [
        {"kind": "magnetometer_stuck", "start": 50.0, "end": 100.0},
        {"kind": "magnetometer_silent", "start": 150.0, "end": 200.0},
        {"kind": "wheel_stuck", "start": 0.0, "end": 30.0},
    ]
    of_scenario = scenario(attitude__faults=faults)
    orbit, attitude = of_scenario.formation_truth(), of_scenario.attitude_truths()["snap1"]
    fields, speeds = [], []
    for _ in range(50):
        attitude.begin_period(AdcsCommand((0, 0, 0), 100.0))
        orbit.advance({})
        attitude.advance(orbit.state_gcrf("snap1"))
        fields.append(attitude.report.field_body)
        speeds.append(attitude.wheel_speed_rpm)
    assert all((field == fields[9][-1]).all() for field in fields[10:20])
    assert not (fields[20] == fields[9][-1]).any()
    assert [len(field) for field in fields[29:41]] == [2] + 10 * [0] + [2]
    assert speeds[5] == 0.0 and speeds[6] == pytest.approx(100.0)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"attitude__body__inertia": [0.05, 0.05, 0.2]}, "[0].attitude.body: inertia: no body"),
        ({"attitude__body__inertia": [0.05, -0.05, 0.05]}, "inertia: expected a positive definite"),
        ({"attitude__body__inertia": [0.05, "a", 0.05]}, "body.inertia: a list of numbers"),
        ({"attitude__propulsion": {"points_body": [[0.0] * 3] * 3}}, "propulsion.mass: field is"),
        ({"attitude__propulsion": {"mass": 0.0}}, "propulsion: mass: expected a positive number"),
        ({"attitude__propulsion": {"mass": 6.5, "points_body": [0.0] * 3}}, "points_body: "),
        ({"attitude__body__inertia": 0.05}, "body.inertia: a list of numbers"),
        ({"attitude__start__wheel_speed_rpm": 5100.0}, "spacecraft[0].attitude: wheel_speed_rpm: "),
        ({"epoch": "2031-02-08T00:00:00 UTC"}, "epoch: the magnetic field model IGRF-14"),
        ({"attitude__period": 7.0}, "[0].attitude: period: one or more whole steps"),
        ({"attitude__period": 0.5}, "period: expected more than the quiet window"),
        ({"attitude__magnetometer__noise": -1.0}, "attitude.magnetometer: noise: "),
        ({"attitude__faults": [{"kind": "tired", "start": 0.0}]}, "faults[0]: kind: one of"),
        ({"attitude__torquer": 1.0}, "spacecraft[0].attitude.torquer: unknown field"),
        ({"attitude__start__rate_body": [0.0, 0.0, 0.0]}, "rate_body, tumble_rpm: one of them"),
    ],
)  # fmt: skip
def test_bad_fields_are_named_in_one_line(changes, text):
    with pytest.raises(ScenarioError) as caught:
        scenario(**changes)
    message = str(caught.value)
    assert message.startswith("snap1.yaml: ") and text in message and "\n" not in message
