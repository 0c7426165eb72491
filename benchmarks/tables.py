"""Rows of results: printed as a Markdown table, kept in ``benchmarks/results/<name>.json``.

A fragment is a JSON object: `title`, `script` (empty for figures of commands), `note`, `columns`
and `rows`. A row has its `cells`, and with them all that is needed to judge and repeat it:
`conditions`, `command`, `seeds`, `date`, `version`, `machine`. `write_results.py` makes
docs/results.md and the tables of benchmarks/README.md from the fragments.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import pathlib
import platform
import sys
from collections.abc import Sequence
from importlib import metadata
from typing import Any

RESULTS = pathlib.Path(__file__).resolve().parent / "results"
"""Folder of the fragments."""

__all__ = ["RESULTS", "add_write_option", "markdown_table", "read_fragment", "write_rows"]


def add_write_option(parser: argparse.ArgumentParser, name: str) -> None:
    """Add ``--write``, which keeps the rows in a fragment.

    Parameters
    ----------
    parser
        Command line of the benchmark.
    name
        Name of the fragment, without folder and suffix.
    """
    parser.add_argument(
        "--write", action="store_true", help=f"keep the rows in benchmarks/results/{name}.json"
    )


def markdown_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table; a bar in a cell is escaped."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join(
        "| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines
    )


def read_fragment(name: str) -> dict[str, Any]:
    """Return a fragment.

    Raises
    ------
    ValueError
        If a row has not as many cells as the fragment has columns; names file and row.
    """
    path = RESULTS / f"{name}.json"
    fragment: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    for row in fragment["rows"]:
        if len(row["cells"]) != len(fragment["columns"]):
            raise ValueError(
                f"{path}: row {row['cells'][0]!r} has {len(row['cells'])} cells, "
                f"{len(fragment['columns'])} expected"
            )
    return fragment


def write_rows(
    name: str, columns: Sequence[str], rows: Sequence[Sequence[str]], seeds: str = "-"
) -> None:
    """Write rows of this run into a fragment, with command, date, version and machine.

    A row replaces the one with the same first cell, whose conditions it keeps; the others stay.

    Parameters
    ----------
    name
        Name of the fragment.
    columns
        Columns of the rows.
    rows
        Cells of each row; the first cell names the row.
    seeds
        Seeds of the flights.

    Raises
    ------
    ValueError
        If the fragment has other columns.
    """
    fragment = read_fragment(name)
    if list(columns) != fragment["columns"]:
        raise ValueError(f"{name}: columns {fragment['columns']} expected, got {list(columns)}")
    kept = {row["cells"][0]: row for row in fragment["rows"]}
    arguments = [word for word in sys.argv[1:] if word != "--write"]
    origin = {
        "command": " ".join(["python", f"benchmarks/{pathlib.Path(sys.argv[0]).name}", *arguments]),
        "seeds": seeds,
        "date": datetime.datetime.now(datetime.timezone.utc).date().isoformat(),
        "version": metadata.version("vtff_bringup"),
        "machine": describe_machine(),
    }
    for cells in rows:
        conditions = kept.get(cells[0], {}).get("conditions", "")
        kept[cells[0]] = {"cells": list(cells), "conditions": conditions, **origin}
    fragment["rows"] = list(kept.values())
    text = json.dumps(fragment, indent=1, ensure_ascii=False)
    (RESULTS / f"{name}.json").write_text(text + "\n", encoding="utf-8")


def describe_machine() -> str:
    """Return processor, number of logical processors and version of Python."""
    model = platform.processor() or platform.machine()
    cpus = pathlib.Path("/proc/cpuinfo")
    if cpus.exists():
        lines = cpus.read_text(encoding="utf-8").splitlines()
        names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
        model = names[0] if names else model
    return f"{model}, {os.cpu_count()} processors, Python {platform.python_version()}"
