"""Error of reading a recording."""

from __future__ import annotations


class RecordingError(ValueError):
    """A recording does not hold what a format or an evaluation needs; the text names it."""
