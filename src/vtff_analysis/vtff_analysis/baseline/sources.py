"""Observations and ephemerides of a baseline, from two observation files."""

from __future__ import annotations

import pathlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_analysis.baseline.usage import describe_usage
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.constants import SYSTEM_LETTERS
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.files.navigation_files import open_navigation
from vtff_gnss.files.observation_files import open_observations
from vtff_gnss.observation_table import ObservationTable
from vtff_gnss.orbits.precise_orbit import InterpolationError, PreciseOrbits
from vtff_gnss.signals import carrier_number_of_signal, signal_number
from vtff_nav.relative.common.measurements import DEFAULT_BANDS

__all__ = [
    "PAIRING_TOLERANCE",
    "BaselineError",
    "BaselineSources",
    "Thrust",
    "TrueBaseline",
    "from_files",
    "pair_times",
]

Position = tuple[float, float, float]
Progress = Callable[[str], None]

PAIRING_TOLERANCE = 0.02
"""s; largest difference of the time tags of two epochs that belong together. The filter moves each
receiver over it with its velocity."""

LOWEST_ORBIT = 100e3  # m


class BaselineError(ValueError):
    """A baseline cannot be computed from the files and options given; the message says why."""


@dataclass(frozen=True, eq=False)
class Thrust:
    """Thrust of the rover: s of duration, and m/s2 in the base's RTN axes at `start`, (3,)."""

    start: GpsTime
    duration: float
    acceleration_rtn: npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TrueBaseline:
    """True baselines: GPS times in ns, (n,), and rover less base in ITRF in m, (n, 3)."""

    time_nanoseconds: npt.NDArray[np.int64]
    baseline_itrf: npt.NDArray[np.float64]


@dataclass(frozen=True)
class BaselineSources:
    """Observations of two receivers and the ephemerides of the satellites.

    Parameters
    ----------
    rover_name, base_name : str
        File or topic and its format, for messages and plots.
    rover, base : ObservationTable
        Observations of the two receivers.
    ephemerides : tuple of BroadcastEphemeris
        Ephemerides of the satellites.
    position_base_itrf : tuple of 3 float or None
        Position in the file of the base, m.
    is_position_stated : bool
        Whether the position is that of a header; otherwise it is a mean of fixes.
    remarks : tuple of str
        Notes on what was unusual, one line each.
    thrust : tuple of Thrust
        Thrust of the rover in a bag, in the order of time.
    truth : TrueBaseline or None
        True baseline in a bag of a simulation.
    precise_orbits : PreciseOrbits or None
        Orbits of SP3 files, used in place of the ephemerides.
    usage : tuple of str
        Sentences on the signals that are used of each satellite system, and on those left out.
    """

    rover_name: str
    base_name: str
    rover: ObservationTable
    base: ObservationTable
    ephemerides: tuple[BroadcastEphemeris, ...]
    position_base_itrf: Position | None
    is_position_stated: bool
    remarks: tuple[str, ...]
    thrust: tuple[Thrust, ...] = ()
    truth: TrueBaseline | None = None
    precise_orbits: PreciseOrbits | None = None
    usage: tuple[str, ...] = ()

    @property
    def is_in_orbit(self) -> bool | None:
        """Whether the base is higher than 100 km; None where its position is not recorded."""
        if self.position_base_itrf is None:
            return None
        return bool(geodetic_from_itrf(self.position_base_itrf)[2] > LOWEST_ORBIT)

    def common_epochs(
        self, start: GpsTime | None = None, end: GpsTime | None = None
    ) -> list[tuple[int, int]]:
        """Return the indices in rover and base of the epochs of equal time, within limits.

        Time tags of receivers with clocks of their own differ; those that are closer than
        `PAIRING_TOLERANCE` and half an interval belong together. The filter refers the
        observations of each receiver to the time of the base.

        Raises
        ------
        BaselineError
            If there is no common epoch.
        """
        rover, base = pair_times(self.rover.time_nanoseconds, self.base.time_nanoseconds)
        times = self.base.time_nanoseconds[base]
        is_within = np.ones(len(times), dtype=bool)
        if start is not None:
            is_within &= times >= start.nanoseconds
        if end is not None:
            is_within &= times <= end.nanoseconds
        if not is_within.any():
            limits = "" if is_within.size == 0 else " within --start and --end"
            raise BaselineError(
                f"no common epochs{limits}: rover {_span_text(self.rover)}, "
                f"base {_span_text(self.base)}; epochs are common if their time tags differ by "
                f"less than {1e3 * PAIRING_TOLERANCE:.0f} ms"
            )
        return list(zip(rover[is_within].tolist(), base[is_within].tolist(), strict=True))


