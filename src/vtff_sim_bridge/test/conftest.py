"""Fixtures of the vtff_sim_bridge tests: an emulator that serves in a thread."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator

import pytest

from vtff_sim_bridge.simgen.emulator_state import ScenarioMachine
from vtff_sim_bridge.simgen.simremote_server import SimRemoteServer

VEHICLES = ("v1_m1", "v2_m1")


class RunningEmulator:
    """An emulator on a port of 127.0.0.1, served by a thread until stopped."""

    def __init__(self, port: int = 0, accepts_udp: bool = False, **options: object) -> None:
        self.machine = ScenarioMachine(VEHICLES, **options)  # type: ignore[arg-type]
        self.server = SimRemoteServer(self.machine, port=port, accepts_udp=accepts_udp)
        self.port = self.server.port
        self._thread = threading.Thread(target=self.server.serve)
        self._thread.start()

    def stop(self) -> None:
        """Stop serving and close every socket; does nothing the second time."""
        if self._thread.is_alive():
            self.server.stop()
            self._thread.join(10.0)
            assert not self._thread.is_alive()
            self.server.close()

    def connect(self) -> socket.socket:
        """Return a new plain connection."""
        return socket.create_connection(("127.0.0.1", self.port), timeout=10.0)


@pytest.fixture
def start_emulator() -> Iterator[Callable[..., RunningEmulator]]:
    """Return a function that starts an emulator; all are stopped after the test."""
    started: list[RunningEmulator] = []

    def start(**options: object) -> RunningEmulator:
        started.append(RunningEmulator(**options))  # type: ignore[arg-type]
        return started[-1]

    yield start
    for emulator in started:
        emulator.stop()


class ManualClock:
    """A wall clock that a test moves."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        """Return the time, s."""
        return self.now

    def sleep(self, seconds: float) -> None:
        """Move on as time.sleep would."""
        self.now += seconds


@pytest.fixture
def manual_clock() -> ManualClock:
    """Return a wall clock that stands still until moved."""
    return ManualClock()
