"""Ionosphere logs of a GPStation-6 and VERSION, from frames made field by field."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from gnss_test_support import binary_frame
from hypothesis import given, settings
from hypothesis import strategies as st

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss import constants as c
from vtff_gnss.novatel import (
    IsmScintillation,
    IsmSlantTec,
    ReceiverLogStream,
    ReceiverVersion,
)

WEEK, MILLISECONDS = 1889, 93_660_000
TIME = GpsTime.from_week_tow(WEEK, MILLISECONDS / 1000.0)
EXAMPLES = settings(max_examples=100)

# prn, frequency, system, first, second; azimuth, elevation, lock, C/N0, then TEC and its change.
TEC_ROWS = [
    ((5, 0, 0, 1, 4), (120.0, 45.0, 600.0, 41.0, 10.5, 0.1, 10.75, 0.25, 11.0, 0.25, 11.5, 0.5)),
    ((11, 0, 5, 1, 2), (270.0, 10.0, 60.0, 38.0, -1.5, 0.0, -1.25, 0.25, -1.0, 0.25, -0.5, 0.5)),
    ((3, -2, 1, 1, 3), (0.0, 80.0, 60.0, 38.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0)),
]
OBS_ROWS = [
    ((5, 0, 0, 1), (120.0, 45.0, 47.5, 600.0, 0.5, 0.25, 0.5, 0.3, 0.01, 0.02, 0.03, 0.04, 0.05)),
    ((5, 0, 0, 7), (120.0, 45.0, 50.0, 600.0, 0.5, 0.25, 0.1, 0.2, 0.01, 0.02, 0.03, 0.04, 0.06)),
    ((11, 0, 5, 3), (270.0, 10.0, 38.0, 60.0, 0.5, 0.25, 0.7, 0.0, 0.1, 0.2, 0.3, 0.4, 0.5)),
    ((7, 3, 1, 1), (0.0, 80.0, 45.0, 60.0, 0.5, 0.25, 0.7, 0.0, 0.1, 0.2, 0.3, 0.4, 0.5)),
]


def tec_payload(rows=TEC_ROWS) -> bytes:
    body = b"".join(struct.pack("<BbBBBxxx12f", *identity, *values) for identity, values in rows)
    return struct.pack("<I", len(rows)) + body


def obs_payload(rows=OBS_ROWS) -> bytes:
    body = b"".join(struct.pack("<BbBB13f", *identity, *values) for identity, values in rows)
    return struct.pack("<I", len(rows)) + body


def tec_frame(payload: bytes | None = None) -> bytes:
    payload = tec_payload() if payload is None else payload
    return binary_frame(1394, payload, week=WEEK, milliseconds=MILLISECONDS)


def obs_frame() -> bytes:
    return binary_frame(1393, obs_payload(), week=WEEK, milliseconds=MILLISECONDS)


def decoded(content: bytes):
    stream = ReceiverLogStream()
    return stream.feed(content) + stream.close(), stream.counters


def test_slant_tec_every_15_seconds():
    events, counters = decoded(tec_frame())
    assert all(isinstance(event, IsmSlantTec) for event in events)
    assert [event.time - TIME for event in events] == [-45.0, -30.0, -15.0, 0.0]
    last = events[-1]
    assert last.system.tolist() == [c.SYSTEM_GPS, c.SYSTEM_GALILEO]
    assert last.prn.tolist() == [5, 11]
    assert last.band_first.tolist() == [1, 1]
    assert last.band_second.tolist() == [2, 5]
    assert [event.stec_tecu.tolist() for event in events] == [
        [10.5, -1.5], [10.75, -1.25], [11.0, -1.0], [11.5, -0.5]
    ]  # fmt: skip
    assert last.stec_change_tecu.tolist() == [0.5, 0.5]
    np.testing.assert_allclose(last.azimuth, np.radians([120.0, 270.0]))
    np.testing.assert_allclose(last.elevation, np.radians([45.0, 10.0]))
    assert counters.signals_unnamed == 1  # GLONASS, whose signal codes are not public


def test_scintillation_indices():
    (event,), counters = decoded(obs_frame())
    assert isinstance(event, IsmScintillation)
    assert event.time == TIME
    assert event.prn.tolist() == [5, 5, 11]
    assert event.band.tolist() == [1, 5, 7]
    assert bytes(event.attribute.tolist()) == b"CQQ"
    np.testing.assert_allclose(event.s4_total, [0.5, 0.1, 0.7], rtol=1e-6)
    np.testing.assert_allclose(event.s4_correction, [0.3, 0.2, 0.0], rtol=1e-6)
    np.testing.assert_allclose(event.sigma_phi[:, -1], [0.05, 0.06, 0.5], rtol=1e-6)
    np.testing.assert_allclose(event.cn0_dbhz, [47.5, 50.0, 38.0])
    np.testing.assert_allclose(event.lock_time, [600.0, 600.0, 60.0])
    assert counters.signals_unnamed == 1


def test_a_log_without_usable_rows_gives_nothing():
    assert decoded(tec_frame(tec_payload([])))[0] == []
    assert decoded(tec_frame(tec_payload(TEC_ROWS[2:])))[0] == []


@EXAMPLES
@given(st.data())
def test_damage_costs_the_log_it_hits_and_nothing_else(data):
    content = bytearray(tec_frame() + obs_frame() + tec_frame())
    first, second = len(tec_frame()), len(tec_frame()) + len(obs_frame())
    hit = data.draw(st.integers(0, first - 1))
    content[hit] ^= data.draw(st.integers(1, 255))
    events, _ = decoded(bytes(content))
    assert [type(event) for event in events] == [IsmScintillation, *4 * [IsmSlantTec]]
    cut = data.draw(st.integers(first, second - 1))
    events, _ = decoded(tec_frame() + obs_frame()[: cut - first] + tec_frame())
    assert [type(event) for event in events] == 8 * [IsmSlantTec]


@pytest.mark.parametrize("message_id", [1393, 1394])
def test_a_count_that_contradicts_the_length_is_no_frame(message_id):
    payload = bytearray(obs_payload())
    payload[:4] = struct.pack("<I", 9)
    frame = binary_frame(message_id, bytes(payload), week=WEEK, milliseconds=MILLISECONDS)
    events, counters = decoded(frame)
    assert events == []
    assert counters.frames_implausible == 1


def version_payload(components) -> bytes:
    body = b"".join(
        struct.pack("<I16s16s16s16s16s12s12s", kind, *(text.encode() for text in texts))
        for kind, *texts in components
    )
    return struct.pack("<I", len(components)) + body


def test_version_names_the_receiver_card():
    other = (2, "OTHER", "S0", "H0", "W0", "B0", "2016/Mar/21", "01:00:00")
    card = (1, "D2LR0G2TT", "BAB12345678", "OEM628-1.00", "OEM060600", "B1", "2016/Mar/21", "1:0")
    events, _ = decoded(binary_frame(37, version_payload([other, card])))
    (version,) = events
    assert isinstance(version, ReceiverVersion)
    assert (version.model, version.serial_number) == ("D2LR0G2TT", "BAB12345678")
    assert (version.hardware_version, version.software_version) == ("OEM628-1.00", "OEM060600")


def test_a_version_without_components_is_malformed():
    events, counters = decoded(binary_frame(37, version_payload([])))
    assert events == []
    assert counters.logs_malformed == 1
