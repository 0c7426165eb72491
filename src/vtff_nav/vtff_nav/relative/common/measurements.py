"""From the observations of two receivers to single differences and their geometry."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss import constants as c
from vtff_gnss.observations import ObservationEpoch
from vtff_gnss.orbits.line_of_sight import lines_of_sight
from vtff_gnss.orbits.satellite_table import SatelliteTable
from vtff_gnss.signals import (
    carrier_frequency_hz,
    carrier_number_of_signal,
    satellite_number,
    satellite_number_of_signal,
    signal_from_number,
    signal_number,
)
from vtff_nav.relative.common.columns import make_table, with_columns
from vtff_nav.relative.common.signal_set import SignalSet
from vtff_nav.relative.kernels.combinations import difference_receivers, read_signals
from vtff_nav.relative.kernels.motion import positions_at_reception

__all__ = [
    "DEFAULT_BANDS",
    "Geometry",
    "MeasurementNoise",
    "SignalReader",
    "SignalTable",
    "SingleDifferences",
    "code_group_delay",
    "compute_geometry",
    "form_single_differences",
    "satellite_mask",
    "satellite_numbers",
    "upper_median",
]

DEFAULT_BANDS: dict[int, tuple[int, ...]] = {c.SYSTEM_GPS: (1, 2, 5), c.SYSTEM_GALILEO: (1, 5, 7)}
"""RINEX frequency digits used for each system: L1, L2, L5; E1, E5a, E5b."""

# Only one of several signals on a carrier is used, because a second signal on the same carrier adds
# little. Civil signals and pilots come first; P(Y) comes before L2C because the broadcast clock
# refers to it.
_ATTRIBUTE_ORDER = "CWPQXSLIBYMNDAZ"
_ATTRIBUTE_RANK = np.full(256, len(_ATTRIBUTE_ORDER), dtype=np.int64)
for _rank, _letter in enumerate(_ATTRIBUTE_ORDER):
    _ATTRIBUTE_RANK[ord(_letter)] = _rank

# Scatter of the delays of two codes on one carrier over the satellites of a system, m.
_MIXED_CODE_SIGMA = 0.5
_LAYOUTS_KEPT = 16
#: Results of `Geometry.columns`: satellites of a geometry, those asked for, and their columns.
#: While the sky does not change, both are the same objects, which nothing is written to.
_known_columns: list[tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.intp]]] = []
_LARGEST_SATELLITE_NUMBER = int(satellite_number(255, 255))


@dataclass(frozen=True)
class MeasurementNoise:
    """Sigmas of the measurements of one receiver.

    Parameters
    ----------
    code_sigma, phase_sigma : float
        Sigmas where the receiver states none, m.
    use_receiver_sigmas : bool
        Whether the sigmas that the receiver states are used.
    smallest_code_sigma, smallest_phase_sigma : float
        Lower limits of the sigmas that the receiver states, m.
    elevation_noise_ratio : float
        Ratio b / a of the variance ``a^2 + (b / sin E)^2`` at elevation E; the sigmas above are
        those at the zenith. 0: the noise is the same at all elevations. For the multipath of
        antennas near the ground RTKLIB takes 1 (manual of 2.4.2, appendix E.7, and its defaults).
    """

    code_sigma: float = 0.3
    phase_sigma: float = 0.001
    use_receiver_sigmas: bool = True
    smallest_code_sigma: float = 0.05
    smallest_phase_sigma: float = 0.0002
    elevation_noise_ratio: float = 0.0

    def growth(self, elevation: FloatArray) -> FloatArray:
        """Return the factor of the sigmas at elevations (rad, above the horizon), shape (n,)."""
        ratio = self.elevation_noise_ratio
        return np.asarray(np.hypot(1.0, ratio / np.sin(elevation)) / np.hypot(1.0, ratio))


@dataclass(frozen=True, eq=False)
class SignalTable:
    """Usable signals of one receiver epoch, at most one on each carrier of a satellite.

    All columns have shape (n,); signals are in the order of `signal`.

    Parameters
    ----------
    signal, satellite : ndarray of int64
        `vtff_gnss.signals.signal_number` and `vtff_gnss.signals.satellite_number`.
    system, band : ndarray of int64
        ``SYSTEM_*`` and RINEX frequency digit.
    wavelength, frequency_hz : ndarray
        Wavelength and frequency of the carrier, m and Hz.
    pseudorange, carrier_range : ndarray
        m; the carrier range is ambiguous.
    code_sigma, phase_sigma : ndarray
        Sigmas of pseudorange and carrier range, m.
    range_rate : ndarray
        Range rate from Doppler, m/s; NaN without Doppler.
    flags : ndarray of uint16
        ``FLAG_*`` of `vtff_gnss.constants`.
    lock_time : ndarray
        s.
    """

    signal: npt.NDArray[np.int64]
    satellite: npt.NDArray[np.int64]
    system: npt.NDArray[np.int64]
    band: npt.NDArray[np.int64]
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
        return len(self.signal)

    def select(self, rows: npt.NDArray[np.intp]) -> SignalTable:
        """Return a table of some rows."""
        return SignalTable(
            **{name: getattr(self, name)[rows] for name in self.__dataclass_fields__}
        )


def satellite_mask(satellites: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """Return an array that is true at the given satellite numbers, shape (65536,).

    Parameters
    ----------
    satellites : ndarray of int64
        `vtff_gnss.signals.satellite_number` of satellites.
    """
    mask = np.zeros(_LARGEST_SATELLITE_NUMBER + 1, dtype=bool)
    mask[satellites] = True
    return mask


@dataclass(frozen=True, eq=False)
class _Layout:
    """Columns that depend only on the signals in a log, in the order of signals; shape (n,).

    Parameters
    ----------
    order : ndarray of intp
        Rows of the epoch.
    signal, satellite, carrier : ndarray of int64
        Numbers of signal and satellite; `carrier` is equal for signals on one carrier of a
        satellite.
    system, band : ndarray of int64
    frequency_hz, wavelength : ndarray
    """

    order: npt.NDArray[np.intp]
    signal: npt.NDArray[np.int64]
    satellite: npt.NDArray[np.int64]
    carrier: npt.NDArray[np.int64]
    system: npt.NDArray[np.int64]
    band: npt.NDArray[np.int64]
    frequency_hz: FloatArray
    wavelength: FloatArray

    def select(self, rows: npt.NDArray[np.intp]) -> _Layout:
        """Return the columns of some of the signals."""
        return _Layout(**{name: getattr(self, name)[rows] for name in self.__dataclass_fields__})


class SignalReader:
    """Reads the usable signals of epochs.

    Parameters
    ----------
    noise : MeasurementNoise
    bands : mapping of int to tuple of int
        RINEX frequency digits that are used of each system.
    """

    def __init__(self, noise: MeasurementNoise, bands: Mapping[int, tuple[int, ...]]) -> None:
        self._noise = noise
        self._sigmas = np.array((noise.code_sigma, noise.phase_sigma))
        self._smallest_sigmas = np.array((noise.smallest_code_sigma, noise.smallest_phase_sigma))
        self._is_wanted = np.zeros((256, 10), dtype=bool)
        for system, digits in bands.items():
            self._is_wanted[system, list(digits)] = True
        # A log holds the same signals for minutes, so the layouts are kept.
        self._layouts: dict[bytes, _Layout] = {}

    def read(self, epoch: ObservationEpoch, has_ephemeris: npt.NDArray[np.bool_]) -> SignalTable:
        """Return the signals of an epoch that have valid code and phase.

        Parameters
        ----------
        epoch : ObservationEpoch
        has_ephemeris : ndarray of bool
            `satellite_mask` of the satellites with an ephemeris; the others are left out.
        """
        layout, noise = self._layout_of(epoch), self._noise
        order = layout.order
        rows, numbers, flags = read_signals(
            order,
            layout.satellite,
            layout.carrier,
            layout.wavelength,
            has_ephemeris,
            epoch.flags,
            epoch.pseudorange,
            epoch.carrier_phase_cycles,
            epoch.pseudorange_sigma,
            epoch.carrier_phase_sigma_cycles,
            epoch.doppler_hz,
            epoch.lock_time,
            self._sigmas,
            self._smallest_sigmas,
            noise.use_receiver_sigmas,
        )
        if len(rows) == len(order):
            names: _Layout = layout
        else:
            names = layout.select(rows)
        return make_table(
            SignalTable,
            signal=names.signal,
            satellite=names.satellite,
            system=names.system,
            band=names.band,
            wavelength=names.wavelength,
            frequency_hz=names.frequency_hz,
            pseudorange=numbers[0],
            carrier_range=numbers[1],
            code_sigma=numbers[2],
            phase_sigma=numbers[3],
            range_rate=numbers[4],
            flags=flags,
            lock_time=numbers[5],
        )

    def _layout_of(self, epoch: ObservationEpoch) -> _Layout:
        """Return the layout of the signals of an epoch."""
        names = epoch.system, epoch.prn, epoch.band, epoch.attribute
        key = names[0].tobytes() + names[1].tobytes() + names[2].tobytes() + names[3].tobytes()
        layout = self._layouts.get(key)
        if layout is None:
            if len(self._layouts) >= _LAYOUTS_KEPT:
                self._layouts.clear()
            system, prn, band, attribute = (column.astype(np.int64) for column in names)
            carrier = signal_number(system, prn, band, 0)
            order = np.lexsort((_ATTRIBUTE_RANK[attribute], carrier))
            order = order[self._is_wanted[system[order], band[order]]]
            frequency = carrier_frequency_hz(system[order], band[order])
            signal = signal_number(system[order], prn[order], band[order], attribute[order])
            layout = _Layout(
                order=order,
                signal=signal,
                satellite=satellite_number_of_signal(signal),
                carrier=carrier[order],
                system=system[order],
                band=band[order],
                frequency_hz=frequency,
                wavelength=SPEED_OF_LIGHT / frequency,
            )
            self._layouts[key] = layout
        return layout


@dataclass(frozen=True, eq=False)
class SingleDifferences:
    """Measurements of the deputy less those of the chief, of the signals that both receivers have.

    All columns but `lock_time` have shape (n,).

    Parameters
    ----------
    keys : SignalSet
        Signals, in the order of their numbers; any other sequence of signals becomes a set.
    satellite : ndarray of int64
        `vtff_gnss.signals.satellite_number`.
    wavelength, frequency_hz : ndarray
        Wavelength and frequency of the carrier, m and Hz.
    code, phase : ndarray
        Single differences of pseudorange and carrier range, m.
    code_variance, phase_variance : ndarray
        Variances of these differences, m2.
    is_parity_known : ndarray of bool
        Whether both receivers know the parity: the ambiguity is then a whole number.
    half_cycles : ndarray of int64
        Receivers that have added half a cycle: bit 0 for the chief, bit 1 for the deputy.
    is_lock_lost : ndarray of bool
        Whether either receiver has lost lock.
    lock_time : ndarray, shape (2, n)
        Lock time of chief and deputy, s.
    noise_growth : ndarray
        Factor that slow errors and sigmas have at the elevation of the satellite; the variances
        contain it.
    """

    keys: SignalSet
    satellite: npt.NDArray[np.int64]
    wavelength: FloatArray
    frequency_hz: FloatArray
    code: FloatArray
    phase: FloatArray
    code_variance: FloatArray
    phase_variance: FloatArray
    is_parity_known: npt.NDArray[np.bool_]
    half_cycles: npt.NDArray[np.int64]
    is_lock_lost: npt.NDArray[np.bool_]
    lock_time: FloatArray
    noise_growth: FloatArray

    def __post_init__(self) -> None:
        """Have the signals as a set."""
        if not isinstance(self.keys, SignalSet):
            object.__setattr__(self, "keys", SignalSet(self.keys))

    def __len__(self) -> int:
        """Return the number of signals."""
        return len(self.keys)

    def grown(self, factor: FloatArray) -> SingleDifferences:
        """Return single differences whose noise is larger by factors, shape (n,)."""
        return with_columns(
            self,
            code_variance=factor**2 * self.code_variance,
            phase_variance=factor**2 * self.phase_variance,
            noise_growth=factor * self.noise_growth,
        )

    def select(self, rows: npt.NDArray[np.intp]) -> SingleDifferences:
        """Return the single differences of some rows."""
        if len(rows) == len(self):
            return self
        columns = {
            name: getattr(self, name).take(rows, axis=-1)
            for name in self.__dataclass_fields__
            if name != "keys"
        }
        return SingleDifferences(keys=self.keys.select(rows), **columns)


def form_single_differences(chief: SignalTable, deputy: SignalTable) -> SingleDifferences:
    """Return the differences, deputy less chief, of the carriers that both receivers have.

    Two signals on one carrier of a satellite are differenced whatever their tracking attributes:
    RINEX aligns their phases (RINEX 3.05, section 9.1). Their codes differ by the delays of the
    satellite, which the variance of the difference holds. The key is that of the deputy's signal,
    so that satellites whose signals are paired in another way have a receiver bias of their own.
    """
    pairs = _pair_carriers(chief.signal.tobytes(), deputy.signal.tobytes())
    numbers, lock_time, is_parity_known, is_lock_lost, half_cycles = difference_receivers(
        pairs.rows_chief,
        pairs.rows_deputy,
        pairs.mixed_variance,
        chief.pseudorange,
        chief.carrier_range,
        chief.code_sigma,
        chief.phase_sigma,
        chief.flags,
        chief.lock_time,
        deputy.pseudorange,
        deputy.carrier_range,
        deputy.code_sigma,
        deputy.phase_sigma,
        deputy.flags,
        deputy.lock_time,
    )
    return make_table(
        SingleDifferences,
        keys=pairs.keys,
        satellite=pairs.satellite,
        wavelength=pairs.wavelength,
        frequency_hz=pairs.frequency_hz,
        code=numbers[0],
        phase=numbers[1],
        code_variance=numbers[2],
        phase_variance=numbers[3],
        is_parity_known=is_parity_known,
        half_cycles=half_cycles,
        is_lock_lost=is_lock_lost,
        lock_time=lock_time,
        noise_growth=pairs.no_growth,
    )


@dataclass(frozen=True, eq=False)
class _CarrierPairs:
    """Carriers that both receivers have, n of them.

    Parameters
    ----------
    rows_chief, rows_deputy : ndarray of intp, shape (n,)
        Rows in the tables of both.
    keys : SignalSet
        Signals of the deputy.
    mixed_variance : ndarray, shape (n,)
        Variance of the delay between two codes of a carrier, m2.
    satellite, wavelength, frequency_hz, no_growth : ndarray, shape (n,)
        Columns of `SingleDifferences`; the last is its `noise_growth` where there is none.
    """

    rows_chief: npt.NDArray[np.intp]
    rows_deputy: npt.NDArray[np.intp]
    keys: SignalSet
    mixed_variance: FloatArray
    satellite: npt.NDArray[np.int64]
    wavelength: FloatArray
    frequency_hz: FloatArray
    no_growth: FloatArray


@functools.lru_cache(maxsize=_LAYOUTS_KEPT)
def _pair_carriers(signals_chief: bytes, signals_deputy: bytes) -> _CarrierPairs:
    """Return the carriers of two columns of signals, which stay the same for minutes."""
    chief, deputy = (np.frombuffer(s, dtype=np.int64) for s in (signals_chief, signals_deputy))
    _, rows_chief, rows_deputy = np.intersect1d(
        carrier_number_of_signal(chief),
        carrier_number_of_signal(deputy),
        assume_unique=True,
        return_indices=True,
    )
    is_mixed = chief[rows_chief] != deputy[rows_deputy]
    keys = SignalSet(signal_from_number(number) for number in deputy[rows_deputy].tolist())
    system, _, band, _ = keys.name_columns
    frequency_hz = carrier_frequency_hz(system.astype(np.int64), band.astype(np.int64))
    return _CarrierPairs(
        rows_chief=rows_chief,
        rows_deputy=rows_deputy,
        keys=keys,
        mixed_variance=np.where(is_mixed, _MIXED_CODE_SIGMA**2, 0.0),
        satellite=satellite_number_of_signal(deputy[rows_deputy]),
        wavelength=SPEED_OF_LIGHT / frequency_hz,
        frequency_hz=frequency_hz,
        no_growth=np.ones(len(keys)),
    )


@dataclass(frozen=True, eq=False)
class Geometry:
    """Lines of sight of both receivers to n satellites; the leading axis is chief, deputy.

    Parameters
    ----------
    satellite : ndarray of int64, shape (n,)
        `vtff_gnss.signals.satellite_number`, increasing.
    range : ndarray, shape (2, n)
        Distance from the receiver at reception (time tag less clock) to the satellite at
        transmission, m.
    range_rate : ndarray, shape (2, n)
        m/s.
    clock : ndarray, shape (2, n)
        Satellite clock, m.
    clock_drift : ndarray, shape (2, n)
        Derivative of the satellite clock, m/s.
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

    def columns(self, satellite: npt.NDArray[np.int64]) -> npt.NDArray[np.intp]:
        """Return the columns of satellites; all of them must be part of the geometry."""
        for known in _known_columns:
            if known[0] is self.satellite and known[1] is satellite:
                return known[2]
        columns = np.searchsorted(self.satellite, satellite)
        del _known_columns[_LAYOUTS_KEPT - 1 :]
        _known_columns.insert(0, (self.satellite, satellite, columns))
        return columns


