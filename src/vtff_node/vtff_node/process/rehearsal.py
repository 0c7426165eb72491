"""The work of a step, done once more in vain shortly before the next step in real time.

A node works for some milliseconds once a second. Until the next step other work has taken its code
and data out of the processor's caches, and to fetch them again takes longer than the work. What has
been rehearsed is still there when the measurements come. Wall time decides only when that is done:
nobody uses the results.
"""

from __future__ import annotations

import time
from typing import Any

from rclpy.clock import Clock
from rclpy.node import Node

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND

__all__ = ["Rehearsal"]

#: How long before the next step a rehearsal begins, s of wall time: it must be over by then.
_LEAD = 0.015
#: Intervals of steps for which that is worth while, s: with a shorter one nothing gets cold.
_SHORTEST_INTERVAL = 0.2
_LONGEST_INTERVAL = 60.0
#: Processor time of a rehearsal that could delay a step, s, and how many of them there may be: the
#: first ones fetch everything.
_LONGEST_WORK = 0.02
_MOST_LONG_ONES = 3
#: Most calls that wait for a rehearsal; where more come, steps do not come regularly.
_MOST_CALLS = 1000


class Rehearsal:
    """Repeats the calls of an object's methods with a twin, shortly before the next step.

    Parameters
    ----------
    node : Node
        Whose executor calls the twin.
    steady_clock : Clock
    twin : object
        Made as the object whose calls are noted, and used for nothing else. It comes to the same
        states, a step later. After an exception, or some rehearsals that took too
        long, there are none.
    """

    def __init__(self, node: Node, steady_clock: Clock, twin: object) -> None:
        self._twin: object | None = twin
        self._calls: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []
        self._stamp = 0
        self._long_ones = 0
        self._timer = node.create_timer(1.0, self._rehearse, clock=steady_clock)
        self._timer.cancel()

    def note(self, method: str, *arguments: Any, **named: Any) -> None:
        """Note a call; the arguments must not change later."""
        if self._twin is not None:
            self._calls.append((method, arguments, named))
            if len(self._calls) > _MOST_CALLS:
                self._end()

    def expect_after(self, stamp: int, started: float) -> None:
        """Expect a step as long after another as that came after the one before it.

        Parameters
        ----------
        stamp
            Stamp of the other step, ns.
        started
            ``time.perf_counter()`` when its work began.
        """
        interval = (stamp - self._stamp) / NANOSECONDS_PER_SECOND
        self._stamp = stamp
        wait = started + interval - _LEAD - time.perf_counter()
        is_usual = _SHORTEST_INTERVAL <= interval <= _LONGEST_INTERVAL
        if self._twin is not None and is_usual and wait > 0.0:
            self._timer.timer_period_ns = round(wait * NANOSECONDS_PER_SECOND)
            self._timer.reset()

    def _rehearse(self) -> None:
        self._timer.cancel()
        calls, self._calls = self._calls, []
        began = time.thread_time()
        try:
            for method, arguments, named in calls:
                getattr(self._twin, method)(*arguments, **named)
        except Exception:  # the object itself has told its node of it
            self._end()
        self._long_ones += time.thread_time() - began > _LONGEST_WORK
        if self._long_ones > _MOST_LONG_ONES:
            self._end()

    def _end(self) -> None:
        self._twin = None
        self._calls = []
