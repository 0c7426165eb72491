"""Bubbles that drift, walls of any width, patterns that differ from receiver to receiver."""

from __future__ import annotations

import dataclasses
import math
import types

import numpy as np
import pytest

from vtff_dynamics.time.timescales import parse_epoch
from vtff_node.plain_yaml import format_yaml
from vtff_sim_bridge.atmosphere.irregularity import IrregularityRegion
from vtff_sim_bridge.gnss.configuration import load_gnss_configuration
from vtff_sim_bridge.gnss.propagation import Ionosphere
from vtff_sim_bridge.truth.scenario_fields import ScenarioError

START = parse_epoch("2016-03-21T01:00:00 GPS")
RADIUS = 6678137.0
SPEED = 7.4e3
MIDDLE = 6378137.0 + 320e3  # of the region, m
REGION = IrregularityRegion(
    name="bubble",
    latitude_south=math.radians(-10.0),
    latitude_north=math.radians(10.0),
    local_time_start_hours=0.0,
    local_time_end_hours=24.0,
    altitude_bottom=290e3,
    altitude_top=350e3,
    s4=0.8,
    decorrelation_time=0.2,
)


def fluctuations(region, longitude, elapsed, receiver=1):
    """Return the S4 and scattered parts that a receiver meets at longitudes and times, (k,)."""
    up = np.stack((np.cos(longitude), np.sin(longitude), np.zeros_like(longitude)), axis=-1)
    first = np.array([RADIUS, 0.0, 0.0, 0.0, SPEED, 0.0])
    ionosphere = Ionosphere(None, (region,), 5, first)
    rays = types.SimpleNamespace(position_satellite_itrf=(26.6e6 * up)[:, np.newaxis])
    crossings = ionosphere.crossings(
        rays, RADIUS * up, START + float(elapsed[-1]), elapsed, np.array([7]), receiver
    )
    if not crossings:
        return np.zeros(len(elapsed)), np.zeros(len(elapsed), dtype=complex)
    return crossings[0].s4_l1[:, 0], crossings[0].fluctuation[:, 0]


def test_the_pattern_drifts_with_the_plasma():
    """Who moves east as fast as the plasma meets what was there before."""
    elapsed = np.arange(0.0, 60.0, 0.05)
    longitude = SPEED / RADIUS * elapsed
    drifting = dataclasses.replace(REGION, drift_east=150.0)
    _, before = fluctuations(drifting, longitude, elapsed)
    later = elapsed + 40.0
    _, after = fluctuations(drifting, longitude + 40.0 * 150.0 / MIDDLE, later)
    assert after == pytest.approx(before, abs=1e-6)
    _, at_the_same_place = fluctuations(drifting, longitude, later)
    assert np.abs(at_the_same_place - before).mean() > 0.5
    standing = dataclasses.replace(REGION, drift_east=0.0)
    _, first = fluctuations(standing, longitude, elapsed)
    _, second = fluctuations(standing, longitude, later)
    assert second == pytest.approx(first, abs=1e-6)


def test_the_sides_drift_with_the_plasma():
    hours = 24.0 / (2.0 * math.pi)
    greenwich = 1.0  # h, UT at the start
    region = dataclasses.replace(
        REGION,
        local_time_start_hours=greenwich,
        local_time_end_hours=greenwich + 0.2 * hours,
        drift_east=100.0,
    )
    longitude = np.linspace(0.1, 0.3, 20001)
    for elapsed, east in ((0.0, 0.2), (2000.0, 0.2 + 2000.0 * 100.0 / MIDDLE)):
        s4, _ = fluctuations(region, longitude, np.full(len(longitude), elapsed))
        # Mean solar time is of UT1, within 17 s of GPS time.
        assert longitude[np.flatnonzero(s4)[-1]] == pytest.approx(east, abs=20.0 / 13750.0)


