"""Brings together what several sources have measured at one epoch; without ROS."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

__all__ = ["EpochJoin", "JoinedEpoch"]

_LARGEST_BACKLOG = 600


@dataclass(frozen=True)
class JoinedEpoch:
    """What the sources have measured at one epoch.

    Parameters
    ----------
    stamp_nanoseconds : int
        The epoch.
    measured : dict
        By source; a source that has nothing for this epoch is absent.
    """

    stamp_nanoseconds: int
    measured: dict[str, Any]


@dataclass
class _OpenEpoch:
    known_since: float
    measured: dict[str, Any] = field(default_factory=dict)


class EpochJoin:
    """Joins measurements by their stamps, in the order of time.

    An epoch is complete when every source has a measurement for it. A source that has already
    sent a later one, or has not sent any for `patience` seconds of wall time, is left out. With
    `waits_for_closing` the time counts only from the moment at which every source that is missing
    has said, by `close`, that it has sent everything up to the epoch: messages of two topics may
    overtake each other, and in lockstep nothing else can make an epoch incomplete.

    Parameters
    ----------
    sources : iterable of str
        Names of the sources, all of them expected at every epoch.
    patience : float
        s of wall time.
    waits_for_closing : bool
        See above.

    Attributes
    ----------
    late : int
        Measurements that came after their epoch was given away.
    incomplete : dict of str to int
        By source, epochs that it was missing from.
    """

    def __init__(
        self, sources: Iterable[str], patience: float, waits_for_closing: bool = False
    ) -> None:
        self._sources = tuple(sources)
        self._patience = patience
        self._waits_for_closing = waits_for_closing
        self._open: dict[int, _OpenEpoch] = {}
        self._newest = {name: -1 for name in self._sources}
        self._closed = {name: -1 for name in self._sources}
        self._closed_since = {name: 0.0 for name in self._sources}
        self._last_given = -1
        self.late = 0
        self.incomplete = {name: 0 for name in self._sources}

    def expect(self, stamp_nanoseconds: int, now: float) -> None:
        """Note that there is an epoch at this time, whether or not anything is measured."""
        if stamp_nanoseconds > self._last_given:
            self._open.setdefault(stamp_nanoseconds, _OpenEpoch(now))
            if len(self._open) > _LARGEST_BACKLOG:
                self._open.pop(min(self._open))

    def add(self, source: str, stamp_nanoseconds: int, measurement: Any, now: float) -> None:
        """Take a measurement; `now` is wall time in s.

        One that comes after its epoch was given away is counted and dropped.
        """
        self._newest[source] = max(self._newest[source], stamp_nanoseconds)
        if stamp_nanoseconds <= self._last_given:
            self.late += 1
            return
        self.expect(stamp_nanoseconds, now)
        self._open[stamp_nanoseconds].measured[source] = measurement

    def close(self, source: str, stamp_nanoseconds: int, now: float) -> None:
        """Note that a source has sent everything up to and including this time."""
        if source in self._closed and stamp_nanoseconds > self._closed[source]:
            self._closed[source] = stamp_nanoseconds
            self._closed_since[source] = now

    def restart(self) -> None:
        """Forget all epochs: time has jumped back."""
        self._open.clear()
        self._last_given = -1
        self._newest = {name: -1 for name in self._sources}
        self._closed = {name: -1 for name in self._sources}

    def take(self, now: float) -> JoinedEpoch | None:
        """Return the next epoch that is complete, or that nothing more is waited for."""
        if not self._open:
            return None
        stamp = min(self._open)
        epoch = self._open[stamp]
        missing = [name for name in self._sources if name not in epoch.measured]
        if any(self._is_awaited(name, stamp, epoch, now) for name in missing):
            return None
        del self._open[stamp]
        self._last_given = stamp
        for name in missing:
            self.incomplete[name] += 1
        return JoinedEpoch(stamp, epoch.measured)

    def _is_awaited(self, name: str, stamp: int, epoch: _OpenEpoch, now: float) -> bool:
        if self._newest[name] > stamp:
            return False
        since = epoch.known_since
        if self._waits_for_closing:
            if self._closed[name] < stamp:
                return True
            since = max(since, self._closed_since[name])
        return now - since < self._patience
