"""Receivers whose electron content is asked for, and those of observation files."""

from __future__ import annotations

import os
import pathlib
from dataclasses import dataclass

import numpy as np

from vtff_analysis.tec.errors import TecError
from vtff_analysis.tec.receiver_orbit import ReceiverOrbit, orbit_from_fixes
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.files.observation_files import open_observations
from vtff_gnss.observation_table import ObservationTable

__all__ = [
    "TecSource",
    "from_file",
    "is_bag",
]


@dataclass(frozen=True, eq=False)
class TecSource:
    """Observations of one receiver.

    Parameters
    ----------
    description : str
        Name and format of the source for messages and plots.
    table : ObservationTable
    ephemerides : tuple of BroadcastEphemeris
        Ephemerides that came with the observations.
    position_itrf : tuple of 3 float or None
        Position of a receiver at rest, m; None for a receiver that moves.
    remarks : tuple of str
        Notes for the user, one line each.
    orbit : ReceiverOrbit or None
        Track of a receiver that moves, from its own fixes.
    """

    description: str
    table: ObservationTable
    ephemerides: tuple[BroadcastEphemeris, ...]
    position_itrf: tuple[float, float, float] | None
    remarks: tuple[str, ...]
    orbit: ReceiverOrbit | None = None


def is_bag(path: pathlib.Path) -> bool:
    """Return whether a path is a bag: a folder or an ``.mcap`` file."""
    return os.path.isdir(path) or path.suffix == ".mcap"


def from_file(path: pathlib.Path, partial: bool = False, systems: str | None = None) -> TecSource:
    """Read an observation file of any kind that `open_observations` knows.

    Only observations of `systems` are read, RINEX letters, of all systems if it is None.

    Raises
    ------
    vtff_gnss.files.observation_files.ObservationFileError
        If the file is not an observation file or is damaged.
    OSError
        If the file cannot be read.
    TecError
        If no satellite has a second frequency.
    """
    file = open_observations(path, systems, partial=partial)
    columns = file.table.columns
    system_numbers = columns["system"].astype(np.int64)
    bands = np.unique(system_numbers << 8 | columns["band"])
    if len(bands) == len(np.unique(system_numbers)):
        raise TecError(f"{path}: no second frequency: TEC needs two bands of a satellite")
    return TecSource(
        description=f"{path.name}, {file.format_name}",
        table=file.table,
        ephemerides=file.ephemerides,
        position_itrf=file.approximate_position,
        remarks=file.remarks,
        orbit=orbit_from_fixes(f"fixes in {path.name}", file.fixes),
    )
