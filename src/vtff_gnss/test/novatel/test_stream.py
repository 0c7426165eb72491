"""Ephemeris, position and time logs, built with NovAtel's own encoder."""

from __future__ import annotations

import math
import pathlib
import re
import struct

import numpy as np
import pytest
from gnss_test_support import (
    L1CA,
    L2C,
    binary_frame,
    events_of,
    oem_file,
    range_frame,
    range_records,
)
from novatel_edie import oem

import vtff_gnss
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss import constants as c
from vtff_gnss import fix as f
from vtff_gnss.ephemeris import (
    BroadcastEphemeris,
    galileo_accuracy,
    lnav_accuracy,
    lnav_fit_interval,
)
from vtff_gnss.novatel import ReceiverLogStream, read_log
from vtff_gnss.novatel import message_ids as ids
from vtff_gnss.novatel.definitions import MessageDecoder
from vtff_gnss.novatel.framing import crc32_novatel
from vtff_gnss.novatel.message_ids import PAYLOAD_LAYOUTS
from vtff_gnss.novatel.solution_logs import (
    fix_from_bestxyz,
    fix_from_payload,
    receiver_time,
    receiver_time_from_payload,
)
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch
from vtff_gnss.orbits.lnav import SubframeError, decode_subframes
from vtff_gnss.signals import carrier_wavelength, satellite_name


def header(milliseconds: float = 3.456e8, week: int = 2200) -> oem.Header:
    return oem.Header(port_address=0x20, week=week, milliseconds=milliseconds, time_status=180)


def encoded(name: str, milliseconds: float = 3.456e8, **fields) -> bytes:
    message = getattr(oem.messages, name)(header=header(milliseconds), **fields)
    return message.to_binary().message


GALILEO = dict(sat_id=11, io_dnav=77, toe=345000, toc=345600, m0=0.5, delta_n=3e-9, ecc=1e-4,
               i0=0.97, i_dot=1e-10, omega0=1.5, omega=-0.7, omega_dot=-5e-9, cuc=1e-6, cus=2e-6,
               crc=150.0, crs=-20.0, cic=1e-8, cis=-2e-8, af0=1e-4, af1=1e-12, af2=0.0,
               e1_e5a_bgd=-3e-9)  # fmt: skip


def test_galileo_inav_of_both_definitions_agree():
    old = encoded("GALINAVEPHEMERIS_DBE9", root_a=5440.6, sisa=107, e5b_health=1, e1b_dvs=1,
                  e1_e5b_bgd=-4e-9, **GALILEO)  # fmt: skip
    new = encoded("GALINAVEPHEMERIS_F4A2", a=5440.6**2, sisa=3.12, health=1 << 7 | 1,
                  e1_e5b_bgd=-4e-9, **GALILEO)  # fmt: skip
    (first,), (second,) = events_of(old), events_of(new)
    assert first.source == c.EPHEMERIS_SOURCE_INAV
    assert satellite_name(first.system, first.prn) == "E11"
    assert (first.toe, first.gps_week, first.health) == (345000.0, 2200, 129)
    assert (first.group_delay, first.group_delay_secondary) == (-3e-9, -4e-9)
    assert second.time == first.time
    for name in vars(first).keys() - {"time"}:
        assert getattr(second, name) == pytest.approx(getattr(first, name), rel=1e-12), name


def test_galileo_fnav():
    (event,) = events_of(encoded("GALFNAVEPHEMERIS_02CD", root_a=5440.6, sisa=255, **GALILEO))
    assert event.source == c.EPHEMERIS_SOURCE_FNAV
    assert math.isnan(event.accuracy)
    assert event.semi_major_axis == 5440.6**2
    assert event.issue_of_data_ephemeris == 77 and event.mean_anomaly == 0.5


def test_galileo_week_is_that_of_the_ephemeris():
    late = encoded("GALFNAVEPHEMERIS_02CD", 604_790_000.0, root_a=5440.6, **GALILEO | {"toe": 0})
    (event,) = events_of(late)
    assert event.gps_week == 2201


def test_gps_ephemeris_of_both_definitions_agree():
    fields = dict(tow=345600.0, iode1=5, iode2=5, wn=2200, zwn=2200, toe=352800.0, a=26.56e6,
                  ecc=0.01, iodc=261, toc=352800.0, eph_var=4.0)  # fmt: skip
    (new,) = events_of(encoded("GPSEPHEM_1214", satellite_id=7, health7=63, **fields))
    (old,) = events_of(encoded("GPSEPHEM_9145", prn=7, health6=63, **fields))
    assert new == old
    assert (new.prn, new.health, new.accuracy, new.issue_of_data_clock) == (7, 63, 2.0, 261)


