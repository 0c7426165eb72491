"""Compilation of inner loops that no array operation can express."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

__all__ = ["compiled"]


def compiled(function: Callable[..., Any]) -> Any:
    """Return a function that numba compiles on its first call.

    The result is cached on disk beside the source or in the home folder; where neither can be
    written, every process compiles again. The compiled loop works through samples in order of
    time, so that a call with one epoch (online) and a call with a whole file (offline) give the
    same numbers. numba itself, half a second of processor, is imported with the first call too.
    """
    found: list[Any] = []

    def find_dispatcher() -> Any:
        """Return the function of numba, and have its module and those that it calls refer to it."""
        if not found:
            found.append(_compile_lazily(function))
            names = function.__globals__
            for name in [*function.__code__.co_names, function.__name__]:
                find = getattr(names.get(name), "find_dispatcher", None)
                if find is not None:
                    names[name] = find()
        return found[0]

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        return find_dispatcher()(*arguments)

    call.find_dispatcher = find_dispatcher  # type: ignore[attr-defined]
    return call


def _compile_lazily(function: Callable[..., Any]) -> Any:
    import numba

    try:
        return numba.njit(cache=True)(function)
    except RuntimeError:  # neither the source folder nor the home folder can be written
        return numba.njit(function)
