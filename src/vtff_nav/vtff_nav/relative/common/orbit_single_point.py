"""Position from the codes of one epoch, and the combinations that are free of the ionosphere."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.frames.frames import geodetic_from_itrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss import constants as c
from vtff_gnss.orbits.broadcast_orbit import EphemerisTable
from vtff_nav.relative.common.measurements import (
    SignalTable,
    code_group_delay,
    geometry,
    satellite_rows,
)

__all__ = ["Combinations", "SinglePoint", "combinations", "single_point", "troposphere_delay"]

_POINT_ITERATIONS = 12
_TOP_OF_TROPOSPHERE = 20e3


@dataclass(frozen=True, eq=False)
class Combinations:
    """Ionosphere-free measurements of one epoch, one row for each of n satellites.

    Parameters
    ----------
    satellite : ndarray of int64
        System and satellite as one number.
    band : ndarray of int64
        Frequency digit of the second carrier; 0 where the row is GRAPHIC.
    code, phase : ndarray
        m; for GRAPHIC `code` is the code itself, with the ionosphere, and `phase` the mean.
    code_sigma, phase_sigma : ndarray
        m.
    is_lock_lost : ndarray of bool
    range_rate : ndarray
        m/s.
    """

    satellite: npt.NDArray[np.int64]
    band: npt.NDArray[np.int64]
    code: FloatArray
    phase: FloatArray
    code_sigma: FloatArray
    phase_sigma: FloatArray
    is_lock_lost: npt.NDArray[np.bool_]
    range_rate: FloatArray

    def __len__(self) -> int:
        """Return the number of satellites."""
        return len(self.satellite)

    def taken(self, rows: npt.NDArray[np.intp] | npt.NDArray[np.bool_]) -> Combinations:
        """Return some rows."""
        return Combinations(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


def combinations(signals: SignalTable, table: EphemerisTable) -> Combinations:
    """Return the ionosphere-free combinations; all satellites must have an ephemeris."""
    known = satellite_rows(table)
    # Signals are ordered by satellite and band, and all satellites have an ephemeris.
    is_first = np.ones(len(signals), dtype=bool)
    is_first[1:] = signals.satellite[1:] != signals.satellite[:-1]
    first = np.flatnonzero(is_first)
    count = np.diff(np.append(first, len(signals)))
    satellites = signals.satellite[first]
    rows = np.searchsorted(known, satellites)
    # The first two of a satellite are its main carriers.
    second = first + (count > 1)
    f1, f2 = signals.frequency_hz[first] ** 2, signals.frequency_hz[second] ** 2
    is_dual = f1 != f2
    gap = np.where(is_dual, f1 - f2, 1.0)
    a1, a2 = np.where(is_dual, f1 / gap, 1.0), np.where(is_dual, -f2 / gap, 0.0)
    p1, p2 = (
        _corrected_code(signals, first, table, rows),
        _corrected_code(signals, second, table, rows),
    )
    l1, l2 = signals.carrier_range[first], signals.carrier_range[second]
    sc1, sc2 = signals.code_sigma[first], signals.code_sigma[second]
    sp1, sp2 = signals.phase_sigma[first], signals.phase_sigma[second]
    code, phase = a1 * p1 + a2 * p2, a1 * l1 + a2 * l2
    lost = (signals.flags & c.FLAG_LOCK_LOST) > 0
    return Combinations(
        satellite=satellites,
        band=np.where(is_dual, (signals.number[second] >> 8) & 255, 0),
        code=code,
        phase=np.where(is_dual, phase, 0.5 * (p1 + l1)),
        code_sigma=np.hypot(a1 * sc1, a2 * sc2),
        phase_sigma=np.where(is_dual, np.hypot(a1 * sp1, a2 * sp2), 0.5 * np.hypot(sc1, sp1)),
        is_lock_lost=lost[first] | lost[second],
        range_rate=signals.range_rate[first],
    )


def _corrected_code(
    signals: SignalTable,
    rows: npt.NDArray[np.intp],
    table: EphemerisTable,
    satellites: npt.NDArray[np.intp],
) -> FloatArray:
    """Return codes without the group delay that the message tells, m."""
    code = signals.pseudorange[rows]
    bands = (signals.number[rows] >> 8) & 255
    for band in set(bands.tolist()):
        chosen = bands == band
        code[chosen] -= code_group_delay(table, band)[satellites[chosen]]
    return code


@dataclass(frozen=True, eq=False)
class SinglePoint:
    """Position from the codes of one epoch.

    Parameters
    ----------
    time : GpsTime
        Time tag of the epoch.
    position_itrf, velocity_itrf : ndarray, shape (3,)
        At the true time of reception; the velocity from Doppler, NaN without.
    covariance : ndarray, shape (3, 3)
        Of the position, m2.
    velocity_sigma : float
        m/s, of each component.
    clock : float
        Receiver clock less GPS time, m.
    """

    time: GpsTime
    position_itrf: FloatArray
    velocity_itrf: FloatArray
    covariance: FloatArray
    velocity_sigma: float
    clock: float


def single_point(
    measured: Combinations,
    table: EphemerisTable,
    time: GpsTime,
    elevation_mask: float,
    has_troposphere: bool,
) -> SinglePoint | None:
    """Solve position and clocks by least squares from nothing; None if that is impossible."""
    systems = np.unique(measured.satellite >> 8)
    if len(measured) < 3 + len(systems):
        return None
    rows = np.searchsorted(satellite_rows(table), measured.satellite)
    directions = table.states(time).position_itrf[rows].sum(axis=0)
    position = 6.9e6 * directions / np.linalg.norm(directions)
    clocks = (measured.satellite[:, None] >> 8 == systems[None, :]).astype(float)
    clock, is_used = np.zeros(len(systems)), np.ones(len(measured), dtype=bool)
    for iteration in range(_POINT_ITERATIONS):
        states = np.zeros((2, 6))
        states[:, :3] = position
        # The clock of the first system stands for the time of reception.
        offset = np.full(2, -clock[0] / SPEED_OF_LIGHT)
        seen = geometry(table, time, offset, states, np.eye(3))
        if iteration > 5:
            is_used = seen.elevation[0, rows] > elevation_mask
            if np.count_nonzero(is_used) < 3 + len(systems):
                return None
        direction = seen.direction[0, rows]
        design = np.hstack((-direction, clocks)) / measured.code_sigma[:, None]
        predicted = seen.range[0, rows] - seen.clock[0, rows] + clocks @ clock
        if has_troposphere and iteration > 5:
            predicted = predicted + troposphere_delay(position, seen.elevation[0, rows])
        residual = (measured.code - predicted) / measured.code_sigma
        normal = design[is_used].T @ design[is_used]
        if np.linalg.cond(normal) > 1e10:
            return None
        change = np.linalg.solve(normal, design[is_used].T @ residual[is_used])
        position = position + change[:3]
        clock = clock + change[3:]
        if float(np.abs(change).max()) < 1e-3 and iteration > 6:
            break
    else:
        return None
    velocity, velocity_sigma = _doppler_velocity(
        measured.taken(is_used), direction[is_used], position, table, time
    )
    covariance = np.linalg.inv(normal)[:3, :3]
    return SinglePoint(time, position, velocity, covariance, velocity_sigma, float(clock[0]))


def _doppler_velocity(
    measured: Combinations,
    direction: FloatArray,
    position_itrf: FloatArray,
    table: EphemerisTable,
    time: GpsTime,
) -> tuple[FloatArray, float]:
    """Return the Earth-fixed velocity from Doppler and its sigma; NaN if there is too little."""
    has_rate = np.isfinite(measured.range_rate) & (measured.range_rate != 0.0)
    if np.count_nonzero(has_rate) < 5:
        return np.full(3, np.nan), math.nan
    rows = np.searchsorted(satellite_rows(table), measured.satellite[has_rate])
    velocity = np.zeros(3)
    for _ in range(3):
        states = np.tile(np.concatenate((position_itrf, velocity)), (2, 1))
        seen = geometry(table, time, np.zeros(2), states, np.eye(3))
        predicted = seen.range_rate[0, rows] - seen.clock_drift[0, rows]
        design = np.hstack((-direction[has_rate], np.ones((len(rows), 1))))
        residual = measured.range_rate[has_rate] - predicted
        change, *_ = np.linalg.lstsq(design, residual, rcond=None)
        velocity = velocity + change[:3]
    spread = float(np.sqrt(np.mean((residual - design @ change) ** 2)))
    return velocity, max(5.0 * spread, 0.5)


def troposphere_delay(position_itrf: FloatArray, elevation: FloatArray) -> FloatArray:
    """Return the delay of a standard atmosphere, m.

    Parameters
    ----------
    position_itrf : ndarray, shape (3,)
        Receiver, m.
    elevation : ndarray
        rad.

    Notes
    -----
    2.4 m at the zenith at sea level, falling with a scale height of 7.5 km; mapped with
    1.001 / sqrt(0.002001 + sin^2 E) (Black and Eisner 1984). Nothing above 20 km.
    """
    height = float(geodetic_from_itrf(position_itrf)[2])
    if not -1e3 < height < _TOP_OF_TROPOSPHERE:
        return np.zeros_like(elevation)
    zenith = 2.4 * math.exp(-height / 7500.0)
    return zenith * 1.001 / np.sqrt(0.002001 + np.sin(elevation) ** 2)