def test_unchanged_ephemeris_is_given_once():
    first = encoded("GPSEPHEM_1214", satellite_id=7, a=26.56e6, toe=352800.0)
    changed = encoded("GPSEPHEM_1214", satellite_id=7, a=26.56e6, toe=360000.0)
    assert len(events_of(first + first + changed + changed)) == 2
    assert len(events_of(first + first + changed, every_ephemeris=True)) == 3


def xyz(milliseconds: float = 3.456e8, **fields) -> bytes:
    values = dict(position_type=16, x=1.0e6, y=-2.0e6, z=3.0e6, x_std_dev=1.0, x_1=1.0, y_1=2.0,
                  z_1=3.0, type=8, num_svs=12, num_soln_svs=11, latency=0.15)  # fmt: skip
    return encoded("BESTXYZ", milliseconds, **values | fields)


def clock(milliseconds: float = 3.456e8, **fields) -> bytes:
    return encoded("TIME", milliseconds, **dict(offset=-2e-8, offset_std=1e-9) | fields)


def test_fix():
    (fix,) = events_of(xyz())
    assert fix.status == f.STATUS_SINGLE
    assert fix.position == (1.0e6, -2.0e6, 3.0e6) and fix.velocity == (1.0, 2.0, 3.0)
    assert (fix.satellites_tracked, fix.satellites_used) == (12, 11)
    assert fix.receiver_solution_type == 16
    assert math.isnan(fix.clock_offset)
    assert fix.velocity_latency == pytest.approx(0.15)


@pytest.mark.parametrize(("solution_type", "status"), [(17, 2), (34, 3), (50, 4), (53, 1), (0, 0)])
def test_fix_status(solution_type, status):
    assert events_of(xyz(position_type=solution_type))[0].status == status


def test_fix_without_solution_is_nan():
    (fix,) = events_of(xyz(solution_status=1))
    assert fix.status == f.STATUS_NONE
    assert np.isnan([*fix.position, *fix.velocity, *fix.position_sigma]).all()


def test_fix_without_velocity():
    (fix,) = events_of(xyz(status=1))
    assert fix.status == f.STATUS_SINGLE and np.isnan(fix.velocity).all()


def test_clock_offset_of_the_epoch_is_joined_whichever_log_comes_first():
    before = events_of(clock() + xyz())
    assert before[1].clock_offset == -2e-8
    after = events_of(b"".join(xyz(t) + clock(t) for t in (1000.0, 2000.0, 3000.0)))
    fixes = [event for event in after if isinstance(event, f.Fix)]
    # The receiver sends TIME second: that is known after the first fix went out.
    assert [math.isnan(fix.clock_offset) for fix in fixes] == [True, False, False]


def test_fix_is_not_held_back_beyond_its_epoch():
    stream = ReceiverLogStream()
    stream.feed(xyz(1000.0) + clock(1000.0))
    assert stream.feed(xyz(2000.0)) == []
    (fix, epoch) = stream.feed(range_frame(range_records(3), 3000))
    assert isinstance(fix, f.Fix) and isinstance(epoch, ObservationEpoch)
    stream.feed(xyz(4000.0) + clock(4000.0) + xyz(5000.0))
    (last,) = stream.close()
    assert last.time.time_of_week == 5.0


def test_clock_offset_of_another_epoch_or_an_invalid_clock_is_not_joined():
    assert math.isnan(events_of(clock(1000.0) + xyz(2000.0))[1].clock_offset)
    assert math.isnan(events_of(clock(clock_model_status=3) + xyz())[1].clock_offset)


def solution_frame(generator, message_id, length, places):
    """Return a BESTXYZ or TIME with any bits; statuses and types have names, or seldom not."""
    payload = bytearray(generator.bytes(length))
    greatest = 100 if generator.random() < 0.9 else 2**32 - 1
    for place in places:
        number = int(generator.choice([0, 0, 0, generator.integers(0, greatest, dtype=np.uint32)]))
        payload[place : place + 4] = number.to_bytes(4, "little")
    frame = bytearray(binary_frame(message_id, bytes(payload)))
    definition = generator.choice([0, 17615, 48615, 64193, 39204, 5])
    frame[24:26] = int(definition).to_bytes(2, "little")
    return bytes(frame[:-4]) + struct.pack("<I", crc32_novatel(bytes(frame[:-4])))


