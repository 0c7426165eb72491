"""A day of one receiver in orbit as archives hold it: RINEX 2.20, SP3, DCB files, known truth.

The receiver is like those of GRACE: an epoch each 10 s, C/A and both P codes, one phase for each
carrier. Everything is computed here, so every bias is known.
"""

from __future__ import annotations

import math
import pathlib
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.time.timescales import GpsTime, parse_epoch
from vtff_gnss.constants import (
    EARTH_ROTATION_RATE_BROADCAST,
    FREQUENCY_L1,
    FREQUENCY_L2,
    GRAVITATIONAL_PARAMETER_BROADCAST,
    SYSTEM_GPS,
)
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.line_of_sight import lines_of_sight
from vtff_gnss.orbits.nominal_constellation import nominal_gps_constellation
from vtff_gnss.rinex.calendar_time import calendar_fields
from vtff_gnss.rinex.write.header import header_line
from vtff_iono.geometry.mapping import profile_content

START = parse_epoch("2010-07-22T00:00:00 GPS")
STEP = 10.0
EPOCHS = 8640
SP3_STEP = 900.0
NANOSECOND = 1e-9 * SPEED_OF_LIGHT
"""m of light in 1 ns."""

# One ray delays the first carrier by this for each TECU, m.
_DELAY_L1 = 40.308193e16 / FREQUENCY_L1**2
_SQUARED_RATIO = (FREQUENCY_L1 / FREQUENCY_L2) ** 2
_WEIGHT_SECOND = 1.0 / (_SQUARED_RATIO - 1.0)
_CHANNELS = 11
_LOWEST_ELEVATION = math.radians(3.0)
_TYPES = ("L1", "L2", "C1", "P1", "P2", "S1", "S2")
_BLOCK = 500


@dataclass(frozen=True)
class EmulatedDay:
    """Files and truth of a day.

    Parameters
    ----------
    observations, orbits, own_orbit, navigation : pathlib.Path
        RINEX 2.20; SP3 of GPS and of the receiver's spacecraft; the rest of the sky as broadcast.
    biases_p1p2, biases_p1c1 : pathlib.Path
        DCB files of the satellites.
    receiver_p1p2_ns, receiver_c1p2_ns : float
        True receiver biases, first less second code.
    position_itrf : ndarray, shape (n, 3)
        True positions at the time tags, m.
    """

    observations: pathlib.Path
    orbits: pathlib.Path
    own_orbit: pathlib.Path
    biases_p1p2: pathlib.Path
    biases_p1c1: pathlib.Path
    receiver_p1p2_ns: float
    receiver_c1p2_ns: float
    position_itrf: np.ndarray


