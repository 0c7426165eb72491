"""Receivers whose electron content is asked for: observation files and bags."""

from __future__ import annotations

import math
import pathlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_gnss.constants import SYSTEM_GALILEO, SYSTEM_GPS
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.files.observation_files import open_observations
from vtff_gnss.observation_table import ObservationTable
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.signals import satellite_number
from vtff_nav.relative.common.measurements import MeasurementNoise, SignalReader, satellite_mask
from vtff_nav.relative.common.orbit_single_point import form_combinations, solve_single_point

__all__ = [
    "TecError",
    "TecSource",
    "bag_receivers",
    "from_bag",
    "from_file",
    "is_bag",
    "receiver_positions",
]

# Topics with observations, the preferred one first.
_OBSERVATIONS = ("high_rate", "epoch")
_BANDS = {SYSTEM_GPS: (1, 2), SYSTEM_GALILEO: (1, 5)}
_POINT_INTERVAL = 30.0  # s between positions from code
_ELEVATION_MASK = math.radians(5.0)
_FEWEST_POINTS = 4


class TecError(ValueError):
    """A file cannot be processed; the message names it and the reason."""


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
    """

    description: str
    table: ObservationTable
    ephemerides: tuple[BroadcastEphemeris, ...]
    position_itrf: tuple[float, float, float] | None
    remarks: tuple[str, ...]


def is_bag(path: pathlib.Path) -> bool:
    """Return whether a path is a bag: a folder or an ``.mcap`` file."""
    return path.is_dir() or path.suffix == ".mcap"


def from_file(path: pathlib.Path, partial: bool = False) -> TecSource:
    """Read an observation file of any kind that `open_observations` knows.

    Raises
    ------
    vtff_gnss.files.observation_files.ObservationFileError
        If the file is not an observation file or is damaged.
    OSError
        If the file cannot be read.
    TecError
        If no satellite has a second frequency.
    """
    file = open_observations(path, partial=partial)
    columns = file.table.columns
    bands = np.unique(np.stack((columns["system"], columns["band"])), axis=1)
    if bands.shape[1] == len(np.unique(bands[0])):
        raise TecError(f"{path}: no second frequency: TEC needs two bands of a satellite")
    return TecSource(
        description=f"{path.name}, {file.format_name}",
        table=file.table,
        ephemerides=file.ephemerides,
        position_itrf=file.approximate_position,
        remarks=file.remarks,
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


def from_bag(path: pathlib.Path, receiver: str) -> TecSource:
    """Read a receiver of a bag: ``RECEIVER/gnss/high_rate``, else ``RECEIVER/gnss/epoch``.

    Raises
    ------
    vtff_bag.file.errors.BagError
        If the bag cannot be read.
    TecError
        If it holds no observations of this receiver.
    """
    # Imported here, because these need rclpy, which files do not.
    from vtff_analysis.recordings.observation_recording import recorded_observations
    from vtff_bag.file.reader import BagReader
    from vtff_node.conversions.gnss import ephemeris_from_message

    reader = BagReader(path)
    topics = [f"{receiver}/gnss/{kind}" for kind in _OBSERVATIONS]
    topic = next((topic for topic in topics if topic in reader.topics), None)
    if topic is None:
        raise TecError(f"{path}: neither {' nor '.join(topics)} in this bag")
    latched = f"{receiver}/gnss/ephemeris"
    messages = reader.messages(latched) if latched in reader.topics else []
    return TecSource(
        description=f"{topic} of {path.name}",
        table=recorded_observations(reader, topic),
        ephemerides=tuple({ephemeris_from_message(decoded.message): None for decoded in messages}),
        position_itrf=None,
        remarks=tuple(reader.notes),
    )


def receiver_positions(
    table: ObservationTable, ephemerides: Sequence[BroadcastEphemeris]
) -> npt.NDArray[np.float64]:
    """Return the positions of a moving receiver at all epochs, ITRF, m, shape (m, 3).

    Positions from code every 30 s are joined by cubic splines. In orbit the noise of the codes,
    some metres, remains, which is negligible for elevations.

    Raises
    ------
    TecError
        If fewer than four epochs give a position.
    """
    store = EphemerisStore(ephemerides)
    reader = SignalReader(MeasurementNoise(), _BANDS)
    seconds = 1e-9 * (table.time_nanoseconds - table.time_nanoseconds[0])
    step = round(_POINT_INTERVAL * NANOSECONDS_PER_SECOND)
    chosen = np.flatnonzero(np.diff(table.time_nanoseconds // step, prepend=-1))
    times, positions = [], []
    for index in np.unique(np.append(chosen, len(table) - 1)).tolist():
        epoch = table.epoch(index)
        orbits = store.table(epoch.time)
        with_orbit = satellite_number(orbits.system, orbits.prn)
        signals = reader.read(epoch, satellite_mask(with_orbit))
        if len(signals) == 0:
            continue
        point = solve_single_point(
            form_combinations(signals, orbits), orbits, epoch.time, _ELEVATION_MASK, False
        )
        if point is not None:
            times.append(seconds[index])
            positions.append(point.position_itrf)
    if len(times) < _FEWEST_POINTS:
        raise TecError("the position of the receiver is not stated and cannot be computed")
    spline = CubicSpline(np.array(times), np.array(positions))
    inside = (seconds >= times[0] - _POINT_INTERVAL) & (seconds <= times[-1] + _POINT_INTERVAL)
    result: npt.NDArray[np.float64] = np.where(inside[:, np.newaxis], spline(seconds), np.nan)
    return result
