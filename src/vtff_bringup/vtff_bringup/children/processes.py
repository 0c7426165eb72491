"""Child processes of a run: started in their own group, logged, and always ended."""

from __future__ import annotations

import contextlib
import errno
import os
import pathlib
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TextIO

#: Signals sent to a process that has to end, with the time in s before the next one.
ESCALATION = ((signal.SIGINT, 20.0), (signal.SIGTERM, 10.0), (signal.SIGKILL, 5.0))

#: Words of the system when a file cannot grow.
FULL_DISK = tuple(os.strerror(number) for number in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG))

#: Words that mark a line of a child as noteworthy: the user sees it at once.
NOTEWORTHY = ("[WARN]", "[ERROR]", "[FATAL]", "error:", "warning:", "Traceback", *FULL_DISK)

TAIL_LINES = 15

#: Signals that a child starts with blocked; it unblocks them when its handlers are installed.
HELD_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class ManagedProcess:
    """One child process.

    It starts with `HELD_SIGNALS` blocked, so that a signal during its start waits for its
    handlers instead of interrupting the interpreter. The program has to unblock them; a program
    that does not is killed in the end.

    Parameters
    ----------
    name
        Name in messages.
    command
        Program and arguments.
    log_path
        File that gets everything the child prints.
    environment
        Its complete environment.
    inherited_descriptors
        File descriptors that stay open in the child.
    on_line
        Function that is called with ``(name, line, noteworthy)`` from a reader thread.

    Raises
    ------
    OSError
        If the program cannot be started.
    """

    def __init__(
        self,
        name: str,
        command: Sequence[str],
        log_path: pathlib.Path,
        environment: Mapping[str, str],
        inherited_descriptors: Sequence[int] = (),
        on_line: Callable[[str, str, bool], None] | None = None,
    ) -> None:
        self.name = name
        self.log_path = log_path
        self._on_line = on_line
        self._tail: list[tuple[str, bool]] = []
        log = self._open_log()
        with _hold_signals():
            self._process = subprocess.Popen(
                list(command),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                env=dict(environment),
                pass_fds=tuple(inherited_descriptors),
                start_new_session=True,
            )
        self._reader = threading.Thread(target=self._read, args=(log,), daemon=True)
        self._reader.start()

    @property
    def exit_code(self) -> int | None:
        """Exit code, or None while it runs; negative for a signal."""
        return self._process.poll()

    @property
    def process_id(self) -> int:
        """Process id, which is also the id of its group."""
        return self._process.pid

    @property
    def is_stopped(self) -> bool:
        """Whether the process is stopped, as by SIGSTOP; False where /proc does not tell."""
        try:
            status = pathlib.Path(f"/proc/{self._process.pid}/stat").read_text(encoding="utf-8")
        except OSError:
            return False
        return status.rpartition(")")[2].split()[0] in ("T", "t")

    def tail(self) -> list[str]:
        """Return what the process printed after its last noteworthy line, at most 15 lines."""
        lines: list[str] = []
        for line, noteworthy in self._tail:
            lines = [] if noteworthy else [*lines, line]
        return lines

    def end(self) -> int:
        """End the process, with a stronger signal each time; return its exit code."""
        return end_together([self])[0]

    def signal_group(self, number: signal.Signals) -> None:
        """Send a signal to the process and its children."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, number)

    def wait(self) -> int:
        """Wait for the end and for the last output; return the exit code."""
        self._reader.join(timeout=2.0)
        return self._process.wait()

    def _read(self, log: TextIO | None) -> None:
        assert self._process.stdout is not None
        in_traceback = False
        for raw in self._process.stdout:
            line = raw.decode("utf-8", "replace").rstrip("\n")
            log = self._write(log, line)
            noteworthy = in_traceback or any(word in line for word in NOTEWORTHY)
            # The first line of a traceback that is not indented is the error itself.
            in_traceback = "Traceback" in line or (in_traceback and line.startswith(" "))
            self._tail = [*self._tail, (line, noteworthy)][-TAIL_LINES:]
            self._show(line, noteworthy)
        if log is not None:
            self._write(log, None)

    def _show(self, line: str, noteworthy: bool) -> None:
        if self._on_line is not None:
            self._on_line(self.name, line, noteworthy)

    def _open_log(self) -> TextIO | None:
        try:
            self.log_path.parent.mkdir(parents=True, exist_ok=True)
            return self.log_path.open("w", encoding="utf-8")
        except OSError as error:
            self._show(_log_failure(self.log_path, error), True)
            return None

    def _write(self, log: TextIO | None, line: str | None) -> TextIO | None:
        """Write a line, or close the log at None; return the log, or None once it has failed.

        A full disk must not stop the reading: a child whose pipe is full stands still.
        """
        if log is None:
            return None
        try:
            if line is None:
                log.close()
                return None
            log.write(line + "\n")
            log.flush()
            return log
        except OSError as error:
            with contextlib.suppress(OSError):
                log.close()
            self._show(_log_failure(self.log_path, error), True)
            return None


def end_together(processes: Sequence[ManagedProcess]) -> list[int]:
    """End processes at the same time, with a stronger signal each time; return their exit codes.

    Parameters
    ----------
    processes
        The processes. Only the remaining children of processes that have ended already are killed.
    """
    for number, patience in ESCALATION:
        running = [process for process in processes if process.exit_code is None]
        for process in running:
            process.signal_group(number)
            # A process that is stopped takes the signal only when it goes on.
            process.signal_group(signal.SIGCONT)
        deadline = time.monotonic() + patience
        while time.monotonic() < deadline and any(p.exit_code is None for p in running):
            time.sleep(0.01)
    # A child may have ended before its own children: these are killed too.
    for process in processes:
        process.signal_group(signal.SIGKILL)
    return [process.wait() for process in processes]


@contextlib.contextmanager
def _hold_signals() -> Iterator[None]:
    """Block `HELD_SIGNALS` in this thread; a child that starts meanwhile inherits the block."""
    previous = signal.pthread_sigmask(signal.SIG_BLOCK, HELD_SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, previous)


def _log_failure(path: pathlib.Path, error: OSError) -> str:
    return f"warning: {path} is not written any more: {error.strerror}"
