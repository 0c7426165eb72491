"""Receiver log files, by path or ``file://`` name; live ports are in `live_port`."""

from __future__ import annotations

import io
import os
import pathlib
import stat
import urllib.parse
from typing import BinaryIO

from vtff_gnss.rinex.compressed_file import (
    COMPRESSION_MARK_LENGTH,
    decompress,
    is_compressed,
)
from vtff_gnss.rinex.errors import RinexError

CHUNK_LENGTH = 1 << 14
PORT_FORMS = "use /dev/tty..., serial://<device>, tcp://<host>:<port> or file://<path>"


class SourceError(OSError):
    """The log of a receiver cannot be opened or read; the text names the port or the file."""


class FileSource:
    """A receiver log file, read from start to end.

    A log that is compressed with gzip, bzip2, zip or compress is decompressed when it is opened.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    SourceError
        If the file cannot be opened, its compression is damaged, or it is no regular file:
        opening a pipe would wait for its writer.
    """

    def __init__(self, path: pathlib.Path) -> None:
        self.path = path
        try:
            mode = os.stat(path).st_mode
            if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
                raise SourceError(f"cannot read receiver log {path}: it is not a regular file")
            self._file: BinaryIO = path.open("rb")
            self.size = os.fstat(self._file.fileno()).st_size
            self._decompress()
        except SourceError:
            raise
        except RinexError as error:
            raise SourceError(f"cannot read receiver log {error}") from error
        except (OSError, ValueError) as error:
            raise SourceError(
                f"cannot read receiver log {path}: {_describe_error(error)}"
            ) from error
        self.position = 0

    def _decompress(self) -> None:
        """Replace a compressed file by its content."""
        is_packed = is_compressed(self._file.read(COMPRESSION_MARK_LENGTH))
        self._file.seek(0)
        if is_packed:
            with self._file as packed:
                content = decompress(packed.read(), self.path)
            self._file, self.size = io.BytesIO(content), len(content)

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
            raise SourceError(
                f"cannot read receiver log {self.path}: {_describe_error(error)}"
            ) from error
        self.position += len(chunk)
        return chunk

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._file.close()


def open_source(port: str) -> FileSource:
    """Open the log file that a port name stands for.

    Parameters
    ----------
    port
        ``file:///absolute/path``, ``file://relative/path`` or a path. The name after ``file://`` is
        used unchanged if such a file exists, else with its percent signs decoded.

    Raises
    ------
    SourceError
        If the name has another form, or the file cannot be read.
    """
    scheme, separator, rest = port.partition("://")
    if separator and scheme.lower() != "file":
        raise SourceError(f"port '{port}': '{scheme}' is not known; {PORT_FORMS}")
    name = rest if separator else port
    if not name:
        raise SourceError(f"port '{port}' names no file; {PORT_FORMS}")
    decoded = urllib.parse.unquote(name)
    if separator and not os.path.lexists(name) and os.path.lexists(decoded):
        name = decoded
    return FileSource(pathlib.Path(name))


def _describe_error(error: OSError | ValueError) -> str:
    return getattr(error, "strerror", None) or str(error)
