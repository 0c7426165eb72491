"""Systems, scenarios, worlds, campaigns and nodes that are installed or in this folder."""

from __future__ import annotations

import importlib.metadata
import pathlib

from vtff_node.executables import ExecutableNotFoundError, share_folder

__all__ = ["FOLDERS", "KINDS", "config_files", "nodes"]

KINDS = ("systems", "scenarios", "worlds", "campaigns", "nodes")

#: Folder in ``config`` of each kind of file.
FOLDERS = {"systems": "system", "scenarios": "scenario", "worlds": "gnss", "campaigns": "campaign"}


def config_files(kind: str) -> list[pathlib.Path]:
    """Return the files of a kind by name: those of ``config`` here, then the installed ones."""
    folders = [pathlib.Path("config")]
    try:
        folders.append(share_folder("vtff_bringup") / "config")
    except ExecutableNotFoundError:
        pass
    found: dict[str, pathlib.Path] = {}
    for folder in folders:
        for path in sorted((folder / FOLDERS[kind]).glob("*.yaml")):
            found.setdefault(path.stem, path)
    return [found[name] for name in sorted(found)]


def nodes() -> list[tuple[str, str, str]]:
    """Return name, package and module of each installed node of vtff, by name."""
    found = [
        (script.name, distribution.name.replace("-", "_"), script.module)
        for distribution in importlib.metadata.distributions()
        if distribution.name.replace("-", "_").startswith("vtff_")
        for script in distribution.entry_points.select(group="console_scripts")
        if script.module.endswith("_node")
    ]
    return sorted(set(found))
