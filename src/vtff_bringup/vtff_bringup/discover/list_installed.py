"""`vtff list`: what is installed, one line each."""

from __future__ import annotations

import ast
import importlib.util
import itertools
import pathlib
import re
from collections.abc import Iterator
from typing import Annotated, Optional

import typer

from vtff_bringup.discover.completion import complete_kind
from vtff_bringup.discover.installed import KINDS, config_files, nodes
from vtff_bringup.run.console import make_console
from vtff_bringup.run.errors import exit_with_error
from vtff_bringup.run.exit_codes import EXIT_USAGE


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
        lines = list(_node_lines() if shown == "nodes" else _file_lines(shown))
        width = max((len(name) for name, _ in lines), default=0)
        console.print(f"[bold]{shown}[/bold]")
        for name, text in lines:
            console.print(f"  {name:{width}}  {text}", markup=False, soft_wrap=True)


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
