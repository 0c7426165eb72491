"""From the observations of two receivers to single differences and their geometry."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss import constants as c
from vtff_gnss.observations import ObservationEpoch
from vtff_gnss.orbits.broadcast_orbit import EphemerisTable
from vtff_gnss.orbits.line_of_sight import lines_of_sight
from vtff_gnss.signals import carrier_frequency_hz, satellite_name

__all__ = [
    "DEFAULT_BANDS",
    "Geometry",
    "MeasurementNoise",
    "SignalKey",
    "SignalReader",
    "SignalTable",
    "SingleDifferences",
    "code_group_delay",
    "geometry",
    "median",
    "satellite_mask",
    "satellite_rows",
    "signal_key",
    "single_differences",
]

DEFAULT_BANDS: dict[int, tuple[int, ...]] = {c.SYSTEM_GPS: (1, 2, 5), c.SYSTEM_GALILEO: (1, 5, 7)}
"""RINEX frequency digits used: L1, L2, L5; E1, E5a, E5b."""

# Of several signals on one carrier one is used: the civil ones and pilots first, P(Y) before L2C
# because the broadcast clock refers to it. They share the carrier, so that a second adds little.
_ATTRIBUTE_ORDER = "CWPQXSLIBYMNDAZ"
_ATTRIBUTE_RANK = np.full(256, len(_ATTRIBUTE_ORDER), dtype=np.int64)
for _rank, _letter in enumerate(_ATTRIBUTE_ORDER):
    _ATTRIBUTE_RANK[ord(_letter)] = _rank

_LAYOUTS_KEPT = 16
_BOTH_VALID = c.FLAG_CODE_VALID | c.FLAG_PHASE_VALID


class SignalKey(NamedTuple):
    """A signal of a satellite."""

    system: int
    prn: int
    band: int
    attribute: int

    @property
    def satellite(self) -> tuple[int, int]:
        """System and number of the satellite."""
        return self.system, self.prn

    @property
    def group(self) -> tuple[int, int, int]:
        """What shares one receiver bias: system, band and attribute."""
        return self.system, self.band, self.attribute

    def __str__(self) -> str:
        """Return for example ``G05 L1C``."""
        return f"{satellite_name(self.system, self.prn)} L{self.band}{chr(self.attribute)}"


@dataclass(frozen=True)
class MeasurementNoise:
    """Sigmas of the measurements of one receiver.

    Parameters
    ----------
    code_sigma, phase_sigma : float
        m; used where the receiver states none.
    use_receiver_sigmas : bool
        Take those of the receiver, but not below the smallest.
    smallest_code_sigma, smallest_phase_sigma : float
        m.
    """

    code_sigma: float = 0.3
    phase_sigma: float = 0.001
    use_receiver_sigmas: bool = True
    smallest_code_sigma: float = 0.05
    smallest_phase_sigma: float = 0.0002

    def sigmas(
        self, epoch: ObservationEpoch, rows: npt.NDArray[np.intp], wavelength: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the sigmas of code and phase of some rows of an epoch, m, shape (n,)."""
        size = len(wavelength)
        code, phase = np.full(size, self.code_sigma), np.full(size, self.phase_sigma)
        if self.use_receiver_sigmas:
            stated = epoch.pseudorange_sigma[rows].astype(float)
            code = np.where(stated > 0.0, np.maximum(stated, self.smallest_code_sigma), code)
            stated = epoch.carrier_phase_sigma_cycles[rows].astype(float) * wavelength
            phase = np.where(stated > 0.0, np.maximum(stated, self.smallest_phase_sigma), phase)
        return code, phase


