"""YAML files that hold one mapping: system files, parameter files, scenarios."""

from __future__ import annotations

import pathlib
from typing import Any

from vtff_bringup.system.errors import SystemFileError
from vtff_node.plain_yaml import PlainYamlError, parse_yaml

__all__ = ["read_mapping", "resolve_file", "ros_parameters"]


def resolve_file(folder: pathlib.Path, name: object) -> pathlib.Path:
    """Return the path of a file that a YAML file names, relative to a folder.

    Raises
    ------
    SystemFileError
        If no file can have that name.
    """
    try:
        return (folder / str(name)).resolve()
    except (OSError, ValueError, RuntimeError):  # too long, a null byte, links in a circle
        raise SystemFileError(f"no file can have the name {str(name)[:80]!r}") from None


def read_mapping(path: pathlib.Path) -> dict[str, Any]:
    """Return the mapping in a YAML file.

    Raises
    ------
    SystemFileError
        If the file cannot be read, is not valid YAML or holds no mapping.
    """
    try:
        content = parse_yaml(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SystemFileError(f"cannot read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise SystemFileError(f"{path} is not a text file: {error}") from error
    except PlainYamlError as error:
        raise SystemFileError(f"{path} is not valid YAML: {error}") from error
    if not isinstance(content, dict):
        raise SystemFileError(f"{path} is empty or not a mapping")
    return content


def ros_parameters(path: pathlib.Path, section: object, content: object) -> dict[str, Any]:
    """Return the parameters of one section of a ROS parameter file.

    Parameters
    ----------
    path
        The file, for messages.
    section, content
        Name of the section and what stands under it.

    Raises
    ------
    SystemFileError
        If the section has no mapping ``ros__parameters``.
    """
    if content is None:
        return {}
    parameters = content.get("ros__parameters") if isinstance(content, dict) else None
    if not isinstance(parameters, dict):
        raise SystemFileError(f"{path}: '{section}' has no mapping 'ros__parameters'")
    return parameters
