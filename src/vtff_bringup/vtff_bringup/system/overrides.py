"""Overrides of a system file from the command line: ``key:=value``."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from vtff_bringup.system.errors import SystemFileError
from vtff_node.plain_yaml import PlainYamlError, parse_yaml

__all__ = ["parse_override", "sort_overrides"]


def parse_override(text: str) -> tuple[str, Any]:
    """Split ``key:=value``; the value is read as YAML.

    Raises
    ------
    SystemFileError
        If the text has not that form.
    """
    key, separator, value = text.partition(":=")
    if not separator or not key:
        raise SystemFileError(f"'{text}' is not of the form key:=value")
    try:
        return key.strip(), parse_yaml(value) if value.strip() else ""
    except PlainYamlError as error:
        raise SystemFileError(f"'{text}': the value is not valid YAML ({error})") from error


def sort_overrides(
    overrides: Sequence[str], arguments: Collection[str], nodes: Collection[Any], file_name: str
) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """Sort overrides into arguments and parameters of nodes.

    Parameters
    ----------
    overrides
        ``argument:=value`` or ``node.parameter:=value`` texts.
    arguments, nodes
        Names of the arguments and nodes of the system file.
    file_name
        Name of the system file, for messages.

    Returns
    -------
    argument_values, parameter_values
        Values of arguments by name, and values of parameters by node and name.

    Raises
    ------
    SystemFileError
        If an override names neither an argument nor a node.
    """
    argument_values: dict[str, Any] = {}
    parameter_values: dict[str, dict[str, Any]] = {}
    for text in overrides:
        key, value = parse_override(text)
        node, _, parameter = key.partition(".")
        if key in arguments:
            argument_values[key] = value
        elif parameter and node.rpartition("/")[2] in nodes:
            parameter_values.setdefault(node, {})[parameter] = value
        else:
            names = sorted(arguments) + [f"{name}.<parameter>" for name in sorted(nodes)]
            raise SystemFileError(
                f"'{text}': {file_name} has no argument or node '{node}'; known: {', '.join(names)}"
            )
    return argument_values, parameter_values
