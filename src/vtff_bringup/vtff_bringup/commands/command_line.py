"""The command as its user typed it."""

from __future__ import annotations

import shlex
import sys

__all__ = ["command_line"]


def command_line() -> str:
    """Return the command line of this process, as a shell reads it."""
    return shlex.join(["vtff", *sys.argv[1:]])
