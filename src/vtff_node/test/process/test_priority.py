"""Niceness and policy of all threads of a process, and niceness of the session that it leads."""

from __future__ import annotations

import errno
import os
import pathlib
import shutil
import subprocess
import sys

import pytest

from vtff_node.process import priority

PROGRAM = """
import os, pathlib, threading
from vtff_node.process.priority import is_niceness_chosen, set_niceness
before = is_niceness_chosen()
threading.Thread(target=threading.Event().wait, daemon=True).start()
assert set_niceness(7)
threads = [int(task.name) for task in pathlib.Path("/proc/self/task").iterdir()]
print(len(threads), {os.getpriority(os.PRIO_PROCESS, thread) for thread in threads})
session = pathlib.Path("/proc/self/autogroup")
print(session.read_text().split()[-1] if session.exists() else 7)
print(before, is_niceness_chosen())
"""


POLICY_PROGRAM = """
import os, pathlib, threading
from vtff_node.process.priority import {function}
threading.Thread(target=threading.Event().wait, daemon=True).start()
{function}()
threading.Thread(target=threading.Event().wait, daemon=True).start()
threads = [int(task.name) for task in pathlib.Path("/proc/self/task").iterdir()]
print(len(threads), *set(map(os.sched_getscheduler, threads)))
"""


def policies_with(function: str, *before: str) -> list[int]:
    """Return the number of threads and their policies in a process that calls a function."""
    program = [*before, sys.executable, "-c", POLICY_PROGRAM.format(function=function)]
    done = subprocess.run(program, capture_output=True, text=True, check=True)
    return [int(word) for word in done.stdout.split()]


def is_real_time_permitted() -> bool:
    """Return whether a process of this user may have a real-time policy."""
    command = ["chrt", "--rr", "1", "true"]
    return (
        bool(shutil.which("chrt")) and subprocess.run(command, capture_output=True).returncode == 0
    )


@pytest.mark.skipif(not hasattr(os, "SCHED_BATCH"), reason="a policy of Linux")
def test_no_thread_interrupts_others():
    assert policies_with("yield_to_others") == [3, os.SCHED_BATCH]


@pytest.mark.skipif(not is_real_time_permitted(), reason="a real-time policy is not permitted")
def test_all_threads_run_at_once():
    assert policies_with("run_at_once") == [3, os.SCHED_RR]


@pytest.mark.skipif(not is_real_time_permitted(), reason="a real-time policy is not permitted")
@pytest.mark.parametrize("function", ["run_at_once", "yield_to_others"])
def test_a_policy_of_the_user_stays(function):
    assert policies_with(function, "chrt", "--fifo", "3") == [3, os.SCHED_FIFO]


def test_all_threads_and_the_session_get_it():
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        capture_output=True,
        text=True,
        start_new_session=True,
        check=True,
    )
    count, niceness = done.stdout.splitlines()[0].split(maxsplit=1)
    assert int(count) >= 2 and niceness == "{7}"
    assert done.stdout.splitlines()[1] in ("7", "nice")
    assert done.stdout.splitlines()[2] == f"{os.nice(0) != 0} True"


@pytest.mark.parametrize("error", [errno.EACCES, errno.EPERM, errno.ENOSYS])
def test_a_system_that_does_not_permit_it(monkeypatch, error):
    def refuse(*_arguments: int) -> None:
        raise OSError(error, os.strerror(error))

    monkeypatch.setattr(os, "setpriority", refuse)
    monkeypatch.setattr(os, "sched_setscheduler", refuse, raising=False)
    session = pathlib.Path("/proc/self/autogroup")
    before = session.read_text() if session.exists() else ""
    assert not priority.set_niceness(-10)
    assert not priority.run_at_once()
    priority.yield_to_others()
    assert (session.read_text() if session.exists() else "") == before
