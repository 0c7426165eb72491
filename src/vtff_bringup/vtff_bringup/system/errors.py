"""Error of system files."""

from __future__ import annotations


class SystemFileError(ValueError):
    """A system file or an override is wrong; the text names file, entry and key."""
