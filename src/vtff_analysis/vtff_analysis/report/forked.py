"""Independent tasks on several processors, each in a copy of this process."""

from __future__ import annotations

import contextlib
import os
import pathlib
import pickle
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

__all__ = ["run_forked", "usable_processors"]

Result = TypeVar("Result")


def usable_processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1


def run_forked(tasks: Sequence[Callable[[], Result]], processes: int) -> list[Result]:
    """Run tasks, in copies of this process where that is possible; return their results in order.

    The copies share what was read before, so that only the results are copied. Each takes the next
    task when it is done with one; a copy whose parent is gone ends after its task.

    Parameters
    ----------
    tasks
        Functions without arguments. What they change in memory is lost; what they return must be
        picklable.
    processes
        Largest number of processes. With 1, and where another thread of this process could hold a
        lock in the moment of copying, the tasks run here, one after the other.

    Raises
    ------
    Exception
        The error of the first task that failed.
    OSError
        If a copy ended without its results, or no process or file can be made.
    """
    processes = min(processes, len(tasks))
    if processes < 2 or threading.active_count() > 1 or not hasattr(os, "fork"):
        return [task() for task in tasks]
    results: dict[int, tuple[Result | None, Exception | None]] = {}
    with tempfile.TemporaryDirectory(prefix="vtff_tasks_") as folder:
        files = [pathlib.Path(folder, str(number)) for number in range(processes)]
        _run_copies(tasks, files)
        for file in files:
            if not file.exists():
                raise OSError("a process that drew pictures ended without a result")
            results.update(pickle.loads(file.read_bytes()))
    for _, error in (results[number] for number in range(len(tasks))):
        if error is not None:
            raise error
    return [results[number][0] for number in range(len(tasks))]  # type: ignore[misc]


def _run_copies(tasks: Sequence[Callable[[], Result]], files: Sequence[pathlib.Path]) -> None:
    """Run tasks in one copy per file, which gets the results; return when all have ended."""
    # A number read from this pipe is a task taken. Without a writer, an empty pipe ends a copy.
    read, write = os.pipe()
    for number in range(len(tasks)):
        os.write(write, number.to_bytes(2, "little"))
    os.close(write)
    copies: list[int] = []
    try:
        with _interrupts_held():
            for file in files:
                copy = os.fork()
                if copy == 0:
                    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it is for the parent
                    _work(tasks, read, file)
                copies.append(copy)
        while copies:
            os.waitpid(copies[-1], 0)
            copies.pop()
    finally:
        os.close(read)
        for copy in copies:
            with contextlib.suppress(ProcessLookupError):
                os.kill(copy, signal.SIGKILL)
            os.waitpid(copy, 0)


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Let an interrupt wait until the end of the context.

    A mask of signals would not do: a thread of a library, which has no mask, takes the signal, and
    Python raises KeyboardInterrupt in whatever the main thread does next. In a function that Python
    calls after a fork that exception would be lost.
    """
    came = []
    handler = signal.signal(signal.SIGINT, lambda *arguments: came.append(arguments))
    try:
        yield
    finally:
        # A handler that was not set from Python is None, and cannot be set again.
        signal.signal(signal.SIGINT, signal.SIG_DFL if handler is None else handler)
        if came:
            signal.raise_signal(signal.SIGINT)


def _work(tasks: Sequence[Callable[[], Result]], read: int, file: pathlib.Path) -> None:
    """Do tasks until none is left, write their results, and end this copy."""
    exit_code = 1
    try:
        results: dict[int, tuple[Result | None, Exception | None]] = {}
        while taken := os.read(read, 2):
            number = int.from_bytes(taken, "little")
            try:
                results[number] = (tasks[number](), None)
            except Exception as error:  # whatever it is, it is raised in the parent
                results[number] = (None, error)
        partial = file.with_suffix(".partial")
        partial.write_bytes(pickle.dumps(results))
        partial.replace(file)
        exit_code = 0
    finally:
        os._exit(exit_code)
