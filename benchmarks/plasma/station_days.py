"""Station days of `bench_station_days.py`: receivers on the ground, drawn plasma and biases.

The plasma is a density in three dimensions and time, integrated along each ray, so that no thin
shell and no mapping function of the programs under test is in the truth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import RADIUS_EARTH_JGM3, SPEED_OF_LIGHT
from vtff_dynamics.frames.geodetic import itrf_from_geodetic
from vtff_dynamics.time.timescales import parse_epoch
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import (
    FLAG_CODE_VALID,
    FLAG_PARITY_KNOWN,
    FLAG_PHASE_VALID,
    FREQUENCY_L1,
    FREQUENCY_L2,
    SYSTEM_GPS,
)
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.observations import OBSERVATION_COLUMNS
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.line_of_sight import lines_of_sight
from vtff_gnss.orbits.nominal_constellation import nominal_gps_constellation

__all__ = ["DayTruth", "StationDay", "draw_station_day"]

STEP = 30.0
_STREAM = 118
_DAY = 86400.0
_SHORTEST_BLOCK = 7200.0  # s of one set of ephemerides
_LOWEST_ELEVATION = math.radians(8.0)
_DELAY_L1 = 40.308193e16 / FREQUENCY_L1**2  # m for each TECU
_SQUARED_RATIO = (FREQUENCY_L1 / FREQUENCY_L2) ** 2
# Altitudes of the integral along a ray, m: nodes of Gauss and Legendre between these bounds.
_BOUNDS = (80e3, 200e3, 300e3, 400e3, 600e3, 1000e3, 2000e3, 5000e3, 20000e3)
_NODES = 6
# Integrals of exp((1 - z - exp(-z)) / 2) above and below its maximum.
_PART_ABOVE = math.sqrt(2.0 * math.pi * math.e) * math.erf(math.sqrt(0.5))
_PART_BELOW = math.sqrt(2.0 * math.pi * math.e) * math.erfc(math.sqrt(0.5))
# Correlation time of multipath, and mean time between cycle slips of a satellite, s.
_MULTIPATH_TIME, _SLIP_INTERVAL = 300.0, 4.0 * 3600.0


@dataclass(frozen=True)
class DayTruth:
    """Parameters of the plasma of a day.

    Parameters
    ----------
    content_night, content_day : float
        Vertical content of the layer at night and, added to it, in the afternoon, TECU.
    gradient_north, gradient_east : float
        Relative change of the density for each radian to the north and to the east of the station.
    crests : float
        Relative height of the crests 15 deg north and south of the equator in the afternoon.
    wave : float
        Relative amplitude of travelling waves of 400 km and 40 min.
    peak_altitude, scale_bottom, scale_top : float
        Chapman layer, m.
    plasmasphere : float
        Vertical content of the plasmasphere at the equator, TECU; its scale height is 3000 km.
    """

    content_night: float
    content_day: float
    gradient_north: float
    gradient_east: float
    crests: float
    wave: float
    peak_altitude: float
    scale_bottom: float
    scale_top: float
    plasmasphere: float


@dataclass(frozen=True, eq=False)
class StationDay:
    """Observations of a day and their truth.

    Parameters
    ----------
    latitude_deg, longitude_deg : float
    truth : DayTruth
    position_itrf : ndarray, shape (3,)
        m.
    time : ndarray of int64, shape (n,)
        GPS time of every observation, ns.
    columns : dict of str to ndarray, shape (n,)
        As `vtff_iono.content.absolute_tec.absolute_tec` takes them.
    ephemerides : tuple of BroadcastEphemeris
    satellite_bias : dict of int to float
        Stated biases C1C - C2W, s, by satellite; they differ from the true ones by `bias_sigma`.
    bias_sigma : float
        s.
    receiver_bias : float
        True bias C1C - C2W, s.
    content_tecu : dict of tuple of int to float
        True slant content by time (ns) and satellite.
    """

    latitude_deg: float
    longitude_deg: float
    truth: DayTruth
    position_itrf: FloatArray
    time: npt.NDArray[np.int64]
    columns: dict[str, npt.NDArray[np.generic]]
    ephemerides: tuple[BroadcastEphemeris, ...]
    satellite_bias: dict[int, float]
    bias_sigma: float
    receiver_bias: float
    content_tecu: dict[tuple[int, int], float]


def _density(
    truth: DayTruth,
    station: tuple[float, float],
    latitude: FloatArray,
    longitude: FloatArray,
    altitude: FloatArray,
    time: FloatArray,
) -> FloatArray:
    """Return densities, TECU/m; the layer moves with the sun, its gradients with the station."""
    local = (time / _DAY * 2.0 * math.pi + longitude + math.pi) % (2.0 * math.pi)
    # The afternoon maximum of a layer is at 14 h of local time.
    day = np.maximum(np.cos(local - 14.0 / 24.0 * 2.0 * math.pi), 0.0) ** 1.5
    zenith = np.cos(latitude) ** 0.5
    crests = (
        truth.crests
        * day
        * sum(np.exp(-0.5 * ((np.degrees(latitude) - crest) / 6.0) ** 2) for crest in (-15.0, 15.0))
    )
    east = np.angle(np.exp(1j * (longitude - station[1])))
    linear = truth.gradient_north * (latitude - station[0]) + truth.gradient_east * east
    phase = RADIUS_EARTH_JGM3 * latitude / 400e3 - time / 2400.0
    wave = truth.wave * np.sin(2.0 * math.pi * phase)
    content = (truth.content_night + truth.content_day * day * zenith) * (1.0 + crests)
    content = content * np.maximum(1.0 + linear, 0.2) * (1.0 + wave)
    # The layer is 60 km higher in the afternoon.
    peak = truth.peak_altitude + 60e3 * day
    height = np.where(altitude < peak, truth.scale_bottom, truth.scale_top)
    argument = (altitude - peak) / height
    thickness = _PART_BELOW * truth.scale_bottom + _PART_ABOVE * truth.scale_top
    layer = content / thickness * np.exp(0.5 * (1.0 - argument - np.exp(-argument)))
    upper = truth.plasmasphere / 3000e3 * np.cos(latitude) ** 4
    return np.asarray(
        layer + np.where(altitude > 700e3, upper * np.exp(-(altitude - 700e3) / 3000e3), 0.0)
    )


def _slant_contents(
    truth: DayTruth,
    station: tuple[float, float],
    position_itrf: FloatArray,
    direction_itrf: FloatArray,
    time: FloatArray,
) -> FloatArray:
    """Return the contents of rays, TECU, shape (n,), on a sphere around the Earth's centre."""
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    radius = float(np.linalg.norm(position_itrf))
    upward = direction_itrf @ position_itrf / radius
    total = np.zeros(len(direction_itrf))
    for low, high in zip(_BOUNDS, _BOUNDS[1:], strict=False):
        for node, weight in zip(nodes, weights, strict=True):
            altitude = 0.5 * (low + high) + 0.5 * (high - low) * node
            shell = RADIUS_EARTH_JGM3 + altitude
            root = np.sqrt(shell**2 - radius**2 * (1.0 - upward**2))
            place = position_itrf + (root - radius * upward)[:, None] * direction_itrf
            latitude = np.arcsin(place[:, 2] / shell)
            longitude = np.arctan2(place[:, 1], place[:, 0])
            density = _density(
                truth, station, latitude, longitude, np.full(len(place), altitude), time
            )
            total += 0.5 * (high - low) * weight * density * shell / root
    return total


