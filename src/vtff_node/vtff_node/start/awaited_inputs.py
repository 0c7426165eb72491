"""Messages of a node about its inputs at the start: missing inputs, and when all are there."""

from __future__ import annotations

import time
from collections.abc import Callable

__all__ = ["AwaitedInputs"]

#: Wall time between two lines about what is still awaited, s.
REMINDER_INTERVAL = 5.0


class AwaitedInputs:
    """Says every few seconds what a node waits for, and once that it has everything.

    Parameters
    ----------
    awaited
        Returns one text for each input that is not there yet.
    say
        Prints a line.
    steady_clock
        Wall time in s.
    """

    def __init__(
        self,
        awaited: Callable[[], list[str]],
        say: Callable[[str], object],
        steady_clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._awaited = awaited
        self._say = say
        self._steady_clock = steady_clock
        self._next_reminder = steady_clock() + REMINDER_INTERVAL
        self.complete = False

    def look(self) -> None:
        """Look at the inputs and say what has to be said; free of cost once all are there."""
        if self.complete:
            return
        awaited = self._awaited()
        if not awaited:
            self.complete = True
            self._say("whole: all inputs are there")
        elif self._steady_clock() >= self._next_reminder:
            self._next_reminder = self._steady_clock() + REMINDER_INTERVAL
            self._say(f"waiting for {', '.join(awaited)}")
