"""Ionosphere-free combinations of one epoch, and the position of a receiver from their codes."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.orbits.satellite_table import SatelliteTable
from vtff_gnss.signals import satellite_number, satellite_number_of_signal, signal_from_number
from vtff_nav.relative.common.columns import make_table
from vtff_nav.relative.common.measurements import (
    SignalTable,
    code_group_delay,
    compute_geometry,
    satellite_numbers,
)
from vtff_nav.relative.kernels.combinations import combine_carriers

__all__ = [
    "Combinations",
    "SinglePoint",
    "form_combinations",
    "solve_single_point",
    "troposphere_delay",
    "troposphere_mapping",
]

_POINT_ITERATIONS = 12
# The first iterations only bring the position near the Earth: elevations mean nothing yet.
_ITERATIONS_WITHOUT_ELEVATION = 6
# From a position nearby one iteration finds the clock and the elevations.
_ITERATIONS_WITH_WIDE_MASK = 1
_FIRST_RADIUS = 6.9e6
_POINT_TOLERANCE = 1e-3
_LARGEST_POINT_CONDITION = 1e10
_FEWEST_DOPPLER_SATELLITES = 5
_SMALLEST_VELOCITY_SIGMA = 0.5
_TOP_OF_TROPOSPHERE = 20e3
_LAYOUTS_KEPT = 16


@dataclass(frozen=True, eq=False)
class Combinations:
    """Ionosphere-free measurements of one epoch, one row for each of n satellites.

    A satellite with two carriers has ionosphere-free combinations of code and phase. A satellite
    with one carrier has GRAPHIC, the mean of code and phase, as `phase`; its `code` is the code
    itself, which the ionosphere delays. All columns but `lock_time` have shape (n,).

    Parameters
    ----------
    satellite : ndarray of int64
        `vtff_gnss.signals.satellite_number`, increasing.
    system : ndarray of int64
        ``SYSTEM_*``.
    second_band : ndarray of int64
        RINEX frequency digit of the second carrier; 0 where the row is GRAPHIC.
    code, phase : ndarray
        m.
    code_sigma, phase_sigma : ndarray
        m.
    is_lock_lost : ndarray of bool
        Whether lock was lost on a carrier.
    half_cycles : ndarray of int64
        Carriers to whose phase the receiver has added half a cycle: bit 0 for the first carrier,
        bit 1 for the second.
    lock_time : ndarray, shape (n, 2)
        Lock time of both carriers, s.
    range_rate : ndarray
        Range rate from Doppler on the first carrier, m/s.
    """

    satellite: npt.NDArray[np.int64]
    system: npt.NDArray[np.int64]
    second_band: npt.NDArray[np.int64]
    code: FloatArray
    phase: FloatArray
    code_sigma: FloatArray
    phase_sigma: FloatArray
    is_lock_lost: npt.NDArray[np.bool_]
    half_cycles: npt.NDArray[np.int64]
    lock_time: FloatArray
    range_rate: FloatArray

    def __len__(self) -> int:
        """Return the number of satellites."""
        return len(self.satellite)

    def select(self, rows: npt.NDArray[np.intp] | npt.NDArray[np.bool_]) -> Combinations:
        """Return the combinations of some rows."""
        return Combinations(
            **{name: getattr(self, name)[rows] for name in self.__dataclass_fields__}
        )


def form_combinations(signals: SignalTable, table: SatelliteTable) -> Combinations:
    """Return the ionosphere-free combinations of the first two carriers of each satellite.

    Parameters
    ----------
    signals : SignalTable
    table : SatelliteTable
        All satellites of `signals` must be in it; their group delays are taken off the codes.
    """
    names = signals.signal.tobytes()
    carriers = _first_carriers(names, signals.frequency_hz.tobytes())
    first, second = carriers.first, carriers.second
    numbers, is_lost, half_cycles, lock_time = combine_carriers(
        first,
        second,
        carriers.is_dual,
        carriers.factor_first,
        carriers.factor_second,
        signals.pseudorange,
        _code_delays(table, names),
        signals.carrier_range,
        signals.code_sigma,
        signals.phase_sigma,
        signals.range_rate,
        signals.flags,
        signals.lock_time,
    )
    return make_table(
        Combinations,
        satellite=carriers.satellite,
        system=carriers.system,
        second_band=carriers.second_band,
        code=numbers[0],
        phase=numbers[1],
        code_sigma=numbers[2],
        phase_sigma=numbers[3],
        is_lock_lost=is_lost,
        half_cycles=half_cycles,
        lock_time=lock_time,
        range_rate=numbers[4],
    )


@dataclass(frozen=True, eq=False)
class _Carriers:
    """Rows of the first two carriers of each of n satellites, and the combination's factors.

    `system` and `second_band` are columns of `Combinations`. `second` is `first` and
    `factor_second` 0 where a satellite has one carrier.
    """

    satellite: npt.NDArray[np.int64]
    system: npt.NDArray[np.int64]
    second_band: npt.NDArray[np.int64]
    first: npt.NDArray[np.intp]
    second: npt.NDArray[np.intp]
    is_dual: npt.NDArray[np.bool_]
    factor_first: FloatArray
    factor_second: FloatArray


@functools.lru_cache(maxsize=_LAYOUTS_KEPT)
def _first_carriers(signal_bytes: bytes, frequency_bytes: bytes) -> _Carriers:
    """Return the carriers of a column of signals, which stays the same for minutes."""
    # Signals are in the order of satellites and bands.
    satellite = satellite_number_of_signal(np.frombuffer(signal_bytes, dtype=np.int64))
    frequency_hz = np.frombuffer(frequency_bytes)
    is_first = np.ones(len(satellite), dtype=bool)
    is_first[1:] = satellite[1:] != satellite[:-1]
    first = np.flatnonzero(is_first)
    second = first + (np.diff(np.append(first, len(satellite))) > 1)
    f1_squared, f2_squared = frequency_hz[first] ** 2, frequency_hz[second] ** 2
    is_dual = f1_squared != f2_squared
    difference = np.where(is_dual, f1_squared - f2_squared, 1.0)
    signals = [signal_from_number(n) for n in np.frombuffer(signal_bytes, dtype=np.int64).tolist()]
    system, band = (
        np.array([getattr(s, name) for s in signals], dtype=np.int64) for name in ("system", "band")
    )
    return _Carriers(
        satellite=satellite[first],
        system=system[first],
        second_band=np.where(is_dual, band[second], 0),
        first=first,
        second=second,
        is_dual=is_dual,
        factor_first=np.where(is_dual, f1_squared / difference, 1.0),
        factor_second=np.where(is_dual, -f2_squared / difference, 0.0),
    )


@functools.lru_cache(maxsize=_LAYOUTS_KEPT)
def _code_delays(table: SatelliteTable, signal_bytes: bytes) -> FloatArray:
    """Return the broadcast group delays of the codes of signals, m, shape (n,)."""
    signals = [signal_from_number(n) for n in np.frombuffer(signal_bytes, dtype=np.int64).tolist()]
    satellites = np.array([satellite_number(s.system, s.prn) for s in signals], dtype=np.int64)
    table_rows = np.searchsorted(satellite_numbers(table), satellites)
    bands = np.array([signal.band for signal in signals])
    delays = np.zeros(len(signals))
    for band in set(bands.tolist()):
        has_band = bands == band
        delays[has_band] = code_group_delay(table, band)[table_rows[has_band]]
    return delays


@dataclass(frozen=True, eq=False)
class SinglePoint:
    """Position of a receiver from the codes of one epoch.

    Parameters
    ----------
    time : GpsTime
        Time tag of the epoch.
    position_itrf, velocity_itrf : ndarray, shape (3,)
        State at the true time of reception, m and m/s; the velocity is NaN without Doppler.
    covariance : ndarray, shape (3, 3)
        Covariance of the position, m2.
    velocity_sigma : float
        Sigma of each component of the velocity, m/s.
    clock : float
        Receiver clock less GPS time, m.
    """

    time: GpsTime
    position_itrf: FloatArray
    velocity_itrf: FloatArray
    covariance: FloatArray
    velocity_sigma: float
    clock: float


def solve_single_point(
    measured: Combinations,
    table: SatelliteTable,
    time: GpsTime,
    elevation_mask: float,
    has_troposphere: bool,
    nearby_itrf: FloatArray | None = None,
) -> SinglePoint | None:
    """Solve position and one clock for each system by least squares.

    Parameters
    ----------
    measured : Combinations
    table : SatelliteTable
    time : GpsTime
        Time tag of the epoch.
    elevation_mask : float
        Satellites below are not used, rad.
    has_troposphere : bool
        Whether `troposphere_delay` is part of the model.
    nearby_itrf : ndarray, shape (3,), optional
        A position within some 1000 km, m, from which fewer iterations are needed.

    Returns
    -------
    SinglePoint or None
        None with too few satellites, a singular geometry or no convergence.
    """
    systems = np.unique(measured.system)
    fewest_satellites = 3 + len(systems)
    if len(measured) < fewest_satellites:
        return None
    rows = np.searchsorted(satellite_numbers(table), measured.satellite)
    if nearby_itrf is None:
        # Satellites in view are on the side of the Earth where the receiver is.
        sum_of_satellites = table.states(time).position_itrf[rows].sum(axis=0)
        position = _FIRST_RADIUS * sum_of_satellites / np.linalg.norm(sum_of_satellites)
        without_elevation = _ITERATIONS_WITHOUT_ELEVATION
    else:
        position, without_elevation = nearby_itrf, _ITERATIONS_WITH_WIDE_MASK
    is_of_system = (measured.system[:, None] == systems[None, :]).astype(float)
    clocks, is_used = np.zeros(len(systems)), np.ones(len(measured), dtype=bool)
    for iteration in range(_POINT_ITERATIONS):
        states = np.zeros((2, 6))
        states[:, :3] = position
        # The clock of the first system stands for the time of reception.
        offsets = np.full(2, -clocks[0] / SPEED_OF_LIGHT)
        geometry = compute_geometry(table, time, offsets, states, np.eye(3))
        elevation = geometry.elevation[0, rows]
        direction = geometry.direction[0, rows]
        design = np.hstack((-direction, is_of_system)) / measured.code_sigma[:, None]
        predicted = geometry.range[0, rows] - geometry.clock[0, rows] + is_of_system @ clocks
        if iteration >= without_elevation:
            is_used = elevation > elevation_mask
            if np.count_nonzero(is_used) < fewest_satellites:
                return None
            if has_troposphere:
                predicted = predicted + troposphere_delay(position, elevation)
        residual = (measured.code - predicted) / measured.code_sigma
        normal = design[is_used].T @ design[is_used]
        if np.linalg.cond(normal) > _LARGEST_POINT_CONDITION:
            return None
        change = np.linalg.solve(normal, design[is_used].T @ residual[is_used])
        position = position + change[:3]
        clocks = clocks + change[3:]
        is_converged = float(np.abs(change).max()) < _POINT_TOLERANCE
        if is_converged and iteration > without_elevation:
            break
    else:
        return None
    velocity, velocity_sigma = _solve_velocity(
        measured.select(is_used), direction[is_used], position, table, time
    )
    return SinglePoint(
        time=time,
        position_itrf=position,
        velocity_itrf=velocity,
        covariance=np.linalg.inv(normal)[:3, :3],
        velocity_sigma=velocity_sigma,
        clock=float(clocks[0]),
    )


def _solve_velocity(
    measured: Combinations,
    direction: FloatArray,
    position_itrf: FloatArray,
    table: SatelliteTable,
    time: GpsTime,
) -> tuple[FloatArray, float]:
    """Return the Earth-fixed velocity from Doppler and its sigma; NaN with too few satellites."""
    has_rate = np.isfinite(measured.range_rate) & (measured.range_rate != 0.0)
    if np.count_nonzero(has_rate) < _FEWEST_DOPPLER_SATELLITES:
        return np.full(3, np.nan), math.nan
    rows = np.searchsorted(satellite_numbers(table), measured.satellite[has_rate])
    velocity = np.zeros(3)
    for _ in range(3):
        states = np.tile(np.concatenate((position_itrf, velocity)), (2, 1))
        geometry = compute_geometry(table, time, np.zeros(2), states, np.eye(3))
        predicted = geometry.range_rate[0, rows] - geometry.clock_drift[0, rows]
        design = np.hstack((-direction[has_rate], np.ones((len(rows), 1))))
        residual = measured.range_rate[has_rate] - predicted
        change, *_ = np.linalg.lstsq(design, residual, rcond=None)
        velocity = velocity + change[:3]
    spread = float(np.sqrt(np.mean((residual - design @ change) ** 2)))
    return velocity, max(5.0 * spread, _SMALLEST_VELOCITY_SIGMA)


def troposphere_delay(position_itrf: FloatArray, elevation: FloatArray) -> FloatArray:
    """Return the delay of a standard atmosphere, m.

    Parameters
    ----------
    position_itrf : ndarray, shape (3,)
        Position of the receiver, m.
    elevation : ndarray, shape (n,)
        rad.

    Returns
    -------
    ndarray, shape (n,)

    Notes
    -----
    The delay is 2.4 m at the zenith at sea level and falls with a scale height of 7.5 km. It is
    mapped with `troposphere_mapping`. It is zero above 20 km.
    """
    height = float(geodetic_from_itrf(position_itrf)[2])
    if not -1e3 < height < _TOP_OF_TROPOSPHERE:
        return np.zeros_like(elevation)
    return 2.4 * math.exp(-height / 7500.0) * troposphere_mapping(elevation)


def troposphere_mapping(elevation: FloatArray) -> FloatArray:
    """Return slant over zenith delay at elevations (rad), shape (n,): Black and Eisner (1984)."""
    return np.asarray(1.001 / np.sqrt(0.002001 + np.sin(elevation) ** 2))
