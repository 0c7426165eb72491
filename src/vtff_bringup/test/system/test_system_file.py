"""System files: what a user may write, and the errors for what is wrong."""

from __future__ import annotations

import pathlib

import pytest

from vtff_bringup.system.description import RunSettings
from vtff_bringup.system.errors import SystemFileError
from vtff_bringup.system.overrides import parse_override
from vtff_bringup.system.system_file import find_system_file, load_system
from vtff_node.plain_yaml import format_yaml

ROOT = pathlib.Path(__file__).resolve().parents[4]
REFERENCE = ROOT / "config/system/reference_software.yaml"


def write(tmp_path, text):
    path = tmp_path / "system.yaml"
    path.write_text(text)
    return path


@pytest.fixture
def settings(tmp_path):
    return RunSettings(run_directory=tmp_path / "run")


def by_name(system):
    return {node.name: node for node in system.nodes}


def test_reference_system(settings):
    system = load_system(REFERENCE, (), settings)
    nodes = by_name(system)
    assert [process.name for process in system.processes] == ["simgen_emulator"]
    assert nodes["thruster"].qualified_name == "/deputy/thruster"
    assert nodes["sdre_controller"].parameters["target_position_rtn"] == [0.0, 100.0, 0.0]
    assert nodes["sdre_controller"].all_parameters()["acceleration_cap"] == 1.4
    assert nodes["simgen_bridge"].parameters["lockstep_side_branches"] == ["/bag_recorder"]
    assert set(nodes["simgen_bridge"].parameters["expected_nodes"]) == {
        "/deputy/sdre_controller",
        "/deputy/thruster",
        "/bag_recorder",
    }
    assert nodes["bag_recorder"].parameters["output"] == str(settings.run_directory / "bag")
    # The port chosen for the emulator is the one that the bridge connects to.
    port = system.processes[0].arguments[1]
    assert str(nodes["simgen_bridge"].parameters["simgen_port"]) == port


def test_hardware_needs_arguments_only(settings):
    system = load_system(REFERENCE, ["simgen_host:=192.0.2.7"], settings)
    assert system.processes == ()
    assert by_name(system)["simgen_bridge"].parameters["simgen_host"] == "192.0.2.7"
    assert by_name(system)["simgen_bridge"].parameters["simgen_port"] == 15650


def test_realtime_asks_nobody_to_acknowledge(tmp_path):
    system = load_system(REFERENCE, (), RunSettings(tmp_path, pacing="realtime", duration=7.0))
    for node in system.nodes:
        assert node.parameters["lockstep"] is False
        assert node.parameters["acknowledge_steps"] is False
    bridge = by_name(system)["simgen_bridge"].parameters
    assert bridge["lockstep_participants"] == bridge["lockstep_side_branches"] == []
    assert bridge["duration"] == 7.0


def test_the_seed_reaches_the_node_that_ends_the_run(tmp_path, settings):
    nodes = by_name(load_system(REFERENCE, (), RunSettings(tmp_path, seed=7)))
    assert nodes["simgen_bridge"].parameters["seed"] == 7
    assert not [name for name, node in nodes.items() if "seed" in node.parameters][1:]
    assert "seed" not in by_name(load_system(REFERENCE, (), settings))["simgen_bridge"].parameters


def test_overrides_of_parameters_win(settings):
    system = load_system(REFERENCE, ["sdre_controller.acceleration_cap:=0.5"], settings)
    assert by_name(system)["sdre_controller"].all_parameters()["acceleration_cap"] == 0.5


