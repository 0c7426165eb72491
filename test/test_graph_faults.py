"""Faults of whole graphs: lost runners, late steps, full disks. Nothing flies on or is silent.

The short ones run with `make test`; docs/reliability.md tells what happens in each case.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time

import can
import psutil
import pytest
from domain_coordinator import domain_id
from graph_support import ROOT, SYSTEMS

from vtff_bag.file.reader import BagReader
from vtff_bringup.run.runner import check_counts
from vtff_node.can_bus.loopback import LoopbackCanBus

LIMIT = 180.0  # s after which a test gives up
GROUP = "239.74.163.2"  # default bus of config/system/reference.yaml


class Run:
    """`vtff run` as a user starts it, and all processes below it."""

    def __init__(self, folder, log, *arguments):
        self.folder = folder
        self.log = log
        command = [sys.executable, "-m", "vtff_bringup.cli", *map(str, arguments)]
        with self.log.open("w") as stream:
            self.process = subprocess.Popen(
                [*command, "--out", str(folder), "--no-report"],
                cwd=ROOT,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                env={**os.environ, "COLUMNS": "200"},
            )

    def wait_until_flying(self):
        wait_until(lambda: "in-track" in self.output() or self.process.poll() is not None)
        assert self.process.poll() is None, self.output()
        return psutil.Process(self.process.pid).children(recursive=True)

    def output(self):
        return self.log.read_text()

    def logs(self):
        return "".join(path.read_text() for path in (self.folder / "logs").glob("*.log"))


def wait_until(condition):
    deadline = time.monotonic() + LIMIT
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert condition()


def alive(processes):
    return [p for p in processes if p.is_running() and p.status() != psutil.STATUS_ZOMBIE]


@pytest.fixture
def fly(tmp_path):
    """A function that starts a run; whatever is left of it in the end is killed."""
    runs = []

    def start(*arguments):
        name = f"run{len(runs)}"
        runs.append(Run(tmp_path / name, tmp_path / f"{name}.log", *arguments))
        return runs[-1]

    yield start
    for run in runs:
        left = []
        with contextlib.suppress(psutil.NoSuchProcess):
            left = psutil.Process(run.process.pid).children(recursive=True)
        for process in [*left, run.process]:
            with contextlib.suppress(psutil.NoSuchProcess, ProcessLookupError):
                process.kill()
        run.process.wait()


def assert_ended_in_order(run, children):
    """Nothing is left, no traceback, and the bag holds exactly what the nodes published."""
    wait_until(lambda: not alive(children))
    assert "Traceback" not in run.logs() + run.output()
    assert "Timeout (" not in run.logs()
    topics = BagReader(run.folder).topics
    recorded = {name: topic.message_count for name, topic in topics.items()}
    assert recorded["/clock"] > 1
    assert check_counts(run.folder, recorded) == []


SOFTWARE = SYSTEMS / "reference_software.yaml"


@pytest.mark.parametrize(
    ("number", "arguments"),
    [
        pytest.param(signal.SIGKILL, ("--distributed",), id="killed"),
        pytest.param(
            signal.SIGKILL, ("--composed",), id="killed, composed", marks=pytest.mark.slow
        ),
        pytest.param(
            signal.SIGHUP, ("--distributed",), id="terminal closed", marks=pytest.mark.slow
        ),
        pytest.param(signal.SIGTERM, ("--composed",), id="terminated", marks=pytest.mark.slow),
    ],
)
def test_a_run_that_loses_its_runner_ends_in_order(fly, number, arguments):
    run = fly("run", SOFTWARE, *arguments)
    children = run.wait_until_flying()
    run.process.send_signal(number)
    assert run.process.wait(LIMIT) == (-signal.SIGKILL if number == signal.SIGKILL else 130)
    assert_ended_in_order(run, children)


@pytest.mark.slow
def test_the_last_command_on_the_bus_is_zero_thrust_when_the_runner_is_killed(fly):
    port = 43_000 + os.getpid() % 1000
    with LoopbackCanBus(GROUP, port) as bus:
        frames: list[can.Message] = []
        listening = threading.Event()

        def listen():
            while not listening.is_set():
                frame = bus.recv(0.1)
                if frame is not None:
                    frames.append(frame)

        thread = threading.Thread(target=listen)
        thread.start()
        emulator = subprocess.Popen(
            [sys.executable, "-m", "vtff_sim_bridge.thruster.can_thruster_emulator"]
            + ["--dbc", str(ROOT / "config/can/vtff_thruster.dbc"), "--port", str(port)],
        )
        try:
            run = fly("run", SYSTEMS / "reference.yaml", "thruster:=hardware", f"can_port:={port}")
            children = run.wait_until_flying()
            run.process.kill()
            assert_ended_in_order(run, children)
        finally:
            listening.set()
            thread.join()
            emulator.terminate()
            emulator.wait(LIMIT)
    decoded = _commands(frames)
    assert any(any(command[:3]) for command in decoded), "it thrust before"
    assert decoded[-1] == (0, 0, 0, 0)


def _commands(frames):
    """Return the accelerations in counts, and the mode, of each whole command."""
    import cantools

    database = cantools.database.load_file(str(ROOT / "config/can/vtff_thruster.dbc"))
    first, commands = None, []
    for frame in frames:
        with contextlib.suppress(KeyError):
            name = database.get_message_by_frame_id(frame.arbitration_id).name
            values = database.decode_message(name, frame.data, decode_choices=False, scaling=False)
            if name == "ThrustCommandRT":
                first = values
            elif name == "ThrustCommandN" and first is not None:
                axes = (first["AccelerationR"], first["AccelerationT"], values["AccelerationN"])
                commands.append((*axes, values["Mode"]))
    return commands


@pytest.mark.slow
def test_a_reprocessing_that_loses_its_runner_ends_in_order(fly):
    recorded = fly("run", SOFTWARE, "--duration", 600)
    assert recorded.process.wait(LIMIT) == 0
    run = fly("reprocess", recorded.folder, "--system", "control_only", "--distributed")
    wait_until(lambda: (run.folder / "logs" / "bag_recorder.log").exists())
    children = psutil.Process(run.process.pid).children(recursive=True)
    run.process.kill()
    wait_until(lambda: not alive(children))
    assert "Traceback" not in run.logs() + run.output()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        pytest.param(("view", "bags/sample", "--no-open"), "http://", id="view"),
        pytest.param(("replay", "bags/sample", "--rate", 0.1), "topics,", id="replay"),
        pytest.param(("study", "radial_offset", "--offset", 100), "", id="study"),
    ],
)
def test_a_command_that_is_killed_leaves_nothing_running(arguments, text, tmp_path):
    """A viewer and a player are one process; a study flies as a campaign does."""
    folder = ("--out", tmp_path / "study") if arguments[0] == "study" else ()
    log = tmp_path / "log"
    with domain_id() as domain, log.open("w") as stream:
        process = subprocess.Popen(
            [sys.executable, "-m", "vtff_bringup.cli", *map(str, (*arguments, *folder))],
            cwd=ROOT,
            stdin=subprocess.DEVNULL,
            stdout=stream,
            stderr=subprocess.STDOUT,
            env={**os.environ, "PYTHONUNBUFFERED": "1", "ROS_DOMAIN_ID": str(domain)},
        )
        below = []
        try:
            command = psutil.Process(process.pid)
            if arguments[0] == "study":  # until the processes of the flight itself are there
                wait_until(lambda: len(command.children(recursive=True)) > 5)
            wait_until(lambda: text in log.read_text())
            assert process.poll() is None, log.read_text()
            below = command.children(recursive=True)
            assert bool(below) == (arguments[0] == "study")
        finally:
            process.kill()
            process.wait()
        wait_until(lambda: not alive(below))
    assert "Traceback" not in log.read_text()


def find_child(children, name):
    return next(child for child in children if any(name in part for part in child.cmdline()))


def test_a_run_that_is_too_late_stops_with_exit_code_1(fly):
    run = fly("run", SOFTWARE, "--realtime", "--duration", 60, "--max-lag", 1)
    children = run.wait_until_flying()
    bridge = find_child(children, "simgen_bridge")
    bridge.suspend()
    time.sleep(3.5)
    bridge.resume()
    assert run.process.wait(LIMIT) == 1
    assert_ended_in_order(run, children)
    late = [line for line in run.output().splitlines() if "s late, more than max_lag" in line]
    assert len(late) == 1
    assert "steps began late, the worst by" in run.output()


@pytest.mark.slow
def test_a_late_run_without_a_limit_goes_on_and_says_so(fly):
    run = fly("run", SOFTWARE, "--realtime", "--duration", 15, "--max-lag", 0)
    bridge = find_child(run.wait_until_flying(), "simgen_bridge")
    bridge.suspend()
    time.sleep(4.0)
    bridge.resume()
    assert run.process.wait(LIMIT) == 0
    begun = [line for line in run.output().splitlines() if "[WARN]" in line and "s late" in line]
    assert begun
    assert "steps began late, the worst by" in run.output()
    reports = [item.message for item in BagReader(run.folder).messages("/diagnostics")]
    levels = [
        status.level for report in reports for status in report.status if "late" in status.message
    ]
    assert b"\x01" in levels


@pytest.mark.slow
def test_a_controller_that_stands_still_is_said(fly):
    run = fly("run", SOFTWARE, "--realtime", "--duration", 15, "--max-lag", 0)
    controller = find_child(run.wait_until_flying(), "sdre_controller")
    controller.suspend()
    time.sleep(6.0)
    controller.resume()
    assert run.process.wait(LIMIT) == 0
    assert "no new thrust of deputy: none is applied" in run.output()


@pytest.fixture
def small_disk(tmp_path):
    """A disk of 14 MB, of which the recorder reserves 8; only root may mount one."""
    place = tmp_path / "small"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=14m", "tmpfs", str(place)], capture_output=True
    )
    if mounted.returncode:
        pytest.skip("no disk can be mounted here")
    yield place
    subprocess.run(["umount", "--lazy", str(place)], check=True)


@pytest.mark.slow
def test_a_full_disk_is_the_last_line(small_disk, tmp_path):
    run = Run(small_disk / "run", tmp_path / "run.log", "run", SYSTEMS / "reference.yaml")
    assert run.process.wait(LIMIT) == 1
    last = run.output().splitlines()[-1]
    assert last.startswith("the disk is full: ") and "No space left on device" in last
    assert "Traceback" not in run.output()
