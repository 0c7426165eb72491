"""Encoders of ephemeris, solution, time and version logs against NovAtel's own encoder."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from encoder_test_support import TIME, fix_at, nominal_ephemeris
from gnss_test_support import events_of, examples, oem_file
from hypothesis import given
from hypothesis import strategies as st
from novatel_edie import oem

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss import constants as c
from vtff_gnss import fix as f
from vtff_gnss.constants import GPS_PI
from vtff_gnss.ephemeris import BroadcastEphemeris, galileo_accuracy, lnav_accuracy
from vtff_gnss.novatel import RawLog, read_log
from vtff_gnss.novatel.encode.ephemeris import (
    encode_galileo_ephemeris,
    encode_gpsephem,
    encode_rawephem,
)
from vtff_gnss.novatel.encode.frame import HeaderSettings
from vtff_gnss.novatel.encode.lnav import LnavMessage, encode_subframes, parity, quantize_lnav
from vtff_gnss.novatel.encode.solution import (
    ComponentVersion,
    IonosphereUtc,
    encode_bestxyz,
    encode_ionutc,
    encode_receiver_time,
    encode_version,
)
from vtff_gnss.novatel.header import TIME_STATUS_UNKNOWN

SETTINGS = HeaderSettings(idle_time=0)
HEADER = dict(port_address=0x20, week=1889, milliseconds=9.0e7, receiver_sw_version=0)
NAN3 = (math.nan,) * 3


def header(time_status: int) -> oem.Header:
    return oem.Header(time_status=time_status, **HEADER)


def bits(width: int, signed: bool = True):
    low = -(1 << (width - 1)) if signed else 0
    return st.integers(low, low + (1 << width) - 1)


@st.composite
def lnav_ephemerides(draw, week: int | None = None) -> BroadcastEphemeris:
    """Draw an ephemeris on the grid of the broadcast message."""
    iodc = draw(bits(10, signed=False))
    iode = iodc & 0xFF
    time = GpsTime.from_week_tow(week or draw(st.integers(900, 3000)), 30.0 * draw(
        st.integers(0, 20159)))  # fmt: skip
    toe = 16.0 * draw(st.integers(0, 37799))
    offset = toe - time.time_of_week
    turn = -1 if offset > 302400.0 else 1 if offset < -302400.0 else 0
    # At exactly half a week's distance the frame start decides; keep away from it.
    if abs(abs(offset) - 302400.0) < 60.0:
        toe, turn = 16.0 * (time.time_of_week // 16.0), 0
    index = draw(st.integers(0, 14))
    return BroadcastEphemeris(
        time=time,
        system=c.SYSTEM_GPS,
        prn=draw(st.integers(1, 32)),
        source=c.EPHEMERIS_SOURCE_LNAV,
        issue_of_data_ephemeris=iode,
        issue_of_data_clock=iodc,
        health=draw(bits(6, signed=False)),
        gps_week=time.week + turn,
        toe=toe,
        toc=16.0 * draw(st.integers(0, 37799)),
        af0=draw(bits(22)) * 2.0**-31,
        af1=draw(bits(16)) * 2.0**-43,
        af2=draw(bits(8)) * 2.0**-55,
        semi_major_axis=(draw(st.integers(2_600_000_000, 2_800_000_000)) * 2.0**-19) ** 2,
        eccentricity=draw(st.integers(0, 2**30)) * 2.0**-33,
        inclination=draw(bits(32)) * 2.0**-31 * GPS_PI,
        inclination_rate=draw(bits(14)) * 2.0**-43 * GPS_PI,
        longitude_of_ascending_node=draw(bits(32)) * 2.0**-31 * GPS_PI,
        right_ascension_rate=draw(bits(24)) * 2.0**-43 * GPS_PI,
        argument_of_perigee=draw(bits(32)) * 2.0**-31 * GPS_PI,
        mean_anomaly=draw(bits(32)) * 2.0**-31 * GPS_PI,
        mean_motion_difference=draw(bits(16)) * 2.0**-43 * GPS_PI,
        cuc=draw(bits(16)) * 2.0**-29,
        cus=draw(bits(16)) * 2.0**-29,
        crc=draw(bits(16)) * 2.0**-5,
        crs=draw(bits(16)) * 2.0**-5,
        cic=draw(bits(16)) * 2.0**-29,
        cis=draw(bits(16)) * 2.0**-29,
        group_delay=draw(bits(8)) * 2.0**-31,
        group_delay_secondary=0.0,
        accuracy=lnav_accuracy(index),
        fit_interval=4 * 3600.0,
    )


@given(lnav_ephemerides())
@examples(60)
def test_gps_ephemeris_comes_back_bit_for_bit_in_both_logs(ephemeris):
    (raw,) = events_of(encode_rawephem(ephemeris, SETTINGS))
    assert raw == ephemeris
    (plain,) = events_of(encode_gpsephem(ephemeris, SETTINGS))
    assert plain == ephemeris


def test_quantization_is_within_half_a_step_and_settles():
    quantized = quantize_lnav(nominal_ephemeris())
    assert quantized != nominal_ephemeris() and quantize_lnav(quantized) == quantized
    assert abs(quantized.mean_anomaly - 3.0) <= 2.0**-32 * GPS_PI
    assert abs(math.sqrt(quantized.semi_major_axis) - math.sqrt(26.56e6)) <= 2.0**-20
    assert abs(quantized.af0 - 1e-5) <= 2.0**-32


@pytest.mark.parametrize("generation", ["OEM6", "OEM7"])
def test_gpsephem_equals_novatel_encoder(generation):
    e = nominal_ephemeris()
    definition = {"OEM6": "GPSEPHEM_9145", "OEM7": "GPSEPHEM_1214"}[generation]
    names = {"OEM6": ("prn", "health6"), "OEM7": ("satellite_id", "health7")}[generation]
    mean_motion = math.sqrt(3.986005e14 / e.semi_major_axis**3) + e.mean_motion_difference
    message = getattr(oem.messages, definition)(
        header=header(200), **{names[0]: 7, names[1]: 0}, tow=90000.0, iode1=5, iode2=5, wn=1889,
        zwn=1889, toe=e.toe, a=e.semi_major_axis, delta_n=e.mean_motion_difference,
        m0=e.mean_anomaly, ecc=e.eccentricity, omega=e.argument_of_perigee, cuc=e.cuc, cus=e.cus,
        crc=e.crc, crs=e.crs, cic=e.cic, cis=e.cis, i0=e.inclination, i_dot=e.inclination_rate,
        omega0=e.longitude_of_ascending_node, omega_dot=e.right_ascension_rate, iodc=261,
        toc=e.toc, tgd=e.group_delay, af0=e.af0, af1=e.af1, af2=e.af2, anti_spoofing=True,
        n=mean_motion, eph_var=4.0)  # fmt: skip
    settings = replace(SETTINGS, generation=generation)
    frame = encode_gpsephem(e, settings)
    assert frame == message.to_binary().message
    assert len(frame) == 256


def test_rawephem_equals_novatel_encoder():
    subframes = [list(s) for s in encode_subframes(nominal_ephemeris())]
    message = oem.messages.RAWEPHEM(
        header=header(200), satellite_id=7, week=1889, toe=93600, subframe1=subframes[0],
        subframe2=subframes[1], subframe3=subframes[2])  # fmt: skip
    frame = encode_rawephem(nominal_ephemeris(), SETTINGS)
    assert frame == message.to_binary().message
    assert len(frame) == 134


def real_rawephems() -> list[tuple[BroadcastEphemeris, bytes]]:
    """Return real RAWEPHEM payloads and what they decode to."""
    found, ephemeris = [], None
    path = oem_file("rtklib_oemv_200911218.gps")
    for event in read_log(path, raw_logs="all", every_ephemeris=True):
        if isinstance(event, BroadcastEphemeris):
            ephemeris = event
        elif isinstance(event, RawLog) and event.name == "RAWEPHEMB":
            found.append((ephemeris, event.content[28:-4]))
    return found


def field(subframe: bytes, word: int, first_bit: int, length: int) -> int:
    end = 24 * (word - 1) + first_bit - 1 + length
    return int.from_bytes(subframe, "big") >> (240 - end) & ((1 << length) - 1)


def words_of(subframe: bytes) -> list[int]:
    return [field(subframe, word, 1, 24) for word in range(1, 11)]


def test_real_subframes_come_back_bit_for_bit():
    """All but the reserved bits of subframe 1 (words 4 to 7), which no decoder keeps."""
    pairs = real_rawephems()
    assert len(pairs) == 25
    for ephemeris, payload in pairs:
        real = [payload[start : start + 30] for start in (12, 42, 72)]
        ours = []
        for k in range(3):
            message = LnavMessage(
                telemetry_message=field(real[k], 1, 9, 16),
                is_alert=bool(field(real[k], 2, 18, 1)),
                is_anti_spoofing_on=bool(field(real[k], 2, 19, 1)),
                codes_on_l2=field(real[0], 3, 11, 2),
                is_l2p_data_off=bool(field(real[0], 4, 1, 1)),
                age_of_data_offset=field(real[1], 10, 18, 5),
            )
            # The subframes in the log may be of different frames; the HOW counts in 6 s.
            start = 6.0 * (field(real[k], 2, 1, 17) - (k + 1))
            sent = replace(ephemeris, time=GpsTime.from_week_tow(ephemeris.time.week, start))
            ours.append(encode_subframes(sent, message)[k])
        assert ours[1] == real[1] and ours[2] == real[2]
        mine, theirs = words_of(ours[0]), words_of(real[0])
        for word in (1, 2, 3, 8, 9):
            assert mine[word - 1] == theirs[word - 1], word
        assert (mine[3] ^ theirs[3]) & 1 << 23 == 0 and (mine[6] ^ theirs[6]) & 0xFF == 0
        assert mine[9] >> 2 == theirs[9] >> 2
        # The header of RAWEPHEM tells week and toe as well.
        frame = encode_rawephem(ephemeris, SETTINGS)
        assert frame[28:40] == payload[:12]


def test_parity_of_real_subframes_ends_words_2_and_10_with_zeros():
    for _, payload in real_rawephems():
        for start in (12, 42, 72):
            d29 = d30 = 0
            for word, source in enumerate(words_of(payload[start : start + 30]), start=1):
                d29, d30 = divmod(parity(source, d29, d30) & 3, 2)
                assert word not in (2, 10) or (d29, d30) == (0, 0)


def test_lnav_refuses_what_does_not_fit():
    with pytest.raises(ValueError, match="GPS PRN 7: crs: 5000"):
        encode_subframes(replace(nominal_ephemeris(), crs=5000.0))
    with pytest.raises(ValueError, match="af0"):
        encode_subframes(replace(nominal_ephemeris(), af0=math.nan))
    with pytest.raises(ValueError, match="IODE 6"):
        encode_subframes(replace(nominal_ephemeris(), issue_of_data_ephemeris=6))
    with pytest.raises(ValueError, match="not of GPS LNAV"):
        encode_subframes(replace(nominal_ephemeris(), system=c.SYSTEM_GALILEO))
    with pytest.raises(ValueError, match="required"):
        encode_gpsephem(replace(nominal_ephemeris(), source=c.EPHEMERIS_SOURCE_CNAV), SETTINGS)


def galileo(source: int, **changes) -> BroadcastEphemeris:
    values = dict(system=c.SYSTEM_GALILEO, prn=11, source=source, issue_of_data_ephemeris=77,
                  issue_of_data_clock=77, toe=90000.0, toc=90000.0, health=0,
                  semi_major_axis=(2852000000 * 2.0**-19) ** 2,
                  group_delay=-3e-9, group_delay_secondary=-4e-9, accuracy=galileo_accuracy(107),
                  fit_interval=4 * 3600.0)  # fmt: skip
    return replace(nominal_ephemeris(), **values | changes)


def test_galileo_ephemerides_come_back():
    inav = galileo(c.EPHEMERIS_SOURCE_INAV, health=2 << 7 | 1 << 6 | 1 << 1 | 1)
    fnav = galileo(c.EPHEMERIS_SOURCE_FNAV, health=1 << 4 | 1 << 3, group_delay_secondary=0.0)
    assert events_of(encode_galileo_ephemeris(inav, SETTINGS)) == [inav]
    assert events_of(encode_galileo_ephemeris(fnav, SETTINGS)) == [fnav]
    unknown = replace(inav, accuracy=math.nan)
    (event,) = events_of(encode_galileo_ephemeris(unknown, SETTINGS))
    assert math.isnan(event.accuracy)
    with pytest.raises(ValueError, match="system 0"):
        encode_galileo_ephemeris(nominal_ephemeris(), SETTINGS)


def test_galileo_equals_novatel_encoder():
    e = galileo(c.EPHEMERIS_SOURCE_INAV, health=1 << 7)
    shared = dict(
        sat_id=11, io_dnav=77, sisa=107, toe=90000, toc=90000, m0=e.mean_anomaly,
        delta_n=e.mean_motion_difference, ecc=e.eccentricity, root_a=math.sqrt(e.semi_major_axis),
        i0=e.inclination, i_dot=e.inclination_rate, omega0=e.longitude_of_ascending_node,
        omega=e.argument_of_perigee, omega_dot=e.right_ascension_rate, cuc=e.cuc, cus=e.cus,
        crc=e.crc, crs=e.crs, cic=e.cic, cis=e.cis, af0=e.af0, af1=e.af1, af2=e.af2,
        e1_e5a_bgd=e.group_delay)  # fmt: skip
    inav = oem.messages.GALINAVEPHEMERIS(
        header=header(200), e5b_health=1, inav_signal_type=3, e1_e5b_bgd=-4e-9, **shared
    )
    fnav = oem.messages.GALFNAVEPHEMERIS(header=header(200), **shared)
    assert encode_galileo_ephemeris(e, SETTINGS) == inav.to_binary().message
    e = replace(e, source=c.EPHEMERIS_SOURCE_FNAV, health=0)
    assert encode_galileo_ephemeris(e, SETTINGS) == fnav.to_binary().message


def same_fix(ours: f.Fix, other: f.Fix) -> bool:
    """Compare by text, in which NaN equals NaN."""
    return repr(ours) == repr(other)


def test_bestxyz():
    (fix,) = events_of(encode_bestxyz(fix_at(TIME), SETTINGS))
    assert same_fix(fix, fix_at(TIME))
    none = fix_at(
        TIME, status=f.STATUS_NONE, receiver_solution_type=0, position=NAN3, velocity=NAN3,
        position_sigma=NAN3, velocity_sigma=NAN3,
    )  # fmt: skip
    (fix,) = events_of(encode_bestxyz(none, SETTINGS))
    assert same_fix(fix, none)
    still = fix_at(TIME, velocity=NAN3, velocity_sigma=NAN3)
    (fix,) = events_of(encode_bestxyz(still, SETTINGS))
    assert same_fix(fix, still)


def test_bestxyz_equals_novatel_encoder():
    message = oem.messages.BESTXYZ(
        header=header(180), position_type=16, x=6.6e6, y=-1.2e6, z=3.4e5, x_std_dev=1.5,
        y_std_dev=2.25, z_std_dev=1.75, type=8, x_1=10.5, y_1=7400.25, z_1=-800.125,
        x_std_dev_1=0.125, y_std_dev_1=0.25, z_std_dev_1=0.5, base_id=list(b"AAAA"), num_svs=12,
        num_soln_svs=11, num_soln_L1_svs=11, gps_and_glo_mask=3)  # fmt: skip
    frame = encode_bestxyz(fix_at(TIME), SETTINGS)
    assert frame == message.to_binary().message
    assert len(frame) == 144


def test_time_and_its_utc():
    time = f.ReceiverTime(TIME, True, -2.5e-8, 1e-9, -17.0)
    frame = encode_receiver_time(time, SETTINGS)
    message = oem.messages.TIME(
        header=header(180), offset=-2.5e-8, offset_std=1e-9, utc_offset=-17.0, utc_year=2016,
        utc_month=3, utc_day=21, utc_hour=0, utc_minute=59, utc_millisecond=43000,
        utc_time_status=1)  # fmt: skip
    assert frame == message.to_binary().message
    assert events_of(frame) == [time] and len(frame) == 76
    # UTC is that of true GPS time: a receiver clock 1.5 s fast is taken off.
    fast = replace(time, clock_offset=1.5)
    parser = oem.Parser()
    parser.write(encode_receiver_time(fast, SETTINGS))
    assert next(iter(parser)).utc_millisecond == 41500
    invalid = replace(time, is_valid=False)
    assert events_of(encode_receiver_time(invalid, SETTINGS)) == [invalid]


def test_ionutc_and_version_equal_novatel_encoder():
    parameters = IonosphereUtc.at(TIME, (1e-8, 2e-8, -6e-8, -1e-7), (9e4, 1e5, -6e4, -5e5))
    message = oem.messages.IONUTC(
        header=header(180), a0=1e-8, a1=2e-8, a2=-6e-8, a3=-1e-7, b0=9e4, b1=1e5, b2=-6e4, b3=-5e5,
        w_nt=1889, tot=0, w_nlsf=1889, dn=7, delta_tls=17, delta_tlsf=17)  # fmt: skip
    frame = encode_ionutc(parameters, TIME, SETTINGS)
    assert frame == message.to_binary().message and len(frame) == 140
    frame = encode_version([ComponentVersion(model="G2L")], TIME, SETTINGS)
    parser = oem.Parser()
    parser.write(frame)
    (version,) = list(parser)
    assert version.versions[0].model_name == "G2L"
    assert int(version.versions[0].component_type) == 1
    assert len(frame) == 28 + 4 + 108 + 4
    assert version.to_binary().message == frame
    with pytest.raises(ValueError, match="model"):
        encode_version([ComponentVersion(model="x" * 16)], TIME, SETTINGS)


def test_header_before_the_time_is_known():
    frames = (
        encode_version([ComponentVersion()], None, SETTINGS),
        encode_version([ComponentVersion()], TIME, SETTINGS, TIME_STATUS_UNKNOWN),
    )
    for frame in frames:
        log = events_of(frame, raw_logs="all")[-1]
        assert log.time is None and log.name == "VERSIONB"
        assert frame[13] == TIME_STATUS_UNKNOWN and frame[14:20] == bytes(6)


@pytest.mark.parametrize(
    "fields", [{"port_address": 300}, {"generation": "OEM9"}, {"idle_time": 201}]
)
def test_header_settings_are_checked(fields):
    with pytest.raises(ValueError, match=next(iter(fields))):
        HeaderSettings(**fields)
