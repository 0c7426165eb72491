"""Niceness of all threads of a process, and of the session that it leads."""

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
    session = pathlib.Path("/proc/self/autogroup")
    before = session.read_text() if session.exists() else ""
    assert not priority.set_niceness(-10)
    assert (session.read_text() if session.exists() else "") == before
