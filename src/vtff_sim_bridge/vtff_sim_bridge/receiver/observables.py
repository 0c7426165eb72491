"""Pseudorange, carrier phase, Doppler and C/N0 of all links of a receiver over a second."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import EARTH_ROTATION_RATE, SPEED_OF_LIGHT
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.antex import PhaseCentre, antex_frequency
from vtff_gnss.constants import SYSTEM_GALILEO, SYSTEM_GPS
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.orbits.line_of_sight import SatelliteRays
from vtff_sim_bridge.gnss.configuration import (
    NoiseModel,
    ReceiverConfiguration,
)
from vtff_sim_bridge.gnss.signal_table import SIGNALS, Signal, clock_group_delay
from vtff_sim_bridge.gnss.sky import Constellation, Sky, UploadError
from vtff_sim_bridge.noise.gauss_markov import GaussMarkovField
from vtff_sim_bridge.noise.random_streams import (
    EPOCHS_PER_SECOND,
    Effect,
    NoiseField,
    generator,
)
from vtff_sim_bridge.receiver.tracking import Link

__all__ = [
    "LineBiasDrift",
    "LinkPlan",
    "MeasurementNoise",
    "Multipath",
    "Observables",
    "Sigmas",
    "all_links",
    "link_addresses",
    "link_rows",
    "signals_of",
]

_REFERENCE_DISTANCE = 20.2e6
# Below a tenth of its amplitude at boresight the direct signal is lost in most receivers.
_LARGEST_MULTIPATH_FACTOR = 10.0
_EARTH_ROTATION = np.array([0.0, 0.0, EARTH_ROTATION_RATE])
_TAGS = np.arange(1 - EPOCHS_PER_SECOND, 1) / EPOCHS_PER_SECOND
_SATELLITES = {SYSTEM_GPS: 32, SYSTEM_GALILEO: 36}
_NOISE_EFFECTS = (
    Effect.CODE_NOISE,
    Effect.PHASE_NOISE,
    Effect.DOPPLER_NOISE,
    Effect.CN0_NOISE,
)


def all_links(signals: Sequence[Signal]) -> list[Link]:
    """Return every link that signals make, satellite by satellite."""
    return [
        Link(system, prn, signal)
        for system, count in _SATELLITES.items()
        for prn in range(1, count + 1)
        for signal in signals
        if signal.system == system
    ]


def link_rows(links: Sequence[Link]) -> dict[tuple[int, int], list[int]]:
    """Return the places of the links of each satellite (system, number)."""
    rows: dict[tuple[int, int], list[int]] = {}
    for row, link in enumerate(links):
        rows.setdefault((link.system, link.prn), []).append(row)
    return rows


@dataclass(frozen=True, eq=False)
class LinkPlan:
    """The links to the satellites of a sky: constants of each, shape (m,), satellite by satellite.

    Parameters
    ----------
    ephemerides : tuple of BroadcastEphemeris
        Ephemerides of the n satellites.
    satellites : list of (int, int)
        Their system and number.
    satellite : ndarray of int
        Column of each link's satellite.
    row : ndarray of int
        Place of the link among all links.
    frequency, wavelength, chip_length : ndarray
        Hz, m, m.
    code_bias : ndarray
        Group delay of the satellite, its further bias, and the bias of the receiver, m.
    broadcast_delay : ndarray
        Part of it that the broadcast message tells, m.
    cn0_zenith_dbhz : ndarray
    system, prn, band, attribute : ndarray of uint8
    stream : ndarray of int, shape (n,)
        Number of each satellite's scintillation pattern.
    has_data : ndarray of bool, shape (m,)
        Whether each signal carries data.
    phase_centre_frequency : ndarray of str, shape (m,)
        How ANTEX files call the frequency of each link.
    upload_errors : tuple of UploadError
        What the n broadcast ephemerides are off by.
    """

    ephemerides: tuple[BroadcastEphemeris, ...]
    satellites: list[tuple[int, int]]
    satellite: npt.NDArray[np.intp]
    row: npt.NDArray[np.intp]
    frequency: FloatArray
    wavelength: FloatArray
    chip_length: FloatArray
    code_bias: FloatArray
    broadcast_delay: FloatArray
    cn0_zenith_dbhz: FloatArray
    system: npt.NDArray[np.uint8]
    prn: npt.NDArray[np.uint8]
    band: npt.NDArray[np.uint8]
    attribute: npt.NDArray[np.uint8]
    stream: npt.NDArray[np.int64]
    has_data: npt.NDArray[np.bool_]
    phase_centre_frequency: npt.NDArray[np.str_]
    upload_errors: tuple[UploadError, ...]

    @classmethod
    def of_sky(
        cls,
        sky: Sky,
        constellation: Constellation,
        links: Sequence[Link],
        rows_of: Mapping[tuple[int, int], Sequence[int]],
        receiver: ReceiverConfiguration,
    ) -> LinkPlan:
        """Return the plan of a receiver for a sky."""
        ephemerides = sky.table.ephemerides
        satellites = [(e.system, e.prn) for e in ephemerides]
        rows_by_satellite = [rows_of.get(satellite, ()) for satellite in satellites]
        rows = [row for satellite_rows in rows_by_satellite for row in satellite_rows]
        chosen = [links[row] for row in rows]
        signals = [link.signal for link in chosen]
        of_satellite = dict(zip(satellites, ephemerides, strict=True))
        delay = SPEED_OF_LIGHT * np.array(
            [clock_group_delay(k.signal, of_satellite[k.system, k.prn]) for k in chosen]
        )
        bias = np.array(
            [
                constellation.signal_bias(k.system, k.prn, k.signal.band, k.signal.attribute)
                + receiver.biases.get(k.signal.name, 0.0)
                for k in chosen
            ]
        )
        frequency = np.array([signal.frequency for signal in signals])
        return cls(
            ephemerides=ephemerides,
            satellites=satellites,
            satellite=np.repeat(
                np.arange(len(satellites)),
                [len(satellite_rows) for satellite_rows in rows_by_satellite],
            ),
            row=np.array(rows, dtype=np.intp),
            frequency=frequency,
            wavelength=SPEED_OF_LIGHT / frequency,
            chip_length=SPEED_OF_LIGHT / np.array([signal.chip_rate for signal in signals]),
            code_bias=delay + bias,
            broadcast_delay=delay,
            cn0_zenith_dbhz=np.array([receiver.cn0_zenith_dbhz[s.name] for s in signals]),
            system=np.array([link.system for link in chosen], dtype=np.uint8),
            prn=np.array([link.prn for link in chosen], dtype=np.uint8),
            band=np.array([signal.band for signal in signals], dtype=np.uint8),
            attribute=np.array([signal.attribute for signal in signals], dtype=np.uint8),
            stream=np.array([64 * system + prn for system, prn in satellites], dtype=np.int64),
            has_data=np.array([signal.has_data for signal in signals], dtype=bool),
            phase_centre_frequency=np.array(
                [antex_frequency(s.system, s.band) for s in signals], dtype=str
            ),
            upload_errors=tuple(map(constellation.upload_error, ephemerides)),
        )

    def cn0_dbhz(
        self,
        line_of_sight: SatelliteRays,
        receiver: ReceiverConfiguration,
        boresight_itrf: FloatArray | None = None,
    ) -> FloatArray:
        """Return C/N0 without scintillation and noise, dB-Hz, shape (k, m).

        Parameters
        ----------
        line_of_sight : SatelliteRays
            Shape (k, n).
        receiver : ReceiverConfiguration
        boresight_itrf : ndarray, shape (k, 3), optional
            Unit vectors along the boresight of the antenna; the zenith if absent.
        """
        gain = -20.0 * np.log10(line_of_sight.range / _REFERENCE_DISTANCE)
        if receiver.antenna is not None:
            off_boresight = 0.5 * math.pi - line_of_sight.elevation
            if boresight_itrf is not None:
                cosine = np.einsum("kni,ki->kn", line_of_sight.direction_itrf, boresight_itrf)
                off_boresight = np.arccos(np.clip(cosine, -1.0, 1.0))
            gain = gain + receiver.antenna.gain_db(off_boresight)
        return np.asarray(self.cn0_zenith_dbhz + gain[:, self.satellite])

    def antenna_delay(
        self,
        line_of_sight: SatelliteRays,
        body_axes_itrf: FloatArray,
        phase_centre: PhaseCentre,
    ) -> FloatArray:
        """Return what ranges are longer by than those from the antenna's reference point, (k, m).

        Parameters
        ----------
        line_of_sight : SatelliteRays
            Shape (k, n).
        body_axes_itrf : ndarray, shape (k, 3, 3)
            Rows are the x, y and z axes of the body.
        phase_centre : PhaseCentre
            Phase centre of the antenna, whose north, east and up axes are x, y and -z.
        """
        axes = body_axes_itrf * np.array([1.0, 1.0, -1.0])[:, None]
        directions = np.einsum("kai,kni->kna", axes, line_of_sight.direction_itrf)
        delay = np.empty((len(directions), len(self.row)))
        for frequency in set(self.phase_centre_frequency):
            links = np.flatnonzero(self.phase_centre_frequency == frequency)
            centre = phase_centre.maps[frequency]
            delay[:, links] = centre.delay(directions[:, self.satellite[links]])
        return delay

    def range_error(self, line_of_sight: SatelliteRays, orbit_errors: FloatArray) -> FloatArray:
        """Return the true range less that to the broadcast orbit and clock, m, shape (k, n).

        Parameters
        ----------
        line_of_sight : SatelliteRays
            To the broadcast orbits, shape (k, n).
        orbit_errors : ndarray, shape (k, n, 4)
            See `Constellation.orbit_errors`.
        """
        position = line_of_sight.position_satellite_itrf
        radial = position / np.linalg.norm(position, axis=-1, keepdims=True)
        normal = np.cross(position, line_of_sight.velocity_satellite_itrf)
        normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
        error = (
            orbit_errors[..., 0, None] * radial
            + orbit_errors[..., 1, None] * np.cross(normal, radial)
            + orbit_errors[..., 2, None] * normal
        )
        clock = orbit_errors[..., 3]
        if any(seconds or clock_upload for seconds, clock_upload in self.upload_errors):
            seconds_ahead, upload_clock = np.array(self.upload_errors).T
            inertial = line_of_sight.velocity_satellite_itrf + np.cross(_EARTH_ROTATION, position)
            error = error - seconds_ahead[:, None] * inertial
            clock = clock - upload_clock
        projected = np.einsum("...i,...i->...", error, line_of_sight.direction_itrf)
        return np.asarray(projected - clock)


@dataclass(frozen=True, eq=False)
class Sigmas:
    """Sigmas of code (m), phase (m) and Doppler (m/s), shape (k, m)."""

    code: FloatArray
    phase: FloatArray
    doppler: FloatArray

    def scaled(self, factor: float) -> Sigmas:
        """Return these sigmas times a factor."""
        return Sigmas(factor * self.code, factor * self.phase, factor * self.doppler)


@dataclass(frozen=True, eq=False)
class Observables:
    """Measurements of a receiver, shape (k, m).

    Parameters
    ----------
    pseudorange : ndarray
        m.
    carrier_phase_cycles : ndarray
        RINEX sign: grows with the range.
    doppler_hz : ndarray
    cn0_dbhz : ndarray
        As the receiver estimates it.
    sigmas : Sigmas
        Sigmas that the receiver states.
    multipath : tuple of 2 ndarray, or None
        Multipath of code and phase in the above, m; None where it is off.
    range_error : ndarray, shape (k, n), or None
        True range less that to the broadcast orbit and clock, m; None where they are the truth.
    """

    pseudorange: FloatArray
    carrier_phase_cycles: FloatArray
    doppler_hz: FloatArray
    cn0_dbhz: FloatArray
    sigmas: Sigmas
    multipath: tuple[FloatArray, FloatArray] | None = None
    range_error: FloatArray | None = None


class MeasurementNoise:
    """Noise of the measurements of one receiver.

    Parameters
    ----------
    model : NoiseModel
    links : sequence of Link
        All links of the receiver.
    seed, receiver : int
        Seed of the run, and number of the receiver.
    """

    def __init__(self, model: NoiseModel, links: Sequence[Link], seed: int, receiver: int) -> None:
        self._model = model
        addresses = link_addresses(links, receiver)
        self._fields: dict[Effect, NoiseField | GaussMarkovField] = {
            effect: NoiseField(seed, effect, addresses) for effect in _NOISE_EFFECTS
        }
        if model.is_coloured:
            # A first-order loop of noise bandwidth B passes 1 / (1 + s / (4 B)) (Kaplan and Hegarty
            # 2006, table 5.6): white noise leaves it with the autocorrelation exp(-4 B |t|).
            for effect, bandwidth_hz in (
                (Effect.CODE_NOISE, model.code_loop_bandwidth_hz),
                (Effect.PHASE_NOISE, model.phase_loop_bandwidth_hz),
            ):
                correlation_time = 1.0 / (4.0 * bandwidth_hz)
                self._fields[effect] = GaussMarkovField(seed, effect, addresses, correlation_time)

    @property
    def is_on(self) -> bool:
        """Whether there is noise."""
        return self._model.model != "none"

    def drawn(
        self, effect: Effect, second: int, rows: npt.NDArray[np.intp], emitted: slice
    ) -> FloatArray:
        """Return noise of unit variance, shape (k, m)."""
        return self._fields[effect].second(second, rows)[emitted]

    def stated(self, sigmas: Sigmas) -> Sigmas:
        """Return what the receiver states for true sigmas."""
        factor = self._model.stated_sigma_factor
        return sigmas if factor == 1.0 else sigmas.scaled(factor)

    def sigmas(
        self, cn0_dbhz: FloatArray, wavelength: FloatArray, chip_length: FloatArray
    ) -> Sigmas:
        """Return the true sigmas, shape (k, m); those that there would be if noise is off.

        References
        ----------
        Kaplan and Hegarty (2006), Understanding GPS, eq. 5.6 (PLL thermal noise) and 5.14
        (non-coherent early-late DLL). Doppler: difference of two phases 0.05 s apart.
        """
        model = self._model
        if model.model == "fixed":
            whole = np.ones(cn0_dbhz.shape)
            return Sigmas(
                model.code_sigma * whole, model.phase_sigma * whole, model.doppler_sigma * whole
            )
        ratio = 10.0 ** (0.1 * cn0_dbhz)
        spacing = model.correlator_spacing_chips
        squaring = 1.0 + 1.0 / (2.0 * model.integration_time * ratio)
        phase = (
            wavelength / (2.0 * math.pi) * np.sqrt(model.phase_loop_bandwidth_hz / ratio * squaring)
        )
        code = chip_length * np.sqrt(
            model.code_loop_bandwidth_hz
            * spacing
            / (2.0 * ratio)
            * (1.0 + 2.0 / ((2.0 - spacing) * model.integration_time * ratio))
        )
        return Sigmas(code, phase, np.full(cn0_dbhz.shape, model.doppler_sigma))

    @staticmethod
    def noisy_cn0_dbhz(cn0_dbhz: FloatArray, noise: FloatArray) -> FloatArray:
        """Return C/N0 as estimated from the power of 0.05 s.

        The relative sigma of the power is sqrt(2 / (C/N0 T)), the noise floor of S4.
        """
        ratio = 10.0 ** (0.1 * cn0_dbhz)
        relative = np.maximum(1.0 + np.sqrt(2.0 / (0.05 * ratio)) * noise, 0.01)
        return np.asarray(cn0_dbhz + 10.0 * np.log10(relative))


class Multipath:
    """Code and phase multipath of all links of one receiver, see `MultipathModel`.

    Parameters
    ----------
    configuration : ReceiverConfiguration
    links : sequence of Link
    seed, receiver : int
    """

    def __init__(
        self, configuration: ReceiverConfiguration, links: Sequence[Link], seed: int, receiver: int
    ) -> None:
        self._model = configuration.multipath
        addresses = link_addresses(links, receiver)
        self._processes = {
            effect: GaussMarkovField(seed, effect, addresses, self._model.correlation_time)
            for effect in (Effect.CODE_MULTIPATH, Effect.PHASE_MULTIPATH)
        }
        draws = np.zeros((len(links), 3))
        if self._has_sinusoids:
            for row, address in enumerate(addresses):
                draws[row] = generator(seed, Effect.MULTIPATH, *address).random(3)
        self._rate = 2.0 * math.pi / (self._model.period * (0.7 + 0.6 * draws[:, 0]))
        self._phases = 2.0 * math.pi * draws[:, 1:]

    @property
    def is_on(self) -> bool:
        """Whether there is multipath."""
        return self._has_sinusoids or self._has_processes

    @property
    def _has_sinusoids(self) -> bool:
        return self._model.code_amplitude > 0.0 or self._model.phase_amplitude > 0.0

    @property
    def _has_processes(self) -> bool:
        return self._model.code_sigma > 0.0 or self._model.phase_sigma > 0.0

    def errors(
        self,
        second: int,
        emitted: slice,
        elevation: FloatArray,
        cn0_loss_db: FloatArray,
        rows: npt.NDArray[np.intp],
    ) -> tuple[FloatArray, FloatArray]:
        """Return errors of code and phase, m, shape (k, m).

        Parameters
        ----------
        second : int
            Number of the second.
        emitted : slice
            Its k epochs.
        elevation : ndarray, shape (k, m)
            rad.
        cn0_loss_db : ndarray, shape (k, m)
            C/N0 at boresight less C/N0.
        rows : ndarray of int, shape (m,)
            Links.
        """
        code, phase = np.zeros(elevation.shape), np.zeros(elevation.shape)
        if self._has_sinusoids:
            elapsed = second + _TAGS[emitted]
            code, phase = self._sinusoids(elapsed, elevation, rows)
        if self._has_processes:
            size = np.ones(elevation.shape)
            if self._model.elevation_model == "cosine":
                size = np.cos(elevation)
            if self._model.follows_cn0:
                size = size * np.clip(10.0 ** (cn0_loss_db / 20.0), 1.0, _LARGEST_MULTIPATH_FACTOR)
            drawn_code, drawn_phase = (
                self._processes[effect].second(second, rows)[emitted]
                for effect in (Effect.CODE_MULTIPATH, Effect.PHASE_MULTIPATH)
            )
            code = code + self._model.code_sigma * size * drawn_code
            phase = phase + self._model.phase_sigma * size * drawn_phase
        return code, phase

    def _sinusoids(
        self, elapsed: FloatArray, elevation: FloatArray, rows: npt.NDArray[np.intp]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the sinusoids of code and phase, m, shape (k, m), at times into the run (k,)."""
        argument = elapsed[:, None] * self._rate[rows]
        size = np.cos(elevation)
        first, second = self._phases[rows].T
        code = self._model.code_amplitude * size * np.sin(argument + first)
        phase = self._model.phase_amplitude * size * np.sin(argument + second)
        return code, phase


