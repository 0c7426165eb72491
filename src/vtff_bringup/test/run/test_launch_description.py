"""The second front end: `ros2 launch` starts what `vtff run` starts.

Without ROS launch (the wheels have none) its actions are replaced by stand-ins that only keep
what they are given; where it is installed, a short run is launched.
"""

from __future__ import annotations

import importlib
import os
import pathlib
import runpy
import sys
import types

import pytest

from vtff_bringup.run import domain
from vtff_bringup.run import launch_description as launch_system
from vtff_bringup.system.description import RunSettings
from vtff_bringup.system.errors import SystemFileError
from vtff_bringup.system.system_file import load_system
from vtff_node import executables
from vtff_node.plain_yaml import format_yaml, parse_yaml

ROOT = pathlib.Path(__file__).resolve().parents[4]
REFERENCE = ROOT / "config/system/reference_software.yaml"
LAUNCH_FILES = sorted((ROOT / "src/vtff_bringup/launch").glob("*.launch.py"))


class Kept:
    """An action or event that keeps its arguments."""

    def __init__(self, *arguments, **named):
        self.arguments = arguments
        self.named = named


def stand_in(monkeypatch, module, *names):
    content = types.ModuleType(module)
    for name in names:
        setattr(content, name, type(name, (Kept,), {}))
    monkeypatch.setitem(sys.modules, module, content)


@pytest.fixture
def kept_launch(monkeypatch, tmp_path):
    """ROS launch replaced by stand-ins, and executables that need not be installed."""
    stand_in(monkeypatch, "launch", "LaunchDescription")
    actions = ("DeclareLaunchArgument", "EmitEvent", "ExecuteProcess", "OpaqueFunction")
    stand_in(monkeypatch, "launch.actions", *actions, "RegisterEventHandler")
    stand_in(monkeypatch, "launch.event_handlers", "OnProcessExit")
    stand_in(monkeypatch, "launch.events", "Shutdown")
    stand_in(monkeypatch, "launch.substitutions", "LaunchConfiguration")
    stand_in(monkeypatch, "launch_ros", "actions")
    stand_in(monkeypatch, "launch_ros.actions", "Node")
    monkeypatch.setattr(
        launch_system, "executable_path", lambda package, name: pathlib.Path(package) / name
    )
    monkeypatch.setattr(domain, "share_file", lambda package, name: tmp_path / name)


def kinds(actions, kind):
    return [action for action in actions if type(action).__name__ == kind]


def ros_arguments(node):
    """Return the command line that launch_ros makes of a Node action."""
    given = node.named
    line = ["--ros-args", "-r", f"__node:={given['name']}", "-r", f"__ns:={given['namespace']}"]
    *files, values = given["parameters"]
    for file in files:
        line += ["--params-file", file]
    for key, value in values.items():
        line += ["-p", f"{key}:={format_yaml(value, on_one_line=True)}"]
    for source, target in given["remappings"]:
        line += ["-r", f"{source}:={target}"]
    return line


@pytest.mark.parametrize("pacing", ["lockstep", "realtime"])
def test_same_command_lines_as_the_runner(kept_launch, monkeypatch, tmp_path, pacing):
    monkeypatch.setattr("vtff_bringup.system.system_file.choose_free_port", lambda *taken: 40000)
    run = tmp_path / "run"
    override = "sdre_controller.design:=delay_aware"
    actions = launch_system.launch_actions(
        str(REFERENCE), override, pacing, duration="20", seed="7", run_directory=str(run)
    )
    settings = RunSettings(run, pacing, duration=20.0, seed=7)
    expected = load_system(REFERENCE, [override], settings)

    processes = kinds(actions, "ExecuteProcess")
    assert [process.named["cmd"][1:] for process in processes] == [
        list(process.arguments) for process in expected.processes
    ]
    nodes = kinds(actions, "Node")
    assert len(nodes) == len(expected.nodes)
    for node, description in zip(nodes, expected.nodes, strict=True):
        assert node.named["package"] == description.package
        assert node.named["executable"] == description.executable
        assert ros_arguments(node) == _without_empty_lists(description.ros_arguments())
        assert node.named["additional_env"]["VTFF_RUN_DIRECTORY"] == str(run)
    bridge = next(node for node in nodes if node.named["executable"] == "simgen_bridge")
    assert bridge.named["parameters"][-1]["duration"] == 20.0


