"""One entry of a scenario file for many deputies, and what its loader says of formations."""

import copy
import pathlib

import numpy as np
import pytest

from vtff_sim_bridge.truth.repeated_spacecraft import repeat_spacecraft
from vtff_sim_bridge.truth.scenario import ScenarioError, load_scenario, read_scenario
from vtff_sim_bridge.truth.scenario_fields import read_yaml

REFERENCE = pathlib.Path(__file__).parents[4] / "config/scenario/reference.yaml"


@pytest.fixture
def fields():
    return read_yaml(REFERENCE)


def repeated(fields, count=3):
    fields = copy.deepcopy(fields)
    deputy = fields["spacecraft"][1]
    deputy["name"], deputy["repeat"] = "pearl_{number}", count
    deputy["orbit"] = {"same_orbit_ahead": {"first": 1000.0, "increment": 200.0}}
    deputy["target"]["position_relative_rtn"] = [0.0, {"first": 100.0, "increment": 50.0}, 0.0]
    return fields


@pytest.mark.parametrize(("asked", "count"), [(0, 3), (1, 1), (15, 15)])
def test_repeated_deputies(fields, asked, count):
    scenario = read_scenario(repeated(fields), "pearls.yaml", number_of_deputies=asked)
    assert [craft.name for craft in scenario.deputies] == [f"pearl_{n + 1}" for n in range(count)]
    chief = scenario.chief.state_gcrf[:3]
    for number, craft in enumerate(scenario.deputies):
        distance = np.linalg.norm(craft.state_gcrf[:3] - chief)
        assert distance == pytest.approx(1000.0 + 200.0 * number)
        assert craft.target_rtn[1] == 100.0 + 50.0 * number


def test_a_file_without_repeat_is_as_it_is(fields):
    assert repeat_spacecraft(fields, "file", 1) is fields
    with pytest.raises(ScenarioError, match="4 deputies are asked for, the file lists 1"):
        repeat_spacecraft(fields, "file", 4)


@pytest.mark.parametrize("count", [0, 1.5, True, 1 << 70])
def test_wrong_repeat_is_refused(fields, count):
    with pytest.raises(ScenarioError, match=r"spacecraft\[1\].repeat: a whole number"):
        repeat_spacecraft(repeated(fields, count), "file")


@pytest.mark.parametrize(
    ("first", "text"),
    [
        ({"a": 1}, r"same_orbit_ahead.first: a number expected, got \{'a': 1\}"),
        ("x", "same_orbit_ahead.first: a number expected, got 'x'"),
        (10**400, "same_orbit_ahead: the numbers are too large"),
    ],
)
def test_a_series_of_something_else_is_refused(fields, first, text):
    fields = repeated(fields)
    fields["spacecraft"][1]["orbit"]["same_orbit_ahead"]["first"] = first
    with pytest.raises(ScenarioError, match=rf"file: spacecraft\[1\].orbit.{text}"):
        repeat_spacecraft(fields, "file")


def test_more_deputies_than_can_fly_are_refused(fields):
    with pytest.raises(ScenarioError, match="1000000 deputies are asked for, at most 1000 can be"):
        repeat_spacecraft(repeated(fields), "file", 10**6)


def changed(fields, **deputy):
    fields = copy.deepcopy(fields)
    fields["spacecraft"].append({**copy.deepcopy(fields["spacecraft"][1]), "name": "c", **deputy})
    return fields


@pytest.mark.parametrize(
    ("deputy", "text"),
    [
        ({"name": "deputy"}, r"spacecraft\[2\].name: 'deputy' is used twice"),
        ({}, "deputy and c start 0 m apart, inside the hard radius of 30 m"),
        (
            {"orbit": {"same_orbit_ahead": 2000.0}},
            "deputy and c have targets 0 m apart, inside the hard radius of 30 m",
        ),
        (
            {
                "orbit": {"same_orbit_ahead": 2000.0},
                "target": {"position_relative_rtn": [0.0, 25.0, 0.0]},
            },
            "chief and c have targets 25 m apart, inside the hard radius of 30 m",
        ),
        (
            {
                "orbit": {"same_orbit_ahead": 2000.0},
                "target": {"position_gcrf": [0.0, 250.0, 0.0]},
            },
            r"spacecraft\[2\].target.position_gcrf: a target is relative to the chief",
        ),
    ],
)
def test_formations_that_cannot_be_flown_are_refused(fields, deputy, text):
    with pytest.raises(ScenarioError, match=text) as refusal:
        read_scenario(changed(fields, **deputy), "file")
    assert "\n" not in str(refusal.value)


def test_hard_radius():
    assert load_scenario(REFERENCE).hard_radius == 30.0
    assert load_scenario(REFERENCE.with_name("laser_250m.yaml")).hard_radius == 10.0
