"""The satellites of a run, and the lines of sight of one receiver to those near its horizon."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import (
    EPHEMERIS_SOURCE_FNAV,
    EPHEMERIS_SOURCE_LNAV,
    SYSTEM_GALILEO,
)
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.ionosphere_parameters import KlobucharParameters
from vtff_gnss.novatel.encode.lnav import quantize_lnav
from vtff_gnss.orbits.broadcast_orbit import EphemerisTable
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.interpolated_orbit import InterpolatedOrbits
from vtff_gnss.orbits.line_of_sight import LineOfSight, lines_of_sight
from vtff_gnss.orbits.nominal_constellation import (
    nominal_galileo_constellation,
    nominal_gps_constellation,
)
from vtff_gnss.orbits.yuma import read_yuma
from vtff_gnss.rinex.navigation import read_rinex_navigation
from vtff_sim_bridge.gnss.configuration import ConstellationConfiguration
from vtff_sim_bridge.gnss.random_streams import Effect, generator

__all__ = ["Constellation", "Sky", "fnav_ephemeris"]

_ALMANAC_SUFFIXES = (".yuma", ".alm", ".txt")
# Elevations change by 0.1 deg/s in low orbits.
_REFRESH_SECONDS = 10
_CANDIDATE_MARGIN = math.radians(2.5)


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
        # Orbits and clocks are those of the message as sent, so that receivers decode the truth.
        self._store = EphemerisStore(
            quantize_lnav(e) if e.source == EPHEMERIS_SOURCE_LNAV else e
            for e in self._read(configuration, start, end)
            if e.system in systems
        )
        self._seed = seed
        self._configuration = configuration
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

    def orbit_error(self, system: int, prn: int) -> FloatArray:
        """Return true less broadcast orbit (radial, along-track, normal) and clock, m, (4,)."""
        configuration = self._configuration
        draws = generator(self._seed, Effect.ORBIT_ERROR, system, prn).standard_normal(4)
        sigma = (configuration.orbit_error_sigma,) * 3 + (configuration.clock_error_sigma,)
        return np.asarray(draws * np.array(sigma))

    @property
    def has_errors(self) -> bool:
        """Whether satellites are elsewhere than they broadcast."""
        configuration = self._configuration
        return configuration.orbit_error_sigma > 0.0 or configuration.clock_error_sigma > 0.0

    def signal_bias(self, system: int, prn: int, band: int, attribute: int) -> float:
        """Return the bias of a signal beyond the broadcast group delays, m."""
        sigma = self._configuration.inter_signal_sigma
        stream = generator(self._seed, Effect.SATELLITE_BIAS, system, prn, band, attribute)
        return sigma * float(stream.standard_normal())


@dataclass(frozen=True, eq=False)
class Sky:
    """Satellites near or above the horizon of a receiver.

    Parameters
    ----------
    full_table : EphemerisTable
        All satellites.
    table : EphemerisTable
        The candidates.
    orbits : InterpolatedOrbits
        Orbits of the candidates.
    """

    full_table: EphemerisTable
    table: EphemerisTable
    orbits: InterpolatedOrbits

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
        seen = lines_of_sight(full, time, 0.0, position_itrf, np.zeros(3))
        rows = np.flatnonzero(seen.elevation > elevation_mask - _CANDIDATE_MARGIN)
        chosen = tuple(full.ephemerides[row] for row in rows.tolist())
        if sky is not None and is_same_table and chosen == sky.table.ephemerides:
            return sky
        table = EphemerisTable(chosen)
        return cls(full, table, InterpolatedOrbits(table))

    def lines_of_sight(
        self,
        time: GpsTime,
        offset: FloatArray,
        position_itrf: FloatArray,
        velocity_itrf: FloatArray,
    ) -> LineOfSight:
        """Return the lines of sight at times of reception ``time + offset``, shapes (k, n)."""
        return lines_of_sight(self.orbits, time, offset, position_itrf, velocity_itrf)


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
