"""Where a receiver's bytes come from. This release: a log file, by path or ``file://`` name."""

from __future__ import annotations

import os
import pathlib
import urllib.parse

CHUNK_LENGTH = 1 << 14


class SourceError(OSError):
    """The bytes of a receiver cannot be had; the text names the port or file."""


class FileSource:
    """A receiver log file, read from start to end.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    SourceError
        If it cannot be opened.
    """

    def __init__(self, path: pathlib.Path) -> None:
        self.path = path
        try:
            self._file = path.open("rb")
            self.size = os.fstat(self._file.fileno()).st_size
        except OSError as error:
            raise SourceError(f"cannot read receiver log {path}: {error.strerror}") from error
        self.position = 0

    def read(self) -> bytes:
        """Return the next bytes; empty at the end.

        Raises
        ------
        SourceError
            If reading fails.
        """
        try:
            chunk = self._file.read(CHUNK_LENGTH)
        except OSError as error:
            raise SourceError(f"cannot read receiver log {self.path}: {error.strerror}") from error
        self.position += len(chunk)
        return chunk

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def open_source(port: str) -> FileSource:
    """Open a port by its name.

    Parameters
    ----------
    port
        ``file:///absolute/path``, ``file://relative/path`` or a path.

    Raises
    ------
    SourceError
        If the name is of another kind, or the file cannot be read.
    """
    scheme, separator, rest = port.partition("://")
    if separator and scheme != "file":
        raise SourceError(f"port '{port}': '{scheme}' is not known; use file://<path>")
    path = pathlib.Path(urllib.parse.unquote(rest) if separator else port)
    if path.is_char_device() or port.startswith("/dev/"):
        raise SourceError(f"port '{port}': serial ports are not read yet; use file://<path>")
    return FileSource(path)
