"""Observations that a process of their own reads, while this one prepares their use."""

from __future__ import annotations

import contextlib
import multiprocessing
import multiprocessing.connection
import os
import pathlib
import signal
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vtff_gnss.files.observation_files import ObservationFile

__all__ = ["begin_reading"]


def begin_reading(
    path: pathlib.Path, systems: str | None = None, partial: bool = False
) -> Callable[[], ObservationFile] | None:
    """Begin to read an observation file; return what waits for it and tells its content.

    Parameters
    ----------
    path, systems, partial
        As in `vtff_gnss.files.observation_files.open_observations`, whose errors the returned
        function raises.

    Returns
    -------
    callable or None
        None where it is not to be had: with one processor, and in a process with further threads,
        which a copy of it would lack.
    """
    if not _has_one_thread() or len(os.sched_getaffinity(0)) < 2:
        return None
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    arguments = (receiver, sender, path, systems, partial)
    process = context.Process(target=_read, args=arguments, daemon=True)
    process.start()
    sender.close()

    def wait() -> ObservationFile:
        try:
            found: ObservationFile | Exception = receiver.recv()
        except EOFError:  # the process has been ended
            found = _open(path, systems, partial)
        process.join()
        if isinstance(found, Exception):
            raise found
        return found

    return wait


def _has_one_thread() -> bool:
    """Return whether this process has no thread but one, those of libraries included."""
    try:
        return len(os.listdir("/proc/self/task")) == 1
    except OSError:  # not Linux
        return False


def _read(
    receiver: multiprocessing.connection.Connection,
    sender: multiprocessing.connection.Connection,
    path: pathlib.Path,
    systems: str | None,
    partial: bool,
) -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends this process without a word
    receiver.close()  # so that nobody reads, and sending fails, once the other process has ended
    try:
        found: ObservationFile | Exception = _open(path, systems, partial)
    except Exception as error:
        found = error
    with contextlib.suppress(BrokenPipeError):
        sender.send(found)


def _open(path: pathlib.Path, systems: str | None, partial: bool) -> ObservationFile:
    # Imported here, because the importing takes a while and may be done in the other process.
    from vtff_gnss.files.observation_files import open_observations

    return open_observations(path, systems, partial=partial)
