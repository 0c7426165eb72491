"""Frames are found whatever surrounds and damages them."""

from __future__ import annotations

import pytest
from encoder_test_support import receiver_log
from gnss_test_support import (
    binary_frame,
    crc32,
    events_of,
    examples,
    oem_file,
    range_frame,
    range_records,
)
from hypothesis import given
from hypothesis import strategies as st

from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.fix import Fix
from vtff_gnss.novatel import CommandResponse, RawLog, ReceiverLogStream, read_log
from vtff_gnss.novatel.framing import crc32_novatel
from vtff_gnss.novatel.message_ids import PAYLOAD_LAYOUTS, PayloadLayout
from vtff_gnss.observations import ObservationEpoch

FRAMES = [
    range_frame(range_records(5, seed=k, lock_time=10.0 + 0.05 * k), 345_600_000 + 50 * k)
    for k in range(8)
]
EPOCHS = [events_of(frame)[0] for frame in FRAMES]


def ascii_log(body: bytes, line_end: bytes = b"\r\n") -> bytes:
    return b"#" + body + b"*%08x" % crc32(body) + line_end


ASCII_TIME = ascii_log(
    b"TIMEA,COM1,0,50.0,FINESTEERING,2200,345600.000,00000000,9924,16809;"
    b"VALID,-1.5e-08,2.5e-09,-18.0,2022,3,10,0,0,0,VALID"
)


def test_crc_equals_bitwise_definition():
    assert crc32_novatel(b"123456789") == crc32(b"123456789") == 0x2DFD2D88


@examples(60)
@given(st.lists(st.integers(1, 700), min_size=1, max_size=12))
def test_events_do_not_depend_on_chunks(chunk_lengths):
    stream = b"<OK\r\n[COM1]" + FRAMES[0] + ASCII_TIME + b"\x00#A\xaaD" + FRAMES[1] + ASCII_TIME
    assert events_of(stream, chunk_lengths) == events_of(stream)


@pytest.mark.parametrize("length", [1, 7, 64, 1000, 4096])
def test_log_of_every_kind_does_not_depend_on_chunks(length, tmp_path):
    path = tmp_path / "made.gps"
    path.write_bytes(receiver_log(12))
    whole = list(read_log(path, raw_logs="all"))
    assert len(whole) > 90
    assert {type(event) for event in whole} >= {ObservationEpoch, BroadcastEphemeris, Fix, RawLog}
    assert events_of(path.read_bytes(), [length], raw_logs="all") == whole


def test_real_file_does_not_depend_on_chunks():
    path = oem_file("gavlab_OnceEachAgain.GPS")
    whole = list(read_log(path, raw_logs="all"))
    assert len(whole) > 90
    for length in (1, 7, 64, 1000, 4096):
        assert events_of(path.read_bytes(), [length], raw_logs="all") == whole


@examples(150)
@given(
    st.lists(
        st.tuples(st.integers(0, 7), st.integers(0, 10_000), st.integers(1, 255)),
        min_size=1,
        max_size=6,
    ),
    st.lists(st.integers(1, 500), min_size=1, max_size=5),
)
def test_damage_costs_only_the_frames_it_hits(damages, chunk_lengths):
    frames = [bytearray(frame) for frame in FRAMES]
    for index, offset, change in damages:
        frames[index][offset % len(frames[index])] ^= change
    expected = [
        epoch for frame, good, epoch in zip(frames, FRAMES, EPOCHS, strict=True) if frame == good
    ]
    assert events_of(b"".join(frames), chunk_lengths) == expected


@examples(150)
@given(st.lists(st.one_of(st.integers(0, 7), st.binary(max_size=60)), max_size=14))
def test_every_intact_frame_between_garbage_is_found(parts):
    content = b"".join(FRAMES[part] if isinstance(part, int) else part for part in parts)
    epochs = [e for e in events_of(content) if isinstance(e, ObservationEpoch)]
    assert epochs == [
        event
        for event in events_of(b"".join(FRAMES[p] for p in parts if isinstance(p, int)))
        if isinstance(event, ObservationEpoch)
    ]


