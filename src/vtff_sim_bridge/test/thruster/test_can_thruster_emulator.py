"""The emulated thruster, frame by frame: cap, quantum, watchdog, counters."""

import dataclasses
import functools
import pathlib
from unittest import mock

import can
import cantools
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vtff_control.bus.checksum import checksum
from vtff_control.thruster.can_frames import (
    MODE_OFF,
    ThrusterFrames,
    ThrusterHeartbeat,
    ThrustReport,
)
from vtff_control.thruster.thruster import Thruster
from vtff_dynamics.time.timescales import GpsTime
from vtff_sim_bridge.thruster.can_thruster_emulator import DEVICES, CanThruster

DBC_FILE = pathlib.Path(__file__).resolve().parents[4] / "config" / "can" / "vtff_thruster.dbc"
FRAMES = ThrusterFrames(DBC_FILE)
START = GpsTime.from_week_tow(1889, 90_000.0)

accelerations = st.lists(st.floats(-5.0, 5.0), min_size=3, max_size=3)


@pytest.fixture(autouse=True, scope="module")
def dbc_file_is_parsed_once():
    """The property tests make hundreds of thrusters, and to parse the file takes 10 ms."""
    load_once = functools.cache(cantools.database.load_file)
    with mock.patch.object(cantools.database, "load_file", load_once):
        yield


def thruster(**options: object) -> CanThruster:
    return CanThruster(DBC_FILE, **options)  # type: ignore[arg-type]


def read(frames: list[can.Message]) -> list[ThrustReport | ThrusterHeartbeat]:
    contents = [FRAMES.decode(frame) for frame in frames]
    return [content for content in contents if content is not None]


def command(
    unit: CanThruster,
    sequence: int,
    start: GpsTime = START,
    acceleration: object = (0.1, 0.0, 0.0),
    now: float = 0.0,
    **options: int,
) -> ThrustReport:
    first, second = FRAMES.encode_command(sequence, start, acceleration, **options)
    assert unit.receive(first, now) == []
    (report,) = read(unit.receive(second, now))
    assert isinstance(report, ThrustReport)
    return report


@given(accelerations, st.floats(1e-5, 5.0), st.integers(0, 1000))
def test_thrust_is_that_of_the_thruster_without_a_bus(
    wanted: list[float], cap: float, quantum_count: int
) -> None:
    on_frames = np.rint(np.array(wanted) / 1e-5) * 1e-5
    quantum = quantum_count * 1e-5
    expected = Thruster(cap, max(quantum, 1e-5)).command(0, on_frames)
    report = command(thruster(acceleration_cap=cap, quantum=quantum), 0, START, wanted)
    # Ties are decided on whole numbers here and on rounded ones there.
    difference = np.abs(report.acceleration_rtn - expected.acceleration_rtn)
    tie = np.abs(np.abs(on_frames / 1e-5) % max(quantum_count, 1) - quantum_count / 2) < 0.5
    np.testing.assert_array_less(difference[~tie], 1e-11)
    assert np.all(difference <= max(quantum, 1e-5) * (1.0 + 1e-9))
    assert np.all(np.abs(report.acceleration_rtn) <= cap * (1.0 + 1e-12))


@given(accelerations)
def test_with_the_quantum_of_the_frames_thrust_is_the_same_to_the_last_bit(
    wanted: list[float],
) -> None:
    expected = Thruster(1.4, 1e-5).command(0, wanted)
    report = command(thruster(acceleration_cap=1.4, quantum=1e-5), 0, START, wanted)
    assert report.acceleration_rtn.tolist() == expected.acceleration_rtn.tolist()


