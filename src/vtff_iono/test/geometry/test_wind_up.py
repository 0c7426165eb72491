"""Wind-up against its definition: turns of antennas, and the phases of fields that they send."""

import numpy as np
import pytest

from vtff_dynamics.constants import EARTH_ROTATION_RATE
from vtff_dynamics.frames.geodetic import itrf_from_geodetic
from vtff_gnss.orbits.line_of_sight import ellipsoid_normal
from vtff_iono.geometry.wind_up import WindUpCounter, count_wind_up, wind_up_cycles

RECEIVER = itrf_from_geodetic([0.3, 1.0, 450e3])
UP = ellipsoid_normal(RECEIVER)
EAST = np.cross((0.0, 0.0, 1.0), UP) / np.linalg.norm(np.cross((0.0, 0.0, 1.0), UP))
NORTH = np.cross(UP, EAST)
RANGE = 20_500e3


def rays(elevation, azimuth, heading):
    """Arguments of `wind_up_cycles` of satellites that fly with a heading, seen from no Earth."""
    elevation, azimuth, heading = np.broadcast_arrays(elevation, azimuth, heading)
    horizontal = np.cos(azimuth)[:, None] * NORTH + np.sin(azimuth)[:, None] * EAST
    direction = np.cos(elevation)[:, None] * horizontal + np.sin(elevation)[:, None] * UP
    satellite = RECEIVER + RANGE * direction
    up = satellite / np.linalg.norm(satellite, axis=1, keepdims=True)
    east = np.cross((0.0, 0.0, 1.0), up)
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    north = np.cross(up, east)
    velocity = 3.9e3 * (np.cos(heading)[:, None] * north + np.sin(heading)[:, None] * east)
    velocity -= np.cross((0.0, 0.0, EARTH_ROTATION_RATE), satellite)
    count = len(direction)
    return np.tile(RECEIVER, (count, 1)), direction, np.full(count, RANGE), velocity


def test_a_turn_of_the_satellite_is_a_cycle():
    """At any elevation: cycles follow the heading, and a whole turn is one."""
    heading = np.linspace(0.0, 2.0 * np.pi, 200)
    for elevation in (0.2, 0.8, 1.5):
        cycles = np.unwrap(wind_up_cycles(*rays(elevation, 2.0, heading)), period=1.0)
        expected = np.sign(cycles[-1] - cycles[0]) * heading / (2.0 * np.pi)
        assert cycles - cycles[0] == pytest.approx(expected, abs=1e-9)


def test_it_is_the_phase_of_the_field_that_is_received():
    """Circularly polarised fields in complex numbers, the parts across the ray."""
    generator = np.random.default_rng(0)
    elevation, azimuth = generator.uniform(0.1, 1.55, 50), generator.uniform(0.0, 6.28, 50)
    position, direction, distance, velocity = rays(
        elevation, azimuth, generator.uniform(0.0, 6.28, 50)
    )
    satellite = position + distance[:, None] * direction
    down = -satellite / np.linalg.norm(satellite, axis=1, keepdims=True)
    side = np.cross(down, velocity + np.cross((0.0, 0.0, EARTH_ROTATION_RATE), satellite))
    forward = np.cross(side, down)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    # One dipole sends a quarter of a cycle after the other, and so listens one of the receiver.
    sent = forward + 1j * np.cross(down, forward)
    sent -= np.sum(sent * direction, axis=1, keepdims=True) * direction
    phase = np.angle(np.sum(sent * (NORTH - 1j * EAST), axis=1)) / (2.0 * np.pi)
    difference = wind_up_cycles(position, direction, distance, velocity) - phase
    assert difference - np.round(difference) == pytest.approx(0.0, abs=1e-4)


def test_arcs_count_from_their_begin_without_jumps():
    counter = WindUpCounter()
    cycles = np.linspace(0.3, 3.3, 31)
    wrapped = cycles - np.round(cycles)
    one, two = np.zeros(1, dtype=np.int64), np.ones(1, dtype=np.int64)
    counted = [counter.count(one, two, wrapped[k : k + 1])[0] for k in range(20)]
    assert counted == pytest.approx(cycles[:20] - 0.3)
    # A row without geometry counts nothing, and the next arc of the link begins anew.
    assert counter.count(one, two, np.array([np.nan]))[0] == 0.0
    link, arc = np.zeros(11, dtype=np.int64), np.array([1] * 5 + [2] * 6)
    later = counter.count(link, arc, wrapped[20:])
    assert later == pytest.approx(np.r_[cycles[20:25] - 0.3, cycles[25:] - cycles[25]])
    together = count_wind_up(np.repeat([4, 1, 9], [25, 6, 1]), np.append(wrapped, np.nan))
    assert together == pytest.approx(np.r_[cycles[:25] - 0.3, cycles[25:] - cycles[25], 0.0])
