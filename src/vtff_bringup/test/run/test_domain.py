"""The DDS domain of a run: reserved, looked at, never shared by accident."""

from __future__ import annotations

import contextlib
import os
import pathlib
import socket
import subprocess
import sys

import pytest

from vtff_bringup.run import domain as domains
from vtff_bringup.run.domain import DomainOccupiedError, has_participants, reserve_domain

LIMIT = 60.0  # s after which a test gives up

PARTICIPANT = """
import sys, time
import rclpy
from rosgraph_msgs.msg import Clock
rclpy.init()
node = rclpy.create_node(sys.argv[1])
if sys.argv[2] == "clock":
    node.create_publisher(Clock, "/clock", 10)
print("ready", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def coordinated():
    """Ports that keep runs which choose by themselves, of other tests too, out of `free_domain`."""
    with contextlib.ExitStack() as coordinated:
        yield coordinated


@pytest.fixture
def free_domain(coordinated):
    """A domain without programs that no run has reserved, so that a run can choose it."""
    domain_coordinator = pytest.importorskip("domain_coordinator", reason="ROS 2 is not installed")
    while True:
        domain = coordinated.enter_context(domain_coordinator.domain_id())
        if not has_participants(domain):
            return domain


@pytest.fixture
def participant(free_domain):
    """A function that starts a node in the free domain."""
    pytest.importorskip("rclpy", reason="ROS 2 is not installed")
    started = []

    def start(name, role):
        process = subprocess.Popen(
            [sys.executable, "-c", PARTICIPANT, name, role],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment(free_domain),
        )
        started.append(process)
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"

    yield start
    for process in started:
        process.kill()
        process.communicate()


def environment(domain):
    return {
        **os.environ,
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }


def test_runs_that_choose_by_themselves_get_different_domains():
    with reserve_domain({}, []) as first, reserve_domain({}, []) as second:
        assert first != second


def test_a_chosen_domain_is_taken_once_and_free_again_afterwards(free_domain):
    chosen = {"ROS_DOMAIN_ID": str(free_domain)}
    with reserve_domain(chosen, []) as domain:
        assert domain == free_domain
        with (
            pytest.raises(DomainOccupiedError, match=f"ROS_DOMAIN_ID {free_domain}; set another"),
            reserve_domain(chosen, []),
        ):
            pass
    with reserve_domain(chosen, []) as domain:
        assert domain == free_domain


def test_a_run_by_itself_leaves_out_a_chosen_domain(free_domain, coordinated, monkeypatch):
    monkeypatch.setattr(domains, "FREE_DOMAINS", range(free_domain, free_domain + 1))
    with reserve_domain({"ROS_DOMAIN_ID": str(free_domain)}, []):
        coordinated.close()
        with pytest.raises(DomainOccupiedError, match="is occupied"), reserve_domain({}, []):
            pass


@pytest.mark.parametrize("text", ["-1", "233", "x", "1.5"])
def test_a_domain_that_is_none_is_refused(text):
    with (
        pytest.raises(DomainOccupiedError, match="must be 0 to 232"),
        reserve_domain({"ROS_DOMAIN_ID": text}, []),
    ):
        pass


def test_an_error_in_a_run_passes_through():
    """domain_coordinator turns an OSError of its user into another error."""
    with pytest.raises(OSError, match="disk full"), reserve_domain({}, []):
        raise OSError("disk full")


def test_ports_tell_whether_a_domain_is_in_use(free_domain):
    assert not has_participants(free_domain)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound:
        bound.bind(("127.0.0.1", 7400 + 250 * free_domain + 11))
        assert has_participants(free_domain)


def test_a_domain_with_a_graph_is_not_taken_by_itself(
    free_domain, participant, coordinated, monkeypatch
):
    participant("lonely", "listener")
    coordinated.close()
    monkeypatch.setattr(domains, "FREE_DOMAINS", range(free_domain, free_domain + 1))
    with pytest.raises(DomainOccupiedError, match="is occupied"), reserve_domain({}, []):
        pass


@pytest.mark.parametrize(
    ("name", "role", "expected"),
    [
        ("other_simulator", "clock", "/other_simulator publishes /clock there"),
        ("thruster", "listener", "a node /thruster is there already"),
        ("viewer", "listener", ""),
    ],
)
def test_who_is_in_a_chosen_domain_decides(free_domain, participant, name, role, expected):
    participant(name, role)
    assert has_participants(free_domain)
    reserved = reserve_domain(environment(free_domain), ["/thruster"])
    if not expected:
        with reserved as domain:
            assert domain == free_domain
        return
    with pytest.raises(DomainOccupiedError, match=expected), reserved:
        pass


def test_the_command_refuses_an_occupied_domain_with_one_line(free_domain, tmp_path):
    pytest.importorskip("rclpy", reason="ROS 2 is not installed")
    out = tmp_path / "run"
    with reserve_domain({"ROS_DOMAIN_ID": str(free_domain)}, []):
        result = subprocess.run(
            [sys.executable, "-m", "vtff_bringup.cli", "run", "reference_software", "--out", out],
            cwd=pathlib.Path(__file__).resolve().parents[4],
            env={**environment(free_domain), "COLUMNS": "200"},
            capture_output=True,
            text=True,
            timeout=LIMIT,
        )
    assert result.returncode == 2
    error = [line for line in result.stdout.splitlines() if line.startswith("error: ")]
    assert len(error) == 1 and f"ROS_DOMAIN_ID {free_domain}" in error[0]
    assert not out.exists()
