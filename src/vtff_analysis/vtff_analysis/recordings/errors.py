"""Error of the exports."""

from __future__ import annotations


class ExportError(ValueError):
    """A bag does not hold what an export needs; the text names it."""
