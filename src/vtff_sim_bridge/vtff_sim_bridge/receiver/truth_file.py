"""Truth of a run: what the receivers of a scenario were given, as JSON lines."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, TextIO

__all__ = ["TruthFile"]


class TruthFile:
    """Writes records, one JSON object to a line; without a path they go nowhere.

    Records have the field ``record``: ``run``, ``receiver``, ``region``, ``fault``, ``satellite``,
    ``arc`` or ``second``.

    Parameters
    ----------
    path : path-like or None

    Raises
    ------
    OSError
        If the file cannot be written.
    """

    def __init__(self, path: str | Path | None = None) -> None:
        self._stream: TextIO | None = (
            None if path is None else Path(path).open("w", encoding="utf-8")
        )

    @property
    def is_wanted(self) -> bool:
        """Whether records are kept."""
        return self._stream is not None

    def write(self, record: str, **fields: Any) -> None:
        """Write one record."""
        if self._stream is not None:
            line = json.dumps({"record": record, **fields}, separators=(",", ":"))
            self._stream.write(line + "\n")

    def flush(self) -> None:
        """Hand what is buffered to the system."""
        if self._stream is not None:
            self._stream.flush()

    def close(self) -> None:
        """Close the file; nothing can be written afterwards."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None
