"""Integers in the bytes of logs, frames and recordings, for compiled loops."""

from __future__ import annotations

import numpy as np

from vtff_dynamics.compiled import compiled

__all__ = ["read_integer"]


@compiled
def read_integer(content, place, length):  # type: ignore[no-untyped-def]
    """Return the integer of some bytes, the lowest first; one of eight bytes may be negative.

    Parameters
    ----------
    content : ndarray of uint8, shape (n,)
    place : int
        Place of the first byte.
    length : int
        Number of bytes, 1 to 8.
    """
    number = np.int64(0)
    for byte in range(length):
        number |= np.int64(content[place + byte]) << (8 * byte)
    return number
