"""The error of a RINEX file."""

from __future__ import annotations

__all__ = ["RinexError"]


class RinexError(ValueError):
    """A RINEX file is malformed; the message names file, line and field."""
