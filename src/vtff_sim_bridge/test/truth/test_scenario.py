"""Scenario files: the two that come with the project, and every way a file can be wrong."""

import copy
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.frames.rtn import relative_state_rtn
from vtff_dynamics.orbit.elements import ClassicalElements
from vtff_dynamics.orbit.propagator import ForceModel
from vtff_dynamics.time.timescales import parse_epoch
from vtff_node.plain_yaml import format_yaml, parse_yaml
from vtff_sim_bridge.truth.scenario import ScenarioError, load_scenario, state_ahead_on_orbit

SCENARIOS = Path(__file__).resolve().parents[4] / "config" / "scenario"
REFERENCE = SCENARIOS / "reference.yaml"
REMOTE_SENSING = SCENARIOS / "remote_sensing.yaml"


@pytest.fixture
def fields() -> dict[str, Any]:
    """Fields of the reference scenario, to be spoilt by a test."""
    return copy.deepcopy(parse_yaml(REFERENCE.read_text(encoding="utf-8")))


def load(fields: dict[str, Any], folder: Path) -> Any:
    """Load a scenario from fields."""
    path = folder / "scenario.yaml"
    path.write_text(format_yaml(fields), encoding="utf-8")
    return load_scenario(path)


@pytest.mark.parametrize("path", sorted(SCENARIOS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_scenario_loads_and_is_named_as_its_file(path: Path) -> None:
    assert load_scenario(path).name == path.stem


def test_reference_scenario_is_that_of_the_appendix() -> None:
    scenario = load_scenario(REFERENCE)
    assert scenario.epoch == parse_epoch("2016-03-21T01:00:00 GPS")
    assert (scenario.duration, scenario.step, scenario.integrator) == (3600.0, 1.0, "rk4")
    assert scenario.force_model == ForceModel()
    assert [craft.name for craft in scenario.spacecraft] == ["chief", "deputy"]
    np.testing.assert_array_equal(
        scenario.chief.state_gcrf,
        [6928137.0, 0.0, 0.0, 0.0, 3792.5442661521847, 6568.879358929605],
    )
    relative = scenario.formation_truth().relative_state_rtn("deputy")
    np.testing.assert_allclose(relative[:3], [-0.0722, 1000.0, 0.0], atol=1e-4)
    np.testing.assert_allclose(relative[3:], 0.0, atol=1e-6)
    np.testing.assert_array_equal(scenario.deputies[0].target_rtn, [0, 100, 0, 0, 0, 0])


def test_remote_sensing_scenario_has_the_relative_state_of_table_1() -> None:
    scenario = load_scenario(REMOTE_SENSING)
    relative = scenario.formation_truth().relative_state_rtn("deputy")
    assert relative[0] == pytest.approx(-854.3, abs=0.5)
    assert relative[1] == pytest.approx(-14980.0, abs=3.0)
    assert relative[2] == pytest.approx(0.0, abs=1e-3)
    np.testing.assert_allclose(relative[3:], [-0.033, 1.760, 0.0], atol=2e-3)
    np.testing.assert_array_equal(
        scenario.deputies[0].target_rtn, [-1000.0, -15000.0, 0.0, 0.0, 0.0, 0.0]
    )


@pytest.mark.parametrize(
    ("changes", "crossings"),
    [
        ({"force_model": ForceModel(gravity="two_body")}, [(290e3, 2028.0, 10.0, -7.4, -74.0)]),
        ({}, [(290e3, 2088.0, 10.0, -7.9, -70.0)]),
        (
            {"force_model": ForceModel(gravity="two_body"), "integrator": "euler"},
            [(290e3, 1921.0, 15.0, None, -81.2), (350e3, 2141.0, 15.0, None, -67.4)],
        ),
    ],
    ids=["two_body", "8x8", "euler"],
)
def test_remote_sensing_chief_rises_through_the_bubble(
    changes: dict[str, Any], crossings: list[tuple[float, ...]]
) -> None:
    scenario = dataclasses.replace(load_scenario(REMOTE_SENSING), **changes)
    truth = scenario.formation_truth()
    heights, places = [], []
    for _ in range(2300):
        position_itrf = rotation_gcrf_to_itrf(truth.time) @ truth.state_gcrf("chief")[:3]
        latitude, longitude, height = geodetic_from_itrf(position_itrf)
        heights.append(height)
        places.append(np.degrees([latitude, longitude]))
        truth.advance()
    for wanted, time, tolerance, latitude_deg, longitude_deg in crossings:
        above = np.array(heights) >= wanted
        step = int(np.flatnonzero(above[1:] & ~above[:-1])[-1]) + 1
        assert step == pytest.approx(time, abs=tolerance)
        assert places[step][1] == pytest.approx(longitude_deg, abs=1.0)
        if latitude_deg is not None:
            assert places[step][0] == pytest.approx(latitude_deg, abs=0.3)


def test_node_can_be_given_as_right_ascension_or_longitude(
    fields: dict[str, Any], tmp_path: Path
) -> None:
    elements = {
        "semi_major_axis": 7e6,
        "eccentricity": 0.01,
        "inclination_deg": 60.0,
        "argument_of_perigee_deg": 20.0,
        "longitude_of_ascending_node_deg": 30.0,
        "mean_anomaly_deg": 339.0,
    }
    fields["spacecraft"][0]["orbit"] = {"elements": elements}
    scenario = load(fields, tmp_path)
    found = ClassicalElements.from_state(scenario.chief.state_gcrf)
    assert np.degrees(found.mean_anomaly) % 360.0 == pytest.approx(339.0, abs=1e-8)
    node_gcrf = np.array([np.cos(found.right_ascension), np.sin(found.right_ascension), 0.0])
    node_itrf = rotation_gcrf_to_itrf(scenario.epoch) @ node_gcrf
    assert np.degrees(np.arctan2(node_itrf[1], node_itrf[0])) == pytest.approx(30.0, abs=1e-3)

    del elements["longitude_of_ascending_node_deg"], elements["mean_anomaly_deg"]
    elements["right_ascension_deg"] = np.degrees(found.right_ascension).item()
    elements["true_anomaly_deg"] = np.degrees(found.true_anomaly).item()
    again = load(fields, tmp_path)
    np.testing.assert_allclose(again.chief.state_gcrf, scenario.chief.state_gcrf, rtol=1e-12)


@pytest.mark.parametrize("eccentricity", [0.0, 0.044, 0.3])
@pytest.mark.parametrize("distance", [1000.0, -15000.0, 1e-3])
def test_state_ahead_is_on_the_same_orbit_at_the_distance(
    eccentricity: float, distance: float
) -> None:
    elements = ClassicalElements(9e6, eccentricity, 0.2, 0.4, 3.1, -1.5)
    state = elements.to_state()
    ahead = state_ahead_on_orbit(state, distance)
    assert np.linalg.norm(ahead[:3] - state[:3]) == pytest.approx(abs(distance), abs=2e-8)
    assert np.sign((ahead[:3] - state[:3]) @ state[3:]) == np.sign(distance)
    found = ClassicalElements.from_state(ahead)
    assert found.semi_major_axis == pytest.approx(elements.semi_major_axis, rel=1e-12)
    assert found.eccentricity == pytest.approx(eccentricity, abs=1e-12)
    np.testing.assert_allclose(
        np.cross(ahead[:3], ahead[3:]), np.cross(state[:3], state[3:]), rtol=1e-12
    )


def test_state_ahead_refuses_what_has_no_answer() -> None:
    state = ClassicalElements(7e6, 0.0, 0.2, 0.0, 0.0, 0.0).to_state()
    with pytest.raises(ValueError, match="no point of the orbit"):
        state_ahead_on_orbit(state, 8e6)
    with pytest.raises(ValueError, match="not an ellipse"):
        state_ahead_on_orbit(state * [1, 1, 1, 2, 2, 2], 10.0)
    np.testing.assert_array_equal(state_ahead_on_orbit(state, 0.0), state)


def test_more_spacecraft_than_two(fields: dict[str, Any], tmp_path: Path) -> None:
    orbit = {"same_orbit_ahead": -2000}
    fields["spacecraft"].append({"name": "deputy_2", "role": "deputy", "orbit": orbit})
    scenario = load(fields, tmp_path)
    assert [craft.name for craft in scenario.deputies] == ["deputy", "deputy_2"]
    assert scenario.deputies[1].target_rtn is None
    truth = scenario.formation_truth()
    assert truth.relative_state_rtn("deputy_2")[1] == pytest.approx(-2000.0, abs=1e-3)


def test_a_deputy_can_start_relative_to_the_chief(fields: dict[str, Any], tmp_path: Path) -> None:
    relative = {"position": [-3000.0, -15000.0, 2.0], "velocity": [0.1, 0.0, -0.2]}
    fields["spacecraft"][1]["orbit"] = {"relative_rtn": relative}
    scenario = load(fields, tmp_path)
    state = relative_state_rtn(scenario.chief.state_gcrf, scenario.deputies[0].state_gcrf)
    np.testing.assert_allclose(state, [-3000.0, -15000.0, 2.0, 0.1, 0.0, -0.2], atol=1e-6)
    del relative["velocity"]
    scenario = load(fields, tmp_path)
    state = relative_state_rtn(scenario.chief.state_gcrf, scenario.deputies[0].state_gcrf)
    np.testing.assert_allclose(state[3:], 0.0, atol=1e-8)


def test_numbers_are_read_as_yaml_1_2_and_forces_by_their_type(
    fields: dict[str, Any], tmp_path: Path
) -> None:
    fields["force_model"] = {"drag": "harris_priester", "third_bodies": ["sun"], "mass": 50}
    path = tmp_path / "scenario.yaml"
    text = format_yaml(fields).replace("duration: 3600.0", "duration: 36e2")
    path.write_text(text, encoding="utf-8")
    scenario = load_scenario(path)
    assert scenario.duration == 3600.0
    assert scenario.force_model == ForceModel(
        drag="harris_priester", third_bodies=("sun",), mass=50.0
    )


def spoil(fields: dict[str, Any], place: str, value: Any) -> None:
    """Set (or with None delete) a field that is named by its place."""
    *path, last = [int(part) if part.isdigit() else part for part in place.split("/")]
    target: Any = fields
    for part in path:
        target = target[part]
    if value is None:
        del target[last]
    else:
        target[last] = value


ELEMENTS = {
    "semi_major_axis": 7e6,
    "eccentricity": 0.0,
    "inclination_deg": 10.0,
    "argument_of_perigee_deg": 0.0,
    "right_ascension_deg": 0.0,
    "true_anomaly_deg": 0.0,
}
CHIEF_ORBIT = "spacecraft/0/orbit"
WRONG = [
    ("name", None, "name: field is missing"),
    ("name", 5, "name: a text expected, got 5"),
    ("colour", "red", "colour: unknown field"),
    ("epoch", "yesterday", "epoch: "),
    ("epoch", 12, "epoch: a text expected"),
    ("duration", "long", "duration: a number expected, got 'long'"),
    ("duration", 10.5, "duration: one or more whole steps of 1 s expected, got 10.5 s"),
    ("duration", -1.0, "duration: one or more"),
    ("duration", True, "duration: a number expected"),
    ("duration", 10**400, "duration: a number expected"),
    ("duration", float("nan"), "duration: a number expected"),
    ("step", 0, "step: at least 1e-09 expected"),
    ("seed", -1, "seed: a whole number of 0 or more expected"),
    ("seed", 1.0, "seed: a whole number of 0 or more expected"),
    ("integrator", "verlet", "integrator: one of rk4, euler expected, got 'verlet'"),
    ("force_model", [], "force_model: a mapping of fields expected"),
    ("force_model/gravity", "egm96", "force_model: gravity 'egm96'"),
    ("force_model/degree", 8.0, "force_model.degree: a whole number expected, got 8.0"),
    ("force_model/degree", 99, "force_model: degree 99"),
    ("force_model/albedo", 1, "force_model.albedo: unknown field"),
    ("force_model/third_bodies", "sun", "third_bodies: a list expected, got 'sun'"),
    ("force_model/third_bodies", ["mars"], "force_model: third_bodies 'mars'"),
    ("force_model/drag", 1, "force_model.drag: a text or null expected, got 1"),
    ("force_model/mass", "heavy", "force_model.mass: a number expected, got 'heavy'"),
    ("spacecraft", [], "spacecraft: a list of at least one mapping expected"),
    ("spacecraft/0", "chief", "spacecraft[0]: a mapping of fields expected"),
    ("spacecraft/0/name", "Chief One", "spacecraft[0].name: 'Chief One' is not made of"),
    ("spacecraft/1/name", "chief", "spacecraft[1].name: 'chief' is used twice"),
    ("spacecraft/1/name", "formation", "spacecraft[1].name: 'formation' is the namespace"),
    ("spacecraft/1/role", "chief", "spacecraft[1].role: the first spacecraft"),
    ("spacecraft/0/role", "deputy", "spacecraft[0].role: the first spacecraft"),
    ("spacecraft/1/role", "leader", "spacecraft[1].role: one of chief, deputy expected"),
    ("spacecraft/0/target", {}, "spacecraft[0].target: unknown field"),
    ("spacecraft/1/target/position_relative_rtn", [1, 2], "three numbers expected, got [1, 2]"),
    ("spacecraft/1/target/position", [1, 2, 3], "spacecraft[1].target.position: unknown field"),
    (
        CHIEF_ORBIT,
        {},
        "exactly one of cartesian_gcrf, elements, same_orbit_ahead, relative_rtn expected, got 0",
    ),
    (CHIEF_ORBIT, {"same_orbit_ahead": 1.0}, "the chief cannot be placed relative to itself"),
    ("spacecraft/1/orbit/same_orbit_ahead", 1e8, "same_orbit_ahead: no point of the orbit"),
    (CHIEF_ORBIT + "/cartesian_gcrf/position", [6928.1, 0, 0], "inside the Earth"),
    (CHIEF_ORBIT + "/cartesian_gcrf/velocity", ["a", 0, 0], "velocity: three numbers expected"),
    (
        CHIEF_ORBIT + "/cartesian_gcrf",
        {"position": [7e6, 0, 0], "velocity": [-10.0, 0, 0]},
        "cartesian_gcrf: state_gcrf: position and velocity do not span an orbital plane",
    ),
    (
        CHIEF_ORBIT,
        {"elements": {**ELEMENTS, "mean_anomaly_deg": 0.0}},
        "spacecraft[0].orbit.elements: exactly one of true_anomaly_deg, mean_anomaly_deg",
    ),
    (CHIEF_ORBIT, {"elements": {**ELEMENTS, "eccentricity": 1.0}}, "elements.eccentricity: less"),
    (CHIEF_ORBIT, {"elements": {**ELEMENTS, "inclination_deg": 200.0}}, "elements: inclination"),
    (CHIEF_ORBIT, {"elements": {**ELEMENTS, "semi_major_axis": 7e3}}, "elements.semi_major_axis"),
]


@pytest.mark.parametrize(("place", "value", "problem"), WRONG)
def test_what_is_wrong_is_named_with_file_and_field(
    fields: dict[str, Any], tmp_path: Path, place: str, value: Any, problem: str
) -> None:
    spoil(fields, place, value)
    with pytest.raises(ScenarioError) as caught:
        load(fields, tmp_path)
    message = str(caught.value)
    assert message.startswith(str(tmp_path / "scenario.yaml") + ": ")
    assert problem in message and "\n" not in message


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (b"name: [", "not readable as YAML"),
        (b"\xff\xfe\x00", "not readable as YAML"),
        (b"name: a\nseed: 1\nname: b\n", "line 3: 'name' is given twice"),
        (b"", "a mapping of fields expected"),
        (b"- 1", "a mapping of fields expected"),
        (b"name: !!python/object:os.system x", "not readable as YAML"),
    ],
)
def test_unreadable_files_are_named(tmp_path: Path, text: bytes, problem: str) -> None:
    path = tmp_path / "broken.yaml"
    path.write_bytes(text)
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path)
    assert str(path) in str(caught.value) and problem in str(caught.value)
    assert "\n" not in str(caught.value)


def test_absent_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="absent.yaml: No such file"):
        load_scenario(tmp_path / "absent.yaml")


def test_a_replaced_duration_is_checked_too() -> None:
    with pytest.raises(ValueError, match="^duration: one or more whole steps"):
        dataclasses.replace(load_scenario(REFERENCE), duration=0.5)
