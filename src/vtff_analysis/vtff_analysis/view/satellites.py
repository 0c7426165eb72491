"""Positions of the GNSS satellites that a scene shows links to."""

from __future__ import annotations

from vtff_analysis.view.scene import Scene
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.signals import satellite_name

#: s between positions: a straight line between two positions misses the orbit of GPS by 250 m.
GRID_INTERVAL = 60

_GRID = GRID_INTERVAL * NANOSECONDS_PER_SECOND


class SatellitePositions:
    """Adds positions of satellites on whole minutes to a scene, from broadcast ephemerides.

    Parameters
    ----------
    scene
        Scene that gets the series ``satellite``.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._ephemerides: dict[tuple[int, int, float], BroadcastEphemeris] = {}
        self._store: EphemerisStore | None = None
        self._next: dict[tuple[int, int], int] = {}
        self._placed: set[tuple[int, int]] = set()

    def add_ephemeris(self, ephemeris: BroadcastEphemeris) -> None:
        """Take an ephemeris; both spacecraft may receive the same one."""
        reference = ephemeris.time_of_ephemeris - GpsTime.from_unix_nanoseconds(0)
        key = (ephemeris.system, ephemeris.prn, reference)
        if key not in self._ephemerides:
            self._ephemerides[key] = ephemeris
            self._store = None

    def need(self, system: int, prn: int, stamp: int) -> None:
        """Ask for the positions of a satellite from a minute before a time (ns since 1970) on."""
        self._next.setdefault((system, prn), (stamp // _GRID - 1) * _GRID)

    def extend(self) -> None:
        """Add the positions up to a minute after the end of the scene."""
        if not self._ephemerides:
            return
        if self._store is None:
            self._store = EphemerisStore(self._ephemerides.values(), healthy_only=False)
        duration = round(self._scene.duration * NANOSECONDS_PER_SECOND)
        end = self._scene.start + duration + 2 * _GRID
        pending = {satellite: first for satellite, first in self._next.items() if first < end}
        for stamp in range(min(pending.values(), default=end), end, _GRID):
            wanted = {satellite for satellite, first in pending.items() if first <= stamp}
            self._add_positions(wanted, stamp)
            # An ephemeris may still arrive: a satellite without one stays pending.
            for satellite in wanted & self._placed:
                self._next[satellite] = stamp + _GRID

    def _add_positions(self, wanted: set[tuple[int, int]], stamp: int) -> None:
        """Add the positions of satellites at one time (ns since 1970)."""
        assert self._store is not None
        time = GpsTime.from_unix_nanoseconds(stamp)
        table = self._store.table(time)
        if not len(table):
            return
        positions = table.states(time).position_itrf
        for row, satellite in enumerate(zip(table.system, table.prn, strict=True)):
            key = (int(satellite[0]), int(satellite[1]))
            if key in wanted:
                name = satellite_name(*key)
                self._scene.add("satellite", stamp, positions[row].tolist(), satellite=name)
                self._placed.add(key)
