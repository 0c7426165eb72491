"""Checksum of NovAtel's frames within compiled loops, eight bytes at a time.

It is `vtff_gnss.novatel.framing.crc32_novatel` (reflected 0xEDB88320, start value 0, no inversion).

References
----------
Kounavis and Berry (2008), Novel table lookup-based algorithms for high-performance CRC generation,
IEEE Transactions on Computers 57(11) ("slicing by 8").
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled

__all__ = ["add_byte", "add_words"]

_POLYNOMIAL = 0xEDB88320


def _make_tables() -> npt.NDArray[np.uint32]:
    """Return the checksum of each byte that is followed by 0 to 7 zeros, shape (8, 256)."""
    tables = np.zeros((8, 256), dtype=np.int64)
    tables[0] = np.arange(256)
    for _ in range(8):
        tables[0] = (tables[0] >> 1) ^ np.where(tables[0] & 1, _POLYNOMIAL, 0)
    for zeros in range(1, 8):
        tables[zeros] = tables[0][tables[zeros - 1] & 255] ^ (tables[zeros - 1] >> 8)
    return tables.astype(np.uint32)


_TABLES = _make_tables()


@compiled
def add_words(checksum, first, second):  # type: ignore[no-untyped-def]
    """Return the checksum of a content with two more 32-bit words (int), lowest byte first."""
    low = checksum ^ first
    return (
        np.int64(_TABLES[7, low & 255])
        ^ np.int64(_TABLES[6, low >> 8 & 255])
        ^ np.int64(_TABLES[5, low >> 16 & 255])
        ^ np.int64(_TABLES[4, low >> 24])
        ^ np.int64(_TABLES[3, second & 255])
        ^ np.int64(_TABLES[2, second >> 8 & 255])
        ^ np.int64(_TABLES[1, second >> 16 & 255])
        ^ np.int64(_TABLES[0, second >> 24])
    )


@compiled
def add_byte(checksum, byte):  # type: ignore[no-untyped-def]
    """Return the checksum of a content with one more byte."""
    return np.int64(_TABLES[0, (checksum ^ byte) & 255]) ^ (checksum >> 8)
