"""Compilation by `numba.njit` of loops that no array operation can express."""

import contextlib
import functools
import os
import pathlib
import pickle
import sys
from hashlib import sha256
from typing import Any

import numba
from numba.core import caching, compiler, serialize


def compiled(function: Any) -> Any:
    """Return a function that numba compiles, and keeps in NUMBA_CACHE_DIR or ~/.cache."""
    dispatcher = numba.njit(function)
    dispatcher._cache = _Files(function)
    return dispatcher


class _Files(caching.NullCache):  # that of numba returns damaged code, and code of old callees
    def __init__(self, function: Any) -> None:
        self._function = function

    def _path(self, types: Any, codegen: Any) -> pathlib.Path:
        base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or "~/.cache"
        name = f"{self._function.__module__}.{self._function.__qualname__}"
        key = f"{[(t, getattr(t, 'fields', 0)) for t in types]}{codegen.magic_tuple()}{sys.version}"
        return pathlib.Path(base, "vtff", name, sha256(key.encode()).hexdigest()).expanduser()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        target_context.refresh()
        with contextlib.suppress(OSError, RuntimeError):  # there is no file, or no home
            content = self._path(sig, target_context.codegen()).read_bytes()
            if content[:32] == sha256(content[32:] + _digest(self._function)).digest():
                return compiler.CompileResult._rebuild(target_context, *pickle.loads(content[32:]))

    def save_overload(self, sig: Any, data: Any) -> None:
        if data.library.has_dynamic_globals:  # addresses of this process
            return
        content = serialize.dumps(data._reduce())
        with contextlib.suppress(OSError, RuntimeError):  # nothing can be written
            path = self._path(sig, data.codegen)
            path.parent.mkdir(parents=True, exist_ok=True)
            part = path.with_suffix(f".{os.getpid()}")
            part.write_bytes(sha256(content + _digest(self._function)).digest() + content)
            part.replace(path)


@functools.cache
def _digest(function: Any) -> bytes:
    """Return a hash of numba and of a function's file, the constants and functions that it uses."""
    parts = [numba.__version__.encode(), pathlib.Path(function.__code__.co_filename).read_bytes()]
    for name in function.__code__.co_names:
        used = function.__globals__.get(name)
        parts.append(_digest(used.py_func) if hasattr(used, "py_func") else serialize.dumps(used))
        parts.append(f"{getattr(used, '__members__', '')}".encode())  # of an enumeration
    return sha256(b"".join(parts)).digest()
