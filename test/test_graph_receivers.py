"""`vtff run reference`: two receivers, SimGEN and a thruster in the loop, all of them emulated."""

from __future__ import annotations

import numpy as np
import pytest
from graph_support import (
    RECEIVER_FLIGHT,
    RECEIVER_FLIGHT_DURATION,
    ROOT,
    assert_equal_messages,
    topics,
)

from vtff_bag.file.reader import BagReader
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_gnss import constants as c
from vtff_node.conversions.gnss import ephemeris_from_message, observations_from_message
from vtff_node.plain_yaml import format_yaml, parse_yaml

pyrtklib = pytest.importorskip("pyrtklib", reason="the referee decoder is not installed")

SYSTEM = "reference.yaml"
CRAFT = ("chief", "deputy")
DURATION = RECEIVER_FLIGHT_DURATION


@pytest.fixture(scope="module")
def run(runs):
    return runs.make("receivers_1", SYSTEM, *RECEIVER_FLIGHT, "--distributed", "--no-report")[0]


@pytest.fixture(scope="module")
def again(runs):
    return runs.make("receivers_2", SYSTEM, *RECEIVER_FLIGHT, "--composed")[0]


def messages(folder, topic):
    return [item.message for item in BagReader(folder).messages(topic)]


@pytest.mark.parametrize("craft", CRAFT)
def test_every_epoch_is_there_from_the_first_on(run, craft):
    fast, whole = (messages(run, f"/{craft}/gnss/{name}") for name in ("high_rate", "epoch"))
    times = np.array([observations_from_message(message).time.nanoseconds for message in fast])
    assert len(fast) == 20 * DURATION + 1
    assert set(np.diff(times)) == {NANOSECONDS_PER_SECOND // 20}
    assert whole == fast[::20]
    assert min(len(message.prn) for message in fast) >= 3 * 6
    assert len(messages(run, f"/{craft}/gnss/fix")) == DURATION + 1


def test_two_runs_are_equal_byte_for_byte(run, again):
    """One in separate processes, one composed."""
    names = topics(run)
    assert names == topics(again)
    assert {f"/{craft}/gnss/{name}" for craft in CRAFT for name in ("high_rate", "raw")} <= names
    assert_equal_messages(run, again, names)


# ---- the referee -----------------------------------------------------------------------------


def satellite(number):
    prn = pyrtklib.Arr1Dint(1)
    assert pyrtklib.satsys(number, prn) == pyrtklib.SYS_GPS
    return prn[0]


def referee(content):
    """Return epochs (time in s, signals) and ephemerides as RTKLIB decodes a byte stream."""
    raw = pyrtklib.raw_t()
    pyrtklib.init_raw(raw, pyrtklib.STRFMT_OEM4)
    epochs, ephemerides = [], []
    for byte in content:
        result = pyrtklib.input_oem4(raw, byte)
        if result == 1:
            signals = {}
            for i in range(raw.obs.n):
                seen = raw.obs.data[i]
                for j in range(pyrtklib.NFREQ + pyrtklib.NEXOBS):
                    if seen.code[j]:
                        key = (satellite(seen.sat), pyrtklib.code2obs(seen.code[j]))
                        signals[key] = (seen.P[j], seen.L[j], seen.D[j], seen.SNR[j], seen.LLI[j])
            time = raw.obs.data[0].time
            epochs.append((time.time + time.sec, signals))
        elif result == 2:
            source = raw.nav.eph[raw.ephsat - 1]
            ephemerides.append((satellite(raw.ephsat), source))
    return epochs, ephemerides


@pytest.fixture(scope="module", params=CRAFT)
def decoded(request, run):
    """Return the craft and what the referee makes of the bytes that came through its port."""
    content = b"".join(bytes(m.data) for m in messages(run, f"/{request.param}/gnss/raw"))
    return request.param, *referee(content)


def test_the_referee_sees_the_same_observations(run, decoded):
    craft, epochs, _ = decoded
    published = messages(run, f"/{craft}/gnss/high_rate")
    assert len(epochs) == len(published)
    gps_to_unix = 315_964_800
    for (time, signals), message in zip(epochs, published, strict=True):
        epoch = observations_from_message(message)
        seconds = epoch.time.nanoseconds / NANOSECONDS_PER_SECOND
        assert time - gps_to_unix == pytest.approx(seconds, abs=1e-6)
        assert len(signals) == len(epoch)
        for i in range(len(epoch)):
            name = f"{epoch.band[i]}{chr(epoch.attribute[i])}"
            code, phase, doppler, strength, indicator = signals[int(epoch.prn[i]), name]
            assert code == epoch.pseudorange[i]
            assert phase == epoch.carrier_phase_cycles[i]
            assert doppler == epoch.doppler_hz[i]
            assert strength == pytest.approx(1e3 * epoch.cn0_dbhz[i], abs=0.51)
            assert bool(indicator & 1) == bool(epoch.flags[i] & c.FLAG_LOCK_LOST)


EPHEMERIS_FIELDS = {
    **{
        "semi_major_axis": "A",
        "eccentricity": "e",
        "inclination": "i0",
        "inclination_rate": "idot",
    },
    **{"longitude_of_ascending_node": "OMG0", "right_ascension_rate": "OMGd"},
    **{"argument_of_perigee": "omg", "mean_anomaly": "M0", "mean_motion_difference": "deln"},
    **{"af0": "f0", "af1": "f1", "af2": "f2", "issue_of_data_ephemeris": "iode"},
    **{name: name for name in ("cuc", "cus", "crc", "crs", "cic", "cis")},
}


def test_the_referee_sees_the_same_ephemerides(run, decoded):
    craft, _, theirs = decoded
    published = [ephemeris_from_message(m) for m in messages(run, f"/{craft}/gnss/ephemeris")]
    assert len(published) == len(theirs) >= 8
    for ours, (prn, reference) in zip(published, theirs, strict=True):
        assert ours.prn == prn
        assert ours.group_delay == reference.tgd[0]
        for name, theirs_name in EPHEMERIS_FIELDS.items():
            expected = getattr(reference, theirs_name)
            assert getattr(ours, name) == pytest.approx(expected, rel=1e-15, abs=0.0), name


# ---- faults ----------------------------------------------------------------------------------

#: Fault, and the seconds in which its receiver may be without epochs.
FAULTS = {
    "slip": ({"cycles": 3.0}, 0),
    "half_cycle": ({}, 0),
    "outage": ({"duration": 5.0}, 0),
    "clock_jump": ({"seconds": 1e-3}, 0),
    "silent": ({"duration": 5.0}, 5),
    "corrupted_bytes": ({"duration": 10.0, "rate": 4e-4}, 10),
    "dropped_bytes": ({"duration": 10.0, "rate": 4e-4}, 10),
}
#: Each fault has a window of its own in one flight: its time, its duration, and its recovery.
FIRST_FAULT_TIME = 10
RECOVERY = 6


def fault_windows():
    """Return the seconds of the flight in which each fault begins and has passed."""
    windows, start = {}, FIRST_FAULT_TIME
    for kind, (given, _) in FAULTS.items():
        windows[kind] = start, start + int(given.get("duration", 0)) + RECOVERY
        start = windows[kind][1]
    return windows


@pytest.fixture(scope="module")
def disturbed(runs, run, tmp_path_factory):
    """Return the flight in which the deputy's receiver has one fault after the other."""
    content = parse_yaml((ROOT / "config/gnss/reference.yaml").read_text())
    epochs = messages(run, "/deputy/gnss/epoch")
    for kind, (start, _) in fault_windows().items():
        fault = {"kind": kind, "receiver": "deputy", "time": float(start), **FAULTS[kind][0]}
        if kind in ("slip", "half_cycle"):
            fault["satellite"], fault["signal"] = f"G{epochs[start].prn[0]:02}", "G1C"
        content["faults"].append(fault)
    path = tmp_path_factory.mktemp("faults") / "gnss.yaml"
    path.write_text(format_yaml(content))
    duration = max(end for _, end in fault_windows().values())
    return runs.make(
        "faults", SYSTEM, "--duration", duration, f"gnss:={path}", "--no-report"
    )[0]  # fmt: skip


@pytest.fixture(scope="module")
def seconds_with_epochs(disturbed):
    """Return the seconds of the flight that have an epoch, by spacecraft."""
    seconds = {}
    for craft in CRAFT:
        epochs = map(observations_from_message, messages(disturbed, f"/{craft}/gnss/epoch"))
        times = np.array([epoch.time.nanoseconds for epoch in epochs])
        seconds[craft] = (times - times[0]) // NANOSECONDS_PER_SECOND
    return seconds


@pytest.mark.parametrize("kind", FAULTS)
def test_the_graph_carries_on(seconds_with_epochs, kind):
    silent_seconds = FAULTS[kind][1]
    window = range(*fault_windows()[kind])
    assert np.isin(window, seconds_with_epochs["chief"]).all()
    present = np.isin(window, seconds_with_epochs["deputy"])
    # The epochs are back when the fault has passed.
    assert present[-RECOVERY + 1 :].all()
    missing = np.count_nonzero(~present)
    assert missing == silent_seconds if kind == "silent" else missing <= silent_seconds


def test_faults_neither_stop_nor_shorten_the_flight(disturbed, seconds_with_epochs):
    duration = max(end for _, end in fault_windows().values())
    assert len(messages(disturbed, "/deputy/propulsion/thrust_applied")) == duration + 1
    for craft in CRAFT:
        seconds = seconds_with_epochs[craft]
        assert (seconds[0], seconds[-1]) == (0, duration)
        assert len(set(seconds)) == len(seconds)
    assert len(seconds_with_epochs["chief"]) == duration + 1
