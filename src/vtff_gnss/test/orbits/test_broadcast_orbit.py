"""Broadcast orbits and clocks against RTKLIB, extended precision and their own derivatives."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from constellation_test_support import (
    BRDC,
    doubles,
    drawn_navigation,
    drawn_navigation_file,
    independent_position_itrf,
    navigation,
    rtklib_time,
)
from gnss_test_support import examples
from hypothesis import given
from hypothesis import strategies as st

from vtff_dynamics.time.timescales import parse_epoch
from vtff_gnss.constants import EPHEMERIS_SOURCE_FNAV, SYSTEM_BEIDOU, SYSTEM_GALILEO, SYSTEM_GPS
from vtff_gnss.orbits.broadcast_orbit import (
    GRAVITATIONAL_PARAMETER_BROADCAST,
    EphemerisTable,
    ephemeris_with_reference,
)
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore, validity_interval
from vtff_gnss.orbits.nominal_constellation import (
    nominal_galileo_constellation,
    nominal_gps_constellation,
)

START = parse_epoch("2016-03-21T01:00:00 GPS")


@pytest.fixture(scope="module")
def nominal():
    return [*nominal_gps_constellation(START, START), *nominal_galileo_constellation(START, START)]


@pytest.fixture(scope="module")
def table(nominal):
    return EphemerisTable(nominal)


def test_position_and_clock_equal_rtklib():
    pyrtklib = pytest.importorskip("pyrtklib")
    nav, obs, station = pyrtklib.nav_t(), pyrtklib.obs_t(), pyrtklib.sta_t()
    assert pyrtklib.readrnx(str(drawn_navigation_file()), 1, "", obs, nav, station) == 1
    ephemerides = drawn_navigation().ephemerides
    assert nav.n == len(ephemerides) == 31
    table = EphemerisTable(ephemerides)
    time = ephemerides[0].time_of_ephemeris
    for offset in (-7100.25, 0.0, 1234.567, 7000.0):
        states = table.states(time, offset)
        for i in range(nav.n):
            position, clock = doubles(pyrtklib, [0.0] * 3), doubles(pyrtklib, [0.0])
            variance = doubles(pyrtklib, [0.0])
            when = rtklib_time(pyrtklib, time, offset)
            pyrtklib.eph2pos(when, nav.eph[i], position, clock, variance)
            difference = states.position_itrf[i] - [position[k] for k in range(3)]
            # RTKLIB stops Kepler's equation at 1e-13 rad, that is 3e-6 m.
            assert np.abs(difference).max() < 1e-5
            assert abs(states.clock_offset[i] - clock[0]) < 1e-17


@pytest.mark.parametrize("offset", [-7200.0, 0.0, 3599.95, 14400.0])
def test_position_equals_interface_document_in_extended_precision(nominal, table, offset):
    states = table.states(nominal[0].time_of_ephemeris, offset)
    for i, ephemeris in enumerate(nominal):
        gm = GRAVITATIONAL_PARAMETER_BROADCAST[ephemeris.system]
        since_toe = nominal[0].time_of_ephemeris - ephemeris.time_of_ephemeris + offset
        expected = independent_position_itrf(ephemeris, since_toe, gm)
        assert np.abs(states.position_itrf[i] - expected).max() < 5e-8


@given(
    eccentricity=st.floats(0.0, 0.7),
    mean_anomaly=st.floats(-np.pi, np.pi),
    since_toe=st.floats(-7200.0, 7200.0),
)
@examples(60)
def test_kepler_equation_for_any_ellipse(eccentricity, mean_anomaly, since_toe):
    ephemeris = dataclasses.replace(
        nominal_gps_constellation(START, START)[3],
        eccentricity=eccentricity,
        mean_anomaly=mean_anomaly,
    )
    states = EphemerisTable([ephemeris]).states(ephemeris.time_of_ephemeris, since_toe)
    gm = GRAVITATIONAL_PARAMETER_BROADCAST[SYSTEM_GPS]
    # 60 fixed-point iterations of the reference converge as e^60.
    tolerance = 1e-6 + 4e7 * eccentricity**60
    expected = independent_position_itrf(ephemeris, since_toe, gm)
    assert np.abs(states.position_itrf[0] - expected).max() < tolerance


def test_velocity_is_the_derivative_of_the_position(table):
    step = 0.5
    before, here, after = (table.states(START, k * step) for k in (-1, 0, 1))
    numeric = (after.position_itrf - before.position_itrf) / (2 * step)
    # The third derivative leaves 3e-6 m/s, the digits of the position 1e-8 m/s.
    assert np.abs(numeric - here.velocity_itrf).max() < 1e-5


def test_acceleration_is_the_derivative_of_the_velocity():
    ephemerides = [
        dataclasses.replace(e, inclination_rate=8e-10, cis=3e-7, cic=-2e-7)
        for e in nominal_gps_constellation(START, START)
    ]
    table = EphemerisTable(ephemerides)
    step = 2.0
    before, here, after = (table.states(START, k * step) for k in (-1, 0, 1))
    numeric = (after.velocity_itrf - before.velocity_itrf) / (2 * step)
    assert np.abs(numeric - here.acceleration_itrf).max() < 2e-8


def test_clock_is_polynomial_and_relativistic_term(nominal):
    # Independent form of the periodic term: -2 r.v / c^2, velocity in non-rotating axes.
    ephemerides = [
        dataclasses.replace(e, cuc=0.0, cus=0.0, crc=0.0, crs=0.0, cic=0.0, cis=0.0)
        for e in nominal
    ]
    for ephemeris in ephemerides:
        pure = dataclasses.replace(ephemeris, mean_motion_difference=0.0, right_ascension_rate=0.0)
        states = EphemerisTable([pure]).states(START, 1800.0)
        elapsed = START - pure.time_of_clock + 1800.0
        position, velocity = states.position_itrf[0], states.velocity_itrf[0]
        # omega x r is perpendicular to r, so the Earth-fixed velocity gives the same product.
        relativistic = -2.0 * position @ velocity / 299792458.0**2
        expected = pure.af0 + pure.af1 * elapsed + relativistic
        assert abs(states.clock_offset[0] - expected) < 1e-15


def test_clock_drift_is_the_derivative_of_the_clock(nominal):
    table = EphemerisTable([dataclasses.replace(e, af2=1e-17) for e in nominal])
    before, here, after = (table.states(START, offset) for offset in (-2.0, 0.0, 2.0))
    numeric = (after.clock_offset - before.clock_offset) / 4.0
    assert np.abs(numeric - here.clock_drift).max() < 1e-18


def test_times_and_satellites_broadcast(table):
    offsets = np.array([[0.0], [0.05], [86400.0]])
    states = table.states(START, offsets)
    assert states.position_itrf.shape == (3, len(table), 3)
    assert states.clock_offset.shape == (3, len(table))
    per_satellite = np.linspace(0.0, 1.0, len(table))
    mixed = table.states(START, per_satellite)
    single = table.states(START, per_satellite[7])
    assert np.array_equal(mixed.position_itrf[7], single.position_itrf[7])
    shifted = table.states(START + 86400, 0.0)
    assert np.abs(states.position_itrf[2] - shifted.position_itrf).max() < 1e-6


def test_table_without_satellites():
    states = EphemerisTable([]).states(START, np.zeros((4, 1)))
    assert states.position_itrf.shape == (4, 0, 3)


def test_reference_can_be_moved(nominal):
    # The clock of a message has a drift that changes; that of the nominal constellation has not.
    ephemerides = [dataclasses.replace(e, af1=-2e-12, af2=3e-18) for e in nominal]
    here = EphemerisTable(ephemerides).states(START, 1000.0)
    for step in (-7200.0, 1800.0, 5 * 86400.0):
        moved = [ephemeris_with_reference(e, e.time_of_ephemeris + step) for e in ephemerides]
        there = EphemerisTable(moved).states(START, 1000.0)
        assert np.abs(here.position_itrf - there.position_itrf).max() < 2e-6
        assert np.abs(here.clock_offset - there.clock_offset).max() < 1e-18


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"system": SYSTEM_BEIDOU}, "C01: only GPS and Galileo"),
        ({"semi_major_axis": 0.0}, "G01: semi_major_axis 0.0 is not positive"),
        ({"eccentricity": 1.0}, "G01: eccentricity 1.0 is not within"),
    ],
)
def test_impossible_orbits_are_refused(nominal, change, text):
    with pytest.raises(ValueError, match=text):
        EphemerisTable([dataclasses.replace(nominal[0], **change)])


def test_newest_valid_set_is_chosen():
    end = START + 6 * 3600
    sets = nominal_gps_constellation(START, end) + nominal_galileo_constellation(START, end)
    store = EphemerisStore(sets)
    time = START
    while time <= end:
        table = store.table(time)
        assert len(table) == 55
        for ephemeris in table.ephemerides:
            since = time - ephemeris.time_of_ephemeris
            assert (0 <= since < 7200) if ephemeris.system else (-7200 <= since < 0)
        assert store.table(time) is table
        time += 1200.5
    assert len(store.table(end + 86400)) == 0


def test_a_table_holds_until_the_next_change(nominal):
    store = EphemerisStore(nominal)
    start = min(validity_interval(one)[0] for one in nominal)
    change = store.next_change(start)
    table = store.table(start)
    assert store.table(dataclasses.replace(change, nanoseconds=change.nanoseconds - 1)) is table
    assert store.table(change) is not table
    assert store.next_change(max(validity_interval(one)[1] for one in nominal)) is None


def test_health_and_source_of_the_real_day():
    day = navigation(BRDC).ephemerides
    noon = parse_epoch("2024-01-10T12:00:00 GPS")
    healthy = EphemerisStore(day).table(noon).ephemerides
    every = EphemerisStore(day, healthy_only=False).table(noon).ephemerides
    names = {(e.system, e.prn) for e in every}
    assert {e.health for e in healthy} == {0}
    assert {(e.system, e.prn) for e in healthy} < names
    assert (SYSTEM_GPS, 1) in names  # G01 was set unhealthy that day
    assert (SYSTEM_GPS, 1) not in {(e.system, e.prn) for e in healthy}
    assert all(validity_interval(e)[0] <= noon < validity_interval(e)[1] for e in every)
    fnav = EphemerisStore(day, sources=(EPHEMERIS_SOURCE_FNAV,)).table(noon)
    assert {int(s) for s in fnav.system} == {SYSTEM_GALILEO}


def test_successive_real_sets_agree_to_metres():
    day = [e for e in navigation(BRDC).ephemerides if e.system == SYSTEM_GPS and not e.health]
    day.sort(key=lambda e: (e.prn, e.time_of_ephemeris))
    differences = []
    for old, new in zip(day, day[1:], strict=False):
        if old.prn == new.prn and new.time_of_ephemeris - old.time_of_ephemeris == 7200:
            middle = old.time_of_ephemeris + 3600
            states = EphemerisTable([old, new]).states(middle)
            differences.append(np.linalg.norm(np.diff(states.position_itrf, axis=0)))
    assert len(differences) > 250
    assert np.median(differences) < 1.5
