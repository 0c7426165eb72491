"""Messages when something is wrong: one clear error, an exit code, a bag that opens."""

from __future__ import annotations

import json
import os
import pathlib
import signal
import subprocess
import sys
import time

import pytest
from graph_support import ROOT, SYSTEMS, run_vtff

from vtff_bag.file.reader import BagReader
from vtff_node.plain_yaml import format_yaml, parse_yaml

SYSTEM = SYSTEMS / "reference_software.yaml"


def system_with(tmp_path, change):
    """Write a changed copy of the reference system beside the original's files."""
    content = parse_yaml(SYSTEM.read_text())
    content["arguments"]["scenario"]["default"] = str(ROOT / "config/scenario/reference.yaml")
    for node in content["nodes"]:
        node["parameter_files"] = [
            str((SYSTEMS / name).resolve()) for name in node.get("parameter_files", [])
        ]
    change(content)
    path = tmp_path / "system.yaml"
    path.write_text(format_yaml(content))
    return path


def start(tmp_path, *arguments):
    return subprocess.Popen(
        [sys.executable, "-m", "vtff_bringup.cli", "run", *map(str, arguments)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "COLUMNS": "200"},
        start_new_session=True,
    )


def process_ids(run_directory, word):
    """Return the processes whose command line names a parameter file of this run."""
    found = []
    for path in pathlib.Path("/proc").glob("[0-9]*/cmdline"):
        try:
            text = path.read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        if str(run_directory) in text and word in text:
            found.append(int(path.parent.name))
    return found


def wait_for_recording(run_directory, process):
    """Wait until the run has recorded something."""
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline and process.poll() is None:
        files = list((run_directory / "bag").glob("*.mcap"))
        if files and files[0].stat().st_size > 20_000:
            return
        time.sleep(0.05)
    pytest.fail(f"nothing was recorded: {process.communicate(timeout=30)[0]}")


def test_a_missing_participant_is_named(tmp_path):
    def demand(content):
        content["nodes"][0]["parameters"].update(
            lockstep_participants=["/deputy/observer"], start_timeout=4.0
        )

    out = tmp_path / "run"
    system = system_with(tmp_path, demand)
    result = run_vtff("run", system, "--composed", "--out", out, "--no-report")
    assert result.returncode == 1
    assert "waiting for /deputy/observer (never answered)" in result.stdout
    assert "Traceback" not in result.stdout
    assert BagReader(out).complete


def test_a_missing_node_of_the_loop_is_named(tmp_path):
    def remove_the_controller(content):
        del content["nodes"][1]
        content["nodes"][0]["parameters"].update(
            expected_nodes=["/deputy/sdre_controller", "/deputy/thruster"], start_timeout=4.0
        )

    out = tmp_path / "run"
    system = system_with(tmp_path, remove_the_controller)
    result = run_vtff("run", system, "--composed", "--out", out, "--no-report")
    assert result.returncode == 1
    assert "not in the graph: /deputy/sdre_controller\n" in result.stdout
    assert BagReader(out).complete


def test_a_node_that_dies_ends_the_run_with_its_name(tmp_path):
    out = tmp_path / "run"
    options = ("--distributed", "--no-report", "--duration", 100000)
    process = start(tmp_path, SYSTEM, "--out", out, *options)
    wait_for_recording(out, process)
    os.kill(process_ids(out, "sdre_controller.yaml")[0], signal.SIGKILL)
    printed = process.communicate(timeout=60)[0]
    assert process.returncode == 1
    assert "sdre_controller failed (signal 9)" in printed
    assert BagReader(out).complete
    assert not process_ids(out, "")


def test_interrupt_ends_cleanly_with_a_readable_bag(tmp_path):
    out = tmp_path / "run"
    process = start(tmp_path, SYSTEM, "--out", out, "--duration", 100000)
    wait_for_recording(out, process)
    process.send_signal(signal.SIGINT)
    printed = process.communicate(timeout=90)[0]
    assert process.returncode == 130, printed
    assert "interrupted" in printed
    assert "the bag does not hold" not in printed
    assert printed.index(f"run: {out}") < printed.index("report:")
    reader = BagReader(out)
    assert reader.complete
    assert reader.message_count > 100
    assert not process_ids(out, "")


