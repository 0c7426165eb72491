"""Campaigns on a cluster of this machine: equal tables whatever happens to workers and commands."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import subprocess
import sys
import threading
import time

import psutil
import pytest
from campaign_samples import (
    ROOT,
    SMALL,
    changed,
    prepared,
    start_campaign,
    table_of,
    wait_for_cases,
    write_campaign,
)

pytest.importorskip("rclpy", reason="needs ROS 2")

from vtff_bringup.campaign.campaign import Execution  # noqa: E402
from vtff_bringup.campaign.cases import Case  # noqa: E402
from vtff_bringup.campaign.run_flight import end_flights  # noqa: E402
from vtff_bringup.campaign.worker import FAILED, HUNG, fly_cases  # noqa: E402

HOUR = changed("duration", 3600.0)


@pytest.fixture(autouse=True)
def _in_the_checkout(monkeypatch):
    monkeypatch.chdir(ROOT)


def descendants(pid=None):
    try:
        return psutil.Process(pid).children(recursive=True)
    except psutil.NoSuchProcess:
        return []


def worker_processes(pid=None):
    return [p for p in descendants(pid) if any("spawn_main" in word for word in p.cmdline())]


def test_a_killed_worker_and_the_number_of_workers_change_nothing(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    content = changed("duration", 600.0)
    alone = prepared(tmp_path / "a", content)
    assert alone.fly(Execution(workers=1)).holds
    killed = []

    def kill_a_worker(record):
        if not killed:
            killed.append(worker_processes()[0])
            killed[0].send_signal(signal.SIGKILL)

    crowd = prepared(tmp_path / "b", content)
    assert crowd.fly(Execution(workers=2, batch=2), on_record=kill_a_worker).holds
    assert killed and not killed[0].is_running()
    assert table_of(alone.folder).equals(table_of(crowd.folder))
    assert not worker_processes()
    assert not (crowd.folder / ".workers").exists()


def test_two_campaigns_at_once_and_one_that_is_interrupted_and_resumed(tmp_path):
    file = write_campaign(tmp_path, changed("samples", 6, changed("duration", 600.0)))
    one, other = tmp_path / "one", tmp_path / "other"
    interrupted = start_campaign(file, one, "--workers", 1)
    steady = start_campaign(file, other, "--workers", 1)
    wait_for_cases(one, 1, interrupted)
    # As the terminal does it: every process of the group gets the signal.
    os.killpg(interrupted.pid, signal.SIGINT)
    output = interrupted.communicate(timeout=120)[0]
    assert interrupted.returncode == 130, output
    last = output.splitlines()[-1]
    assert last.startswith("interrupted; ") and f"--out {one} --resume" in last
    assert "Traceback" not in output
    kept = (one / "cases.jsonl").read_bytes()
    assert 1 <= len(table_of(one)) == kept.count(b"\n") < 12
    refused = start_campaign(file, one)
    assert "already holds a campaign" in refused.communicate(timeout=120)[0]
    assert refused.returncode == 2
    resumed = start_campaign(file, one, "--workers", 1, "--resume")
    output = resumed.communicate(timeout=240)[0]
    assert resumed.returncode == 0, output
    assert f"{kept.count(chr(10).encode())} of 12 cases are finished already" in output
    assert (one / "cases.jsonl").read_bytes().startswith(kept)
    assert steady.wait(timeout=240) == 0, steady.communicate()[0]
    assert table_of(one).equals(table_of(other))
    assert (one / "report.html").stat().st_size > 20_000


def test_a_case_alone_is_that_of_the_campaign(tmp_path):
    file = write_campaign(tmp_path)
    flown = prepared(tmp_path)
    records = fly_cases(flown.plan, flown.cases)
    process = start_campaign(file, tmp_path / "alone", "--case", 6)
    output = process.communicate(timeout=120)[0]
    assert process.returncode == 0, output
    for name, value in {**records[5]["inputs"], **records[5]["figures"]}.items():
        assert f"{name}: {value}\n" in output
    assert not (tmp_path / "alone").exists()


def test_a_case_that_raises_is_told_and_the_next_is_flown(tmp_path):
    flown = prepared(tmp_path)
    wrong = Case(1, 1, {}, {"scenario.step": -1.0})
    first, second = fly_cases(flown.plan, [wrong, flown.cases[1]])
    assert first["status"] == FAILED
    assert first["reason"].startswith("ScenarioError: reference.yaml: step: at least")
    assert second["status"] == "complete"


def test_the_seed_of_a_case_is_that_of_its_scenario(tmp_path):
    """Noise of the thruster, which the scenario has, differs between seeds and repeats with one."""
    flown = prepared(tmp_path)
    noisy = {"scenario.spacecraft.1.thruster_errors": {"noise": 0.2}}
    cases = [Case(number, seed, {}, noisy) for number, seed in enumerate((1, 1, 2), 1)]
    records = fly_cases(flown.plan, cases)
    assert [record["status"] for record in records] == ["complete"] * 3, records
    first, again, other = (record["figures"] for record in records)
    assert first == again
    assert first != other


def test_a_worker_of_another_version_flies_nothing(tmp_path):
    flown = prepared(tmp_path)

    plan = dataclasses.replace(flown.plan, version="0.0.1")
    (record,) = fly_cases(plan, flown.cases[:1])
    assert record["status"] == FAILED and "not 0.0.1" in record["reason"]


@pytest.fixture
def run_campaign(tmp_path):
    content = changed("loop", "run", changed("vary/cap/values", [1.4]))
    return prepared(tmp_path, changed("samples", 1, content))


def test_a_run_gives_the_figures_of_the_closed_loop(run_campaign, tmp_path):
    (run,) = fly_cases(run_campaign.plan, run_campaign.cases)
    assert run["status"] == "complete", run["reason"]
    library = prepared(tmp_path, changed("vary/cap/values", [1.4], changed("samples", 1)))
    (closed_loop,) = fly_cases(library.plan, library.cases)
    assert run["inputs"] == closed_loop["inputs"]
    for name, value in closed_loop["figures"].items():
        assert run["figures"][name] == (None if value is None else pytest.approx(value, rel=1e-9))
    assert run["processor_time_s"] > 0.5
    assert not (run_campaign.folder / "runs").exists()  # kept of failed cases only


@pytest.mark.slow
def test_a_run_that_hangs_is_ended_with_all_it_started(run_campaign):

    plan = dataclasses.replace(run_campaign.plan, duration=36000.0, timeout=8.0)
    (record,) = fly_cases(plan, run_campaign.cases)
    assert record["status"] == HUNG and record["reason"] == "hung: not done after 8 s"
    kept = run_campaign.folder / record["run_folder"]
    assert (kept / "bag").is_dir() and (kept / "scenario.yaml").is_file()
    assert (kept / "vtff_run.log").is_file()
    assert not descendants()


@pytest.mark.slow
def test_a_run_that_is_stopped_hard_is_ended_with_all_it_started(run_campaign):
    """The run and its nodes do not react any more: what SIGSTOP does to them."""

    def stop_everything():
        for process in descendants():
            process.send_signal(signal.SIGSTOP)

    timer = threading.Timer(6.0, stop_everything)
    timer.start()
    plan = dataclasses.replace(run_campaign.plan, duration=36000.0, timeout=10.0)
    (record,) = fly_cases(plan, run_campaign.cases)
    timer.join()
    assert record["status"] == HUNG
    assert not descendants()


@pytest.mark.slow
def test_a_run_dies_with_its_worker(tmp_path):
    content = changed("loop", "run", changed("duration", 600.0, changed("samples", 1)))
    flown = prepared(tmp_path, content)
    killed = []

    def follow(finished, dashboard):
        def kill():
            deadline = time.monotonic() + 60.0
            while time.monotonic() < deadline:
                for worker in worker_processes():
                    children = worker.children(recursive=True)
                    if any(
                        "sdre_controller" in " ".join(p.cmdline())
                        or "composed" in " ".join(p.cmdline())
                        for p in children
                    ):
                        killed.extend(children)
                        worker.send_signal(signal.SIGKILL)
                        return
                time.sleep(0.05)

        threading.Thread(target=kill, daemon=True).start()

    result = flown.fly(Execution(workers=1), on_start=follow)
    assert result.holds and len(result.records) == 2
    assert killed
    _, alive = psutil.wait_procs(killed, timeout=60.0)
    assert not alive


@pytest.mark.slow
def test_a_case_that_ends_its_workers_is_named_and_the_others_complete(tmp_path):
    content = changed("vary", {"scenario.duration": [60.0, 360000.0]})
    content = changed("timeout", 3.0, changed("duration", None, changed("samples", None, content)))
    flown = prepared(tmp_path, content)
    result = flown.fly(Execution(workers=2))
    first, second = result.records
    assert first["status"] == "complete"
    assert second["status"] == "lost" and "ended its worker 3 times" in second["reason"]
    assert [record["case"] for record in result.failed] == [2]


@pytest.mark.slow
def test_a_killed_command_leaves_nothing_running_and_is_resumed(tmp_path):
    file = write_campaign(tmp_path, HOUR)
    process = start_campaign(file, tmp_path / "out", "--workers", 2)
    wait_for_cases(tmp_path / "out", 2, process)
    below = descendants(process.pid)
    process.kill()
    process.communicate()
    _, alive = psutil.wait_procs(below, timeout=60.0)
    assert not alive
    resumed = start_campaign(file, tmp_path / "out", "--resume")
    output = resumed.communicate(timeout=240)[0]
    assert resumed.returncode == 0, output
    assert "cases are finished already" in output


@pytest.mark.slow
def test_a_full_disk_is_one_line(tmp_path):
    """The journal may grow to a few lines only, as on a disk that is full."""
    file = write_campaign(tmp_path, SMALL)
    program = (
        "import resource, runpy, signal, sys\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (2000, -1))\n"
        "sys.argv[0] = 'vtff'\n"
        "runpy.run_module('vtff_bringup.cli', run_name='__main__')\n"
    )
    out = tmp_path / "out"
    outcome = subprocess.run(
        [sys.executable, "-c", program, "campaign", file, "--out", out, "--workers", "1"],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert outcome.returncode == 1
    last = outcome.stdout.splitlines()[-1]
    assert last.startswith("error: ") and "File too large" in last and "--resume" in last
    assert "Traceback" not in outcome.stdout + outcome.stderr
    for line in (out / "cases.jsonl").read_text().splitlines():
        json.loads(line)
    resumed = start_campaign(file, out, "--resume")
    output = resumed.communicate(timeout=240)[0]
    assert resumed.returncode == 0, output
    assert len(table_of(out)) == 8


def test_nothing_flies_when_nothing_was_started():
    assert end_flights("/no/campaign") == 0
