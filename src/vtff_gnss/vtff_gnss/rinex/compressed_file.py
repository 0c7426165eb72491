"""Bytes of RINEX files, whatever compression they are stored in."""

from __future__ import annotations

import bz2
import errno
import gzip
import io
import pathlib
import stat
import warnings
import zipfile
import zlib
from typing import Protocol

import hatanaka

from vtff_gnss.rinex.errors import RinexError

__all__ = [
    "COMPRESSION_MARK_LENGTH",
    "decompress",
    "decompress_hatanaka",
    "is_compressed",
    "is_hatanaka",
    "is_rinex",
    "read_decompressed",
    "read_file",
]

COMPRESSION_MARK_LENGTH = 4
"""Bytes at the start of a file that tell its compression."""

_GZIP, _BZIP2, _COMPRESS, _ZIP = b"\x1f\x8b", b"BZh", b"\x1f\x9d", b"PK\x03\x04"

_VERSION_LABEL = b"RINEX VERSION / TYPE"
_LABEL_COLUMN = 60
# Limits of a decompressed file: a few bytes may stand for gigabytes. Observations expand 3 to 20
# times.
_LARGEST_SMALL_CONTENT = 16 << 20  # bytes, whatever the size of the compressed file
_LARGEST_EXPANSION = 200  # times the compressed file
# What the decompressors raise at damaged or incomplete content.
# A HatanakaException is a RuntimeError.
_DAMAGES = (OSError, EOFError, ValueError, RuntimeError, zlib.error, zipfile.BadZipFile)


class _Readable(Protocol):
    """A compressed file that gives its content."""

    def read(self, size: int = ..., /) -> bytes: ...


def read_file(path: str | pathlib.Path) -> bytes:
    """Return the content of a file.

    Raises
    ------
    OSError
        If the file cannot be read, or is a pipe or a device, which may never end.
    """
    path = pathlib.Path(path)
    kind = path.stat().st_mode
    if not stat.S_ISREG(kind) and not stat.S_ISDIR(kind):  # reading a folder tells that it is one
        raise OSError(errno.EINVAL, "not a regular file", str(path))
    return path.read_bytes()


def read_decompressed(path: str | pathlib.Path) -> bytes:
    """Return the content of a file without its compression; see `read_file`, `decompress`."""
    return decompress(read_file(path), path)


def decompress(content: bytes, path: str | pathlib.Path) -> bytes:
    """Undo gzip, bzip2, zip or Unix compress, found by content; other bytes are returned as is.

    Parameters
    ----------
    content : bytes
        The file.
    path : path-like
        Name of the file, for messages.

    Raises
    ------
    RinexError
        If the compressed file is damaged or incomplete, or a zip archive of several files.
    """
    try:
        if content.startswith(_GZIP):
            with gzip.GzipFile(fileobj=io.BytesIO(content)) as packed:
                return _read_bounded(packed, content, path)
        if content.startswith(_BZIP2):
            with bz2.BZ2File(io.BytesIO(content)) as packed:
                return _read_bounded(packed, content, path)
        if content.startswith(_COMPRESS):
            return bytes(hatanaka.decompress(content))
        if content.startswith(_ZIP):
            return _unzip(content, path)
    except RinexError:
        raise
    except _DAMAGES as error:
        raise RinexError(f"{path}: compressed file is damaged or incomplete: {error}") from None
    return content


def is_compressed(content: bytes) -> bool:
    """Return whether bytes are the start of a file that `decompress` unpacks."""
    return content.startswith((_GZIP, _BZIP2, _COMPRESS, _ZIP))


def is_hatanaka(content: bytes) -> bool:
    """Return whether (decompressed) bytes are a Compact RINEX file."""
    return b"COMPACT RINEX" in content[:80]


def is_rinex(content: bytes) -> bool:
    """Return whether (decompressed) bytes begin like a RINEX or Compact RINEX file."""
    first = content[:200].split(b"\n", 1)[0]
    return is_hatanaka(content) or first[_LABEL_COLUMN:].strip() == _VERSION_LABEL


def decompress_hatanaka(content: bytes, path: str | pathlib.Path) -> tuple[bytes, tuple[str, ...]]:
    """Restore an observation file from Compact RINEX (Hatanaka 2008).

    Returns
    -------
    content : bytes
        RINEX.
    remarks : tuple of str
        Warnings of the decompressor.

    Raises
    ------
    RinexError
        If the file is damaged or incomplete.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            restored = bytes(hatanaka.crx2rnx(content))
        except hatanaka.HatanakaException as error:
            reason = " ".join(str(error).split()) or "no reason given"
            raise RinexError(f"{path}: Compact RINEX is damaged or incomplete: {reason}") from None
    return restored, tuple(" ".join(str(warning.message).split()) for warning in caught)


def _unzip(content: bytes, path: str | pathlib.Path) -> bytes:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        names = archive.namelist()
        if len(names) != 1:
            raise RinexError(f"{path}: zip archive of {len(names)} files, one is required")
        with archive.open(names[0]) as packed:
            return _read_bounded(packed, content, path)


def _read_bounded(packed: _Readable, content: bytes, path: str | pathlib.Path) -> bytes:
    """Return what a compressed file holds, if it is not many times what observations expand to."""
    largest = _LARGEST_SMALL_CONTENT + _LARGEST_EXPANSION * len(content)
    restored = packed.read(largest + 1)
    if len(restored) > largest:
        raise RinexError(
            f"{path}: compressed file of {len(content)} bytes holds more than {largest}; "
            "that is no RINEX file"
        )
    return restored
