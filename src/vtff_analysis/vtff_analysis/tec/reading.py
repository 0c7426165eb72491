"""Observations that a process of their own reads, while this one prepares their use."""

from __future__ import annotations

import contextlib
import importlib
import multiprocessing
import multiprocessing.connection
import os
import pathlib
import signal
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from vtff_gnss.files.observation_files import ObservationFile

__all__ = ["begin_reading", "prepare_reading"]

_ObservationsOrError: TypeAlias = "ObservationFile | Exception"


class _Reader:
    """A process that imports what reading needs, and reads the file of which it is told."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("fork")
        self._connection, other_end = context.Pipe()
        self._process = context.Process(
            target=_serve, args=(self._connection, other_end), daemon=True
        )
        self._process.start()
        other_end.close()

    def begin(self, *arguments: Any) -> None:
        """Tell it what to read, in the arguments of `open_observations`."""
        with contextlib.suppress(BrokenPipeError):  # the process has been ended
            self._connection.send(arguments)

    def wait(self) -> _ObservationsOrError | None:
        """Return what it has read; None if it has been ended."""
        try:
            found: _ObservationsOrError | None = self._connection.recv()
        except (EOFError, ConnectionResetError):
            found = None
        self._process.join()
        return found

    def end(self) -> None:
        """End a process that was told nothing."""
        self._connection.close()
        self._process.join()


_prepared: _Reader | None = None


def prepare_reading() -> None:
    """Have a process import what `begin_reading` needs, for a file that will be named later.

    Does nothing where that has no process of its own. A prepared process that is told of no file
    ends with this one.
    """
    global _prepared  # noqa: PLW0603 - the process of this process
    if _prepared is None and _can_read_beside():
        _prepared = _Reader()


def begin_reading(
    path: pathlib.Path | None, systems: str | None = None, partial: bool = False
) -> Callable[[], ObservationFile] | None:
    """Begin to read an observation file; return what waits for it and tells its content.

    Parameters
    ----------
    path, systems, partial
        As in `vtff_gnss.files.observation_files.open_observations`, whose errors the returned
        function raises. A path of None ends a process that was prepared in vain.

    Returns
    -------
    callable or None
        None where it is not to be had: without a path, with one processor, and in a process with
        further threads, which a copy of it would lack.
    """
    global _prepared  # noqa: PLW0603 - as above
    reader, _prepared = _prepared, None
    if path is None:
        if reader is not None:
            reader.end()
        return None
    if reader is None:
        if not _can_read_beside():
            return None
        reader = _Reader()
    reader.begin(path, systems, partial)
    beside = reader

    def wait() -> ObservationFile:
        found = beside.wait()
        if found is None:
            return _open(path, systems, partial)
        if isinstance(found, Exception):
            raise found
        return found

    return wait


def _can_read_beside() -> bool:
    return _has_one_thread() and len(os.sched_getaffinity(0)) > 1


def _has_one_thread() -> bool:
    """Return whether this process has no thread but one, those of libraries included."""
    try:
        return len(os.listdir("/proc/self/task")) == 1
    except OSError:  # not Linux
        return False


def _serve(
    ours: multiprocessing.connection.Connection, connection: multiprocessing.connection.Connection
) -> None:
    """Read one file for the process at the other end of a connection."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends this process without a word
    ours.close()  # so that nobody reads, and sending fails, once the other process has ended
    with contextlib.suppress(Exception):  # raised again when a file is read
        importlib.import_module("vtff_gnss.files.observation_files")
    try:
        arguments = connection.recv()
    except EOFError:  # no file is to be read
        return
    try:
        found: _ObservationsOrError = _open(*arguments)
    except Exception as error:
        found = error
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):
        connection.send(found)


def _open(path: pathlib.Path, systems: str | None, partial: bool) -> ObservationFile:
    # Imported here, because the importing takes a while and may be done in the other process.
    from vtff_gnss.files.observation_files import open_observations

    return open_observations(path, systems, partial=partial)
