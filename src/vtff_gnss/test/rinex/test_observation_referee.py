"""Every value of real observation files against pyrtklib and georinex."""

from __future__ import annotations

import hatanaka
import numpy as np
import pytest
from constellation_test_support import seconds_of, shared_file
from rinex_test_support import REAL_FILES, real_observations

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_gnss import constants as c
from vtff_gnss.rinex.observation import read_rinex_observation

RTKLIB_LETTERS = {1: "G", 2: "S", 4: "R", 8: "E", 16: "J", 32: "C"}
QUANTITIES = {"pseudorange": "C", "carrier_phase_cycles": "L", "cn0_dbhz": "S"}
EVERY = {"leo_250m": 60, "spirent_dynamic": 20, "bele": 60}


def plain_file(name, tmp_path, epochs=None):
    """Return the file without compression, or only the first epochs of it."""
    content = hatanaka.decompress(shared_file(REAL_FILES[name]).read_bytes())
    if epochs is not None:
        content = b"\n>".join(content.split(b"\n>")[: epochs + 1]) + b"\n"
    path = tmp_path / "plain.rnx"
    path.write_bytes(content)
    return path


def rtklib_signals(pyrtklib, obs, chosen):
    """Return by (epoch time in ns, satellite, signal) code, phase, Doppler, C/N0 and LLI."""
    number = pyrtklib.Arr1Dint(1)
    found = {}
    for i in range(obs.n):
        observation = obs.data[i]
        time = round(seconds_of(observation.time) * 1e3) * 1_000_000
        if time not in chosen:
            continue
        letter = RTKLIB_LETTERS[pyrtklib.satsys(observation.sat, number)]
        prn = number[0] - {"S": 100, "J": 192}.get(letter, 0)
        for j in range(pyrtklib.NFREQ + pyrtklib.NEXOBS):
            if observation.code[j] and (observation.P[j] or observation.L[j]):
                key = (time, f"{letter}{prn:02d}", pyrtklib.code2obs(observation.code[j]))
                found[key] = (
                    observation.P[j], observation.L[j], observation.D[j],
                    observation.SNR[j] * 0.001, observation.LLI[j],
                )  # fmt: skip
    return found


def test_every_signal_that_rtklib_keeps_is_equal(tmp_path):
    pyrtklib = pytest.importorskip("pyrtklib", reason="the referee is not installed")
    for name in REAL_FILES:
        assert_equal_to_rtklib(pyrtklib, name, tmp_path)


def assert_equal_to_rtklib(pyrtklib, name, tmp_path):
    ours = real_observations(name).table
    nav, obs, station = pyrtklib.nav_t(), pyrtklib.obs_t(), pyrtklib.sta_t()
    assert pyrtklib.readrnx(str(plain_file(name, tmp_path)), 1, "", obs, nav, station) == 1
    chosen = ours.time_nanoseconds[:: EVERY[name]].tolist()
    theirs = rtklib_signals(pyrtklib, obs, set(chosen))
    assert len({time for time, _, _ in theirs}) == len(chosen)
    seen = 0
    for index in range(0, len(ours), EVERY[name]):
        epoch = ours.epoch(index)
        for i in range(len(epoch)):
            satellite = f"{c.SYSTEM_LETTERS[epoch.system[i]]}{epoch.prn[i]:02d}"
            signal = f"{epoch.band[i]}{chr(epoch.attribute[i])}"
            their = theirs.pop((epoch.time.nanoseconds, satellite, signal), None)
            if their is None:
                continue  # RTKLIB keeps one signal per band and three bands
            seen += 1
            code, phase, doppler, cn0, lock = their
            flags = epoch.flags[i]
            assert (code or np.nan) == pytest.approx(epoch.pseudorange[i], nan_ok=True, abs=0)
            assert (phase or np.nan) == pytest.approx(
                epoch.carrier_phase_cycles[i], nan_ok=True, abs=0
            )
            # RTKLIB holds Doppler shifts in single precision, strengths to 0.001 dB-Hz.
            assert np.float32(doppler) == np.nan_to_num(epoch.doppler_hz[i])
            assert cn0 == pytest.approx(np.nan_to_num(epoch.cn0_dbhz[i]), abs=1.1e-3)
            assert bool(flags & c.FLAG_CODE_VALID) == (code != 0.0)
            assert bool(flags & c.FLAG_PHASE_VALID) == (phase != 0.0)
            if phase != 0.0:
                assert bool(flags & c.FLAG_PARITY_KNOWN) == (lock & 2 == 0)
            assert flags & c.FLAG_LOCK_LOST or not lock & 1
    assert not theirs
    assert seen > 1000, name


def test_every_signal_equals_georinex(tmp_path):
    georinex = pytest.importorskip("georinex", reason="the referee is not installed")
    for name, use, signals in (
        ("leo_250m", "G", ("1C", "2W")),
        ("spirent_dynamic", "E", ("1B", "5Q", "8Q")),
        ("bele", "G", ("1C", "2W", "2X", "5X")),
        ("bele", "C", ("2I", "6I", "7I")),
    ):
        assert_equal_to_georinex(georinex, name, use, signals, tmp_path)


def assert_equal_to_georinex(georinex, name, use, signals, tmp_path):
    path = plain_file(name, tmp_path, epochs=40)
    theirs = georinex.load(path, use=use)
    ours = real_observations(name).table
    system = c.SYSTEM_LETTERS.index(use)
    times = theirs.time.values.astype("datetime64[ns]").astype(np.int64)
    start = np.datetime64("1980-01-06", "ns").astype(np.int64)
    np.testing.assert_array_equal(times - start, ours.time_nanoseconds[:40])
    in_file = set(theirs.sv.values.tolist())
    for signal in signals:
        for column, quantity in QUANTITIES.items():
            prn, values = ours.by_satellite(column, system, int(signal[0]), signal[1])
            satellites = [f"{use}{number:02d}" for number in prn]
            listed = [i for i, satellite in enumerate(satellites) if satellite in in_file]
            later = [i for i in range(len(prn)) if i not in listed]
            assert listed
            assert np.isnan(values[:40, later]).all()
            matrix = theirs[quantity + signal].sel(sv=[satellites[i] for i in listed]).values
            # Its missing values are zero or NaN.
            expected = np.nan_to_num(matrix.astype(values.dtype))
            np.testing.assert_array_equal(np.nan_to_num(values[:40, listed]), expected)


def test_time_tags_are_exact_and_the_day_is_complete():
    table = real_observations("bele").table
    steps = np.diff(table.time_nanoseconds)
    assert len(table) == 2880
    assert set(steps.tolist()) == {30 * NANOSECONDS_PER_SECOND}
    np.testing.assert_array_equal(table.receiver_clock_offset[:2], [2e-9, 2e-9])


def test_filters_keep_the_same_rows():
    everything = real_observations("bele").table
    signals = ("1C", "2W", "6I")
    part = read_rinex_observation(REAL_FILES["bele"], systems="GC", signals=signals).table
    columns = everything.columns
    signal = [f"{b}{chr(a)}" for b, a in zip(columns["band"], columns["attribute"], strict=True)]
    chosen = np.isin(columns["system"], (c.SYSTEM_GPS, c.SYSTEM_BEIDOU))
    chosen &= np.isin(signal, signals)
    for name, column in part.columns.items():
        np.testing.assert_array_equal(column, columns[name][chosen], err_msg=name)
    np.testing.assert_array_equal(part.epoch_index, everything.epoch_index[chosen])
