"""A timeline of attitude control: which mode from when on, and when the thruster fires."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from vtff_control.attitude.controller import MODES, ControlMode

__all__ = ["AttitudeTimeline", "Firing", "parse_timeline"]

_FIRE = "fire"


@dataclass(frozen=True)
class Firing:
    """A firing of the thruster: start, s since the start of the timeline, and duration, s."""

    start: float
    duration: float


@dataclass(frozen=True)
class AttitudeTimeline:
    """Modes and firings of a run by their times.

    Attributes
    ----------
    requests
        Time, s since the start, and mode, in the order of time; the first at 0.
    firings
        In the order of time.
    """

    requests: tuple[tuple[float, ControlMode], ...]
    firings: tuple[Firing, ...] = ()

    def mode_at(self, time: float) -> ControlMode:
        """Return the mode that is asked for at a time, s since the start."""
        mode = self.requests[0][1]
        for start, name in self.requests:
            if start <= time:
                mode = name
        return mode

    def firing_in(self, start: float, period: float) -> Firing | None:
        """Return the firing that begins in a period, s since the start; None without one."""
        for firing in self.firings:
            if start <= firing.start < start + period:
                return firing
        return None


def parse_timeline(entries: Iterable[str]) -> AttitudeTimeline:
    """Return the timeline of entries such as ``0 detumble``, ``7200 point``, ``9000 fire 3``.

    Raises
    ------
    ValueError
        If an entry has another form, or the timeline does not begin with a mode at 0; the message
        names the entry.
    """
    requests: list[tuple[float, ControlMode]] = []
    firings: list[Firing] = []
    for entry in entries:
        words = entry.split()
        try:
            time = float(words[0])
        except (IndexError, ValueError):
            time = math.nan
        if not 0.0 <= time < math.inf:
            raise ValueError(f"entry {entry!r}: a time of 0 s or more expected first")
        if len(words) == 2 and words[1] in MODES:
            requests += [(time, mode) for mode in MODES if mode == words[1]]
        elif len(words) == 3 and words[1] == _FIRE:
            firings.append(Firing(time, _duration(entry, words[2])))
        else:
            raise ValueError(
                f"entry {entry!r}: '<seconds> <mode>' with one of {', '.join(MODES)}, or "
                "'<seconds> fire <seconds>' expected"
            )
    requests.sort(key=lambda request: request[0])
    if not requests or requests[0][0] != 0.0:
        raise ValueError("a mode at 0 s expected, as '0 detumble'")
    return AttitudeTimeline(tuple(requests), tuple(sorted(firings, key=lambda item: item.start)))


def _duration(entry: str, text: str) -> float:
    try:
        duration = float(text)
    except ValueError:
        duration = math.nan
    if not 0.0 < duration < math.inf:
        raise ValueError(f"entry {entry!r}: a duration of more than 0 s expected; got {text!r}")
    return duration