def test_receivers_meet_patterns_of_the_correlation_that_is_asked_for():
    elapsed = np.arange(0.0, 2000.0, 0.5)
    longitude = SPEED / RADIUS * elapsed
    for correlation in (0.0, 0.5, 0.9, 1.0):
        region = dataclasses.replace(REGION, correlation=correlation)
        pair = [fluctuations(region, longitude, elapsed, receiver)[1] for receiver in (1, 2)]
        product = np.mean(pair[0] * pair[1].conj())
        assert product == pytest.approx(correlation, abs=0.08)
        for fluctuation in pair:
            assert np.mean(np.abs(fluctuation) ** 2) == pytest.approx(1.0, abs=0.08)


def test_walls_of_fluctuations_are_as_long_as_asked_for():
    elapsed, longitude = np.array([0.0]), np.array([0.0])
    # A ray upwards has 50 km inside.
    for taper_length, s4 in ((50e3, 0.8), (100e3, 0.4)):
        region = dataclasses.replace(REGION, taper_length=taper_length)
        assert fluctuations(region, longitude, elapsed)[0] == pytest.approx(s4, abs=1e-3)


CONFIGURATION = {
    "name": "plasma",
    "seed": 1,
    "atmosphere": {
        "electron_density": {
            "chapman": [
                {
                    "peak_density_per_m3": 1e12,
                    "peak_altitude": 375e3,
                    "scale_height_below": 50e3,
                    "scale_height_above": 50e3,
                }
            ],
            "depletions": [
                {"altitude_bottom": 340e3, "altitude_top": 400e3, "depth": 0.7, "edge_width": 20e3}
            ],
        },
        "regions": [
            {
                "name": "bubble",
                "latitude_south_deg": -10.0,
                "latitude_north_deg": 10.0,
                "local_time_start_hours": 20.0,
                "local_time_end_hours": 22.0,
                "altitude_bottom": 340e3,
                "altitude_top": 400e3,
                "s4": 0.5,
                "decorrelation_time": 0.1,
                "taper_length": 8e3,
                "correlation": 0.6,
                "drift_east": 120.0,
            }
        ],
    },
    "receivers": [{"name": "chief", "cn0_zenith_dbhz": {"G1C": 45.0}}],
}


def load(tmp_path, configuration):
    path = tmp_path / "plasma.yaml"
    path.write_text(format_yaml(configuration), encoding="utf-8")
    return load_gnss_configuration(path)


def test_configuration_has_bubbles_with_walls_and_drift(tmp_path):
    loaded = load(tmp_path, CONFIGURATION)
    (region,) = loaded.regions
    assert (region.taper_length, region.correlation, region.drift_east) == (8e3, 0.6, 120.0)
    bare = {**CONFIGURATION["atmosphere"]["electron_density"]}
    del bare["depletions"]
    atmosphere = {**CONFIGURATION["atmosphere"], "electron_density": bare}
    whole = load(tmp_path, {**CONFIGURATION, "atmosphere": atmosphere}).profile
    altitude = np.array([320e3, 330e3, 335e3, 340e3, 345e3, 350e3, 370e3])
    missing = 1.0 - loaded.profile.density(altitude) / whole.density(altitude)
    # Linear in the missing part between corners of the table, which has steps of some km.
    assert missing == pytest.approx([0.0, 0.0, 0.175, 0.35, 0.525, 0.7, 0.7], abs=0.01)


@pytest.mark.parametrize(
    ("field", "value"), [("taper_length", 0.0), ("correlation", 1.5), ("drift_east", ".nan")]
)
def test_values_that_have_no_meaning_name_the_region(tmp_path, field, value):
    (region,) = CONFIGURATION["atmosphere"]["regions"]
    atmosphere = {**CONFIGURATION["atmosphere"], "regions": [{**region, field: value}]}
    with pytest.raises(ScenarioError, match=field):
        load(tmp_path, {**CONFIGURATION, "atmosphere": atmosphere})
