"""Frames of the CAN thruster: bits, checksum, both halves, and what damage does."""

import pathlib

import can
import cantools
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vtff_control.bus.checksum import checksum
from vtff_control.thruster.can_frames import (
    MODE_OFF,
    MODE_THRUST,
    FrameError,
    ThrusterFrames,
    ThrusterHeartbeat,
    ThrustReport,
)
from vtff_dynamics.time.timescales import GpsTime

DBC_FILE = pathlib.Path(__file__).resolve().parents[4] / "config" / "can" / "vtff_thruster.dbc"
DATABASE = cantools.database.load_file(str(DBC_FILE), strict=True)
FRAMES = ThrusterFrames(DBC_FILE)
START = GpsTime.from_week_tow(1889, 90_000.25)

counts = st.integers(-524287, 524287)
sequences = st.integers(0, 15)
milliseconds = st.integers(0, 604_799_999)
flags = st.booleans()


def reference_checksum(identifier: int, payload: bytes) -> int:
    """CRC-8 SAE J1850 (polynomial 0x1D, initial value and final XOR 0xFF), bit by bit."""
    remainder = 0xFF
    for byte in bytes([identifier & 0xFF, identifier >> 8]) + payload[1:]:
        remainder ^= byte
        for _ in range(8):
            remainder = ((remainder << 1) ^ (0x1D if remainder & 0x80 else 0)) & 0xFF
    return remainder ^ 0xFF


def packed(identifier: int, fields: list[tuple[int, int, int]]) -> bytes:
    """Little-endian frame from (start bit, length, value) with its checksum in byte 0."""
    word = 0
    for start, length, value in fields:
        word |= (value & (2**length - 1)) << start
    payload = bytearray(word.to_bytes(8, "little"))
    payload[0] = reference_checksum(identifier, payload)
    return bytes(payload)


def message(identifier: int, payload: bytes, **others: object) -> can.Message:
    return can.Message(
        arbitration_id=identifier, data=payload, **{"is_extended_id": False, **others}
    )


def report(
    sequence: int, time_of_week: int, applied: tuple[int, int, int], status: int = 0
) -> tuple[can.Message, can.Message]:
    """A report packed by hand; status: bits 12 to 16 of the first half."""
    radial, along_track, normal = applied
    first = [(8, 4, sequence), (12, 5, status), (24, 20, radial), (44, 20, along_track)]
    second = [(8, 4, sequence), (12, 20, normal), (32, 30, time_of_week)]
    return message(0x120, packed(0x120, first)), message(0x121, packed(0x121, second))


def test_checksum_has_the_check_value_of_its_standard() -> None:
    # The catalogue's check value of CRC-8/SAE-J1850 is 0x4B for the text 123456789.
    assert checksum(int.from_bytes(b"12", "little"), b"\0" + b"3456789") == 0x4B


@given(st.integers(0, 2**11 - 1), st.binary(min_size=8, max_size=8))
def test_checksum_equals_its_definition(identifier: int, payload: bytes) -> None:
    assert checksum(identifier, payload) == reference_checksum(identifier, payload)


def test_no_two_signals_overlap_and_every_frame_is_classic_can() -> None:
    assert {frame.frame_id for frame in DATABASE.messages} == {
        *(0x100, 0x110, 0x111, 0x120, 0x121, 0x130)
    }
    for frame in DATABASE.messages:
        assert frame.length == 8 and not frame.is_extended_frame and not frame.is_fd
        bits = sum(signal.length for signal in frame.signals)
        assert bits <= 64 and frame.signals[0].name == "Checksum"


def test_frames_hold_the_thrust_of_the_reference_formation() -> None:
    assert FRAMES.resolution == 1e-5
    assert FRAMES.largest_acceleration == pytest.approx(5.24287, abs=1e-12)


@given(sequences, st.integers(0, 4095), milliseconds, st.tuples(counts, counts, counts), flags)
def test_command_has_the_documented_bits(
    sequence: int, week: int, time_of_week: int, applied: tuple[int, int, int], on: bool
) -> None:
    start = GpsTime(week * 604_800_000_000_000 + time_of_week * 1_000_000)
    mode = MODE_THRUST if on else MODE_OFF
    first, second = FRAMES.encode_command(sequence, start, np.array(applied) * 1e-5, mode)
    radial, along_track, normal = applied
    assert (first.arbitration_id, second.arbitration_id) == (0x110, 0x111)
    assert bytes(first.data) == packed(
        0x110, [(8, 4, sequence), (12, 12, week), (24, 20, radial), (44, 20, along_track)]
    )
    assert bytes(second.data) == packed(
        0x111, [(8, 4, sequence), (12, 20, normal), (32, 30, time_of_week), (62, 2, mode)]
    )


