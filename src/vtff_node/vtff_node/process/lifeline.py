"""Lifelines: the processes of a run end in order when the program that started them is gone.

The program that starts a run holds the write end of one pipe for each stage of the end: nodes,
recorders, helpers. A process watches the pipe of its own stage and keeps the pipes of the later
stages open. So a pipe comes to its end of file when the program is gone, whatever ended it, and
every process of the earlier stages with it: nodes end first, recorders after the last messages of
the nodes, emulators last. A process opens the pipes through ``/proc``, so that a program that
cannot pass descriptors on, such as ``ros2 launch``, can hold lifelines too.
"""

from __future__ import annotations

import contextlib
import enum
import faulthandler
import os
import signal
import sys
import threading

__all__ = ["LIFELINE_VARIABLE", "LOG_FILE_VARIABLE", "Lifelines", "Stage", "watch_lifeline"]

#: Lifelines of a process, ``<process id>:<watched descriptor>:<kept descriptors>``.
LIFELINE_VARIABLE = "VTFF_LIFELINE"
#: File that takes the output of a process whose reader is gone; without it the output is lost.
LOG_FILE_VARIABLE = "VTFF_LOG_FILE"

#: Time in which a process has to begin its orderly end after its lifeline broke, s.
END_PATIENCE = 20.0


class Stage(enum.IntEnum):
    """Order in which the processes of a run end."""

    NODES = 0
    RECORDERS = 1
    HELPERS = 2


class Lifelines:
    """The pipes of a run, held by the program that starts its processes."""

    def __init__(self) -> None:
        self._pipes = [os.pipe() for _ in Stage]

    def environment(self, stage: Stage) -> dict[str, str]:
        """Return the variable that ties a process of a stage to this program."""
        watched = self._pipes[stage][0]
        kept = ",".join(str(write) for _, write in self._pipes[stage + 1 :])
        return {LIFELINE_VARIABLE: f"{os.getpid()}:{watched}:{kept}"}

    def close(self) -> None:
        """Close the pipes; processes that still watch them end."""
        for read, write in self._pipes:
            os.close(read)
            os.close(write)
        self._pipes = []


def watch_lifeline() -> None:
    """Watch the lifeline of this process, if it has one, and send SIGTERM to itself when it breaks.

    The handler of SIGTERM has to be installed before. A process that does not end in time is
    ended with code 1 and a trace of its threads.
    """
    lifeline = os.environ.pop(LIFELINE_VARIABLE, "")
    if not lifeline:
        return
    holder, watched, kept = lifeline.split(":")
    folder = f"/proc/{holder}/fd"
    descriptor: int | None = None
    try:
        for number in filter(None, kept.split(",")):
            os.open(f"{folder}/{number}", os.O_WRONLY)
        descriptor = os.open(f"{folder}/{watched}", os.O_RDONLY)
    except (FileNotFoundError, ProcessLookupError):
        pass  # the holder is gone already
    except OSError as error:
        print(
            f"warning: {error.filename}: {error.strerror}: this process will not notice when "
            f"process {holder}, which started it, dies",
            file=sys.stderr,
        )
        return
    watcher = threading.Thread(
        target=_wait_for_end, args=(descriptor, holder), name="lifeline", daemon=True
    )
    watcher.start()


def _wait_for_end(descriptor: int | None, holder: str) -> None:
    while descriptor is not None and os.read(descriptor, 1):
        pass  # nobody writes into a lifeline
    _redirect_output()
    faulthandler.dump_traceback_later(END_PATIENCE, exit=True, file=2)
    os.write(2, f"process {holder}, which started this one, is gone: ending\n".encode())
    os.kill(os.getpid(), signal.SIGTERM)


def _redirect_output() -> None:
    """Send the output to the log file: its reader is gone with the program."""
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT
    output: int | None = None
    with contextlib.suppress(OSError):
        output = os.open(os.environ.get(LOG_FILE_VARIABLE, os.devnull), flags, 0o644)
    if output is None:
        output = os.open(os.devnull, os.O_WRONLY)
    os.dup2(output, 1)
    os.dup2(output, 2)
