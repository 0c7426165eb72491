"""Truth of a run: what the receivers of a scenario were given, as JSON lines."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TextIO

__all__ = ["TruthFile"]

#: Kind of a record, and a function that makes its fields.
_Record = tuple[str, Callable[[], dict[str, Any]]]
_ENCODER = json.JSONEncoder(separators=(",", ":"))


class TruthFile:
    """Writes records, one JSON object to a line; without a path they go nowhere.

    Records wait for `flush`: a client that waits for the bytes of receivers does not wait for them.
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
        self._waiting: list[_Record] = []

    @property
    def is_wanted(self) -> bool:
        """Whether records are kept."""
        return self._stream is not None

    def write(self, record: str, **fields: Any) -> None:
        """Write one record."""
        self.write_later(record, lambda: fields)

    def write_later(self, record: str, make_fields: Callable[[], dict[str, Any]]) -> None:
        """Write one record, whose fields are made when it is written.

        Parameters
        ----------
        record : str
        make_fields : callable
            Returns the fields; what it uses must not change before.
        """
        if self._stream is not None:
            self._waiting.append((record, make_fields))

    def flush(self) -> None:
        """Hand what waits to the system; raises OSError with the path if that fails."""
        if self._stream is None or not self._waiting:
            return
        lines = [
            _ENCODER.encode({"record": record, **make()}) + "\n" for record, make in self._waiting
        ]
        self._waiting.clear()
        with self._named_errors():
            self._stream.write("".join(lines))
            self._stream.flush()

    def close(self) -> None:
        """Write what waits and close the file; nothing can be written then.

        Raises as `flush` does.
        """
        self.flush()
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
