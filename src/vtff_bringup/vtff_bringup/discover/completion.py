"""Completions of a shell: systems, their arguments and parameters, campaigns, nodes, runs, topics.

Where nothing is returned, a shell completes the names of files.
"""

from __future__ import annotations

import os
import pathlib
from collections.abc import Iterable, Iterator

import typer

from vtff_bringup.discover.installed import KINDS, config_files, nodes

__all__ = [
    "complete_campaign",
    "complete_kind",
    "complete_node",
    "complete_override",
    "complete_run",
    "complete_system",
    "complete_topic",
]

RUNS = "bags"  # folder in which runs are written if --out is not given


def complete_kind(incomplete: str) -> list[str]:
    """Return the kinds of things to list that begin with a text."""
    return _beginning(KINDS, incomplete)


def complete_system(incomplete: str) -> list[str]:
    """Return the systems that begin with a text."""
    return _beginning((path.stem for path in config_files("systems")), incomplete)


def complete_campaign(incomplete: str) -> list[str]:
    """Return the campaigns that begin with a text."""
    return _beginning((path.stem for path in config_files("campaigns")), incomplete)


def complete_node(incomplete: str) -> list[str]:
    """Return the nodes that begin with a text."""
    return _beginning((name for name, _, _ in nodes()), incomplete)


def complete_run(incomplete: str) -> list[str]:
    """Return the runs and bags in the folder bags that begin with a text."""
    folders = sorted(pathlib.Path(RUNS).glob("*/"))
    return _beginning((str(folder) for folder in folders if _holds_bag(folder)), incomplete)


def complete_override(context: typer.Context, incomplete: str) -> list[str]:
    """Return what a system lets its user set, as ``NAME:=``, and begins with a text.

    Those are its arguments and the parameters of the nodes that match, else the names of its
    nodes. The system is that of the same command line.
    """
    from vtff_bringup.system.errors import SystemFileError

    try:
        return _beginning(_settable(str(context.params.get("system")), incomplete), incomplete)
    except (SystemFileError, LookupError, OSError):
        return []  # the command itself says what is wrong with the system


def complete_topic(context: typer.Context, incomplete: str) -> list[str]:
    """Return the topics of the bag of ``--bag`` that begin with a text; none without a bag."""
    from vtff_bag.file.errors import BagError
    from vtff_bag.file.reader import BagReader

    bag = context.params.get("bag")
    try:
        return [] if bag is None else _beginning(sorted(BagReader(bag).topics), incomplete)
    except BagError:
        return []


def _beginning(names: Iterable[str], incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]


def _holds_bag(folder: pathlib.Path) -> bool:
    return (folder / "bag").is_dir() or any(name.endswith(".mcap") for name in os.listdir(folder))


def _settable(system: str, incomplete: str) -> Iterator[str]:
    """Yield arguments of a system, and parameters of the nodes whose names a text begins.

    Raises
    ------
    SystemFileError
        If there is no such system, or its file is wrong.
    """
    from vtff_bringup.system.parameter_check import parameter_tables
    from vtff_bringup.system.system_file import find_system_file, list_settable
    from vtff_node.parameters import fields_in_order

    arguments, entries = list_settable(find_system_file(system))
    yield from (f"{name}:=" for name in arguments)
    named, dot, _ = incomplete.partition(".")
    matching = [name for name in entries if (name == named if dot else name.startswith(named))]
    if len(matching) > 1:
        yield from (f"{name}." for name in matching)
        return
    for name in matching:
        entry = entries[name]
        values = entry.get("parameters") or {}
        for table in parameter_tables(entry["package"], entry["executable"], values):
            yield from (f"{name}.{field.name}:=" for field in fields_in_order(table))