def test_fix_and_time_from_bytes_are_those_of_novatel_edie():
    generator = np.random.default_rng(1)
    decoder, time = MessageDecoder(), GpsTime.from_week_tow(2200, 345600.0)
    taken = {ids.ID_BESTXYZ: 0, ids.ID_TIME: 0}
    for _ in range(1500):
        frame = solution_frame(generator, ids.ID_BESTXYZ, 112, (0, 4, 44, 48))
        fix = fix_from_payload(frame[28:-4], time)
        if fix is not None:
            taken[ids.ID_BESTXYZ] += 1
            assert repr(fix) == repr(fix_from_bestxyz(decoder.decode(frame), time))
        frame = solution_frame(generator, ids.ID_TIME, 44, (0, 40))
        clock_time = receiver_time_from_payload(frame[28:-4], time)
        if clock_time is not None:
            taken[ids.ID_TIME] += 1
            assert repr(clock_time) == repr(receiver_time(decoder.decode(frame), time))
    assert min(taken.values()) > 500
    assert fix_from_payload(bytes(113), time) is None
    assert receiver_time_from_payload(bytes(43), time) is None


def test_all_that_novatel_has_published_of_fix_and_time_has_one_layout():
    """What the bytes are read by; a new definition of novatel_edie shows here."""
    database = oem.get_builtin_database()
    kinds = {}
    for message_id in (ids.ID_BESTXYZ, ids.ID_TIME):
        definitions = database.get_msg_def(message_id).fields.values()
        layouts = {
            tuple(str(field.data_type).replace("UCHAR", "CHAR") for field in fields)
            for fields in definitions
        }
        (kinds[message_id],) = layouts
    enumeration, double, single, byte = "UNKNOWN", "DOUBLE", "FLOAT", "CHAR"
    motion = [enumeration] * 2 + [double] * 3 + [single] * 3
    # The station is one array of 4 bytes.
    assert kinds[ids.ID_BESTXYZ] == (*motion, *motion, byte, *[single] * 3, *[byte] * 8)
    assert kinds[ids.ID_TIME] == (
        enumeration, *[double] * 3, "ULONG", *[byte] * 4, "ULONG", enumeration,
    )  # fmt: skip


def test_logs_before_the_receiver_knows_the_time_are_counted():
    stream = ReceiverLogStream()
    payload = struct.pack("<I", 0)
    assert stream.feed(binary_frame(43, payload, week=0, time_status=20)) == []
    assert stream.counters.logs_without_time == 1


def test_epoch_columns():
    records = range_records(4)
    records["tracking_status"] = [L1CA, L1CA | 1 << 28, L2C & ~(1 << 10), 3 << 16 | 12 << 21]
    records["prn"] = [1, 2, 3, 36]
    (epoch,) = events_of(range_frame(records))
    assert [satellite_name(s, p) for s, p in zip(epoch.system, epoch.prn, strict=True)] == [
        "G01", "G02", "G03", "E36",
    ]  # fmt: skip
    assert epoch.band.tolist() == [1, 1, 2, 5]
    assert bytes(epoch.attribute) == b"CCSQ"
    assert epoch.flags.tolist() == [7, 15, 5, 0]
    assert (epoch.carrier_phase_cycles == -records["accumulated_doppler_cycles"]).all()
    assert (epoch.doppler_hz == records["doppler_hz"]).all()
    for name, kind in OBSERVATION_COLUMNS.items():
        column = epoch.columns()[name]
        assert column.dtype == kind and column.shape == (4,), name


def test_epochs_share_no_column():
    """Also where the signals are the same, or one is there twice: no epoch changes another."""
    records = range_records(4)
    records[1] = records[0]
    epochs = events_of(b"".join(range_frame(records, 345_600_000 + 50 * k) for k in range(3)))
    addresses = [column.ctypes.data for epoch in epochs for column in epoch.columns().values()]
    assert len(set(addresses)) == 3 * len(OBSERVATION_COLUMNS)


