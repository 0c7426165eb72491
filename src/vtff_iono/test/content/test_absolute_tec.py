"""Absolute TEC of a station: biases of two pairs of codes, contents, mapping, what is rejected."""

import numpy as np
import pytest
from link_simulation import LIGHT, START, observations

from vtff_dynamics.frames.geodetic import itrf_from_geodetic
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.constants import SYSTEM_GPS
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.nominal_constellation import nominal_gps_constellation
from vtff_iono.content.absolute_tec import absolute_tec
from vtff_iono.content.slant_tec import ArcLevels, Rejection
from vtff_iono.geometry.mapping import mapping_factor
from vtff_iono.geometry.satellite_geometry import satellite_geometry
from vtff_iono.geometry.vertical_mapping import vertical_mapping

HOURS = 5.0
STEP = 120.0
SATELLITES = 30
POSITION = itrf_from_geodetic([0.1, -0.8, 40.0])
VERTICAL = 20.0
# Code biases: what each satellite, and the receiver, adds to C2W and C5Q, m.
SATELLITE_BIAS = np.random.default_rng(1).normal(0.0, 1.0, SATELLITES)
RECEIVER_BIAS = {"C2W": 1.7, "C5Q": -2.3}
FACTOR = {"C2W": 9.51775, "C5Q": 7.7627}
KEYS = {code: (SYSTEM_GPS, "C1C", code) for code in FACTOR}


@pytest.fixture(scope="module")
def ephemerides():
    start = GpsTime(START)
    return nominal_gps_constellation(start, start + 3600.0 * HOURS)


def station(ephemerides, epochs, fewer_l5=0):
    """Return times, columns, and elevations of all observations above 10 deg."""
    seconds = np.arange(epochs) * STEP
    prns = np.tile(np.arange(1, SATELLITES + 1, dtype=np.uint8), epochs)
    time = np.repeat(START + np.round(seconds * 1e9).astype(np.int64), SATELLITES)
    geometry = satellite_geometry(
        EphemerisStore(ephemerides), time, np.full(len(prns), SYSTEM_GPS), prns, POSITION
    )
    factor = mapping_factor(geometry.elevation, np.linalg.norm(POSITION), 40.0)
    content = VERTICAL * factor.reshape(epochs, SATELLITES)
    content = np.where(np.isfinite(content), content, 0.0)
    signals = ((1, "C"), (2, "W"), (5, "Q"))
    when, columns = observations(seconds, content, signals, code_sigma=0.2, seed=4)
    satellite = columns["prn"].astype(int) - 1
    for band, code in ((2, "C2W"), (5, "C5Q")):
        is_band = columns["band"] == band
        bias = SATELLITE_BIAS[satellite] + RECEIVER_BIAS[code]
        columns["pseudorange"][is_band] += bias[is_band]
    # An observation each for the three signals.
    elevation = np.repeat(geometry.elevation, 3)
    kept = elevation > np.radians(10.0)
    kept &= (columns["band"] != 5) | (columns["prn"] > fewer_l5)
    return when[kept], {name: column[kept] for name, column in columns.items()}, elevation[kept]


def satellite_bias(link, time):
    """P_second - P_first contains -c DSB."""
    return -float(SATELLITE_BIAS[link.prn - 1]) / LIGHT, 0.1 / LIGHT


@pytest.fixture(scope="module")
def day(ephemerides):
    time, columns, elevation = station(ephemerides, round(3600.0 * HOURS / STEP), fewer_l5=4)
    return absolute_tec(time, columns, POSITION, ephemerides, satellite_bias), columns, elevation


def test_receiver_biases_of_both_pairs(day):
    """The pair with more samples steers; the other one follows by comparison with it."""
    result, _, _ = day
    assert result.remarks == ()
    assert set(result.receiver_biases) == set(KEYS.values())
    errors = {}
    for code, key in KEYS.items():
        bias = result.receiver_biases[key]
        errors[code] = bias.bias_tecu - FACTOR[code] * RECEIVER_BIAS[code]
        assert abs(errors[code]) <= 2.0 * bias.sigma_tecu
        assert bias.sigma_tecu < 5.0
        assert not bias.is_bounded
    primary, other = (result.receiver_biases[KEYS[code]] for code in ("C2W", "C5Q"))
    # The same ionosphere is in both: the errors of the biases are equal but for the code noise.
    assert errors["C5Q"] == pytest.approx(errors["C2W"], abs=0.15)
    difference = other.bias_tecu - primary.bias_tecu
    assert np.array(other.model_tecu) - primary.model_tecu == pytest.approx(difference)
    assert primary.sigma_tecu < other.sigma_tecu < primary.sigma_tecu + 0.1
    assert primary.sampling_sigma_tecu < other.sampling_sigma_tecu
    assert other.spread_tecu == primary.spread_tecu
    assert other.pairs == np.count_nonzero(
        np.isfinite(result.stec_tecu)
        & (result.rows.pairs.link >= 0)
        & np.isin(result.rows.pairs.link, links_of(result, "C5Q"))
    )


