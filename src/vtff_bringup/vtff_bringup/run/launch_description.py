"""Launch descriptions from system files, for `ros2 launch`.

Nodes, parameters and remaps are those of `vtff run`; only the front end differs. This module
needs launch and launch_ros, which come with an apt ROS 2 and are not on PyPI.
"""

from __future__ import annotations

import datetime
import os
import pathlib
import shlex
from typing import Any

from vtff_bringup.children.processes import ESCALATION
from vtff_bringup.run.domain import add_dds_settings
from vtff_bringup.system.blas_threads import ONE_BLAS_THREAD
from vtff_bringup.system.description import NodeDescription, RunSettings
from vtff_bringup.system.system_file import find_system_file, load_system
from vtff_node.executables import executable_path
from vtff_node.process.lifeline import Lifelines, Stage
from vtff_node.process.run_environment import RUN_DIRECTORY_VARIABLE

DEFAULT_SYSTEM = "reference_software"

#: Time between the signals that end a process, s, as launch wants them: the same as in `vtff run`.
TEARDOWN = {
    name: str(patience)
    for name, (_, patience) in zip(
        ("sigterm_timeout", "sigkill_timeout"), ESCALATION[:2], strict=True
    )
}

#: Default and description of the launch arguments; every launch file has these.
ARGUMENTS = {
    "overrides": ("", "argument:=value and node.parameter:=value texts, blanks between them"),
    "pacing": ("lockstep", "lockstep: as fast as it goes; realtime: one second each second"),
    "duration": ("", "scenario seconds to run; empty: as the scenario says"),
    "seed": ("", "seed of every random stream; empty: as the scenario says"),
    "run_directory": ("", "folder of the run; empty: bags/<system>_<date>_<time>"),
}


def launch_description(system: str | None = None) -> Any:
    """Return the launch description of a launch file.

    Parameters
    ----------
    system
        Name or path of the system file; if it is not given, the launch argument ``system``.

    Returns
    -------
    launch.LaunchDescription
    """
    from launch import LaunchDescription
    from launch.actions import DeclareLaunchArgument, OpaqueFunction
    from launch.substitutions import LaunchConfiguration

    arguments = dict(ARGUMENTS)
    if system is None:
        arguments["system"] = (DEFAULT_SYSTEM, "name of a file in config/system, or a path")

    def start(context: Any) -> list[Any]:
        values = {name: LaunchConfiguration(name).perform(context) for name in arguments}
        if system is not None:
            values["system"] = system
        return launch_actions(**values)

    declared = [
        DeclareLaunchArgument(
            name,
            default_value=default,
            description=description,
            choices=["lockstep", "realtime"] if name == "pacing" else None,
        )
        for name, (default, description) in arguments.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start)])


def launch_actions(
    system: str,
    overrides: str = "",
    pacing: str = "lockstep",
    duration: str = "",
    seed: str = "",
    run_directory: str = "",
) -> list[Any]:
    """Return the launch actions of a system file.

    Parameters
    ----------
    system
        Name or path of the system file.
    overrides
        ``key:=value`` texts separated by blanks; a text with a blank in it stands in quotes.
    pacing
        ``lockstep`` or ``realtime``.
    duration
        Scenario seconds to run; empty for the scenario's own.
    seed
        Seed of every random stream; empty for the scenario's own.
    run_directory
        Folder of the run; empty for ``bags/<system>_<date>_<time>``.

    Raises
    ------
    SystemFileError
        If the system file or an override is wrong.
    ValueError
        If `duration` or `seed` is not a number, the folder already holds a run, or the system has
        several hosts.
    """
    from launch.actions import ExecuteProcess

    path = find_system_file(system)
    now = datetime.datetime.now().strftime("%Y%m%d_%H%M%S")
    directory = pathlib.Path(run_directory or f"bags/{path.stem}_{now}").resolve()
    if (directory / "bag").exists():
        raise ValueError(f"{directory} already holds a run; choose another run_directory")
    settings = RunSettings(
        run_directory=directory,
        pacing=pacing,
        duration=_parse_number("duration", duration, float),
        seed=_parse_number("seed", seed, int),
    )
    description = load_system(path, shlex.split(overrides), settings)
    if description.hosts:
        raise ValueError(f"{path.name} runs on several hosts: only `vtff run --host` can do so")
    directory.mkdir(parents=True, exist_ok=True)
    environment = _additional_environment(directory)
    lifelines = Lifelines()  # `ros2 launch` holds them as long as it lives
    actions: list[Any] = []
    for process in description.processes:
        program = executable_path(process.package, process.executable)
        action = ExecuteProcess(
            cmd=[str(program), *process.arguments],
            name=process.name,
            additional_env={**environment, **lifelines.environment(Stage.HELPERS)},
            output="screen",
            **TEARDOWN,
        )
        actions += [action, _make_exit_handler(action, process.name, ends_run=False)]
    for node in description.nodes:
        stage = Stage.RECORDERS if node.own_process else Stage.NODES
        own = lifelines.environment(stage)
        action = _make_node_action(node, {**environment, **own})
        actions += [action, _make_exit_handler(action, node.qualified_name, ends_run=node.ends_run)]
    return actions


def _parse_number(name: str, text: str, kind: type) -> Any:
    if not text.strip():
        return None
    try:
        return kind(text)
    except ValueError as error:
        raise ValueError(f"launch argument '{name}' is '{text}'; it must be a number") from error


def _additional_environment(directory: pathlib.Path) -> dict[str, str]:
    """Return the variables that the processes get beside the environment of `ros2 launch`."""
    environment = dict(os.environ)
    add_dds_settings(environment)
    environment = {**ONE_BLAS_THREAD, **environment}
    changed = {name: value for name, value in environment.items() if os.environ.get(name) != value}
    return {RUN_DIRECTORY_VARIABLE: str(directory), **changed}


def _make_node_action(node: NodeDescription, environment: dict[str, str]) -> Any:
    from launch_ros.actions import Node

    # ROS cannot read the type of an empty list: it is left out, which means the default.
    values = {key: value for key, value in node.parameters.items() if value != []}
    return Node(
        package=node.package,
        executable=node.executable,
        name=node.name,
        namespace=node.namespace,
        parameters=[*(str(path) for path in node.parameter_files), values],
        remappings=list(node.remaps.items()),
        additional_env=environment,
        output="screen",
        **TEARDOWN,
    )


def _make_exit_handler(action: Any, name: str, *, ends_run: bool) -> Any:
    """Return the handler that ends the launch when a process ends.

    It raises on a failure: only that gives `ros2 launch` a non-zero exit code.
    """
    from launch.actions import EmitEvent, RegisterEventHandler
    from launch.event_handlers import OnProcessExit
    from launch.events import Shutdown

    def end_launch(event: Any, context: Any) -> list[Any]:
        if context.is_shutdown:
            return []
        if ends_run and event.returncode == 0:
            return [EmitEvent(event=Shutdown(reason="run complete"))]
        what = "failed" if event.returncode else "ended before the run did"
        raise RuntimeError(f"{name} {what} (exit code {event.returncode})")

    return RegisterEventHandler(OnProcessExit(target_action=action, on_exit=end_launch))
