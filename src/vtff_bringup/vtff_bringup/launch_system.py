"""Launch actions for a system file, for those who start with `ros2 launch`.

The nodes, parameters and remaps are those of `vtff run`; only the front end differs. This
module needs launch and launch_ros, which come with an apt ROS 2 and are not on PyPI.
"""

from __future__ import annotations

import datetime
import pathlib
from typing import Any

from vtff_bringup.executables import executable_path
from vtff_bringup.system import NodeDescription, RunSettings, find_system_file, load_system


def launch_actions(
    system: str, overrides: str = "", pacing: str = "lockstep", run_directory: str = ""
) -> list[Any]:
    """Return the launch actions of a system file.

    Parameters
    ----------
    system
        Name or path of the system file.
    overrides
        ``key:=value`` texts separated by blanks.
    pacing
        ``lockstep`` or ``realtime``.
    run_directory
        Folder of the run; empty for ``bags/<system>_<date>_<time>``.
    """
    from launch.actions import EmitEvent, ExecuteProcess, RegisterEventHandler
    from launch.event_handlers import OnProcessExit
    from launch.events import Shutdown

    path = find_system_file(system)
    now = datetime.datetime.now().strftime("%Y%m%d_%H%M%S")
    directory = pathlib.Path(run_directory or f"bags/{path.stem}_{now}").resolve()
    directory.mkdir(parents=True, exist_ok=True)
    description = load_system(path, overrides.split(), RunSettings(directory, pacing))
    actions: list[Any] = [
        ExecuteProcess(
            cmd=[str(executable_path(process.package, process.executable)), *process.arguments],
            name=process.name,
            output="screen",
        )
        for process in description.processes
    ]
    for node in description.nodes:
        action = _node_action(node)
        actions.append(action)
        if node.ends_run:
            end = OnProcessExit(
                target_action=action, on_exit=[EmitEvent(event=Shutdown(reason="run complete"))]
            )
            actions.append(RegisterEventHandler(end))
    return actions


def _node_action(node: NodeDescription) -> Any:
    from launch_ros.actions import Node

    # Empty lists are left out: ROS cannot read their type, and they mean the default.
    values = {key: value for key, value in node.parameters.items() if value != []}
    return Node(
        package=node.package,
        executable=node.executable,
        name=node.name,
        namespace=node.namespace,
        parameters=[*(str(path) for path in node.parameter_files), values],
        remappings=list(node.remaps.items()),
        output="screen",
    )
