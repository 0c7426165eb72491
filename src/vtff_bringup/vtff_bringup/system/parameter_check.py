"""Parameters that a user gives to nodes, checked before any process starts."""

from __future__ import annotations

import dataclasses
import importlib.metadata
from collections.abc import Sequence
from typing import Any

from vtff_bringup.system.description import NodeDescription, SystemDescription
from vtff_bringup.system.errors import SystemFileError
from vtff_bringup.system.overrides import parse_override
from vtff_bringup.system.references import NUMBER_OF_DEPUTIES
from vtff_node.executables import ExecutableNotFoundError, node_class
from vtff_node.node import CommonParameters
from vtff_node.parameters import ParameterError, check, check_values, default_of, fields_in_order
from vtff_node.plugins.loading import PluginError, load_plugin
from vtff_sim_bridge.gnss.configuration import load_gnss_configuration
from vtff_sim_bridge.truth.scenario import load_scenario
from vtff_sim_bridge.truth.scenario_fields import ScenarioError

__all__ = ["check_files", "check_parameters", "parameter_tables"]


def check_parameters(system: SystemDescription, overrides: Sequence[str]) -> None:
    """Check names and values of the parameters of all nodes.

    A node that has no table of parameters (`vtff_node.executables.node_class`) checks its
    parameters itself. Files that parameters refer to are checked before (`check_files`).

    Raises
    ------
    SystemFileError
        If a node has no such parameter, or a value is not allowed; one line with the node, and
        with the system file unless the overrides name the node.
    """
    named = {parse_override(text)[0].partition(".")[0].strip("/") for text in overrides}
    for node in system.nodes:
        try:
            _check_node(node)
        except SystemFileError as error:
            if named & {node.name, node.qualified_name.strip("/")}:
                raise
            raise SystemFileError(f"{system.path}: {error}") from error


def check_files(system: SystemDescription) -> None:
    """Check scenario and emulated receivers of a system, so that no process starts for a wrong one.

    Raises
    ------
    SystemFileError
        If a file is wrong; one line with file and field.
    """
    arguments = system.arguments
    if "scenario" in arguments:
        _check_scenario(system)
    is_emulated = any(process.executable == "simgen_emulator" for process in system.processes)
    if arguments.get("gnss") and is_emulated:
        try:
            load_gnss_configuration(str(arguments["gnss"]))
        except (OSError, ValueError) as error:
            raise SystemFileError(str(error)) from error


def _check_scenario(system: SystemDescription) -> None:
    number = system.arguments.get(NUMBER_OF_DEPUTIES) or 0
    try:
        load_scenario(str(system.arguments["scenario"]), number_of_deputies=number)
    except ScenarioError as error:
        raise SystemFileError(str(error)) from error


def _check_node(node: NodeDescription) -> None:
    values = node.all_parameters()
    try:
        tables = parameter_tables(node.package, node.executable, values)
    except (ExecutableNotFoundError, importlib.metadata.PackageNotFoundError):
        return
    except SystemFileError as error:
        raise SystemFileError(f"{node.qualified_name}: {error}") from error
    try:
        check_values(node.qualified_name, values, tables)
        for table in tables:
            if hasattr(table, "check"):  # what values tell together
                names = {field.name for field in dataclasses.fields(table)}
                table(**{name: values[name] for name in names & values.keys()}).check()
    except (ParameterError, ValueError) as error:
        text = str(error)
        where = "" if node.qualified_name in text else f"{node.qualified_name}: "
        raise SystemFileError(f"{where}{text}") from error


def parameter_tables(package: str, executable: str, values: dict[str, Any]) -> list[type]:
    """Return the tables of parameters of a node, with that of the plug-in that its values name.

    Raises
    ------
    ExecutableNotFoundError
        If the package has no such node.
    SystemFileError
        If the plug-in is not installed or cannot be loaded.
    """
    found = node_class(package, executable)
    tables = [table for table in (found.Parameters, CommonParameters) if table is not None]
    if found.Plugins is not None:
        key = found.Plugins.parameter
        field = next(field for field in fields_in_order(found.Parameters) if field.name == key)
        value = values.get(key, default_of(field))
        try:
            check(key, field, value)
            plugin = load_plugin(found.Plugins, value)
        except (ValueError, PluginError) as error:
            raise SystemFileError(str(error)) from error
        if plugin.parameter_table is not None:
            tables.append(plugin.parameter_table)
    return tables
