"""Encoders of RANGE, RANGECMP and RANGECMP4 against our decoder, NovAtel's, and RTKLIB's."""

from __future__ import annotations

from dataclasses import replace

import novatel_edie
import numpy as np
import pytest
from encoder_test_support import ALL_VALID, TIME, gps_observation_epoch, observation_epoch
from gnss_test_support import (
    L1CA,
    L2C,
    L2P_CODELESS,
    edie_range_vectors,
    events_of,
    examples,
    oem_file,
)
from hypothesis import given
from hypothesis import strategies as st
from novatel_edie import oem

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss import constants as c
from vtff_gnss.novatel import read_log
from vtff_gnss.novatel.encode.frame import HeaderSettings
from vtff_gnss.novatel.encode.range import (
    encode_range,
    encode_range_series,
    encode_rangecmp,
    tracking_status,
)
from vtff_gnss.novatel.encode.rangecmp4 import RangeCmp4Encoder
from vtff_gnss.novatel.range.range_logs import RANGE_RECORD
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch, ObservationSeries
from vtff_gnss.signals import carrier_wavelength

SETTINGS = HeaderSettings()
SIGNALS = [
    (c.SYSTEM_GPS, 1, "C"), (c.SYSTEM_GPS, 2, "W"), (c.SYSTEM_GPS, 2, "S"),
    (c.SYSTEM_GPS, 5, "Q"), (c.SYSTEM_GALILEO, 1, "C"), (c.SYSTEM_GALILEO, 5, "Q"),
    (c.SYSTEM_GALILEO, 7, "Q"), (c.SYSTEM_GALILEO, 8, "Q"), (c.SYSTEM_GLONASS, 1, "C"),
    (c.SYSTEM_GLONASS, 2, "P"), (c.SYSTEM_BEIDOU, 2, "I"), (c.SYSTEM_QZSS, 1, "C"),
]  # fmt: skip


@st.composite
def epochs(draw):
    chosen = draw(
        st.lists(st.tuples(st.sampled_from(SIGNALS), st.integers(1, 10)), max_size=40, unique=True)
    )
    signals = [(s, prn, band, ord(attribute)) for (s, band, attribute), prn in chosen]
    flags = draw(st.lists(st.integers(0, 15), min_size=len(signals), max_size=len(signals)))
    seconds = draw(st.integers(0, 604_799_999)) / 1000.0
    time = GpsTime.from_week_tow(draw(st.integers(1, 4000)), seconds)
    return observation_epoch(signals, time, draw(st.integers(0, 99)), flags=np.array(flags))


def test_typical_status_words():
    words = tracking_status(gps_observation_epoch(1))
    assert words.tolist() == [L1CA, L2P_CODELESS, L2C]
    added = gps_observation_epoch(1, flags=np.full(3, ALL_VALID | c.FLAG_HALF_CYCLE_ADDED))
    assert tracking_status(added)[0] == 0x18109C04
    assert tracking_status(gps_observation_epoch(1), np.array([1, 2, 31]))[2] == L2C | 31 << 5
    unlocked = tracking_status(gps_observation_epoch(1, flags=np.full(3, c.FLAG_CODE_VALID)))
    assert [int(word) & 31 for word in unlocked] == [7, 10, 10]


@given(epochs())
@examples(60)
def test_range_comes_back_bit_for_bit(epoch):
    (decoded,) = events_of(encode_range(epoch, SETTINGS))
    assert decoded == epoch


@pytest.mark.parametrize("first", [0, 3])
def test_range_of_a_series_is_that_of_its_epochs(first):
    whole = gps_observation_epoch(5)
    count, random = 6, np.random.default_rng(5)
    columns = {
        name: column
        if name in ("system", "prn", "band", "attribute", "glonass_channel")
        else np.array([np.roll(column, k) for k in range(count)])
        for name, column in whole.columns().items()
    }
    series = ObservationSeries(
        [whole.time + 0.05 * k for k in range(count)],
        whole.time_status,
        1 << 8,
        "RANGE",
        np.vstack((np.ones((2, len(whole)), bool), random.random((count - 2, len(whole))) < 0.7)),
        **columns,
    )
    epochs = [series.epoch(index) for index in range(first, count)]
    assert encode_range_series(series, SETTINGS)[first:] == [
        encode_range(epoch, SETTINGS) for epoch in epochs
    ]
    assert len(epochs[-1]) < len(whole) and epochs[-1].time == whole.time + 0.25
    channel = np.broadcast_to(np.arange(len(whole), dtype=np.uint8), series.pseudorange.shape)
    with_channels = replace(series, channel=channel)
    assert encode_range_series(with_channels, SETTINGS)[first:] == [
        encode_range(epoch, SETTINGS, channel[0][observed])
        for epoch, observed in zip(epochs, series.is_observed[first:], strict=True)
    ]


