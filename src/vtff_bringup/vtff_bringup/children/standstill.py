"""Processes of a run that are stopped, and a run that goes on no more."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from vtff_bringup.children.processes import ManagedProcess

LOOK_INTERVAL = 1.0  # s of wall time between looks at the processes
LARGEST_STOP = 10.0  # s that a process may be stopped, as by SIGSTOP or a debugger
LARGEST_LIFELESSNESS = 10.0  # s without a sign of life from a process that gives them
LARGEST_GAP = 3.0  # s between two looks after which nothing is said of the time between them
LARGEST_SILENCE = 60.0  # s between two progress reports of the node that ends the run


class StandstillWatch:
    """Names the process that holds a run back without having ended.

    A node that waits for others fails by itself when their answers are late. This watch is for
    what no node can notice: that the node which paces the run is the one that stands still, or,
    in real time, the recorder, for which nobody waits.

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
        self._alive_at: dict[str, float] = {}
        self._ready: set[str] = set()
        self._looked_at = steady_clock()

    def take_progress(self) -> None:
        """Note that the node that ends the run has reported its progress."""
        self._progress_at = self._steady_clock()

    def take_sign_of_life(self, name: str, is_ready: bool) -> None:
        """Note that the process of this name goes on, and whether it does all that is needed."""
        self._alive_at[name] = self._steady_clock()
        if is_ready:
            self._ready.add(name)

    def was_ready(self, name: str) -> bool:
        """Return whether the process of this name has reported that it does what is needed."""
        return name in self._ready

    def silence(self, name: str) -> float:
        """Return the time since the last sign of life of a process in s; 0 if it never gave one."""
        now = self._steady_clock()
        return now - self._alive_at.get(name, now)

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
        if now - self._looked_at > LARGEST_GAP:  # the whole machine may have stood still
            self._alive_at = dict.fromkeys(self._alive_at, now)
        self._looked_at = now
        for process in processes:
            if not process.is_stopped:
                self._stopped_since.pop(process.process_id, None)
                if now - self._alive_at.get(process.name, now) > LARGEST_LIFELESSNESS:
                    return process, f"has shown no sign of life for {LARGEST_LIFELESSNESS:g} s"
                continue
            if process.name in self._alive_at:
                self._alive_at[process.name] = now
            if now - self._stopped_since.setdefault(process.process_id, now) > LARGEST_STOP:
                return process, f"has been stopped for {LARGEST_STOP:g} s"
        if ending is not None and self._progress_at is not None:
            if now - self._progress_at > LARGEST_SILENCE:
                return ending, f"has reported no progress for {LARGEST_SILENCE:g} s"
        return None
