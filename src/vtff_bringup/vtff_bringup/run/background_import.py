"""Imports what the report of a run needs while the run flies, which leaves a processor idle."""

from __future__ import annotations

import contextlib
import importlib
import threading

__all__ = ["BackgroundImport"]


class BackgroundImport:
    """An import of a module in a thread of its own.

    Parameters
    ----------
    module
        Full name of the module. An error of its import is left to whoever imports it next.

    Raises
    ------
    ImportError
        If brahe, which only a thread that lasts may load, cannot be imported.
    """

    def __init__(self, module: str) -> None:
        # The allocator of brahe (mimalloc 3.3) takes the thread that loads it for the main thread.
        # After the end of that thread, the next with its number dies of a segmentation fault
        # (github.com/microsoft/mimalloc/issues/1287). So brahe is loaded here, not by the import.
        importlib.import_module("brahe")
        self._module = module
        self._thread: threading.Thread | None = None

    def begin(self) -> None:
        """Begin to import; further calls do nothing."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._import, daemon=True)
            self._thread.start()

    def wait(self) -> None:
        """Wait for the end of an import that has begun."""
        if self._thread is not None:
            self._thread.join()

    def _import(self) -> None:
        with contextlib.suppress(Exception):
            importlib.import_module(self._module)