def test_every_process_has_its_lifeline_and_the_time_of_vtff_run_to_end(kept_launch, tmp_path):
    actions = launch_system.launch_actions(str(REFERENCE), run_directory=str(tmp_path / "run"))
    started = [*kinds(actions, "ExecuteProcess"), *kinds(actions, "Node")]
    for action in started:
        times = (action.named["sigterm_timeout"], action.named["sigkill_timeout"])
        assert times == ("20.0", "10.0")
    lines = {
        action.named.get("executable", action.named["name"]): action.named["additional_env"][
            "VTFF_LIFELINE"
        ].split(":")
        for action in started
    }
    assert {holder for holder, _, _ in lines.values()} == {str(os.getpid())}
    # Nodes keep recorders and emulators alive, recorders only emulators.
    kept = {name: len(line[2].split(",")) if line[2] else 0 for name, line in lines.items()}
    assert kept.pop("bag_recorder") == 1
    assert kept.pop("simgen_emulator") == 0
    assert set(kept.values()) == {2}


@pytest.mark.parametrize(
    ("given", "profile"),
    [
        ({}, "fastdds.xml"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, "fastdds_network.xml"),
        ({"FASTRTPS_DEFAULT_PROFILES_FILE": "/mine.xml"}, "mine.xml"),
    ],
)
def test_dds_stays_on_this_machine_unless_it_is_widened(
    kept_launch, monkeypatch, tmp_path, given, profile
):
    for name in ("ROS_AUTOMATIC_DISCOVERY_RANGE", "FASTRTPS_DEFAULT_PROFILES_FILE"):
        monkeypatch.delenv(name, raising=False)
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    environment = dict(os.environ)
    domain.add_dds_settings(environment)
    assert pathlib.Path(environment["FASTRTPS_DEFAULT_PROFILES_FILE"]).name == profile
    again = dict(environment)
    domain.add_dds_settings(again)
    assert again == environment
    actions = launch_system.launch_actions(str(REFERENCE), run_directory=str(tmp_path / "run"))
    added = kinds(actions, "Node")[0].named["additional_env"]
    in_force = {**os.environ, **added}["FASTRTPS_DEFAULT_PROFILES_FILE"]
    assert in_force == environment["FASTRTPS_DEFAULT_PROFILES_FILE"]


def _without_empty_lists(arguments):
    """Drop ``-p name:=[]``, which ROS cannot read and which means the default."""
    kept = []
    for flag, value in zip(arguments[1::2], arguments[2::2], strict=True):
        if not (flag == "-p" and value.strip().endswith(":=[]")):
            kept += [flag, value]
    return ["--ros-args", *kept]


def handler(actions, name):
    """Return what happens at the end of the process or node `name`."""
    for registration in kinds(actions, "RegisterEventHandler"):
        on_exit = registration.arguments[0].named
        target = on_exit["target_action"].named
        if name in (target.get("name"), target.get("executable")):
            return on_exit["on_exit"]
    raise AssertionError(f"nothing is registered for the end of {name}")


