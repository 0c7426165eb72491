"""The error of a source of contents."""

from __future__ import annotations

__all__ = ["TecError"]


class TecError(ValueError):
    """A file cannot be processed; the message names it and the reason."""