def write_day(
    folder: pathlib.Path,
    epochs: int = EPOCHS,
    seed: int = 20100722,
    version: str = "2.20",
    first_time_format: str = "13.7f",
    hours: float = 3.0,
) -> EmulatedDay:
    """Write the files of a day, or of its first epochs, into a folder.

    The orbits of a shorter recording last `hours` at least.
    """
    generator = np.random.default_rng(seed)
    store = EphemerisStore(nominal_gps_constellation(START - 7200.0, START + 93600.0))
    table = store.table(START)
    satellites = table.prn.tolist()
    p1p2 = dict(zip(satellites, generator.normal(0.0, 4.0, len(satellites)), strict=True))
    p1c1 = dict(zip(satellites, generator.normal(0.0, 1.0, len(satellites)), strict=True))
    for biases in (p1p2, p1c1):  # The datum of CODE: biases of all satellites add up to zero.
        mean = sum(biases.values()) / len(biases)
        biases.update({prn: round(value - mean, 3) for prn, value in biases.items()})
    receiver = {"P1": 2.0, "P2": 2.0 + 12.89, "C1": 2.0 - 1.86}
    time = STEP * np.arange(epochs)
    states = np.array([_orbit(t) for t in time])
    text = [_header(version, first_time_format)]
    noise = np.random.default_rng(seed + 1)
    ambiguities: dict[int, tuple[int, int]] = {}
    for first in range(0, epochs, _BLOCK):
        rows = slice(first, min(first + _BLOCK, epochs))
        text.append(
            _observations(store, time[rows], states[rows], p1p2, p1c1, receiver, noise, ambiguities)
        )
    day = EmulatedDay(
        observations=folder / "leo12030.10o",
        orbits=folder / "gps15935.sp3",
        own_orbit=folder / "leo15935.sp3",
        biases_p1p2=folder / "P1P2_2010.DCB",
        biases_p1c1=folder / "P1C1_2010.DCB",
        receiver_p1p2_ns=receiver["P1"] - receiver["P2"],
        receiver_c1p2_ns=receiver["C1"] - receiver["P2"],
        position_itrf=states[:, :3],
    )
    day.observations.write_text("".join(text), encoding="ascii")
    span = max(time[-1], 3600.0 * hours) if epochs < EPOCHS else 86400.0
    count = math.ceil(span / SP3_STEP) + 1
    day.orbits.write_text(_gps_sp3(store, count), encoding="ascii")
    day.own_orbit.write_text(_own_sp3(span), encoding="ascii")
    day.biases_p1p2.write_text(_dcb("P1-P2", p1p2), encoding="ascii")
    day.biases_p1c1.write_text(_dcb("P1-C1", p1c1), encoding="ascii")
    return day


def _orbit(time: float) -> np.ndarray:
    """Return position and Earth-fixed velocity in ITRF on a polar orbit, (6,)."""
    axis, inclination = 6_850e3, math.radians(89.0)
    rate = math.sqrt(GRAVITATIONAL_PARAMETER_BROADCAST[SYSTEM_GPS] / axis**3)
    latitude_argument = rate * time
    node = 0.7 - EARTH_ROTATION_RATE_BROADCAST * time
    c, s = math.cos(latitude_argument), math.sin(latitude_argument)
    ci, si = math.cos(inclination), math.sin(inclination)
    cn, sn = math.cos(node), math.sin(node)
    turn = np.array([[cn, -sn * ci, sn * si], [sn, cn * ci, -cn * si], [0.0, si, ci]])
    position = turn @ (axis * c, axis * s, 0.0)
    velocity = turn @ (-axis * rate * s, axis * rate * c, 0.0)
    return np.concatenate(
        (position, velocity - np.cross([0.0, 0.0, EARTH_ROTATION_RATE_BROADCAST], position))
    )


