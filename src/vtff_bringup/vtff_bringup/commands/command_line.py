"""The command as its user typed it, and what several commands are given."""

from __future__ import annotations

import pathlib
import shlex
import sys
from typing import Annotated, Any, Literal

import typer

from vtff_bringup.discover.completion import complete_run

__all__ = ["RecordedRun", "TableForm", "command_line", "folder_option"]

RecordedRun = Annotated[
    pathlib.Path,
    typer.Argument(help="Run folder, bag directory or .mcap file.", autocompletion=complete_run),
]

TableForm = Annotated[
    Literal["parquet", "csv"],
    typer.Option(
        "--format",
        help="Form of large tables; parquet keeps units and times in its metadata.",
    ),
]


def command_line(*, without: str = "") -> str:
    """Return the command line of this process, as a shell reads it.

    Parameters
    ----------
    without
        Option that is left out with its value.
    """
    kept: list[str] = []
    words = iter(sys.argv[1:])
    for word in words:
        if without and word == without:
            next(words, None)
        elif not (without and word.startswith(f"{without}=")):
            kept.append(word)
    return shlex.join(["vtff", *kept])


def folder_option(text: str) -> Any:
    """Return the option that names the folder into which a command writes, with its help."""
    return typer.Option(parser=_folder_name, metavar="FOLDER", help=text)


def _folder_name(text: str | pathlib.Path) -> pathlib.Path:
    """Return a folder that its user typed.

    An empty text, as an unset variable of a shell is, would be this folder.
    """
    if not str(text):
        raise typer.BadParameter("a folder expected, got an empty text; this folder is '.'")
    return pathlib.Path(text)
