"""Processes of a run that are stopped, and a run that goes on no more."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from vtff_bringup.run.processes import ManagedProcess

LOOK_INTERVAL = 1.0  # s of wall time between looks at the processes
LARGEST_STOP = 10.0  # s that a process may be stopped, as by SIGSTOP or a debugger
LARGEST_SILENCE = 60.0  # s between two progress reports of the node that ends the run


class StandstillWatch:
    """Names the process that holds a run back without having ended.

    A node that waits for others fails by itself when their answers are late. This watch is for
    what no node can notice: that the node which paces the run is the one that stands still.

    Parameters
    ----------
    steady_clock
        Wall time in s.
    """

    def __init__(self, steady_clock: Callable[[], float] = time.monotonic) -> None:
        self._steady_clock = steady_clock
        self._next_look = -float("inf")
        self._stopped_since: dict[int, float] = {}
        self._progress_at: float | None = None

    def take_progress(self) -> None:
        """Note that the node that ends the run has reported its progress."""
        self._progress_at = self._steady_clock()

    def find(
        self, processes: Sequence[ManagedProcess], ending: ManagedProcess | None
    ) -> tuple[ManagedProcess, str] | None:
        """Return a process that has stood still for too long, and what it did; None without one.

        Parameters
        ----------
        processes
            All processes of the run.
        ending
            The process of the node that ends the run and reports its progress, if there is one.
        """
        now = self._steady_clock()
        if now < self._next_look:
            return None
        self._next_look = now + LOOK_INTERVAL
        for process in processes:
            if not process.is_stopped:
                self._stopped_since.pop(process.process_id, None)
            elif now - self._stopped_since.setdefault(process.process_id, now) > LARGEST_STOP:
                return process, f"has been stopped for {LARGEST_STOP:g} s"
        if ending is not None and self._progress_at is not None:
            if now - self._progress_at > LARGEST_SILENCE:
                return ending, f"has reported no progress for {LARGEST_SILENCE:g} s"
        return None
