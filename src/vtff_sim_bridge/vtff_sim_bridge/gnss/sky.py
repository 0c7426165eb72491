"""The satellites of a run, and the lines of sight of one receiver to those near its horizon."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import (
    EPHEMERIS_SOURCE_FNAV,
    EPHEMERIS_SOURCE_LNAV,
    GRAVITATIONAL_PARAMETER_BROADCAST,
    SYSTEM_GALILEO,
)
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.ionosphere_parameters import KlobucharParameters
from vtff_gnss.novatel.encode.lnav import quantize_lnav
from vtff_gnss.orbits.broadcast_orbit import EphemerisTable
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.line_of_sight import lines_of_sight
from vtff_gnss.orbits.nominal_constellation import (
    nominal_galileo_constellation,
    nominal_gps_constellation,
)
from vtff_gnss.orbits.yuma import read_yuma
from vtff_gnss.rinex.navigation import read_rinex_navigation
from vtff_sim_bridge.gnss.configuration import ConstellationConfiguration
from vtff_sim_bridge.noise.gauss_markov import SlowGaussMarkov
from vtff_sim_bridge.noise.random_streams import Effect, generator

__all__ = ["Constellation", "Sky", "UploadError", "fnav_ephemeris"]

_ALMANAC_SUFFIXES = (".yuma", ".alm", ".txt")
# Elevations change by 0.1 deg/s in low orbits.
_REFRESH_SECONDS = 10
_CANDIDATE_MARGIN = math.radians(2.5)


class UploadError(NamedTuple):
    """Error of a broadcast ephemeris: broadcast less correct orbit and clock.

    Parameters
    ----------
    seconds_ahead : float
        By which the broadcast satellite is ahead on its orbit, s.
    clock : float
        m.
    """

    seconds_ahead: float
    clock: float


class Constellation:
    """Broadcast ephemerides of a run, and the errors that satellites have beyond them.

    Parameters
    ----------
    configuration : ConstellationConfiguration
    start, end : GpsTime
        The run.
    systems : set of int
        ``SYSTEM_*`` that receivers track.
    seed : int
        Seed of the run.

    Attributes
    ----------
    klobuchar : KlobucharParameters or None
        Ionospheric parameters that the satellites broadcast.

    Raises
    ------
    ValueError, OSError
        If the file cannot be used or tells nothing about the start of the run.
    """

    def __init__(
        self,
        configuration: ConstellationConfiguration,
        start: GpsTime,
        end: GpsTime,
        systems: set[int],
        seed: int,
    ) -> None:
        self.klobuchar: KlobucharParameters | None = None
        self._seed = seed
        self._start = start
        self._configuration = configuration
        self._drifts: dict[tuple[int, int], SlowGaussMarkov] = {}
        self._signal_biases: dict[tuple[int, int, int, int], float] = {}
        self._upload_errors: dict[tuple[int, int, int, int, float], UploadError] = {}
        # Orbits and clocks are those of the message as sent, so that receivers decode the truth.
        self._store = EphemerisStore(
            self._sent(e) for e in self._read(configuration, start, end) if e.system in systems
        )
        if not len(self._store.table(start)):
            raise ValueError(f"{configuration.source}: no ephemeris is valid at {start}")

    def _read(
        self, configuration: ConstellationConfiguration, start: GpsTime, end: GpsTime
    ) -> Sequence[BroadcastEphemeris]:
        source = configuration.source
        if source == "nominal":
            gps = nominal_gps_constellation(start, end, configuration.seed)
            return (*gps, *nominal_galileo_constellation(start, end, configuration.seed))
        if Path(source).suffix.lower() in _ALMANAC_SUFFIXES:
            return read_yuma(source, start)
        navigation = read_rinex_navigation(source)
        self.klobuchar = navigation.klobuchar
        return navigation.ephemerides

    def table(self, time: GpsTime) -> EphemerisTable:
        """Return the ephemerides in use at a time; the same object while none changes."""
        return self._store.table(time)

    def _sent(self, ephemeris: BroadcastEphemeris) -> BroadcastEphemeris:
        """Return an ephemeris as it is broadcast: with the error of its upload, and quantised."""

        def quantized(e: BroadcastEphemeris) -> BroadcastEphemeris:
            return quantize_lnav(e) if e.source == EPHEMERIS_SOURCE_LNAV else e

        correct = quantized(ephemeris)
        sigma = self._configuration.upload_error_sigma
        if sigma == 0.0:
            return correct
        e = ephemeris
        address = (e.system, e.prn, e.source, e.gps_week, int(e.toe))
        draws = generator(self._seed, Effect.EPHEMERIS_UPLOAD, *address).standard_normal(2)
        along, clock = (sigma * draws).tolist()
        sent = quantized(
            replace(
                e,
                mean_anomaly=math.remainder(
                    e.mean_anomaly + along / e.semi_major_axis, 2.0 * math.pi
                ),
                af0=e.af0 + clock / SPEED_OF_LIGHT,
            )
        )
        mean_motion = math.sqrt(GRAVITATIONAL_PARAMETER_BROADCAST[e.system] / e.semi_major_axis**3)
        advance = math.remainder(sent.mean_anomaly - correct.mean_anomaly, 2.0 * math.pi)
        self._upload_errors[_ephemeris_key(sent)] = UploadError(
            seconds_ahead=advance / mean_motion,
            clock=SPEED_OF_LIGHT * (sent.af0 - correct.af0),
        )
        return sent

    def orbit_errors(
        self, satellites: Sequence[tuple[int, int]], elapsed: npt.ArrayLike
    ) -> FloatArray:
        """Return true less correctly uploaded orbit and clock at times into the run.

        Parameters
        ----------
        satellites : sequence of (int, int)
            System and number of the n satellites.
        elapsed : array_like, shape (k,)
            s.

        Returns
        -------
        ndarray, shape (k, n, 4)
            Orbit (radial, along-track, normal) and clock, m. What uploads are off by is told by
            `upload_error`.
        """
        configuration = self._configuration
        sigma = (configuration.orbit_error_sigma,) * 3 + (configuration.clock_error_sigma,)
        times = np.asarray(elapsed, dtype=float)
        draws = np.empty((len(times), len(satellites), 4))
        for column, satellite in enumerate(satellites):
            if configuration.error_correlation_time == 0.0:
                stream = generator(self._seed, Effect.ORBIT_ERROR, *satellite)
                draws[:, column] = stream.standard_normal(4)
                continue
            if satellite not in self._drifts:
                self._drifts[satellite] = SlowGaussMarkov(
                    self._seed,
                    Effect.ORBIT_DRIFT,
                    satellite,
                    4,
                    configuration.error_correlation_time,
                )
            draws[:, column] = self._drifts[satellite].at(times)
        return np.asarray(draws * np.array(sigma))

    def upload_error(self, ephemeris: BroadcastEphemeris) -> UploadError:
        """Return what a broadcast ephemeris is off by since its upload."""
        return self._upload_errors.get(_ephemeris_key(ephemeris), UploadError(0.0, 0.0))

    @property
    def has_errors(self) -> bool:
        """Whether satellites are elsewhere than they broadcast."""
        configuration = self._configuration
        return (
            configuration.orbit_error_sigma > 0.0
            or configuration.clock_error_sigma > 0.0
            or configuration.upload_error_sigma > 0.0
        )

    def signal_bias(self, system: int, prn: int, band: int, attribute: int) -> float:
        """Return the bias of a signal beyond the broadcast group delays, m."""
        signal = (system, prn, band, attribute)
        if signal not in self._signal_biases:
            stream = generator(self._seed, Effect.SATELLITE_BIAS, *signal)
            sigma = self._configuration.inter_signal_sigma
            self._signal_biases[signal] = sigma * float(stream.standard_normal())
        return self._signal_biases[signal]


def _ephemeris_key(e: BroadcastEphemeris) -> tuple[int, int, int, int, float]:
    return (e.system, e.prn, e.source, e.gps_week, e.toe)


@dataclass(frozen=True, eq=False)
class Sky:
    """Satellites near or above the horizon of a receiver.

    Parameters
    ----------
    full_table : EphemerisTable
        All satellites.
    table : EphemerisTable
        The candidates.
    """

    full_table: EphemerisTable
    table: EphemerisTable

    @classmethod
    def refresh(
        cls,
        sky: Sky | None,
        constellation: Constellation,
        time: GpsTime,
        position_itrf: npt.ArrayLike,
        elevation_mask: float,
    ) -> Sky:
        """Return the satellites for the next second, `sky` itself if they are the same.

        Parameters
        ----------
        sky : Sky or None
            The sky of the second before.
        constellation : Constellation
        time : GpsTime
            End of the second: a whole one.
        position_itrf : array_like, shape (3,)
            Receiver, m.
        elevation_mask : float
            rad.
        """
        full = constellation.table(time)
        is_same_table = sky is not None and sky.full_table is full
        if sky is not None and is_same_table and int(time.time_of_week) % _REFRESH_SECONDS:
            return sky
        position = np.asarray(position_itrf, dtype=float)[None]
        seen = lines_of_sight(full, time, np.zeros(1), position, np.zeros((1, 3)))
        rows = np.flatnonzero(seen.elevation[0] > elevation_mask - _CANDIDATE_MARGIN)
        chosen = tuple(full.ephemerides[row] for row in rows.tolist())
        if sky is not None and is_same_table and chosen == sky.table.ephemerides:
            return sky
        return cls(full, EphemerisTable(chosen))


def fnav_ephemeris(ephemeris: BroadcastEphemeris) -> BroadcastEphemeris:
    """Return the F/NAV set that says the same as an I/NAV set, with the clock of E1/E5a.

    Raises
    ------
    ValueError
        If it is not of Galileo.
    """
    if ephemeris.system != SYSTEM_GALILEO:
        raise ValueError("ephemeris: Galileo is required")
    return replace(
        ephemeris,
        source=EPHEMERIS_SOURCE_FNAV,
        af0=ephemeris.af0 + ephemeris.group_delay - ephemeris.group_delay_secondary,
        group_delay_secondary=0.0,
    )
