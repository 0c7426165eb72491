"""When a chaser of a cluster gathers with the others, and when it drifts."""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["MODES", "MemberTimeline"]

MODES = ("gather", "free_drift")
"""Climb the potential; look on without thrust."""


@dataclass(frozen=True)
class MemberTimeline:
    """Modes of a chaser over time; before the first entry it drifts.

    Attributes
    ----------
    times
        s after the first fix, ascending.
    modes
        Mode from each time on, some of `MODES`.
    """

    times: tuple[float, ...]
    modes: tuple[str, ...]

    @classmethod
    def read(cls, lines: Sequence[str]) -> MemberTimeline:
        """Return the timeline of texts such as ``600 gather``, in any order.

        Raises
        ------
        ValueError
            If a line has another form; the text names the line.
        """
        entries = []
        for line in lines:
            words = line.split()
            try:
                (time, mode), seconds = words, float(words[0])
            except (ValueError, IndexError) as error:
                text = "time and mode expected, such as '600 gather'"
                raise ValueError(f"timeline, '{line}': {text}") from error
            if not (math.isfinite(seconds) and seconds >= 0.0):
                raise ValueError(f"timeline, '{line}': time: 0 s or more expected, got {time}")
            if mode not in MODES:
                raise ValueError(
                    f"timeline, '{line}': mode: one of {', '.join(MODES)} expected, got '{mode}'"
                )
            entries.append((seconds, mode))
        entries.sort(key=lambda entry: entry[0])
        return cls(tuple(time for time, _ in entries), tuple(mode for _, mode in entries))

    def mode_at(self, time: float) -> str:
        """Return the mode at a time, s after the first fix."""
        index = bisect.bisect_right(self.times, time + 1e-6)
        return self.modes[index - 1] if index else "free_drift"
