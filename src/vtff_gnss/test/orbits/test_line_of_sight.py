"""Light time, range, direction and visibility against independent formulations and RTKLIB."""

from __future__ import annotations

import numpy as np
import pytest
from constellation_test_support import (
    LONG,
    doubles,
    drawn_navigation,
    drawn_navigation_file,
    independent_position_itrf,
    rtklib_time,
)

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.frames.geodetic import geodetic_from_itrf, itrf_from_geodetic
from vtff_dynamics.time.timescales import parse_epoch
from vtff_gnss.orbits.broadcast_orbit import GRAVITATIONAL_PARAMETER_BROADCAST, EphemerisTable
from vtff_gnss.orbits.line_of_sight import (
    earth_obstructs,
    elevation_azimuth,
    ellipsoid_normal,
    lines_of_sight,
)
from vtff_gnss.orbits.nominal_constellation import (
    nominal_galileo_constellation,
    nominal_gps_constellation,
)

START = parse_epoch("2016-03-21T01:00:00 GPS")
LEO = np.array([6100e3, 2900e3, 1500e3])
LEO_VELOCITY = np.array([-3500.0, 4000.0, 5000.0])
GROUND = itrf_from_geodetic([0.65, 2.2, 120.0])
ROTATION_RATE = LONG("7.2921151467e-5")


@pytest.fixture(scope="module")
def ephemerides():
    return nominal_gps_constellation(START, START) + nominal_galileo_constellation(START, START)


@pytest.fixture(scope="module")
def table(ephemerides):
    return EphemerisTable(ephemerides)


def inertial(position_itrf, seconds):
    """Turn Earth-fixed axes into axes that are fixed at START."""
    angle = ROTATION_RATE * LONG(seconds)
    x, y, z = position_itrf
    return np.array(
        [x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle), z]
    )


def independent_range(ephemeris, offset, receiver):
    """Solve the light-time equation in axes fixed at START, in extended precision."""
    gm = GRAVITATIONAL_PARAMETER_BROADCAST[ephemeris.system]
    since_toe = LONG(START - ephemeris.time_of_ephemeris) + LONG(offset)
    here = inertial(receiver.astype(LONG), offset)
    travel_time = LONG(0)
    for _ in range(8):
        there = independent_position_itrf(ephemeris, since_toe - travel_time, gm)
        distance = np.linalg.norm(inertial(there, LONG(offset) - travel_time) - here)
        travel_time = distance / LONG(SPEED_OF_LIGHT)
    return distance


@pytest.mark.parametrize(("receiver", "velocity"), [(LEO, LEO_VELOCITY), (GROUND, np.zeros(3))])
@pytest.mark.parametrize("offset", [0.0, 3217.35])
def test_range_equals_independent_formulation(ephemerides, table, receiver, velocity, offset):
    sight = lines_of_sight(table, START, offset, receiver, velocity)
    expected = [independent_range(e, offset, receiver) for e in ephemerides]
    assert np.abs(sight.range - np.array(expected, dtype=float)).max() < 1e-6


def test_light_time_is_consistent(table):
    sight = lines_of_sight(table, START, 10.0, LEO, LEO_VELOCITY)
    transmitted = table.states(START, 10.0 - sight.travel_time)
    assert np.array_equal(sight.range, SPEED_OF_LIGHT * sight.travel_time)
    angle = 7.2921151467e-5 * sight.travel_time
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y, z = np.moveaxis(transmitted.position_itrf, -1, 0)
    turned = np.stack((x * cosine + y * sine, y * cosine - x * sine, z), axis=-1)
    assert np.abs(turned - sight.position_satellite_itrf).max() < 1e-7
    assert np.abs(np.linalg.norm(turned - LEO, axis=-1) - sight.range).max() < 1e-7
    assert np.abs(np.linalg.norm(sight.direction_itrf, axis=-1) - 1.0).max() < 1e-15
    assert np.abs(sight.clock_offset_satellite - transmitted.clock_offset).max() < 1e-18
    x, y, z = np.moveaxis(transmitted.velocity_itrf, -1, 0)
    turned = np.stack((x * cosine + y * sine, y * cosine - x * sine, z), axis=-1)
    assert np.abs(turned - sight.velocity_satellite_itrf).max() < 1e-7


