"""`vtff list`: what is installed, one line each."""

from __future__ import annotations

import ast
import importlib.metadata
import importlib.util
import itertools
import pathlib
import re
from collections.abc import Iterator
from typing import Annotated, Optional

import typer

from vtff_bringup.run.console import make_console
from vtff_bringup.run.errors import exit_with_error
from vtff_bringup.run.exit_codes import EXIT_USAGE

KINDS = ("systems", "scenarios", "worlds", "campaigns", "nodes")

#: Folder in ``config`` of each kind of file.
FOLDERS = {"systems": "system", "scenarios": "scenario", "worlds": "gnss", "campaigns": "campaign"}


def complete_kind(incomplete: str) -> list[str]:
    """Return the kinds that begin with a text, for the completion of a shell."""
    return [kind for kind in KINDS if kind.startswith(incomplete)]


def complete_system(incomplete: str) -> list[str]:
    """Return the systems that begin with a text, for the completion of a shell."""
    return [path.stem for path in config_files("systems") if path.stem.startswith(incomplete)]


def complete_node(incomplete: str) -> list[str]:
    """Return the nodes that begin with a text, for the completion of a shell."""
    return [name for name, _, _ in nodes() if name.startswith(incomplete)]


def list_installed(
    kind: Annotated[
        Optional[str],  # noqa: UP045 - typer reads the annotation at run time on 3.10
        typer.Argument(help=f"{', '.join(KINDS)}; default: all.", autocompletion=complete_kind),
    ] = None,
) -> None:
    """List systems, scenarios, worlds, campaigns and nodes.

    Each with what it is. Worlds are those of the receivers. Files of config/ in this folder come
    before installed ones of the same name. The topics of a running graph or of a bag: vtff topic
    list. Parameters of a node: vtff node NODE --help.
    """
    console = make_console()
    if kind is not None and kind not in KINDS:
        text = f"'{kind}' cannot be listed; choose one of: {', '.join(KINDS)}"
        text += ", or topics of a run or bag by vtff topic list" if kind == "topics" else ""
        raise exit_with_error(console, text, EXIT_USAGE)
    for shown in KINDS if kind is None else (kind,):
        lines = _node_lines() if shown == "nodes" else _file_lines(shown)
        console.print(f"[bold]{shown}[/bold]")
        for name, text in lines:
            console.print(f"  {name:22} {text}", markup=False, soft_wrap=True)


def config_files(kind: str) -> list[pathlib.Path]:
    """Return the files of a kind by name: those of ``config`` here, then the installed ones."""
    from vtff_node.executables import ExecutableNotFoundError, share_folder

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


def _file_lines(kind: str) -> Iterator[tuple[str, str]]:
    for path in config_files(kind):
        yield path.stem, _description(path)


def _description(path: pathlib.Path) -> str:
    """Return the description that a file gives itself, else the first sentence of its comment."""
    lines = path.read_text(encoding="utf-8").splitlines()
    for line in lines:
        if line.startswith("description:"):
            text = line.partition(":")[2].strip()
            if text not in (">", ">-", "|", ""):
                return text.strip("\"'")
    comments = itertools.takewhile(lambda line: line.startswith("#"), lines)
    text = " ".join(line.lstrip("# ") for line in comments)
    return re.split(r"(?<=[^.])\.(?: |$)", text, maxsplit=1)[0]  # its first sentence


def _node_lines() -> Iterator[tuple[str, str]]:
    for name, package, module in nodes():
        yield name, f"{_first_line(module)} ({package})"


def _first_line(module: str) -> str:
    """Return what a node does from the docstring of its module, which is not imported."""
    package, _, name = module.rpartition(".")
    spec = importlib.util.find_spec(package)
    folders = [] if spec is None else list(spec.submodule_search_locations or ())
    for folder in folders:
        path = pathlib.Path(folder, f"{name}.py")
        if path.is_file():
            text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
            return text.partition("\n")[0].partition(": ")[2] or text.partition("\n")[0]
    return ""
