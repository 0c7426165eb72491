"""Pseudorange, carrier phase, Doppler and C/N0 of all links of a receiver over a second."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.vectors import FloatArray
from vtff_sim_bridge.gnss.configuration import NoiseModel, ReceiverConfiguration
from vtff_sim_bridge.gnss.link_plan import Link, link_addresses, signals_of
from vtff_sim_bridge.noise.gauss_markov import GaussMarkovField
from vtff_sim_bridge.noise.random_streams import (
    EPOCHS_PER_SECOND,
    Effect,
    EpochField,
    NoiseField,
    generator,
)

__all__ = [
    "LineBiasDrift",
    "MeasurementNoise",
    "Multipath",
    "Observables",
    "Sigmas",
    "observe",
]

# Below a tenth of its amplitude at boresight the direct signal is lost in most receivers.
_LARGEST_MULTIPATH_FACTOR = 10.0
_TAGS = np.arange(1 - EPOCHS_PER_SECOND, 1) / EPOCHS_PER_SECOND
# The estimate of C/N0 is from the power of so many s.
_POWER_TIME = 0.05
_NO_NOISE = np.empty((0, 0))
_NOISE_EFFECTS = (
    Effect.CODE_NOISE,
    Effect.PHASE_NOISE,
    Effect.DOPPLER_NOISE,
    Effect.CN0_NOISE,
)


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
        self._fixed: Sigmas | None = None
        addresses = link_addresses(links, receiver)
        self._fields: dict[Effect, EpochField] = {
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

    def of_all_links(
        self, second: int, rows: npt.NDArray[np.intp]
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return noise of unit variance of code, phase, Doppler and C/N0, shape (links, 20).

        Only that of the links `rows` is true; empty arrays if noise is off.
        """
        if self._model.model == "none":
            return (_NO_NOISE,) * 4
        code, phase, doppler, cn0 = (
            self._fields[effect].of_all_links(second, rows) for effect in _NOISE_EFFECTS
        )
        return code, phase, doppler, cn0

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
            if self._fixed is None or self._fixed.code.shape != cn0_dbhz.shape:
                sizes = (model.code_sigma, model.phase_sigma, model.doppler_sigma)
                self._fixed = Sigmas(*(np.full(cn0_dbhz.shape, size) for size in sizes))
            return self._fixed
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


@compiled
def observe(  # type: ignore[no-untyped-def]
    clock_offset,
    clock_drift,
    distance,
    distance_rate,
    clock_offset_satellite,
    clock_drift_satellite,
    satellite,
    row,
    code_bias,
    wavelength,
    range_terms,
    code_terms,
    phase_terms,
    code_delay,
    phase_delay,
    last_phase_delay,
    cycles,
    cn0_dbhz,
    sigma_code,
    sigma_phase,
    sigma_doppler,
    noise_code,
    noise_phase,
    noise_doppler,
    noise_cn0,
    first,
    ten,
):
    """Return pseudorange (m), phase (cycles), Doppler (Hz) and C/N0 (dB-Hz), shape (4, k, m).

    Parameters
    ----------
    clock_offset, clock_drift : ndarray, shape (k,)
        Clock of the receiver, s, s/s.
    distance, distance_rate : ndarray, shape (k, n)
        m, m/s.
    clock_offset_satellite, clock_drift_satellite : ndarray, shape (k, n)
        s, s/s.
    satellite, row : ndarray of int, shape (m,)
        Column of each link, and its place among all links.
    code_bias, wavelength : ndarray, shape (m,)
        m.
    range_terms : ndarray, shape (any, k, n)
        Further parts of the ranges, m.
    code_terms, phase_terms : ndarray, shape (any, k, m)
        Further parts of code and carrier ranges, m.
    code_delay, phase_delay : ndarray, shape (k, m)
        What the ionosphere delays code and phase by, m.
    last_phase_delay : ndarray, shape (links,)
        That of the epoch before of all links, NaN where there was none, m; is changed to that of
        the last epoch.
    cycles : ndarray, shape (k, m)
        By which the phase differs from the carrier range.
    cn0_dbhz : ndarray, shape (k, m)
    sigma_code, sigma_phase, sigma_doppler : ndarray, shape (k, m)
        m, m, m/s.
    noise_code, noise_phase, noise_doppler, noise_cn0 : ndarray, shape (links, 20)
        Noise of unit variance; empty if there is none.
    first : int
        Index of the first epoch in the second.
    ten : float
        10; as a constant it would make another power of it.
    """
    epochs, satellites = distance.shape
    links = len(satellite)
    result = np.empty((4, epochs, links))
    ranges, rates = np.empty(satellites), np.empty(satellites)
    before = last_phase_delay[row]
    for k in range(epochs):
        to_receiver_time = 1.0 - clock_drift[k]
        for n in range(satellites):
            ranges[n] = distance[k, n] + SPEED_OF_LIGHT * (
                clock_offset[k] - clock_offset_satellite[k, n]
            )
            for t in range(len(range_terms)):
                ranges[n] += range_terms[t, k, n]
            satellite_drift = clock_drift_satellite[k, n] * (
                1.0 - distance_rate[k, n] / SPEED_OF_LIGHT
            )
            rate = (distance_rate[k, n] - SPEED_OF_LIGHT * satellite_drift) * to_receiver_time
            rates[n] = rate + SPEED_OF_LIGHT * clock_drift[k]
        for m in range(links):
            n = satellite[m]
            pseudorange = ranges[n] + code_delay[k, m] + code_bias[m]
            carrier = ranges[n] + phase_delay[k, m]
            for t in range(len(code_terms)):
                pseudorange += code_terms[t, k, m]
                carrier += phase_terms[t, k, m]
            change = (phase_delay[k, m] - before[m]) * EPOCHS_PER_SECOND
            before[m] = phase_delay[k, m]
            rate = rates[n]
            if not math.isnan(change):
                rate += change
            cn0 = cn0_dbhz[k, m]
            if len(noise_code):
                i, epoch = row[m], first + k
                pseudorange += sigma_code[k, m] * noise_code[i, epoch]
                carrier += sigma_phase[k, m] * noise_phase[i, epoch]
                rate += sigma_doppler[k, m] * noise_doppler[i, epoch]
                # The relative sigma of the power is sqrt(2 / (C/N0 T)), the noise floor of S4.
                ratio = ten ** (0.1 * cn0)
                relative = 1.0 + math.sqrt(2.0 / (_POWER_TIME * ratio)) * noise_cn0[i, epoch]
                cn0 += 10.0 * math.log10(max(relative, 0.01))
            result[0, k, m] = pseudorange
            result[1, k, m] = carrier / wavelength[m] + cycles[k, m]
            result[2, k, m] = -rate / wavelength[m]
            result[3, k, m] = cn0
    last_phase_delay[:] = np.nan
    for m in range(links):
        last_phase_delay[row[m]] = before[m]
    return result