def draw_station_day(seed: int, plasmasphere: float = 0.0) -> StationDay:
    """Return a day of a receiver on the ground, everything drawn by seed.

    `plasmasphere` is the vertical content above the layer at the equator, TECU.
    """
    random = np.random.default_rng(np.random.SeedSequence((seed, _STREAM)))
    latitude, longitude = random.uniform(-60.0, 60.0), random.uniform(-180.0, 180.0)
    night = random.uniform(3.0, 12.0)
    truth = DayTruth(
        content_night=night,
        content_day=random.uniform(1.5, 6.0) * night,
        gradient_north=random.uniform(-1.0, 1.0),
        gradient_east=random.uniform(-1.0, 1.0),
        crests=random.uniform(0.2, 1.0),
        wave=random.uniform(0.0, 0.04),
        peak_altitude=random.uniform(270e3, 350e3),
        scale_bottom=random.uniform(25e3, 45e3),
        scale_top=random.uniform(45e3, 75e3),
        plasmasphere=plasmasphere,
    )
    geodetic = np.array([math.radians(latitude), math.radians(longitude), random.uniform(0, 1e3)])
    position = itrf_from_geodetic(geodetic)
    start = parse_epoch("2024-01-10T00:00:00 GPS") + _DAY * float(random.integers(0, 360))
    ephemerides = nominal_gps_constellation(start - 7200.0, start + _DAY + 7200.0, seed)
    store = EphemerisStore(ephemerides)
    satellites = store.table(start).prn.tolist()
    true_bias = dict(zip(satellites, random.normal(0.0, 4e-9, len(satellites)), strict=True))
    sigma = 0.1e-9
    stated = {prn: bias + random.normal(0.0, sigma) for prn, bias in true_bias.items()}
    receiver = float(random.normal(0.0, 10e-9))
    chunks = []
    for first in np.arange(0.0, _DAY, _SHORTEST_BLOCK):
        begin = start + float(first)
        table = store.table(begin)
        offset = np.arange(0.0, _SHORTEST_BLOCK, STEP)
        place = np.broadcast_to(position, (len(offset), 3))
        sight = lines_of_sight(table, begin, offset, place, np.zeros_like(place))
        epoch, column = np.nonzero(sight.elevation > _LOWEST_ELEVATION)
        chunks.append(
            (
                first + offset[epoch],
                np.asarray(table.prn)[column],
                sight.elevation[epoch, column],
                sight.range[epoch, column]
                - SPEED_OF_LIGHT * sight.clock_offset_satellite[epoch, column],
                sight.direction_itrf[epoch, column],
            )
        )
    seconds, prn, elevation, geometric, direction = (
        np.concatenate(c) for c in zip(*chunks, strict=True)
    )
    station = (geodetic[0], geodetic[1])
    content = _slant_contents(truth, station, position, direction, seconds)
    arc = _arcs(seconds, prn, random)
    multipath = random.uniform(0.1, 0.6)
    bias = np.array([true_bias[n] for n in prn.tolist()]) + receiver
    geometric = geometric + SPEED_OF_LIGHT * 1e-7 * np.sin(seconds / 3000.0)
    codes, phases = [], []
    for frequency, factor, of_bias in (
        (FREQUENCY_L1, 1.0, 1.0),
        (FREQUENCY_L2, _SQUARED_RATIO, 0.0),
    ):
        scatter = random.normal(0.0, 0.2, len(prn)) / (0.3 + np.sin(elevation))
        slow = multipath * _correlated(seconds, arc, random) * np.cos(elevation) ** 2
        delay = factor * _DELAY_L1 * content
        codes.append(geometric + delay + SPEED_OF_LIGHT * of_bias * bias + scatter + slow)
        slow_phase = 0.003 * _correlated(seconds, arc, random) * np.cos(elevation)
        whole = random.integers(-(10**6), 10**6, arc.max() + 1)[arc]
        noise = random.normal(0.0, 0.002, len(prn))
        wavelength = SPEED_OF_LIGHT / frequency
        phases.append((geometric - delay + noise + slow_phase) / wavelength + whole)
    order = np.lexsort((prn, seconds))
    return StationDay(
        latitude_deg=latitude,
        longitude_deg=longitude,
        truth=truth,
        position_itrf=position,
        time=np.repeat(start.nanoseconds + np.rint(seconds[order] * 1e9).astype(np.int64), 2),
        columns=_columns(
            prn[order],
            elevation[order],
            [code[order] for code in codes],
            [phase[order] for phase in phases],
        ),
        ephemerides=ephemerides,
        satellite_bias=stated,
        bias_sigma=sigma,
        receiver_bias=receiver,
        content_tecu={
            (start.nanoseconds + round(1e9 * s), int(n)): float(value)
            for s, n, value in zip(seconds.tolist(), prn.tolist(), content.tolist(), strict=True)
        },
    )


