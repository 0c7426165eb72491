"""Elevation, azimuth and direction of the observed satellites, from broadcast ephemerides."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.orbits.broadcast_orbit import EphemerisTable
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.line_of_sight import lines_of_sight

__all__ = ["SatelliteGeometry", "geometry_from_stores", "satellite_geometry"]

# Epochs that are computed together; bounds the memory.
_MOST_EPOCHS = 1000
# From so many epochs on it pays to leave out the satellites that are below the horizon.
_MANY_EPOCHS = 100
# Reference times are multiples of this, ns: whoever computes an epoch counts from the same time.
_REFERENCE_INTERVAL = 1000 * NANOSECONDS_PER_SECOND


@dataclass(frozen=True, eq=False)
class SatelliteGeometry:
    """Where observed satellites are seen; NaN for one without ephemeris.

    Parameters
    ----------
    elevation, azimuth : ndarray, shape (n,)
        rad; above the plane normal to the ellipsoid normal; from north through east.
    direction_itrf : ndarray, shape (n, 3)
        Unit vectors towards the satellites, in the Earth-fixed axes of reception.
    """

    elevation: FloatArray
    azimuth: FloatArray
    direction_itrf: FloatArray

    def part(self, start: int, end: int) -> SatelliteGeometry:
        """Return observations `start` to `end` (not included)."""
        return SatelliteGeometry(
            self.elevation[start:end], self.azimuth[start:end], self.direction_itrf[start:end]
        )


def satellite_geometry(
    store: EphemerisStore,
    time: npt.ArrayLike,
    system: npt.NDArray[np.uint8],
    prn: npt.NDArray[np.uint8],
    position_receiver_itrf: npt.ArrayLike,
) -> SatelliteGeometry:
    """Return where satellites are seen from a receiver at rest or in motion.

    Parameters
    ----------
    store : EphemerisStore
    time : array_like of int, shape (n,) or scalar
        GPS time of every observation, ns since 1980-01-06, not decreasing.
    system, prn : ndarray of uint8, shape (n,)
        Satellites.
    position_receiver_itrf : array_like, shape (3,) or (n, 3)
        m. A row of a satellite without position (NaN) gives NaN.
    """
    rows = len(system)
    time = np.broadcast_to(np.asarray(time, dtype=np.int64), (rows,))
    position = np.broadcast_to(np.asarray(position_receiver_itrf, dtype=float), (rows, 3))
    result = SatelliteGeometry(
        np.full(rows, np.nan), np.full(rows, np.nan), np.full((rows, 3), np.nan)
    )
    starts = np.flatnonzero(np.diff(time, prepend=time[:1] - 1)) if rows else np.zeros(0, int)
    ends = np.append(starts[1:], rows)
    for first, last, table in _epochs_of_tables(store, time[starts]):
        part = slice(starts[first], ends[last - 1])
        epoch_of_row = np.repeat(np.arange(last - first), ends[first:last] - starts[first:last])
        _fill(
            result,
            part,
            table,
            time[starts[first:last]],
            position[starts[first:last]],
            epoch_of_row,
            system[part].astype(np.int64) << 8 | prn[part],
        )
    return result


def _epochs_of_tables(
    store: EphemerisStore, time: npt.NDArray[np.int64]
) -> Iterator[tuple[int, int, EphemerisTable]]:
    """Yield first and last epoch (not included) that use the same ephemerides, and these.

    Epochs of one part have one reference time; how the epochs are cut makes no difference to the
    numbers.
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
    stores: Mapping[int, EphemerisStore],
    time: npt.NDArray[np.int64],
    system: npt.NDArray[np.uint8],
    prn: npt.NDArray[np.uint8],
    position_receiver_itrf: npt.ArrayLike,
) -> SatelliteGeometry:
    """Return the geometry of observations of several systems.

    Galileo changes its ephemerides every ten minutes; a store of its own spares GPS the changes.

    Parameters
    ----------
    stores : mapping of int to EphemerisStore
        By ``SYSTEM_*``; a system without one has no geometry.
    time, system, prn, position_receiver_itrf
        As in `satellite_geometry`.
    """
    position = np.broadcast_to(np.asarray(position_receiver_itrf, dtype=float), (len(prn), 3))
    result = SatelliteGeometry(
        np.full(len(prn), np.nan), np.full(len(prn), np.nan), np.full((len(prn), 3), np.nan)
    )
    for number, store in stores.items():
        rows = np.flatnonzero(system == number)
        if len(rows) and len(store):
            part = satellite_geometry(store, time[rows], system[rows], prn[rows], position[rows])
            result.elevation[rows] = part.elevation
            result.azimuth[rows] = part.azimuth
            result.direction_itrf[rows] = part.direction_itrf
    return result


def _fill(
    result: SatelliteGeometry,
    part: slice,
    table: EphemerisTable,
    time: npt.NDArray[np.int64],
    position: FloatArray,
    epoch_of_row: npt.NDArray[np.int64],
    satellite: npt.NDArray[np.int64],
) -> None:
    """Compute the rows of epochs that use the same ephemerides."""
    if len(table) == 0:
        return
    known = np.asarray(np.isfinite(position).all(axis=1))
    if len(time) >= _MANY_EPOCHS:
        seen_at_all = np.unique(satellite)
        table = EphemerisTable(
            [e for e in table.ephemerides if (e.system << 8 | e.prn) in seen_at_all]
        )
        if len(table) == 0:
            return
    reference = time[0] // _REFERENCE_INTERVAL * _REFERENCE_INTERVAL
    sight = lines_of_sight(
        table,
        GpsTime(int(reference)),
        1e-9 * (time - reference),
        np.where(known[:, np.newaxis], position, [[1e7, 0.0, 0.0]]),
        np.zeros(3),
    )
    names = np.asarray(table.system, dtype=np.int64) << 8 | np.asarray(table.prn, dtype=np.int64)
    order = np.argsort(names)
    place = np.minimum(np.searchsorted(names, satellite, sorter=order), len(names) - 1)
    column = order[place]
    seen = (names[column] == satellite) & known[epoch_of_row]
    row = np.flatnonzero(seen)
    index = (epoch_of_row[row], column[row])
    target = part.start + row
    result.elevation[target] = sight.elevation[index]
    result.azimuth[target] = sight.azimuth[index]
    result.direction_itrf[target] = sight.direction_itrf[index]
