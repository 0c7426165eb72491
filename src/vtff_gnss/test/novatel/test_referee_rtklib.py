"""Every real log against pyrtklib, a decoder that is not ours.

All signals of these files are in both. RTKLIB 2.4.3 b34 differs in this, and only this is allowed
for:

- The carrier phase of GLONASS in RANGECMP is 1e-9 until GLOEPHEMERIS told it the frequency channel
  (160 signals of rtklib_oemv, all 6976 of gavlab_test2_rcvr1); here the channel in RANGECMP itself
  is used. Those phases are compared with NovAtel's own decompression in range/test_range_vectors.
- Pseudorange without code lock and carrier phase and Doppler without phase lock are 0; here the
  values are kept and flagged. The files have no such signal.
- It would leave out L1P, L2C, GLONASS L2 C/A and GLONASS of unknown parity; the files have none.
- It reads neither GPSEPHEM (compared with its ASCII twin instead) nor ASCII logs, nor RANGECMP2,
  4 and 5 (compared with NovAtel's decoder in range/test_range_vectors).
- An ephemeris with the IODE of the one before is not given again; here, one of equal content.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from gnss_test_support import oem_file
from rtklib_test_support import EPHEMERIS_FIELDS, pyrtklib, rtklib_ephemeris, rtklib_epoch

from vtff_gnss import constants as c
from vtff_gnss.ephemeris import BroadcastEphemeris, GlonassEphemeris, lnav_accuracy
from vtff_gnss.novatel import StreamCounters, read_log
from vtff_gnss.observations import ObservationEpoch
from vtff_gnss.signals import satellite_name

PHASE_WITHOUT_CHANNEL = 1e-9
LLI_SLIP, LLI_PARITY_UNKNOWN, LLI_HALF_CYCLE_ADDED = 1, 2, 64


def rtklib_events(name: str) -> tuple[list, list]:
    raw = pyrtklib.raw_t()
    pyrtklib.init_raw(raw, pyrtklib.STRFMT_OEM4)
    file = pyrtklib.FileWrapper(str(oem_file(name)), "rb")
    epochs, ephemerides = [], []
    while (result := pyrtklib.input_oem4f(raw, file)) != -2:
        if result == 1:
            epochs.append(rtklib_epoch(raw))
        elif result == 2:
            ephemerides.append(rtklib_ephemeris(raw))
    return epochs, ephemerides


def signals_of(epoch: ObservationEpoch) -> dict:
    names = [f"{band}{chr(a)}" for band, a in zip(epoch.band, epoch.attribute, strict=True)]
    keys = zip(epoch.system.tolist(), epoch.prn.tolist(), names, strict=True)
    return {key: index for index, key in enumerate(keys)}


FILES = {
    "rtklib_oemv_200911218.gps": (46, 14),
    "gavlab_test2_rcvr1.dat": (436, 0),
    "gavlab_test2_rcvr2.dat": (429, 0),
    "gavlab_OnceEachAgain.GPS": (2, 0),
    "gavlab_ParsingData.GPS": (0, 0),
}


PHASES_WITHOUT_CHANNEL = {"rtklib_oemv_200911218.gps": 160, "gavlab_test2_rcvr1.dat": 6976}


def test_observations_equal_rtklib():
    for name in FILES:
        assert_observations_equal_rtklib(name)


def assert_observations_equal_rtklib(name):
    theirs, _ = rtklib_events(name)
    ours, known_slots = [], []
    slots: set[int] = set()
    for event in read_log(oem_file(name)):
        if isinstance(event, GlonassEphemeris):
            slots.add(event.prn)
        elif isinstance(event, ObservationEpoch):
            ours.append(event)
            known_slots.append(set(slots))
    assert len(ours) == len(theirs) == FILES[name][0], name
    without_channel = 0
    for epoch, slots, (time, reference) in zip(ours, known_slots, theirs, strict=True):
        assert epoch.time.nanoseconds == round(time * 1e9)
        signals = signals_of(epoch)
        assert set(signals) == set(reference)
        for key, values in reference.items():
            index = signals[key]
            assert values["pseudorange"] == epoch.pseudorange[index]
            assert values["doppler_hz"] == epoch.doppler_hz[index]
            # RTKLIB keeps C/N0 as a whole number of 0.001 dB-Hz.
            assert values["cn0_dbhz"] == pytest.approx(float(epoch.cn0_dbhz[index]), abs=0.00051)
            assert values["lli"] == expected_lli(int(epoch.flags[index])), (time, key)
            if values["carrier_phase_cycles"] == PHASE_WITHOUT_CHANNEL:
                assert key[0] == c.SYSTEM_GLONASS and key[1] not in slots
                without_channel += 1
            else:
                assert values["carrier_phase_cycles"] == epoch.carrier_phase_cycles[index]
    assert without_channel == PHASES_WITHOUT_CHANNEL.get(name, 0)


def expected_lli(flags: int) -> int:
    assert flags & c.FLAG_CODE_VALID and flags & c.FLAG_PHASE_VALID
    return (
        bool(flags & c.FLAG_LOCK_LOST) * LLI_SLIP
        | (not flags & c.FLAG_PARITY_KNOWN) * LLI_PARITY_UNKNOWN
        | bool(flags & c.FLAG_HALF_CYCLE_ADDED) * LLI_HALF_CYCLE_ADDED
    )


def test_ephemerides_equal_rtklib():
    _, theirs = rtklib_events("rtklib_oemv_200911218.gps")
    ours = [
        event
        for event in read_log(oem_file("rtklib_oemv_200911218.gps"))
        if isinstance(event, (BroadcastEphemeris, GlonassEphemeris))
    ]
    assert len(ours) == len(theirs) == 14
    assert sum(isinstance(event, BroadcastEphemeris) for event in ours) == 9
    for event, reference in zip(ours, theirs, strict=True):
        if isinstance(event, GlonassEphemeris):
            assert reference["satellite"] == (c.SYSTEM_GLONASS, event.prn)
            compared = set(reference) - {"satellite", "toe"}
        else:
            assert reference["satellite"] == (event.system, event.prn)
            assert event.time_of_clock.nanoseconds == round(reference["toc"] * 1e9)
            assert event.accuracy == lnav_accuracy(reference["ura_index"])
            assert event.fit_interval == reference["fit_hours"] * 3600.0
            assert event.group_delay == reference["group_delay"]
            compared = set(EPHEMERIS_FIELDS)
        assert event.time_of_ephemeris.nanoseconds == round(reference["toe"] * 1e9)
        for field in compared:
            assert getattr(event, field) == pytest.approx(reference[field], rel=1e-15, abs=0.0), (
                field
            )


def test_repeated_ephemerides_are_all_there_on_request():
    path = oem_file("rtklib_oemv_200911218.gps")
    every = [e for e in read_log(path, every_ephemeris=True) if isinstance(e, BroadcastEphemeris)]
    assert len(every) == 25
    assert {satellite_name(e.system, e.prn) for e in every} == {
        "G03", "G06", "G07", "G08", "G11", "G13", "G16", "G19", "G22",
    }  # fmt: skip


def test_glonass_channels_of_rangecmp_equal_those_of_the_ephemerides():
    events = list(read_log(oem_file("rtklib_oemv_200911218.gps")))
    channels = {e.prn: e.glonass_channel for e in events if isinstance(e, GlonassEphemeris)}
    assert len(channels) == 5
    for epoch in events:
        if isinstance(epoch, ObservationEpoch):
            is_glonass = epoch.system == c.SYSTEM_GLONASS
            for prn, channel in zip(
                epoch.prn[is_glonass], epoch.glonass_channel[is_glonass], strict=True
            ):
                assert channels[int(prn)] == channel
            assert (epoch.glonass_channel[~is_glonass] == 0).all()


def test_gpsephem_equals_its_ascii_twin():
    for names_and_count in (
        ("gavlab_test2_rcvr1.dat", "gavlab_test2_rcvr1_decompressed.ASC", 13),
        ("gavlab_OnceEachAgain.GPS", "gavlab_OnceEachAgain.ASC", 19),
    ):
        assert_gpsephem_equals_its_ascii_twin(*names_and_count)


def assert_gpsephem_equals_its_ascii_twin(binary_name, ascii_name, count):
    binary, text = (
        [e for e in read_log(oem_file(name)) if isinstance(e, BroadcastEphemeris)]
        for name in (binary_name, ascii_name)
    )
    assert len(binary) == len(text) == count
    for ours, twin in zip(binary, text, strict=True):
        for field, value in vars(ours).items():
            reference = getattr(twin, field)
            if isinstance(value, float):
                # ASCII has 10 significant digits at least, except for af0 to af2 (6).
                relative = 1e-5 if field.startswith("af") else 1e-9
                assert reference == pytest.approx(value, rel=relative, abs=1e-300), field
            else:
                assert reference == value, field


def test_gpsephem_orbits_are_gps_orbits():
    for event in read_log(oem_file("gavlab_test2_rcvr1.dat")):
        if isinstance(event, BroadcastEphemeris):
            assert event.semi_major_axis == pytest.approx(26.56e6, rel=2e-3)
            assert event.inclination == pytest.approx(math.radians(55.0), abs=0.1)
            assert abs(event.time_of_ephemeris - event.time) < 7300.0


def test_truncated_file_is_counted_not_raised():
    counters = StreamCounters()
    for _ in read_log(oem_file("rtklib_oemv_200911218.gps"), counters=counters):
        pass
    assert counters.frames_truncated == 1
    assert counters.frames_crc_bad == counters.logs_malformed == 0
    assert np.all([counters.signals_unnamed, counters.signals_without_reference]) == 0
