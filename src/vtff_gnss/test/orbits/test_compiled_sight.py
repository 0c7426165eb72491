"""Compiled lines of sight against the array formulas, which are the reference."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from vtff_dynamics.frames.geodetic import itrf_from_geodetic
from vtff_dynamics.time.timescales import parse_epoch
from vtff_gnss.orbits.broadcast_orbit import EphemerisTable
from vtff_gnss.orbits.line_of_sight import LineOfSight, ellipsoid_normal, lines_of_sight
from vtff_gnss.orbits.nominal_constellation import (
    nominal_galileo_constellation,
    nominal_gps_constellation,
)

START = parse_epoch("2016-03-21T01:00:00 GPS")

# What rounding makes of 3e7 m, 4e3 m/s, angles and clocks.
ROUNDING = {"range": 1e-7, "position_satellite_itrf": 1e-7, "range_rate": 1e-10}


def receivers(generator, count):
    """Return positions from the ground up to 2000 km, the first two at a pole and the equator."""
    latitude = np.arcsin(generator.uniform(-1.0, 1.0, count))
    latitude[:2] = 0.5 * np.pi, 0.0
    longitude = generator.uniform(-np.pi, np.pi, count)
    height = generator.choice((-50.0, 300.0, 5e5, 2e6), count)
    return itrf_from_geodetic(np.stack((latitude, longitude, height), axis=-1))


@pytest.mark.parametrize("seed", range(3))
def test_every_quantity_is_that_of_the_array_formulas(seed):
    generator = np.random.default_rng(seed)
    ephemerides = [
        *nominal_gps_constellation(START, START),
        *nominal_galileo_constellation(START, START),
    ]
    # Nominal orbits have no perturbations: drawn ones of the size of real ones, and more.
    perturbed = [
        dataclasses.replace(
            e,
            eccentricity=0.5 * generator.random(),
            inclination_rate=1e-9 * generator.standard_normal(),
            mean_motion_difference=5e-9 * generator.standard_normal(),
            af0=1e-4 * generator.standard_normal(),
            af1=1e-11 * generator.standard_normal(),
            af2=1e-18 * generator.standard_normal(),
            **{name: 1e-6 * generator.standard_normal() for name in ("cuc", "cus", "cic", "cis")},
            **{name: 200.0 * generator.standard_normal() for name in ("crc", "crs")},
        )
        for e in ephemerides
    ]
    table = EphemerisTable([*ephemerides, *perturbed])
    time = ephemerides[0].time_of_ephemeris + float(generator.uniform(-7200.0, 7200.0))
    offset = generator.uniform(-30.0, 30.0, 8)
    position = receivers(generator, 8)
    velocity = 7e3 * generator.standard_normal((8, 3))
    compiled = lines_of_sight(table, time, offset, position, velocity)
    # With the zenith given, array operations compute the same.
    reference = lines_of_sight(table, time, offset, position, velocity, ellipsoid_normal(position))
    for field in dataclasses.fields(LineOfSight):
        found, expected = getattr(compiled, field.name), getattr(reference, field.name)
        assert found.shape == expected.shape
        tolerance = ROUNDING.get(field.name, 1e-11)
        if field.name == "azimuth":
            # On the axis of the Earth north is a matter of rounding.
            found, expected = found[1:], expected[1:]
        np.testing.assert_allclose(found, expected, rtol=1e-13, atol=tolerance, err_msg=field.name)


def test_a_table_without_satellites_has_no_lines_of_sight():
    table = EphemerisTable(())
    sight = lines_of_sight(table, START, np.zeros(2), np.ones((2, 3)), (0, 0, 0))
    assert sight.range.shape == (2, 0) and sight.direction_itrf.shape == (2, 0, 3)
