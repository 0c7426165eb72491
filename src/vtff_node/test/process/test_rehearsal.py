"""A twin repeats what an object was told, shortly before the next step; then it is left alone."""

import time

import pytest

from vtff_node.process.rehearsal import Rehearsal

SECOND = 1_000_000_000
START = 10_000 * SECOND  # long after a stamp of zero


class Timer:
    def __init__(self, callback):
        self.callback = callback
        self.is_running = True
        self.timer_period_ns = SECOND

    def cancel(self):
        self.is_running = False

    def reset(self):
        self.is_running = True


class Node:
    def create_timer(self, period, callback, clock):
        self.timer = Timer(callback)
        return self.timer


class Summing:
    def __init__(self):
        self.total = 0.0
        self.scales = []

    def add(self, number, *, scale=1.0):
        self.total += scale * number
        self.scales.append(scale)

    def fail(self):
        raise ArithmeticError

    def linger(self):
        end = time.thread_time() + 0.021
        while time.thread_time() < end:
            self.total += 0.0


@pytest.fixture
def rehearsed():
    node, twin = Node(), Summing()
    return node, twin, Rehearsal(node, None, twin)


def test_a_rehearsal_comes_shortly_before_the_next_step(rehearsed):
    node, twin, rehearsal = rehearsed
    assert not node.timer.is_running
    for step in (5, 6):
        rehearsal.note("add", step, scale=2.0)
        rehearsal.expect_after(START + step * SECOND, time.perf_counter())
    assert node.timer.is_running and twin.total == 0.0
    assert 0.8 * SECOND < node.timer.timer_period_ns < SECOND
    node.timer.callback()
    assert twin.total == 22.0 and twin.scales == [2.0, 2.0]
    assert not node.timer.is_running


@pytest.mark.parametrize("interval, late", [(0.05, 0.0), (1.0, 2.0), (1000.0, 0.0)])
def test_no_rehearsal_between_steps_that_follow_at_once_or_at_an_unknown_time(
    rehearsed, interval, late
):
    node, _, rehearsal = rehearsed
    rehearsal.expect_after(START + 5 * SECOND, time.perf_counter())
    rehearsal.expect_after(
        START + 5 * SECOND + round(interval * SECOND), time.perf_counter() - late
    )
    assert not node.timer.is_running


@pytest.mark.parametrize("method", ["fail", "linger"])
def test_a_twin_that_fails_or_is_slow_is_left_alone(rehearsed, method):
    node, twin, rehearsal = rehearsed
    for _ in range(10):
        rehearsal.note(method)
        node.timer.callback()
    rehearsal.note("add", 1.0)
    rehearsal.expect_after(START + 5 * SECOND, time.perf_counter())
    rehearsal.expect_after(START + 6 * SECOND, time.perf_counter())
    assert not node.timer.is_running
    node.timer.callback()
    assert twin.total == 0.0


def test_calls_without_steps_do_not_gather_for_ever(rehearsed):
    node, twin, rehearsal = rehearsed
    for number in range(2000):
        rehearsal.note("add", number)
    node.timer.callback()
    assert twin.total == 0.0
