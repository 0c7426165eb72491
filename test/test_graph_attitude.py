"""Attitude over the graph: CAN bus, estimator and controller, faults, equal bytes."""

from __future__ import annotations

import numpy as np
import pytest
from graph_support import ROOT, assert_equal_messages, run_vtff, topics

from vtff_analysis.attitude.log_estimation import estimate_from_log
from vtff_bag.file.reader import BagReader
from vtff_control.adcs.frames import AdcsFrames
from vtff_control.adcs.log import read_reports
from vtff_dynamics.attitude.orbit_axes import (
    orbit_rate,
    quaternion_from_roll_pitch_yaw,
    rotation_gcrf_to_orbit,
)
from vtff_dynamics.attitude.quaternion import (
    conjugate,
    multiply,
    rotation_matrix,
    rotation_vector,
)
from vtff_nav.attitude.configuration import AttitudeFilterConfiguration, BodyModel
from vtff_nav.attitude.onboard import OnboardAttitudeEstimator
from vtff_nav.attitude.orbit_memory import OrbitMemory
from vtff_node.plain_yaml import format_yaml, parse_yaml
from vtff_node.stamps import to_nanoseconds

# An attitude that is told may steer at once; a search from nothing takes twelve minutes, and tests
# of the library fly it (vtff_analysis/test/attitude/test_loop.py, vtff_nav/test/attitude).
START = {
    "roll_pitch_yaw_deg": [0.6, -0.5, 0.4],
    "rate_body": [0.0, -0.00106, 0.0],
    "wheel_speed_rpm": -2700.0,
}
TOLD = ("attitude_estimator.initial_rotation_sigma_deg:=1.0",
        "attitude_estimator.initial_rate_sigma:=2.0e-4")  # fmt: skip
TIMELINE = "attitude_controller.timeline:=['0 compass', '60 point']"
BUS_OFF = ("adcs_emulator.bus_off_after:=100", "adcs_emulator.bus_off_duration:=30")
END = 340.0
AGAIN_END = 150  # of the flight that is compared to the byte: the bus is off in it


@pytest.fixture(scope="module")
def scenario_file(tmp_path_factory):
    """Return the scenario of SNAP-1 pointing, with a magnetometer that fails twice."""
    fields = parse_yaml((ROOT / "config/scenario/snap1.yaml").read_text(encoding="utf-8"))
    attitude = fields["spacecraft"][0]["attitude"]
    attitude["start"] = START
    attitude["faults"] = [
        {"kind": "magnetometer_stuck", "start": 180.0, "end": 230.0},
        {"kind": "magnetometer_saturated", "start": 270.0, "end": 300.0},
    ]
    path = tmp_path_factory.mktemp("attitude") / "pointing.yaml"
    path.write_text(format_yaml(fields), encoding="utf-8")
    return path


def messages(run, topic):
    """Return the messages of a topic by time since the start, s."""
    found = [decoded.message for decoded in BagReader(run).messages(topic)]
    stamps = [to_nanoseconds(message.header.stamp) for message in found]
    return {
        (stamp - stamps[0]) / 1e9: message for stamp, message in zip(stamps, found, strict=True)
    }


@pytest.fixture(scope="module")
def flight(runs, scenario_file):
    return runs.make(
        "attitude", "snap1.yaml", f"scenario:={scenario_file}", TIMELINE, *TOLD, *BUS_OFF,
        "--duration", round(END), "--no-report", "--composed",
    )[0]  # fmt: skip


def earth_pointing(state_gcrf):
    """Return attitude and rate of a spacecraft that points at the Earth."""
    to_orbit = rotation_gcrf_to_orbit(state_gcrf)
    quaternion = quaternion_from_roll_pitch_yaw(0.0, 0.0, 0.0, to_orbit)
    rate_gcrf = -orbit_rate(state_gcrf) * to_orbit[1]
    return quaternion, rotation_matrix(quaternion).T @ rate_gcrf


def test_equal_runs_are_equal_byte_for_byte_also_in_one_process(flight, runs, scenario_file):
    again = runs.make(
        "attitude_again", "snap1.yaml", f"scenario:={scenario_file}", TIMELINE, *TOLD, *BUS_OFF,
        "--duration", AGAIN_END, "--no-report", "--distributed",
    )[0]  # fmt: skip
    end = BagReader(again).end_time  # it is the shorter of both
    names = set(topics(flight)) - {"/sim/status"}  # it holds the length of the run
    assert assert_equal_messages(flight, again, names, end) > 250