@functools.lru_cache(maxsize=_LAYOUTS_KEPT)
def satellite_numbers(table: SatelliteTable) -> npt.NDArray[np.int64]:
    """Return the `vtff_gnss.signals.satellite_number` of each row of a table, increasing."""
    return satellite_number(table.system, table.prn)


def compute_geometry(
    table: SatelliteTable,
    time: GpsTime,
    offsets: FloatArray,
    states_itrf: FloatArray,
    to_itrf: FloatArray,
) -> Geometry:
    """Return the lines of sight of both receivers to the satellites of a table.

    Parameters
    ----------
    table : SatelliteTable
    time : GpsTime
        Time of the states.
    offsets : ndarray, shape (2,)
        True time of reception less `time` (time tag less clock), s.
    states_itrf : ndarray, shape (2, 6)
        Positions and Earth-fixed velocities at `time`, m and m/s. The positions are moved to the
        time of reception by the velocity (7.6 mm for each microsecond in orbit) and free fall.
    to_itrf : ndarray, shape (3, 3)
        Rotation from the navigation axes to ITRF.
    """
    position = positions_at_reception(states_itrf, offsets)
    sight = lines_of_sight(table, time, offsets, position, states_itrf[:, 3:])
    return make_table(
        Geometry,
        satellite=satellite_numbers(table),
        range=sight.range,
        range_rate=sight.range_rate,
        clock=SPEED_OF_LIGHT * sight.clock_offset_satellite,
        clock_drift=SPEED_OF_LIGHT * sight.clock_drift_satellite,
        direction=sight.direction_itrf @ to_itrf,
        elevation=sight.elevation,
        azimuth=sight.azimuth,
    )