def test_range_and_angles_equal_rtklib():
    pyrtklib = pytest.importorskip("pyrtklib")
    nav, obs, station = pyrtklib.nav_t(), pyrtklib.obs_t(), pyrtklib.sta_t()
    pyrtklib.readrnx(str(drawn_navigation_file()), 1, "", obs, nav, station)
    table = EphemerisTable(drawn_navigation().ephemerides)
    time = table.ephemerides[0].time_of_ephemeris
    for receiver in (LEO, GROUND):
        sight = lines_of_sight(table, time, 300.0, receiver, np.zeros(3))
        geodetic = geodetic_from_itrf(receiver)
        for i in range(nav.n):
            position, clock = doubles(pyrtklib, [0.0] * 3), doubles(pyrtklib, [0.0])
            when = rtklib_time(pyrtklib, time, 300.0 - sight.travel_time[i])
            pyrtklib.eph2pos(when, nav.eph[i], position, clock, doubles(pyrtklib, [0.0]))
            direction = doubles(pyrtklib, [0.0] * 3)
            distance = pyrtklib.geodist(position, doubles(pyrtklib, receiver), direction)
            # RTKLIB takes the rotation during the flight to first order: 0.2 mm.
            assert abs(sight.range[i] - distance) < 5e-4
            # RTKLIB's elevation and azimuth from its direction, which has no rotation at all.
            angles = doubles(pyrtklib, [0.0, 0.0])
            mine = doubles(pyrtklib, sight.direction_itrf[i])
            pyrtklib.satazel(doubles(pyrtklib, geodetic), mine, angles)
            assert abs(sight.elevation[i] - angles[1]) < 1e-9
            turn = (sight.azimuth[i] - angles[0] + np.pi) % (2 * np.pi) - np.pi
            assert abs(turn) * np.cos(sight.elevation[i]) < 1e-9


def test_range_rate_is_the_derivative_of_the_range(table):
    step = 0.02
    offsets = np.array([-step, 0.0, step])
    receiver = LEO + offsets[:, np.newaxis] * LEO_VELOCITY
    sight = lines_of_sight(table, START, offsets, receiver, LEO_VELOCITY)
    numeric = (sight.range[2] - sight.range[0]) / (2 * step)
    assert np.abs(numeric - sight.range_rate[1]).max() < 1e-6


def test_receivers_and_times_broadcast(table):
    offsets = np.arange(20) / 20.0
    receivers = np.stack((LEO, LEO + 250.0, GROUND))[:, np.newaxis]
    velocity = np.stack((LEO_VELOCITY, LEO_VELOCITY, np.zeros(3)))[:, np.newaxis]
    moving = receivers + offsets[:, np.newaxis] * velocity
    sight = lines_of_sight(table, START, offsets, moving, velocity)
    assert sight.range.shape == (3, 20, len(table))
    assert sight.direction_itrf.shape == (3, 20, len(table), 3)
    assert sight.clock_drift_satellite.shape == (3, 20, len(table))
    for i in range(3):
        one = lines_of_sight(table, START, offsets[7], moving[i, 7], velocity[i, 0])
        assert np.array_equal(one.range, sight.range[i, 7])
        assert np.array_equal(one.azimuth, sight.azimuth[i, 7])
        assert np.array_equal(one.range_rate, sight.range_rate[i, 7])


def test_a_table_without_satellites_has_no_lines_of_sight():
    sight = lines_of_sight(EphemerisTable(()), START, np.zeros(2), np.ones((2, 3)), (0, 0, 0))
    assert sight.range.shape == (2, 0) and sight.direction_itrf.shape == (2, 0, 3)


