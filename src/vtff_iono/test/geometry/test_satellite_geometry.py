"""Directions of satellites against single lines of sight, and how epochs may be cut."""

import numpy as np
import pytest

from vtff_dynamics.frames.geodetic import itrf_from_geodetic
from vtff_dynamics.time.timescales import parse_epoch
from vtff_gnss import constants as c
from vtff_gnss.orbits.broadcast_orbit import EphemerisTable
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.line_of_sight import lines_of_sight
from vtff_gnss.orbits.nominal_constellation import (
    nominal_galileo_constellation,
    nominal_gps_constellation,
)
from vtff_iono.geometry.satellite_geometry import geometry_from_stores, satellite_geometry

START = parse_epoch("2024-01-10T11:50:00 GPS")
SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def stores():
    end = START + 7200.0
    return {
        c.SYSTEM_GPS: EphemerisStore(nominal_gps_constellation(START, end)),
        c.SYSTEM_GALILEO: EphemerisStore(nominal_galileo_constellation(START, end)),
    }


def observed(epochs, step, prns=(3, 9, 20), system=c.SYSTEM_GPS):
    """Return times (ns), systems, PRNs and positions of a receiver that moves at 7.5 km/s."""
    time = START.nanoseconds + np.arange(epochs) * round(step * SECOND)
    seconds = np.arange(epochs) * step
    geodetic = np.stack((0.2 + seconds / 1e3, 0.5 + 0.0 * seconds, 5e5 + 0.0 * seconds), axis=-1)
    count = len(prns)
    return (
        np.repeat(time, count),
        np.full(epochs * count, system, dtype=np.uint8),
        np.tile(np.array(prns, dtype=np.uint8), epochs),
        np.repeat(itrf_from_geodetic(geodetic), count, axis=0),
    )


def assert_lines_of_sight(store, arguments, geometry):
    """Each row is the line of sight of its satellite with the ephemeris of its time."""
    time, system, prn, position = arguments
    for row in range(0, len(time), 7):
        when = START + 1e-9 * (int(time[row]) - START.nanoseconds)
        ephemeris = store.ephemeris(int(system[row]), int(prn[row]), when)
        assert ephemeris is not None
        sight = lines_of_sight(EphemerisTable([ephemeris]), when, 0.0, position[row], np.zeros(3))
        assert geometry.elevation[row] == pytest.approx(sight.elevation[0], abs=1e-9)
        assert geometry.azimuth[row] == pytest.approx(sight.azimuth[0], abs=1e-9)
        assert geometry.direction_itrf[row] == pytest.approx(sight.direction_itrf[0], abs=1e-9)


@pytest.mark.parametrize(("epochs", "step"), [(40, 30.0), (150, 10.0), (1100, 1.0)])
def test_directions_are_lines_of_sight(stores, epochs, step):
    """Few epochs, many, and more than are computed together, with a change of ephemerides."""
    arguments = observed(epochs, step)
    store = stores[c.SYSTEM_GPS]
    assert_lines_of_sight(store, arguments, satellite_geometry(store, *arguments))


def test_epochs_may_be_cut_anywhere(stores):
    store, arguments = stores[c.SYSTEM_GPS], observed(130, 15.0)
    whole = satellite_geometry(store, *arguments)
    for rows in np.array_split(np.arange(130 * 3).reshape(130, 3), 11):
        one = satellite_geometry(store, *(column[rows.ravel()] for column in arguments))
        for name in ("elevation", "azimuth", "direction_itrf"):
            assert np.array_equal(getattr(one, name), getattr(whole, name)[rows.ravel()])


@pytest.mark.parametrize("epochs", [3, 120])
def test_what_is_unknown_is_nan(stores, epochs):
    """A satellite that does not exist, and an epoch without position; the others keep theirs."""
    store = stores[c.SYSTEM_GPS]
    time, system, prn, position = observed(epochs, 1.0, prns=(3, 99, 9))
    known = satellite_geometry(store, time, system, prn, position)
    position[3:6] = np.nan
    geometry = satellite_geometry(store, time, system, prn, position)
    is_lost = prn == 99
    is_lost[3:6] = True
    assert np.isnan(geometry.elevation[is_lost]).all()
    assert np.isnan(geometry.azimuth[is_lost]).all()
    assert np.isnan(geometry.direction_itrf[is_lost]).all()
    assert np.array_equal(geometry.elevation[~is_lost], known.elevation[~is_lost])
    nothing = satellite_geometry(EphemerisStore([]), time, system, prn, position)
    assert np.isnan(nothing.elevation).all()
    empty = satellite_geometry(store, time[:0], system[:0], prn[:0], position[:0])
    assert empty.direction_itrf.shape == (0, 3)


def test_each_system_has_its_store(stores):
    gps, galileo = observed(20, 60.0), observed(20, 60.0, (2, 3), c.SYSTEM_GALILEO)
    glonass = observed(20, 60.0, (3,), c.SYSTEM_GLONASS)
    joined = [np.concatenate(columns) for columns in zip(gps, galileo, glonass, strict=True)]
    order = np.argsort(joined[0], kind="stable")
    geometry = geometry_from_stores(stores, *(column[order] for column in joined))
    system = joined[1][order]
    for number, arguments in ((c.SYSTEM_GPS, gps), (c.SYSTEM_GALILEO, galileo)):
        alone = satellite_geometry(stores[number], *arguments)
        rows = system == number
        assert np.array_equal(geometry.elevation[rows], alone.elevation)
        assert np.array_equal(geometry.azimuth[rows], alone.azimuth)
        assert np.array_equal(geometry.direction_itrf[rows], alone.direction_itrf)
        assert_lines_of_sight(stores[number], arguments, alone)
    assert np.isnan(geometry.elevation[system == c.SYSTEM_GLONASS]).all()