def test_a_failed_node_fails_the_launch(kept_launch, tmp_path):
    actions = launch_system.launch_actions(str(REFERENCE), run_directory=str(tmp_path / "run"))
    running = types.SimpleNamespace(is_shutdown=False)
    ending = types.SimpleNamespace(is_shutdown=True)

    def ended(code):
        return types.SimpleNamespace(returncode=code)

    shutdown = handler(actions, "simgen_bridge")(ended(0), running)
    assert kinds(shutdown, "EmitEvent")
    with pytest.raises(RuntimeError, match=r"/simgen_bridge failed \(exit code 1\)"):
        handler(actions, "simgen_bridge")(ended(1), running)
    with pytest.raises(RuntimeError, match="/deputy/thruster ended before the run did"):
        handler(actions, "thruster")(ended(0), running)
    with pytest.raises(RuntimeError, match=r"simgen_emulator failed \(exit code -9\)"):
        handler(actions, "simgen_emulator")(ended(-9), running)
    # While the launch shuts down, every process ends.
    assert handler(actions, "thruster")(ended(-2), ending) == []


@pytest.mark.parametrize(
    ("arguments", "error", "text"),
    [
        ({"duration": "long"}, ValueError, "'duration' is 'long'"),
        ({"seed": "1.5"}, ValueError, "'seed' is '1.5'"),
        ({"overrides": "nonsense:=1"}, SystemFileError, "no argument or node 'nonsense'"),
        ({"system": "nonsense"}, SystemFileError, "no system file 'nonsense'"),
    ],
)
def test_wrong_arguments(kept_launch, tmp_path, arguments, error, text):
    run = tmp_path / "run"
    with pytest.raises(error, match=text):
        launch_system.launch_actions(
            **{"system": str(REFERENCE), "run_directory": str(run), **arguments}
        )
    assert not run.exists()


def test_a_run_is_not_overwritten(kept_launch, tmp_path):
    (tmp_path / "run/bag").mkdir(parents=True)
    with pytest.raises(ValueError, match="already holds a run"):
        launch_system.launch_actions(str(REFERENCE), run_directory=str(tmp_path / "run"))


def test_an_override_may_hold_blanks(kept_launch, tmp_path):
    actions = launch_system.launch_actions(
        str(REFERENCE),
        "'sdre_controller.target_position_rtn:=[0.0, 150.0, 0.0]'",
        run_directory=str(tmp_path / "run"),
    )
    controller = next(
        node for node in kinds(actions, "Node") if node.named["executable"] == "sdre_controller"
    )
    assert controller.named["parameters"][-1]["target_position_rtn"] == [0.0, 150.0, 0.0]


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_launch_files_take_the_same_arguments(kept_launch, path):
    description = runpy.run_path(str(path))["generate_launch_description"]()
    declared = kinds(description.arguments[0], "DeclareLaunchArgument")
    names = {action.arguments[0] for action in declared}
    assert names - {"system"} == set(launch_system.ARGUMENTS)
    assert ("system" in names) == (path.name == "system.launch.py")


@pytest.fixture
def real_launch():
    """ROS launch; the project of that name on PyPI is another one and has no actions."""
    for module in ("launch.actions", "launch_ros.actions"):
        pytest.importorskip(module, reason="ROS launch is not installed", exc_type=ImportError)
    return importlib.import_module("launch")


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_short_run(real_launch, tmp_path, path):
    try:
        executables.executable_path("vtff_sim_bridge", "simgen_bridge")
    except executables.ExecutableNotFoundError as error:
        pytest.skip(str(error))
    from launch.actions import IncludeLaunchDescription
    from launch.launch_description_sources import PythonLaunchDescriptionSource

    run = tmp_path / "run"
    arguments = {"duration": "20", "run_directory": str(run)}
    service = real_launch.LaunchService(noninteractive=True)
    service.include_launch_description(
        real_launch.LaunchDescription(
            [
                IncludeLaunchDescription(
                    PythonLaunchDescriptionSource(str(path)), launch_arguments=arguments.items()
                )
            ]
        )
    )
    assert service.run() == 0
    metadata = parse_yaml((run / "bag/metadata.yaml").read_text())
    counts = {
        entry["topic_metadata"]["name"]: entry["message_count"]
        for entry in metadata["rosbag2_bagfile_information"]["topics_with_message_count"]
    }
    assert counts["/clock"] == 21
    assert counts["/deputy/propulsion/thrust_applied"] == 21
