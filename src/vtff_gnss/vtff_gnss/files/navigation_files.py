"""Orbits of the satellites from all navigation files, receiver logs and SP3 files of a user."""

from __future__ import annotations

import dataclasses
import pathlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.constants import SYSTEM_LETTERS
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.files.observation_files import ObservationFileError, open_ephemerides
from vtff_gnss.orbits.ephemeris_selection import stores_by_system, validity_interval
from vtff_gnss.orbits.precise_orbit import InterpolationError, PreciseOrbits
from vtff_gnss.orbits.satellite_table import SatelliteOrbits
from vtff_gnss.orbits.sp3 import Sp3File, is_sp3, parse_sp3
from vtff_gnss.rinex.compressed_file import read_decompressed
from vtff_gnss.rinex.errors import RinexError

__all__ = ["NavigationFiles", "open_navigation"]


@dataclass(frozen=True, eq=False)
class NavigationFiles:
    """Orbits and clocks of satellites from files.

    Parameters
    ----------
    ephemerides : tuple of BroadcastEphemeris
        Ephemerides of all navigation files and receiver logs, without repetitions.
    precise_orbits : PreciseOrbits or None
        Orbits and clocks of all SP3 files.
    remarks : tuple of str
        Files that could not be used, and what SP3 files hold, one sentence each.
    names : tuple of str
        The files that are used.
    """

    ephemerides: tuple[BroadcastEphemeris, ...] = ()
    precise_orbits: PreciseOrbits | None = None
    remarks: tuple[str, ...] = ()
    names: tuple[str, ...] = ()

    def with_ephemerides(self, ephemerides: Iterable[BroadcastEphemeris]) -> NavigationFiles:
        """Return these orbits with further ephemerides, which come first."""
        joined = tuple(dict.fromkeys((*ephemerides, *self.ephemerides)))
        return dataclasses.replace(self, ephemerides=joined)

    @property
    def is_empty(self) -> bool:
        """Whether there is neither an ephemeris nor an SP3 file."""
        return not self.ephemerides and self.precise_orbits is None

    def by_system(self, systems: Iterable[int]) -> dict[int, SatelliteOrbits]:
        """Return the orbits of each system; precise ones where there are some.

        Satellites that are unhealthy are part of it. Systems without orbits are left out.
        """
        orbits: dict[int, SatelliteOrbits] = {**stores_by_system(self.ephemerides)}
        if self.precise_orbits is not None:
            orbits.update(dict.fromkeys(self.precise_orbits.systems, self.precise_orbits))
        return {system: orbits[system] for system in systems if system in orbits}

    def satellites(self, system: int) -> set[int]:
        """Return the numbers of the satellites of a system that have an orbit at some time."""
        numbers = {e.prn for e in self.ephemerides if e.system == system}
        precise = self.precise_orbits
        if precise is not None:
            numbers |= set(precise.prn[precise.system == system].tolist())
        return numbers

    def require_coverage(self, time_nanoseconds: npt.NDArray[np.int64], name: str) -> None:
        """Raise an error unless some orbit is valid at some time of observations.

        Parameters
        ----------
        time_nanoseconds : ndarray of int64, shape (n,)
            GPS times of the observations, increasing.
        name : str
            Their source, for the message.

        Raises
        ------
        ObservationFileError
            The message gives the times of both.
        """
        if not len(time_nanoseconds) or self.is_empty:
            return
        first, last = (GpsTime(int(time_nanoseconds[index])) for index in (0, -1))

        def spans() -> Iterator[tuple[GpsTime, GpsTime]]:
            if self.precise_orbits is not None:
                yield self.precise_orbits.start, self.precise_orbits.end
            yield from map(validity_interval, self.ephemerides)

        if any(start <= last and first <= end for start, end in spans()):
            return
        start, end = min(span[0] for span in spans()), max(span[1] for span in spans())
        origin = ", ".join(self.names) or "the ephemerides of the log"
        raise ObservationFileError(
            f"{origin}: valid from {_minute(start)} to {_minute(end)}, the observations "
            f"of {name} are of {_minute(first)} to {_minute(last)} GPS time"
        )

    def missing_systems(self, systems: Iterable[int]) -> list[str]:
        """Return the letters of the systems without orbits."""
        available = self.by_system(systems)
        return [SYSTEM_LETTERS[system] for system in systems if system not in available]


def open_navigation(
    paths: Sequence[pathlib.Path],
    progress: Callable[[str], None] | None = None,
    systems: str | None = None,
) -> NavigationFiles:
    """Read RINEX navigation files, receiver logs and SP3 files, told apart by their content.

    A file that cannot be used beside others that can is a remark.

    Parameters
    ----------
    paths : sequence of path
    progress : callable, optional
        Called with the name of each file before it is read.
    systems : str, optional
        RINEX letters of the systems whose broadcast ephemerides are read, by default all.

    Raises
    ------
    ObservationFileError
        If no file can be used; the message is that about the first.
    OSError
        If a file cannot be read.
    """
    ephemerides: list[BroadcastEphemeris] = []
    precise: list[Sp3File] = []
    failures: list[str] = []
    names: list[str] = []
    for path in paths:
        if progress is not None:
            progress(path.name)
        try:
            sp3 = _open_sp3(path)
            if sp3 is None:
                ephemerides += open_ephemerides(path, systems)
            else:
                precise.append(sp3)
            names.append(path.name)
        except ObservationFileError as error:
            failures.append(str(error))
    orbits = None
    if precise:
        try:
            orbits = PreciseOrbits(precise)
        except InterpolationError as error:
            failures.append(str(error))
    if failures and not ephemerides and orbits is None:
        raise ObservationFileError(failures[0])
    remarks = [f"not used: {failure}" for failure in failures]
    if orbits is not None:
        remarks.append(orbits.describe())
    unique = tuple(dict.fromkeys(ephemerides))
    return NavigationFiles(unique, orbits, tuple(remarks), tuple(names))


def _open_sp3(path: pathlib.Path) -> Sp3File | None:
    """Return the content of an SP3 file; None for a file of another kind."""
    try:
        content = read_decompressed(path)
        return parse_sp3(content, path) if is_sp3(content) else None
    except RinexError as error:
        raise ObservationFileError(str(error)) from None


def _minute(time: GpsTime) -> str:
    return time.isoformat()[:16].replace("T", " ")
