"""The end of a second, by its last log or by silence; rates and load of the line."""

from __future__ import annotations

import math

import pytest
from receiver_port_support import START, Outputs, epoch_time

from vtff_nav.receiver.log_replay import whole_second
from vtff_nav.receiver.second_watch import SHORTER_WAIT, SecondWatch
from vtff_nav.receiver.stream_statistics import StreamStatistics

OUTPUTS = Outputs(signals=4)
FIRST = whole_second(START)


def time_log(second: int):
    return OUTPUTS.receiver_time(epoch_time(20 * second))


def test_the_last_log_ends_a_second_before_or_after_it_is_named():
    watch = SecondWatch("TIME", 0.3)
    watch.read(100, [time_log(0)], 10.0)
    assert not watch.is_done(10.0)  # not named yet
    watch.begin(FIRST, 10.1)
    assert watch.is_done(10.1)
    assert not watch.is_done(10.1)  # once
    watch.begin(FIRST + 1, 10.2)
    assert not watch.is_done(10.2)
    watch.read(100, [OUTPUTS.fix(epoch_time(20))], 10.25)
    assert not watch.is_done(10.25)
    watch.read(100, [time_log(1)], 10.3)
    assert watch.is_done(10.3)


@pytest.mark.parametrize(
    ("log", "event"), [("BESTXYZ", OUTPUTS.fix), ("TIME", OUTPUTS.receiver_time)]
)
def test_which_log_it_is_can_be_chosen(log, event):
    watch = SecondWatch(log, 0.3)
    watch.begin(FIRST, 0.0)
    watch.read(1, [event(START)], 0.0)
    assert watch.is_done(0.0)


def test_only_the_observations_of_the_whole_second_end_it():
    watch = SecondWatch("RANGE", 0.3)
    watch.begin(FIRST + 1, 0.0)
    watch.read(1, epochs(1, 20), 0.0)
    assert not watch.is_done(0.0)
    watch.read(1, epochs(20, 21), 0.0)
    assert watch.is_done(0.0)


def test_silence_ends_a_second_and_then_sooner():
    watch = SecondWatch("TIME", 0.3)
    watch.begin(FIRST, 0.0)
    watch.read(10, [], 0.2)  # something comes, but not the last log
    assert not watch.is_done(0.45)
    assert watch.is_done(0.55)
    assert watch.silent_seconds == 0
    watch.begin(FIRST + 1, 1.0)
    assert not watch.is_done(1.0 + 0.9 * 0.3 * SHORTER_WAIT)
    assert watch.is_done(1.0 + 1.1 * 0.3 * SHORTER_WAIT)
    assert watch.silent_seconds == 1
    watch.begin(FIRST + 1, 1.5)
    watch.read(10, [], 1.5)  # it is back: patience for the rest of the second
    assert not watch.is_done(1.5 + 0.9 * 0.3)
    assert watch.is_done(1.5 + 1.1 * 0.3)
    watch.begin(FIRST + 2, 2.0)
    watch.read(10, [time_log(2)], 2.0)
    assert watch.is_done(2.0)
    watch.begin(FIRST + 3, 3.0)
    assert not watch.is_done(3.0 + 0.9 * 0.3)  # patient again
    assert watch.silent_seconds == 0


def test_answers_to_commands_do_not_break_the_silence():
    watch = SecondWatch("TIME", 0.1)
    for second in range(3):
        watch.begin(FIRST + second, float(second))
        watch.read(50, [], float(second), is_dialogue=True)
        assert watch.is_done(second + 0.2)
    assert watch.silent_seconds == 3


def test_a_scenario_that_begins_again_is_waited_for():
    watch = SecondWatch("TIME", 0.3)
    watch.begin(FIRST + 100, 0.0)
    watch.read(10, [time_log(100)], 0.0)
    assert watch.is_done(0.0)
    watch.begin(FIRST, 1.0)
    assert not watch.is_done(1.0)
    watch.read(10, [time_log(0)], 1.1)
    assert watch.is_done(1.1)


def epochs(first: int, last: int):
    return [OUTPUTS.observations(epoch_time(n)).series.epoch(0) for n in range(first, last)]


@pytest.mark.parametrize("batch", [1, 7, 40])
def test_rates_do_not_depend_on_how_the_epochs_come(batch):
    statistics = StreamStatistics()
    for first in range(0, 400, batch):
        taken = epochs(first, min(first + batch, 400))
        statistics.add(1000 * len(taken), taken)
    epoch_rate, byte_rate = statistics.rates()
    assert epoch_rate == pytest.approx(20.0)
    assert byte_rate == pytest.approx(20_000.0, rel=1e-3)
    assert statistics.line_values(460800)["link load %"] == "43.4"
    assert "link load %" not in statistics.line_values(None)


def test_rates_after_a_gap_are_those_after_the_gap():
    statistics = StreamStatistics()
    assert all(math.isnan(rate) for rate in statistics.rates())
    assert statistics.line_values(9600) == {}
    statistics.add(1000, epochs(0, 20))
    for number in range(600, 641, 20):  # 1 Hz now
        statistics.add(50, epochs(number, number + 1))
    assert statistics.rates() == pytest.approx((1.0, 50.0))


def test_nothing_observed_yet():
    statistics = StreamStatistics()
    assert statistics.tracking_values() == {"satellites": "0"}
    assert statistics.newest_nanoseconds == 0
