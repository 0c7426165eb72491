"""Child processes of a run: started in their own group, logged, and always ended."""

from __future__ import annotations

import os
import pathlib
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Mapping, Sequence

#: Signals sent to a process that has to end, with the seconds each may take.
ESCALATION = ((signal.SIGINT, 10.0), (signal.SIGTERM, 5.0), (signal.SIGKILL, 5.0))

#: Lines of a child that the user should see at once.
NOTEWORTHY = ("[WARN]", "[ERROR]", "[FATAL]", "error:", "warning:", "Traceback")

TAIL_LINES = 15


class ManagedProcess:
    """One child process.

    Parameters
    ----------
    name
        Shown in messages and used for the log file.
    command
        Program and arguments.
    log_path
        Everything the child prints is kept there.
    environment
        Its complete environment.
    inherited_descriptors
        File descriptors the child keeps.
    on_line
        Called with ``(name, line, noteworthy)`` from a reader thread.
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
        self._tail: list[str] = []
        log_path.parent.mkdir(parents=True, exist_ok=True)
        self._process = subprocess.Popen(
            list(command),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=dict(environment),
            pass_fds=tuple(inherited_descriptors),
            start_new_session=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def exit_code(self) -> int | None:
        """Exit code, or None while it runs; negative for a signal."""
        return self._process.poll()

    @property
    def process_id(self) -> int:
        """Process id, which is also the id of its group."""
        return self._process.pid

    def tail(self) -> str:
        """Return the last lines the process printed."""
        return "\n".join(self._tail)

    def end(self) -> int:
        """Ask the process to end, more firmly each time; return its exit code."""
        for number, patience in ESCALATION:
            if self.exit_code is not None:
                break
            self._signal_group(number)
            deadline = time.monotonic() + patience
            while self.exit_code is None and time.monotonic() < deadline:
                time.sleep(0.01)
        # Children of the child that outlived it must not stay behind either.
        self._signal_group(signal.SIGKILL)
        self._reader.join(timeout=2.0)
        return self._process.wait()

    def _signal_group(self, number: signal.Signals) -> None:
        try:
            os.killpg(self._process.pid, number)
        except (ProcessLookupError, PermissionError):
            return

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self.log_path.open("w", encoding="utf-8") as log:
            for raw in self._process.stdout:
                line = raw.decode("utf-8", "replace").rstrip("\n")
                log.write(line + "\n")
                log.flush()
                self._tail = [*self._tail, line][-TAIL_LINES:]
                if self._on_line is not None:
                    noteworthy = any(word in line for word in NOTEWORTHY)
                    self._on_line(self.name, line, noteworthy)
