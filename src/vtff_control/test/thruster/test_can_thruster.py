"""The link to a thruster: reports, losses, and buses of python-can that go away."""

import contextlib
import copy
import functools
import pathlib
import random
import socket
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from itertools import pairwise

import can
import pytest

from vtff_control.thruster.can_frames import ThrusterFrames
from vtff_control.thruster.can_thruster import ThrusterLink
from vtff_dynamics.time.timescales import GpsTime
from vtff_node.can_bus.connection import open_bus
from vtff_sim_bridge.thruster.can_thruster_emulator import CanThruster, serve

DBC_FILE = pathlib.Path(__file__).resolve().parents[4] / "config" / "can" / "vtff_thruster.dbc"
START = GpsTime.from_week_tow(1889, 90_000.0)
MULTICAST_GROUP = "239.74.163.2"
PATIENCE = 20.0  # s, ends a test that would hang


class FakeBus:
    """A bus with one emulated thruster; `spoil` may drop or change what the thruster says."""

    def __init__(self, wall: list[float], unit: CanThruster) -> None:
        self.wall = wall
        self.unit = unit
        self.waiting: deque[can.Message] = deque()
        self.spoil: Callable[[list[can.Message]], list[can.Message]] = lambda frames: frames
        self.broken = False
        self.closed = 0

    def send(self, frame: can.Message, timeout: float | None = None) -> None:
        if self.broken:
            raise can.CanOperationError("cable pulled")
        self.waiting.extend(self.spoil(self.unit.receive(frame, self.wall[0])))

    def recv(self, timeout: float) -> can.Message | None:
        if self.broken:
            raise can.CanOperationError("cable pulled")
        if self.waiting:
            return self.waiting.popleft()
        self.wall[0] += timeout
        return None

    def shutdown(self) -> None:
        self.closed += 1


