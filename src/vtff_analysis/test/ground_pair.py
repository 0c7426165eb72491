"""Two receivers at rest as RINEX files: troposphere, thermal noise, ground reflections.

Nothing here is shared with the filter. The troposphere is a zenith delay that falls off with the
height, hydrostatic and wet, with the mapping of a spherical shell; multipath is one reflection
from flat ground below each antenna, whose size follows from the pattern of the antenna
(Georgiadou and Kleusberg 1988, manuscripta geodaetica 13, 172). It does not follow the rule
``a^2 + (b / sin E)^2`` that the filter takes for it.
"""

from __future__ import annotations

import math
import pathlib
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.frames.geodetic import itrf_from_geodetic, rotation_itrf_to_enu
from vtff_dynamics.time.timescales import parse_epoch
from vtff_gnss import constants as c
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.line_of_sight import lines_of_sight
from vtff_gnss.orbits.nominal_constellation import nominal_gps_constellation
from vtff_gnss.rinex.write.navigation import write_rinex_navigation
from vtff_gnss.rinex.write.observation import write_rinex_observation
from vtff_gnss.signals import carrier_frequency_hz

SIGNALS = ((1, "C"), (2, "W"))
BASELINE_ENU = (1600.0, 1200.0, 40.0)
LOWEST_ELEVATION = math.radians(8.0)
#: Zenith delays at height 0, m, and the heights over which they fall by a factor of e, m.
HYDROSTATIC, WET = (2.31, 8000.0), (0.17, 2000.0)
SHELL_HEIGHT, EARTH_RADIUS = 5000.0, 6371e3
#: Heights of the antennas of base and rover above the ground, m.
ANTENNA_HEIGHTS = (2.1, 1.4)


@dataclass(frozen=True)
class GroundPair:
    """Files of a pair, and its truth.

    Parameters
    ----------
    rover, base, navigation : Path
    base_itrf, baseline_itrf : ndarray, shape (3,)
        Position of the base and rover less base, m.
    """

    rover: pathlib.Path
    base: pathlib.Path
    navigation: pathlib.Path
    base_itrf: np.ndarray
    baseline_itrf: np.ndarray

    def errors_enu(self, baselines_itrf: np.ndarray) -> np.ndarray:
        """Return the errors of baselines to east, north and up, m, shape (n, 3)."""
        return (baselines_itrf - self.baseline_itrf) @ rotation_itrf_to_enu(self.base_itrf).T


