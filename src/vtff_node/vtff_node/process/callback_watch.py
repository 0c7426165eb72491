"""Names the node whose callback does not return: the other nodes of its process wait for it."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from types import FrameType
from typing import Any

__all__ = ["LARGEST_CALLBACK_TIME", "CallbackWatch", "describe_place"]

#: Time of one callback after which it is named, s. A first step compiles, which takes seconds.
LARGEST_CALLBACK_TIME = 20.0

#: Time between two looks, s.
LOOK_INTERVAL = 1.0

#: Time between two looks above which the whole process has stood still, s.
LARGEST_GAP = 3.0


class CallbackWatch:
    """Looks from a thread of its own whether the executor still comes round.

    Parameters
    ----------
    node_type
        Class whose methods are the callbacks; the node needs ``get_fully_qualified_name``.
    report
        Function that takes the line which names a callback; called once for each.
    steady_clock
        Wall time in s.
    """

    def __init__(
        self,
        node_type: type,
        report: Callable[[str], None],
        steady_clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._node_type = node_type
        self._report = report
        self._steady_clock = steady_clock
        self._came_round_at = self._looked_at = steady_clock()
        self._is_reported = False
        self._thread_id = threading.get_ident()
        self._ended = threading.Event()

    def start(self) -> None:
        """Watch the thread that made this object until `close`."""
        threading.Thread(target=self._watch, name="callback_watch", daemon=True).start()

    def come_round(self) -> None:
        """Note that the executor has come round: no callback is running."""
        self._came_round_at = self._steady_clock()
        self._is_reported = False

    def look(self) -> None:
        """Report the callback that runs if it has run for too long."""
        now = self._steady_clock()
        if now - self._looked_at > LARGEST_GAP:
            self._came_round_at = now
        self._looked_at = now
        duration = now - self._came_round_at
        if self._is_reported or duration < LARGEST_CALLBACK_TIME:
            return
        self._is_reported = True
        frame = sys._current_frames().get(self._thread_id)
        place = describe_place(frame, self._node_type)
        self._report(f"{place} has not returned for {duration:.0f} s")

    def close(self) -> None:
        """End the watch."""
        self._ended.set()

    def _watch(self) -> None:
        while not self._ended.wait(LOOK_INTERVAL):
            self.look()


def describe_place(frame: FrameType | None, node_type: type) -> str:
    """Return what a thread does: the node and its method, and the line where it stands.

    Parameters
    ----------
    frame
        Innermost frame of the thread; None if the thread has ended.
    node_type
        Class of the nodes.
    """
    if frame is None:
        return "a callback"
    place = f"{frame.f_code.co_filename}, line {frame.f_lineno}, in {frame.f_code.co_name}"
    while frame is not None:
        owner: Any = frame.f_locals.get("self")
        if isinstance(owner, node_type):
            name = owner.get_fully_qualified_name()  # type: ignore[attr-defined]
            return f"{frame.f_code.co_name} of {name} ({place})"
        frame = frame.f_back
    return f"a callback ({place})"
