"""Paths of executables, shared files and node classes, found as `ros2 run` finds them."""

from __future__ import annotations

import importlib
import importlib.metadata
import os
import pathlib
from typing import Any


class ExecutableNotFoundError(LookupError):
    """A package, its executable or its file is not installed; the text names it."""


def executable_path(package: str, executable: str) -> pathlib.Path:
    """Return ``<prefix>/lib/<package>/<executable>`` of the ament prefix that has it.

    Raises
    ------
    ExecutableNotFoundError
        If no prefix in ``AMENT_PREFIX_PATH`` holds the package or the executable.
    """
    path = _prefix(package) / "lib" / package / executable
    # Only what the package installs: a path would lead to any program of the machine.
    if pathlib.PurePath(executable).name != executable or not path.is_file():
        raise ExecutableNotFoundError(f"package '{package}' has no executable '{executable}'")
    return path


def share_file(package: str, name: str) -> pathlib.Path:
    """Return ``<prefix>/share/<package>/<name>``.

    Raises
    ------
    ExecutableNotFoundError
        If the package or the file is not installed.
    """
    path = share_folder(package) / name
    if not path.is_file():
        raise ExecutableNotFoundError(f"package '{package}' has no file '{name}'")
    return path


def share_folder(package: str) -> pathlib.Path:
    """Return ``<prefix>/share/<package>``.

    Raises
    ------
    ExecutableNotFoundError
        If the package is not installed.
    """
    return _prefix(package) / "share" / package


def _prefix(package: str) -> pathlib.Path:
    marker = pathlib.Path("share/ament_index/resource_index/packages") / package
    if pathlib.PurePath(package).name != package:
        raise ExecutableNotFoundError(f"'{package}' is not the name of a package")
    for text in os.environ.get("AMENT_PREFIX_PATH", "").split(":"):
        if text and (pathlib.Path(text) / marker).is_file():
            return pathlib.Path(text)
    raise ExecutableNotFoundError(
        f"package '{package}' is not in AMENT_PREFIX_PATH; run 'make setup' or source the workspace"
    )


def node_class(package: str, executable: str) -> Any:
    """Return the node class of an executable, so that several nodes can share one process.

    Every node module assigns its class to ``NODE_CLASS``.

    Raises
    ------
    ExecutableNotFoundError
        If the package has no such console script or the module no ``NODE_CLASS``.
    """
    scripts = importlib.metadata.distribution(package).entry_points.select(
        group="console_scripts", name=executable
    )
    for script in scripts:
        module = importlib.import_module(script.module)
        if hasattr(module, "NODE_CLASS"):
            return module.NODE_CLASS
        raise ExecutableNotFoundError(f"{script.module} has no NODE_CLASS: it cannot be composed")
    raise ExecutableNotFoundError(f"package '{package}' has no executable '{executable}'")
