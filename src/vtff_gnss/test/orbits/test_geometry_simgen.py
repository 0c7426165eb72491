"""Orbits, clocks and geometry against observations made by SimGEN, a simulator that is not ours.

RINEX_GN_Spirent.23N with the code and phase that SimGEN made from it without noise for a static
base and a rover whose true motion is given (Saastamoinen troposphere, Klobuchar ionosphere).
"""

from __future__ import annotations

import csv
import gzip

import numpy as np
import pytest
from constellation_test_support import SPIRENT, doubles, navigation, seconds_of, shared_file

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_gnss.constants import FREQUENCY_L1, FREQUENCY_L2
from vtff_gnss.orbits.broadcast_orbit import EphemerisTable
from vtff_gnss.orbits.line_of_sight import lines_of_sight

pyrtklib = pytest.importorskip("pyrtklib", reason="the RINEX observation reader is not installed")

BASE = np.array([4157177.06580187, 671230.476590636, 4774767.03105544])
WEIGHT = FREQUENCY_L1**2 / (FREQUENCY_L1**2 - FREQUENCY_L2**2)
STEP = 30


def observations(name, tmp_path):
    """Return L1 and L2 code, phase in m and L1 range rate, by (second of the run, PRN)."""
    raw = gzip.decompress(shared_file(SPIRENT.parent / f"{name}.obs.gz").read_bytes())
    path = tmp_path / f"{name}.obs"
    path.write_bytes(raw)
    nav, obs, station = pyrtklib.nav_t(), pyrtklib.obs_t(), pyrtklib.sta_t()
    assert pyrtklib.readrnx(str(path), 1, "", obs, nav, station) == 1
    wavelength = SPEED_OF_LIGHT / FREQUENCY_L1, SPEED_OF_LIGHT / FREQUENCY_L2
    prn, result = pyrtklib.Arr1Dint(1), {}
    start = navigation(SPIRENT).ephemerides[0].time_of_ephemeris.nanoseconds / 1e9
    for i in range(obs.n):
        one = obs.data[i]
        second = round(seconds_of(one.time) - start)
        if second % STEP == 0 and pyrtklib.satsys(one.sat, prn) == 1:
            result[second, prn[0]] = np.array(
                [
                    *(one.P[k] for k in (0, 1)),
                    *(one.L[k] * wavelength[k] for k in (0, 1)),
                    -one.D[0] * wavelength[0],
                ]
            )
    return result


@pytest.fixture(scope="module")
def rover_state():
    """Return true position and velocity by second of the run."""
    path = shared_file(SPIRENT.parent / "Rover-dynamic_motion_Spirent.csv.gz")
    with gzip.open(path, "rt") as file:
        file.readline()
        names = ("Pos_X", "Pos_Y", "Pos_Z", "Vel_X", "Vel_Y", "Vel_Z")
        return {
            int(row["Time_ms"]) // 1000: np.array([float(row[n]) for n in names])
            for row in csv.DictReader(file)
            if int(row["Time_ms"]) % (1000 * STEP) == 0
        }


@pytest.fixture(scope="module")
def table():
    return EphemerisTable(navigation(SPIRENT).ephemerides)


def test_rover_less_base_is_the_geometry(table, rover_state, tmp_path):
    rover = observations("Rover-dynamic_MO_Spirent", tmp_path)
    base = observations("Base-static_MO_Spirent", tmp_path)
    time, rows = (
        table.ephemerides[0].time_of_ephemeris,
        {int(p): i for i, p in enumerate(table.prn)},
    )
    code, phase, rate = [], {}, []
    for second, prn in sorted(rover.keys() & base.keys()):
        state, row = rover_state[second], rows[prn]
        there = lines_of_sight(table, time, float(second), state[:3], state[3:])
        here = lines_of_sight(table, time, float(second), BASE, np.zeros(3))
        # At 100 m troposphere and ionosphere are common, but for low satellites.
        if here.elevation[row] < np.radians(20.0):
            continue
        difference = rover[second, prn] - base[second, prn]
        geometry = there.range[row] - here.range[row]
        clock = there.clock_offset_satellite[row] - here.clock_offset_satellite[row]
        code.append(difference[:2] - geometry + SPEED_OF_LIGHT * clock)
        phase.setdefault(prn, []).append(difference[2:4] - geometry + SPEED_OF_LIGHT * clock)
        rate.append(difference[4] - there.range_rate[row] + here.range_rate[row])
    assert len(code) > 100
    # Printed to 1 mm and (phase) 0.2 mm; true positions to 0.1 mm, velocities to 0.1 mm/s.
    assert np.abs(code).max() < 2e-3
    for residuals in phase.values():
        assert np.ptp(residuals, axis=0).max() < 1e-3
    assert np.abs(rate).max() < 1e-3


def test_one_receiver_is_geometry_clock_and_troposphere(table, rover_state, tmp_path):
    rover = observations("Rover-dynamic_MO_Spirent", tmp_path)
    time, rows = (
        table.ephemerides[0].time_of_ephemeris,
        {int(p): i for i, p in enumerate(table.prn)},
    )
    code, phase = [], {}
    for (second, prn), values in sorted(rover.items()):
        state, row = rover_state[second], rows[prn]
        sight = lines_of_sight(table, time, float(second), state[:3], state[3:])
        # Lower down, models of the troposphere differ by more than a centimetre.
        if sight.elevation[row] < np.radians(40.0):
            continue
        angles = doubles(pyrtklib, [sight.azimuth[row], sight.elevation[row]])
        place = doubles(pyrtklib, geodetic_from_itrf(state[:3]))
        troposphere = pyrtklib.tropmodel(pyrtklib.gtime_t(), place, angles, 0.7)
        model = sight.range[row] - SPEED_OF_LIGHT * sight.clock_offset_satellite[row] + troposphere
        # The ionosphere-free pair has no group delay in it.
        code.append(WEIGHT * values[0] - (WEIGHT - 1.0) * values[1] - model)
        phase.setdefault(prn, []).append(WEIGHT * values[2] - (WEIGHT - 1.0) * values[3] - model)
    assert len(code) > 80
    assert np.abs(code).max() < 0.06
    assert np.std(code) < 0.01
    for residuals in phase.values():
        assert np.ptp(residuals) < 3e-3
