"""Positions of the GNSS satellites that a scene shows links to."""

from __future__ import annotations

from vtff_analysis.view.scene import Scene
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.signals import satellite_name

#: s between positions: a straight line between them misses the orbit of GPS by 250 m.
GRID = 60
_NANOSECONDS = 1_000_000_000


class SatellitePositions:
    """Samples of satellites on whole minutes, from broadcast ephemerides.

    Parameters
    ----------
    scene
        Where the series ``satellite`` go.
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
        """Ask for a satellite from a time (ns since 1970) on, a minute around it included."""
        grid = GRID * _NANOSECONDS
        self._next.setdefault((system, prn), (stamp // grid - 1) * grid)

    def extend(self) -> None:
        """Add the positions up to a minute after the end of the scene."""
        if not self._ephemerides:
            return
        if self._store is None:
            self._store = EphemerisStore(self._ephemerides.values(), healthy_only=False)
        grid = GRID * _NANOSECONDS
        end = self._scene.start + round(self._scene.duration * _NANOSECONDS) + 2 * grid
        pending = {satellite: first for satellite, first in self._next.items() if first < end}
        for stamp in range(min(pending.values(), default=end), end, grid):
            wanted = {satellite for satellite, first in pending.items() if first <= stamp}
            self._place(wanted, stamp)
            # An ephemeris may still be on its way: what has had none is asked for again.
            for satellite in wanted & self._placed:
                self._next[satellite] = stamp + grid

    def _place(self, wanted: set[tuple[int, int]], stamp: int) -> None:
        """Add the positions at one time."""
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
