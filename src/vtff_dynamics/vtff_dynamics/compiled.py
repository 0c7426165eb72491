"""Compilation of inner loops that no array operation can express."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba

__all__ = ["compiled"]


def compiled(function: Callable[..., Any]) -> Any:
    """Return a function that numba compiles on its first call.

    The result is cached on disk beside the source or in the home folder; where neither can be
    written, every process compiles again. The compiled loop works through samples in order of
    time, so that a call with one epoch (online) and a call with a whole file (offline) give the
    same numbers.
    """
    try:
        return numba.njit(cache=True)(function)
    except RuntimeError:  # neither the source folder nor the home folder can be written
        return numba.njit(function)
