"""A deputy that turns: its thrust goes along the axes of its body, in and out by two attitudes."""

from __future__ import annotations

import numpy as np
import pytest
from graph_support import ROOT

from vtff_bag.file.reader import BagReader
from vtff_dynamics.attitude.quaternion import (
    conjugate,
    multiply,
    rotation_matrix,
    rotation_vector,
    turned_at_rate,
)
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_node.plain_yaml import format_yaml, parse_yaml
from vtff_node.stamps import to_nanoseconds

SECONDS = 30
SYSTEM = "reference_attitude_software.yaml"


def messages(run, topic):
    """Return the messages of a topic by stamp, ns."""
    found = (decoded.message for decoded in BagReader(run).messages(topic))
    return {to_nanoseconds(message.header.stamp): message for message in found}


def vector(message):
    linear = message.accel.linear
    return np.array([linear.x, linear.y, linear.z])


def fly(runs, folder, name, *arguments, along_body=True, has_errors=True):
    """Fly from a metre ahead of the target, so that the thrusters are at their limit."""
    scenario = parse_yaml((ROOT / "config/scenario/reference_attitude.yaml").read_text())
    deputy = scenario["spacecraft"][1]
    deputy["orbit"]["same_orbit_ahead"] = 101.0
    if not has_errors:
        del deputy["thruster_errors"]
        deputy["attitude"]["propulsion"]["points_body"] = [[0.0] * 3] * 3
    if not along_body:
        del deputy["attitude"]["propulsion"]
    file = folder / f"{name}.yaml"
    file.write_text(format_yaml(scenario))
    return runs.make(
        name, SYSTEM, f"scenario:={file}", "simgen_host:=", *arguments,
        "--duration", SECONDS, "--no-report",
    )[0]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("body_thrust")


@pytest.fixture(scope="module")
def flight(runs, folder):
    return fly(runs, folder, "body_thrust")


def test_thrust_is_off_by_the_error_of_the_attitude(flight):
    """What the truth flies, by the true attitude, against what is reported by the estimated one."""
    truth, estimates = (
        messages(flight, "/deputy/truth/attitude"),
        messages(flight, "/deputy/attitude"),
    )
    states = messages(flight, "/deputy/relative_state_truth")
    applied = messages(flight, "/deputy/propulsion/thrust_applied")
    body = messages(flight, "/deputy/propulsion/thrust_body")
    assert {message.header.frame_id for message in body.values()} == {"deputy/body"}
    assert {message.header.frame_id for message in applied.values()} == {"chief/rtn"}
    errors = []
    for stamp in [stamp for stamp in applied if stamp in states and vector(applied[stamp]).any()]:
        state = states[stamp]
        chief = np.concatenate((state.position_chief_gcrf, state.velocity_chief_gcrf))
        true = np.array(truth[stamp].quaternion)
        flown = rotation_gcrf_to_rtn(chief) @ rotation_matrix(true) @ vector(body[stamp])
        # The estimate before the command, which is a second older than the thrust.
        known = max(known for known in estimates if known < stamp - 10**9)
        estimate = estimates[known]
        assert estimate.valid
        predicted = turned_at_rate(
            np.array(estimate.quaternion), np.array(estimate.rate_body), (stamp - known) / 1e9
        )
        error = rotation_vector(multiply(conjugate(predicted), true))
        in_rtn = rotation_gcrf_to_rtn(chief) @ rotation_matrix(true) @ error
        reported = vector(applied[stamp])
        size = np.linalg.norm(reported)
        np.testing.assert_allclose(
            flown - reported, np.cross(in_rtn, reported), atol=2e-3 * size, rtol=0.0
        )
        errors.append(np.linalg.norm(flown - reported) / size)
    assert len(errors) > 20
    assert 1e-4 < np.median(errors) < np.radians(5.0)


def test_with_perfect_attitude_the_flight_is_that_without_one(runs, folder):
    """Attitude and orbit are predicted by a second: 1e-5 rad of a thrust of 1.6e-5 m/s2."""
    exact = ("thruster.quantum:=0.0", "attitude:=truth/attitude")
    in_body = fly(runs, folder, "body_thrust_exact", *exact, has_errors=False)
    in_rtn = fly(runs, folder, "body_thrust_rtn", *exact, has_errors=False, along_body=False)
    topic = "/deputy/relative_state_truth"
    first, second = (messages(run, topic) for run in (in_body, in_rtn))
    assert len(first) == SECONDS + 1
    difference = [first[stamp].position - second[stamp].position for stamp in first]
    thrust = [vector(m) for m in messages(in_body, "/deputy/propulsion/thrust_applied").values()]
    assert np.abs(thrust).max() > 1e-5
    assert np.abs(difference).max() < 2e-7