@pytest.mark.parametrize("week", [1, 15_250, 65_535])
def test_time_is_that_of_the_header_in_any_week(week):
    payload = struct.pack("<I", 2) + range_records(2).tobytes()
    (epoch,) = events_of(binary_frame(43, payload, 604_799_900, week))
    assert (epoch.time.week, epoch.time.time_of_week) == (week, 604_799.9)


def test_signals_without_a_rinex_name_are_left_out_and_counted():
    records = range_records(3)
    records["tracking_status"][1] = 7 << 16 | 19 << 21  # L-band
    records["prn"][2] = 0
    stream = ReceiverLogStream()
    (epoch,) = stream.feed(range_frame(records))
    assert len(epoch) == 1 and stream.counters.signals_unnamed == 2


def test_carrier_phase_grows_with_distance_in_a_real_log():
    epochs = [
        event
        for event in read_log(oem_file("gavlab_test2_rcvr2.dat"))
        if isinstance(event, ObservationEpoch)
    ]
    checked = 0
    for first, second in zip(epochs, epochs[1:], strict=False):
        same = len(first) == len(second) and (first.prn == second.prn).all()
        if not same or second.time - first.time != 1.0:
            continue
        good = (second.flags & 18) == c.FLAG_PHASE_VALID
        step = (second.carrier_phase_cycles - first.carrier_phase_cycles)[good]
        doppler_hz = (0.5 * (second.doppler_hz + first.doppler_hz))[good]
        wavelength = carrier_wavelength(second.system, second.band)[good]
        assert np.abs(step + doppler_hz).max() < 1.5
        motion = (second.pseudorange - first.pseudorange)[good]
        assert np.median(np.abs(motion - step * wavelength)) < 1.0
        checked += 1
    assert checked > 300


def test_fixes_of_a_real_log_equal_their_ascii_twins():
    binary, text = (
        [event for event in read_log(oem_file(name)) if isinstance(event, f.Fix)]
        for name in ("gavlab_test2_rcvr1.dat", "gavlab_test2_rcvr1_decompressed.ASC")
    )
    assert len(binary) == len(text) == 448
    for ours, twin in zip(binary, text, strict=True):
        assert (ours.time, ours.status, ours.satellites_used) == (
            twin.time, twin.status, twin.satellites_used,
        )  # fmt: skip
        np.testing.assert_allclose(ours.position, twin.position, atol=5.1e-5, rtol=0)
        np.testing.assert_allclose(ours.velocity, twin.velocity, atol=5.1e-5, rtol=0)
        np.testing.assert_allclose(ours.position_sigma, twin.position_sigma, atol=5.1e-5, rtol=0)


def real_subframes() -> tuple[BroadcastEphemeris, bytes]:
    path = oem_file("rtklib_oemv_200911218.gps")
    for event in read_log(path, raw_logs="all"):
        if isinstance(event, BroadcastEphemeris):
            ephemeris = event
        elif getattr(event, "name", "") == "RAWEPHEMB":
            return ephemeris, event.content[28:-4]
    raise AssertionError("no RAWEPHEM")


def test_subframes_of_different_uploads_are_refused():
    ephemeris, payload = real_subframes()
    subframes = [payload[start : start + 30] for start in (12, 42, 72)]
    assert decode_subframes(ephemeris.prn, tuple(subframes), ephemeris.time) == ephemeris
    changed = bytearray(subframes[2])
    changed[27] ^= 1  # IODE of subframe 3, word 10
    with pytest.raises(SubframeError, match="issues of data"):
        decode_subframes(1, (subframes[0], subframes[1], bytes(changed)), ephemeris.time)
    with pytest.raises(SubframeError, match="subframe 1: it says 2"):
        decode_subframes(1, (subframes[1], subframes[1], subframes[2]), ephemeris.time)
    with pytest.raises(SubframeError, match="no preamble"):
        decode_subframes(1, (bytes(30), subframes[1], subframes[2]), ephemeris.time)
    with pytest.raises(SubframeError, match="29 bytes"):
        decode_subframes(1, (subframes[0][:29], subframes[1], subframes[2]), ephemeris.time)


def test_malformed_subframes_in_a_log_are_counted():
    stream = ReceiverLogStream()
    assert stream.feed(binary_frame(41, bytes(102))) == []
    assert stream.counters.logs_malformed == 1