def pair_times(
    rover: npt.NDArray[np.int64], base: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the indices of the times of two receivers that belong together, both increasing.

    Parameters
    ----------
    rover, base : ndarray of int64, shape (n,), (m,)
        ns, increasing.
    """
    if not len(rover) or not len(base):
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    steps = [float(np.median(np.diff(times))) for times in (rover, base) if len(times) > 1]
    tolerance = min([PAIRING_TOLERANCE * NANOSECONDS_PER_SECOND, *(0.45 * step for step in steps)])
    after = np.clip(np.searchsorted(rover, base), 1, max(len(rover) - 1, 1))
    after = np.minimum(after, len(rover) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(rover[before] - base) <= np.abs(rover[after] - base), before, after)
    index = np.flatnonzero(np.abs(rover[nearest] - base) <= tolerance)
    # Two epochs of the base may be nearest to one of the rover where the base repeats itself.
    chosen, first = np.unique(nearest[index], return_index=True)
    return chosen, index[first]


def _without_unshared_signals(
    rover: ObservationTable, base: ObservationTable
) -> tuple[ObservationTable, ObservationTable]:
    """Return the tables without signals on carriers on which the receivers share another signal.

    Each receiver has its own preferred signal on a carrier. Equal signals are better than two
    that only share the carrier.
    """
    numbers = [_signal_numbers(table) for table in (rover, base)]
    shared = np.intersect1d(np.unique(numbers[0]), np.unique(numbers[1]))
    carriers = np.unique(carrier_number_of_signal(shared))
    kept = [
        np.isin(number, shared) | ~np.isin(carrier_number_of_signal(number), carriers)
        for number in numbers
    ]
    return rover.rows(kept[0]), base.rows(kept[1])


def _signal_numbers(table: ObservationTable) -> npt.NDArray[np.int64]:
    columns = table.columns
    return signal_number(columns["system"], columns["prn"], columns["band"], columns["attribute"])


def from_files(
    rover: pathlib.Path,
    base: pathlib.Path,
    navigation: Sequence[pathlib.Path] = (),
    bands: Mapping[int, tuple[int, ...]] = DEFAULT_BANDS,
    partial: bool = False,
    progress: Progress | None = None,
) -> BaselineSources:
    """Read two observation files and, if given, navigation files.

    Parameters
    ----------
    rover, base : pathlib.Path
        RINEX 2, 3 or 4 or NovAtel logs, compressed or not.
    navigation : sequence of pathlib.Path
        RINEX navigation files, NovAtel logs or SP3 files; ephemerides in the observation files are
        used too.
    bands : mapping of int to tuple of int
        RINEX frequency digits that are used of each system.
    partial : bool
        Whether a damaged RINEX file is used up to the damage.
    progress : callable, optional
        Called with the name of each file before it is read.

    Raises
    ------
    vtff_gnss.files.observation_files.ObservationFileError
        If a file is not an observation file or is damaged.
    BaselineError
        If there are no ephemerides.
    OSError
        If a file cannot be read.
    """
    files = []
    for path in (rover, base):
        if progress is not None:
            progress(path.name)
        files.append(open_observations(path, partial=partial))
    given = open_navigation(navigation, progress)
    given = given.with_ephemerides(e for file in files for e in file.ephemerides)
    if given.is_empty:
        raise BaselineError(
            f"no ephemerides: {rover.name} and {base.name} hold none, name a navigation file"
        )
    letters = "".join(SYSTEM_LETTERS[system] for system in sorted(bands))
    if not given.by_system(bands):
        raise BaselineError(f"no ephemerides of the systems {letters} in the files given")
    for file in files:
        given.require_coverage(file.table.time_nanoseconds, file.path.name)
    try:
        precise = given.precise_orbits and given.precise_orbits.with_clocks()
    except InterpolationError as error:
        raise BaselineError(str(error)) from None
    whole = _without_unshared_signals(files[0].table, files[1].table)
    tables = [table.select(systems=letters) for table in whole]
    for file, table in zip(files, tables, strict=True):
        if not len(table.columns["prn"]):
            raise BaselineError(f"{file.path}: no observations of systems {letters}")
    return BaselineSources(
        rover_name=f"{rover.name}, {files[0].format_name}",
        base_name=f"{base.name}, {files[1].format_name}",
        rover=tables[0],
        base=tables[1],
        ephemerides=tuple(e for e in given.ephemerides if e.system in bands),
        position_base_itrf=files[1].approximate_position,
        is_position_stated=files[1].format_name.startswith("RINEX"),
        remarks=(
            *(f"{f.path.name}: {remark}" for f in files for remark in f.remarks),
            *given.remarks,
        ),
        precise_orbits=precise,
        usage=describe_usage(*whole, given, bands),
    )


def _span_text(table: ObservationTable) -> str:
    if not len(table):
        return "without epochs"
    return f"{table.time(0)} to {table.time(len(table) - 1)}"