@given(sequences, milliseconds, st.tuples(counts, counts, counts))
def test_cantools_reads_the_command_that_was_given(
    sequence: int, time_of_week: int, applied: tuple[int, int, int]
) -> None:
    start = GpsTime.from_week_tow(1889, 0.0) + time_of_week * 1e-3
    acceleration = np.array(applied) * 1e-5
    values: dict[str, float] = {}
    for frame in FRAMES.encode_command(sequence, start, acceleration):
        values |= DATABASE.decode_message(frame.arbitration_id, frame.data, decode_choices=False)
    assert (values["Sequence"], values["GpsWeek"], values["Mode"]) == (sequence, 1889, MODE_THRUST)
    assert values["TimeOfWeek"] == time_of_week
    np.testing.assert_array_equal([values[f"Acceleration{axis}"] for axis in "RTN"], acceleration)


@given(sequences, milliseconds, st.tuples(counts, counts, counts), st.integers(0, 31))
def test_report_is_read_as_it_was_packed(
    sequence: int, time_of_week: int, applied: tuple[int, int, int], status: int
) -> None:
    first, second = report(sequence, time_of_week, applied, status)
    assert FRAMES.decode(first) is None
    result = FRAMES.decode(second)
    assert isinstance(result, ThrustReport)
    assert (result.sequence, result.time_of_week_milliseconds) == (sequence, time_of_week)
    np.testing.assert_array_equal(result.acceleration_rtn, np.array(applied) * 1e-5)
    assert result.saturated == bool(status & 0b111)
    assert result.watchdog == bool(status & 0b1000)
    assert result.fault == bool(status & 0b10000)


def test_heartbeat_is_read_as_it_was_packed() -> None:
    fields = [(8, 4, 7), (12, 4, 2), (16, 16, 300), (32, 16, 12), (48, 16, 65535)]
    beat = FRAMES.decode(message(0x130, packed(0x130, fields)))
    assert beat == ThrusterHeartbeat(7, "Watchdog", 300, 12, 65535)


@given(st.integers(0, 63), flags)
def test_one_wrong_bit_is_always_found(bit: int, in_first_half: bool) -> None:
    frames = list(report(3, 90_000_000, (1, -2, 3)))
    damaged = frames[not in_first_half]
    damaged.data[bit // 8] ^= 1 << bit % 8
    results = []
    for frame in frames:
        try:
            results.append(FRAMES.decode(frame))
        except FrameError:
            results.append(None)
    assert results == [None, None]
    # The decoder has recovered.
    first, second = report(4, 90_000_000, (1, -2, 3))
    FRAMES.decode(first)
    assert isinstance(FRAMES.decode(second), ThrustReport)


@given(st.integers(0, 0x7FF), st.binary(max_size=8), flags, flags, flags)
def test_any_frame_is_ignored_or_refused_but_never_breaks_the_decoder(
    identifier: int, payload: bytes, extended: bool, remote: bool, error: bool
) -> None:
    frames = ThrusterFrames(DBC_FILE) if identifier == 0 else FRAMES
    frame = message(
        identifier,
        b"" if remote else payload,
        is_extended_id=extended,
        is_remote_frame=remote,
        is_error_frame=error,
    )
    try:
        result = frames.decode(frame)
    except FrameError as problem:
        assert str(problem).startswith("Thrust")
        return
    if result is not None:
        assert payload[0] == reference_checksum(identifier, payload)


def test_halves_of_different_commands_are_not_put_together() -> None:
    frames = ThrusterFrames(DBC_FILE)
    first, _ = report(3, 1000, (1, 1, 1))
    other_first, other_second = report(4, 2000, (2, 2, 2))
    assert frames.decode(first) is None
    with pytest.raises(FrameError, match="^ThrustReportN: "):
        frames.decode(other_second)
    assert frames.decode(first) is None
    with pytest.raises(FrameError, match="^ThrustReportRT: "):
        frames.decode(other_first)
    result = frames.decode(other_second)
    assert isinstance(result, ThrustReport) and result.sequence == 4


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("acceleration_rtn", (0, START, [5.25, 0, 0])),
        ("acceleration_rtn", (0, START, [np.nan, 0, 0])),
        ("acceleration_rtn", (0, START, [0, 0])),
        ("sequence", (16, START, [0, 0, 0])),
        ("sequence", (-1, START, [0, 0, 0])),
        ("mode", (0, START, [0, 0, 0], 2)),
    ],
)
def test_what_does_not_fit_is_named(name: str, arguments: tuple) -> None:
    with pytest.raises(ValueError, match=f"^{name}: "):
        FRAMES.encode_command(*arguments)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("not a database", "cannot be read as a DBC file"),
        ('VERSION "1"\nBU_: A\n', "has no message ThrustCommandRT"),
        (DBC_FILE.read_text().replace("SG_ Fault ", "SG_ Broken "), "no signal Fault"),
    ],
)
def test_wrong_dbc_file_is_named(tmp_path: pathlib.Path, text: str, reason: str) -> None:
    path = tmp_path / "wrong.dbc"
    path.write_text(text)
    with pytest.raises(ValueError, match=reason) as caught:
        ThrusterFrames(path)
    assert str(path) in str(caught.value)
    with pytest.raises(ValueError, match="missing.dbc"):
        ThrusterFrames(tmp_path / "missing.dbc")