def test_interrupt_while_the_nodes_start_prints_no_tracebacks(tmp_path):
    out = tmp_path / "run"
    process = start(tmp_path, SYSTEM, "--out", out, "--duration", 100000)
    deadline = time.monotonic() + 60.0
    while not list((out / "logs").glob("*.log")) and time.monotonic() < deadline:
        time.sleep(0.005)
    process.send_signal(signal.SIGINT)
    printed = process.communicate(timeout=90)[0]
    assert process.returncode == 130, printed
    logs = [path.read_text() for path in (out / "logs").glob("*.log")]
    assert logs
    for text in (printed, *logs):
        assert "Traceback" not in text and "Fatal" not in text, text
    assert not process_ids(out, "")


def test_what_a_killed_recorder_missed_is_recorded_by_another(tmp_path):
    out = tmp_path / "run"
    # The recorder has a process of its own beside those that are composed.
    options = ("--composed", "--no-report", "--duration", 100000)
    process = start(tmp_path, SYSTEM, "--out", out, *options)
    wait_for_recording(out, process)
    os.kill(process_ids(out, "bag_recorder.yaml")[0], signal.SIGKILL)
    printed = process.communicate(timeout=90)[0]
    assert process.returncode == 1
    assert "bag_recorder ended before the run did" in printed
    assert "a second recorder has taken the" in printed
    reader = BagReader(out, scan=True)
    assert reader.complete and [path.name for path in out.glob("bag*")] == ["bag"]
    published = json.loads((out / "nodes" / "simgen_bridge.json").read_text())["published"]
    assert published["/clock"] > 10
    for topic in ("/clock", "/chief/truth/orbit", "/sim/status"):
        assert reader.topics[topic].message_count == published[topic]


@pytest.mark.parametrize(
    ("argument", "expected"),
    [
        ("sdre_controller.design:=best", "parameter 'design' is 'best'; "),
        ("sdre_controller.desing:=paper", "no parameter 'desing'; did you mean: design"),
    ],
)
def test_wrong_parameters_are_named_before_anything_starts(tmp_path, argument, expected):
    result = run_vtff("run", SYSTEM, argument, "--out", tmp_path / "run", "--no-report")
    assert result.returncode == 2
    assert expected in result.stdout and len(result.stdout.splitlines()) == 1
    assert not (tmp_path / "run").exists()


def test_what_only_the_node_can_check_is_named(tmp_path):
    argument = "simgen_bridge.scenario_file:=missing.yaml"
    result = run_vtff("run", SYSTEM, argument, "--composed", "--out", tmp_path / "run")
    assert result.returncode == 2
    assert result.stdout.count("missing.yaml") == 1
    assert "failed (exit code 2); log: " in result.stdout
    assert "Traceback" not in result.stdout
    assert "real time" not in result.stdout


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["nothing.yaml"], "no system file 'nothing.yaml'"),
        ([SYSTEM, "scenario:=nothing.yaml"], "argument 'scenario': no file 'nothing.yaml'"),
        ([SYSTEM, "controller.design:=paper"], "no argument or node 'controller'"),
        ([SYSTEM, "design"], "is not of the form key:=value"),
        ([SYSTEMS / "receiver_log.yaml"], "needs 'log'"),
    ],
)
def test_wrong_arguments_are_named(tmp_path, arguments, expected):
    result = run_vtff("run", *arguments, "--out", tmp_path / "run")
    assert result.returncode == 2
    assert expected in result.stdout
    assert not (tmp_path / "run").exists()


def test_a_run_is_never_overwritten(tmp_path):
    (tmp_path / "run" / "bag").mkdir(parents=True)
    result = run_vtff("run", SYSTEM, "--out", tmp_path / "run")
    assert result.returncode == 2
    assert "already holds a run" in result.stdout
