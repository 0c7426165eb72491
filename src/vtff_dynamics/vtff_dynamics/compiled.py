"""Compilation of inner loops that no array operation can express."""

from __future__ import annotations

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
    return _Uncompiled(function)


class _Uncompiled:
    """Stands for a function of numba until the first call, which puts that in its place."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.__doc__, self.__name__ = function.__doc__, function.__name__
        self.__module__, self.__wrapped__ = function.__module__, function
        self._dispatcher: Any = None

    def __call__(self, *arguments: Any) -> Any:
        return self.dispatcher()(*arguments)

    def dispatcher(self) -> Any:
        """Return the function of numba, and have its module and those that it calls refer to it."""
        if self._dispatcher is None:
            function = self.__wrapped__
            self._dispatcher = _compile_lazily(function)
            names = function.__globals__
            for name in [*function.__code__.co_names, self.__name__]:
                item = names.get(name)
                if isinstance(item, _Uncompiled):
                    names[name] = item.dispatcher()
        return self._dispatcher


def _compile_lazily(function: Callable[..., Any]) -> Any:
    import numba

    try:
        return numba.njit(cache=True)(function)
    except RuntimeError:  # neither the source folder nor the home folder can be written
        return numba.njit(function)
