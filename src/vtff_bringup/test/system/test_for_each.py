"""System files: entries that stand for one node or process for each spacecraft or deputy."""

import pytest

from vtff_bringup.system.description import RunSettings
from vtff_bringup.system.errors import SystemFileError
from vtff_bringup.system.system_file import load_system

SCENARIO = """
seed: 1
spacecraft:
  - {name: mother, role: chief}
  - {name: b, role: deputy, target: {position_relative_rtn: [0.0, 100.0, 0.0]}}
  - {name: c, role: deputy, target: {position_relative_rtn: [0.0, 200.0, 0.0]}}
"""
SYSTEM = """
arguments:
  scenario: {default: scenario.yaml, file: true}
  bus: {default: vcan0}
  ${spacecraft}_port: {default: "/dev/vtff/${spacecraft}"}
  ${deputy}_bus: {default: "${bus}"}
processes:
  - name: emulator
    package: vtff_sim_bridge
    executable: simgen_emulator
    for_each: deputy
    sets: {"${deputy}_bus": "virtual_${deputy}"}
    arguments: [--bus, "${${deputy}_bus}", --of, "${deputy}"]
nodes:
  - package: vtff_nav
    executable: receiver_driver
    for_each: spacecraft
    namespace: ${spacecraft}
    parameters: {port: "${${spacecraft}_port}"}
  - package: vtff_control
    executable: sdre_controller
    for_each: deputy
    namespace: ${deputy}
    parameters: {target_position_rtn: "${deputy.target.position_relative_rtn}", chief: "${chief}"}
  - package: vtff_iono
    executable: ionosphere_processor
    parameters: {deputies: "${deputies}", sources: ["/${spacecraft}/x", "/${deputy}/y", "/z"]}
"""


@pytest.fixture
def load(tmp_path):
    def load(*overrides, system=SYSTEM, scenario=SCENARIO):
        (tmp_path / "scenario.yaml").write_text(scenario)
        (tmp_path / "system.yaml").write_text(system)
        return load_system(tmp_path / "system.yaml", overrides, RunSettings(tmp_path / "run"))

    return load


def test_one_node_for_each(load):
    system = load("b_port:=/dev/ttyS0")
    nodes = {node.qualified_name: node.parameters for node in system.nodes}
    ports = {name: nodes[f"/{name}/receiver_driver"]["port"] for name in ("mother", "b", "c")}
    assert ports == {"mother": "/dev/vtff/mother", "b": "/dev/ttyS0", "c": "/dev/vtff/c"}
    assert nodes["/c/sdre_controller"]["target_position_rtn"] == [0.0, 200.0, 0.0]
    assert nodes["/b/sdre_controller"]["chief"] == "mother"
    iono = nodes["/ionosphere_processor"]
    assert iono["deputies"] == ["b", "c"]
    assert iono["sources"] == ["/mother/x", "/b/x", "/c/x", "/b/y", "/c/y", "/z"]
    assert "/mother/sdre_controller" not in nodes


def test_one_process_for_each(load):
    system = load()
    assert {process.name: process.arguments for process in system.processes} == {
        "b__emulator": ("--bus", "virtual_b", "--of", "b"),
        "c__emulator": ("--bus", "virtual_c", "--of", "c"),
    }
    assert load("c_bus:=can1").processes[1].arguments[1] == "can1"


def test_a_scenario_has_a_hard_radius(load):
    system = SYSTEM.replace('deputies: "${deputies}"', 'radius: "${scenario.hard_radius}"')
    assert load(system=system).nodes[-1].parameters["radius"] == 10.0
    scenario = f"hard_radius: 30.0\n{SCENARIO}"
    assert load(system=system, scenario=scenario).nodes[-1].parameters["radius"] == 30.0


def test_overrides_of_all_and_of_one(load):
    system = load("sdre_controller.design:=paper", "c/sdre_controller.design:=delay_aware")
    designs = {n.namespace: n.parameters.get("design") for n in system.nodes}
    assert (designs["/b"], designs["/c"]) == ("paper", "delay_aware")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (("for_each: spacecraft", "for_each: moon"), "for_each is 'moon'; choose spacecraft or"),
        (("namespace: ${spacecraft}", "namespace: same"), "two nodes have the name '/same/rec"),
        (("${deputy.target.position", "${deputy.targets.position"), "no 'spacecraft.b.targets"),
    ],
)
def test_wrong_entries_are_refused(load, change, text):
    with pytest.raises(SystemFileError, match=text.replace("'", ".").replace("${", ".")):
        load(system=SYSTEM.replace(*change))


def test_a_spacecraft_listed_twice_is_refused(load):
    with pytest.raises(SystemFileError, match="spacecraft: 'b' is listed twice"):
        load(scenario=SCENARIO.replace("name: c", "name: b"))
    with pytest.raises(SystemFileError, match="no argument or node 'd_port'"):
        load("d_port:=/dev/ttyS0")


def test_a_node_that_needs_deputies_is_refused_without_any(load):
    alone = "\n".join(SCENARIO.splitlines()[:4])
    with pytest.raises(SystemFileError, match="a deputy or more expected beside 'mother'"):
        load(scenario=alone)


def test_names_of_a_repeated_deputy(load):
    scenario = SCENARIO.replace("{name: c,", "{name: 'c_{number}', repeat: 3,")
    names = [node.namespace for node in load(scenario=scenario).nodes[:5]]
    assert names == ["/mother", "/b", "/c_1", "/c_2", "/c_3"]
