"""Child processes: logged, ended with growing firmness, never left behind."""

from __future__ import annotations

import os
import pathlib
import signal
import sys
import time

import pytest

from vtff_bringup.children import processes
from vtff_bringup.children.processes import ManagedProcess, end_together
from vtff_bringup.run.runner import check_counts


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    monkeypatch.setattr(
        processes,
        "ESCALATION",
        ((signal.SIGINT, 0.3), (signal.SIGTERM, 0.3), (signal.SIGKILL, 5.0)),
    )


def start(tmp_path, code, seen=None, log=None):
    def on_line(name, line, noteworthy):
        if seen is not None:
            seen.append((line, noteworthy))

    return ManagedProcess(
        "child",
        [sys.executable, "-c", code],
        log or tmp_path / "child.log",
        os.environ,
        (),
        on_line,
    )


def wait_for_line(tmp_path, text):
    deadline = time.monotonic() + 20.0
    while text not in (tmp_path / "child.log").read_text() and time.monotonic() < deadline:
        time.sleep(0.01)


def test_output_is_kept_and_noteworthy_lines_are_marked(tmp_path):
    seen = []
    code = (
        "import sys; print('hello', flush=True); print('[ERROR] broken', file=sys.stderr)\n"
        "print('afterwards'); sys.exit(3)"
    )
    child = start(tmp_path, code, seen)
    while child.exit_code is None:
        time.sleep(0.01)
    assert child.end() == 3
    assert ("[ERROR] broken", True) in seen
    assert ("hello", False) in seen
    assert "hello" in (tmp_path / "child.log").read_text()
    assert child.tail() == ["afterwards"]


def test_every_line_of_a_traceback_is_noteworthy(tmp_path):
    seen = []
    child = start(tmp_path, "print('before', flush=True)\nraise ValueError('wrong')", seen)
    while child.exit_code is None:
        time.sleep(0.01)
    child.end()
    assert seen[0] == ("before", False)
    assert seen[-1] == ("ValueError: wrong", True)
    assert len(seen) > 3 and all(noteworthy for _, noteworthy in seen[1:])
    assert child.tail() == []


@pytest.mark.skipif(not pathlib.Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_neither_stops_the_child_nor_goes_unsaid(tmp_path):
    seen = []
    lines = 20_000  # more than a pipe holds
    code = f"for i in range({lines}): print('line', i)"
    child = start(tmp_path, code, seen, log=pathlib.Path("/dev/full"))
    deadline = time.monotonic() + 60.0
    while child.exit_code is None and time.monotonic() < deadline:
        time.sleep(0.01)
    assert child.end() == 0
    assert seen[-1] == (f"line {lines - 1}", False)
    warnings = [line for line, noteworthy in seen if noteworthy]
    assert warnings == ["warning: /dev/full is not written any more: No space left on device"]


def test_a_log_that_cannot_be_opened_is_said(tmp_path):
    (tmp_path / "file").write_text("")
    seen = []
    child = start(tmp_path, "print('hello')", seen, log=tmp_path / "file" / "child.log")
    while child.exit_code is None:
        time.sleep(0.01)
    assert child.end() == 0
    assert "is not written any more: " in seen[0][0]
    assert seen[1:] == [("hello", False)]


def test_a_signal_during_the_start_waits_for_the_handlers(tmp_path, monkeypatch):
    monkeypatch.setattr(processes, "ESCALATION", ((signal.SIGINT, 20.0), (signal.SIGKILL, 5.0)))
    code = (
        "print('starting', flush=True)\n"
        "import signal, sys, time\n"
        "time.sleep(0.3)\n"
        "signal.signal(signal.SIGINT, lambda *_: sys.exit(7))\n"
        "signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])\n"
        "time.sleep(600)"
    )
    child = start(tmp_path, code)
    wait_for_line(tmp_path, "starting")
    assert child.end() == 7
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_processes_end_at_the_same_time(tmp_path, monkeypatch):
    """Each waits for the signal of the other: one after the other, they would be killed."""
    monkeypatch.setattr(processes, "ESCALATION", ((signal.SIGINT, 20.0), (signal.SIGKILL, 5.0)))
    code = (
        "import pathlib, signal, time\n"
        "own, other = pathlib.Path({own!r}), pathlib.Path({other!r})\n"
        "signal.signal(signal.SIGINT, lambda *_: own.touch())\n"
        "signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])\n"
        "while not (own.exists() and other.exists()): time.sleep(0.01)"
    )
    a, b = str(tmp_path / "a"), str(tmp_path / "b")
    children = [
        start(tmp_path, code.format(own=own, other=other), log=tmp_path / f"{own[-1]}.log")
        for own, other in ((a, b), (b, a))
    ]
    assert end_together(children) == [0, 0]


def test_a_child_that_ignores_signals_is_killed(tmp_path):
    code = (
        "import signal, time\n"
        "signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
        "signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "print('ready', flush=True)\n"
        "time.sleep(600)"
    )
    child = start(tmp_path, code)
    wait_for_line(tmp_path, "ready")
    assert child.end() == -signal.SIGKILL


def test_grandchildren_do_not_outlive_the_child(tmp_path):
    code = (
        "import subprocess, sys\n"
        "p = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'])\n"
        "print(p.pid, flush=True)\n"
    )
    child = start(tmp_path, code)
    while child.exit_code is None:
        time.sleep(0.01)
    child.end()
    wait_for_line(tmp_path, "\n")
    grandchild = pathlib.Path("/proc") / (tmp_path / "child.log").read_text().strip()
    deadline = time.monotonic() + 20.0
    while grandchild.exists() and time.monotonic() < deadline:
        if "State:\tZ" in (grandchild / "status").read_text():
            break
        time.sleep(0.01)
    else:
        assert not grandchild.exists()


def test_counts_that_differ_are_named(tmp_path):
    (tmp_path / "nodes").mkdir()
    (tmp_path / "nodes" / "a.json").write_text('{"published": {"/x": 3, "/y": 2}}')
    (tmp_path / "nodes" / "b.json").write_text('{"published": {"/x": 4}}')
    assert check_counts(tmp_path, {"/x": 7, "/y": 2}) == []
    assert check_counts(tmp_path, {"/x": 6}) == [
        "/x: published 7, recorded 6",
        "/y: published 2, recorded 0",
    ]


def test_more_recorded_than_published_names_the_cause(tmp_path):
    (tmp_path / "nodes").mkdir()
    (tmp_path / "nodes" / "a.json").write_text('{"published": {"/x": 3}}')
    assert check_counts(tmp_path, {"/x": 5}) == [
        "/x: published 3, recorded 5 (another run or program publishes on the same ROS_DOMAIN_ID)",
    ]


def test_a_stopped_child_is_named_and_ends_in_order(tmp_path):
    code = (
        "import signal, sys\n"
        "signal.signal(signal.SIGINT, lambda *_: sys.exit(7))\n"
        "signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])\n"
        "print('ready', flush=True)\n"
        "while True: signal.pause()"
    )
    child = start(tmp_path, code)
    wait_for_line(tmp_path, "ready")
    assert not child.is_stopped
    os.kill(child.process_id, signal.SIGSTOP)
    deadline = time.monotonic() + 20.0
    while not child.is_stopped and time.monotonic() < deadline:
        time.sleep(0.01)
    assert child.is_stopped
    assert child.end() == 7
    assert not child.is_stopped
