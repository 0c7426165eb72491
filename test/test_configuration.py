"""Place of a value: defaults in nodes, differences in params files, wiring in systems.

Defaults stand in the parameter dataclass of a node, a params file holds what differs from them,
and a system file connects nodes and hands on the scenario's target, step and names. What the
simulator flies is never handed to an estimator: its models are its own parameters.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import pathlib
from typing import Any

import pytest
import rclpy
from domain_coordinator import domain_id
from rclpy.context import Context
from rclpy.node import Node

from vtff_bringup.system.extension import join_system
from vtff_node.executables import node_class
from vtff_node.parameters import default_of
from vtff_node.plain_yaml import parse_yaml
from vtff_node.plugins.loading import load_plugin
from vtff_sim_bridge.simremote.language import DEFAULT_PORT

CONFIG = pathlib.Path(__file__).resolve().parents[1] / "config"
SYSTEM_FILES = sorted((CONFIG / "system").glob("*.yaml"))
PARAMETER_FILES = sorted((CONFIG / "params").glob("*.yaml"))

#: What a system file may take from the scenario, beside the targets of deputies.
SCENARIO_ENTRIES = ("step", "hard_radius")
#: Parameters of the models that estimators and controllers have of the world.
MODEL_PARAMETERS = frozenset(
    ("gravity", "gravity_degree", "gravity_order", "integrator", "longest_step")
    + ("code_sigma", "phase_sigma", "use_receiver_sigmas", "thrust_sigma")
    + ("empirical_acceleration_sigma", "feedforward_gravity", "acceleration_cap", "quantum")
)


def read(path: pathlib.Path) -> dict[str, Any]:
    return parse_yaml(path.read_text(encoding="utf-8"))


def nodes_of(path: pathlib.Path) -> list[dict[str, Any]]:
    """Return the entries of the nodes of a system file, with those of the files it extends."""
    return join_system(path, read)["nodes"]


def defaults_of(node: dict[str, Any]) -> dict[str, Any]:
    kind = node_class(node["package"], node["executable"])
    defaults = {field.name: default_of(field) for field in dataclasses.fields(kind.Parameters)}
    if kind.Plugins is not None:
        # A plug-in's parameters are those of its node.
        name = kind.Plugins.parameter
        chosen = node.get("parameters", {}).get(name, defaults[name])
        table = load_plugin(kind.Plugins, chosen).parameter_table
        if table is not None:
            defaults |= {field.name: default_of(field) for field in dataclasses.fields(table)}
    return defaults


def users_of(parameter_file: pathlib.Path) -> list[dict[str, Any]]:
    """Return the nodes of all systems that are given a params file."""
    return [
        node
        for path in SYSTEM_FILES
        for node in nodes_of(path)
        if any(
            (path.parent / name).resolve() == parameter_file
            for name in node.get("parameter_files", ())
        )
    ]


@pytest.mark.parametrize("path", PARAMETER_FILES, ids=lambda path: path.stem)
def test_a_params_file_holds_only_what_differs_from_the_defaults(path):
    users = users_of(path)
    assert users, "no system uses the file"
    (section,) = read(path).values()
    assert section["ros__parameters"]
    for node in users:
        defaults = defaults_of(node)
        for name, value in section["ros__parameters"].items():
            assert name in defaults, f"{node['executable']} has no parameter {name}"
            assert value != defaults[name], f"{name}: the default of {node['executable']}"


@pytest.fixture(scope="module")
def domain():
    with domain_id() as domain:
        yield domain


@pytest.mark.parametrize("path", PARAMETER_FILES, ids=lambda path: path.stem)
def test_rcl_reads_the_same_types_from_a_params_file(path, domain):
    (section,) = read(path).values()
    context = Context()
    arguments = ["--ros-args", "--params-file", str(path)]
    rclpy.init(args=arguments, context=context, domain_id=domain)
    try:
        options = {"automatically_declare_parameters_from_overrides": True}
        node = Node("reader", context=context, enable_rosout=False, **options)
        found = {name: node.get_parameter(name).value for name in section["ros__parameters"]}
        node.destroy_node()
    finally:
        context.shutdown()
    plain = {name: list(v) if hasattr(v, "typecode") else v for name, v in found.items()}
    assert repr(plain) == repr(section["ros__parameters"])


@pytest.mark.parametrize("path", SYSTEM_FILES, ids=lambda path: path.stem)
def test_a_system_file_sets_no_model_of_the_world(path):
    for node in nodes_of(path):
        given = set(node.get("parameters", {}))
        assert given <= set(defaults_of(node)) | {"expected_nodes"}, node["executable"]
        assert not given & MODEL_PARAMETERS, node["executable"]


@pytest.mark.parametrize("path", SYSTEM_FILES, ids=lambda path: path.stem)
def test_a_system_file_takes_only_step_target_and_hard_radius_from_the_scenario(path):
    for node in nodes_of(path):
        for name, value in node.get("parameters", {}).items():
            if isinstance(value, str) and value.startswith("${scenario."):
                entry = value.removeprefix("${scenario.").rstrip("}").split(".")
                assert entry[0] in SCENARIO_ENTRIES, f"{node['executable']}: {name}"
            if isinstance(value, str) and value.startswith(("${deputy.", "${spacecraft.")):
                assert value.split(".")[1] == "target", f"{node['executable']}: {name}"


@pytest.mark.parametrize("path", SYSTEM_FILES, ids=lambda path: path.stem)
def test_an_argument_that_feeds_a_parameter_has_the_default_of_that_parameter(path):
    """Arguments whose value a process needs too: the bus and the port of SimREMOTE."""
    arguments = join_system(path, read).get("arguments", {})
    for node in nodes_of(path):
        defaults = defaults_of(node)
        for name, value in node.get("parameters", {}).items():
            argument = arguments.get(str(value).removeprefix("${").rstrip("}"), {})
            if argument.get("file") or defaults.get(name) in (None, ""):
                continue
            # 'emulator' stands for what the emulator's own process sets.
            default = argument.get("default")
            if str(default).startswith("${free_port"):  # chosen when the run starts
                continue
            while str(default).startswith("${"):  # that of another argument
                default = arguments[default.removeprefix("${").rstrip("}")]["default"]
            if default not in (None, "emulator"):
                assert default == defaults[name], f"{node['executable']}: {name}"


#: What receivers and their data feed; the rest of a system may be the simulator or a judge.
ESTIMATOR_PACKAGES = ("vtff_nav", "vtff_iono")


@pytest.mark.parametrize(
    "path",
    [
        path
        for path in SYSTEM_FILES
        if any(node["executable"] == "receiver_driver" for node in nodes_of(path))
    ],
    ids=lambda path: path.stem,
)
def test_no_truth_reaches_an_estimator_where_there_are_receivers(path):
    """Neither by the wiring of the system nor by the topics that the nodes hear by themselves."""
    estimators = [node for node in nodes_of(path) if node["package"] in ESTIMATOR_PACKAGES]
    assert estimators
    for node in estimators:
        kind = node_class(node["package"], node["executable"])
        source = inspect.getsource(inspect.getmodule(kind))
        heard = [
            ast.unparse(call.args[1])
            for call in ast.walk(ast.parse(source))
            if isinstance(call, ast.Call)
            and isinstance(call.func, ast.Attribute)
            and call.func.attr == "subscribe"
        ]
        wired = [*node.get("remaps", {}).values(), *map(str, node.get("parameters", {}).values())]
        assert not [text for text in (*heard, *wired) if "truth" in text], node["executable"]
        # `orbit` is a message of the simulator unless another node of the system estimates it.
        assert "orbit" not in _topics_heard(node, heard), node["executable"]


def _topics_heard(node: dict[str, Any], heard: list[str]) -> set[str]:
    """Return the names of topics that a node hears, as its parameters choose them."""
    names = {text.strip("'") for text in heard}
    if node.get("parameters", {}).get("orbit_source") == "navigation":
        names.discard("orbit")
    return names


def test_simremote_has_one_port():
    bridge = {"package": "vtff_sim_bridge", "executable": "simgen_bridge"}
    assert defaults_of(bridge)["simgen_port"] == DEFAULT_PORT


@pytest.mark.parametrize("path", SYSTEM_FILES, ids=lambda path: path.stem)
def test_emulated_devices_have_their_properties_from_their_own_defaults(path):
    for process in join_system(path, read).get("processes", ()):
        options = {str(text) for text in process["arguments"]}
        assert not options & {"--acceleration-cap", "--quantum", "--smallest", "--watchdog-timeout"}
