"""Commands that come too late to act, as after a cut of the link to the controller."""

from __future__ import annotations

import time
from collections.abc import Callable

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND

__all__ = ["LateCommands"]

#: Rate at which the clock of this machine may run away from that of the stamps; quartz clocks
#: differ by a tenth of it.
LARGEST_DRIFT = 5e-4


class LateCommands:
    """Tells, in real time, whether the time of a command is over when it comes.

    What a link held back comes all at once when it is whole again. The age of a command is its
    delay beyond that of the quickest one: clocks need not agree, only run at about one rate.

    Parameters
    ----------
    longest_age
        Age in s from which a command is too late: the end of the step in which it would act.
    steady_clock
        Wall time in s.

    Attributes
    ----------
    refused
        Number of commands that were too late.
    """

    def __init__(
        self, longest_age: float, steady_clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._longest_age = longest_age
        self._steady_clock = steady_clock
        self._smallest_delay: float | None = None
        self._last_at = 0.0
        self.refused = 0

    def is_too_late(self, stamp_nanoseconds: int) -> bool:
        """Note a command with the time of its state, ns; return whether it is too late."""
        now = self._steady_clock()
        delay = now - stamp_nanoseconds / NANOSECONDS_PER_SECOND
        if self._smallest_delay is None:
            self._smallest_delay = delay
        else:
            drifted = self._smallest_delay + LARGEST_DRIFT * (now - self._last_at)
            self._smallest_delay = min(delay, drifted)
        self._last_at = now
        too_late = delay - self._smallest_delay > self._longest_age
        self.refused += too_late
        return too_late
