"""Compilation by `numba.njit(cache=True)` of loops that no array operation can express.

numba alone runs old code after a change in a callee or in a constant of another module, and damage.
"""

import contextlib
import functools
import pathlib
import pickle
from hashlib import sha256
from typing import Any

import numba
from numba.core import caching, serialize


def compiled(function: Any) -> Any:
    """Return a function that numba compiles and keeps in NUMBA_CACHE_DIR or beside its source."""
    try:
        dispatcher: Any = numba.njit(cache=True)(function)
    except RuntimeError:  # no folder can be written
        return numba.njit(function)
    if dispatcher is not function:  # as it is with NUMBA_DISABLE_JIT
        dispatcher._cache._cache_file = _Files(dispatcher._cache, function)
    return dispatcher


class _Files(caching.IndexDataCacheFile):
    # Its stamp is a digest of all that is used, its keys name fields, its files have a checksum.
    def __init__(self, cache: Any, function: Any) -> None:
        super().__init__(cache.cache_path, cache._impl.filename_base, source_stamp=None)
        self._function = function

    def load(self, key: Any) -> Any:
        self._source_stamp = _digest(self._function)  # its module is complete now
        with contextlib.suppress(OSError):  # it is made again
            for path in pathlib.Path(self._cache_path).glob(self._index_name[:-3] + "*nb[ic]"):
                content = path.read_bytes().removeprefix(pickle.dumps(self._version, protocol=-1))
                if sha256(content[:-32]).digest() != content[-32:]:
                    path.unlink()
            data = super().load(f"{key} {[getattr(each, 'fields', 0) for each in key[0]]}")
            return data if data and str(data[3].args) == str(key[0]) else None  # two saved at once

    def save(self, key: Any, data: Any) -> None:
        with contextlib.suppress(OSError):  # such as a full disk
            super().save(f"{key} {[getattr(each, 'fields', 0) for each in key[0]]}", data)

    def _dump(self, content: Any) -> bytes:
        pickled = super()._dump(content)
        return bytes(pickled + sha256(pickled).digest())


@functools.cache
def _digest(function: Any) -> bytes:
    parts = [pathlib.Path(function.__code__.co_filename).read_bytes()]
    for name in function.__code__.co_names:
        used = function.__globals__.get(name)
        parts.append(_digest(used.py_func) if hasattr(used, "py_func") else serialize.dumps(used))
        parts.append(f"{getattr(used, '__members__', '')}".encode())  # of an enumeration
    return sha256(b"".join(parts)).digest()
