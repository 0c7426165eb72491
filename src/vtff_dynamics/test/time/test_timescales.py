"""Time scales: exact arithmetic, leap seconds, week numbers and text."""

import datetime

import brahe
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vtff_dynamics.time.timescales import GpsTime, leap_seconds, leap_seconds_at_unix, parse_epoch

BILLION = 10**9
SPAN = st.integers(min_value=0, max_value=3 * 10**18)


def test_gps_epoch_is_unix_315964800():
    unix = datetime.datetime(1980, 1, 6, tzinfo=datetime.timezone.utc).timestamp()
    assert GpsTime(0).to_unix_nanoseconds() == int(unix) * BILLION
    assert parse_epoch("1980-01-06T00:00:00 GPS") == parse_epoch("1980-01-06T00:00:00 UTC")


@pytest.mark.parametrize(
    ("date", "seconds"),
    [("1980-06-01", 0), ("1981-06-30", 0), ("1981-07-01", 1), ("1999-01-01", 13)]
    + [("2005-12-31", 13), ("2006-01-01", 14), ("2009-01-01", 15), ("2012-07-01", 16)]
    + [("2015-06-30", 16), ("2016-03-21", 17), ("2016-12-31", 17), ("2017-01-01", 18)],
)
def test_gps_minus_utc_agrees_with_bulletin_c(date, seconds):
    time = parse_epoch(f"{date}T00:00:00 UTC")
    assert leap_seconds(time) == seconds
    assert leap_seconds_at_unix(time.to_unix_nanoseconds()) == seconds


@given(SPAN)
def test_leap_seconds_agree_with_those_of_sofa(nanoseconds):
    # brahe takes them from SOFA; its Unix time is a float that loses some microseconds.
    time = GpsTime(nanoseconds)
    difference = time.to_brahe_epoch().unix_timestamp() - time.to_unix_nanoseconds() / BILLION
    in_leap_second = time.isoformat("UTC")[17:19] == "60"
    assert in_leap_second or abs(difference) < 1e-3


def test_around_the_leap_second_of_2016():
    before = parse_epoch("2016-12-31T23:59:59 UTC")
    inserted = parse_epoch("2016-12-31T23:59:60 UTC")
    after = parse_epoch("2017-01-01T00:00:00 UTC")
    assert inserted - before == 1.0
    assert after - inserted == 1.0
    assert (inserted + 0.25).isoformat("UTC") == "2016-12-31T23:59:60.25 UTC"
    # Unix time has no number for it and counts the following second twice.
    assert inserted.to_unix_nanoseconds() == after.to_unix_nanoseconds()
    assert GpsTime.from_unix_nanoseconds(after.to_unix_nanoseconds()) == after
    assert GpsTime.from_unix_nanoseconds(before.to_unix_nanoseconds()) == before
    with pytest.raises(ValueError, match="no leap second"):
        parse_epoch("2016-12-30T23:59:60 UTC")


def test_week_counts_through_rollovers():
    first, second = (parse_epoch(f"{date}T00:00:00 GPS") for date in ("1999-08-22", "2019-04-07"))
    assert (first.week, first.time_of_week) == (1024, 0.0)
    assert (second.week, second.time_of_week) == (2048, 0.0)
    last = GpsTime(second.nanoseconds - 1)
    assert (last.week, last.time_of_week_nanoseconds) == (2047, 604800 * BILLION - 1)
    # The epoch of paper 000: its week 865 is modulo 1024.
    paper = GpsTime.from_week_tow(865 + 1024, 90000.0)
    assert paper == parse_epoch("2016-03-21T01:00:00 GPS")
    assert paper.isoformat("UTC") == "2016-03-21T00:59:43 UTC"
    assert paper.isoformat("TT") == "2016-03-21T01:00:51.184 TT"


@given(SPAN, st.sampled_from(["GPS", "UTC", "TT"]))
def test_text_and_time_are_inverse(nanoseconds, scale):
    time = GpsTime(nanoseconds)
    assert parse_epoch(time.isoformat(scale)) == time


@given(SPAN)
def test_unix_and_gps_are_inverse(nanoseconds):
    time = GpsTime(nanoseconds)
    if time.isoformat("UTC")[17:19] != "60":
        assert GpsTime.from_unix_nanoseconds(time.to_unix_nanoseconds()) == time


@given(SPAN)
def test_week_and_time_of_week_are_inverse(nanoseconds):
    time = GpsTime(nanoseconds)
    assert GpsTime(time.week * 604800 * BILLION + time.time_of_week_nanoseconds) == time
    assert abs(GpsTime.from_week_tow(time.week, time.time_of_week).nanoseconds - nanoseconds) <= 1


@given(SPAN)
def test_brahe_epoch_is_the_same_time(nanoseconds):
    time = GpsTime(nanoseconds)
    year, month, day = (int(part) for part in time.isoformat()[:10].split("-"))
    midnight = brahe.Epoch.from_datetime(year, month, day, 0, 0, 0.0, 0.0, brahe.TimeSystem.GPS)
    expected = nanoseconds % (86400 * BILLION) / BILLION
    assert time.to_brahe_epoch() - midnight == pytest.approx(expected, abs=2e-10)


def test_many_steps_of_a_tenth_do_not_drift():
    time = start = parse_epoch("2016-03-21T01:00:00 GPS")
    for _ in range(100_000):
        time = time + 0.1
    assert time.nanoseconds - start.nanoseconds == 10_000 * BILLION
    assert time - 10_000 == start
    assert time > start


def test_julian_date_in_tt():
    # J2000.0 is 2000-01-01 12:00 TT.
    assert parse_epoch("2000-01-01T12:00:00 TT").julian_date_tt() == (2451545.0, 0.0)
    assert parse_epoch("2000-01-02T00:00:00 TT").julian_date_tt() == (2451545.0, 0.5)
    epoch = parse_epoch("2016-03-21T01:00:00 GPS")
    days, fraction = epoch.julian_date_tt()
    expected = epoch.to_brahe_epoch().jd_as_time_system(brahe.TimeSystem.TT)
    assert abs(days + fraction - expected) < 1e-8


@pytest.mark.parametrize(
    "text",
    ["", "2016-03-21T01:00:00", "2016-03-21 GPS", "2016-13-21T01:00:00 GPS"]
    + ["2016-03-21T24:00:00 GPS", "2016-03-21T01:60:00 UTC", "2016-12-31T23:59:60 GPS"]
    + ["2016-03-21T01:00:00.0000000001 GPS", "noon GPS", "2016-02-30T00:00:00 TT"],
)
def test_errors_name_the_text(text):
    with pytest.raises(ValueError, match="epoch") as error:
        parse_epoch(text)
    assert repr(text) in str(error.value)


def test_only_integers_are_nanoseconds():
    with pytest.raises(TypeError, match="nanoseconds"):
        GpsTime(1.5)
    with pytest.raises(TypeError, match="unix_nanoseconds"):
        GpsTime.from_unix_nanoseconds(1.5)
    with pytest.raises(ValueError, match="time scale 'TAI'"):
        GpsTime(0).isoformat("TAI")