class LineBiasDrift:
    """Drifts of the line biases of one receiver, see `BiasDriftModel`.

    Parameters
    ----------
    configuration : ReceiverConfiguration
    links : sequence of Link
        All links of the receiver; those of one signal share its line.
    seed, receiver : int
    """

    def __init__(
        self, configuration: ReceiverConfiguration, links: Sequence[Link], seed: int, receiver: int
    ) -> None:
        self._model = configuration.bias_drift
        lines = signals_of(configuration)
        addresses = [(receiver, s.system, s.band, s.attribute) for s in lines]
        self._processes = {
            effect: GaussMarkovField(seed, effect, addresses, self._model.correlation_time)
            for effect in (Effect.CODE_LINE_BIAS, Effect.PHASE_LINE_BIAS)
        }
        self._lines = np.arange(len(lines))
        self._line = np.array([lines.index(k.signal) for k in links], dtype=np.intp)

    @property
    def is_on(self) -> bool:
        """Whether the biases drift."""
        return self._model.code_sigma > 0.0 or self._model.phase_sigma > 0.0

    def errors(
        self, second: int, emitted: slice, rows: npt.NDArray[np.intp]
    ) -> tuple[FloatArray, FloatArray]:
        """Return what code and phase of links are longer by, m, shape (k, m)."""
        code, phase = (
            self._processes[effect].second(second, self._lines)[emitted][:, self._line[rows]]
            for effect in (Effect.CODE_LINE_BIAS, Effect.PHASE_LINE_BIAS)
        )
        return self._model.code_sigma * code, self._model.phase_sigma * phase


def link_addresses(links: Sequence[Link], receiver: int) -> list[tuple[int, ...]]:
    """Return the address of each link of a receiver in the random streams."""
    return [(receiver, k.system, k.prn, k.signal.band, k.signal.attribute) for k in links]


def signals_of(configuration: ReceiverConfiguration) -> list[Signal]:
    """Return the signals that a receiver tracks."""
    return [SIGNALS[name] for name in configuration.cn0_zenith_dbhz]