def test_week_of_the_subframes_is_resolved_near_the_log_time():
    ephemeris, payload = real_subframes()
    subframes = tuple(payload[start : start + 30] for start in (12, 42, 72))
    for weeks in (-400, 0, 400):
        time = ephemeris.time + 604800 * weeks
        assert decode_subframes(1, subframes, time).gps_week == ephemeris.gps_week
    assert decode_subframes(1, subframes, ephemeris.time + 604800 * 1024).gps_week == (
        ephemeris.gps_week + 1024
    )


def test_accuracy_tables():
    expected = [2.0, 2.8, 4.0, 5.7, 8.0, 11.3, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0, 1024.0]
    assert [lnav_accuracy(k) for k in range(13)] == expected
    assert math.isnan(lnav_accuracy(15))
    # Galileo OS SIS ICD: the segments join at 0.5, 1, 2 m and end at 6 m.
    assert [galileo_accuracy(k) for k in (0, 49, 50, 75, 100)] == [0.0, 0.49, 0.5, 1.0, 2.0]
    assert galileo_accuracy(125) == pytest.approx(6.0)
    assert math.isnan(galileo_accuracy(126)) and math.isnan(galileo_accuracy(255))


def test_fit_intervals():
    hours = {(0, 500): 4, (1, 5): 6, (1, 240): 8, (1, 496): 14, (1, 503): 26, (1, 1021): 26}
    for (fit_flag, issue), expected in hours.items():
        assert lnav_fit_interval(fit_flag, issue) == expected * 3600.0


def test_library_knows_no_ros():
    foreign = re.compile(r"^\s*(?:import|from)\s+(?:rclpy|vtff_msgs|\w+_msgs)", re.MULTILINE)
    paths = list(pathlib.Path(vtff_gnss.__file__).parent.rglob("*.py"))
    assert len(paths) > 10
    for path in paths:
        assert not foreign.search(path.read_text(encoding="utf-8")), path


def frame_with(payload: bytes, message_id: int, header_length: int = 28) -> bytes:
    """Return a frame with any payload, message number and header length; its CRC is right."""
    changed = bytearray(xyz()[:28] + bytes(header_length - 28) + payload)
    changed[3] = header_length
    struct.pack_into("<H", changed, 4, message_id)
    struct.pack_into("<H", changed, 8, len(payload))
    return bytes(changed) + struct.pack("<I", crc32_novatel(bytes(changed)))


DECODED_LOGS = (*PAYLOAD_LAYOUTS, ids.ID_GALINAVEPHEMERIS, ids.ID_GALFNAVEPHEMERIS)


@pytest.mark.parametrize("header_length", [29, 30, 32, 39, 64])
def test_a_header_may_have_grown(header_length):
    """The manual asks for it; novatel_edie ends the process at some such frames."""
    inav = encoded("GALINAVEPHEMERIS_F4A2", a=5440.6**2, sisa=3.12, **GALILEO)
    for frame in (inav, xyz()):
        (known,) = events_of(frame)
        message_id = int.from_bytes(frame[4:6], "little")
        changed = bytearray(frame_with(frame[28:-4], message_id, header_length))
        changed[10:28] = frame[10:28]
        changed[-4:] = struct.pack("<I", crc32_novatel(bytes(changed[:-4])))
        (grown,) = events_of(bytes(changed))
        assert vars(grown) == vars(known)


@pytest.mark.parametrize("header_length", [28, 39])
def test_a_frame_inside_a_frame_is_not_taken_for_it(header_length):
    """novatel_edie searches on inside a frame that does not fit its definition."""
    decoder = MessageDecoder()
    for length in (144, 200, 300):
        inside = xyz().ljust(length, b"\0")
        message = decoder.decode(frame_with(inside, ids.ID_GALINAVEPHEMERIS, header_length))
        assert message is None or message.name == "GALINAVEPHEMERIS"


@pytest.mark.parametrize("filling", [b"\0", b"\x01", b"\x7f", b"\xff", b"\xaaD\x12"])
@pytest.mark.parametrize("header_length", [28, 39, 64])
def test_payloads_that_contradict_their_definition_raise_nothing(filling, header_length):
    """Each log that is decoded, with payloads of many lengths and a right checksum."""
    stream = ReceiverLogStream(raw_logs="all")
    for message_id in DECODED_LOGS:
        for length in (0, 4, *range(90, 330, 7), 1000):
            payload = (filling * length)[:length]
            stream.feed(frame_with(payload, message_id, header_length))
    stream.feed(xyz())
    stream.close()
    assert stream.counters.logs_malformed > 0