def test_an_attitude_that_was_told_is_followed_and_its_sigma_is_true(flight):
    truth = messages(flight, "/snap1/truth/attitude")
    estimates = messages(flight, "/snap1/attitude")
    known = [time for time, estimate in estimates.items() if estimate.valid]
    assert len(known) == len(estimates) > END / 5.0
    for time in known:
        true, estimate = truth[time], estimates[time]
        error = rotation_vector(
            multiply(conjugate(np.array(estimate.quaternion)), np.array(true.quaternion))
        )
        covariance = np.array(estimate.covariance).reshape(9, 9)[:3, :3]
        assert np.degrees(np.linalg.norm(error)) < 2.0
        assert error @ np.linalg.solve(covariance, error) < 16.3  # 0.1 % of chi squared


def test_a_bus_that_is_off_means_rods_off_and_is_said(flight):
    reports = messages(flight, "/snap1/adcs/report")
    actuations = messages(flight, "/snap1/adcs/actuation")
    silent = [time for time, report in reports.items() if not report.heard]
    assert silent == [100.0 + 5.0 * number for number in range(6)]
    for time in silent:
        assert not actuations[time].accepted
        assert not np.array(actuations[time].pulse_steps).any()
    assert all(actuations[time].accepted for time in actuations if time not in silent)
    truth = messages(flight, "/snap1/truth/attitude")
    speeds = [truth[time].wheel_speed_rpm for time in silent[1:]]
    assert max(speeds) == min(speeds)


@pytest.mark.parametrize(
    ("start", "end", "reason"),
    [(195.0, 230.0, "magnetometer stuck"), (275.0, 300.0, "magnetometer saturated")],
)
def test_a_magnetometer_that_lies_is_named_and_not_steered_by(flight, start, end, reason):
    estimates = messages(flight, "/snap1/attitude")
    commands = messages(flight, "/snap1/adcs/command")
    for time in np.arange(start, end + 1.0, 5.0):
        assert estimates[time].reason.startswith(reason)
        assert not np.array(commands[time].pulse_steps).any()
    after = [end + 5.0 * number for number in range(2, 8)]
    assert not any(estimates[time].reason.startswith("magnetometer") for time in after)
    assert np.array([commands[time].pulse_steps for time in after]).any()


def test_the_log_of_the_bus_holds_what_the_bag_holds(flight):
    frames = AdcsFrames(ROOT / "config/can/vtff_adcs.dbc")
    reports = messages(flight, "/snap1/adcs/report")
    heard = {time: report for time, report in reports.items() if report.heard}
    logged = list(read_reports(flight / "adcs.log", frames))
    assert len(logged) == len(heard)
    start = logged[0][0]
    for stamp, report in logged:
        message = heard[(stamp - start) / 1e9]
        np.testing.assert_array_equal(report.field_body.ravel(), np.array(message.field_body))
        assert report.wheel_speed_rpm == message.wheel_speed_rpm


def test_the_estimator_alone_on_the_log_says_what_the_node_said(flight):
    """Until the bus is off: how the node bridges a silence is not in the log."""
    orbit = OrbitMemory(kept=1000)
    states = {}
    for decoded in BagReader(flight).messages("/snap1/truth/orbit"):
        message = decoded.message
        state = np.concatenate((message.position, message.velocity))
        states[to_nanoseconds(message.header.stamp)] = state
        orbit.add(to_nanoseconds(message.header.stamp), state)
    estimator = OnboardAttitudeEstimator(
        BodyModel(),
        AttitudeFilterConfiguration(
            field_sigma=3e-7, initial_rotation_sigma_deg=1.0, initial_rate_sigma=2e-4
        ),
    )
    estimator.expect(*earth_pointing(states[min(states)]))
    frames = AdcsFrames(ROOT / "config/can/vtff_adcs.dbc")
    known = list(estimate_from_log(flight / "adcs.log", frames, orbit, estimator))
    estimates = messages(flight, "/snap1/attitude")
    assert len(known) == len(estimates)
    start = known[0][0]
    for stamp, attitude in known:
        time = (stamp - start) / 1e9
        if 5.0 <= time < 100.0:
            np.testing.assert_array_equal(
                attitude.estimate.quaternion_gcrf, np.array(estimates[time].quaternion)
            )
    end = known[-1][1].estimate
    assert np.degrees(end.rotation_sigma) < 5.0


def test_diagnostics_name_the_faults(flight):
    text = {
        f"{status.name}: {status.message}"
        for decoded in BagReader(flight).messages("/diagnostics")
        for status in decoded.message.status
    }
    assert any("CAN link: nothing from the ADCS module" in line for line in text), sorted(text)


def test_bad_settings_end_the_run_in_one_line(tmp_path):
    result = run_vtff(
        "run", "snap1", "attitude_controller.compensation:=fixed",
        "attitude_controller.fixed_compensation:=[0.0, 0.0, 0.2]", "--out", tmp_path / "run",
    )  # fmt: skip
    assert result.returncode == 2, result.stdout + result.stderr
    assert "fixed_compensation: the torquers give at most 0.1016 A m2" in (
        result.stdout + result.stderr
    )
    assert "Traceback" not in result.stdout + result.stderr
