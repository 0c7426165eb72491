"""The link to a run of SimGEN when the simulator does not answer."""

from __future__ import annotations

import socket
import threading

import numpy as np
import pytest

from vtff_dynamics.time.timescales import GpsTime
from vtff_sim_bridge.bridge.simgen_link import SimGenLink
from vtff_sim_bridge.simremote.client import SimRemoteClient, SimRemoteError

MOTIONS = {
    "chief": np.array([[6.863e6, 0.0, 0.0], [0.0, 7.6e3, 0.0], [0.0] * 3, [0.0] * 3]),
    "deputy": np.array([[6.864e6, 0.0, 0.0], [0.0, 7.6e3, 0.0], [0.0] * 3, [0.0] * 3]),
}


class Relay:
    """A TCP relay to an emulator that can stop to forward, as a link that is cut."""

    def __init__(self, port: int) -> None:
        self._target = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.passing = threading.Event()
        self.passing.set()
        self._dropping = False
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            server = socket.create_connection(("127.0.0.1", self._target))
            for source, target in ((client, server), (server, client)):
                threading.Thread(target=self._forward, args=(source, target), daemon=True).start()

    def _forward(self, source: socket.socket, target: socket.socket) -> None:
        try:
            while content := source.recv(65536):
                self.passing.wait()
                if self._dropping:
                    self._dropping = False
                    source.close()
                    return
                target.sendall(content)
        except OSError:
            pass

    def drop(self) -> None:
        """Lose what comes next, and the connection that it comes on."""
        self._dropping = True

    def close(self) -> None:
        self.passing.set()
        self._listener.close()


@pytest.fixture
def relay(start_emulator):
    made = Relay(start_emulator(clock_mode="realtime").port)
    yield made
    made.close()


def test_in_real_time_a_cut_link_takes_a_part_of_a_step(relay, caplog):
    """The client waits as long as it was told before and after the run, and less within it."""
    client = SimRemoteClient("127.0.0.1", relay.port, timeout=30.0)
    link = SimGenLink(client, ["chief", "deputy"], None, patience_while_running=0.1)
    link.start("leo.scn", GpsTime.from_week_tow(1889, 90000.0), 600, MOTIONS)
    assert client.timeout == 0.1
    relay.passing.clear()
    link.send(1.0, MOTIONS)
    link.receive()
    assert "no reply within 0.1 s" in link.problem
    relay.passing.set()
    for second in range(2, 60):
        link.send(float(second), MOTIONS)
        link.receive()
        if not link.problem:
            break
    assert not link.problem and link.counters.reconnects >= 1
    link.stop()
    assert client.timeout == 30.0


def test_a_client_that_is_quicker_keeps_its_patience(relay):
    client = SimRemoteClient("127.0.0.1", relay.port, timeout=5.0)
    link = SimGenLink(client, ["chief", "deputy"], None, patience_while_running=20.0)
    link.start("leo.scn", GpsTime.from_week_tow(1889, 90000.0), 600, MOTIONS)
    assert client.timeout == 5.0
    link.stop()


def test_motion_of_several_steps_goes_together(start_emulator):
    """SimGEN has nothing before the packet is full, then every step, and the rest at the end."""
    machine = (emulator := start_emulator(clock_mode="lockstep")).machine
    client = SimRemoteClient("127.0.0.1", emulator.port, timeout=5.0)
    link = SimGenLink(client, ["chief", "deputy"], 5.0, steps_together=4)
    link.start("leo.scn", GpsTime.from_week_tow(1889, 90000.0), 600, MOTIONS)
    times: list[int] = []
    machine.observers.append(times.append)
    begun = client.counters.sent
    for second in (1, 2, 3):
        link.send(float(second), MOTIONS)
        link.receive()
    assert client.counters.sent == begun
    for second in range(4, 11):
        link.send(float(second), MOTIONS)
        link.receive()
    assert client.counters.sent == begun + 16
    link.complete()
    assert client.counters.replies == client.counters.sent == begun + 20
    assert times == [second * 1_000_000_000 for second in range(1, 11)]
    link.stop()


def test_steps_together_name_the_error_of_the_packet_before(start_emulator):
    emulator = start_emulator(clock_mode="lockstep")
    client = SimRemoteClient("127.0.0.1", emulator.port, timeout=5.0)
    link = SimGenLink(client, ["chief", "deputy", "third"], 5.0, steps_together=2)
    two = {name: MOTIONS[name] for name in ("chief", "deputy")}
    link.start("leo.scn", GpsTime.from_week_tow(1889, 90000.0), 600, two)
    wrong = {"chief": MOTIONS["chief"], "third": MOTIONS["deputy"]}
    for second, motions in enumerate((two, wrong, two), start=1):
        link.send(float(second), motions)
    with pytest.raises(SimRemoteError, match=r"MOT,v3_m1.*not in the scenario"):
        link.send(4.0, two)
    link.stop()


def test_steps_without_a_reply_are_sent_again(start_emulator, caplog):
    """A connection that is lost with a packet on the way loses no step."""
    relay = Relay((emulator := start_emulator(clock_mode="lockstep")).port)
    client = SimRemoteClient("127.0.0.1", relay.port, timeout=0.2)
    link = SimGenLink(client, ["chief", "deputy"], 5.0, steps_together=3)
    link.start("leo.scn", GpsTime.from_week_tow(1889, 90000.0), 600, MOTIONS)
    times: list[int] = []
    emulator.machine.observers.append(times.append)
    relay.drop()
    for second in range(1, 8):
        link.send(float(second), MOTIONS)
    link.complete()
    assert link.counters.connection_losses == 1 and not link.problem
    assert times == [second * 1_000_000_000 for second in range(1, 8)]
    link.stop()
    relay.close()


def test_a_motion_that_cannot_be_computed_has_no_step_sent_twice(start_emulator):
    machine = (emulator := start_emulator(clock_mode="lockstep")).machine
    client = SimRemoteClient("127.0.0.1", emulator.port, timeout=5.0)
    link = SimGenLink(client, ["chief", "deputy"], 5.0, steps_together=3)
    link.start("leo.scn", GpsTime.from_week_tow(1889, 90000.0), 600, MOTIONS)
    times: list[int] = []
    machine.observers.append(times.append)

    def fail() -> dict[str, np.ndarray]:
        raise ValueError("no motion")

    link.send(1.0, MOTIONS)
    link.send(2.0, MOTIONS)
    with pytest.raises(ValueError, match="no motion"):
        link.send(3.0, fail)
    for second in range(4, 8):
        link.send(float(second), MOTIONS)
    link.complete()
    assert times == [second * 1_000_000_000 for second in range(4, 8)]
    link.stop()


def test_motion_is_computed_while_simgen_works(start_emulator):
    """Steps that wait are computed before the replies to the packet before are awaited."""
    emulator = start_emulator(clock_mode="lockstep")
    client = SimRemoteClient("127.0.0.1", emulator.port, timeout=5.0)
    link = SimGenLink(client, ["chief", "deputy"], 5.0, steps_together=2)
    link.start("leo.scn", GpsTime.from_week_tow(1889, 90000.0), 600, MOTIONS)
    unanswered: list[int] = []

    def compute() -> dict[str, np.ndarray]:
        unanswered.append(client.counters.sent - client.counters.replies)
        return MOTIONS

    for second in range(1, 6):
        link.send(float(second), compute)
    link.complete()
    assert unanswered == [0, 0, 4, 4, 4]
    link.stop()
