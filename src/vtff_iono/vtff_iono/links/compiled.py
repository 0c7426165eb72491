"""How inner loops are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba

__all__ = ["compiled"]


def compiled(function: Callable[..., Any]) -> Any:
    """Compile on first use, and keep the result on disk where there is a place for it.

    Samples are worked through one after the other, in order of time. Online a call gets one epoch,
    offline a whole file; the loop and so the numbers are the same.
    """
    try:
        return numba.njit(cache=True)(function)
    except RuntimeError:  # neither the source folder nor a home folder can be written
        return numba.njit(function)
