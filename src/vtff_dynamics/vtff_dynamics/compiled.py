"""Compilation of inner loops that no array operation can express."""

from __future__ import annotations

import functools
import os
import types
from collections.abc import Callable
from typing import Any

from vtff_dynamics.machine_code import (
    argument_forms,
    build_machine_code,
    dispatching_function,
    load_machine_code,
    machine_code_path,
    source_fingerprint,
)

__all__ = ["compiled", "count_compiled_forms"]

_kernels: list[_Kernel] = []


def compiled(function: Callable[..., Any]) -> Any:
    """Return a function that is compiled by numba on its first call with arguments of some types.

    The machine code is kept in files beside the source or in the user's cache folder, or in
    NUMBA_CACHE_DIR; later processes load them without numba, whose import takes half a second of
    processor. Where there is no C compiler, no place for files, or arguments are neither numbers
    nor arrays of them, numba compiles in each process, or reads its own cache. The compiled loop
    works through samples in order of time, so that a call with one epoch (online) and a call with
    a whole file (offline) give the same numbers.
    """
    kernel = _Kernel(function)
    _kernels.append(kernel)

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        return kernel.call(*arguments)

    call.kernel = kernel  # type: ignore[attr-defined]
    return call


def count_compiled_forms() -> dict[str, int]:
    """Return for how many types of arguments each function is compiled in this process."""
    return {
        f"{kernel.function.__module__}.{kernel.function.__qualname__}": kernel.count_forms()
        for kernel in _kernels
        if kernel.count_forms()
    }


class _Kernel:
    """A compiled function: what is known of it, and the function that calls its machine code."""

    def __init__(self, function: Any) -> None:
        self.function: types.FunctionType = function
        self.call: Callable[..., Any] = self._call_unknown_form
        self._codes: dict[tuple[str, ...], Callable[..., Any]] = {}
        self._dispatchers: dict[bool, Any] = {}

    def count_forms(self) -> int:
        """Return for how many types of arguments this process has machine code."""
        return len(self._codes) + sum(
            len(getattr(dispatcher, "signatures", ())) for dispatcher in self._dispatchers.values()
        )

    def dispatcher(self, *, cache: bool) -> Any:
        """Return the function of numba that compiles this one for the types of each call.

        numba's cache looks at the file of a function only, not at the constants and functions that
        it imports.
        """
        if cache not in self._dispatchers:
            import numba

            function = self._function_calling(cache=cache)
            try:
                dispatcher: Any = numba.njit(cache=cache)(function)
            except RuntimeError:  # neither the source folder nor the home folder can be written
                dispatcher = numba.njit(function)
            self._dispatchers[cache] = dispatcher
        return self._dispatchers[cache]

    def _function_calling(self, *, cache: bool) -> types.FunctionType:
        """Return the function such that it calls functions of numba, where numba wants these."""
        source = self.function
        names = dict(source.__globals__)
        for name in source.__code__.co_names:
            kernel = getattr(names.get(name), "kernel", None)
            if isinstance(kernel, _Kernel):
                names[name] = kernel.dispatcher(cache=cache)
        copied = types.FunctionType(
            source.__code__, names, source.__name__, source.__defaults__, source.__closure__
        )
        functools.update_wrapper(copied, source)
        return copied

    def _call_unknown_form(self, *arguments: Any) -> Any:
        """Load or make the machine code for arguments of types that have not been met."""
        forms = argument_forms(arguments)
        code = None if forms is None else self._machine_code(forms, arguments)
        otherwise = self._call_unknown_form
        if forms is None or code is None:
            code = otherwise = self.dispatcher(cache=True)
        else:
            self._codes[forms] = code
        self.call = dispatching_function(self._codes, otherwise) if self._codes else otherwise
        return code(*arguments)

    def _machine_code(
        self, forms: tuple[str, ...], arguments: tuple[Any, ...]
    ) -> Callable[..., Any] | None:
        fingerprint = source_fingerprint(self.function, _function_of)
        is_interpreted = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")
        if fingerprint is None or is_interpreted:
            return None
        path = machine_code_path(self.function, fingerprint, forms)
        code = load_machine_code(path)
        if code is None and build_machine_code(
            self._function_calling(cache=False), arguments, path
        ):
            code = load_machine_code(path)
        return code


def _function_of(value: Any) -> types.FunctionType | None:
    """Return the function behind a compiled one."""
    kernel = getattr(value, "kernel", None)
    return kernel.function if isinstance(kernel, _Kernel) else None