@examples(100)
@given(st.data())
def test_cut_out_bytes_cost_only_the_frames_they_are_in(data):
    content = b"".join(FRAMES)
    start = data.draw(st.integers(0, len(content) - 1))
    end = data.draw(st.integers(start + 1, min(len(content), start + 400)))
    position, expected = 0, []
    for frame, epoch in zip(FRAMES, EPOCHS, strict=True):
        if position + len(frame) <= start or position >= end:
            expected.append(epoch)
        position += len(frame)
    assert events_of(content[:start] + content[end:]) == expected


@examples(200)
@given(st.binary(max_size=3000))
def test_any_bytes_are_survived(content):
    stream = ReceiverLogStream(raw_logs="all")
    stream.feed(content)
    stream.close()
    assert stream.counters.bytes_received == len(content)


@examples(300)
@given(st.sampled_from(sorted({*PAYLOAD_LAYOUTS, 1309, 1310})), st.integers(0, 40), st.data())
def test_any_content_of_a_decoded_log_is_survived(message_id, count, data):
    layout = PAYLOAD_LAYOUTS.get(message_id, PayloadLayout(228))
    length = layout.fixed + layout.stride * count
    payload = bytearray(data.draw(st.binary(min_size=length, max_size=length)))
    if layout.stride:
        payload[layout.count_offset : layout.count_offset + 4] = count.to_bytes(4, "little")
    stream = ReceiverLogStream(raw_logs="all")
    events = stream.feed(binary_frame(message_id, bytes(payload))) + stream.close()
    assert stream.counters.frames_good == 1
    assert len(events) in (1, 2, 5)  # ISMREDTEC holds four instants


@examples(60)
@given(st.data())
def test_damaged_real_log_gives_no_wrong_observation(data):
    content = bytearray(oem_file("gavlab_test2_rcvr2.dat").read_bytes()[:30_000])
    good = {
        event.time: event
        for event in events_of(bytes(content))
        if isinstance(event, ObservationEpoch)
    }
    for _ in range(data.draw(st.integers(1, 30))):
        content[data.draw(st.integers(0, len(content) - 1))] ^= data.draw(st.integers(1, 255))
    for event in events_of(bytes(content)):
        if isinstance(event, ObservationEpoch):
            # A lost frame changes what is known of lock, not the measurement.
            reference = good[event.time]
            assert (event.pseudorange == reference.pseudorange).all()
            assert (event.carrier_phase_cycles == reference.carrier_phase_cycles).all()
            assert (event.prn == reference.prn).all()


@pytest.mark.parametrize("high_byte", [0x01, 0x10, 0x1F, 0x70, 0x7F])
def test_damaged_length_withholds_nothing(high_byte):
    damaged = bytearray(FRAMES[0])
    damaged[9] ^= high_byte
    stream = ReceiverLogStream()
    assert stream.feed(damaged) == []
    # The very next frame is there as soon as its last byte is, although the damaged one said
    # that it was kilobytes long.
    assert stream.feed(FRAMES[1]) == [EPOCHS[1]]
    assert stream.counters.frames_implausible == 1


def test_damaged_count_in_a_long_log_is_found_at_once():
    damaged = bytearray(FRAMES[0])
    damaged[8:10] = (4 + 44 * 300).to_bytes(2, "little")
    stream = ReceiverLogStream()
    stream.feed(damaged)
    assert stream.feed(FRAMES[1]) == [EPOCHS[1]]


def test_other_logs_are_limited_in_length():
    damaged = bytearray(binary_frame(9999, bytes(100)))
    damaged[9] = 0x7F
    stream = ReceiverLogStream()
    stream.feed(damaged)
    assert stream.feed(FRAMES[1]) == [EPOCHS[1]]