class Bench:
    """Link and thruster on a fake bus and a fake wall clock."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.wall = [100.0]
        self.bus = FakeBus(self.wall, CanThruster(DBC_FILE))
        self.link = ThrusterLink(ThrusterFrames(DBC_FILE), self._open, lambda: self.wall[0])
        monkeypatch.setattr("vtff_control.thruster.can_thruster.time.sleep", self._sleep)

    def _open(self) -> can.BusABC:
        if self.bus.broken:
            raise OSError("No such device")
        return self.bus  # type: ignore[return-value]

    def _sleep(self, seconds: float) -> None:
        self.wall[0] += seconds

    def exchange(self, second: int, timeout: float = 1.0) -> object:
        self.link.send_command(START + second, [0.1, 0.2, -0.3])
        return self.link.wait_for_report(timeout)


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(monkeypatch)


def test_every_command_gets_its_report(bench: Bench) -> None:
    for second in range(40):
        report = bench.exchange(second)
        assert report.sequence == second % 16
        assert report.acceleration_rtn.tolist() == [0.1, 0.2, -30000 * 1e-5]
    counters = bench.link.counters
    assert (counters.commands, counters.reports) == (40, 40)
    assert counters.resent == counters.timeouts == counters.sequence_gaps == 0
    assert bench.bus.unit.sequence_gaps == 0


def test_lost_report_is_asked_for_again(bench: Bench) -> None:
    lost = [True, True]
    bench.bus.spoil = lambda frames: [] if frames and lost and lost.pop() else frames
    assert bench.exchange(0).sequence == 0
    assert bench.link.counters.resent == 2 and bench.bus.unit.commands == 1


def test_a_report_that_has_come_is_read_however_late_the_call_is(bench: Bench) -> None:
    """The process was busy with something else for longer than the wait."""
    bench.link.send_command(START, [0.1, 0.2, -0.3])
    bench.wall[0] += 60.0
    assert bench.link.wait_for_report(-59.0).sequence == 0
    assert bench.link.counters.resent == 0


def test_damaged_report_is_counted_and_asked_for_again(bench: Bench) -> None:
    intact = [False]

    def spoil(frames: list[can.Message]) -> list[can.Message]:
        if not frames or intact[0]:
            return frames
        intact[0] = True
        damaged = copy.deepcopy(frames)
        damaged[0].data[4] ^= 0x10
        return damaged

    bench.bus.spoil = spoil
    assert bench.exchange(0).sequence == 0
    # The damaged half, and the other one that came without it.
    assert bench.link.counters.rejected_frames == 2 and bench.link.counters.resent == 1


def test_silent_thruster_ends_in_a_timeout(bench: Bench) -> None:
    bench.bus.spoil = lambda frames: []
    assert bench.exchange(0) is None
    assert bench.link.counters.timeouts == 0
    bench.link.give_up()
    bench.link.give_up()
    assert bench.link.counters.timeouts == 1
    assert bench.wall[0] == pytest.approx(101.0, abs=1e-9)


def test_report_of_another_command_is_not_taken(bench: Bench) -> None:
    held: list[can.Message] = []
    bench.bus.spoil = lambda frames: held.extend(frames) or []
    assert bench.exchange(0, 0.1) is None
    bench.bus.spoil = lambda frames: [*held, *frames] if frames else []
    report = bench.exchange(1, 0.1)
    assert report.sequence == 1
    counters = bench.link.counters
    assert (counters.timeouts, counters.sequence_gaps, counters.reports) == (1, 1, 1)


def test_missing_heartbeat_is_a_gap_and_a_restart_is_none(bench: Bench) -> None:
    beats = [bench.bus.unit.tick(100.0 + second)[0] for second in range(20)]
    bench.bus.waiting.extend(beats[:10])
    bench.link.poll()
    assert bench.link.counters.sequence_gaps == 0
    bench.bus.waiting.extend(beats[12:])
    bench.link.poll()
    assert bench.link.counters.sequence_gaps == 1
    bench.bus.waiting.extend(CanThruster(DBC_FILE).tick(500.0))
    bench.link.poll()
    assert bench.link.counters.sequence_gaps == 1
    assert bench.link.heartbeat is not None and bench.link.heartbeat.uptime == 0
    assert bench.link.heard_at == bench.wall[0]


def test_bus_that_goes_away_is_opened_again(bench: Bench) -> None:
    assert bench.exchange(0) is not None
    bench.bus.broken = True
    assert bench.exchange(1) is None
    assert bench.bus.closed == 1 and "No such device" in bench.link.problem
    errors = bench.link.counters.bus_errors
    assert 2 <= errors <= 6  # the pauses between attempts grow
    bench.bus.broken = False
    assert bench.exchange(2, 5.0).sequence == 2
    assert bench.link.problem == ""
    assert bench.link.counters.bus_errors == errors


def test_pauses_between_attempts_to_open_a_lost_bus_double_up_to_2_s(bench: Bench) -> None:
    bench.bus.broken = True
    attempts = []
    for step in range(2000):
        bench.wall[0] = 100.0 + step / 128
        errors = bench.link.counters.bus_errors
        assert not bench.link.connect()
        if bench.link.counters.bus_errors > errors:
            attempts.append(bench.wall[0])
    pauses = [later - earlier for earlier, later in pairwise(attempts)]
    assert pauses[:5] == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.6], abs=1 / 128)
    assert pauses[5:] == [2.0] * 6


def test_bus_that_comes_back_during_the_wait_still_gets_the_command(bench: Bench) -> None:
    bench.bus.broken = True
    bench.link.send_command(START, [0.1, 0.0, 0.0])
    assert bench.link.wait_for_report(0.3) is None
    bench.bus.broken = False
    assert bench.link.wait_for_report(5.0) is not None


@pytest.mark.parametrize("seed", range(5))
def test_noisy_bus_never_gives_a_wrong_report(bench: Bench, seed: int) -> None:
    generator = random.Random(seed)

    def spoil(frames: list[can.Message]) -> list[can.Message]:
        heard = []
        for frame in frames:
            payload = bytearray(frame.data)
            if generator.random() < 0.3:
                payload[generator.randrange(8)] ^= 1 << generator.randrange(8)
            if generator.random() > 0.1:
                heard.append(can.Message(arbitration_id=frame.arbitration_id, data=payload))
                heard[-1].is_extended_id = False
        return heard

    bench.bus.spoil = spoil
    answered = 0
    for second in range(100):
        report = bench.exchange(second)
        if report is not None:
            answered += 1
            assert report.sequence == second % 16
            assert report.acceleration_rtn.tolist() == [0.1, 0.2, -30000 * 1e-5]
    assert answered > 50
    assert bench.link.counters.rejected_frames > 0


# ---- buses of python-can -------------------------------------------------------------------------


@contextlib.contextmanager
def serving(open_thruster_bus: Callable[[], can.BusABC]) -> Iterator[CanThruster]:
    unit = CanThruster(DBC_FILE)
    stop = threading.Event()
    thread = threading.Thread(target=serve, args=(unit, open_thruster_bus, stop.is_set))
    thread.start()
    try:
        yield unit
    finally:
        stop.set()
        thread.join()


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return probe.getsockname()[1]


def require_multicast(port: int) -> None:
    try:
        with (
            open_bus("udp_multicast", MULTICAST_GROUP, port) as sender,
            open_bus("udp_multicast", MULTICAST_GROUP, port) as receiver,
        ):
            sender.send(can.Message(arbitration_id=1, is_extended_id=False))
            if receiver.recv(2.0) is None:
                pytest.skip("this machine does not loop multicast datagrams back")
    except (can.CanError, OSError) as error:
        pytest.skip(f"no multicast on this machine: {error}")


def fly(link: ThrusterLink) -> None:
    for second in range(50):
        link.send_command(START + second, [0.001 * second, 2.0, 0.0])
        report = link.wait_for_report(PATIENCE)
        assert report is not None and report.sequence == second % 16
        assert report.acceleration_rtn.tolist() == [second * 100 * 1e-5, 140000 * 1e-5, 0.0]
        assert report.saturated
    assert link.counters.timeouts == link.counters.bus_errors == 0


def test_virtual_bus_within_a_process() -> None:
    open_one = functools.partial(open_bus, "virtual", "test_virtual_bus")
    with serving(open_one) as unit:
        link = ThrusterLink(ThrusterFrames(DBC_FILE), open_one)
        fly(link)
        link.close()
    assert unit.commands == 50 and unit.rejected_frames == 0


def test_multicast_bus_between_processes() -> None:
    port = free_port()
    require_multicast(port)
    emulator = subprocess.Popen(
        [sys.executable, "-m", "vtff_sim_bridge.thruster.can_thruster_emulator"]
        + ["--dbc", str(DBC_FILE), "--port", str(port)],
        stderr=subprocess.PIPE,
        text=True,
    )
    link = ThrusterLink(
        ThrusterFrames(DBC_FILE),
        functools.partial(open_bus, "udp_multicast", MULTICAST_GROUP, port),
    )
    try:
        fly(link)
    finally:
        link.close()
        emulator.terminate()
        _, log = emulator.communicate(timeout=PATIENCE)
    assert emulator.returncode == 0
    assert "50 commands, 0 rejected frames, 0 sequence gaps" in log


def test_a_second_emulator_on_a_bus_is_refused_with_one_line() -> None:
    port = free_port()
    require_multicast(port)
    command = [sys.executable, "-m", "vtff_sim_bridge.thruster.can_thruster_emulator"]
    command += ["--dbc", str(DBC_FILE), "--port", str(port)]
    first = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    link = ThrusterLink(
        ThrusterFrames(DBC_FILE),
        functools.partial(open_bus, "udp_multicast", MULTICAST_GROUP, port),
    )
    try:
        fly(link)  # the first one has the bus
        second = subprocess.run(
            command, capture_output=True, text=True, timeout=PATIENCE, check=False
        )
    finally:
        link.close()
        first.terminate()
        first.wait(PATIENCE)
    assert second.returncode == 1
    assert len(second.stderr.splitlines()) == 1
    assert (
        f"another emulated thruster is on udp_multicast 239.74.163.2 port {port}" in second.stderr
    )


def test_socketcan_bus() -> None:
    open_one = functools.partial(open_bus, "socketcan", "vcan0")
    try:
        open_one().shutdown()
    except (can.CanError, OSError) as error:
        pytest.skip(f"no vcan0 on this machine: {error}")
    with serving(open_one):
        link = ThrusterLink(ThrusterFrames(DBC_FILE), open_one)
        fly(link)
        link.close()


def test_unknown_interface_is_an_error_at_once() -> None:
    link = ThrusterLink(ThrusterFrames(DBC_FILE), functools.partial(open_bus, "semaphore", "x"))
    with pytest.raises(can.CanInterfaceNotImplementedError, match="semaphore"):
        link.connect()


def test_emulator_refuses_wrong_options_with_one_line() -> None:
    result = subprocess.run(
        [sys.executable, "-m", "vtff_sim_bridge.thruster.can_thruster_emulator"]
        + ["--dbc", str(DBC_FILE), "--quantum", "1.5e-5"],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert result.returncode == 1
    assert len(result.stderr.splitlines()) == 1 and "quantum: a multiple of 1e-05" in result.stderr
