"""Description of a system, resolved: its processes, its nodes, and what a run gives to it."""

from __future__ import annotations

import dataclasses
import pathlib
from typing import Any

from vtff_bringup.system.yaml_file import read_mapping, ros_parameters
from vtff_node.plain_yaml import format_yaml

__all__ = [
    "HostDescription",
    "NodeDescription",
    "ProcessDescription",
    "RunSettings",
    "SystemDescription",
]


@dataclasses.dataclass(frozen=True)
class HostDescription:
    """A machine of a run on several machines, and the IPv4 address of its interface."""

    name: str
    address: str


@dataclasses.dataclass(frozen=True)
class ProcessDescription:
    """A program without ROS that belongs to a run."""

    name: str
    package: str
    executable: str
    arguments: tuple[str, ...]
    host: str = ""


@dataclasses.dataclass(frozen=True)
class NodeDescription:
    """A ROS node of a run; the attributes are the keys of ``nodes`` in a system file."""

    package: str
    executable: str
    name: str
    namespace: str
    parameters: dict[str, Any]
    parameter_files: tuple[pathlib.Path, ...]
    remaps: dict[str, str]
    lockstep: str
    prepares: bool
    ends_run: bool
    own_process: bool
    host: str = ""

    @property
    def qualified_name(self) -> str:
        """Fully qualified node name, e.g. ``/deputy/thruster``."""
        return f"{self.namespace.rstrip('/')}/{self.name}"

    def all_parameters(self) -> dict[str, Any]:
        """Return the parameters in force: those of the parameter files, then the node's own.

        The sections ``/**`` and that of the node itself count, in the order of the file.

        Raises
        ------
        SystemFileError
            If a parameter file cannot be read or has not the form of one.
        """
        values: dict[str, Any] = {}
        for path in self.parameter_files:
            for section, content in read_mapping(path).items():
                names = ("**", self.name, self.qualified_name.strip("/"))
                if str(section).strip("/") in names:
                    values.update(ros_parameters(path, section, content))
        return {**values, **self.parameters}

    def ros_arguments(self, parameter_file: pathlib.Path | None = None) -> list[str]:
        """Return the command line after the executable.

        Parameters
        ----------
        parameter_file
            File that holds `parameters`; without it each parameter is an argument.
        """
        arguments = ["--ros-args", "-r", f"__node:={self.name}", "-r", f"__ns:={self.namespace}"]
        for path in self.parameter_files:
            arguments += ["--params-file", str(path)]
        if parameter_file is not None:
            arguments += ["--params-file", str(parameter_file)]
        else:
            for key, value in self.parameters.items():
                arguments += ["-p", f"{key}:={format_yaml(value, on_one_line=True)}"]
        for source, target in self.remaps.items():
            arguments += ["-r", f"{source}:={target}"]
        return arguments


@dataclasses.dataclass(frozen=True)
class SystemDescription:
    """A system file with arguments and overrides applied.

    `hosts` is empty for a run on one machine; otherwise the main host is the first. `free_ports`
    has the value of each ``${free_port}`` and ``${free_port.NAME}`` that the file uses.
    """

    path: pathlib.Path
    description: str
    arguments: dict[str, Any]
    processes: tuple[ProcessDescription, ...]
    nodes: tuple[NodeDescription, ...]
    hosts: tuple[HostDescription, ...] = ()
    control_port: int = 0
    free_ports: dict[str, int] = dataclasses.field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name of the system: its file name without ending."""
        return self.path.stem


@dataclasses.dataclass(frozen=True)
class RunSettings:
    """Settings that a run gives to its system file.

    Attributes
    ----------
    run_directory
        Folder of the run.
    pacing
        ``lockstep`` or ``realtime``.
    duration
        Scenario seconds to run; None for the scenario's own.
    seed
        Seed of every random stream; None for the scenario's own.
    max_lag
        In real time, steps that the run may be late before it stops, 0 for no limit; None for the
        default of the node that paces the run.
    free_ports
        Values of ``free_port`` and ``free_port.NAME``; those that are missing are chosen.
    """

    run_directory: pathlib.Path
    pacing: str = "lockstep"
    duration: float | None = None
    seed: int | None = None
    max_lag: float | None = None
    free_ports: dict[str, int] = dataclasses.field(default_factory=dict)
