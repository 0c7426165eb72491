"""The console that every command prints on."""

from __future__ import annotations

import os

from rich.console import Console

__all__ = ["make_console"]

#: Width in letters of a console that is no terminal: no line of a command is longer.
_UNWRAPPED = 10_000


def make_console() -> Console:
    """Return the console of a command.

    On a terminal text is wrapped at its width. In a file or a pipe a line stays one line, so that
    a search or a program finds it whole; the environment variable COLUMNS sets another width.
    """
    console = Console(highlight=False)
    if console.is_terminal or "COLUMNS" in os.environ:
        return console
    return Console(highlight=False, width=_UNWRAPPED)
