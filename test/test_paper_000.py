"""Rooms that docs/paper_000.md says may go are not imported by the reference systems."""

from __future__ import annotations

import ast
import importlib.metadata
import pathlib
import re

import pytest
import yaml

ROOT = pathlib.Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs/paper_000.md").read_text(encoding="utf-8")
SYSTEMS = ("reference", "reference_software")
#: What `vtff run` imports by name, beside the nodes.
RUNNER = ("vtff_bringup.cli", "vtff_bringup.commands.run", "vtff_analysis.report.write")


def find_modules() -> dict[str, pathlib.Path]:
    """Return the modules and packages of src by dotted name."""
    found = {}
    for package in (ROOT / "src").glob("vtff_*"):
        for file in (package / package.name).rglob("*.py"):
            name = ".".join(file.relative_to(package).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = file
    return found


MODULES = find_modules()


def imports(file: pathlib.Path) -> set[str]:
    """Return the modules of src that a file imports, also inside functions."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{name.name}" for name in node.names)}
        elif isinstance(node, ast.Import):
            names |= {name.name for name in node.names}
    return names & MODULES.keys()


def reach(starts: set[str]) -> set[str]:
    """Return all modules that the modules import, directly or not."""
    reached: set[str] = set()
    waiting = list(starts)
    while waiting:
        name = waiting.pop()
        if name and name not in reached:
            reached.add(name)
            waiting += [*imports(MODULES[name]), name.rpartition(".")[0]]
    return reached


def modules_of_systems() -> set[str]:
    """Return the modules of the nodes, processes and plug-ins of the reference systems."""
    scripts = {
        script.name: script.module
        for script in importlib.metadata.entry_points(group="console_scripts")
    }
    content = [
        yaml.safe_load((ROOT / f"config/system/{name}.yaml").read_text()) for name in SYSTEMS
    ]
    entries = [entry for one in content for entry in (*one["nodes"], *one["processes"])]
    plugins = [
        point.module
        for group in ("vtff.controllers", "vtff.estimators")
        for point in importlib.metadata.entry_points(group=group)
    ]
    return {scripts[entry["executable"]] for entry in entries} | set(plugins)


def rooms(heading: str) -> list[str]:
    """Return the rooms of the table whose third column has this heading."""
    table = re.search(rf"\| package \| rooms that may go \| {heading} \|\n.*?\n\n", PAGE, re.S)
    assert table
    rows = re.findall(r"^\| (vtff_\w+) \| ([^|]+) \|", table.group(), re.M)
    return [
        f"{package}.{room.replace('/', '.')}"
        for package, cell in rows
        for room in re.findall(r"`([^`]+)`", cell)
    ]


@pytest.mark.parametrize(
    ("heading", "starts"), [("subject", (*RUNNER,)), ("used by", ())], ids=["run", "nodes"]
)
def test_rooms_that_may_go_are_not_imported(heading, starts):
    named = rooms(heading)
    assert len(named) > 10 and all(room in MODULES for room in named)
    reached = reach(modules_of_systems() | set(starts))
    assert len(reached) > 100
    needed = {name for name in reached for room in named if name.startswith(f"{room}.")}
    assert not needed


def test_imports_of_rooms_that_stay_are_seen():
    """The search can fail."""
    reached = reach(modules_of_systems())
    assert "vtff_control.tracking.sdre" in reached
    assert any(name.startswith("vtff_nav.relative.cdgps.") for name in reached)
