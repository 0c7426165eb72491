"""When a chaser of a cluster gathers with the others, and when it drifts."""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass

from vtff_control.guidance.requests import RequestError, read_timed_lines

__all__ = ["MODES", "MemberTimeline"]

_FORM = "time and mode expected, such as '600 gather'"
MODES = ("gather", "orbits", "free_drift")
"""Climb the potential to a place at rest; to an orbit; look on without thrust."""


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
        RequestError
            If a line has another form; the text names the line.
        """
        entries = read_timed_lines(lines, _read_mode, _FORM)
        return cls(tuple(time for time, _ in entries), tuple(mode for _, mode in entries))

    def mode_at(self, time: float) -> str:
        """Return the mode at a time, s after the first fix."""
        index = bisect.bisect_right(self.times, time + 1e-6)
        return self.modes[index - 1] if index else "free_drift"


def _read_mode(words: list[str]) -> str:
    if len(words) > 1:
        raise RequestError(_FORM)
    if words[0] not in MODES:
        raise RequestError(f"mode: one of {', '.join(MODES)} expected, got '{words[0]}'")
    return words[0]