def links_of(result, code):
    return [number for number, link in enumerate(result.links) if link.code_second == code]


def test_contents_have_neither_biases_nor_levels_of_single_samples(day):
    result, columns, elevation = day
    first = result.rows.pairs.row_first
    good = result.rejected == 0
    assert good.mean() > 0.9
    truth = VERTICAL * mapping_factor(elevation[first], np.linalg.norm(POSITION), 40.0)
    levels = ArcLevels(result.rows)
    for code, key in KEYS.items():
        rows = good & np.isin(result.rows.pairs.link, links_of(result, code))
        bias = result.receiver_biases[key]
        removed = levels.stec_tecu[rows] - result.stec_tecu[rows]
        assert removed == pytest.approx(bias.bias_tecu, abs=1e-9)
        error = result.stec_tecu[rows] - truth[rows]
        wrong = bias.bias_tecu - FACTOR[code] * RECEIVER_BIAS[code]
        assert np.sqrt(np.mean((error + wrong) ** 2)) < 0.6
        sigma = np.hypot(levels.stec_sigma_tecu[rows], bias.sigma_tecu)
        assert result.stec_sigma_tecu[rows] == pytest.approx(sigma)
    assert result.vtec_tecu[good] * truth[good] / VERTICAL == pytest.approx(
        result.stec_tecu[good], rel=1e-6
    )


def test_geometry_is_that_of_the_first_observation_of_a_row(day):
    result, columns, elevation = day
    first = result.rows.pairs.row_first
    assert len(result.geometry.elevation) == len(columns["prn"])
    assert result.geometry.elevation == pytest.approx(elevation, abs=1e-9)
    assert np.array_equal(result.azimuth, result.geometry.azimuth[first])
    assert np.array_equal(result.rows.elevation, result.geometry.elevation[first])
    mapping = vertical_mapping(
        np.tile(POSITION, (len(first), 1)),
        result.geometry.direction_itrf[first],
        elevation[first],
    )
    assert result.pierce_latitude == pytest.approx(mapping.pierce_latitude)
    assert result.pierce_longitude == pytest.approx(mapping.pierce_longitude)


def test_a_position_for_each_observation(day, ephemerides):
    """Equal positions give the result of one position; no geometry without a position."""
    time, columns, _ = station(ephemerides, 8)
    fixed = absolute_tec(time, columns, POSITION, ephemerides, satellite_bias)
    positions = np.tile(POSITION, (len(time), 1))
    positions[time == time[0]] = np.nan
    moved = absolute_tec(time, columns, positions, ephemerides, satellite_bias)
    is_first = moved.rows.pairs.time == time[0]
    assert (moved.rejected[is_first] & Rejection.NO_GEOMETRY).all()
    assert not (moved.rejected[~is_first] & Rejection.NO_GEOMETRY).any()
    assert np.array_equal(moved.azimuth[~is_first], fixed.azimuth[~is_first])
    assert np.isnan(moved.azimuth[is_first]).all()


def test_few_samples_keep_the_receiver_bias(ephemerides):
    time, columns, _ = station(ephemerides, 2)
    result = absolute_tec(time, columns, POSITION, ephemerides, satellite_bias)
    assert result.receiver_biases == {}
    (remark,) = result.remarks
    assert "pairs of satellites" in remark and "include the receiver bias" in remark
    assert (result.rejected & Rejection.NO_RECEIVER_BIAS).all()
    assert np.array_equal(result.stec_tecu, ArcLevels(result.rows).stec_tecu, equal_nan=True)


def test_a_pair_without_a_common_satellite_has_no_bias(ephemerides):
    """L5 comes from satellites that have no L2."""
    time, columns, _ = station(ephemerides, round(3600.0 * HOURS / STEP))
    kept = np.where(columns["prn"] <= 4, columns["band"] != 2, columns["band"] != 5)
    columns = {name: column[kept] for name, column in columns.items()}
    result = absolute_tec(time[kept], columns, POSITION, ephemerides, satellite_bias)
    assert set(result.receiver_biases) == {KEYS["C2W"]}
    (remark,) = result.remarks
    assert "receiver bias G C1C-C5Q" in remark
    is_l5 = np.isin(result.rows.pairs.link, links_of(result, "C5Q"))
    lacks = (result.rejected & Rejection.NO_RECEIVER_BIAS) != 0
    assert np.array_equal(lacks, is_l5)