def _vertical_content(latitude: np.ndarray, longitude: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the content above the orbit, TECU: two crests and a day side."""
    local_time = time / 3600.0 + np.degrees(longitude) / 15.0
    day = 0.5 * (1.0 + np.cos(2.0 * np.pi * (local_time - 14.0) / 24.0))
    crests = sum(np.exp(-0.5 * ((np.degrees(latitude) - c) / 14.0) ** 2) for c in (-12.0, 12.0))
    return np.asarray(1.5 + 4.0 * day + 4.0 * day * crests)


_ELEVATIONS = np.radians(np.linspace(0.0, 90.0, 181))


def _mapping(elevation: np.ndarray, radius: float) -> np.ndarray:
    altitude = np.arange(radius - 6_371e3, 3_000e3, 5e3)
    density = np.exp(-(altitude - altitude[0]) / 220e3) + 0.02 * (altitude[0] / altitude) ** 3
    content = profile_content(_ELEVATIONS, radius, altitude, density)
    return np.asarray(np.interp(elevation, _ELEVATIONS, content / content[-1]))


def _observations(store, time, states, p1p2, p1c1, receiver, noise, ambiguities) -> str:
    """Return the epochs of some times as text."""
    begin = START + float(time[0])
    table = store.table(begin)
    reception = time - time[0]
    # The clock of the receiver is steered to below a microsecond.
    clock = 1e-7 * np.sin(2.0 * np.pi * time / 5600.0)
    position = states[:, :3] - clock[:, None] * states[:, 3:]
    sight = lines_of_sight(table, begin, reception - clock, position, states[:, 3:])
    latitude, longitude, _ = geodetic_from_itrf(position).T
    # Where the ray is, some 4 deg towards the satellite near the horizon.
    towards = np.radians(4.0) * np.cos(sight.elevation)
    content = _vertical_content(
        latitude[:, None] + towards * np.cos(sight.azimuth),
        longitude[:, None] + towards * np.sin(sight.azimuth),
        time[:, None],
    ) * _mapping(sight.elevation, float(np.linalg.norm(position[0])))
    geometric = sight.range + SPEED_OF_LIGHT * (clock[:, None] - sight.clock_offset_satellite)
    delay = _DELAY_L1 * content
    prn = table.prn.tolist()
    difference = np.array([p1p2[n] for n in prn])
    offset = {
        "P1": -_WEIGHT_SECOND * difference,
        "P2": -(1.0 + _WEIGHT_SECOND) * difference,
    }
    offset["C1"] = offset["P1"] - np.array([p1c1[n] for n in prn])
    shape = geometric.shape
    sigma = 0.25 / (0.3 + np.sin(np.maximum(sight.elevation, 0.0)))
    codes = {}
    for name, factor in (("C1", 1.0), ("P1", 1.0), ("P2", _SQUARED_RATIO)):
        biases = NANOSECOND * (offset[name] + receiver[name])
        codes[name] = geometric + factor * delay + biases + sigma * noise.standard_normal(shape)
    wavelengths = SPEED_OF_LIGHT / FREQUENCY_L1, SPEED_OF_LIGHT / FREQUENCY_L2
    phases = [
        (geometric - factor * delay + 0.001 * noise.standard_normal(shape)) / wavelength
        for factor, wavelength in zip((1.0, _SQUARED_RATIO), wavelengths, strict=True)
    ]
    lines = []
    for row in range(len(time)):
        chosen = np.flatnonzero(sight.elevation[row] > _LOWEST_ELEVATION)
        chosen = chosen[np.argsort(-sight.elevation[row, chosen])][:_CHANNELS]
        names = [prn[i] for i in sorted(chosen.tolist())]
        for number in set(ambiguities) - set(names):
            del ambiguities[number]
        lines.append(_epoch_line(START + float(time[row]), names))
        for i in sorted(chosen.tolist()):
            is_new = prn[i] not in ambiguities
            if is_new:
                whole = noise.integers(-(10**7), 10**7, 2)
                ambiguities[prn[i]] = int(whole[0]), int(whole[1])
            strength = 30.0 + 20.0 * math.sin(float(sight.elevation[row, i]))
            values = (
                *(phases[k][row, i] + ambiguities[prn[i]][k] for k in range(2)),
                *(codes[name][row, i] for name in ("C1", "P1", "P2")),
                strength, strength - 8.0,
            )  # fmt: skip
            mark = "1 " if is_new else "  "
            cells = [f"{v:14.3f}{mark if k < 2 else '  '}" for k, v in enumerate(values)]
            lines.append(("".join(cells[:5])).rstrip() + "\n")
            lines.append(("".join(cells[5:])).rstrip() + "\n")
    return "".join(lines)


def _epoch_line(time: GpsTime, names: list[int]) -> str:
    year, month, day, hour, minute, second, nanosecond = calendar_fields(time)
    seconds = second + 1e-9 * nanosecond
    date = f" {year % 100:02d} {month:2d} {day:2d} {hour:2d} {minute:2d}{seconds:11.7f}"
    return f"{date}  0{len(names):3d}" + "".join(f"G{n:02d}" for n in names) + "\n"


def _header(version: str, first_time_format: str) -> str:
    second = format(0.0, first_time_format)
    types = f"{len(_TYPES):6d}" + "".join(f"{name:>6}" for name in _TYPES)
    return "".join(
        (
            header_line(f"{version:>9}{'':11}OBSERVATION DATA    G (GPS)", "RINEX VERSION / TYPE"),
            header_line("emulated_day        vtff", "PGM / RUN BY / DATE"),
            header_line("LEO", "MARKER NAME"),
            header_line(f"{0.0:14.4f}{0.0:14.4f}{0.0:14.4f}", "APPROX POSITION XYZ"),
            header_line("     1     1", "WAVELENGTH FACT L1/2"),
            header_line(types, "# / TYPES OF OBSERV"),
            header_line(f"{STEP:10.3f}", "INTERVAL"),
            header_line(f"  2010     7    22     0     0{second}", "TIME OF FIRST OBS"),
            header_line("", "END OF HEADER"),
        )
    )


def _sp3_header(names: list[str], count: int, step: float) -> list[str]:
    width = 17
    padded = names + ["  0"] * (-len(names) % width)
    lists = ["".join(padded[i : i + width]) for i in range(0, len(padded), width)]
    return [
        f"#cP2010  7 22  0  0  0.00000000 {count:7d} ORBIT IGS05 FIT VTFF",
        f"## {START.week:4d} {START.time_of_week:15.8f} {step:14.8f} 55399 0.0000000000000",
        *(f"+  {len(names) if i == 0 else '':>3}   {text}" for i, text in enumerate(lists)),
        *("++       " + "  0" * width for _ in lists),
        "%c G  cc GPS ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc",
        "%f  1.2500000  1.025000000  0.00000000000  0.000000000000000",
        "/* Emulated day of vtff",
    ]


def _sp3_epoch(time: GpsTime) -> str:
    year, month, day, hour, minute, second, nanosecond = calendar_fields(time)
    seconds = second + 1e-9 * nanosecond
    return f"*  {year:4d} {month:2d} {day:2d} {hour:2d} {minute:2d} {seconds:11.8f}"


def _gps_sp3(store: EphemerisStore, count: int) -> str:
    names = [f"G{prn:02d}" for prn in store.table(START).prn.tolist()]
    lines = _sp3_header(names, count, SP3_STEP)
    spin = np.array([0.0, 0.0, EARTH_ROTATION_RATE_BROADCAST])
    for number in range(count):
        time = START + SP3_STEP * number
        states = store.table(time).states(time)
        inertial = states.velocity_itrf + np.cross(spin, states.position_itrf)
        relativity = -2.0 * np.sum(states.position_itrf * inertial, axis=1) / SPEED_OF_LIGHT**2
        clock = 1e6 * (states.clock_offset - relativity)
        lines.append(_sp3_epoch(time))
        for name, position, offset in zip(names, states.position_itrf, clock, strict=True):
            cells = "".join(f"{1e-3 * x:14.6f}" for x in position)
            lines.append(f"P{name}{cells}{offset:14.6f}")
    return "\n".join([*lines, "EOF"]) + "\n"


def _own_sp3(span: float) -> str:
    count = int(span / 60.0) + 1
    lines = _sp3_header(["L01"], count, 60.0)
    for number in range(count):
        lines.append(_sp3_epoch(START + 60.0 * number))
        cells = "".join(f"{1e-3 * x:14.6f}" for x in _orbit(60.0 * number)[:3])
        lines.append(f"PL01{cells} 999999.999999")
    return "\n".join([*lines, "EOF"]) + "\n"


def _dcb(pair: str, biases: dict[int, float]) -> str:
    """Return a DCB file in the form of CODE."""
    title = f"CODE'S 30-DAY GPS {pair} DCB SOLUTION, ENDING D203, 2010"
    lines = [
        f"{title:<64}04-AUG-10 01:30",
        "-" * 80,
        "",
        f"DIFFERENTIAL ({pair}) CODE BIASES FOR SATELLITES AND RECEIVERS:",
        "",
        "PRN / STATION NAME        VALUE (NS)  RMS (NS)",
        "***   ****************    *****.***   *****.***",
    ]
    lines += [f"G{prn:02d}{'':23}{value:9.3f}{'':3}{0.01:9.3f}" for prn, value in biases.items()]
    return "\n".join(lines) + "\n"