def test_range_equals_novatel_encoder():
    epoch = gps_observation_epoch()
    header = oem.Header(
        port_address=0x20, week=1889, milliseconds=9.0e7, time_status=180, receiver_status=0x100,
        receiver_sw_version=15823, idle_time=120,
    )  # fmt: skip
    message = oem.messages.RANGE(header=header)
    message.obs = [
        oem.messages.RANGE_obs_Field(
            sv_prn=int(epoch.prn[i]),
            psr=float(epoch.pseudorange[i]),
            sd_psr=float(epoch.pseudorange_sigma[i]),
            adr=-float(epoch.carrier_phase_cycles[i]),
            sd_adr=float(epoch.carrier_phase_sigma_cycles[i]),
            dop=float(epoch.doppler_hz[i]),
            C_No=float(epoch.cn0_dbhz[i]),
            lock_time=float(epoch.lock_time[i]),
            c_status=int(tracking_status(epoch)[i]),
        )
        for i in range(len(epoch))
    ]
    frame = encode_range(epoch, HeaderSettings(software_version=15823))
    assert frame == message.to_binary().message
    assert len(frame) == 36 + 44 * 36


def test_real_range_vectors_come_back():
    """Real observations of all systems: everything but state, channel and correlator is kept."""
    count = 0
    for event in events_of(edie_range_vectors()):
        if isinstance(event, ObservationEpoch) and event.log_name == "RANGE":
            kept = replace(event, flags=event.flags & np.uint16(15))
            (decoded,) = events_of(encode_range(kept, SETTINGS))
            assert decoded == kept
            count += 1
    assert count > 5


@given(epochs())
@examples(60)
def test_rangecmp_comes_back_to_its_quantum(epoch):
    (decoded,) = events_of(encode_rangecmp(epoch, SETTINGS))
    for name in ("system", "prn", "band", "attribute"):
        assert (getattr(decoded, name) == getattr(epoch, name)).all(), name
    if np.any(epoch.glonass_channel[epoch.system == c.SYSTEM_GLONASS] > -7):
        # A record that has only the number 0 is taken as one of OEMV, which tells no channel.
        assert (decoded.glonass_channel == epoch.glonass_channel).all()
    has_code = (epoch.flags & c.FLAG_CODE_VALID) > 0
    flags = np.where(has_code, epoch.flags, epoch.flags & ~np.uint16(c.FLAG_PHASE_VALID))
    assert (decoded.flags == flags).all()
    assert np.abs(decoded.pseudorange - epoch.pseudorange).max(initial=0.0) <= 0.5 / 128
    difference = np.abs(decoded.carrier_phase_cycles - epoch.carrier_phase_cycles)
    assert difference.max(initial=0.0) <= 0.5 / 256 + 1e-7
    assert np.abs(decoded.doppler_hz - epoch.doppler_hz).max(initial=0.0) <= 0.5 / 256 + 1e-6
    assert np.abs(decoded.cn0_dbhz - epoch.cn0_dbhz).max(initial=0.0) <= 0.5
    lost = epoch.lock_time - decoded.lock_time
    assert lost.min(initial=0.0) >= 0.0 and lost.max(initial=0.0) < 1 / 32
    assert (decoded.pseudorange_sigma >= epoch.pseudorange_sigma).all()
    assert (decoded.carrier_phase_sigma_cycles >= epoch.carrier_phase_sigma_cycles - 1e-9).all()
    again = events_of(encode_rangecmp(replace(decoded, log_name="RANGE"), SETTINGS))
    if np.all(decoded.glonass_channel > -100):
        assert again == [decoded]