def test_angles_of_known_directions():
    north, east, up = np.array([0.0, 0, 1]), np.array([0.0, 1, 0]), np.array([1.0, 0, 0])
    directions = np.stack((up, north, east, -north, -east, -up, (north + up) / np.sqrt(2)))
    elevation, azimuth = elevation_azimuth(directions, up)
    assert np.allclose(np.degrees(elevation), [90, 0, 0, 0, 0, -90, 45], atol=1e-12)
    assert np.allclose(np.degrees(azimuth[1:5]), [0, 90, 180, 270], atol=1e-12)
    elevation, azimuth = elevation_azimuth(-np.eye(3), np.array([0.0, 0.0, 1.0]))
    assert np.allclose(np.degrees(elevation), [0, 0, -90])
    assert np.allclose(np.degrees(azimuth[:2]), [0, 270])


def test_zenith_direction_is_the_callers(table):
    radial = LEO / np.linalg.norm(LEO)
    given = lines_of_sight(table, START, 0.0, LEO, LEO_VELOCITY, zenith_itrf=radial)
    default = lines_of_sight(table, START, 0.0, LEO, LEO_VELOCITY)
    assert np.allclose(np.sin(given.elevation), given.direction_itrf @ radial, atol=1e-14)
    tilt = np.arccos(radial @ ellipsoid_normal(LEO))
    assert np.abs(given.elevation - default.elevation).max() <= tilt + 1e-12


@pytest.mark.parametrize("height", [-50e3, 0.0, 100e3])
def test_obstruction_by_a_sphere_is_a_dip_angle(table, height):
    sight = lines_of_sight(table, START, 0.0, LEO, LEO_VELOCITY, LEO / np.linalg.norm(LEO))
    dip = np.arccos((6371e3 + height) / np.linalg.norm(LEO))
    obstructed = earth_obstructs(
        LEO, sight.position_satellite_itrf, height, semi_major_axis=6371e3, flattening=0.0
    )
    assert np.array_equal(obstructed, sight.elevation < -dip)
    assert 5 < obstructed.sum() < len(table) - 5


@pytest.mark.parametrize("height", [0.0, 80e3])
def test_obstruction_by_the_ellipsoid_is_the_lowest_height(height):
    generator = np.random.default_rng(5)
    satellites = generator.normal(size=(300, 3))
    satellites *= 26.6e6 / np.linalg.norm(satellites, axis=-1, keepdims=True)
    fractions = np.linspace(0.0, 1.0, 4001)[:, np.newaxis, np.newaxis]
    heights = geodetic_from_itrf((LEO + fractions * (satellites - LEO)).reshape(-1, 3))[:, 2]
    lowest = heights.reshape(4001, 300).min(axis=0)
    obstructed = earth_obstructs(LEO, satellites, height)
    clear_cut = np.abs(lowest - height) > 500.0
    assert clear_cut.sum() > 290
    assert np.array_equal(obstructed[clear_cut], (lowest < height)[clear_cut])
    assert 50 < obstructed.sum() < 250


def test_obstruction_on_the_ground():
    up = ellipsoid_normal(GROUND)
    east = np.cross([0.0, 0.0, 1.0], up)
    elevations = np.radians([-20.0, -1.0, 1.0, 20.0])[:, np.newaxis]
    satellites = GROUND + 2e7 * (np.sin(elevations) * up + np.cos(elevations) * east)
    assert earth_obstructs(GROUND, satellites).tolist() == [True, True, False, False]
    # A receiver below the surface is obstructed only where the line first descends.
    assert earth_obstructs(GROUND, satellites, 50e3).tolist() == [True, True, False, False]


def test_surface_without_volume_is_refused():
    with pytest.raises(ValueError, match="no volume"):
        earth_obstructs(LEO, GROUND, height=-7e6)
