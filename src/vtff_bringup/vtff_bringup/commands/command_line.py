"""The command as its user typed it."""

from __future__ import annotations

import shlex
import sys

__all__ = ["command_line"]


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
