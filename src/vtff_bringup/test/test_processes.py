"""Child processes: logged, ended with growing firmness, never left behind."""

from __future__ import annotations

import os
import pathlib
import signal
import sys
import time

import pytest

from vtff_bringup import processes
from vtff_bringup.processes import ManagedProcess
from vtff_bringup.runner import check_counts


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    monkeypatch.setattr(
        processes,
        "ESCALATION",
        ((signal.SIGINT, 0.3), (signal.SIGTERM, 0.3), (signal.SIGKILL, 5.0)),
    )


def start(tmp_path, code, seen=None):
    def on_line(name, line, noteworthy):
        if seen is not None:
            seen.append((line, noteworthy))

    return ManagedProcess(
        "child", [sys.executable, "-c", code], tmp_path / "child.log", os.environ, (), on_line
    )


def wait_for_line(tmp_path, text):
    deadline = time.monotonic() + 20.0
    while text not in (tmp_path / "child.log").read_text() and time.monotonic() < deadline:
        time.sleep(0.01)


def test_output_is_kept_and_noteworthy_lines_are_marked(tmp_path):
    seen = []
    code = "import sys; print('hello'); print('[ERROR] broken', file=sys.stderr); sys.exit(3)"
    child = start(tmp_path, code, seen)
    while child.exit_code is None:
        time.sleep(0.01)
    assert child.end() == 3
    assert ("[ERROR] broken", True) in seen
    assert ("hello", False) in seen
    assert "hello" in (tmp_path / "child.log").read_text()
    assert "broken" in child.tail()


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
