"""Rotation to ITRF and leap seconds against ERFA, the library of the IAU's fundamental astronomy.

ERFA gets polar motion and UT1 - UTC of the same Bulletin A, interpolated here on its own, and does
everything else itself: time scales, IAU 2000A precession-nutation, Earth rotation, polar motion.
"""

import math

import brahe
import numpy as np
import pytest

from vtff_dynamics.frames.earth import earth_rotation_angle, rotation_gcrf_to_itrf
from vtff_dynamics.frames.earth_environment import ensure_earth_orientation
from vtff_dynamics.time.timescales import GpsTime, leap_seconds, parse_epoch

erfa = pytest.importorskip("erfa", reason="pyerfa is not installed")

DAYS = (
    "2006-01-01", "2010-07-15", "2012-06-30", "2012-07-01", "2015-06-30", "2016-03-21",
    "2016-12-31", "2017-01-01", "2020-02-29", "2023-10-05",
)  # fmt: skip
TIMES = [f"{day}T{clock} UTC" for day in DAYS for clock in ("00:00:00", "11:59:30", "23:59:59")]


def earth_orientation(mjd_utc: float) -> tuple[float, float, float]:
    """Return UT1 - UTC (s) and polar motion (rad), linear between the midnights of Bulletin A."""
    ensure_earth_orientation()
    day, fraction = divmod(mjd_utc, 1.0)
    rows = []
    for midnight in (day, day + 1.0):
        x, y = brahe.get_global_pm(midnight)
        rows.append((brahe.get_global_ut1_utc(midnight), x, y))
    (ut1, *pole), (ut1_next, *pole_next) = rows
    # UT1 - UTC jumps with a leap second, UT1 - TAI does not.
    ut1_next -= round(ut1_next - ut1)
    return (
        ut1 + fraction * (ut1_next - ut1),
        pole[0] + fraction * (pole_next[0] - pole[0]),
        pole[1] + fraction * (pole_next[1] - pole[1]),
    )


def utc_fields(text: str) -> tuple[int, int, int, int, int, float]:
    date, clock = text.removesuffix(" UTC").split("T")
    (year, month, day), (hour, minute, second) = date.split("-"), clock.split(":")
    return int(year), int(month), int(day), int(hour), int(minute), float(second)


def erfa_times(text: str) -> tuple[tuple[float, float], tuple[float, float], float, float]:
    """Return ERFA's TT and UT1 of a UTC time, and the polar motion in rad."""
    utc = erfa.dtf2d("UTC", *utc_fields(text))
    year, month, day, hour, minute, second = utc_fields(text)
    midnight = erfa.cal2jd(year, month, day)[1]
    ut1_utc, x, y = earth_orientation(midnight + (hour * 3600 + minute * 60 + second) / 86400)
    tt = erfa.taitt(*erfa.utctai(*utc))
    return tt, erfa.utcut1(*utc, ut1_utc), x, y


@pytest.mark.parametrize("text", TIMES)
def test_rotation_to_itrf_equals_that_of_erfa(text):
    tt, ut1, x, y = erfa_times(text)
    expected = erfa.c2t06a(*tt, *ut1, x, y)
    rotation = rotation_gcrf_to_itrf(parse_epoch(text))
    # IAU 2000B is within 1 mas (5e-9 rad) of IAU 2000A; in low orbit that is 34 mm.
    assert np.abs(rotation @ expected.T - np.eye(3)).max() < 5e-9


@pytest.mark.parametrize("text", TIMES)
def test_earth_rotation_angle_equals_that_of_erfa(text):
    _, ut1, *_ = erfa_times(text)
    difference = earth_rotation_angle(parse_epoch(text)) - erfa.era00(*ut1)
    # 1e-9 rad are 14 us of UT1: the two differ by how a day with a leap second is interpolated.
    assert abs(math.remainder(difference, 2.0 * math.pi)) < 1e-9


@pytest.mark.parametrize("text", TIMES)
def test_leap_seconds_equal_those_of_erfa(text):
    year, month, day, *_ = utc_fields(text)
    assert leap_seconds(parse_epoch(text)) == erfa.dat(year, month, day, 0.0) - 19.0


def test_every_leap_second_of_erfa_since_gps_began_is_known():
    table = erfa.leap_seconds.get()
    since_gps = [row for row in table if (row["year"], row["month"]) > (1980, 1)]
    assert len(since_gps) >= 18
    for row in since_gps:
        start = parse_epoch(f"{row['year']:04d}-{row['month']:02d}-01T00:00:00 UTC")
        assert leap_seconds(start) == row["tai_utc"] - 19.0
        assert leap_seconds(GpsTime(start.nanoseconds - 1)) == row["tai_utc"] - 20.0
