"""The links of a receiver, and their constants while it sees the same satellites."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import EARTH_ROTATION_RATE, SPEED_OF_LIGHT
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.antenna_pattern import ParabolicPattern, parabolic_gain_db
from vtff_gnss.antex import PhaseCentre, antex_frequency
from vtff_gnss.constants import (
    DELAY_PER_TECU,
    SYSTEM_GALILEO,
    SYSTEM_GPS,
)
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.orbits.line_of_sight import LineOfSight
from vtff_gnss.signals import satellite_name
from vtff_sim_bridge.gnss.configuration import ReceiverConfiguration
from vtff_sim_bridge.gnss.signal_table import SIGNALS, Signal, clock_group_delay
from vtff_sim_bridge.gnss.sky import Constellation, Sky, UploadError

__all__ = ["Link", "LinkPlan", "all_links", "link_addresses", "link_rows", "signals_of"]

_REFERENCE_DISTANCE = 20.2e6
_EARTH_ROTATION = np.array([0.0, 0.0, EARTH_ROTATION_RATE])
_NO_ANTENNA = ParabolicPattern(boresight_gain_db=0.0, front_to_back_db=0.0)
_SATELLITES = {SYSTEM_GPS: 32, SYSTEM_GALILEO: 36}


@dataclass(frozen=True)
class Link:
    """A signal of a satellite as a receiver may track it."""

    system: int
    prn: int
    signal: Signal


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
    glonass_channel : ndarray of int8
        Zero, as for all other systems.
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
    glonass_channel: npt.NDArray[np.int8]
    stream: npt.NDArray[np.int64]
    has_data: npt.NDArray[np.bool_]
    phase_centre_frequency: npt.NDArray[np.str_]
    upload_errors: tuple[UploadError, ...]

    @cached_property
    def satellite_names(self) -> list[str]:
        """Names of the satellites, such as ``"G05"``."""
        return [satellite_name(*satellite) for satellite in self.satellites]

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
            glonass_channel=np.zeros(len(chosen), dtype=np.int8),
            stream=np.array([64 * system + prn for system, prn in satellites], dtype=np.int64),
            has_data=np.array([signal.has_data for signal in signals], dtype=bool),
            phase_centre_frequency=np.array(
                [antex_frequency(s.system, s.band) for s in signals], dtype=str
            ),
            upload_errors=tuple(map(constellation.upload_error, ephemerides)),
        )

    def levels_and_delays(
        self,
        line_of_sight: LineOfSight,
        slant_tec_tecu: FloatArray,
        receiver: ReceiverConfiguration,
        boresight_itrf: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return C/N0 without scintillation and noise, and the delays of the ionosphere.

        Parameters
        ----------
        line_of_sight : LineOfSight
            Shape (k, n).
        slant_tec_tecu : ndarray, shape (k, n)
            TECU.
        receiver : ReceiverConfiguration
        boresight_itrf : ndarray, shape (k, 3), optional
            Unit vectors along the boresight of the antenna; the zenith if absent.

        Returns
        -------
        cn0_dbhz, code_delay, phase_delay : ndarray, shape (k, m)
            dB-Hz; what is added to the code and carrier ranges, m. The code is delayed by as much
            as the phase is advanced.
        """
        off_boresight = 0.5 * math.pi - line_of_sight.elevation
        if receiver.antenna is not None and boresight_itrf is not None:
            cosine = np.einsum("kni,ki->kn", line_of_sight.direction_itrf, boresight_itrf)
            off_boresight = np.arccos(np.clip(cosine, -1.0, 1.0))
        antenna = receiver.antenna or _NO_ANTENNA
        cn0_dbhz, code_delay, phase_delay = _levels_and_delays(
            line_of_sight.range,
            off_boresight,
            antenna.boresight_gain_db,
            antenna.half_power_beamwidth,
            antenna.front_to_back_db,
            slant_tec_tecu,
            self.satellite,
            self.cn0_zenith_dbhz,
            self.frequency,
        )
        return cn0_dbhz, code_delay, phase_delay

    def antenna_delay(
        self,
        line_of_sight: LineOfSight,
        body_axes_itrf: FloatArray,
        phase_centre: PhaseCentre,
    ) -> FloatArray:
        """Return what ranges are longer by than those from the antenna's reference point, (k, m).

        Parameters
        ----------
        line_of_sight : LineOfSight
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

    def range_error(self, line_of_sight: LineOfSight, orbit_errors: FloatArray) -> FloatArray:
        """Return the true range less that to the broadcast orbit and clock, m, shape (k, n).

        Parameters
        ----------
        line_of_sight : LineOfSight
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


def link_addresses(links: Sequence[Link], receiver: int) -> list[tuple[int, ...]]:
    """Return the address of each link of a receiver in the random streams."""
    return [(receiver, k.system, k.prn, k.signal.band, k.signal.attribute) for k in links]


def signals_of(configuration: ReceiverConfiguration) -> list[Signal]:
    """Return the signals that a receiver tracks."""
    return [SIGNALS[name] for name in configuration.cn0_zenith_dbhz]


@compiled
def _levels_and_delays(  # type: ignore[no-untyped-def]
    distance,
    off_boresight,
    boresight_gain_db,
    half_power_beamwidth,
    front_to_back_db,
    slant_tec_tecu,
    satellite,
    cn0_zenith_dbhz,
    frequency,
):
    """Return C/N0 and delays of links, see `LinkPlan.levels_and_delays`.

    Distances (m), angles from boresight (rad) and contents (TECU) have shape (k, n).

    References
    ----------
    IERS Conventions (2010), eq. (9.27), first order.
    """
    epochs, satellites = distance.shape
    links = len(satellite)
    cn0_dbhz = np.empty((epochs, links))
    code_delay, phase_delay = np.empty((epochs, links)), np.empty((epochs, links))
    gain_db, delay = np.empty(satellites), np.empty(satellites)
    for k in range(epochs):
        for n in range(satellites):
            loss_db = -20.0 * math.log10(distance[k, n] / _REFERENCE_DISTANCE)
            gain_db[n] = loss_db + parabolic_gain_db(
                off_boresight[k, n], boresight_gain_db, half_power_beamwidth, front_to_back_db
            )
            delay[n] = DELAY_PER_TECU * slant_tec_tecu[k, n]
        for m in range(links):
            cn0_dbhz[k, m] = cn0_zenith_dbhz[m] + gain_db[satellite[m]]
            code_delay[k, m] = delay[satellite[m]] / (frequency[m] * frequency[m])
            phase_delay[k, m] = -code_delay[k, m]
    return cn0_dbhz, code_delay, phase_delay
