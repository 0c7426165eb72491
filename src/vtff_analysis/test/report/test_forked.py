"""Tasks in copies of the process: order, errors, lost copies, and none left."""

from __future__ import annotations

import contextlib
import functools
import os
import pathlib
import signal
import threading
import time

import pytest

from vtff_analysis.report.forked import run_forked

LONG = 60.0  # s


@pytest.fixture
def alone(monkeypatch):
    """Overlook the threads of the test session; none of them matters to a copy."""
    monkeypatch.setattr(threading, "active_count", lambda: 1)


def square_and_process(number):
    return number**2, os.getpid()


def test_the_results_are_in_the_order_of_the_tasks(alone):
    tasks = [functools.partial(square_and_process, number) for number in range(40)]
    results = run_forked(tasks, 3)
    assert [square for square, _ in results] == [number**2 for number in range(40)]
    assert os.getpid() not in {process for _, process in results}


@pytest.mark.parametrize("count", [0, 1, 5])
def test_one_process_is_this_one(count):
    tasks = [functools.partial(square_and_process, number) for number in range(count)]
    assert run_forked(tasks, 1) == [(number**2, os.getpid()) for number in range(count)]


def test_another_thread_keeps_the_tasks_in_this_process():
    end = threading.Event()
    thread = threading.Thread(target=end.wait)
    thread.start()
    try:
        assert {run for _, run in run_forked([lambda: (0, os.getpid())] * 2, 2)} == {os.getpid()}
    finally:
        end.set()
        thread.join()


def test_the_error_of_the_first_task_that_failed_is_raised(alone):
    def fail(text):
        raise ValueError(text)

    tasks = [lambda: 1, functools.partial(fail, "second"), functools.partial(fail, "third")]
    with pytest.raises(ValueError, match="second"):
        run_forked(tasks, 2)


def children():
    """Return the ids of the child processes of this one, ended or not."""
    ids = set()
    for path in pathlib.Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            if int(path.read_text().rpartition(")")[2].split()[1]) == os.getpid():
                ids.add(int(path.parent.name))
    return ids


def test_a_copy_that_is_killed_is_an_error_and_no_copy_is_left(alone):
    def end():
        os.kill(os.getpid(), signal.SIGKILL)

    before = children()
    with pytest.raises(OSError, match="ended without a result"):
        run_forked([end, lambda: 1, lambda: 2], 2)
    assert children() <= before


def test_an_interrupt_ends_the_copies(alone):
    """The handler of Python is set: ROS may have left its own in this process."""

    def interrupt_parent():
        os.kill(os.getppid(), signal.SIGINT)
        time.sleep(LONG)

    before = children()
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            run_forked([interrupt_parent, lambda: time.sleep(LONG)], 2)
    finally:
        signal.signal(signal.SIGINT, handler)
    assert children() <= before
