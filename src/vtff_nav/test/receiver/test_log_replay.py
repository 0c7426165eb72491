"""Order and seconds of a replayed log, and its pace by the wall clock."""

from __future__ import annotations

import numpy as np
import pytest

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.novatel import CommandResponse, RawLog
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch
from vtff_nav.receiver import log_replay
from vtff_nav.receiver.log_replay import LogReplay, WallClockPacer

START = 1_300_000_000  # s since 1980-01-06


def at(seconds):
    return GpsTime(START * 1_000_000_000) + seconds


def epoch(seconds):
    empty = {name: np.empty(0, kind) for name, kind in OBSERVATION_COLUMNS.items()}
    return ObservationEpoch(at(seconds), 180, 0, "RANGE", **empty)


def raw(seconds):
    return RawLog(None if seconds is None else at(seconds), "VERSIONB", 37, b"")


class Script:
    """Stands for source and stream: each chunk gives the next group of events."""

    def __init__(self, *groups, chunk_length=100):
        self._groups = list(groups)
        self._chunk_length = chunk_length
        self.position = 0

    def read(self):
        if not self._groups:
            return b""
        self.position += self._chunk_length
        return b"."

    def feed(self, chunk):
        return self._groups.pop(0)

    def close(self):
        return []


def steps(script):
    """Return second of the log and event, for all events in order."""
    log = LogReplay(script, script)
    taken = []
    while True:
        if log.has_next:
            announced = log.next_second()
            event = log.take()
            assert announced is None or announced == log.second
            taken.append((log.second - START, event))
        elif log.at_end:
            return log, taken
        else:
            log.read_more()


def test_a_second_holds_what_was_measured_since_the_one_before():
    events = [epoch(x) for x in (0.0, 0.05, 0.95, 1.0, 1.05, 2.0, 4.5)]
    _, taken = steps(Script(events))
    assert [second for second, _ in taken] == [0, 1, 1, 1, 2, 2, 5]
    assert [event for _, event in taken] == events


@pytest.mark.parametrize("cut", range(5))
def test_what_stands_before_the_first_measurement_belongs_to_its_second(cut):
    events = [raw(None), CommandResponse(True, "OK"), raw(-720.0), epoch(3.0), epoch(4.0)]
    _, taken = steps(Script(events[:cut], events[cut:]))
    assert [second for second, _ in taken] == [3, 3, 3, 3, 4]
    assert [event for _, event in taken] == events


def test_stored_logs_with_old_or_new_times_do_not_move_the_time():
    _, taken = steps(Script([epoch(0.0), raw(-720.0), raw(9.0), epoch(1.0)]))
    assert [second for second, _ in taken] == [0, 0, 0, 1]


def test_small_disorder_does_not_turn_the_time_back():
    _, taken = steps(Script([epoch(40.0), epoch(39.0), epoch(10.0), epoch(41.0)]))
    assert [second for second, _ in taken] == [40, 40, 40, 41]


def test_a_jump_back_begins_an_earlier_second():
    _, taken = steps(Script([epoch(40.0), epoch(9.0), epoch(10.0), epoch(-1e6)]))
    assert [second for second, _ in taken] == [40, 9, 10, -1_000_000]


def test_in_a_log_without_measurements_every_time_counts():
    _, taken = steps(Script([raw(None), raw(1.0)], [raw(2.5), raw(None), raw(4.0)]))
    assert [second for second, _ in taken] == [1, 1, 3, 3, 4]


def test_the_search_for_a_measurement_is_limited():
    groups = [[raw(float(k))] for k in range(20)] + [[epoch(50.0)]]
    script = Script(*groups, chunk_length=log_replay.READ_AHEAD_LENGTH // 4)
    log = LogReplay(script, script)
    while not log.has_next:
        log.read_more()
    assert script.position == log_replay.READ_AHEAD_LENGTH
    assert log.next_second() == START


def test_a_log_without_any_time_has_nothing_to_take():
    log, taken = steps(Script([raw(None), CommandResponse(True, "OK")]))
    assert taken == []
    assert log.undated_count == 2


def test_the_wall_clock_paces():
    pacer = WallClockPacer(2.0)
    assert pacer.may_begin(100, 10.0)
    assert not pacer.may_begin(101, 10.4)
    assert pacer.may_begin(101, 10.5)
    assert pacer.may_begin(104, 12.0)
    assert not pacer.may_begin(105, 12.4)


def test_what_was_late_is_caught_up():
    pacer = WallClockPacer(1.0)
    assert pacer.may_begin(0, 0.0)
    assert pacer.may_begin(1, 5.0)
    assert all(pacer.may_begin(second, 5.0) for second in (2, 3, 4, 5))
    assert not pacer.may_begin(6, 5.0)


@pytest.mark.parametrize("jump", [-1000, -1, log_replay.LONGEST_GAP_SECONDS + 1, 10**8])
def test_jumps_are_not_waited_out(jump):
    pacer = WallClockPacer(1.0)
    assert pacer.may_begin(5000, 0.0)
    assert pacer.may_begin(5000 + jump, 0.5)
    assert not pacer.may_begin(5001 + jump, 1.4)
    assert pacer.may_begin(5001 + jump, 1.5)


def test_rate_zero_does_not_wait():
    pacer = WallClockPacer(0.0)
    assert all(pacer.may_begin(second, 0.0) for second in range(0, 10_000, 7))
