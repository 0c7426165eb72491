"""Properties of the built-in GPS and Galileo constellations."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf
from vtff_dynamics.time.timescales import parse_epoch
from vtff_gnss.constants import GPS_PI
from vtff_gnss.orbits.broadcast_orbit import EARTH_ROTATION_RATE_BROADCAST, EphemerisTable
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore, validity_interval
from vtff_gnss.orbits.line_of_sight import lines_of_sight
from vtff_gnss.orbits.message_lattice import clock_steps
from vtff_gnss.orbits.nominal_constellation import (
    nominal_galileo_constellation,
    nominal_gps_constellation,
)

START = parse_epoch("2016-03-21T01:00:00 GPS")
DAY = 86400
BOTH = [nominal_gps_constellation, nominal_galileo_constellation]
RADIUS_550_KM = 6928e3

# Name and resolution in the message: IS-GPS-200 tables 20-I and 20-III; Galileo OS SIS ICD
# ephemeris, clock and BGD tables. (angles and angular rates in semicircles)
ANGLES = {
    "mean_anomaly": (32, -31),
    "longitude_of_ascending_node": (32, -31),
    "inclination": (32, -31),
    "argument_of_perigee": (32, -31),
    "mean_motion_difference": (16, -43),
    "right_ascension_rate": (24, -43),
}
COMMON = {
    "cuc": (16, -29),
    "cus": (16, -29),
    "cic": (16, -29),
    "cis": (16, -29),
    "crc": (16, -5),
    "crs": (16, -5),
    "eccentricity": (33, -33),
}
CLOCKS = {
    0: {"af0": (22, -31), "af1": (16, -43), "group_delay": (8, -31), "toe": (17, 4)},
    3: {
        "af0": (31, -34),
        "af1": (21, -46),
        "group_delay": (10, -32),
        "group_delay_secondary": (10, -32),
    },
}


@pytest.mark.parametrize(("make", "count"), list(zip(BOTH, (31, 24), strict=True)))
@pytest.mark.parametrize("text", ["1999-08-22", "2016-03-21", "2035-12-30"])
def test_values_are_numbers_of_the_message(make, count, text):
    start = parse_epoch(f"{text}T05:00:00 GPS")
    sets = make(start, start)
    assert sorted(e.prn for e in sets) == list(range(1, count + 1))
    for e in sets:
        for name, (bits, exponent) in {**COMMON, **CLOCKS[e.system], **ANGLES}.items():
            value = getattr(e, name) / (GPS_PI if name in ANGLES else 1.0)
            steps = value / 2.0**exponent
            assert abs(steps - round(steps)) < 1e-6, name
            assert -(2 ** (bits - 1)) <= round(steps) < 2 ** (bits - 1), name
        steps = np.sqrt(e.semi_major_axis) * 2.0**19
        assert abs(steps - round(steps)) < 1e-3


@pytest.mark.parametrize("make", BOTH)
def test_sets_of_one_time_do_not_depend_on_the_span(make):
    whole = make(START, START + 2 * DAY)
    assert set(make(START + DAY, START + DAY)) <= set(whole)
    assert make(START, START, seed=1) != make(START, START)
    with pytest.raises(ValueError, match="before start"):
        make(START, START - 1)


@pytest.mark.parametrize("make", BOTH)
def test_orbit_and_clock_join_from_set_to_set(make):
    start = parse_epoch("2016-03-24T00:00:00 GPS")
    sets = sorted(make(start, start + 7 * DAY), key=lambda e: (e.prn, e.time_of_ephemeris))
    position, velocity, clock, turn = [], [], [], []
    for old, new in itertools.pairwise(sets):
        if old.prn != new.prn:
            continue
        states = EphemerisTable([old, new]).states(validity_interval(new)[0])
        distance = np.linalg.norm(np.diff(states.position_itrf, axis=0))
        (position if old.gps_week == new.gps_week else turn).append(distance)
        velocity.append(np.linalg.norm(np.diff(states.velocity_itrf, axis=0)))
        clock.append(abs(np.diff(states.clock_offset)[0]))
    assert max(position) < 1e-5
    assert max(turn) < 0.03
    assert max(velocity) < 1e-5
    assert max(clock) < 1e-18


def test_clock_is_a_continuous_triangle():
    quarter = 4000
    for used_before in (True, False):
        previous = clock_steps(-1, 0, 1, used_before)
        for index in range(4 * quarter + 2):
            offset, drift = clock_steps(index, 0, 1, used_before)
            # 7200 s of drift in 2^-12 offset steps is the offset gained.
            gained = (drift if used_before else previous[1]) * 7200 / 4096
            assert offset - previous[0] == gained
            assert abs(offset) <= quarter * 225
            previous = offset, drift


def test_gps_planes_and_eccentricities():
    sets = nominal_gps_constellation(START, START)
    nodes = np.degrees([e.longitude_of_ascending_node for e in sets])
    plane_of = np.repeat(np.arange(6), (5, 5, 5, 6, 5, 5))
    assert np.ptp((nodes - nodes[0] - 60.0 * plane_of + 180.0) % 360.0) < 1e-6
    inclinations = np.degrees([e.inclination for e in sets])
    assert 53.0 < inclinations.min() and inclinations.max() < 57.0
    assert all(0.001 <= e.eccentricity <= 0.018 for e in sets)
    assert len({e.group_delay for e in sets}) > 20


def test_gps_slots_are_those_of_the_standard():
    # Slot A1 at the epoch of the table, whose Greenwich hour angle is 18 h 36 min 14.4 s.
    epoch = parse_epoch("1993-07-01T00:00:00 UTC")
    table = EphemerisStore(nominal_gps_constellation(epoch, epoch)).table(epoch)
    position = table.states(epoch).position_itrf[0]
    greenwich, node, argument = np.radians([279.06, 272.847, 268.126])
    inclination = table.ephemerides[0].inclination
    expected = np.array(
        [
            np.cos(argument) * np.cos(node - greenwich)
            - np.sin(argument) * np.cos(inclination) * np.sin(node - greenwich),
            np.cos(argument) * np.sin(node - greenwich)
            + np.sin(argument) * np.cos(inclination) * np.cos(node - greenwich),
            np.sin(argument) * np.sin(inclination),
        ]
    )
    angle = np.arccos(position @ expected / np.linalg.norm(position))
    # The table gives mean arguments: the equation of the centre is 2 e at most.
    assert angle < 2.0 * table.ephemerides[0].eccentricity + np.radians(0.2)


def test_gps_ground_track_repeats_each_sidereal_day():
    sets = nominal_gps_constellation(START, START + 2 * DAY)
    first = EphemerisStore(sets).table(START)
    # The Earth's turn below the node, which moves west.
    node_rate = first.ephemerides[0].right_ascension_rate
    sidereal_day = 2.0 * np.pi / (EARTH_ROTATION_RATE_BROADCAST - node_rate)
    second = EphemerisStore(sets).table(START + sidereal_day)
    difference = (
        first.states(START).position_itrf - second.states(START + sidereal_day).position_itrf
    )
    assert np.linalg.norm(difference, axis=-1).max() < 5.0


def test_galileo_is_a_walker_constellation():
    sets = nominal_galileo_constellation(START, START)
    nodes = np.degrees([e.longitude_of_ascending_node for e in sets]).reshape(3, 8)
    arguments = np.degrees([e.mean_anomaly + e.argument_of_perigee for e in sets]).reshape(3, 8)
    assert np.allclose((nodes - nodes[0, 0] + 180) % 360, [[180.0], [300.0], [60.0]], atol=1e-6)
    phases = (arguments - arguments[0, 0] + 1e-3) % 360 - 1e-3
    expected = 45.0 * np.arange(8) + 15.0 * np.arange(3)[:, np.newaxis]
    assert np.allclose(phases, expected, atol=1e-6)


def test_galileo_plane_is_where_the_service_centre_says():
    epoch = parse_epoch("2016-11-21T00:00:00 UTC")
    table = EphemerisStore(nominal_galileo_constellation(epoch, epoch)).table(epoch)
    position = rotation_gcrf_to_itrf(epoch).T @ table.states(epoch).position_itrf[0]
    inclination, node = table.ephemerides[0].inclination, np.radians(317.632)
    normal = np.array(
        [
            np.sin(inclination) * np.sin(node),
            -np.sin(inclination) * np.cos(node),
            np.cos(inclination),
        ]
    )
    # Sidereal time and Earth rotation angle differ by the precession in 17 years.
    assert abs(normal @ position) / np.linalg.norm(position) < np.radians(0.3)


@pytest.mark.parametrize(("makes", "fewest"), [(BOTH[:1], 7), (BOTH[1:], 6), (BOTH, 13)])
def test_satellites_in_view_at_550_km(makes, fewest):
    """Satellites above 5 deg anywhere at 550 km over a day."""
    latitude, longitude = np.meshgrid(
        np.radians(np.arange(-87.5, 90.0, 12.5)), np.radians(np.arange(0.0, 360.0, 20.0))
    )
    zenith = np.stack(
        (
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ),
        axis=-1,
    ).reshape(-1, 1, 3)
    store = EphemerisStore([e for make in makes for e in make(START, START + DAY)])
    minimum = 99
    for begin in range(0, DAY, 7200):
        offset = np.arange(0.0, 7200.0, 900.0)
        position = np.broadcast_to(RADIUS_550_KM * zenith, (len(zenith), len(offset), 3))
        time = START + begin
        sight = lines_of_sight(store.table(time), time, offset, position, np.zeros(3), zenith)
        in_view = (sight.elevation > np.radians(5.0)).sum(axis=-1)
        minimum = min(minimum, int(in_view.min()))
    assert minimum >= fewest