def test_ros_arguments_name_everything(settings, tmp_path):
    node = by_name(load_system(REFERENCE, (), settings))["sdre_controller"]
    arguments = node.ros_arguments(tmp_path / "p.yaml")
    assert arguments[0] == "--ros-args"
    assert "__node:=sdre_controller" in arguments
    assert "relative_state:=relative_state_truth" in arguments
    assert str(tmp_path / "p.yaml") in arguments


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "is empty or not a mapping"),
        ("nodes: [}", "is not valid YAML"),
        ("nodes: []", "no nodes"),
        ("node: []", "unknown key 'node'"),
        ("nodes: [{package: a}]", "'executable' is missing"),
        ("nodes: [{package: a, executable: b, nmae: c}]", "unknown key 'nmae'"),
        ("nodes: [{package: a, executable: b, lockstep: maybe}]", "choose participant or"),
        ("nodes: [{package: a, executable: b, parameters: {x: '${y}'}}]", "unknown ${y}"),
        ("nodes: [{package: a, executable: b, parameter_files: [no.yaml]}]", "no parameter file"),
        ("processes: [{name: a}]\nnodes: [{package: a, executable: b}]", "'package' is missing"),
        ("arguments: {a: {defualt: 1}}\nnodes: [{package: a, executable: b}]", "'defualt'"),
        ("arguments: {a: {}}\nnodes: [{package: a, executable: b}]", "needs 'a'"),
        (
            "arguments: {a: {default: no.txt, file: true}}\nnodes: [{package: a, executable: b}]",
            "argument 'a': no file 'no.txt'",
        ),
        ("nodes: 3", "'nodes' must be a list, not 3"),
        ("nodes: {a: 1}", "'nodes' must be a list"),
        ("nodes: [foo]", "node 1 must be a mapping of keys to values, not 'foo'"),
        ("nodes: [{package: [a], executable: b}]", "node 'b': 'package' must be a text"),
        ("nodes: [{package: a, executable: b, name: 3}]", "'name' must be a text, not 3"),
        ("nodes: [{package: a, executable: b, parameters: 3}]", "'parameters' must be a mapping"),
        ("nodes: [{package: a, executable: b, parameters: {3: 4}}]", "node 'b': 'parameters'"),
        ("nodes: [{package: a, executable: b, parameter_files: x}]", "'parameter_files' must be"),
        ("nodes: [{package: a, executable: b, remaps: [x]}]", "'remaps' must be a mapping"),
        ("nodes: [{package: a, executable: b, remaps: {x: 3}}]", "remap 'x' must be a name"),
        ("arguments: [a]\nnodes: [{package: a, executable: b}]", "'arguments' must be a mapping"),
        ("arguments: {a: 3}\nnodes: [{package: a, executable: b}]", "argument 'a' must be a map"),
        ("processes: 3\nnodes: [{package: a, executable: b}]", "'processes' must be a list"),
        ("processes: [x]\nnodes: [{package: a, executable: b}]", "process 1 must be a mapping"),
        (
            "processes: [{name: p, package: a, executable: b, arguments: x}]\n"
            "nodes: [{package: a, executable: b}]",
            "process 'p': 'arguments' must be a list",
        ),
        (
            "processes: [{name: p, package: a, executable: b, when: [x]}]\n"
            "nodes: [{package: a, executable: b}]",
            "process 'p': 'when' must be a mapping",
        ),
        ("3: 4\nnodes: [{package: a, executable: b}]", "unknown key '3'"),
    ],
)
def test_mistakes_are_named(tmp_path, settings, text, expected):
    path = write(tmp_path, text)
    with pytest.raises(SystemFileError) as caught:
        load_system(path, (), settings)
    assert expected in str(caught.value)
    assert "system.yaml" in str(caught.value) or "argument" in str(caught.value)


@pytest.mark.parametrize("text", ["/**: 3", "/**: {parameters: {}}", "b: {ros__parameters: [1]}"])
def test_malformed_parameter_files_are_named(tmp_path, settings, text):
    (tmp_path / "p.yaml").write_text(text)
    path = write(tmp_path, "nodes: [{package: a, executable: b, parameter_files: [p.yaml]}]")
    node = load_system(path, (), settings).nodes[0]
    with pytest.raises(SystemFileError, match=r"p\.yaml: .* has no mapping 'ros__parameters'"):
        node.all_parameters()


def test_scenario_entries_are_looked_up_and_missing_ones_named(tmp_path, settings):
    (tmp_path / "scenario.yaml").write_text(
        format_yaml({"spacecraft": [{"name": "deputy", "target": {"x": [1, 2]}}]})
    )
    template = (
        "arguments: {{scenario: {{default: scenario.yaml, file: true}}}}\n"
        "nodes: [{{package: a, executable: b, parameters: {{t: '${{{}}}'}}}}]"
    )
    good = write(tmp_path, template.format("scenario.spacecraft.deputy.target.x"))
    assert load_system(good, (), settings).nodes[0].parameters["t"] == [1, 2]
    bad = write(tmp_path, template.format("scenario.spacecraft.chief.target"))
    with pytest.raises(SystemFileError, match="has no 'spacecraft.chief.target'"):
        load_system(bad, (), settings)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a:=1", ("a", 1)),
        ("a.b:=[1.0, 2.0]", ("a.b", [1.0, 2.0])),
        ("a:=", ("a", "")),
        ("a:=x:=y", ("a", "x:=y")),
    ],
)
def test_overrides_are_yaml(text, expected):
    assert parse_override(text) == expected


@pytest.mark.parametrize("text", ["a", ":=1", "a=1", "a:=[1"])
def test_malformed_overrides_are_refused(text):
    with pytest.raises(SystemFileError):
        parse_override(text)


