"""Niceness and policy of all threads of a process, and niceness of the session that it leads."""

from __future__ import annotations

import errno
import os
import pathlib
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


YIELDING_PROGRAM = """
import os, pathlib, threading
from vtff_node.process.priority import yield_to_others
threading.Thread(target=threading.Event().wait, daemon=True).start()
yield_to_others()
threading.Thread(target=threading.Event().wait, daemon=True).start()
threads = [int(task.name) for task in pathlib.Path("/proc/self/task").iterdir()]
print(len(threads), {os.sched_getscheduler(thread) for thread in threads} == {os.SCHED_BATCH})
"""


@pytest.mark.skipif(not hasattr(os, "SCHED_BATCH"), reason="a policy of Linux")
def test_no_thread_interrupts_others():
    done = subprocess.run(
        [sys.executable, "-c", YIELDING_PROGRAM], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["3", "True"]


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
    priority.yield_to_others()
    assert (session.read_text() if session.exists() else "") == before
