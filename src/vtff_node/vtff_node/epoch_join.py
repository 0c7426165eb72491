"""Joins the measurements that several sources have made at the same epoch; without ROS."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

__all__ = ["EpochJoin", "JoinedEpoch"]

_LARGEST_BACKLOG = 600


@dataclass(frozen=True)
class JoinedEpoch:
    """The measurements of all sources at one epoch.

    Parameters
    ----------
    stamp_nanoseconds : int
        Time of the epoch, ns since 1970.
    measured : dict
        Measurement by source; a source without a measurement at this epoch is absent.
    """

    stamp_nanoseconds: int
    measured: dict[str, Any]


@dataclass
class _OpenEpoch:
    opened_at: float
    measured: dict[str, Any] = field(default_factory=dict)


class EpochJoin:
    """Joins measurements by their stamps, in the order of time.

    An epoch is complete when every source has a measurement for it. A missing source is no longer
    awaited once it has sent a measurement of a later epoch, or once `patience` seconds of wall time
    have passed since the epoch was opened. With `waits_for_closing` the patience begins only when
    the missing source has been closed up to the epoch: messages of two topics may overtake each
    other, and in lockstep nothing else can make an epoch incomplete.

    Parameters
    ----------
    sources : iterable of str
        Names of the sources; each is expected at every epoch.
    patience : float
        Wall time for which a missing source is awaited, s.
    waits_for_closing : bool
        Whether the patience begins when the missing source is closed, see `close`.

    Attributes
    ----------
    late : int
        Number of measurements that came after their epoch had been taken.
    incomplete : dict of str to int
        By source, the number of epochs without its measurement.
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
        self._last_taken = -1
        self.late = 0
        self.incomplete = {name: 0 for name in self._sources}

    def expect(self, stamp_nanoseconds: int, now: float) -> None:
        """Open the epoch of this time, whether or not a source measures it."""
        if stamp_nanoseconds > self._last_taken:
            self._open.setdefault(stamp_nanoseconds, _OpenEpoch(now))
            if len(self._open) > _LARGEST_BACKLOG:
                self._open.pop(min(self._open))

    def add(self, source: str, stamp_nanoseconds: int, measurement: Any, now: float) -> None:
        """Add the measurement of a source; `now` is wall time in s.

        A measurement whose epoch has already been taken is counted as late and dropped.
        """
        self._newest[source] = max(self._newest[source], stamp_nanoseconds)
        if stamp_nanoseconds <= self._last_taken:
            self.late += 1
            return
        self.expect(stamp_nanoseconds, now)
        self._open[stamp_nanoseconds].measured[source] = measurement

    def close(self, source: str, stamp_nanoseconds: int, now: float) -> None:
        """Note that a source has sent all its measurements up to and including this time."""
        if source in self._closed and stamp_nanoseconds > self._closed[source]:
            self._closed[source] = stamp_nanoseconds
            self._closed_since[source] = now

    def restart(self) -> None:
        """Forget all epochs, as after a jump back in time."""
        self._open.clear()
        self._last_taken = -1
        self._newest = {name: -1 for name in self._sources}
        self._closed = {name: -1 for name in self._sources}

    def take(self, now: float) -> JoinedEpoch | None:
        """Return the oldest epoch once it is complete or its patience has run out; else None."""
        if not self._open:
            return None
        stamp = min(self._open)
        epoch = self._open[stamp]
        missing = [name for name in self._sources if name not in epoch.measured]
        if any(self._is_awaited(name, stamp, epoch, now) for name in missing):
            return None
        del self._open[stamp]
        self._last_taken = stamp
        for name in missing:
            self.incomplete[name] += 1
        return JoinedEpoch(stamp, epoch.measured)

    def _is_awaited(self, name: str, stamp: int, epoch: _OpenEpoch, now: float) -> bool:
        if self._newest[name] > stamp:
            return False
        since = epoch.opened_at
        if self._waits_for_closing:
            if self._closed[name] < stamp:
                return True
            since = max(since, self._closed_since[name])
        return now - since < self._patience
