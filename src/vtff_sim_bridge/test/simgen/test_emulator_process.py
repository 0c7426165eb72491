"""The simgen_emulator process with receivers: SimREMOTE over TCP, logs over pseudo-terminals."""

from __future__ import annotations

import os
import selectors
import signal
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import gnss_emulator_support as support
import pytest

from vtff_gnss.fix import Fix
from vtff_gnss.novatel import ReceiverLogStream
from vtff_gnss.novatel.events import CommandResponse
from vtff_gnss.observations import ObservationEpoch
from vtff_sim_bridge.simremote.client import SimRemoteClient
from vtff_sim_bridge.simremote.language import format_motion, parse_motion
from vtff_sim_bridge.simremote.motion import MotionState

SECONDS = 10
COMMANDS = b"UNLOGALL\r\nLOG RANGEB ONTIME 0.05\r\nLOG BESTXYZB ONTIME 1\r\nLOG TIMEB ONTIME 1\r\n"


class Reader:
    """A driver: it opens a port, sends commands, and reads in a thread."""

    def __init__(self, path: Path, pause: float = 0.0) -> None:
        self.descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.descriptor)
        self.content = bytearray()
        self._pause = pause
        self._stopping = False
        self._thread = threading.Thread(target=self._read)
        self._thread.start()
        os.write(self.descriptor, COMMANDS)

    def _read(self) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(self.descriptor, selectors.EVENT_READ)
            while not self._stopping:
                if selector.select(0.02):
                    self.content += os.read(self.descriptor, 4096)
                    time.sleep(self._pause)

    def wait_for(self, text: bytes, count: int) -> None:
        """Wait until a text has come so often; fail after a while."""
        deadline = time.monotonic() + 60.0
        while self.content.count(text) < count:
            assert time.monotonic() < deadline, bytes(self.content[-200:])
            time.sleep(0.01)

    def close(self) -> None:
        """Stop reading and close the port."""
        self._stopping = True
        self._thread.join()
        os.close(self.descriptor)


@pytest.fixture
def emulator(tmp_path: Path) -> Iterator[tuple[Path, int]]:
    """Start the process; give the folder of the ports and the TCP port of SimREMOTE."""
    port_file = tmp_path / "port"
    process = subprocess.Popen(
        [
            sys.executable, "-m", "vtff_sim_bridge.simgen.simgen_emulator", "--port", "0",
            "--port-file", str(port_file), "--port-link-directory", str(tmp_path / "ports"),
            "--gnss", str(support.REPOSITORY / "config" / "gnss" / "noise_free.yaml"),
            "--gnss-truth", str(tmp_path / "truth.jsonl"), "--log-level", "warning",
        ]
    )  # fmt: skip
    try:
        deadline = time.monotonic() + 60.0
        while not port_file.exists():
            assert process.poll() is None and time.monotonic() < deadline
            time.sleep(0.02)
        yield tmp_path, int(port_file.read_text(encoding="ascii"))
    finally:
        process.send_signal(signal.SIGTERM)
        assert process.wait(30.0) == 0


def as_sent(state: MotionState) -> MotionState:
    """Return a motion as it is after it was a text command."""
    return parse_motion(format_motion(0, "v1_m1", state).split(",")[2:])[1]


def play(port: int) -> list[list[MotionState]]:
    """Run the scenario in lockstep as fast as the emulator goes; return the motions."""
    motions = support.orbit_motions([support.CHIEF_GCRF, support.DEPUTY_GCRF], SECONDS)
    with SimRemoteClient("127.0.0.1", port) as client:
        client.connect()
        initial = list(zip(support.VEHICLES, motions[0], strict=True))
        client.command("SC,leo.scn")
        client.command("START_TIME,21-MAR-2016 01:00:00,00:10:00")
        client.receive_replies(client.send_motion(0.0, initial))
        client.command("TR,0")
        client.command("RU")
        for second, states in enumerate(motions[1:], start=1):
            pairs = zip(support.VEHICLES, states, strict=True)
            client.receive_replies(client.send_motion(float(second), pairs), timeout=60.0)
    return [[as_sent(state) for state in states] for states in motions]


@pytest.mark.parametrize("pause", [0.0, 0.01])
def test_every_byte_of_a_lockstep_run_comes_through_the_ports(emulator, pause):
    """Also to a driver that reads slowly; epochs are complete, in order, and the same as inside."""
    folder, port = emulator
    readers = {name: Reader(folder / "ports" / name, pause) for name in ("chief", "deputy")}
    try:
        for reader in readers.values():
            reader.wait_for(b"<OK", 4)
        motions = play(port)
        commands = COMMANDS.replace(b"UNLOGALL\r\n", b"")
        inside = support.Run(support.configuration(), motions, commands).all()
        for name, reader in readers.items():
            deadline = time.monotonic() + 60.0
            wanted = bytes(inside.content[name])
            while not reader.content.endswith(wanted[-64:]) and time.monotonic() < deadline:
                time.sleep(0.01)
            received = bytes(reader.content)
            assert received[received.index(wanted[:28]) :] == wanted
            check_stream(received)
    finally:
        for reader in readers.values():
            reader.close()
    assert (folder / "truth.jsonl").read_text(encoding="utf-8").count('"second"') == 2 * (
        SECONDS + 1
    )


def check_stream(received: bytes) -> None:
    """Check that what was received is what was asked for."""
    stream = ReceiverLogStream()
    events = stream.feed(received) + stream.close()
    epochs = [event for event in events if isinstance(event, ObservationEpoch)]
    assert [e.time - support.START for e in epochs] == pytest.approx(
        [k / 20.0 for k in range(20 * SECONDS + 1)]
    )
    fixes = [event for event in events if isinstance(event, Fix)]
    assert len(fixes) == SECONDS + 1
    assert sum(isinstance(event, CommandResponse) and event.is_ok for event in events) == 4
    assert all(len(epoch) >= 12 for epoch in epochs)
