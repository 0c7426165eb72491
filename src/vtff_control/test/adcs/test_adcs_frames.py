"""Frames of the ADCS module: the emulated module encodes what the controller decodes, and back."""

from __future__ import annotations

import pathlib

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vtff_control.adcs.frames import AdcsAnswer, AdcsFrameError, AdcsFrames, AdcsModuleReport
from vtff_control.adcs.log import AdcsLogError, AdcsLogWriter, read_reports
from vtff_sim_bridge.attitude.adcs_bus import AdcsModulePort

CONFIG = pathlib.Path(__file__).resolve().parents[4] / "config" / "can"
DBC_FILE = CONFIG / "vtff_adcs.dbc"
FRAMES, PORT = AdcsFrames(DBC_FILE), AdcsModulePort(DBC_FILE)
PULSES = st.tuples(*[st.integers(-400, 400)] * 3)
SPEED = st.floats(-5000.0, 5000.0)
FIELD = st.lists(st.tuples(*[st.floats(-6e-5, 6e-5)] * 3), max_size=3)


def decoded(frames: list[can.Message], decoder: AdcsFrames | None = None) -> list[object]:
    decoder = decoder or AdcsFrames(DBC_FILE)
    return [decoder.decode(frame) for frame in frames]


@given(st.integers(0, 60479999), st.sampled_from([0.0, 1.0, 5.0]), FIELD, PULSES, SPEED, SPEED)
def test_a_report_comes_back_to_the_resolution_of_the_frames(
    time, period, field, pulses, told, speed
):
    samples = np.array(field, dtype=float).reshape(-1, 3)
    frames = PORT.report(0.01 * time, period, samples, pulses, told, speed)
    *nothing, report = decoded(frames)
    assert nothing == [None] * (1 + len(field))
    assert isinstance(report, AdcsModuleReport)
    assert report.time_of_week == pytest.approx(0.01 * time, abs=1e-6)
    assert (report.period, report.pulse_steps) == (period, pulses)
    np.testing.assert_allclose(report.field_body, samples, rtol=0.0, atol=1.001e-9)
    assert report.wheel_command_rpm == pytest.approx(told, abs=0.1001)
    assert report.wheel_speed_rpm == pytest.approx(speed, abs=0.1001)


@given(st.integers(0, 15), st.tuples(*[st.integers(-511, 511)] * 3), st.floats(-6553.0, 6553.0))
def test_a_command_is_answered_within_the_limits_of_the_module(sequence, pulses, speed):
    (frame,) = FRAMES.encode_command(sequence, pulses, speed, 5)
    (answer,) = decoded(PORT.receive(frame))
    assert isinstance(answer, AdcsAnswer)
    assert answer.sequence == sequence and not answer.fires
    assert answer.pulse_steps == tuple(np.clip(pulses, -400, 400))
    assert answer.wheel_speed_rpm == pytest.approx(np.clip(speed, -5000.0, 5000.0), abs=0.1001)


def test_a_firing_belongs_to_the_command_of_its_number():
    firing, command = FRAMES.encode_command(3, (0, 0, 0), 0.0, firing=(10, 300))
    other = FRAMES.encode_command(4, (0, 0, 0), 0.0)[0]
    for frames, fires in (((firing, command), True), ((firing, other), False), ((command,), False)):
        (answer,) = [answer for frame in frames for answer in decoded(PORT.receive(frame))]
        assert answer.fires is fires


@given(st.sampled_from([0x200, 0x201, 0x210, 0x220, 0x221, 0x222]), st.binary(max_size=8))
def test_no_bytes_break_either_side(identifier, data):
    frame = can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
    try:
        decoded([frame])
    except AdcsFrameError as error:
        assert "\n" not in str(error)
    for answer in PORT.receive(frame):
        decoded([answer])


@given(st.integers(0, 4), st.integers(0, 7), st.integers(1, 255))
def test_a_damaged_or_missing_frame_loses_its_report_and_no_other(number, byte, change):
    frames = PORT.report(100.0, 5.0, np.zeros((2, 3)), (1, 2, 3), 0.0, 0.0)
    after = PORT.report(105.0, 5.0, np.ones((2, 3)) * 1e-5, (4, 5, 6), 0.0, 0.0)
    number %= len(frames)
    frames[number].data[byte] ^= change
    reports = []
    decoder = AdcsFrames(DBC_FILE)
    for frame in [*frames, *after]:
        try:
            reports.append(decoder.decode(frame))
        except AdcsFrameError:
            continue
    (report,) = [report for report in reports if report is not None]
    assert report.pulse_steps == (4, 5, 6)


def test_commands_that_do_not_fit_are_refused_by_name():
    for arguments, name in (
        ((16, (0, 0, 0), 0.0), "sequence"),
        ((0, (512, 0, 0), 0.0), "pulse_steps"),
        ((0, (0, 0, 0), float("nan")), "wheel_speed_rpm"),
        ((0, (0, 0, 0), 7000.0), "wheel_speed_rpm"),
        ((0, (0, 0, 0), 0.0, 0, (0, 5000)), "firing"),
    ):
        with pytest.raises(ValueError, match=f"^{name}: "):
            FRAMES.encode_command(*arguments)
    with pytest.raises(ValueError, match="vtff_thruster.dbc: has no message AdcsCommand"):
        AdcsFrames(CONFIG / "vtff_thruster.dbc")
    with pytest.raises(ValueError, match="not the DBC file of an ADCS module"):
        AdcsModulePort(CONFIG / "vtff_thruster.dbc")


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "adcs.log"
    writer = AdcsLogWriter(path)
    for number in range(4):
        stamp = (981590400 + 5 * number) * 10**9
        for frame in PORT.report(5.0 * number, 5.0, np.zeros((2, 3)), (number, 0, 0), 0.0, 0.0):
            writer.write(frame, stamp)
        writer.write(FRAMES.encode_command(number, (0, 0, 0), 0.0)[0], stamp)
    writer.close()
    return path


def test_a_log_gives_its_reports_and_a_cut_one_those_before_the_cut(log):
    reports = list(read_reports(log, AdcsFrames(DBC_FILE)))
    assert [stamp for stamp, _ in reports] == [(981590400 + 5 * k) * 10**9 for k in range(4)]
    assert [report.pulse_steps[0] for _, report in reports] == [0, 1, 2, 3]
    text = log.read_text()
    for length in range(len(text) // 2, len(text), 7):
        log.write_text(text[:length])
        assert len(list(read_reports(log, AdcsFrames(DBC_FILE)))) in (1, 2, 3, 4)


def test_a_log_of_another_kind_is_refused_in_one_line(log, tmp_path):
    other = tmp_path / "other.log"
    other.write_text(log.read_text().replace(" 22", " 32"))
    broken = tmp_path / "broken.log"
    broken.write_text("nothing\n" + log.read_text())
    binary = tmp_path / "binary.log"
    binary.write_bytes(b"\xff\x00")
    for path, text in (
        (other, "no report of an ADCS module"),
        (broken, "line 1: "),
        (binary, "cannot be read"),
        (tmp_path / "missing.log", "cannot be read"),
    ):
        with pytest.raises(AdcsLogError, match=text) as caught:
            list(read_reports(path, AdcsFrames(DBC_FILE)))
        assert str(path) in str(caught.value) and "\n" not in str(caught.value)