def test_an_engine_gives_its_smallest_thrust_or_none() -> None:
    # 84 steps of 12 uN are the first that are not below 1 mN.
    file = DBC_FILE.with_name("t5_thruster.dbc")
    frames = ThrusterFrames(file)
    unit = CanThruster(file, **dataclasses.asdict(DEVICES["t5"]))
    given = []
    for sequence, wanted in enumerate(
        ([3.0e-7, 3.3e-7, -3.3e-7], [6.3e-7, -6.6e-7, 1.0], [0.0, -1.0, 7.5e-6])
    ):
        first, second = frames.encode_command(sequence, START, np.clip(wanted, -2e-5, 2e-5))
        unit.receive(first, 0.0)
        answers = [frames.decode(frame) for frame in unit.receive(second, 0.0)]
        given += [answer for answer in answers if isinstance(answer, ThrustReport)]
    counts = [np.rint(report.acceleration_rtn / 7.5e-9).tolist() for report in given]
    assert counts == [[0, 84, -84], [84, -88, 2083], [0, -2083, 1000]]


def test_report_echoes_the_command_and_tells_of_the_cap() -> None:
    report = command(thruster(), 9, START, [0.0, -1.5, 0.0])
    assert (report.sequence, report.time_of_week_milliseconds) == (9, 90_000_000)
    assert report.saturated and not report.watchdog and not report.fault
    assert not command(thruster(), 9, START, [0.0, -1.4, 0.0]).saturated


def test_off_means_no_thrust() -> None:
    assert not command(thruster(), 0, mode=MODE_OFF).acceleration_rtn.any()


def test_unknown_mode_is_refused_with_no_thrust() -> None:
    unit = thruster()
    first, second = FRAMES.encode_command(0, START, [1.0, 1.0, 1.0])
    second.data[7] |= 0xC0
    second.data[0] = checksum(second.arbitration_id, bytes(second.data))
    unit.receive(first, 0.0)
    (report,) = read(unit.receive(second, 0.0))
    assert isinstance(report, ThrustReport)
    assert report.fault and not report.acceleration_rtn.any()
    assert not command(unit, 1).fault


def test_repeated_command_gets_the_same_answer_and_acts_once() -> None:
    unit = thruster()
    reports = [command(unit, 3) for _ in range(3)]
    assert unit.commands == 1 and unit.sequence_gaps == 0
    assert len({report.acceleration_rtn.tobytes() for report in reports}) == 1


def test_jump_of_the_sequence_is_counted_and_the_command_acts() -> None:
    unit = thruster()
    for sequence in (14, 15, 0, 1, 4):
        report = command(unit, sequence, START + sequence)
        assert report.acceleration_rtn[0] == 0.1
    assert unit.sequence_gaps == 1 and unit.commands == 5


@pytest.mark.parametrize(("pause", "trips"), [(1.0, 0), (2.0, 0), (2.001, 1), (60.0, 1)])
def test_watchdog_in_lockstep_goes_by_the_times_of_commands(pause: float, trips: int) -> None:
    unit = thruster(clock_mode="lockstep")
    command(unit, 0, START, now=0.0)
    report = command(unit, 1, START + pause, now=0.001)
    assert (unit.watchdog_trips, report.watchdog) == (trips, bool(trips))
    assert report.acceleration_rtn[0] == 0.1
    assert not command(unit, 2, START + pause + 1.0).watchdog


def test_watchdog_in_lockstep_ignores_the_wall_clock() -> None:
    unit = thruster(clock_mode="lockstep")
    command(unit, 0, START, now=0.0)
    assert not any(isinstance(c, ThrustReport) for c in read(unit.tick(1000.0)))
    assert not command(unit, 1, START + 1.0, now=1000.0).watchdog


def test_watchdog_spans_the_end_of_the_week() -> None:
    unit = thruster(clock_mode="lockstep")
    command(unit, 0, GpsTime.from_week_tow(1889, 604_799.0))
    command(unit, 1, GpsTime.from_week_tow(1890, 0.0))
    assert unit.watchdog_trips == 0