@dataclass(frozen=True, eq=False)
class SignalTable:
    """Usable signals of one receiver epoch, at most one on each carrier of a satellite; (n,).

    Parameters
    ----------
    number : ndarray of int64
        System, satellite, band and attribute as one number, increasing.
    wavelength, frequency_hz : ndarray
    pseudorange, carrier_range : ndarray
        m; the carrier range has an ambiguity.
    code_sigma, phase_sigma : ndarray
        m.
    range_rate : ndarray
        m/s, from Doppler; NaN where there is none.
    flags : ndarray of uint16
    lock_time : ndarray
    """

    number: npt.NDArray[np.int64]
    wavelength: FloatArray
    frequency_hz: FloatArray
    pseudorange: FloatArray
    carrier_range: FloatArray
    code_sigma: FloatArray
    phase_sigma: FloatArray
    range_rate: FloatArray
    flags: npt.NDArray[np.uint16]
    lock_time: FloatArray

    def __len__(self) -> int:
        """Return the number of signals."""
        return len(self.number)

    def taken(self, rows: npt.NDArray[np.intp]) -> SignalTable:
        """Return some rows."""
        return SignalTable(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    @property
    def satellite(self) -> npt.NDArray[np.int64]:
        """System and satellite as one number, shape (n,)."""
        return self.number >> 16


def satellite_mask(satellites: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """Return which of all satellite numbers (system and number as one) are given, (65536,)."""
    mask = np.zeros(1 << 16, dtype=bool)
    mask[satellites] = True
    return mask


@dataclass(frozen=True, eq=False)
class _Layout:
    """What depends only on which signals a log holds, in the order of their numbers; shape (n,)."""

    order: npt.NDArray[np.intp]
    number: npt.NDArray[np.int64]
    frequency_hz: FloatArray
    wavelength: FloatArray


class SignalReader:
    """Takes the usable signals out of epochs.

    Parameters
    ----------
    noise : MeasurementNoise
    bands : mapping of int to tuple of int
        Frequency digits wanted of each system.
    """

    def __init__(self, noise: MeasurementNoise, bands: Mapping[int, tuple[int, ...]]) -> None:
        self._noise = noise
        self._is_wanted = np.zeros((256, 10), dtype=bool)
        for wanted, digits in bands.items():
            self._is_wanted[wanted, list(digits)] = True
        # A log holds the same signals for minutes: one layout for each receiver and some more.
        self._layouts: dict[bytes, _Layout] = {}

    def read(self, epoch: ObservationEpoch, is_known: npt.NDArray[np.bool_]) -> SignalTable:
        """Return the signals of an epoch that have valid code and phase.

        Parameters
        ----------
        epoch : ObservationEpoch
        is_known : ndarray of bool
            See `satellite_mask`: satellites with an ephemeris.
        """
        layout = self._layout(epoch)
        order = layout.order
        flags = epoch.flags[order]
        is_usable = (flags & _BOTH_VALID) == _BOTH_VALID
        is_usable &= is_known[layout.number >> 16]
        pseudorange = epoch.pseudorange[order]
        carrier_range = layout.wavelength * epoch.carrier_phase_cycles[order]
        is_usable &= np.isfinite(pseudorange + carrier_range)
        rows = np.flatnonzero(is_usable)
        carrier = layout.number[rows] >> 8
        rows = rows[np.append(True, carrier[1:] != carrier[:-1])] if len(rows) else rows
        chosen, wavelength = order[rows], layout.wavelength[rows]
        code_sigma, phase_sigma = self._noise.sigmas(epoch, chosen, wavelength)
        return SignalTable(
            number=layout.number[rows],
            wavelength=wavelength,
            frequency_hz=layout.frequency_hz[rows],
            pseudorange=pseudorange[rows],
            carrier_range=carrier_range[rows],
            code_sigma=code_sigma,
            phase_sigma=phase_sigma,
            range_rate=-wavelength * epoch.doppler_hz[chosen].astype(float),
            flags=flags[rows],
            lock_time=epoch.lock_time[chosen].astype(float),
        )

    def _layout(self, epoch: ObservationEpoch) -> _Layout:
        names = epoch.system, epoch.prn, epoch.band, epoch.attribute
        key = b"".join(column.tobytes() for column in names)
        layout = self._layouts.get(key)
        if layout is None:
            if len(self._layouts) >= _LAYOUTS_KEPT:
                self._layouts.clear()
            system, prn, band, attribute = (column.astype(np.int64) for column in names)
            carrier = (system << 16) | (prn << 8) | band
            order = np.lexsort((_ATTRIBUTE_RANK[attribute], carrier))
            order = order[self._is_wanted[system[order], band[order]]]
            frequency = carrier_frequency_hz(system[order], band[order])
            layout = _Layout(
                order=order,
                number=(carrier[order] << 8) | attribute[order],
                frequency_hz=frequency,
                wavelength=SPEED_OF_LIGHT / frequency,
            )
            self._layouts[key] = layout
        return layout


def signal_key(number: int) -> SignalKey:
    """Return the key of a signal number of `SignalTable`."""
    return SignalKey(number >> 24, (number >> 16) & 255, (number >> 8) & 255, number & 255)


@dataclass(frozen=True, eq=False)
class SingleDifferences:
    """Deputy less chief of the signals that both have, shape (n,); m.

    Parameters
    ----------
    keys : list of SignalKey
    satellite : ndarray of int64
        System and satellite as one number.
    wavelength, frequency_hz, code, phase, code_variance, phase_variance, range_rate : ndarray
    is_parity_known : ndarray of bool
        At both receivers: the ambiguity is a whole number.
    half_cycles : ndarray of int64
        Bit 0 for the chief, bit 1 for the deputy: the receiver has added half a cycle.
    is_lock_lost : ndarray of bool
        At either.
    lock_time : ndarray, shape (2, n)
        s; chief, deputy.
    """

    keys: list[SignalKey]
    satellite: npt.NDArray[np.int64]
    wavelength: FloatArray
    frequency_hz: FloatArray
    code: FloatArray
    phase: FloatArray
    code_variance: FloatArray
    phase_variance: FloatArray
    range_rate: FloatArray
    is_parity_known: npt.NDArray[np.bool_]
    half_cycles: npt.NDArray[np.int64]
    is_lock_lost: npt.NDArray[np.bool_]
    lock_time: FloatArray

    def __len__(self) -> int:
        """Return the number of signals."""
        return len(self.keys)


def single_differences(chief: SignalTable, deputy: SignalTable) -> SingleDifferences:
    """Return the differences of the signals that both receivers have."""
    _, first, second = np.intersect1d(
        chief.number, deputy.number, assume_unique=True, return_indices=True
    )
    a, b = chief.taken(first), deputy.taken(second)
    both = a.flags & b.flags
    added = c.FLAG_HALF_CYCLE_ADDED
    half = ((a.flags & added) > 0).astype(np.int64) + 2 * ((b.flags & added) > 0)
    return SingleDifferences(
        keys=[signal_key(number) for number in a.number.tolist()],
        satellite=a.satellite,
        wavelength=a.wavelength,
        frequency_hz=a.frequency_hz,
        code=b.pseudorange - a.pseudorange,
        phase=b.carrier_range - a.carrier_range,
        code_variance=a.code_sigma**2 + b.code_sigma**2,
        phase_variance=a.phase_sigma**2 + b.phase_sigma**2,
        range_rate=b.range_rate - a.range_rate,
        is_parity_known=(both & c.FLAG_PARITY_KNOWN) > 0,
        half_cycles=half,
        is_lock_lost=((a.flags | b.flags) & c.FLAG_LOCK_LOST) > 0,
        lock_time=np.array([a.lock_time, b.lock_time]),
    )


@dataclass(frozen=True, eq=False)
class Geometry:
    """Lines of sight of both receivers to n satellites; leading axis chief, deputy.

    Parameters
    ----------
    satellite : ndarray of int64, shape (n,)
        System and satellite as one number, increasing.
    range : ndarray, shape (2, n)
        m, from the position at reception (tag less clock) to that at transmission.
    range_rate : ndarray, shape (2, n)
        m/s.
    clock : ndarray, shape (2, n)
        Satellite clock, m.
    clock_drift : ndarray, shape (2, n)
        Its derivative, m/s.
    direction : ndarray, shape (2, n, 3)
        Unit vectors to the satellites in the navigation axes.
    elevation, azimuth : ndarray, shape (2, n)
        rad.
    """

    satellite: npt.NDArray[np.int64]
    range: FloatArray
    range_rate: FloatArray
    clock: FloatArray
    clock_drift: FloatArray
    direction: FloatArray
    elevation: FloatArray
    azimuth: FloatArray

    def rows(self, satellite: npt.NDArray[np.int64]) -> npt.NDArray[np.intp]:
        """Return the columns of satellites, all of which must be there."""
        return np.searchsorted(self.satellite, satellite)


def satellite_rows(table: EphemerisTable) -> npt.NDArray[np.int64]:
    """Return system and satellite as one number for each row of a table (increasing)."""
    return (table.system.astype(np.int64) << 8) | table.prn.astype(np.int64)


def geometry(
    table: EphemerisTable,
    time: GpsTime,
    offsets: FloatArray,
    states_itrf: FloatArray,
    to_itrf: FloatArray,
) -> Geometry:
    """Return the lines of sight of receivers.

    Parameters
    ----------
    table : EphemerisTable
    time : GpsTime
        Of the states.
    offsets : ndarray, shape (2,)
        True time of reception less `time` (time tag less clock), s.
    states_itrf : ndarray, shape (2, 6)
        Positions and Earth-fixed velocities at `time`. They are carried to the time of reception
        by their velocity and the acceleration of free fall: 7.6 mm for each microsecond in orbit.
    to_itrf : ndarray, shape (3, 3)
        From the navigation axes.
    """
    position, velocity = states_itrf[:, :3], states_itrf[:, 3:]
    shift = offsets[:, None]
    received = position + shift * velocity + 0.5 * shift**2 * _acceleration(states_itrf)
    sight = lines_of_sight(table, time, offsets, received, velocity)
    return Geometry(
        satellite=satellite_rows(table),
        range=sight.range,
        range_rate=sight.range_rate,
        clock=SPEED_OF_LIGHT * sight.clock_offset_satellite,
        clock_drift=SPEED_OF_LIGHT * sight.clock_drift_satellite,
        direction=sight.direction_itrf @ to_itrf,
        elevation=sight.elevation,
        azimuth=sight.azimuth,
    )


def _acceleration(states_itrf: FloatArray) -> FloatArray:
    """Return the Earth-fixed acceleration of free fall, (2, 3); 0 for receivers at rest."""
    position, velocity = states_itrf[:, :3], states_itrf[:, 3:]
    squared = np.sum(position**2, axis=1, keepdims=True)
    rate = c.EARTH_ROTATION_RATE_BROADCAST
    fall = -c.GRAVITATIONAL_PARAMETER_BROADCAST[c.SYSTEM_GPS] / squared**1.5 * position
    coriolis = 2.0 * rate * velocity[:, [1, 0, 2]] * np.array([1.0, -1.0, 0.0])
    inertial = fall + coriolis
    centrifugal = rate**2 * position * np.array([1.0, 1.0, 0.0])
    is_orbiting = np.sum(velocity**2, axis=1, keepdims=True) > 1e6
    return np.where(is_orbiting, inertial + centrifugal, 0.0)


@functools.lru_cache(maxsize=32)
def code_group_delay(table: EphemerisTable, band: int) -> FloatArray:
    """Return by how much codes leave later than the broadcast clock tells, m, of all satellites.

    With gamma = (f1 / f)^2: GPS gamma TGD (IS-GPS-200, 20.3.3.3.3.2; inter-signal corrections of
    L2C and L5 are not in LNAV and taken as zero). Galileo with the I/NAV clock: E1 and E5b gamma
    BGD(E1,E5b), E5a BGD(E1,E5b) + (gamma - 1) BGD(E1,E5a) (OS SIS ICD, 5.1.5).
    """
    frequency = carrier_frequency_hz(table.system, np.full(len(table), band))
    gamma = (c.FREQUENCY_L1 / frequency) ** 2
    first, second = table.group_delay, table.group_delay_secondary
    galileo = second + (gamma - 1.0) * first if band == 5 else gamma * second
    delay = np.where(table.system == c.SYSTEM_GALILEO, galileo, gamma * first)
    return SPEED_OF_LIGHT * delay


def median(values: FloatArray) -> float:
    """Return the (upper) median; `numpy.median` takes ten times as long on so few numbers."""
    ordered: list[float] = sorted(values.tolist())
    return ordered[len(ordered) // 2]
