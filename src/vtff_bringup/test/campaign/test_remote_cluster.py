"""Campaigns on a Dask cluster that somebody else has started."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time

import pytest
from campaign_samples import (
    ROOT,
    changed,
    prepared,
    start_campaign,
    table_of,
    wait_for_cases,
    write_campaign,
)

pytest.importorskip("rclpy", reason="needs ROS 2")

from vtff_bringup.campaign.campaign import Execution  # noqa: E402

pytestmark = pytest.mark.slow
WORKERS = 4


@pytest.fixture(autouse=True)
def _in_the_checkout(monkeypatch):
    monkeypatch.chdir(ROOT)


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextlib.contextmanager
def processes():
    """Yield a function that starts Dask programs; all are ended."""
    started = []

    def start(program, *arguments, prefix=()):
        command = [*prefix, sys.executable, "-m", f"distributed.cli.{program}", *arguments]
        started.append(
            subprocess.Popen(
                [str(word) for word in command],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env={**os.environ, "OMP_NUM_THREADS": "1"},
            )
        )
        return started[-1]

    try:
        yield start
    finally:
        for process in reversed(started):
            process.terminate()
        for process in started:
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def scheduler_options(port):
    return "--host", "127.0.0.1", "--port", port, "--no-dashboard"


def test_a_scheduler_that_is_not_there_is_one_line(tmp_path):
    file = write_campaign(tmp_path)
    address = f"tcp://127.0.0.1:{free_port()}"
    process = start_campaign(file, tmp_path / "out", "--scheduler", address)
    output = process.communicate(timeout=120)[0]
    assert process.returncode == 1
    assert f"error: no Dask scheduler at {address}" in output.splitlines()[-1]


def test_a_scheduler_that_is_killed_is_one_line_and_the_campaign_goes_on(tmp_path):
    file = write_campaign(tmp_path, changed("duration", 3600.0))
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    out = tmp_path / "out"
    with processes() as start:
        scheduler = start("dask_scheduler", *scheduler_options(port))
        start("dask_worker", address, "--nthreads", 1, "--local-directory", tmp_path)
        process = start_campaign(file, out, "--scheduler", address)
        wait_for_cases(out, 2, process)
        scheduler.send_signal(signal.SIGKILL)
        output = process.communicate(timeout=120)[0]
    assert process.returncode == 1
    last = output.splitlines()[-1]
    assert last.startswith(f"error: the Dask scheduler {address} is lost; ") and "--resume" in last
    assert "Traceback" not in output
    resumed = start_campaign(file, out, "--resume")
    output = resumed.communicate(timeout=240)[0]
    assert resumed.returncode == 0, output
    assert len(table_of(out)) == 8


@pytest.fixture
def namespaces():
    """Names of network namespaces, one a worker, joined by a bridge to this one."""
    made, bridge = [], f"vtffbr{os.getpid() % 10000}"
    run = lambda *words: subprocess.run(["ip", *words], check=True, capture_output=True)  # noqa: E731
    try:
        try:
            run("link", "add", bridge, "type", "bridge")
            run("addr", "add", "10.213.7.1/24", "dev", bridge)
            run("link", "set", bridge, "up")
            for number in range(WORKERS):
                name = f"{bridge}n{number}"
                run("netns", "add", name)
                made.append(name)
                run(
                    "link",
                    "add",
                    f"v{bridge}{number}",
                    "type",
                    "veth",
                    "peer",
                    "eth0",
                    "netns",
                    name,
                )
                run("link", "set", f"v{bridge}{number}", "master", bridge, "up")
                inside = ("-n", name)
                run(*inside, "addr", "add", f"10.213.7.{10 + number}/24", "dev", "eth0")
                run(*inside, "link", "set", "eth0", "up")
                run(*inside, "link", "set", "lo", "up")
        except (OSError, subprocess.CalledProcessError) as error:
            detail = getattr(error, "stderr", b"") or str(error).encode()
            pytest.skip(f"network namespaces cannot be made here: {detail.decode().strip()}")
        yield made
    finally:
        for name in made:
            subprocess.run(["ip", "netns", "del", name], capture_output=True)
        subprocess.run(["ip", "link", "del", bridge], capture_output=True)


def test_four_workers_in_network_namespaces_give_the_table_of_one(tmp_path, namespaces):
    content = changed("duration", 600.0)
    (tmp_path / "alone").mkdir()
    alone = prepared(tmp_path / "alone", content)
    assert alone.fly(Execution(workers=1)).holds
    file = write_campaign(tmp_path, content)
    out, port = tmp_path / "out", free_port()
    address = f"tcp://10.213.7.1:{port}"
    with processes() as start:
        start("dask_scheduler", "--host", "10.213.7.1", "--port", port, "--no-dashboard")
        for number, name in enumerate(namespaces):
            start(
                "dask_worker",
                address,
                "--nthreads",
                1,
                "--host",
                f"10.213.7.{10 + number}",
                "--no-dashboard",
                "--local-directory",
                tmp_path,
                prefix=("ip", "netns", "exec", name),
            )
        time.sleep(5.0)  # so that all four are there for the first case
        process = start_campaign(file, out, "--scheduler", address)
        output = process.communicate(timeout=240)[0]
    assert process.returncode == 0, output
    assert table_of(alone.folder).equals(table_of(out))
