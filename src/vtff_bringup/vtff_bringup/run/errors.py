"""Error lines and notes that the commands print."""

from __future__ import annotations

import os
import pathlib
from collections.abc import Sequence

import typer
from rich.console import Console
from rich.markup import escape

__all__ = [
    "describe_os_error",
    "discard_output",
    "exit_with_error",
    "print_error",
    "print_note",
]


def print_error(console: Console, error: Exception | str) -> None:
    """Print an error as one line."""
    console.print(f"[red]error:[/red] {escape(str(error))}", soft_wrap=True)


def print_note(console: Console, note: str) -> None:
    """Print a note as one line."""
    console.print(f"[yellow]note:[/yellow] {escape(note)}", soft_wrap=True)


def exit_with_error(console: Console, error: Exception | str, exit_code: int) -> typer.Exit:
    """Print an error, and return the exception that ends the command."""
    print_error(console, error)
    return typer.Exit(exit_code)


def describe_os_error(error: OSError, path: str | pathlib.Path = "") -> str:
    """Return file and reason of an error; `path` stands for the file that it does not name."""
    file = error.filename or path
    reason = error.strerror or str(error)
    return f"{file}: {reason}" if file else reason


def discard_output(descriptors: Sequence[int]) -> None:
    """Discard all further output to file descriptors: their terminal or pipe is gone."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for descriptor in descriptors:
        os.dup2(nowhere, descriptor)
    os.close(nowhere)
