"""Truth of a run: what the receivers of a scenario were given, as JSON lines."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TextIO

__all__ = ["TruthFile"]

_ENCODER = json.JSONEncoder(separators=(",", ":"))


class TruthFile:
    """Writes records, one JSON object to a line; without a path they go nowhere.

    They have the field ``record``: ``run``, ``receiver``, ``region``, ``fault``, ``satellite``,
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
        self._path = path
        self._stream: TextIO | None = (
            None if path is None else Path(path).open("w", encoding="utf-8")
        )

    @property
    def is_wanted(self) -> bool:
        """Whether records are kept."""
        return self._stream is not None

    def write(self, record: str, **fields: Any) -> None:
        """Write one record; raise OSError with the path if that fails."""
        if self._stream is not None:
            with self._named_errors():
                self._stream.write(_ENCODER.encode({"record": record, **fields}) + "\n")

    def flush(self) -> None:
        """Hand the records to the system; raise OSError with the path if that fails."""
        if self._stream is not None:
            with self._named_errors():
                self._stream.flush()

    def close(self) -> None:
        """Close the file; nothing can be written then. Raises as `flush` does."""
        if self._stream is not None:
            with self._named_errors():
                self._stream.close()
            self._stream = None

    @contextlib.contextmanager
    def _named_errors(self) -> Iterator[None]:
        """Give up the file at an error, and raise one that names it.

        What is buffered can never be written then: it must not be tried again at every later call.
        """
        try:
            yield
        except OSError as error:
            stream, self._stream = self._stream, None
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()
            raise OSError(error.errno, error.strerror, str(self._path)) from error
