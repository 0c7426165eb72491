"""When something happened to a step, in wall time, as nodes tell it on /diagnostics; no ROS.

The monotonic clock is one for all processes of a machine, so that the moments of two nodes can be
subtracted. Moments of another machine, or of another boot, have another key.
"""

from __future__ import annotations

import collections
import pathlib
import time

__all__ = ["COMMAND_SENT", "SECOND_RECEIVED", "StepMoments", "read_moments"]

#: Name of the value with the moments at which the last byte of a second had been read.
SECOND_RECEIVED = "seconds received"
#: Name of the value with the moments at which the command of a step was on the bus.
COMMAND_SENT = "commands sent"

#: Moments in one report. Reports and steps come once a second each, so that none is missed.
_NEWEST = 5
_BOOT_FILE = pathlib.Path("/proc/sys/kernel/random/boot_id")


class StepMoments:
    """The newest moments of one kind."""

    def __init__(self) -> None:
        self._moments: collections.deque[tuple[int, float]] = collections.deque(maxlen=_NEWEST)
        self._clock = _name_of_clock()

    def note(self, stamp: int, moment: float | None = None) -> None:
        """Note when it happened to a step.

        Parameters
        ----------
        stamp
            Stamp of the step, ns since 1970.
        moment
            ``time.monotonic()`` then; now if not given.
        """
        self._moments.append((stamp, time.monotonic() if moment is None else moment))

    def values(self, name: str) -> dict[str, str]:
        """Return the moments as a value of a status; none before the first."""
        if not self._moments:
            return {}
        moments = " ".join(f"{stamp}:{moment:.6f}" for stamp, moment in self._moments)
        return {name: f"{self._clock} {moments}"}


def read_moments(text: str) -> dict[tuple[str, int], float]:
    """Return the moments in a value, s of the clock, by name of the clock and stamp in ns.

    What is not of that form is left out.
    """
    clock, *entries = text.split() or [""]
    moments = {}
    for entry in entries:
        stamp, _, moment = entry.partition(":")
        try:
            moments[clock, int(stamp)] = float(moment)
        except ValueError:
            continue
    return moments


def _name_of_clock() -> str:
    """Return a text that all processes of this machine have in common until it is booted anew."""
    try:
        return _BOOT_FILE.read_text(encoding="ascii").strip().replace("-", "")[:12] or "clock"
    except OSError:
        return "clock"
