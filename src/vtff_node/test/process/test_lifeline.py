"""Lifelines: processes end in order when the program that started them is killed."""

from __future__ import annotations

import os
import pathlib
import signal
import subprocess
import sys
import textwrap
import time

import pytest

from vtff_node.process.lifeline import LIFELINE_VARIABLE, Lifelines, Stage

LIMIT = 30.0  # s after which a test gives up

# A process of a run: says that it watches, and at its end appends its name to a file.
CHILD = """
    import signal, sys, time
    from vtff_node.process import lifeline
    from vtff_node.process.stop_signals import StopRequest

    name, report, teardown = sys.argv[1:]
    lifeline.END_PATIENCE = 1.0
    stop = StopRequest()
    stop.install()
    lifeline.watch_lifeline()
    open(report + "." + name, "w").close()
    while not stop.requested:
        time.sleep(0.01)
    exec(teardown)
    with open(report, "a") as stream:
        stream.write(name + "\\n")
"""

# The program that starts a process of each stage, those that end last first.
HOLDER = """
    import os, subprocess, sys, time
    from vtff_node.process.lifeline import Lifelines, Stage

    child, report, teardown = sys.argv[1:]
    lifelines = Lifelines()
    for stage in reversed(Stage):
        last_work = teardown if stage is Stage.NODES else "pass"
        subprocess.Popen(
            [sys.executable, "-c", child, stage.name, report, last_work],
            env={**os.environ, **lifelines.environment(stage)},
            start_new_session=True,
        )
    time.sleep(600)
"""


def wait_until(condition):
    deadline = time.monotonic() + LIMIT
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert condition()


def start_holder(report, teardown):
    child, holder = textwrap.dedent(CHILD), textwrap.dedent(HOLDER)
    process = subprocess.Popen([sys.executable, "-c", holder, child, str(report), teardown])
    ready = [pathlib.Path(f"{report}.{stage.name}") for stage in Stage]
    wait_until(lambda: all(path.exists() for path in ready))
    return process


def lines_of(report):
    return report.read_text().split() if report.exists() else []


def test_processes_end_stage_by_stage_when_their_program_is_killed(tmp_path):
    report = tmp_path / "report"
    # The node takes its time: the others must wait for it.
    holder = start_holder(report, "time.sleep(0.5)")
    holder.kill()
    holder.wait()
    wait_until(lambda: len(lines_of(report)) == len(Stage))
    assert lines_of(report) == [stage.name for stage in Stage]


def test_a_node_that_does_not_end_does_not_keep_the_others(tmp_path):
    report = tmp_path / "report"
    holder = start_holder(report, "while True: pass")
    holder.kill()
    holder.wait()
    wait_until(lambda: len(lines_of(report)) == len(Stage) - 1)
    assert lines_of(report) == ["RECORDERS", "HELPERS"]


def run_child(report, lifeline):
    return subprocess.run(
        [sys.executable, "-c", textwrap.dedent(CHILD), "child", str(report), "pass"],
        env={**os.environ, LIFELINE_VARIABLE: lifeline},
        capture_output=True,
        text=True,
        timeout=LIMIT,
    )


def test_a_process_whose_program_died_before_it_started_ends_at_once(tmp_path):
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    result = run_child(tmp_path / "report", f"{gone.pid}:5:6,7")
    assert (result.returncode, result.stderr) == (0, "")
    assert lines_of(tmp_path / "report") == ["child"]


def test_closed_lifelines_end_the_process(tmp_path):
    lifelines = Lifelines()
    environment = {**os.environ, **lifelines.environment(Stage.HELPERS)}
    report = tmp_path / "report"
    child = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(CHILD), "child", str(report), "pass"],
        env=environment,
    )
    wait_until(pathlib.Path(f"{report}.child").exists)
    assert child.poll() is None
    lifelines.close()
    assert child.wait(LIMIT) == 0


@pytest.mark.parametrize(("ignored", "code"), [(False, 0), (True, -signal.SIGKILL)])
def test_a_closed_terminal_ends_a_process_unless_nohup_ignores_it(ignored, code):
    # The tests themselves may run under nohup, whose handling a process inherits.
    handling = "SIG_IGN" if ignored else "SIG_DFL"
    program = f"""if True:
        import signal, time
        from vtff_node.process.stop_signals import StopRequest
        signal.signal(signal.SIGHUP, signal.{handling})
        stop = StopRequest()
        stop.install()
        print("ready", flush=True)
        while not stop.requested:
            time.sleep(0.01)
    """
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        try:
            process.stdout.readline()
            process.send_signal(signal.SIGHUP)
            if ignored:
                time.sleep(0.3)
                process.kill()
            assert process.wait(LIMIT) == code
        finally:
            process.kill()
