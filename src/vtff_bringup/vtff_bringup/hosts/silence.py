"""Silence of another host: noticed, ended, or too long."""

from __future__ import annotations

import time
from collections.abc import Callable

__all__ = ["HEARTBEAT_INTERVAL", "LARGEST_SILENCE", "LOOK_INTERVAL", "SilenceWatch"]

HEARTBEAT_INTERVAL = 1.0  # s between two signs of life
LOOK_INTERVAL = 0.25  # s between looks at the silence
NOTICED_SILENCE = 3.0  # s after which the console names the host
LARGEST_SILENCE = 15.0  # s after which the host is lost; DDS forgets a participant after 20 s


class SilenceWatch:
    """Watches when another host was heard.

    Parameters
    ----------
    host
        Its name and address, for messages.
    say
        Takes one line when the host falls silent, and one when it is heard again.
    steady_clock
        Wall time in s.
    """

    def __init__(
        self,
        host: str,
        say: Callable[[str], None],
        steady_clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._host = host
        self._say = say
        self._steady_clock = steady_clock
        self._heard_at = steady_clock()
        self._silent = False

    def note_heard(self) -> None:
        """Note a sign of life."""
        now = self._steady_clock()
        if self._silent:
            self._silent = False
            self._say(f"host {self._host} is heard again after {now - self._heard_at:.0f} s")
        self._heard_at = now

    def is_lost(self) -> bool:
        """Return whether the host has been silent for too long; say when it falls silent."""
        silence = self._steady_clock() - self._heard_at
        if silence > NOTICED_SILENCE and not self._silent:
            self._silent = True
            self._say(
                f"host {self._host} is silent; the run goes on without it for up to "
                f"{LARGEST_SILENCE:g} s"
            )
        return silence > LARGEST_SILENCE
