"""Emulated receivers behind the server, commanded ahead by the link of the bridge, or not."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import threading
import tty
from collections.abc import Iterator
from pathlib import Path

import gnss_emulator_support as support
import numpy as np
import pytest

from vtff_gnss.novatel import ReceiverLogStream
from vtff_gnss.observations import ObservationEpoch
from vtff_sim_bridge.bridge.simgen_link import SimGenLink
from vtff_sim_bridge.receiver.receiver_port import ReceiverPort
from vtff_sim_bridge.receiver.truth_file import TruthFile
from vtff_sim_bridge.simgen.emulator_state import ScenarioMachine
from vtff_sim_bridge.simgen.gnss_emulation import GnssEmulation, ReceiverSet
from vtff_sim_bridge.simgen.simremote_server import SimRemoteServer
from vtff_sim_bridge.simremote.client import SimRemoteClient

NAMES = ("chief", "deputy")
LOGS = support.LOGS + b"LOG BESTXYZB ONTIME 1\r\nLOG TIMEB ONTIME 1\r\n"
STEPS = 10


class Bench:
    """The emulator in a thread, and ports that are read when the reply to a step is there."""

    def __init__(self, folder: Path, **changes: object) -> None:
        base = support.configuration("reference", **changes)
        receivers = tuple(
            dataclasses.replace(receiver, name=name, vehicle=vehicle)
            for receiver, name, vehicle in zip(
                base.receivers, NAMES, support.VEHICLES, strict=False
            )
        )
        self.truth = folder / "truth.jsonl"
        self.machine = ScenarioMachine(support.VEHICLES, clock_mode="lockstep")
        self.emulation = GnssEmulation(
            self.machine, dataclasses.replace(base, receivers=receivers), folder, self.truth
        )
        self.server = SimRemoteServer(self.machine, companion=self.emulation)
        self.content = {name: bytearray() for name in NAMES}
        self._ports = {}
        for name in NAMES:
            self._ports[name] = os.open(folder / name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            tty.setraw(self._ports[name])
            os.write(self._ports[name], LOGS)
        self._thread = threading.Thread(target=self.server.serve)
        self._thread.start()
        for name in NAMES:
            self._read_until(name, LOGS.count(b"\n"), b"<OK")

    def _read_until(self, name: str, count: int, text: bytes) -> None:
        """Read until a text has come so often."""
        while self.content[name].count(text) < count:
            try:
                self.content[name] += os.read(self._ports[name], 65536)
            except BlockingIOError:
                threading.Event().wait(0.001)

    def fly(self, step: int, is_ahead: bool, steps: int = STEPS, level: str = "") -> SimGenLink:
        """Fly steps of whole seconds, as the bridge does, and end the run."""
        motions = support.orbit_motions(
            [support.CHIEF_GCRF, support.DEPUTY_GCRF], (steps + 1) * step
        )
        # Position, velocity, acceleration and jerk.
        arrays = [
            {name: np.array(state[:4]) for name, state in zip(NAMES, states, strict=True)}
            for states in motions[::step]
        ]
        link = SimGenLink(SimRemoteClient("127.0.0.1", self.server.port, timeout=5.0), NAMES, 5.0)
        link.start("leo.scn", support.START, 600, arrays[0])
        if level:
            with contextlib.closing(SimRemoteClient("127.0.0.1", self.server.port, 5.0)) as client:
                client.connect()
                client.command(level)
        for k in range(1, steps + 1):
            following = (float(k + 1) * step, {"chief": arrays[k + 1]["chief"]})
            link.send(float(k * step), arrays[k], following if is_ahead else None)
            link.receive()
            for name in NAMES:
                # Time of the last log of each second: one at the start, then one each.
                self._read_until(name, 1 + k * step, b"\xaa\x44\x12\x1c\x65\x00")
        link.stop()
        return link

    def close(self) -> None:
        """End the emulator."""
        self.server.stop()
        self._thread.join(10.0)
        self.server.close()
        self.emulation.close()
        for port in self._ports.values():
            os.close(port)


@pytest.fixture
def benches(tmp_path) -> Iterator[list[Bench]]:
    made = []
    for name in ("plain", "early"):
        (tmp_path / name).mkdir()
        made.append(Bench(tmp_path / name))
    yield made
    for bench in made:
        bench.close()


@pytest.mark.parametrize("step", [1, 5])
def test_bytes_and_truth_are_those_of_a_run_that_is_not_commanded_ahead(benches, step):
    """The run ends in the middle; receivers are read when the reply is there, as in one process."""
    plain, early = benches
    steps = STEPS if step == 1 else 3
    for bench in benches:
        link = bench.fly(step, bench is early, steps)
        assert link.counters.connection_losses == link.counters.errors == 0
        bench.emulation.settle()
    assert early.content == plain.content
    assert len(plain.content["deputy"]) > 20_000 * step * steps
    assert early.truth.read_bytes() == plain.truth.read_bytes()


def test_the_chief_has_measured_when_its_second_comes(benches, monkeypatch):
    _, early = benches
    seconds: list[int] = []
    settle = GnssEmulation.settle

    def settle_and_note(self: GnssEmulation) -> None:
        settle(self)
        receivers = self._set
        if receivers is not None and receivers._ahead:
            seconds.append(receivers._last_epoch // 20)
            assert list(receivers._ahead) == ["chief"]

    monkeypatch.setattr(GnssEmulation, "settle", settle_and_note)
    early.fly(1, True)
    assert set(seconds) == set(range(1, STEPS + 1))


def test_nothing_is_measured_ahead_while_bytes_wait_for_a_client(benches, monkeypatch):
    """Who reads a second waits for what a pseudo-terminal does not hold of it."""
    _, early = benches
    looks, waiting = [], []
    settle, look_ahead = GnssEmulation.settle, ReceiverSet.look_ahead

    def look_and_note(self: ReceiverSet, *arguments: object) -> None:
        looks.append([port.pending_bytes for port in early.emulation.ports.values()])
        look_ahead(self, *arguments)

    def settle_and_note(self: GnssEmulation) -> None:
        waiting.append(any(port.pending_bytes for port in self.ports.values()))
        settle(self)

    monkeypatch.setattr(ReceiverSet, "look_ahead", look_and_note)
    monkeypatch.setattr(GnssEmulation, "settle", settle_and_note)
    early.fly(1, True)
    assert any(waiting), "a second is more than a terminal holds"
    assert len(looks) >= STEPS and not np.any(looks)


@pytest.mark.parametrize(("clock_mode", "writes"), [("lockstep", False), ("realtime", True)])
def test_a_client_that_stalls_keeps_no_truth_back_in_real_time(
    tmp_path, monkeypatch, clock_mode, writes
):
    emulation = GnssEmulation(
        ScenarioMachine(support.VEHICLES, clock_mode=clock_mode), support.configuration(), tmp_path
    )
    flushes = []
    monkeypatch.setattr(TruthFile, "flush", lambda self: flushes.append(self))
    monkeypatch.setattr(ReceiverPort, "pending_bytes", 5)
    emulation.settle()
    assert bool(flushes) is writes
    emulation.close()


def test_where_levels_are_commanded_nothing_is_measured_ahead(benches):
    """The level holds from the epoch of its time on, as without."""
    plain, early = benches
    level = "2.5,POW_LEV,v1_a1,-3.5,GPS,0,0,1,1,1,1,0"
    for bench in benches:
        bench.fly(1, bench is early, level=level)
    assert early.content == plain.content
    events = ReceiverLogStream().feed(bytes(early.content["chief"]))
    levels = [float(e.cn0_dbhz.mean()) for e in events if isinstance(e, ObservationEpoch)]
    assert np.mean(levels[30:49]) - np.mean(levels[51:70]) == pytest.approx(3.5, abs=0.5)


def test_a_motion_that_comes_too_late_is_told(caplog):
    motions = support.orbit_motions([support.CHIEF_GCRF, support.DEPUTY_GCRF], 3)
    run = support.Run(support.configuration(), motions, support.LOGS, ahead=1)

    def correct(second: int) -> None:
        if second == 1:
            run._vehicles["v1_m1"].command(1_500_000_000, motions[2][0])

    run.all(correct)
    assert caplog.messages == [
        "receiver chief had measured to 2 s when a motion command for that time came: "
        "it takes no part of it"
    ]