def test_frame_inside_an_intact_frame_is_not_an_event():
    carrier = binary_frame(9999, FRAMES[0])
    events = events_of(carrier + FRAMES[1], [50], raw_logs="all")
    assert [type(e).__name__ for e in events] == ["RawLog", "ObservationEpoch", "RawLog"]
    assert events[0].content == carrier and events[0].name == "LOG9999B"


def test_truncated_last_frame_is_counted():
    stream = ReceiverLogStream()
    events = stream.feed(FRAMES[0] + FRAMES[1][:-1]) + stream.close()
    assert events == [EPOCHS[0]]
    assert stream.counters.frames_truncated == 1


def test_frame_behind_a_false_start_at_the_end_is_found():
    damaged = bytearray(binary_frame(9999, bytes(4000)))[:60]
    stream = ReceiverLogStream()
    assert stream.feed(bytes(damaged) + FRAMES[0]) == []
    assert stream.close() == [EPOCHS[0]]


@pytest.mark.parametrize("line_end", [b"\r\n", b"\n", b"\r", b"\n\n"])
def test_ascii_with_any_line_end(line_end):
    text = ASCII_TIME.removesuffix(b"\r\n") + line_end
    (first, second) = events_of(text + text)
    assert first == second
    assert first.clock_offset == -1.5e-08 and first.utc_offset == -18.0


def test_real_ascii_file_with_line_feeds_only():
    content = oem_file("gavlab_OnceEachAgain.ASC").read_bytes()
    assert b"\r\n" in content
    assert events_of(content.replace(b"\r\n", b"\n")) == events_of(content)


def test_ascii_logs_joined_by_a_damaged_line_end():
    text = ASCII_TIME.removesuffix(b"\r\n")
    assert len(events_of(text + b"J" + text + b"\n")) == 2


def test_ascii_followed_at_once_by_binary():
    events = events_of(ASCII_TIME.removesuffix(b"\r\n") + FRAMES[0])
    assert events[1:] == [EPOCHS[0]]


def test_damaged_ascii_is_dropped():
    text = ASCII_TIME.replace(b"-1.5e-08", b"-1.6e-08")
    stream = ReceiverLogStream()
    assert stream.feed(text) == []
    assert stream.counters.frames_crc_bad == 1


def test_responses():
    events = events_of(b"\r\n<OK\r\n[COM1]\r\n<ERROR:Invalid Message. Field = BESTGP\r\n[COM1]")
    assert events == [
        CommandResponse(is_ok=True, text="OK"),
        CommandResponse(is_ok=False, text="ERROR:Invalid Message. Field = BESTGP"),
    ]


def test_binary_response():
    content = binary_frame(1, (1).to_bytes(4, "little") + b"OK", message_type=0x80)
    assert events_of(content) == [CommandResponse(is_ok=True, text="OK", command="LOG")]


def test_raw_log_holds_the_bytes_as_received():
    (event,) = [e for e in events_of(b"xx" + FRAMES[0], raw_logs="all") if hasattr(e, "content")]
    assert event.content == FRAMES[0]
    assert (event.name, event.log_id) == ("RANGEB", 43)
    assert event.time == EPOCHS[0].time


def test_bytes_are_all_accounted_for():
    stream = ReceiverLogStream()
    content = b"junk" + FRAMES[0] + b"\xaa\x44more" + ASCII_TIME + FRAMES[1]
    stream.feed(content)
    stream.close()
    used = len(FRAMES[0]) + len(FRAMES[1]) + len(ASCII_TIME.rstrip())
    assert stream.counters.bytes_skipped == len(content) - used
    assert stream.counters.frames_good == 3


def test_unknown_option_is_refused():
    with pytest.raises(ValueError, match="raw_logs"):
        ReceiverLogStream(raw_logs="some")


def test_progress_reaches_the_file_size(tmp_path):
    path = tmp_path / "receiver.gps"
    path.write_bytes(b"".join(FRAMES))
    calls = []
    assert list(read_log(path, progress=lambda done, total: calls.append((done, total)))) == EPOCHS
    assert calls[-1] == (path.stat().st_size, path.stat().st_size)
