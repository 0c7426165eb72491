"""Receivers whose electron content is asked for: observation files and bags."""

from __future__ import annotations

import os
import pathlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from vtff_analysis.tec.errors import TecError
from vtff_analysis.tec.receiver_orbit import ReceiverOrbit, orbit_from_fixes
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.files.observation_files import open_observations
from vtff_gnss.fix import Fix
from vtff_gnss.observation_table import ObservationTable

if TYPE_CHECKING:
    from vtff_bag.file.reader import BagReader

__all__ = [
    "TecSource",
    "bag_receivers",
    "from_bag",
    "from_file",
    "is_bag",
]

# Topics with observations, the preferred one first.
_OBSERVATIONS = ("high_rate", "epoch")


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


def bag_receivers(path: pathlib.Path) -> list[str]:
    """Return the namespaces of the receivers of a bag, such as ``/chief``.

    Raises
    ------
    vtff_bag.file.errors.BagError
        If the bag cannot be read.
    TecError
        If it holds no observations.
    """
    # Imported here, because it needs rclpy, which files do not.
    from vtff_bag.file.reader import BagReader

    receivers = {
        topic.removesuffix(f"/gnss/{kind}")
        for topic in BagReader(path).topics
        for kind in _OBSERVATIONS
        if topic.endswith(f"/gnss/{kind}")
    }
    if not receivers:
        raise TecError(f"{path}: no topic NAME/gnss/high_rate or NAME/gnss/epoch in this bag")
    return sorted(receivers)


def from_bag(path: pathlib.Path, receiver: str, systems: str | None = None) -> TecSource:
    """Read a receiver of a bag: ``RECEIVER/gnss/high_rate``, else ``RECEIVER/gnss/epoch``.

    Only observations of `systems` are used, RINEX letters, of all systems if it is None.

    Raises
    ------
    vtff_bag.file.errors.BagError
        If the bag cannot be read.
    TecError
        If it holds no observations of this receiver.
    """
    # Imported here, because these need rclpy, which files do not.
    from vtff_analysis.recordings.observation_recording import recorded_observations
    from vtff_analysis.recordings.run_place import find_run
    from vtff_bag.file.reader import BagReader
    from vtff_node.conversions.gnss import ephemeris_from_message

    reader = BagReader(path)
    topics = [f"{receiver}/gnss/{kind}" for kind in _OBSERVATIONS]
    topic = next((topic for topic in topics if topic in reader.topics), None)
    if topic is None:
        raise TecError(f"{path}: neither {' nor '.join(topics)} in this bag")
    latched = f"{receiver}/gnss/ephemeris"
    messages = reader.messages(latched) if latched in reader.topics else []
    name = find_run(path).name
    return TecSource(
        description=f"{topic} of {name}",
        table=recorded_observations(reader, topic).select(systems),
        ephemerides=tuple({ephemeris_from_message(decoded.message): None for decoded in messages}),
        position_itrf=None,
        remarks=tuple(reader.notes),
        orbit=orbit_from_fixes(f"fixes of {receiver} in {name}", _recorded_fixes(reader, receiver)),
    )


def _recorded_fixes(reader: BagReader, receiver: str) -> list[Fix]:
    from vtff_node.conversions.gnss import fix_from_message

    topic = f"{receiver}/gnss/fix"
    if topic not in reader.topics:
        return []
    return [fix_from_message(decoded.message) for decoded in reader.messages(topic)]