def _arcs(
    seconds: FloatArray, prn: npt.NDArray[np.integer], random: np.random.Generator
) -> npt.NDArray[np.int64]:
    """Return the number of the arc of each observation: passes, and drawn cycle slips."""
    arc = np.zeros(len(prn), dtype=np.int64)
    number = 0
    for satellite in np.unique(prn).tolist():
        rows = np.flatnonzero(prn == satellite)
        rows = rows[np.argsort(seconds[rows])]
        is_new = np.diff(seconds[rows], prepend=-_DAY) > 1.5 * STEP
        is_new |= random.random(len(rows)) < STEP / _SLIP_INTERVAL
        arc[rows] = number + np.cumsum(is_new)
        number = int(arc[rows].max())
    return arc - 1


def _correlated(
    seconds: FloatArray, arc: npt.NDArray[np.int64], random: np.random.Generator
) -> FloatArray:
    """Return a Gauss-Markov process of sigma 1 for each arc."""
    values = np.zeros(len(seconds))
    kept = math.exp(-STEP / _MULTIPATH_TIME)
    for number in range(int(arc.max()) + 1):
        rows = np.flatnonzero(arc == number)
        rows = rows[np.argsort(seconds[rows])]
        drawn = random.standard_normal(len(rows))
        drawn[1:] *= math.sqrt(1.0 - kept**2)
        value = 0.0
        for row, step in zip(rows.tolist(), drawn.tolist(), strict=True):
            value = kept * value + step
            values[row] = value
    return values


def _columns(
    prn: npt.NDArray[np.integer],
    elevation: FloatArray,
    codes: list[FloatArray],
    phases: list[FloatArray],
) -> dict[str, npt.NDArray[np.generic]]:
    """Return the columns that a RINEX file of C1C, L1C, C2W and L2W gives."""
    count = 2 * len(prn)

    def alternate(first: npt.ArrayLike, second: npt.ArrayLike) -> npt.NDArray[np.generic]:
        shape = (len(prn),)
        both = np.broadcast_to(first, shape), np.broadcast_to(second, shape)
        return np.stack(both, axis=-1).reshape(count)

    strength = 32.0 + 18.0 * np.sin(elevation)
    columns = {
        "system": np.full(count, SYSTEM_GPS),
        "prn": np.repeat(prn, 2),
        "band": alternate(1, 2),
        "attribute": alternate(ord("C"), ord("W")),
        "glonass_channel": np.zeros(count),
        "pseudorange": alternate(*codes),
        "carrier_phase_cycles": alternate(*phases),
        "cn0_dbhz": alternate(strength, strength - 6.0),
        "flags": np.full(count, FLAG_CODE_VALID | FLAG_PHASE_VALID | FLAG_PARITY_KNOWN),
    }
    absent = np.full(count, np.nan)
    return {
        name: np.asarray(columns.get(name, absent)).astype(kind)
        for name, kind in OBSERVATION_COLUMNS.items()
    }
