"""The link to a run of SimGEN when the simulator does not answer."""

from __future__ import annotations

import socket
import threading

import numpy as np
import pytest

from vtff_dynamics.time.timescales import GpsTime
from vtff_sim_bridge.bridge.simgen_link import SimGenLink
from vtff_sim_bridge.simremote.client import SimRemoteClient

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
                target.sendall(content)
        except OSError:
            pass

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
