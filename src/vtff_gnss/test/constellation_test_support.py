"""Shared navigation files, pyrtklib times and an independent orbit for the constellation tests."""

from __future__ import annotations

import atexit
import dataclasses
import functools
import pathlib
import shutil
import tempfile

import numpy as np
from shared_data import require_shared, shared_folder

from vtff_dynamics.time.timescales import GpsTime, parse_epoch
from vtff_gnss.orbits.nominal_constellation import nominal_gps_constellation
from vtff_gnss.rinex.navigation import RinexNavigation, read_rinex_navigation
from vtff_gnss.rinex.write.navigation import write_rinex_navigation

SPIRENT = shared_folder() / "data/navigation/spirent_dynamic/RINEX_GN_Spirent.23N"
BRDC = shared_folder() / "data/ionosphere/bele_2024010/BRDC00IGS_R_20240100000_01D_MN.rnx.gz"
UNIX_TIME_OF_GPS_EPOCH = 315_964_800
LONG = np.longdouble


def shared_file(path: pathlib.Path) -> pathlib.Path:
    """Return a shared file, or skip the test."""
    return require_shared(path)


@functools.lru_cache(maxsize=2)
def navigation(path: pathlib.Path) -> RinexNavigation:
    return read_rinex_navigation(shared_file(path))


@functools.lru_cache(maxsize=1)
def drawn_navigation() -> RinexNavigation:
    """Return what stands in `drawn_navigation_file`."""
    return read_rinex_navigation(drawn_navigation_file())


@functools.lru_cache(maxsize=1)
def drawn_navigation_file() -> pathlib.Path:
    """Return a RINEX file of 31 GPS satellites whose orbital corrections are all drawn by seed."""
    start = parse_epoch("2016-03-21T01:00:00 GPS")
    generator = np.random.default_rng(11)
    scales = {
        **dict.fromkeys(("cuc", "cus"), 3e-6),
        **dict.fromkeys(("crc", "crs"), 200.0),
        **dict.fromkeys(("cic", "cis"), 2e-7),
        "mean_motion_difference": 5e-9,
        "inclination_rate": 3e-10,
        "af2": 1e-18,
    }
    ephemerides = [
        dataclasses.replace(e, **{n: float(generator.normal(0.0, s)) for n, s in scales.items()})
        for e in nominal_gps_constellation(start, start)
    ]
    path = pathlib.Path(tempfile.mkdtemp(prefix="vtff_test_")) / "drawn.rnx"
    atexit.register(shutil.rmtree, path.parent, ignore_errors=True)
    write_rinex_navigation(path, ephemerides)
    return path


def rtklib_time(pyrtklib, time: GpsTime, offset: float = 0.0):
    """Return a gtime_t, which counts GPS time as if it were Unix time."""
    result = pyrtklib.gtime_t()
    whole, nanoseconds = divmod(time.nanoseconds, 1_000_000_000)
    result.time = int(whole + UNIX_TIME_OF_GPS_EPOCH)
    result.sec = nanoseconds * 1e-9
    return pyrtklib.timeadd(result, offset)


def seconds_of(time) -> float:
    """Return the GPS seconds of a gtime_t."""
    return time.time - UNIX_TIME_OF_GPS_EPOCH + time.sec


def doubles(pyrtklib, values):
    array = pyrtklib.Arr1Ddouble(len(values))
    for i, value in enumerate(values):
        array[i] = float(value)
    return array


def independent_position_itrf(ephemeris, since_toe, gm):
    """Evaluate IS-GPS-200 table 20-IV line by line for one satellite, in extended precision."""
    e = {
        name: LONG(getattr(ephemeris, name))
        for name in ephemeris.__dataclass_fields__
        if isinstance(getattr(ephemeris, name), float)
    }
    tk = LONG(since_toe)
    n = np.sqrt(LONG(gm) / e["semi_major_axis"] ** 3) + e["mean_motion_difference"]
    mk = e["mean_anomaly"] + n * tk
    ek = mk
    for _ in range(60):
        ek = mk + e["eccentricity"] * np.sin(ek)
    half = np.sqrt((1 + e["eccentricity"]) / (1 - e["eccentricity"])) * np.tan(ek / 2)
    phi = 2 * np.arctan(half) + e["argument_of_perigee"]
    u = phi + e["cus"] * np.sin(2 * phi) + e["cuc"] * np.cos(2 * phi)
    r = e["semi_major_axis"] * (1 - e["eccentricity"] * np.cos(ek))
    r += e["crs"] * np.sin(2 * phi) + e["crc"] * np.cos(2 * phi)
    i = e["inclination"] + e["inclination_rate"] * tk
    i += e["cis"] * np.sin(2 * phi) + e["cic"] * np.cos(2 * phi)
    rate = LONG("7.2921151467e-5")
    node = e["longitude_of_ascending_node"] + (e["right_ascension_rate"] - rate) * tk
    node -= rate * e["toe"]
    x, y = r * np.cos(u), r * np.sin(u)
    return np.array(
        [
            x * np.cos(node) - y * np.cos(i) * np.sin(node),
            x * np.sin(node) + y * np.cos(i) * np.cos(node),
            y * np.sin(i),
        ]
    )
