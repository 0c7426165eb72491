"""States, commands and scenario time of the emulated SimGEN, without network or wall clock."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vtff_sim_bridge.simgen.emulator_state import ScenarioMachine
from vtff_sim_bridge.simremote.language import Reply, SimGenStatus, format_motion
from vtff_sim_bridge.simremote.motion import MotionState

if TYPE_CHECKING:
    from conftest import ManualClock

VEHICLES = ("v1_m1", "v2_m1")
SECOND = 1_000_000_000
INITIAL = ["0,MOT,v1_m1,7e6,0,0", "0,mot,V2_M1,7.1e6,0,0"]
PATHS = {
    SimGenStatus.NO_SCENARIO: [],
    SimGenStatus.READY: ["SC,a.scn"],
    SimGenStatus.ARMED: ["SC,a.scn", *INITIAL, "AR"],
    SimGenStatus.RUNNING: ["SC,a.scn", *INITIAL, "RU"],
    SimGenStatus.ENDED: ["SC,a.scn", *INITIAL, "RU", "-,EN"],
}


def made(*lines: str, **options: object) -> ScenarioMachine:
    """Return a machine after some commands, none of which may fail."""
    machine = ScenarioMachine(VEHICLES, **options)  # type: ignore[arg-type]
    for line in lines:
        reply = machine.execute(line)
        assert reply is None or reply.failure is None, (line, reply)
    return machine


def answer(machine: ScenarioMachine, line: str) -> Reply:
    reply = machine.execute(line)
    assert reply is not None
    return reply


# From the status (column) a command leads to the status given; x: refused, status unchanged.
TRANSITIONS = """
command                                     0   2   4   5   7
NULL                                        0   2   4   5   7
*IDN?                                       0   2   4   5   7
-,NULL                                      0   2   4   5   7
SC,b.scn                                    2   2   x   x   x
START_TIME,22-Mar-2017_02:00:18,01:00:00    x   2   x   x   x
TR,0                                        x   2   4   x   x
TR,1                                        x   x   x   x   x
AR                                          x   x   x   x   x
AR_NOWAIT                                   x   x   x   x   x
RU                                          x   x   5   x   x
RU_NOWAIT                                   x   x   5   x   x
-,EN                                        x   x   x   7   7
-,EN,0                                      x   x   x   7   7
-,EN,1                                      x   x   x   2   2
-,EN,1,0                                    x   x   x   2   2
-,EN,3                                      x   x   x   x   x
EN,1                                        x   x   x   x   x
RW                                          x   2   x   x   2
-,INIT_POS,v1_m1,1,2,3                      x   2   x   x   x
-,POW_LEV,V1_A1,-3,GPS,0,0,1,1,1,1,0        x   2   4   5   x
-,POW_ON,v1_a1,1,GPS,1,0,0,0,0              x   2   4   5   x
-,POW_MODE,v1_a1,1                          x   2   4   5   x
REF_DBM,-130                                x   2   4   5   x
0,MOT,v1_m1,1,2,3                           x   2   4   5   x
-,MOT,v1_m1,1,2,3                           x   2   4   5   x
0,MOTB,v1_m1,0.1,0.2,3                      x   2   4   5   x
0,MOT,v9_m1,1,2,3                           x   x   x   x   x
ZCNT_TIM?                                   x   x   x   x   x
"""


def transition_table() -> list[tuple[str, SimGenStatus, str]]:
    header, *rows = [line.split() for line in TRANSITIONS.strip().splitlines()]
    statuses = [SimGenStatus(int(text)) for text in header[1:]]
    return [
        (row[0].replace("_02:", " 02:"), status, expected)
        for row in rows
        for status, expected in zip(statuses, row[1:], strict=True)
    ]


@pytest.mark.parametrize(("line", "status", "expected"), transition_table())
def test_transition(line: str, status: SimGenStatus, expected: str) -> None:
    machine = made(*PATHS[status])
    assert machine.status is status
    reply = answer(machine, line)
    assert (reply.failure is not None) == (expected == "x"), reply
    assert reply.status == (status if expected == "x" else int(expected))
    assert machine.status is reply.status


@pytest.mark.parametrize("line", ["AR", "-,ar", "RU", "AR_NOWAIT", "RU_NOWAIT"])
def test_arming_needs_motion_of_every_vehicle(line: str) -> None:
    machine = made("SC,a.scn", INITIAL[0])
    reply = answer(machine, line)
    assert reply.status is SimGenStatus.READY
    assert "v2_m1 has no motion at time 0" in str(reply.failure)
    made_ready = made("SC,a.scn", INITIAL[0], "-,INIT_POS,v2_m1,45,10,100")
    expected = SimGenStatus.RUNNING if "R" == line[0] else SimGenStatus.ARMED
    assert answer(made_ready, line).status is expected


def test_armed_cannot_be_ended_but_run_and_then_ended() -> None:
    machine = made(*PATHS[SimGenStatus.ARMED])
    reply = answer(machine, "-,EN,1")
    assert reply.failure == "an armed scenario cannot be ended: send RU, then EN"
    assert answer(machine, "RU").status is SimGenStatus.RUNNING
    assert answer(machine, "-,EN,1").status is SimGenStatus.READY


def test_arming_takes_its_delay(manual_clock: ManualClock) -> None:
    machine = made("SC,a.scn", *INITIAL, arming_delay=26.0, monotonic=manual_clock)
    assert machine.execute("AR") is None
    assert machine.seconds_to_next_change() == 26.0
    manual_clock.now += 25.5
    assert machine.deferred_reply() is None
    assert answer(machine, "NULL").status is SimGenStatus.ARMING
    assert "cannot be ended" in str(answer(machine, "-,EN,1").failure)
    assert answer(machine, "AR").failure is not None
    manual_clock.now += 0.5
    assert machine.deferred_reply() == Reply(SimGenStatus.ARMED)
    assert machine.seconds_to_next_change() is None
    assert answer(machine, "RU").status is SimGenStatus.RUNNING


def test_run_from_ready_arms_first(manual_clock: ManualClock) -> None:
    machine = made("SC,a.scn", *INITIAL, arming_delay=26.0, monotonic=manual_clock)
    assert machine.execute("RU") is None
    assert machine.status is SimGenStatus.ARMING
    manual_clock.now += 26.0
    assert machine.deferred_reply() == Reply(SimGenStatus.RUNNING)


def test_nowait_forms_answer_at_once(manual_clock: ManualClock) -> None:
    machine = made("SC,a.scn", *INITIAL, arming_delay=26.0, monotonic=manual_clock)
    assert answer(machine, "AR_NOWAIT") == Reply(SimGenStatus.ARMING)
    assert answer(machine, "RU_NOWAIT") == Reply(SimGenStatus.ARMING)
    manual_clock.now += 26.0
    assert answer(machine, "NULL").status is SimGenStatus.RUNNING


def test_loading_takes_its_delay(manual_clock: ManualClock) -> None:
    machine = made(loading_delay=3.0, monotonic=manual_clock)
    assert answer(machine, "SC,a.scn") == Reply(SimGenStatus.LOADING)
    assert "loading" in str(answer(machine, "-,TIME").data_text)
    assert answer(machine, "SC,b.scn").failure is not None
    manual_clock.now += 3.0
    assert answer(machine, "NULL").status is SimGenStatus.READY


def test_queries() -> None:
    machine = made("SC,C:\\Scenarios\\leo, polar.scn")
    assert "Spirent" in str(answer(machine, "*idn?").data_text)
    assert answer(machine, "SC_NAME").data_text == "leo,polar.scn"
    assert answer(machine, "SC_NAME,includepath").data_text == "C:\\Scenarios\\leo,polar.scn"
    made_start = "START_TIME,22-MAR-2017 02:00:18,1 02:03:04,v1_m1"
    assert answer(machine, made_start).failure is None
    assert answer(machine, "STTIME").data_text == "22-Mar-2017 02:00:18"
    assert answer(machine, "SC_DURATION").data_text == "1 02:03:04"
    assert answer(machine, "-,TIME").data_text == "scenario is loading or has ended"
    for line in [*INITIAL, "RU", "1.25,MOT,v1_m1,1,2,3", "1.25,MOT,v2_m1,1,2,3"]:
        assert answer(machine, line).failure is None
    assert float(str(answer(machine, "-,TIME").data_text)) == 1.25
    # 2017-03-22 is 13590 days after 1980-01-06; GPS was 18 s ahead of UTC.
    assert answer(machine, "-,GPS_TIME").data_text == str(13590 * 86400 + 7218 + 1)
    assert answer(machine, "-,UTC_TIME").data_text == "22-Mar-2017 02:00:01.250"


@pytest.mark.parametrize(
    ("line", "field"),
    [
        ("5x,MOT,v1_m1,1,2,3", "timestamp"),
        ("MOT,v1_m1,1,2,3", "timestamp"),
        ("10,RU", "timestamp"),
        ("TIME", "timestamp"),
        ("0,MOT,v1,1,2,3", "vehicle"),
        ("0,MOT,v1_m1,1,2", "position_z"),
        ("0,MOTB,v1_m1,1,2,x", "height"),
        ("-,INIT_POS,v1_m1,91,2,3", "latitude"),
        ("-,INIT_POS,v1_m1,1,2", "INIT_POS"),
        ("-,POW_LEV,v1_m1,-3", "antenna"),
        ("-,POW_LEV,v1_a1,loud", "level"),
        ("-,POW_LEV,v7_a1,1", "vehicle"),
        ("-,POW_ON,v1_a1,2", "switch"),
        ("START_TIME,yesterday", "start_time"),
        ("START_TIME,22-Mar-2017 02:00:18,0", "duration"),
        ("START_TIME,22-Mar-2017 02:00:18,00:00:00", "duration"),
        ("TR,7", "trigger"),
        ("-,EN,x", "stop_mode"),
        ("SC", "scenario"),
        ("SC_NAME,x", "argument 1"),
        ("NULL,1", "argument 1"),
        ("FOO", "verb"),
    ],
)
def test_errors_name_the_field(line: str, field: str) -> None:
    reply = answer(made("SC,a.scn"), line)
    assert str(reply.error_text).startswith(field + ": ")


def test_power_commands_are_stored() -> None:
    machine = made("SC,a.scn", "REF_DBM,-125.5", "1.5,POW_LEV,V1_A1,-3,GPS,0,0,1,1,1,1,0")
    reference, level = machine.power_commands
    assert (reference.verb, reference.value, reference.antenna_id) == ("REF_DBM", -125.5, None)
    assert (level.time_nanoseconds, level.antenna_id, level.value) == (1_500_000_000, "v1_a1", -3.0)
    assert level.arguments[2:4] == ("GPS", "0")
    answer(machine, "SC,b.scn")
    assert machine.power_commands == []


def test_lockstep_time_is_the_newest_stamp_of_all_vehicles() -> None:
    machine = made("SC,a.scn", *INITIAL)
    times: list[int] = []
    machine.observers.append(times.append)
    answer(machine, "RU")
    assert times == [0]
    for line, expected in [
        ("1,MOT,v1_m1,1,2,3", 0.0),
        ("2,MOT,v1_m1,1,2,3", 0.0),
        ("0 00:00:01.000,MOT,v2_m1,1,2,3", 1.0),
        ("3,MOT,v2_m1,1,2,3", 1.0),
        ("00:00:02,MOTB,v2_m1,0.1,0.2,3", 2.0),
        ("1.5,MOT,v1_m1,1,2,3", 2.0),
        ("3.0,MOT,v1_m1,1,2,3", 3.0),
    ]:
        answer(machine, line)
        assert machine.time_nanoseconds == expected * SECOND
    assert times == [0, SECOND, 2 * SECOND, 3 * SECOND]


def test_lockstep_commands_sent_before_the_run_count() -> None:
    ahead = ["1,MOT,v1_m1,1,2,3", "1,MOT,v2_m1,1,2,3", "2,MOT,v1_m1,1,2,3"]
    machine = made("SC,a.scn", *INITIAL, *ahead)
    times: list[int] = []
    machine.observers.append(times.append)
    answer(machine, "RU")
    assert times == [0, SECOND]


def test_observer_sees_the_motion_of_the_whole_step() -> None:
    machine = made("SC,a.scn", *INITIAL)
    seen: list[list[float]] = []

    def observe(time: int) -> None:
        grid = [t for t in (time - 3 * SECOND // 4, time - SECOND // 2, time) if t >= 0]
        seen.append([machine.motions["v1_m1"].at(t).position_itrf[0] for t in grid])

    machine.observers.append(observe)
    answer(machine, "RU")
    for step in (1, 2):
        state = MotionState((100.0 * step, 0.0, 0.0), (10.0, 0.0, 0.0))
        for vehicle in VEHICLES:
            answer(machine, format_motion(step * SECOND, vehicle, state))
    # Within the step the previous command is extrapolated; at its end the new one holds.
    assert seen == [[7e6], [7e6, 7e6, 100.0], [102.5, 105.0, 200.0]]
    assert all(len(motion) == 1 for motion in machine.motions.values())


def test_the_scenario_ends_after_its_duration() -> None:
    start = "START_TIME,22-Mar-2017 02:00:18,00:00:02"
    machine = made("SC,a.scn", start, *INITIAL, "RU")
    for second in (1, 2):
        for vehicle in VEHICLES:
            assert answer(machine, f"{second},MOT,{vehicle},1,2,3").failure is None
    assert machine.status is SimGenStatus.ENDED
    assert machine.time_nanoseconds == 2 * SECOND
    assert "ended" in str(answer(machine, "-,TIME").data_text)
    assert "motion needs status" in str(answer(machine, "3,MOT,v1_m1,1,2,3").failure)


def test_rewound_scenario_runs_again_and_needs_new_motion() -> None:
    machine = made(*PATHS[SimGenStatus.RUNNING], "5,MOT,v1_m1,1,2,3", "5,MOT,v2_m1,1,2,3")
    assert machine.time_nanoseconds == 5 * SECOND
    assert answer(machine, "-,EN,1").status is SimGenStatus.READY
    assert machine.time_nanoseconds == 0
    assert "no motion at time 0" in str(answer(machine, "RU").failure)
    for line in [*INITIAL, "RU"]:
        assert answer(machine, line).failure is None
    assert machine.time_nanoseconds == 0


def test_realtime_follows_the_wall_clock(manual_clock: ManualClock) -> None:
    start = "START_TIME,22-Mar-2017 02:00:18,00:00:10"
    lines = ["SC,a.scn", start, *INITIAL]
    machine = made(*lines, clock_mode="realtime", monotonic=manual_clock)
    times: list[int] = []
    machine.observers.append(times.append)
    answer(machine, "RU")
    assert machine.seconds_to_next_change() == pytest.approx(0.01)
    manual_clock.now += 1.2345
    assert answer(machine, "-,TIME").data_text == "1.230"
    answer(machine, "1.3,MOT,v1_m1,5,0,0,1,0,0")
    manual_clock.now += 0.5
    machine.poll()
    assert machine.motions["v1_m1"].at(machine.time_nanoseconds).position_itrf[0] == pytest.approx(
        5.0 + 0.43
    )
    manual_clock.now += 60.0
    machine.poll()
    assert machine.status is SimGenStatus.ENDED
    assert times == [0, 1_230_000_000, 1_730_000_000, 10 * SECOND]


@pytest.mark.parametrize(
    ("vehicles", "options", "field"),
    [
        ((), {}, "vehicle_ids"),
        (("v1_m1", "V1_M1"), {}, "vehicle_ids"),
        (("chief",), {}, "vehicle"),
        (VEHICLES, {"clock_mode": "fast"}, "clock_mode"),
        (VEHICLES, {"arming_delay": -1.0}, "arming_delay"),
        (VEHICLES, {"loading_delay": float("nan")}, "loading_delay"),
    ],
)
def test_parameters_are_checked(vehicles: tuple, options: dict, field: str) -> None:
    with pytest.raises(ValueError, match=field):
        ScenarioMachine(vehicles, **options)


COMMAND_WORDS = [*PATHS[SimGenStatus.ARMED], "RU", "-,EN", "-,EN,1", "RW", "1,MOT,v1_m1,1,2,3"]


@given(st.lists(st.sampled_from([*COMMAND_WORDS, "1,MOT,v2_m1,1,2,3", "TR,0", "-,UTC_TIME"])))
def test_any_order_of_commands_is_answered(lines: list[str]) -> None:
    machine = ScenarioMachine(VEHICLES)
    previous = machine.status
    for line in lines:
        reply = answer(machine, line)
        assert reply.status is machine.status
        if reply.failure is not None:
            assert reply.status is previous
        previous = reply.status


@given(st.text())
def test_any_text_is_answered(line: str) -> None:
    assert answer(made(*PATHS[SimGenStatus.RUNNING]), line).status in SimGenStatus
