"""One graph on several hosts: network namespaces, whose links lose, delay and can be cut.

The parts of a run are tested without nodes in src/vtff_bringup/test/hosts.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import psutil
import pytest
from graph_support import (
    RECEIVER_FLIGHT,
    RECEIVER_FLIGHT_DURATION,
    ROOT,
    SYSTEMS,
    assert_equal_messages,
    run_vtff,
    topics,
)
from network_hosts import NetworkHosts, why_no_hosts

from vtff_bag.file.reader import BagReader
from vtff_bringup.run.runner import check_counts

SYSTEM = SYSTEMS / "reference_hosts.yaml"
HOSTS = ("chief", "deputy", "simulator")
LIMIT = 240.0  # s after which a test gives up
LOSSY = {"loss": 0.01, "delay": 0.005, "jitter": 0.002}

needs_hosts = pytest.mark.usefixtures("possible_hosts")


@pytest.fixture(scope="module")
def possible_hosts():
    """Skip, with the reason, where no hosts can be made."""
    reason = why_no_hosts()
    if reason:
        pytest.skip(reason)


class Part:
    """`vtff run --host` on one host, with what it printed."""

    def __init__(self, network, number, folder, host, arguments, first_host=0):
        self.folder = folder
        self.lines = []
        addresses = [
            f"{name}_address:={network.address(first_host + index)}"
            for index, name in enumerate(HOSTS)
            if first_host + index < network.count
        ]
        command = [sys.executable, "-m", "vtff_bringup.cli", "run", SYSTEM, *addresses]
        self.process = network.popen(
            number,
            [*command, *arguments, "--host", host, "--out", folder],
            cwd=ROOT,
            env={**os.environ, "COLUMNS": "200", "OPENBLAS_NUM_THREADS": "1"},
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self.process.stdout:
            self.lines.append(line.rstrip("\n"))

    @property
    def output(self):
        return "\n".join(self.lines)

    def wait(self, limit=LIMIT):
        """Return the exit code."""
        try:
            code = self.process.wait(limit)
        except subprocess.TimeoutExpired:
            pytest.fail(f"still runs after {limit:g} s:\n{self.output}")
        self._reader.join(10.0)
        return code

    def wait_for(self, words, limit=60.0):
        """Wait until a line has come."""
        deadline = time.monotonic() + limit
        while words not in self.output and time.monotonic() < deadline:
            if self.process.poll() is not None:
                self._reader.join(10.0)
                break
            time.sleep(0.05)
        assert words in self.output, self.output

    def logs(self):
        return "".join(path.read_text() for path in (self.folder / "logs").glob("*.log"))


def start_parts(network, folder, *options, placed=(), hosts=HOSTS[:2], first_host=0):
    """Start all parts of a run; the options go to the main part, the placement to all."""
    parts = []
    for index, host in enumerate(hosts):
        arguments = [*placed, *(options if index == 0 else ())]
        number = first_host + index
        part = Part(network, number, folder / host, host, arguments, first_host)
        parts.append(part)
    return parts


def complete(parts, bag_of):
    """Wait for a run that ends in order; return the folder with the bag."""
    codes = [part.wait() for part in parts]
    assert codes == [0] * len(parts), "\n\n".join(part.output for part in parts)
    for part in parts:
        assert "Traceback" not in part.output + part.logs()
        if part is not bag_of:
            assert f"run: {bag_of.folder} on host '" in part.output, part.output
            assert "messages, complete" in part.output
            assert not (part.folder / "bag").exists()
    assert_complete(bag_of.folder)
    return bag_of.folder


def assert_complete(folder):
    """The bag holds exactly what the nodes of all hosts published."""
    counted = {path.stem for path in (folder / "nodes").glob("*.json")}
    assert counted == {path.stem for path in (folder / "parameters").glob("*.yaml")}
    recorded = {name: topic.message_count for name, topic in BagReader(folder).topics.items()}
    assert recorded["/clock"] > 1
    assert check_counts(folder, recorded) == []


def messages(folder, topic):
    return [item.message for item in BagReader(folder).messages(topic)]


def seconds(message):
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def thrust(folder, topic="/deputy/propulsion/thrust_applied"):
    """Return time and size of each thrust."""
    rows = [
        (seconds(m), np.linalg.norm([m.accel.linear.x, m.accel.linear.y, m.accel.linear.z]))
        for m in messages(folder, topic)
    ]
    return np.array(rows)


@needs_hosts
def test_two_hosts_in_lockstep_give_the_same_bytes_as_one(runs, tmp_path):
    """The flight of test_graph_receivers.py, with TCP in place of serial ports."""
    one = runs.make("receivers_2", "reference.yaml", *RECEIVER_FLIGHT, "--composed")[0]
    with NetworkHosts(2) as network:
        parts = start_parts(
            network, tmp_path, *RECEIVER_FLIGHT, "--composed", "--no-report",
            placed=["recorder_host:=deputy"],
        )  # fmt: skip
        folder = complete(parts, bag_of=parts[1])
    names = topics(one)
    assert names == topics(folder)
    assert {"/chief/gnss/raw", "/deputy/gnss/high_rate", "/deputy/relative_state"} <= names
    assert assert_equal_messages(one, folder, names) > 100 * RECEIVER_FLIGHT_DURATION


@needs_hosts
@pytest.mark.slow
@pytest.mark.parametrize("quality", [{}, LOSSY], ids=["clean", "lossy"])
def test_three_hosts_in_lockstep_give_the_same_bytes_as_one(runs, tmp_path, quality):
    """Every node is a process, and the recorder is far from all of them."""
    one = runs.make("hosts_none_long", "reference.yaml", "--duration", 120, "--no-report")[0]
    with NetworkHosts(3, **quality) as network:
        parts = start_parts(
            network, tmp_path, "--duration", 120, "--distributed", "--no-report",
            placed=["simulator_host:=simulator", "recorder_host:=simulator"], hosts=HOSTS,
        )  # fmt: skip
        folder = complete(parts, bag_of=parts[2])
    names = topics(one)
    assert names == topics(folder)
    assert assert_equal_messages(one, folder, names) > 50 * 120


def assert_sockets_of_the_run_only(network, number):
    """DDS has no socket on another address than that of the host, and is in no multicast group."""
    script = "cat /proc/net/udp; echo; cat /proc/net/igmp; echo; cat /proc/net/udp6"
    output = network.popen(number, ["sh", "-c", script]).communicate(timeout=20.0)[0]
    udp, igmp, udp6 = output.split("\n\n")
    own = bytes(int(part) for part in network.address(number).split("."))
    bound = {line.split()[1].partition(":")[0] for line in udp.splitlines()[1:]}
    addresses = {bytes.fromhex(text)[::-1] for text in bound}
    # The bus of the emulated thruster is a group on the loopback interface.
    assert {address for address in addresses if address[0] not in (127, 239)} == {own}
    groups = {line.split()[0] for line in igmp.splitlines() if line.startswith("\t\t\t\t")}
    assert bytes([239, 255, 0, 1])[::-1].hex().upper() not in groups  # that of DDS
    assert len(udp6.strip().splitlines()) == 1


@needs_hosts
def test_a_cut_link_in_real_time_is_named_safe_and_survived(tmp_path):
    """The short form of the tests below: 5 s without the deputy, with loss and delay."""
    with NetworkHosts(2, **LOSSY, cuts=True) as network:
        parts = start_parts(
            network, tmp_path, "--composed", "--realtime", "--duration", 20, "--no-report"
        )
        parts[0].wait_for("deputy in-track")
        assert_sockets_of_the_run_only(network, 0)
        assert_sockets_of_the_run_only(network, 1)
        network.cut(1)
        time.sleep(5.0)
        network.join(1)
        folder = complete(parts, bag_of=parts[0])
    assert_cut_was_survived(parts, folder, least=2, most=9)


def assert_cut_was_survived(parts, folder, least, most):
    """Silence is named, no thrust is flown on old commands, and control goes on afterwards."""
    for part, other in zip(parts, ("deputy", "chief"), strict=False):
        silent = [line for line in part.lines if f"host '{other}'" in line and "silent" in line]
        heard = [line for line in part.lines if f"host '{other}'" in line and "heard again" in line]
        assert len(silent) == len(heard) == 1, part.output
    assert "no new thrust of deputy: none is applied" in parts[0].logs()
    status = messages(folder, "/sim/status")
    late = [message.late_commands for message in status]
    assert least <= late[-1] <= most + 6
    gone = [seconds(m) for m, n, p in zip(status[1:], late[1:], late, strict=False) if n > p]
    times, sizes = thrust(folder, "/deputy/control/thrust_command").T
    answered = thrust(folder)
    # Commands that the link held back come when their time is over.
    cut = (answered[:, 0] > gone[0] + 0.5) & (answered[:, 0] < gone[-1] - 1.0)
    assert not np.any(answered[cut, 1] > 0.0), answered[cut]
    assert "taken over" not in parts[0].logs()
    after = answered[answered[:, 0] > gone[-1] + 3.0]
    assert len(after) > 3 and np.all(after[-4:-1, 1] > 0.0)  # the last one ends the run
    assert times[-1] > gone[-1] and sizes[-1] > 0.0


@needs_hosts
@pytest.mark.slow
@pytest.mark.parametrize("cut_host", [1, 2], ids=["deputy", "simulator"])
def test_a_link_cut_for_ten_seconds_is_survived(tmp_path, cut_host):
    with NetworkHosts(3, **LOSSY, cuts=True) as network:
        parts = start_parts(
            network, tmp_path, "--realtime", "--duration", 70, "--no-report",
            placed=["simulator_host:=simulator"], hosts=HOSTS,
        )  # fmt: skip
        parts[0].wait_for("deputy in-track")
        time.sleep(10.0)
        network.cut(cut_host)
        time.sleep(10.0)
        network.join(cut_host)
        folder = complete(parts, bag_of=parts[0])
    if cut_host == 1:
        assert_cut_was_survived(parts[:2], folder, least=6, most=14)
    assert f"host '{HOSTS[cut_host]}' ({network.address(cut_host)}) is silent" in parts[0].output
    states = {seconds(m): m.position for m in messages(folder, "/deputy/relative_state")}
    truths = {seconds(m): m.position for m in messages(folder, "/deputy/relative_state_truth")}
    last = max(states.keys() & truths.keys())
    assert max(truths) - last <= 2.0
    assert np.linalg.norm(np.subtract(states[last], truths[last])) < 1.0


@needs_hosts
@pytest.mark.slow
def test_a_link_cut_in_lockstep_makes_time_stand_still(tmp_path):
    with NetworkHosts(2, **LOSSY, cuts=True) as network:
        parts = start_parts(network, tmp_path, "--composed", "--duration", 200, "--no-report")
        parts[0].wait_for("deputy in-track")
        network.cut(1)
        time.sleep(10.0)
        network.join(1)
        complete(parts, bag_of=parts[0])
    assert "host 'deputy' (10.24.0.2) is heard again" in parts[0].output


@needs_hosts
@pytest.mark.slow
@pytest.mark.parametrize("how", ["killed", "unreachable"])
@pytest.mark.parametrize("lost", [0, 1], ids=["chief", "deputy"])
def test_a_lost_host_ends_the_run_in_order(tmp_path, how, lost):
    """The part that is left names the lost one, commands no thrust, and keeps the bag."""
    left = 1 - lost
    with NetworkHosts(2, cuts=True) as network:
        parts = start_parts(
            network, tmp_path, "--realtime", "--duration", 300, "--no-report",
            placed=[f"recorder_host:={HOSTS[left]}"],
        )  # fmt: skip
        parts[0].wait_for("deputy in-track")
        children = psutil.Process(parts[left].process.pid).children(recursive=True)
        if how == "killed":
            for process in psutil.Process(parts[lost].process.pid).children(recursive=True):
                process.kill()
            parts[lost].process.send_signal(signal.SIGKILL)
        else:
            network.cut(lost)
        began = time.monotonic()
        assert parts[left].wait(60.0) == 1
        assert time.monotonic() - began < 45.0
    name = f"host '{HOSTS[lost]}' ({network.address(lost)}) is lost"
    assert name in parts[left].output, parts[left].output
    assert "Traceback" not in parts[left].output + parts[left].logs()
    assert not [process for process in children if process.is_running()]
    times = [seconds(message) for message in messages(parts[left].folder, "/sim/status")]
    assert len(times) > 3
    if lost == 0:  # the thruster is here: it has ended in order, which switches it off
        record = json.loads((parts[left].folder / "nodes/deputy__thruster.json").read_text())
        assert record["exit_code"] == 0
        if how == "unreachable":  # and it has been without a command for long before
            assert thrust(parts[left].folder)[-1, 1] == 0.0


@needs_hosts
@pytest.mark.slow
def test_ten_minutes_in_real_time_over_a_bad_link(tmp_path):
    with NetworkHosts(2, **LOSSY) as network:
        parts = start_parts(network, tmp_path, "--realtime", "--duration", 600, "--no-report")
        for part in parts:
            part.wait(720.0)
        folder = complete(parts, bag_of=parts[0])
    truth = messages(folder, "/deputy/relative_state_truth")
    assert len(truth) == 601
    in_track = np.array([message.position[1] for message in truth[-60:]])
    np.testing.assert_allclose(in_track, 100.0, atol=1.0)
    assert messages(folder, "/sim/status")[-1].late_commands <= 30


@needs_hosts
@pytest.mark.slow
def test_two_graphs_on_one_network_do_not_meet(tmp_path):
    """Four hosts and two runs, which by themselves take the same domain."""
    with NetworkHosts(4) as network:
        both = []
        for number, seed in ((0, 1), (2, 2)):
            (tmp_path / str(number)).mkdir()
            parts = start_parts(
                network, tmp_path / str(number), "--composed", "--realtime", "--duration", 20,
                "--seed", seed, "--no-report", first_host=number,
            )  # fmt: skip
            both.append(parts)
        folders = [complete(parts, bag_of=parts[0]) for parts in both]
    domains = {re.search(r"ROS_DOMAIN_ID (\d+)", parts[0].output).group(1) for parts in both}
    assert len(domains) == 1
    for folder in folders:
        assert len(messages(folder, "/clock")) == 21


@needs_hosts
@pytest.mark.slow
def test_a_full_disk_on_the_recording_host_ends_the_run_as_here(tmp_path):
    with NetworkHosts(2) as network:
        small = tmp_path / "deputy"
        small.mkdir()
        mount = ["mount", "-t", "tmpfs", "-o", "size=14m", "tmpfs", small]
        mounted = network.popen(1, mount)
        output = mounted.communicate(timeout=20.0)[0]
        if mounted.returncode:
            pytest.skip(f"no disk can be mounted here: {output}")
        parts = start_parts(
            network, tmp_path, "--composed", "--no-report", "receiver_driver.publish_raw:=true",
            placed=["recorder_host:=deputy"],
        )  # fmt: skip
        main, recorder = (part.wait() for part in parts)
    assert (main, recorder) == (1, 1), parts[1].output
    assert parts[1].lines[-1].startswith("the disk is full: "), parts[1].output
    assert "host 'deputy' (10.24.0.2): bag_recorder has no room on the disk" in parts[0].output
    assert "Traceback" not in parts[0].output + parts[1].output
    said = next(line for line in parts[0].lines if line.startswith("run: "))
    assert "on host 'deputy'" in said and "exit code 1 there" in said
    assert int(re.search(r"(\d+) messages", said).group(1)) > 100


def test_a_system_of_several_hosts_names_its_parts():
    """Before anything is made; the parts are those of src/vtff_bringup/test/hosts."""
    result = run_vtff(
        "run", SYSTEM, "chief_address:=192.0.2.1", "deputy_address:=192.0.2.2", "--composed"
    )
    assert result.returncode == 2
    assert result.stdout == (
        "error: reference_hosts.yaml runs on 2 hosts; start one part on each: "
        "--host chief (192.0.2.1), --host deputy (192.0.2.2); the first leads the run\n"
    )


def test_a_part_on_the_wrong_machine_is_refused(tmp_path):
    result = run_vtff(
        "run", SYSTEM, "chief_address:=203.0.113.1", "deputy_address:=203.0.113.2",
        "--host", "deputy", "--out", tmp_path / "run",
    )  # fmt: skip
    assert result.returncode == 2
    assert result.stdout.startswith("error: host 'deputy' (203.0.113.2): ")
    assert "no interface of this machine has that address" in result.stdout
    assert result.stdout.count("\n") == 1
    assert not (tmp_path / "run").exists()
