"""The night of plasma bubbles over Belem, 2024-01-10: the bounds of the project on real data."""

import csv
import dataclasses
import functools
import json

import numpy as np
from iono_test_support import bele_file
from pyarrow import parquet

from vtff_dynamics.time.timescales import GpsTime, parse_epoch
from vtff_gnss.constants import SYSTEM_GPS
from vtff_gnss.files.observation_files import open_ephemerides, open_observations
from vtff_iono.bias.bias_files import read_code_biases
from vtff_iono.content.absolute_tec import absolute_tec
from vtff_iono.content.rate_of_tec import RateOfTecMonitor
from vtff_iono.links.geometry_free import tecu_per_metre
from vtff_iono.links.signal_pairs import DEFAULT_PAIRS

MIDNIGHT = parse_epoch("2024-01-10T00:00:00 GPS")
KEY = (SYSTEM_GPS, "C1C", "C2W")


@functools.lru_cache(maxsize=1)
def solution():
    """Process the day as a user would: GPS L1/L2 and Galileo E1/E5a."""
    file = open_observations(
        bele_file("BELE00BRA_R_20240100000_01D_30S_MO.crx.gz"),
        systems="GE",
        signals=("1C", "2W", "1X", "5X"),
    )
    biases = read_code_biases(bele_file("CAS0OPSRAP_20240100000_01D_01D_DCB.BIA.gz"))
    table = file.table
    return absolute_tec(
        np.repeat(table.time_nanoseconds, np.diff(table.first_row)),
        table.columns,
        file.approximate_position,
        open_ephemerides(bele_file("BRDC00IGS_R_20240100000_01D_MN.rnx.gz")),
        lambda link, time: biases.satellite_bias(
            link.system, link.prn, link.code_first, link.code_second, time
        ),
        pairs=[DEFAULT_PAIRS[0], DEFAULT_PAIRS[2]],
    )


def gps_rows(found):
    is_gps = np.array(
        [(link.system, link.code_first, link.code_second) == KEY for link in found.links] + [False]
    )
    return is_gps[found.rows.pairs.link]


def test_receiver_bias():
    truth = json.loads(bele_file("truth_dcb.json").read_text())
    truth = truth["receiver_DSB_C1C_C2W_ns_CAS"]["BELE"]["value"]
    bias = solution().receiver_biases[KEY]
    value, sigma = bias.code_bias(tecu_per_metre(1575.42e6, 1227.60e6))
    assert abs(value * 1e9 - truth) <= 0.3
    assert abs(value * 1e9 - truth) <= 2.0 * sigma * 1e9
    assert sigma * 1e9 <= 0.5
    galileo = solution().receiver_biases[(3, "C1X", "C5X")]
    value, sigma = galileo.code_bias(tecu_per_metre(1575.42e6, 1176.45e6))
    assert abs(value * 1e9 - 9.969) <= 2.0 * sigma * 1e9  # CAS, the same day


def test_slant_tec_above_30_deg_agrees_with_another_program():
    """pygnss-tec 0.4.2 with the true receiver bias; its times are UTC."""
    found = solution()
    peer = parquet.read_table(bele_file("peers/pygnsstec042_BELE_gps_extDCB.parquet"))
    unix = np.array(peer["time"].cast("int64"))
    leap = GpsTime(0).to_unix_nanoseconds() // 10**6 - 18_000
    satellite = np.array([int(name[1:]) for name in peer["sv"].to_pylist()])
    theirs = (unix - leap) * 256 + satellite
    prn = np.array([link.prn for link in found.links] + [0])[found.rows.pairs.link]
    mine = (found.rows.pairs.time // 1_000_000) * 256 + prn
    use = np.flatnonzero(
        gps_rows(found) & (np.degrees(found.rows.elevation) >= 30.0) & np.isfinite(found.stec_tecu)
    )
    _, one, other = np.intersect1d(mine[use], theirs, return_indices=True)
    assert len(one) > 0.98 * np.count_nonzero(np.array(peer["elevation"]) >= 30.0)
    difference = found.stec_tecu[use[one]] - np.array(peer["stec_dcb_corrected"])[other]
    assert np.std(difference) <= 1.5
    assert abs(np.mean(difference)) <= 1.0
    online = found.rows.stec_tecu[use[one]] - found.receiver_biases[KEY].bias_tecu
    difference = online - np.array(peer["stec_dcb_corrected"])[other]
    assert np.std(difference) <= 1.5
    assert abs(np.mean(difference)) <= 1.0


def test_vertical_tec_is_that_of_an_ionosphere():
    found = solution()
    good = (found.rejected == 0) & np.isfinite(found.vtec_tecu)
    assert np.count_nonzero(good) > 30_000
    assert np.abs(found.vtec_tecu[np.isfinite(found.vtec_tecu)]).max() <= 120.0
    assert np.mean(found.vtec_tecu[good] < 0.0) < 0.001


def above_30_deg_as_in_the_table(rows):
    """Samples whose differences are in the table: its elevations are those 18 s later (UTC)."""
    kept = np.zeros(len(rows), dtype=bool)
    elevation_deg = np.degrees(rows.elevation)
    for link in np.unique(rows.pairs.link):
        own = np.flatnonzero(rows.pairs.link == link)
        later = elevation_deg[own] + 18.0 / 30.0 * np.append(np.diff(elevation_deg[own]), 0.0)
        is_high = later > 30.0
        # The first difference begins below.
        kept[own] = is_high | np.append(is_high[1:], False)
    return kept


def test_roti():
    """The table takes every difference of 30 s for a rate."""
    found = solution()
    is_high = above_30_deg_as_in_the_table(found.rows)
    rows = dataclasses.replace(found.rows, arc=np.where(is_high, found.rows.arc, 0))
    monitor = RateOfTecMonitor(30.0, 300.0)
    windows = [*monitor.update(rows), *monitor.flush()]
    own = {}
    for window in windows:
        start = round((GpsTime(window.time) - MIDNIGHT) - 300.0)
        for link, roti, rates in zip(
            window.link, window.roti_tecu_per_minute, window.rates, strict=True
        ):
            if found.links[link].system == SYSTEM_GPS:
                own[found.links[link].prn, start] = roti, rates
    ratios, same_samples = [], []
    with bele_file("peers/roti5min_BELE.csv").open() as file:
        for row in csv.DictReader(file):
            start = int(row["t"][11:13]) * 3600 + int(row["t"][14:16]) * 60
            roti, rates = own.get((int(row["sv"][1:]), start), (np.nan, 0))
            ratios.append(roti / float(row["roti"]))
            same_samples.append(rates == int(row["n"]))
    ratios, same_samples = np.array(ratios), np.array(same_samples)
    assert len(ratios) == 1308
    assert np.abs(ratios[same_samples] - 1.0).max() <= 0.05
    # In one window an outlier of the wide lane, a slip as far as that can be told then, has broken
    # an arc.
    assert np.count_nonzero(~same_samples) <= 1
    assert np.count_nonzero(~(np.abs(ratios - 1.0) <= 0.05)) <= 1
