"""Written RINEX files: read back by our readers, by pyrtklib and by georinex."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from constellation_test_support import BRDC, drawn_navigation_file, navigation, seconds_of
from gnss_test_support import examples, oem_file
from hypothesis import given
from hypothesis import strategies as st
from rinex_test_support import assert_same_rows, in_order_of_signals, names, real_observations

from vtff_dynamics.time.timescales import GpsTime, parse_epoch
from vtff_gnss import constants as c
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.ionosphere_parameters import KlobucharParameters, NeQuickParameters
from vtff_gnss.novatel import read_log
from vtff_gnss.observation_table import ObservationTable
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch
from vtff_gnss.orbits.nominal_constellation import (
    nominal_galileo_constellation,
    nominal_gps_constellation,
)
from vtff_gnss.rinex.navigation import read_rinex_navigation
from vtff_gnss.rinex.observation import parse_rinex_observation, read_rinex_observation
from vtff_gnss.rinex.write.navigation import write_rinex_navigation
from vtff_gnss.rinex.write.observation import format_rinex_observation, write_rinex_observation

VALID = c.FLAG_CODE_VALID | c.FLAG_PHASE_VALID | c.FLAG_PARITY_KNOWN
EPHEMERIS_FIELDS = [field.name for field in dataclasses.fields(BroadcastEphemeris)]


def written(path, observations, **options) -> ObservationTable:
    write_rinex_observation(path, observations, **options)
    return read_rinex_observation(path).table


def epoch(second=0.0, lock_time=0.0, **changes) -> ObservationEpoch:
    """Return an epoch of four signals."""
    columns = {
        "system": [c.SYSTEM_GPS, c.SYSTEM_GPS, c.SYSTEM_GLONASS, c.SYSTEM_GALILEO],
        "prn": [5, 5, 3, 11],
        "band": [1, 2, 1, 7],
        "attribute": [ord(letter) for letter in "CWCQ"],
        "glonass_channel": [0, 0, -4, 0],
        "pseudorange": [2.0e7, 2.0e7 + 1.25, 1.9e7, 2.4e7],
        "carrier_phase_cycles": [1.05e8, 8.2e7, -5.0, 9.6e7],
        "doppler_hz": [-1234.5, -961.0, 0.25, 3000.125],
        "cn0_dbhz": [45.0, 32.5, 51.25, 60.0],
        "pseudorange_sigma": np.full(4, np.nan),
        "carrier_phase_sigma_cycles": np.full(4, np.nan),
        "lock_time": np.full(4, lock_time),
        "flags": np.full(4, VALID),
        **changes,
    }
    typed = {name: np.array(columns[name]).astype(kind) for name, kind in
             OBSERVATION_COLUMNS.items()}  # fmt: skip
    time = parse_epoch("2024-01-10T23:59:59 GPS") + second
    return ObservationEpoch(time, 0, 0, "RINEX", **typed)


def test_real_files_survive_writing(tmp_path):
    for name in ("spirent_dynamic", "bele"):
        table = real_observations(name).table
        original = ObservationTable.from_epochs(table.epoch(i) for i in range(300))
        assert_same_rows(original, written(tmp_path / f"{name}.rnx", original))


def test_receiver_clock_offsets_survive_writing(tmp_path):
    offsets = np.array([1.234567890e-3, np.nan, -2e-9])
    epochs = ObservationTable.from_epochs(epoch(second) for second in range(3))
    table = dataclasses.replace(epochs, receiver_clock_offset=offsets)
    again = written(tmp_path / "clock.rnx", table)
    np.testing.assert_allclose(again.receiver_clock_offset, offsets, rtol=0, atol=1e-15)


def test_a_receiver_log_survives_writing(tmp_path):
    events = read_log(oem_file("gavlab_test2_rcvr1.dat"))
    original = ObservationTable.from_epochs(e for e in events if isinstance(e, ObservationEpoch))
    again = written(tmp_path / "log.rnx", original, marker_name="GAVLAB")
    np.testing.assert_array_equal(original.time_nanoseconds, again.time_nanoseconds)
    flags = original.columns["flags"]
    is_kept = flags & (c.FLAG_CODE_VALID | c.FLAG_PHASE_VALID) != 0
    assert len(again.columns["prn"]) == np.count_nonzero(is_kept)
    ours, theirs = in_order_of_signals(original), in_order_of_signals(again)
    kept = ours["flags"] & (c.FLAG_CODE_VALID | c.FLAG_PHASE_VALID) != 0
    for column, valid, step in (
        ("pseudorange", c.FLAG_CODE_VALID, 5.1e-4),
        ("carrier_phase_cycles", c.FLAG_PHASE_VALID, 5.1e-4),
        ("doppler_hz", c.FLAG_PHASE_VALID, 8e-4),
    ):
        expected = np.where(ours["flags"] & valid != 0, ours[column], np.nan)[kept]
        np.testing.assert_allclose(theirs[column], expected, rtol=0, atol=step, err_msg=column)
    np.testing.assert_allclose(theirs["cn0_dbhz"], ours["cn0_dbhz"][kept], rtol=0, atol=5.1e-4)
    lost = ours["flags"][kept] & c.FLAG_LOCK_LOST != 0
    phase = ours["flags"][kept] & c.FLAG_PHASE_VALID != 0
    assert (theirs["flags"][lost & phase] & c.FLAG_LOCK_LOST != 0).all()


def test_all_columns_that_rinex_has_are_kept(tmp_path):
    epochs = [epoch(second, lock_time=second) for second in range(4)]
    table = written(tmp_path / "four.rnx", epochs)
    assert list(table.epochs()) == epochs


def test_invalid_values_are_left_blank(tmp_path):
    flags = [VALID, c.FLAG_CODE_VALID, c.FLAG_PHASE_VALID, 0]
    table = written(tmp_path / "flags.rnx", [epoch(flags=flags)])
    assert names(table) == ["G05 1C", "G05 2W", "R03 1C"]
    assert table.columns["flags"].tolist() == flags[:3]
    np.testing.assert_array_equal(np.isnan(table.columns["pseudorange"]), [False, False, True])
    np.testing.assert_array_equal(np.isnan(table.columns["doppler_hz"]), [False, True, False])


def test_values_that_do_not_fit_are_left_blank(tmp_path):
    phases = [1.0e10, -1.0e9, 9_999_999_999.0, np.nan]
    table = written(tmp_path / "large.rnx", [epoch(carrier_phase_cycles=phases)])
    has_phase = table.columns["flags"] & c.FLAG_PHASE_VALID != 0
    assert has_phase.tolist() == [False, False, True, False]


def test_slips_and_half_cycle_changes_are_losses_of_lock(tmp_path):
    added, lost = VALID | c.FLAG_HALF_CYCLE_ADDED, VALID | c.FLAG_LOCK_LOST
    flags = [[VALID, VALID, VALID, VALID], [VALID, lost, added, VALID],
             [VALID, VALID, added, VALID]]  # fmt: skip
    table = written(
        tmp_path / "slips.rnx", [epoch(second, flags=row) for second, row in enumerate(flags)]
    )
    is_lost = (table.columns["flags"] & c.FLAG_LOCK_LOST != 0).reshape(3, 4)
    np.testing.assert_array_equal(is_lost.sum(axis=0), [0, 1, 1, 0])
    np.testing.assert_array_equal(is_lost[1], [False, True, True, False])


def test_seconds_are_rounded_to_the_resolution_without_overflow(tmp_path):
    late = dataclasses.replace(epoch(), time=GpsTime(epoch(1).time.nanoseconds - 40))
    path = tmp_path / "late.rnx"
    assert written(path, [late]).time(0) == parse_epoch("2024-01-11T00:00:00 GPS")
    assert "60.0000000" not in path.read_text()


def test_equal_input_gives_equal_files():
    text = format_rinex_observation([epoch()])
    assert text == format_rinex_observation([epoch()])
    assert max(len(line) for line in text.split("END OF HEADER")[0].splitlines()) <= 80


def test_errors():
    with pytest.raises(ValueError, match="no epoch"):
        format_rinex_observation([])
    with pytest.raises(ValueError, match="MARKER NAME"):
        format_rinex_observation([epoch()], marker_name="x" * 61)


@given(
    st.lists(st.floats(-9e8, 9e9), min_size=4, max_size=4),
    st.lists(st.floats(0.001, 9e9), min_size=4, max_size=4),
)
@examples(100)
def test_any_value_survives_to_the_millimetre(phases, codes):
    original = epoch(carrier_phase_cycles=phases, pseudorange=codes)
    text = format_rinex_observation([original])
    found = parse_rinex_observation(text.encode(), "text").table.epoch(0)
    for name in ("pseudorange", "carrier_phase_cycles"):
        rounded = np.round(getattr(original, name), 3)
        expected = np.where(rounded == 0.0, np.nan, rounded)
        np.testing.assert_allclose(getattr(found, name), expected, rtol=0, atol=1.1e-3)


def test_rtklib_and_georinex_read_the_observations(tmp_path):
    path = tmp_path / "log.rnx"
    table = real_observations("spirent_dynamic").table
    write_rinex_observation(path, (table.epoch(i) for i in range(20)), interval=1.0)
    pyrtklib = pytest.importorskip("pyrtklib", reason="the referee is not installed")
    nav, obs, station = pyrtklib.nav_t(), pyrtklib.obs_t(), pyrtklib.sta_t()
    assert pyrtklib.readrnx(str(path), 1, "", obs, nav, station) == 1
    first = table.epoch(0)
    assert seconds_of(obs.data[0].time) == first.time.nanoseconds / 1e9
    is_l1 = (first.system == c.SYSTEM_GPS) & (first.band == 1)
    theirs = {
        obs.data[i].sat: (obs.data[i].P[0], obs.data[i].L[0], obs.data[i].SNR[0] * 0.001)
        for i in range(len(set(zip(first.system.tolist(), first.prn.tolist(), strict=True))))
    }
    for prn, code, phase, cn0 in zip(
        first.prn[is_l1], first.pseudorange[is_l1], first.carrier_phase_cycles[is_l1],
        first.cn0_dbhz[is_l1], strict=True,
    ):  # fmt: skip
        assert theirs[prn][:2] == (code, phase)
        assert theirs[prn][2] == pytest.approx(cn0, abs=1.1e-3)
    georinex = pytest.importorskip("georinex", reason="the referee is not installed")
    dataset = georinex.load(path, use="G")
    prn, values = table.by_satellite("carrier_phase_cycles", c.SYSTEM_GPS, 5, "I")
    listed = [f"G{number:02d}" for number in prn]
    np.testing.assert_array_equal(dataset["L5I"].sel(sv=listed).values, values[:20])


def rtklib_ephemerides(pyrtklib, path):
    nav, obs, station = pyrtklib.nav_t(), pyrtklib.obs_t(), pyrtklib.sta_t()
    assert pyrtklib.readrnx(str(path), 1, "", obs, nav, station) == 1
    return nav


@pytest.mark.parametrize("source", [drawn_navigation_file(), BRDC], ids=["drawn", "brdc"])
def test_navigation_files_survive_writing(source, tmp_path):
    original = navigation(source)
    ephemerides = original.ephemerides[:: max(len(original.ephemerides) // 500, 1)]
    path = tmp_path / "again.rnx"
    write_rinex_navigation(
        path, ephemerides, original.klobuchar, original.nequick, original.leap_seconds
    )
    again = read_rinex_navigation(path)
    assert (again.klobuchar, again.nequick) == (original.klobuchar, original.nequick)
    assert again.leap_seconds == original.leap_seconds
    key = ("system", "prn", "source", "gps_week", "toe", "toc", "issue_of_data_ephemeris", "time")
    ours, theirs = (
        sorted(listed, key=lambda e: tuple(getattr(e, name) for name in key))
        for listed in (ephemerides, again.ephemerides)
    )
    assert len(ours) == len(theirs)
    for mine, their in zip(ours, theirs, strict=True):
        for name in EPHEMERIS_FIELDS:
            a, b = getattr(mine, name), getattr(their, name)
            # The square root of the axis has 13 digits, the axis itself then a few parts in 1e13.
            assert a == b or a == pytest.approx(b, rel=4e-13, abs=0, nan_ok=True), name


def test_nominal_constellations_keep_13_digits_and_rtklib_reads_them(tmp_path):
    start = parse_epoch("2024-01-10T00:00:00 GPS")
    sets = [
        *nominal_gps_constellation(start, start + 3600),
        *nominal_galileo_constellation(start, start + 3600),
    ]
    path = tmp_path / "nominal.rnx"
    klobuchar = KlobucharParameters((1.1176e-8, 0.0, -5.9605e-8, 0.0), (9.0112e4, 0.0, -2e5, 0.0))
    write_rinex_navigation(path, sets, klobuchar, NeQuickParameters((66.25, 0.1, 0.0)), 18)
    again = read_rinex_navigation(path)
    assert len(again.ephemerides) == len(sets)
    assert again.klobuchar == klobuchar
    pyrtklib = pytest.importorskip("pyrtklib", reason="the referee is not installed")
    nav = rtklib_ephemerides(pyrtklib, path)
    assert nav.n >= len({(e.system, e.prn) for e in sets})
    georinex = pytest.importorskip("georinex", reason="the referee is not installed")
    dataset = georinex.load(path, use="G")
    gps = sorted({e.prn for e in sets if e.system == c.SYSTEM_GPS})
    assert sorted(int(str(sv)[1:3]) for sv in dataset.sv.values) == gps
    chosen = next(e for e in sets if e.system == c.SYSTEM_GPS)
    theirs = dataset["Eccentricity"].sel(sv=f"G{chosen.prn:02d}").values
    assert np.any(np.isclose(theirs, chosen.eccentricity, rtol=1e-12, atol=0))


def test_other_ephemerides_are_refused(tmp_path):
    some = nominal_gps_constellation(parse_epoch("2024-01-10T00:00:00 GPS"),
                                     parse_epoch("2024-01-10T01:00:00 GPS"))[0]  # fmt: skip
    cnav = dataclasses.replace(some, source=c.EPHEMERIS_SOURCE_CNAV)
    with pytest.raises(ValueError, match=f"G{some.prn:02d}, source 1"):
        write_rinex_navigation(tmp_path / "cnav.rnx", [cnav])