@functools.lru_cache(maxsize=32)
def code_group_delay(table: SatelliteTable, band: int) -> FloatArray:
    """Return the delay of the code on a carrier against the broadcast clock, m.

    Parameters
    ----------
    table : SatelliteTable
    band : int
        RINEX frequency digit.

    Returns
    -------
    ndarray, shape (n,)
        Delay for each satellite of the table, NaN where its system lacks the carrier.

    Notes
    -----
    With gamma = (f1 / f)^2: GPS gamma TGD (IS-GPS-200, 20.3.3.3.3.2; inter-signal corrections of
    L2C and L5 are not in LNAV and taken as zero). Galileo with the I/NAV clock: E1 and E5b gamma
    BGD(E1,E5b), E5a BGD(E1,E5b) + (gamma - 1) BGD(E1,E5a) (OS SIS ICD, 5.1.5); with the F/NAV
    clock: E1 and E5a gamma BGD(E1,E5a); it does not tell the delay of E5b, which is taken as that
    of E5a.
    """
    frequency = carrier_frequency_hz(table.system, np.full(len(table), band))
    gamma = (c.FREQUENCY_L1 / frequency) ** 2
    if band == 5:
        galileo = table.group_delay_secondary + (gamma - 1.0) * table.group_delay
    else:
        galileo = gamma * table.group_delay_secondary
    is_fnav = table.source == c.EPHEMERIS_SOURCE_FNAV
    galileo = np.where(is_fnav, gamma * table.group_delay, galileo)
    delay = np.where(table.system == c.SYSTEM_GALILEO, galileo, gamma * table.group_delay)
    return SPEED_OF_LIGHT * delay


def upper_median(values: FloatArray) -> float:
    """Return the upper median; `numpy.median` takes ten times as long on so few numbers."""
    ordered: list[float] = sorted(values.tolist())
    return ordered[len(ordered) // 2]