def test_rangecmp_of_real_receivers_comes_back_record_for_record():
    for name in ("gavlab_test2_rcvr1.dat", "rtklib_oemv_200911218.gps"):
        epochs = [e for e in read_log(oem_file(name)) if isinstance(e, ObservationEpoch)]
        for epoch in epochs[:: max(1, len(epochs) // 20)]:
            chosen = epoch.system == c.SYSTEM_GPS
            gps = replace(epoch, **{n: getattr(epoch, n)[chosen] for n in OBSERVATION_COLUMNS})
            gps = replace(gps, flags=gps.flags & np.uint16(15))
            assert events_of(encode_rangecmp(gps, SETTINGS)) == [gps]


def edie_range(frames: list[bytes]) -> list[np.ndarray]:
    """Decompress with NovAtel's own decoder; the records of every frame."""
    novatel_edie.disable_internal_logging()
    parser = oem.Parser()
    records = []
    for frame in frames:
        parser.write(frame)
        for message in parser:
            assert message.name == "RANGE"
            content = message.to_binary().message
            count = (len(content) - 36) // 44
            records.append(np.frombuffer(content, RANGE_RECORD, offset=32, count=count))
    return records


def test_rangecmp_equals_novatel_decompression():
    epoch = gps_observation_epoch()
    frame = encode_rangecmp(epoch, SETTINGS)
    assert len(frame) == 36 + 24 * 36
    (theirs,) = edie_range([frame])
    (ours,) = events_of(frame)
    assert (theirs["pseudorange"] == ours.pseudorange).all()
    np.testing.assert_allclose(
        -theirs["accumulated_doppler_cycles"], ours.carrier_phase_cycles, rtol=0, atol=1e-6
    )
    assert (theirs["tracking_status"] == tracking_status(epoch)).all()


def test_rangecmp_saturates():
    epoch = gps_observation_epoch(
        1,
        cn0_dbhz=[5.0, 60.0, 51.4],
        lock_time=[65535.9, 1e6, 0.01],
        pseudorange_sigma=[500.0, 152.0, 0.0],
        carrier_phase_sigma_cycles=[1.0, 0.0, 0.03125],
        doppler_hz=[6e5, -6e5, 0.0],
    )
    (decoded,) = events_of(encode_rangecmp(epoch, SETTINGS))
    assert decoded.cn0_dbhz.tolist() == [20.0, 51.0, 51.0]
    assert decoded.lock_time.tolist() == [65535.875, 65535.96875, 0.0]
    assert decoded.pseudorange_sigma.tolist() == pytest.approx([152.0, 152.0, 0.05])
    assert decoded.carrier_phase_sigma_cycles.tolist() == pytest.approx([1 / 32, 1 / 512, 1 / 32])
    assert decoded.doppler_hz.tolist() == [2.0**19, -(2.0**19), 0.0]  # float32


def test_what_cannot_be_encoded_is_refused():
    with pytest.raises(ValueError, match="whole millisecond"):
        encode_range(gps_observation_epoch(time=TIME + 0.0001), SETTINGS)
    with pytest.raises(ValueError, match="prn: 0 of system 0"):
        encode_range(gps_observation_epoch(1, prn=[1, 1, 0]), SETTINGS)
    with pytest.raises(ValueError, match="signal: 3C of system 0"):
        encode_range(gps_observation_epoch(1, band=[1, 3, 2], attribute=[67, 67, 83]), SETTINGS)
    with pytest.raises(ValueError, match="pseudorange"):
        encode_rangecmp(gps_observation_epoch(1, pseudorange=[-1.0, 2e7, 2e7]), SETTINGS)


def moved(epoch: ObservationEpoch, elapsed: float, acceleration: float) -> ObservationEpoch:
    """Return the epoch later, every satellite with its own range rate and one acceleration."""
    wavelength = carrier_wavelength(epoch.system, epoch.band, epoch.glonass_channel)
    rate = -epoch.doppler_hz.astype(np.float64) * wavelength
    motion = rate * elapsed + 0.5 * acceleration * elapsed**2
    return replace(
        epoch,
        time=epoch.time + elapsed,
        pseudorange=epoch.pseudorange + motion,
        carrier_phase_cycles=epoch.carrier_phase_cycles + motion / wavelength,
        doppler_hz=(-(rate + acceleration * elapsed) / wavelength).astype(np.float32),
        lock_time=(epoch.lock_time + elapsed).astype(np.float32),
    )


def same_rate_epoch(count: int) -> ObservationEpoch:
    """Return observations whose signals of one satellite have one range rate."""
    epoch = gps_observation_epoch(count)
    wavelength = carrier_wavelength(epoch.system, epoch.band)
    rate = np.repeat(np.linspace(-700.0, 700.0, count), 3)
    return replace(epoch, doppler_hz=(-rate / wavelength).astype(np.float32))


def assert_equal_to_rangecmp4(decoded: ObservationEpoch, epoch: ObservationEpoch) -> None:
    # RANGECMP4 sorts the signals by its own numbers: L1 C/A 1, L2P(Y) 4, L2C 5.
    order = np.lexsort((epoch.attribute != ord("W"), epoch.band, epoch.prn, epoch.system))
    wavelength = carrier_wavelength(epoch.system, epoch.band, epoch.glonass_channel)[order]
    for name in ("system", "prn", "band", "attribute"):
        assert (getattr(decoded, name) == getattr(epoch, name)[order]).all(), name
    assert (decoded.flags & 15 == epoch.flags[order] & 15).all()
    assert np.abs(decoded.pseudorange - epoch.pseudorange[order]).max() < 0.00025 + 1e-8
    phase = decoded.carrier_phase_cycles - epoch.carrier_phase_cycles[order]
    assert np.abs(phase * wavelength).max() < 0.00005 + 1e-7
    rate = (decoded.doppler_hz - epoch.doppler_hz[order]) * wavelength
    assert np.abs(rate).max() < 0.00005 + 1e-4
    assert np.abs(decoded.cn0_dbhz - epoch.cn0_dbhz[order]).max() < 0.0251
    assert (decoded.lock_time <= epoch.lock_time[order]).all()
    assert (decoded.pseudorange_sigma >= epoch.pseudorange_sigma[order] * (1 - 1e-6)).all()


@pytest.mark.parametrize(("acceleration", "is_short"), [(0.3, True), (10.0, False)])
def test_rangecmp4_comes_back_and_equals_novatel_decompression(acceleration, is_short):
    start = same_rate_epoch(12)
    encoder = RangeCmp4Encoder()
    series = [moved(start, 0.05 * step, acceleration) for step in range(41)]
    frames = [encoder.encode(epoch, SETTINGS) for epoch in series]
    decoded = events_of(b"".join(frames))
    assert len(decoded) == len(series)
    for ours, epoch, theirs in zip(decoded, series, edie_range(frames), strict=True):
        assert_equal_to_rangecmp4(ours, epoch)
        assert (theirs["prn"] == ours.prn).all()
        np.testing.assert_allclose(theirs["pseudorange"], ours.pseudorange, rtol=0, atol=1e-6)
        np.testing.assert_allclose(
            -theirs["accumulated_doppler_cycles"], ours.carrier_phase_cycles, rtol=0, atol=1e-5
        )
        assert (ours.flags & c.FLAG_LOCK_LOST == 0).all()
    reference, difference = len(frames[0]), len(frames[1])
    assert (reference - 36) / 36 < 13.6 and (difference - 36) / 36 < 11.0
    # At 10 m/s^2 the range rate of secondary signals leaves its 0.8 m/s after 0.08 s.
    short = [len(frame) < 0.9 * reference for frame in frames[1:20]]
    assert short == [is_short or step == 1 for step in range(1, 20)]


def test_rangecmp4_new_satellite_between_seconds():
    encoder = RangeCmp4Encoder()
    both = same_rate_epoch(3)
    one = replace(both, **{n: getattr(both, n)[:6] for n in OBSERVATION_COLUMNS})
    later = moved(both, 0.1, 0.1)
    decoded = events_of(encoder.encode(one, SETTINGS) + encoder.encode(later, SETTINGS))
    assert len(decoded[1]) == 9
    assert_equal_to_rangecmp4(decoded[1], later)


def test_rangecmp4_differences_are_to_their_own_second_only():
    encoder = RangeCmp4Encoder()
    start = same_rate_epoch(3)
    late = moved(start, 1.25, 0.1)
    decoded = events_of(encoder.encode(start, SETTINGS) + encoder.encode(late, SETTINGS))
    assert_equal_to_rangecmp4(decoded[1], late)


def test_rangecmp4_marks_what_does_not_fit_as_invalid():
    epoch = gps_observation_epoch(1)
    wavelength = carrier_wavelength(epoch.system, epoch.band)
    fast = replace(epoch, doppler_hz=(-5000.0 / wavelength).astype(np.float32))
    (decoded,) = events_of(RangeCmp4Encoder().encode(fast, SETTINGS))
    assert np.isnan(decoded.doppler_hz).all() and np.isfinite(decoded.pseudorange).all()
    far = replace(epoch, carrier_phase_cycles=epoch.carrier_phase_cycles + [0.0, 3e3, 0.0])
    (decoded,) = events_of(RangeCmp4Encoder().encode(far, SETTINGS))
    assert (decoded.flags & c.FLAG_PHASE_VALID > 0).tolist() == [True, False, True]


@given(epochs())
@examples(40)
def test_rangecmp4_keeps_validity(epoch):
    (decoded,) = events_of(RangeCmp4Encoder().encode(epoch, SETTINGS))
    assert len(decoded) == len(epoch)
    keys = {
        key: index
        for index, key in enumerate(
            zip(*(getattr(epoch, n).tolist() for n in ("system", "prn", "band", "attribute")),
                strict=True)
        )
    }  # fmt: skip
    for i, key in enumerate(
        zip(*(getattr(decoded, n).tolist() for n in ("system", "prn", "band", "attribute")),
            strict=True)
    ):  # fmt: skip
        flags = int(epoch.flags[keys[key]])
        quality = c.FLAG_PARITY_KNOWN | c.FLAG_HALF_CYCLE_ADDED
        assert int(decoded.flags[i]) & quality == flags & quality
        if decoded.flags[i] & c.FLAG_CODE_VALID:
            assert flags & c.FLAG_CODE_VALID
            assert abs(decoded.pseudorange[i] - epoch.pseudorange[keys[key]]) < 0.00026
        if decoded.flags[i] & c.FLAG_PHASE_VALID:
            assert flags & c.FLAG_PHASE_VALID