def test_names_and_paths_of_system_files(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    assert find_system_file("reference_software").samefile(REFERENCE)
    assert find_system_file(str(REFERENCE)) == REFERENCE
    with pytest.raises(SystemFileError, match="reference_software"):
        find_system_file("nothing")


TWINS = """
arguments:
  scenario: {default: scenario.yaml, file: true}
  simulator: {default: emulator}
  chief_port: {default: /dev/ttyUSB1}
  deputy_port: {default: /dev/ttyUSB0}
processes:
  - name: emulator
    package: vtff_sim_bridge
    executable: simgen_emulator
    when: {simulator: emulator}
    sets: {simulator: 127.0.0.1, chief_port: ports/chief, deputy_port: ports/deputy}
    arguments: ["${free_port.a}", "${free_port.a}", "${free_port.b}", "${seed}"]
nodes:
  - {package: vtff_nav, executable: receiver_driver, namespace: chief,
     parameters: {port: "${chief_port}"}}
  - {package: vtff_nav, executable: receiver_driver, namespace: deputy,
     parameters: {port: "${deputy_port}"}}
"""


@pytest.fixture
def twins(tmp_path):
    (tmp_path / "scenario.yaml").write_text("seed: 5\n")
    (tmp_path / "twins.yaml").write_text(TWINS)
    return tmp_path / "twins.yaml"


def ports_of(system):
    return [node.parameters["port"] for node in system.nodes]


def test_a_process_sets_arguments_that_the_command_line_left_alone(twins):
    assert ports_of(load_system(twins)) == ["ports/chief", "ports/deputy"]
    given = load_system(twins, ["deputy_port:=/dev/ttyS0", "simulator:=emulator"])
    assert ports_of(given) == ["ports/chief", "/dev/ttyS0"]
    assert given.arguments["simulator"] == "127.0.0.1"
    real = load_system(twins, ["simulator:=192.0.2.7"])
    assert ports_of(real) == ["/dev/ttyUSB1", "/dev/ttyUSB0"]
    assert not real.processes


def test_named_free_ports_and_the_seed(twins):
    first, again, other, seed = load_system(twins).processes[0].arguments
    assert first == again != other
    assert seed == "5"
    settings = RunSettings(run_directory=twins.parent, seed=9)
    assert load_system(twins, (), settings).processes[0].arguments[3] == "9"


def test_an_override_may_name_one_of_two_nodes_of_a_name(twins):
    both = load_system(twins, ["receiver_driver.baud:=9600"])
    assert [node.parameters.get("baud") for node in both.nodes] == [9600, 9600]
    one = load_system(twins, ["deputy/receiver_driver.baud:=9600"])
    assert [node.parameters.get("baud") for node in one.nodes] == [None, 9600]
    with pytest.raises(SystemFileError, match="no node 'third/receiver_driver'"):
        load_system(twins, ["third/receiver_driver.baud:=9600"])


PREPARING = """
nodes:
  - {package: vtff_sim_bridge, executable: simgen_bridge, ends_run: true}
  - {package: vtff_nav, executable: receiver_driver, namespace: chief, lockstep: participant,
     prepares: true}
  - {package: vtff_nav, executable: receiver_driver, namespace: deputy}
"""


@pytest.mark.parametrize("pacing", ["lockstep", "realtime"])
def test_nodes_that_prepare_are_waited_for_in_any_pacing(tmp_path, pacing):
    settings = RunSettings(run_directory=tmp_path, pacing=pacing)
    bridge, chief, deputy = load_system(write(tmp_path, PREPARING), (), settings).nodes
    assert bridge.parameters["lockstep_preparing"] == ["/chief/receiver_driver"]
    assert chief.parameters["reports_ready"] is True
    assert "reports_ready" not in deputy.parameters
    assert "lockstep_preparing" not in chief.parameters


def test_without_nodes_that_prepare_nobody_is_told_of_them(settings):
    bridge = by_name(load_system(REFERENCE, (), settings))["simgen_bridge"]
    assert "lockstep_preparing" not in bridge.parameters


def test_a_file_that_extends_another_adds_to_it(tmp_path, settings):
    (tmp_path / "params").mkdir()
    (tmp_path / "params" / "limits.yaml").write_text("/**:\n  ros__parameters: {cap: 1.0}\n")
    (tmp_path / "base").mkdir()
    base = tmp_path / "base" / "base.yaml"
    base.write_text(
        "arguments: {scenario: {default: base.yaml, file: true}, speed: {default: 1}}\n"
        "nodes:\n"
        "  - {package: p, executable: one, parameters: {a: 1, b: 2},"
        " parameter_files: [../params/limits.yaml]}\n"
    )
    top = write(
        tmp_path,
        "extends: base/base.yaml\n"
        "arguments: {speed: {default: 3}}\n"
        "nodes:\n"
        "  - {executable: one, parameters: {b: '${speed}'}}\n"
        "  - {package: p, executable: two}\n",
    )
    system = load_system(top, (), settings)
    assert system.arguments == {"scenario": str(base), "speed": 3}
    one, two = system.nodes
    assert (one.parameters["a"], one.parameters["b"]) == (1, 3)
    assert one.all_parameters()["cap"] == 1.0
    assert two.executable == "two"


def test_a_change_of_a_node_in_another_namespace_is_named(tmp_path, settings):
    (tmp_path / "base.yaml").write_text(
        "nodes:\n  - {package: p, executable: one, namespace: deputy}\n"
    )
    top = write(tmp_path, "extends: base.yaml\nnodes:\n  - {name: one, parameters: {b: 1}}\n")
    with pytest.raises(SystemFileError, match=r"'one' of base\.yaml .*there: namespace: deputy"):
        load_system(top, (), settings)


def test_files_must_not_extend_each_other_in_a_circle(tmp_path, settings):
    top = write(tmp_path, "extends: system.yaml\n")
    with pytest.raises(SystemFileError, match="circle"):
        load_system(top, (), settings)
