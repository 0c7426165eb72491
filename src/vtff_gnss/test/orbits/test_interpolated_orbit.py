"""Interpolated orbits against the evaluation of the ephemerides."""

from __future__ import annotations

import numpy as np
import pytest

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.time.timescales import parse_epoch
from vtff_gnss.orbits.broadcast_orbit import EphemerisTable
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.interpolated_orbit import InterpolatedOrbits
from vtff_gnss.orbits.line_of_sight import lines_of_sight, rays_of_epochs
from vtff_gnss.orbits.nominal_constellation import (
    nominal_galileo_constellation,
    nominal_gps_constellation,
)

START = parse_epoch("2016-03-21T01:00:00 GPS")


@pytest.fixture(scope="module")
def table() -> EphemerisTable:
    end = START + 7200
    ephemerides = [
        *nominal_gps_constellation(START, end, 0),
        *nominal_galileo_constellation(START, end, 0),
    ]
    return EphemerisStore(ephemerides).table(START)


@pytest.mark.parametrize("second", [0, 1, 14, 29, 30, 1801])
def test_states_are_those_of_the_ephemerides(table, second):
    orbits = InterpolatedOrbits(table)
    offset = np.linspace(-1.1, 0.1, 25)[:, None]
    exact, found = table.states(START + second, offset), orbits.states(START + second, offset)
    assert found.position_itrf.shape == exact.position_itrf.shape
    # 0.01 mm is asked for; evaluation itself rounds the node (40 rad) to 2e-7 m.
    assert found.position_itrf == pytest.approx(exact.position_itrf, abs=3e-7)
    assert found.velocity_itrf == pytest.approx(exact.velocity_itrf, abs=1e-7)
    assert found.acceleration_itrf == pytest.approx(exact.acceleration_itrf, abs=1e-8)
    clock = SPEED_OF_LIGHT * (found.clock_offset - exact.clock_offset)
    assert np.abs(clock).max() < 1e-8
    assert found.clock_drift == pytest.approx(exact.clock_drift, abs=1e-18)


def test_states_do_not_depend_on_what_was_asked_before(table):
    one, other = InterpolatedOrbits(table), InterpolatedOrbits(table)
    offset = np.array([[-0.95], [0.0]])
    for second in (90, 3, 61):
        one.states(START + second, offset)
    ask = START + 30
    assert np.array_equal(
        one.states(ask, offset).position_itrf, other.states(ask, offset).position_itrf
    )


def test_rays_of_epochs_are_lines_of_sight(table):
    orbits = InterpolatedOrbits(table)
    offset = np.arange(-19, 1) / 20.0 - 3e-5
    random = np.random.default_rng(4)
    for seconds in (0.0, 14.0, 30.0):
        up = random.normal(size=3)
        position = 6.9e6 * up / np.linalg.norm(up) + np.outer(offset, (5e3, -3e3, 4e3))
        velocity = np.tile((5e3, -3e3, 4e3), (20, 1))
        time = START + seconds
        expected = vars(lines_of_sight(orbits, time, offset, position, velocity))
        for name, column in vars(rays_of_epochs(orbits, time, offset, position, velocity)).items():
            np.testing.assert_allclose(column, expected[name], rtol=4e-16, atol=4e-16, err_msg=name)
