"""Elevation, azimuth and direction of the observed satellites, from broadcast ephemerides."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.orbits.line_of_sight import lines_of_sight
from vtff_gnss.orbits.satellite_table import SatelliteOrbits, SatelliteTable
from vtff_gnss.signals import satellite_number

__all__ = [
    "ELEVATION_MASK_DEG",
    "SatelliteGeometry",
    "geometry_from_stores",
    "satellite_geometry",
]

ELEVATION_MASK_DEG = 10.0
"""Default elevation mask of contents, density and vertical edges.

`ionosphere_processor` and `vtff tec` have it as a parameter. Edges of rays have limits of their own
(`vtff_iono.edges.ray_edges.RayEdgeSettings`).
"""

# Largest number of epochs that are computed together; it bounds the memory.
_MOST_EPOCHS = 1000
# From this number of epochs on it pays to leave out the satellites that are not observed.
_MANY_EPOCHS = 100
# Reference times are multiples of this interval, ns, so that an epoch has the same reference time
# whichever epochs are computed together with it.
_REFERENCE_INTERVAL = 1000 * NANOSECONDS_PER_SECOND
# Stands in for an unknown position, so that no computation fails; its results are not used.
_PLACEHOLDER_POSITION = (1e7, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class SatelliteGeometry:
    """Directions of observed satellites; NaN for a satellite without ephemeris.

    Parameters
    ----------
    elevation, azimuth : ndarray, shape (n,)
        Elevation above the plane normal to the ellipsoid normal, and azimuth from north through
        east, rad.
    direction_itrf : ndarray, shape (n, 3)
        Unit vectors towards the satellites, in the Earth-fixed axes of reception.
    range : ndarray, shape (n,)
        m; distance that the signals have travelled.
    velocity_satellite_itrf : ndarray, shape (n, 3)
        As seen from the Earth, in the axes of `direction_itrf`, m/s.
    """

    elevation: FloatArray
    azimuth: FloatArray
    direction_itrf: FloatArray
    range: FloatArray
    velocity_satellite_itrf: FloatArray

    @classmethod
    def unknown(cls, rows: int) -> SatelliteGeometry:
        """Return the geometry of satellites without ephemerides."""
        nothing = np.full((9, rows), np.nan)
        return cls(nothing[0], nothing[1], nothing[2:5].T, nothing[5], nothing[6:].T)


def satellite_geometry(
    store: SatelliteOrbits,
    time: npt.ArrayLike,
    system: npt.NDArray[np.uint8],
    prn: npt.NDArray[np.uint8],
    position_receiver_itrf: npt.ArrayLike,
) -> SatelliteGeometry:
    """Return the directions of satellites from a receiver at rest or in motion.

    Parameters
    ----------
    store : SatelliteOrbits
        Orbits of the satellites, broadcast or precise.
    time : array_like of int, shape (n,) or scalar
        GPS time of every observation, ns since 1980-01-06, not decreasing.
    system, prn : ndarray of uint8, shape (n,)
        Satellite of every observation.
    position_receiver_itrf : array_like, shape (3,) or (n, 3)
        Positions of the receiver, m; the result is NaN where the position is.
    """
    rows = len(system)
    time = np.broadcast_to(np.asarray(time, dtype=np.int64), (rows,))
    position = np.broadcast_to(np.asarray(position_receiver_itrf, dtype=float), (rows, 3))
    result = SatelliteGeometry.unknown(rows)
    satellite = satellite_number(system, prn)
    _fill_satellites(result, np.arange(rows), store, time, satellite, position)
    return result


def _epochs_of_tables(
    store: SatelliteOrbits, time: npt.NDArray[np.int64]
) -> Iterator[tuple[int, int, SatelliteTable]]:
    """Yield ranges of epochs that use the same ephemerides: first, last (not included), table.

    The epochs of a range have the same reference time. The numbers do not depend on how the epochs
    are divided into ranges.
    """
    reference = time // _REFERENCE_INTERVAL
    first = 0
    while first < len(time):
        last = min(first + _MOST_EPOCHS, int(np.searchsorted(reference, reference[first], "right")))
        start = GpsTime(int(time[first]))
        change = store.next_change(start)
        if change is not None:
            last = min(last, int(np.searchsorted(time, change.nanoseconds)))
        table = store.table(start)
        yield first, last, table
        first = last


def geometry_from_stores(
    stores: Mapping[int, SatelliteOrbits],
    time: npt.NDArray[np.int64],
    system: npt.NDArray[np.uint8],
    prn: npt.NDArray[np.uint8],
    position_receiver_itrf: npt.ArrayLike,
) -> SatelliteGeometry:
    """Return the geometry of observations of several systems.

    Galileo changes its ephemerides every ten minutes; with separate stores these changes do not
    divide the epochs of GPS.

    Parameters
    ----------
    stores : mapping of int to SatelliteOrbits
        Orbits by ``SYSTEM_*``; a system without a store has no geometry.
    time, system, prn, position_receiver_itrf
        As in `satellite_geometry`.
    """
    position = np.broadcast_to(np.asarray(position_receiver_itrf, dtype=float), (len(prn), 3))
    result = SatelliteGeometry.unknown(len(prn))
    satellite = satellite_number(system, prn)
    for number, store in stores.items():
        rows = np.flatnonzero(system == number)
        if len(store):
            _fill_satellites(result, rows, store, time[rows], satellite[rows], position)
    return result


def _fill_satellites(
    result: SatelliteGeometry,
    rows: npt.NDArray[np.intp],
    store: SatelliteOrbits,
    time: npt.NDArray[np.int64],
    satellite: npt.NDArray[np.int64],
    position: FloatArray,
) -> None:
    """Fill in some rows, whose satellites have their orbits in one store.

    `time` and `satellite` (a `satellite_number`) are those of these rows, `position` those of all
    rows of the result.
    """
    if not len(rows):
        return
    starts = np.flatnonzero(np.diff(time, prepend=time[0] - 1))
    ends = np.append(starts[1:], len(rows))
    time_of_epoch, position_of_epoch = time[starts], position[rows[starts]]
    for first, last, table in _epochs_of_tables(store, time_of_epoch):
        epochs = slice(first, last)
        rows_of_epochs = slice(starts[first], ends[last - 1])
        _fill_rows(
            result,
            rows[rows_of_epochs],
            table,
            time_of_epoch[epochs],
            position_of_epoch[epochs],
            np.repeat(np.arange(last - first), ends[epochs] - starts[epochs]),
            satellite[rows_of_epochs],
        )


def _fill_rows(
    result: SatelliteGeometry,
    rows: npt.NDArray[np.intp],
    table: SatelliteTable,
    time: npt.NDArray[np.int64],
    position: FloatArray,
    epoch_of_row: npt.NDArray[np.int64],
    satellite: npt.NDArray[np.int64],
) -> None:
    """Fill in the rows of epochs that use the same ephemerides.

    `rows` are those of the result, `time` and `position` those of the epochs, `epoch_of_row` and
    `satellite` (a `satellite_number`) those of the rows.
    """
    if len(table) == 0:
        return
    has_position = np.asarray(np.isfinite(position).all(axis=1))
    if len(time) >= _MANY_EPOCHS:
        numbers = satellite_number(table.system, table.prn)
        is_observed = np.zeros(int(max(numbers.max(), satellite.max())) + 1, dtype=bool)
        is_observed[satellite] = True
        table = table.select(np.flatnonzero(is_observed[numbers]))
        if len(table) == 0:
            return
    reference = time[0] // _REFERENCE_INTERVAL * _REFERENCE_INTERVAL
    sight = lines_of_sight(
        table,
        GpsTime(int(reference)),
        1e-9 * (time - reference),
        np.where(has_position[:, np.newaxis], position, _PLACEHOLDER_POSITION),
        np.zeros(3),
    )
    number_of_column = satellite_number(table.system, table.prn)
    column_of_satellite = np.full(int(max(number_of_column.max(), satellite.max())) + 1, -1)
    column_of_satellite[number_of_column] = np.arange(len(number_of_column))
    column = column_of_satellite[satellite]
    has_sight = (column >= 0) & has_position[epoch_of_row]
    taken = [
        (sight.elevation, result.elevation),
        (sight.azimuth, result.azimuth),
        (sight.range, result.range),
    ]
    for axis in range(3):
        taken.append((sight.direction_itrf[..., axis], result.direction_itrf[:, axis]))
        velocity = sight.velocity_satellite_itrf[..., axis]
        taken.append((velocity, result.velocity_satellite_itrf[:, axis]))
    chosen = np.flatnonzero(has_sight)
    for values, of_rows in taken:
        of_rows[rows[chosen]] = values[epoch_of_row[chosen], column[chosen]]
