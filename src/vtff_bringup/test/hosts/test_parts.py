"""Parts of a run meet, agree, are refused, lose each other and end together, without nodes.

The hosts are addresses of the loopback interface, and each part is a thread of this process.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import pathlib
import socket
import threading
import time

import pytest

from vtff_bringup.hosts import joining_part, main_part, silence
from vtff_bringup.hosts.joining_part import JoiningPart
from vtff_bringup.hosts.main_part import MainPart
from vtff_bringup.hosts.run_order import RunOrder
from vtff_bringup.run.domain import DomainOccupiedError
from vtff_bringup.run.host_session import Conclusion, HostError, RunEnd
from vtff_bringup.system.description import (
    HostDescription,
    NodeDescription,
    SystemDescription,
)
from vtff_bringup.system.errors import SystemFileError
from vtff_node.process.lifeline import Stage

LIMIT = 30.0  # s after which a test gives up
VERSION = "0.1.0 (sources 123456789abc)"
ORDER = RunOrder(overrides=("deputy_address:=127.0.0.2",), duration=30.0, seed=7)


def node(name, host, *, ends_run=False, own_process=False):
    return NodeDescription(
        package="vtff_test", executable=name, name=name, namespace="/", parameters={},
        parameter_files=(), remaps={}, lockstep="", prepares=False, ends_run=ends_run,
        own_process=own_process, host=host,
    )  # fmt: skip


def _free_port() -> int:
    """Return a port below those that the kernel gives to other sockets, free for TCP and UDP."""
    for port in range(20_000 + os.getpid() % 10_000, 32_000):
        with contextlib.suppress(OSError), socket.socket() as stream:
            stream.bind(("127.0.0.1", port))
            with socket.socket(type=socket.SOCK_DGRAM) as datagrams:
                datagrams.bind(("127.0.0.1", port))
                return port
    raise OSError("no free port from 20000 to 32000")


@pytest.fixture
def system(monkeypatch):
    """A system of three hosts with a control port of its own; domains are not reserved."""
    port = _free_port()

    @contextlib.contextmanager
    def reserve(environment, nodes):
        yield int(environment.get("ROS_DOMAIN_ID") or 5)

    for module in (main_part, joining_part):
        monkeypatch.setattr(module, "reserve_domain", reserve)
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    monkeypatch.setattr(main_part, "WAITING_INTERVAL", 0.2)
    monkeypatch.setattr(joining_part, "WAITING_INTERVAL", 0.2)
    return SystemDescription(
        path=pathlib.Path("test_hosts.yaml"),
        description="",
        arguments={},
        processes=(),
        nodes=(
            node("bridge", "chief", ends_run=True),
            node("driver", "deputy"),
            node("recorder", "disk", own_process=True),
        ),
        hosts=(
            HostDescription("chief", "127.0.0.1"),
            HostDescription("deputy", "127.0.0.2"),
            HostDescription("disk", "127.0.0.3"),
        ),
        control_port=port,
        free_ports={"free_port": 0},
    )


class Network:
    """Parts of one run, each with the lines that it said."""

    def __init__(self, system):
        self.system = system
        self.parts = []
        self.lines = {}

    def main(self, order=ORDER, load=None):
        lines = self.lines.setdefault("chief", [])
        main = MainPart(
            self.system, order, VERSION, {"node /driver": "a"}, load or (lambda _: self.system),
            lines.append,
        )  # fmt: skip
        self.parts.append(main)
        return main

    def join(self, host, *, given=ORDER, version=VERSION, digest="a", load=None):
        """Return a part that has joined, or raise what it raised."""
        lines = self.lines.setdefault(host, [])

        def load_here(order, ports):
            return self.system, {"node /driver": digest}

        part = JoiningPart(self.system, host, given, version, load or load_here, lines.append)
        self.parts.append(part)
        part.join()
        return part

    def close(self):
        for part in self.parts:
            part.close()


@pytest.fixture
def network(system):
    network = Network(system)
    yield network
    network.close()


def start(function, *arguments, **named):
    """Run a function in a thread; return the thread, with `result` when it has ended."""

    def run():
        try:
            thread.result = function(*arguments, **named)
        except Exception as error:
            thread.result = error

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    return thread


def wait_until(condition):
    deadline = time.monotonic() + LIMIT
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert condition()


def end_of(thread):
    thread.join(LIMIT)
    assert not thread.is_alive()
    return thread.result


def refusal(network, host, **named):
    """Return the text with which a part is refused."""
    error = end_of(start(network.join, host, **named))
    assert isinstance(error, HostError)
    return str(error)


def said(network, host, words):
    return any(words in line for line in network.lines.get(host, []))


@pytest.fixture
def flying(network):
    """The main part and the two others, after the start of the run."""
    main = network.main()
    threads = {host: start(network.join, host) for host in ("deputy", "disk")}
    main.gather()
    return main, end_of(threads["deputy"]), end_of(threads["disk"])


def test_parts_agree_on_order_domain_and_clocks(flying, network):
    main, deputy, disk = flying
    assert deputy.order == disk.order == ORDER
    assert main.domain == deputy.domain == disk.domain == 5
    assert set(main.clock_offsets) == {"deputy", "disk"}
    assert abs(deputy.clock_offsets["chief"]) < 1.0
    assert said(network, "chief", "clock of 'deputy': ")
    assert main.is_main and disk.records and not deputy.is_main and not main.records


def test_a_part_that_comes_first_says_for_whom_it_waits(network):
    early = start(network.join, "deputy")
    wait_until(lambda: said(network, "deputy", "waiting for host 'chief' (127.0.0.1), port"))
    main = network.main()
    gathering = start(main.gather)
    wait_until(lambda: said(network, "chief", "waiting for host 'disk' (127.0.0.3); start there"))
    wait_until(lambda: said(network, "deputy", "waiting for the other hosts"))
    late = start(network.join, "disk")
    for thread in (early, late, gathering):
        assert not isinstance(end_of(thread), Exception)


def test_a_part_that_leaves_before_the_start_may_come_again(network):
    main = network.main()
    gathering = start(main.gather)
    first = start(network.join, "deputy")
    wait_until(lambda: said(network, "chief", "'deputy' (127.0.0.2) takes part"))
    network.parts[-1].close()
    end_of(first)
    wait_until(lambda: said(network, "chief", "'deputy' (127.0.0.2) has left"))
    again = [start(network.join, host) for host in ("deputy", "disk")]
    for thread in (*again, gathering):
        assert not isinstance(end_of(thread), Exception)


@pytest.mark.parametrize("pacing", ["lockstep", "realtime"])
@pytest.mark.parametrize("composed", [None, True, False])
def test_nodes_share_a_process_in_lockstep_unless_told_otherwise(pacing, composed):
    order = RunOrder(pacing=pacing, composed=composed)
    assert RunOrder.from_message(order.as_message()) == order
    assert order.shares_process is (composed if composed is not None else pacing == "lockstep")


@pytest.mark.parametrize(
    ("named", "reason"),
    [
        ({"version": "0.2.0 (sources 0)"}, "it has vtff 0.2.0 (sources 0), the main host 0.1.0"),
        ({"digest": "b"}, "its system file differs: node /driver"),
        ({"given": RunOrder(seed=8)}, "seed is 8 there and 7 here"),
        ({"given": RunOrder(overrides=("x:=1",))}, "x is 1 there and is not given here"),
        (
            {"given": RunOrder(overrides=("deputy_address:=127.0.0.9",))},
            "deputy_address is 127.0.0.9 there and 127.0.0.2 here",
        ),
        ({"given": RunOrder(pacing="realtime")}, "pacing is realtime there and lockstep here"),
    ],
    ids=["version", "system file", "seed", "argument", "address", "pacing"],
)
def test_a_part_that_does_not_fit_is_refused_in_one_line(network, named, reason):
    main = network.main()
    start(main.gather)
    text = refusal(network, "deputy", **named)
    assert text.startswith("host 'chief' (127.0.0.1) refuses this part: ") and "\n" not in text
    assert reason in text
    wait_until(lambda: said(network, "chief", f"refused host 'deputy' (127.0.0.2): {reason}"))


def test_a_part_whose_system_cannot_be_loaded_says_why(network):
    start(network.main().gather)

    def load(order, ports):
        raise SystemFileError("argument 'scenario': no file 'mine.yaml'")

    text = refusal(network, "deputy", load=load)
    assert "refuses this part: argument 'scenario': no file" in text


def test_a_part_that_is_started_twice_is_refused(network):
    start(network.main().gather)
    start(network.join, "deputy")
    wait_until(lambda: said(network, "chief", "'deputy' (127.0.0.2) takes part"))
    assert "host 'deputy' takes part already" in refusal(network, "deputy")


def test_a_part_that_comes_during_the_run_is_refused(flying, network):
    flying[1].close()
    wait_until(lambda: flying[0].poll() is not None)
    assert "the run is under way" in refusal(network, "deputy")


def test_the_main_part_started_twice_is_refused(network):
    network.main()
    with pytest.raises(HostError, match=r"host 'chief' \(127.0.0.1\) cannot listen on TCP port"):
        network.main()


def test_a_host_on_another_machine_is_refused(network, system):
    elsewhere = dataclasses.replace(
        system, hosts=(system.hosts[0], HostDescription("deputy", "192.0.2.77"))
    )
    with pytest.raises(HostError, match="no interface of this machine has that address"):
        JoiningPart(elsewhere, "deputy", ORDER, VERSION, lambda *_: None, print)


def test_a_stranger_at_the_control_port_does_no_harm(network, system):
    main = network.main()
    gathering = start(main.gather)
    address = (system.hosts[0].address, system.control_port)
    for content in (b"GET / HTTP/1.1\r\n\r\n", b"{}\n", b'{"host": "deputy"}\n', b"[1]\n", b"\xff"):
        with socket.create_connection(address) as stranger:
            stranger.sendall(content)
    joined = [start(network.join, host) for host in ("deputy", "disk")]
    for thread in (*joined, gathering):
        assert not isinstance(end_of(thread), Exception)


def test_an_occupied_domain_makes_way_for_another(network, monkeypatch):
    domains = iter(range(5, 20))

    @contextlib.contextmanager
    def reserve_here(environment, nodes):
        yield next(domains)

    @contextlib.contextmanager
    def reserve_there(environment, nodes):
        if int(environment["ROS_DOMAIN_ID"]) < 7:
            raise DomainOccupiedError("a simulator is there")
        yield int(environment["ROS_DOMAIN_ID"])

    monkeypatch.setattr(main_part, "reserve_domain", reserve_here)
    monkeypatch.setattr(joining_part, "reserve_domain", reserve_there)
    main = network.main()
    joined = [start(network.join, host) for host in ("deputy", "disk")]
    main.gather()
    assert main.domain == 7
    assert [end_of(thread).domain for thread in joined] == [7, 7]


def test_a_chosen_domain_that_is_occupied_elsewhere_is_refused(network, monkeypatch):
    @contextlib.contextmanager
    def reserve_there(environment, nodes):
        raise DomainOccupiedError("a simulator is there")
        yield

    monkeypatch.setattr(joining_part, "reserve_domain", reserve_there)
    monkeypatch.setenv("ROS_DOMAIN_ID", "9")
    main = network.main()
    for host in ("deputy", "disk"):
        start(network.join, host)
    # Both refuse it; either may be the first to say so.
    with pytest.raises(DomainOccupiedError, match=r"host '(deputy|disk)' .*: a simulator is there"):
        main.gather()


def test_stages_of_the_end_are_ordered_over_all_hosts(flying):
    """Counts of every host reach the one that records before its recorder ends."""
    main, deputy, disk = flying
    events = []

    def end(part, name):
        for stage in Stage:
            part.begin_stage(stage, RunEnd(0, ""))
            events.append((stage, name, dict(part.counts)))
            part.complete_stage(stage, {f"{name}.json": "{}"} if stage is Stage.NODES else {})

    assert deputy.poll() is None
    threads = [start(end, main, "chief")]
    wait_until(lambda: deputy.poll() is not None and disk.poll() is not None)
    assert deputy.poll() == RunEnd(0, "")
    threads += [start(end, disk, "disk"), start(end, deputy, "deputy")]
    for thread in threads:
        assert end_of(thread) is None
    stages = [stage for stage, _, _ in events]
    assert stages == sorted(stages)
    counts = next(c for stage, name, c in events if (stage, name) == (Stage.RECORDERS, "disk"))
    assert set(counts) == {"chief.json", "deputy.json", "disk.json"}


def test_the_failure_of_a_part_ends_all(flying):
    main, deputy, disk = flying
    deputy.begin_stage(Stage.NODES, RunEnd(1, "driver failed", ("last words",)))
    wait_until(lambda: main.poll() is not None)
    end = main.poll()
    assert end == RunEnd(1, "host 'deputy' (127.0.0.2): driver failed", ("last words",))
    main.begin_stage(Stage.NODES, end)
    wait_until(lambda: disk.poll() is not None)
    assert disk.poll().exit_code == 1
    assert "host 'deputy' (127.0.0.2): driver failed" in disk.poll().reason


def test_a_part_that_is_gone_is_named(flying):
    main, deputy, disk = flying
    deputy.close()
    wait_until(lambda: main.poll() is not None)
    assert main.poll().exit_code == 1
    assert "host 'deputy' (127.0.0.2) is lost: its part of the run is gone" in main.poll().reason
    main.close()
    wait_until(lambda: disk.poll() is not None)
    assert "host 'chief' (127.0.0.1) is lost" in disk.poll().reason


def test_a_silent_host_is_named_heard_again_and_lost(system, monkeypatch):
    monkeypatch.setattr(silence, "NOTICED_SILENCE", 0.3)
    monkeypatch.setattr(silence, "LARGEST_SILENCE", 3.0)
    for module in (main_part, joining_part):
        monkeypatch.setattr(module, "LARGEST_SILENCE", 3.0)
    monkeypatch.setattr(joining_part, "HEARTBEAT_INTERVAL", 0.05)
    network = Network(system)
    try:
        main = network.main()
        threads = {host: start(network.join, host) for host in ("deputy", "disk")}
        main.gather()
        deputy = end_of(threads["deputy"])
        time.sleep(0.5)
        assert not said(network, "chief", "silent")
        monkeypatch.setattr(joining_part, "HEARTBEAT_INTERVAL", 1.0)
        wait_until(lambda: said(network, "chief", "host 'deputy' (127.0.0.2) is silent"))
        assert main.poll() is None
        monkeypatch.setattr(joining_part, "HEARTBEAT_INTERVAL", 0.05)
        wait_until(lambda: said(network, "chief", "host 'deputy' (127.0.0.2) is heard again"))
        monkeypatch.setattr(joining_part, "HEARTBEAT_INTERVAL", 1000.0)
        wait_until(lambda: main.poll() is not None)
        assert "is lost: not heard for 3 s" in main.poll().reason
        wait_until(lambda: deputy.poll() is not None)
        assert "host 'chief' (127.0.0.1) is lost: not heard for 3 s" in deputy.poll().reason
    finally:
        network.close()


def test_the_recording_host_concludes_for_all(flying):
    main, deputy, disk = flying
    conclusion = Conclusion("disk", "/data/run", 1, 1234)
    threads = [start(part.conclude, None) for part in (main, deputy)]
    assert disk.conclude(conclusion) == conclusion
    assert [end_of(thread) for thread in threads] == [conclusion, conclusion]


def test_progress_of_the_main_host_reaches_the_others(flying):
    main, deputy, _ = flying
    main.progress = {"done": 3.0, "total": 30.0}
    wait_until(lambda: deputy.progress == {"done": 3.0, "total": 30.0})
