"""A callback that does not return is named with its node and its line."""

from __future__ import annotations

import threading

import pytest

from vtff_node.process.callback_watch import LARGEST_CALLBACK_TIME, CallbackWatch


class Node:
    """Stands for a node."""

    def __init__(self) -> None:
        self.entered, self.goes_on = threading.Event(), threading.Event()

    def get_fully_qualified_name(self) -> str:
        return "/deputy/relative_ekf"

    def take_epoch(self) -> None:
        self.entered.set()
        wait_for(self.goes_on)


def wait_for(event: threading.Event) -> None:
    """Stand for a function that a node calls."""
    event.wait(60.0)


class Clock:
    """A clock that goes when it is told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


def look_for(watch: CallbackWatch, clock: Clock, duration: float) -> None:
    """Look once a second, as the thread of the watch does."""
    for _ in range(round(duration)):
        clock.now += 1.0
        watch.look()


def test_the_node_and_its_line_are_named_once(clock):
    node, lines = Node(), []
    watches = []

    def run() -> None:
        watches.append(CallbackWatch(Node, lines.append, clock))
        node.take_epoch()

    thread = threading.Thread(target=run)
    thread.start()
    try:
        assert node.entered.wait(10.0)
        look_for(watches[0], clock, LARGEST_CALLBACK_TIME - 1.0)
        assert lines == []
        look_for(watches[0], clock, 10.0)
    finally:
        node.goes_on.set()
        thread.join()
    (line,) = lines
    assert line.startswith("take_epoch of /deputy/relative_ekf (")
    assert line.endswith(f"has not returned for {LARGEST_CALLBACK_TIME:.0f} s")


def test_a_loop_that_comes_round_is_not_named(clock):
    lines = []
    watch = CallbackWatch(Node, lines.append, clock)
    for _ in range(5):
        look_for(watch, clock, LARGEST_CALLBACK_TIME - 5.0)
        watch.come_round()
    assert lines == []


def test_a_process_that_was_stopped_is_not_named(clock):
    lines = []
    watch = CallbackWatch(Node, lines.append, clock)
    look_for(watch, clock, 5.0)
    clock.now += 600.0
    look_for(watch, clock, LARGEST_CALLBACK_TIME - 1.0)
    assert lines == []


def test_a_thread_that_has_ended_is_still_reported(clock):
    watches, lines = [], []
    thread = threading.Thread(
        target=lambda: watches.append(CallbackWatch(Node, lines.append, clock))
    )
    thread.start()
    thread.join()
    look_for(watches[0], clock, LARGEST_CALLBACK_TIME)
    assert lines == [f"a callback has not returned for {LARGEST_CALLBACK_TIME:.0f} s"]