def write_pair(
    folder: pathlib.Path,
    seed: int,
    epochs: int,
    interval: float = 5.0,
    phase_sigma: float = 0.001,
    code_sigma: float = 0.3,
    reflection: float = 0.0,
    baseline_enu: tuple[float, float, float] = BASELINE_ENU,
    content_tecu: float = 0.0,
) -> GroundPair:
    """Write the files of a pair at a place and time drawn by the seed.

    Parameters
    ----------
    folder : Path
    seed, epochs : int
    interval : float
        s.
    phase_sigma, code_sigma : float
        Thermal noise of each receiver, m.
    reflection : float
        Amplitude of the reflected signal at the horizon, relative to the direct one.
    baseline_enu : tuple of 3 float
        Rover less base, m.
    content_tecu : float
        Vertical content of the ionosphere, a thin shell over both.
    """
    generator = np.random.default_rng(seed)
    start = parse_epoch("2023-01-08T00:00:00 GPS") + 60.0 * int(generator.integers(0, 1200))
    base = itrf_from_geodetic(
        (generator.uniform(-1.0, 1.0), generator.uniform(-math.pi, math.pi), 300.0)
    )
    baseline = np.array(baseline_enu) @ rotation_itrf_to_enu(base)
    ephemerides = nominal_gps_constellation(start, start + epochs * interval)
    table = EphemerisStore(ephemerides).table(start)
    offsets = interval * np.arange(epochs, dtype=float)
    # What the clocks are ahead, m: the instants of reception are before the time tags.
    clocks = 3e3 * generator.standard_normal(2)
    sights = []
    for position, clock in zip((base, base + baseline), clocks.tolist(), strict=True):
        rest = np.tile(np.concatenate((position, np.zeros(3))), (epochs, 1))
        received = offsets - clock / SPEED_OF_LIGHT
        sights.append(lines_of_sight(table, start, received, rest[:, :3], rest[:, 3:]))
    in_view = np.flatnonzero(np.min([s.elevation for s in sights], axis=(0, 1)) > LOWEST_ELEVATION)
    paths = []
    for receiver, sight in enumerate(sights):
        integers = generator.integers(-100_000, 100_000, (len(SIGNALS), len(in_view)))
        elevation = sight.elevation[:, in_view]
        height = 300.0 + receiver * baseline_enu[2]
        geometric = (sight.range - SPEED_OF_LIGHT * sight.clock_offset_satellite)[:, in_view]
        geometric = geometric + clocks[receiver] + troposphere(elevation, height)
        rows = []
        for k in range(epochs):
            parts: dict[str, list[np.ndarray]] = {name: [] for name in OBSERVATION_COLUMNS}
            for number, (band, attribute) in enumerate(SIGNALS):
                frequency = float(carrier_frequency_hz([c.SYSTEM_GPS], [band])[0])
                wavelength = SPEED_OF_LIGHT / frequency
                code_error, phase_error = ground_reflection(
                    elevation[k], ANTENNA_HEIGHTS[receiver], wavelength, reflection
                )
                count = len(in_view)
                plasma = content_tecu * plasma_delay(elevation[k], frequency)
                code = geometric[k] + code_error + code_sigma * generator.standard_normal(count)
                code += plasma
                phase = geometric[k] + phase_error + phase_sigma * generator.standard_normal(count)
                phase -= plasma
                values = {
                    "system": np.full(count, c.SYSTEM_GPS),
                    "prn": table.prn[in_view],
                    "band": np.full(count, band),
                    "attribute": np.full(count, ord(attribute)),
                    "pseudorange": code,
                    "carrier_phase_cycles": phase / wavelength + integers[number],
                    "doppler_hz": np.zeros(count),
                    "lock_time": np.full(count, 1000.0 + interval * k),
                    "cn0_dbhz": np.full(count, 45.0),
                    "flags": np.full(
                        count, c.FLAG_CODE_VALID | c.FLAG_PHASE_VALID | c.FLAG_PARITY_KNOWN
                    ),
                }
                for name in OBSERVATION_COLUMNS:
                    fill = 0 if name == "glonass_channel" else np.nan
                    parts[name].append(np.asarray(values.get(name, np.full(count, fill))))
            columns = {
                name: np.concatenate(parts[name]).astype(OBSERVATION_COLUMNS[name])
                for name in OBSERVATION_COLUMNS
            }
            rows.append(
                ObservationEpoch(
                    time=start + float(offsets[k]),
                    time_status=180,
                    receiver_status=0,
                    log_name="RANGE",
                    **columns,
                )
            )
        paths.append(folder / ("base", "rover")[receiver])
        position = base + receiver * (baseline + generator.standard_normal(3))
        write_rinex_observation(
            paths[-1], rows, approximate_position=tuple(position.tolist()), interval=interval
        )
    navigation = folder / "navigation"
    write_rinex_navigation(navigation, ephemerides)
    return GroundPair(paths[1], paths[0], navigation, base, baseline)


def troposphere(elevation: np.ndarray, height: float) -> np.ndarray:
    """Return the slant delay at elevations (rad) and a height (m), m."""
    zenith = sum(delay * math.exp(-height / scale) for delay, scale in (HYDROSTATIC, WET))
    ratio = EARTH_RADIUS / (EARTH_RADIUS + SHELL_HEIGHT)
    return zenith / np.sqrt(1.0 - (ratio * np.cos(elevation)) ** 2)


def plasma_delay(elevation: np.ndarray, frequency: float) -> np.ndarray:
    """Return the delay of a code by 1 TECU in a shell 450 km high, m."""
    ratio = EARTH_RADIUS / (EARTH_RADIUS + 450e3)
    return 40.308193e16 / frequency**2 / np.sqrt(1.0 - (ratio * np.cos(elevation)) ** 2)


def ground_reflection(
    elevation: np.ndarray, height: float, wavelength: float, reflection: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors of code and phase by a reflection from flat ground, m.

    The gain of the antenna rises by 10 dB from the horizon to the zenith with the sine of the
    elevation, and falls likewise below the horizon, from where the reflection comes.
    """
    sine = np.sin(elevation)
    amplitude = reflection * 10.0 ** (-sine)
    detour = 2.0 * height * sine
    angle = 2.0 * np.pi * detour / wavelength
    real, imaginary = 1.0 + amplitude * np.cos(angle), amplitude * np.sin(angle)
    phase = wavelength / (2.0 * np.pi) * np.arctan2(imaginary, real)
    return detour * amplitude * np.cos(angle) / real, phase