def test_watchdog_in_real_time_cuts_the_thrust_and_says_so_once() -> None:
    unit = thruster(clock_mode="realtime")
    unit.tick(100.0)
    assert command(unit, 0, now=100.0).acceleration_rtn[0] == 0.1
    assert not any(isinstance(content, ThrustReport) for content in read(unit.tick(102.0)))
    reports = [c for c in read(unit.tick(102.1) + unit.tick(102.2)) if isinstance(c, ThrustReport)]
    (report,) = reports
    assert report.watchdog and report.sequence == 0 and not report.acceleration_rtn.any()
    (beat,) = read(unit.tick(104.0))
    assert isinstance(beat, ThrusterHeartbeat) and beat.state == "Watchdog"
    resumed = command(unit, 1, START + 4.0, now=104.0)
    assert resumed.acceleration_rtn[0] == 0.1 and not resumed.watchdog
    assert unit.watchdog_trips == 1


@given(st.integers(0, 63), st.booleans())
def test_damaged_command_is_counted_and_never_acts(bit: int, in_first_half: bool) -> None:
    unit = thruster()
    frames = FRAMES.encode_command(0, START, [1.0, 1.0, 1.0])
    frames[not in_first_half].data[bit // 8] ^= 1 << bit % 8
    assert [unit.receive(frame, 0.0) for frame in frames] == [[], []]
    assert unit.commands == 0 and unit.rejected_frames >= 1
    assert command(unit, 0).acceleration_rtn[0] == 0.1


@given(st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8)), max_size=20))
def test_any_frames_leave_it_working(frames: list[tuple[int, bytes]]) -> None:
    unit = thruster()
    for identifier, payload in [*frames, (0x110, b""), (0x111, bytes(8))]:
        frame = can.Message(arbitration_id=identifier, data=payload, is_extended_id=False)
        unit.receive(frame, 0.0)
    assert unit.rejected_frames >= 2
    assert command(unit, 0).acceleration_rtn[0] == 0.1


def test_heartbeat_comes_once_a_second_with_the_counters() -> None:
    unit = thruster()
    beats = [beat for step in range(25) for beat in read(unit.tick(50.0 + 0.125 * step))]
    assert [beat.sequence for beat in beats] == [0, 1, 2, 3]
    command(unit, 0)
    command(unit, 5, START + 1.0)
    unit.receive(can.Message(arbitration_id=0x110, is_extended_id=False), 0.0)
    (beat,) = read(unit.tick(60.0))
    assert beat == ThrusterHeartbeat(4, "Thrusting", 1, 1, 10)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("acceleration_cap", 0.0),
        ("acceleration_cap", 6.0),
        ("acceleration_cap", float("nan")),
        ("quantum", 1.5e-5),
        ("quantum", -1e-5),
        ("quantum", float("nan")),
        ("smallest", -1e-5),
        ("smallest", 2.0),
        ("watchdog_timeout", 0.0),
        ("clock_mode", "sidereal"),
    ],
)
def test_wrong_options_are_named(name: str, value: object) -> None:
    with pytest.raises(ValueError, match=f"^{name}: "):
        thruster(**{name: value})


def test_wrong_dbc_file_is_named(tmp_path: pathlib.Path) -> None:
    with pytest.raises(ValueError, match="missing.dbc: "):
        CanThruster(tmp_path / "missing.dbc")


def test_isolated_axes_give_nothing_until_they_are_opened():
    unit = thruster()
    assert unit.receive(FRAMES.encode_isolation([False, True, False]), 0.0) == []
    report = command(unit, 0, acceleration=(0.3, -0.4, 0.5))
    np.testing.assert_allclose(report.acceleration_rtn, [0.3, 0.0, 0.5], atol=1e-9)
    # It may come between the halves of a command, and damaged it counts as a rejected frame.
    first, second = FRAMES.encode_command(1, START, (0.3, -0.4, 0.5))
    damaged = FRAMES.encode_isolation([True, True, True])
    damaged.data[1] ^= 0x01
    unit.receive(first, 1.0)
    unit.receive(damaged, 1.0)
    unit.receive(FRAMES.encode_isolation([False, False, False]), 1.0)
    (report,) = read(unit.receive(second, 1.0))
    np.testing.assert_allclose(report.acceleration_rtn, [0.3, -0.4, 0.5], atol=1e-9)
    assert unit.rejected_frames == 1
