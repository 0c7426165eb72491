"""Choice of the broadcast ephemeris of each satellite that is valid at a time."""

from __future__ import annotations

import bisect
from collections.abc import Iterable

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.constants import (
    EPHEMERIS_SOURCE_FNAV,
    EPHEMERIS_SOURCE_INAV,
    EPHEMERIS_SOURCE_LNAV,
    SYSTEM_GALILEO,
)
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.orbits.broadcast_orbit import EphemerisTable

__all__ = ["DEFAULT_SOURCES", "EphemerisStore", "stores_by_system", "validity_interval"]


def validity_interval(ephemeris: BroadcastEphemeris) -> tuple[GpsTime, GpsTime]:
    """Return the first time and the end of the validity of an ephemeris.

    The fit interval of GPS lies about `toe` (IS-GPS-200, 20.3.4.4), so that a set is in use from
    its start on, hours before its `toe`. That of Galileo begins at `toe`, which is not later than
    the transmission.
    """
    reference = ephemeris.time_of_ephemeris
    if ephemeris.system == SYSTEM_GALILEO:
        return reference, reference + ephemeris.fit_interval
    half = 0.5 * ephemeris.fit_interval
    return reference - half, reference + half


DEFAULT_SOURCES = (EPHEMERIS_SOURCE_LNAV, EPHEMERIS_SOURCE_INAV, EPHEMERIS_SOURCE_FNAV)
"""Messages that orbits and clocks are computed from, the preferred one of a satellite first."""


class EphemerisStore:
    """Ephemerides of many satellites and times; gives the table that is valid at a time.

    For each satellite the valid set with the newest `toe` is used; of several sets with
    the same `toe` the set received last, and of several received at once the last given. Sets of
    a message that stands later in `sources` are used where no other is valid.

    Parameters
    ----------
    ephemerides : iterable of BroadcastEphemeris
        GPS and Galileo.
    sources : tuple of int
        ``EPHEMERIS_SOURCE_*`` to use, the preferred one first; others are left out. Galileo files
        hold I/NAV and F/NAV, whose clocks refer to different pairs of signals.
    healthy_only : bool
        Leave out a satellite while the chosen set has health bits. The set of an unhealthy
        satellite does not make room for an older, healthy one.
    """

    def __init__(
        self,
        ephemerides: Iterable[BroadcastEphemeris],
        sources: tuple[int, ...] = DEFAULT_SOURCES,
        healthy_only: bool = True,
    ) -> None:
        self._healthy_only = healthy_only
        # With their validity (ns), which is asked for at every change of any satellite.
        self._sets: dict[tuple[int, int], list[tuple[int, int, BroadcastEphemeris]]] = {}
        changes: set[int] = set()
        for ephemeris in ephemerides:
            if ephemeris.source in sources:
                start, end = (time.nanoseconds for time in validity_interval(ephemeris))
                satellite = (ephemeris.system, ephemeris.prn)
                self._sets.setdefault(satellite, []).append((start, end, ephemeris))
                changes.update((start, end))
        for sets in self._sets.values():
            sets.sort(
                key=lambda entry: (
                    -sources.index(entry[2].source),
                    entry[2].time_of_ephemeris.nanoseconds,
                    entry[2].time.nanoseconds,
                )
            )
        self._changes = sorted(changes)
        self._interval: int | None = None
        self._table = EphemerisTable(())

    def __len__(self) -> int:
        """Return the number of sets."""
        return sum(len(sets) for sets in self._sets.values())

    def ephemeris(self, system: int, prn: int, time: GpsTime) -> BroadcastEphemeris | None:
        """Return the set of one satellite to be used at `time`, or None."""
        nanoseconds = time.nanoseconds
        for start, end, ephemeris in reversed(self._sets.get((system, prn), [])):
            if start <= nanoseconds < end:
                return None if self._healthy_only and ephemeris.health else ephemeris
        return None

    def table(self, time: GpsTime) -> EphemerisTable:
        """Return the ephemerides to be used at `time`, ordered by system and number.

        The table is the same object until the choice changes, so that repeated calls cost nothing.
        """
        interval = bisect.bisect_right(self._changes, time.nanoseconds)
        if interval != self._interval:
            chosen = (self.ephemeris(system, prn, time) for system, prn in sorted(self._sets))
            self._table = EphemerisTable([e for e in chosen if e is not None])
            self._interval = interval
        return self._table

    def next_change(self, time: GpsTime) -> GpsTime | None:
        """Return until when `table` gives the object of `time`; None if for ever."""
        interval = bisect.bisect_right(self._changes, time.nanoseconds)
        return GpsTime(self._changes[interval]) if interval < len(self._changes) else None


def stores_by_system(ephemerides: Iterable[BroadcastEphemeris]) -> dict[int, EphemerisStore]:
    """Return one store for each satellite system, in which unhealthy satellites stay.

    The ionosphere is measured with them too: an unhealthy satellite still broadcasts a valid
    orbit, and its signals pass the same ionosphere. Galileo changes its ephemerides every ten
    minutes; with separate stores these changes do not touch GPS.
    """
    listed = list(ephemerides)
    return {
        system: EphemerisStore([e for e in listed if e.system == system], healthy_only=False)
        for system in sorted({e.system for e in listed})
    }
