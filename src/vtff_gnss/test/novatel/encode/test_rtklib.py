"""Encoded logs through RTKLIB's decoder, which is not ours.

RTKLIB 2.4.3 b34 reads RANGE, RANGECMP and RAWEPHEM of GPS. It leaves out L2C, and keeps C/N0 as a
whole number of 0.001 dB-Hz.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from encoder_test_support import TIME, gps_observation_epoch, nominal_ephemeris
from rtklib_test_support import EPHEMERIS_FIELDS, pyrtklib, rtklib_ephemeris, rtklib_epoch

from vtff_gnss import constants as c
from vtff_gnss.ephemeris import lnav_accuracy
from vtff_gnss.novatel import ReceiverLogStream
from vtff_gnss.novatel.encode.ephemeris import encode_rawephem
from vtff_gnss.novatel.encode.frame import HeaderSettings
from vtff_gnss.novatel.encode.lnav import parity, quantize_lnav
from vtff_gnss.novatel.encode.range import encode_range, encode_rangecmp
from vtff_gnss.observations import OBSERVATION_COLUMNS

SETTINGS = HeaderSettings()


def rtklib_events(content: bytes) -> tuple[list, list]:
    raw = pyrtklib.raw_t()
    pyrtklib.init_raw(raw, pyrtklib.STRFMT_OEM4)
    epochs, ephemerides = [], []
    for byte in content:
        result = pyrtklib.input_oem4(raw, byte)
        if result == 1:
            epochs.append(rtklib_epoch(raw))
        elif result == 2:
            ephemerides.append(rtklib_ephemeris(raw))
    return epochs, ephemerides


def l1_l2_epoch(step: int):
    """Return L1 C/A and L2P(Y) of 12 satellites, 50 ms apart."""
    epoch = gps_observation_epoch(12, time=TIME + 0.05 * step, seed=step)
    chosen = epoch.attribute != ord("S")
    columns = {name: getattr(epoch, name)[chosen] for name in OBSERVATION_COLUMNS}
    columns["lock_time"] = np.full(24, 100.0 + 0.05 * step, dtype=np.float32)
    columns["flags"] = columns["flags"].copy()
    columns["flags"][step % 24] |= c.FLAG_HALF_CYCLE_ADDED
    return replace(epoch, **columns)


@pytest.mark.parametrize("encode", [encode_range, encode_rangecmp])
def test_observations_equal_those_of_rtklib(encode):
    content = b"".join(encode(l1_l2_epoch(step), SETTINGS) for step in range(5))
    theirs, _ = rtklib_events(content)
    ours = ReceiverLogStream().feed(content)
    assert len(theirs) == len(ours) == 5
    for (time, signals), epoch in zip(theirs, ours, strict=True):
        assert round(time * 1e3) * 1_000_000 == epoch.time.nanoseconds
        assert len(signals) == len(epoch) == 24
        for i in range(24):
            key = (
                int(epoch.system[i]),
                int(epoch.prn[i]),
                f"{epoch.band[i]}{chr(epoch.attribute[i])}",
            )
            values = signals[key]
            assert values["pseudorange"] == epoch.pseudorange[i]
            assert values["carrier_phase_cycles"] == epoch.carrier_phase_cycles[i]
            assert values["doppler_hz"] == epoch.doppler_hz[i]
            assert values["cn0_dbhz"] == pytest.approx(float(epoch.cn0_dbhz[i]), abs=0.00051)
            assert bool(values["lli"] & 64) == bool(epoch.flags[i] & c.FLAG_HALF_CYCLE_ADDED)
            assert values["lli"] & 3 == 0


def test_ephemerides_equal_those_of_rtklib():
    sent = [
        quantize_lnav(
            replace(nominal_ephemeris(), prn=prn, mean_anomaly=0.1 * prn, af0=1e-6 * (prn - 16))
        )
        for prn in range(1, 33)
    ]
    # RTKLIB takes the week from the epoch of the observations before.
    content = encode_range(l1_l2_epoch(0), SETTINGS)
    content += b"".join(encode_rawephem(ephemeris, SETTINGS) for ephemeris in sent)
    _, theirs = rtklib_events(content)
    assert len(theirs) == 32
    for ephemeris, reference in zip(sent, theirs, strict=True):
        assert reference["satellite"] == (c.SYSTEM_GPS, ephemeris.prn)
        assert round(reference["toe"] * 1e9) == ephemeris.time_of_ephemeris.nanoseconds
        assert round(reference["toc"] * 1e9) == ephemeris.time_of_clock.nanoseconds
        assert lnav_accuracy(reference["ura_index"]) == ephemeris.accuracy
        assert reference["group_delay"] == ephemeris.group_delay
        for field in EPHEMERIS_FIELDS:
            expected = reference[field]
            assert getattr(ephemeris, field) == pytest.approx(expected, rel=1e-15, abs=0.0), field


def test_parity_is_that_of_rtklib():
    decoded = getattr(pyrtklib, "Arr1Dunsigned char")(3)
    generator = np.random.default_rng(5)
    for _ in range(300):
        source, star = int(generator.integers(1 << 24)), int(generator.integers(4))
        bits = parity(source, star >> 1, star & 1)
        sent = source ^ (0xFFFFFF if star & 1 else 0)
        word = star << 30 | sent << 6 | bits
        assert pyrtklib.decode_word(word, decoded) == 1
        assert bytes(decoded[k] for k in range(3)) == source.to_bytes(3, "big")
        assert pyrtklib.decode_word(word ^ 1 << int(generator.integers(6)), decoded) == 0
