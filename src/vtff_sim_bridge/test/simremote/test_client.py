"""The SimREMOTE client against the emulator and against simulators that misbehave."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest

from vtff_sim_bridge.simremote.client import (
    SimRemoteClient,
    SimRemoteConnectionError,
    SimRemoteError,
    SimRemoteTimeoutError,
)
from vtff_sim_bridge.simremote.language import SimGenStatus
from vtff_sim_bridge.simremote.motion import MotionState

if TYPE_CHECKING:
    from conftest import ManualClock, RunningEmulator

Start = Callable[..., "RunningEmulator"]
# Only `nanoseconds` of the start time is used; 1 000 000 000 s is 14-SEP-2011 01:46:40 GPS.
START = SimpleNamespace(nanoseconds=1_000_000_000 * 10**9)
INITIAL = {
    "v1_m1": MotionState((7e6, 0.0, 0.0), (0.0, 7.5e3, 0.0)),
    "v2_m1": MotionState((7e6, 1e3, 0.0), (0.0, 7.5e3, 1e-7)),
}


def connected(emulator: RunningEmulator, **options: object) -> SimRemoteClient:
    client = SimRemoteClient("127.0.0.1", emulator.port, 10.0, **options)  # type: ignore[arg-type]
    client.connect()
    return client


@pytest.fixture
def fake_simulator() -> Iterator[Callable[[bytes], int]]:
    """Return a function that serves one client with a fixed answer; gives the port."""
    threads: list[threading.Thread] = []

    def serve(answer: bytes) -> int:
        listener = socket.create_server(("127.0.0.1", 0))

        def run() -> None:
            with listener:
                accepted, _ = listener.accept()
            with accepted:
                accepted.recv(65536)
                accepted.sendall(answer)
                if answer and not answer.endswith(b"!"):
                    # Wait for the client to leave.
                    accepted.recv(65536)

        threads.append(threading.Thread(target=run))
        threads[-1].start()
        return int(listener.getsockname()[1])

    yield serve
    for thread in threads:
        thread.join(10.0)
        assert not thread.is_alive()


@pytest.mark.parametrize("line_ending", ["\n", "\r\n"])
def test_a_whole_run(start_emulator: Start, line_ending: str) -> None:
    emulator = start_emulator()
    with connected(emulator, line_ending=line_ending) as client:
        assert client.prepare_run("leo.scn", START, 3600.0, INITIAL) is SimGenStatus.ARMED
        assert client.command("STTIME").data_text == "14-Sep-2011 01:46:40"
        assert client.command("SC_DURATION").data_text == "01:00:00"
        assert client.run() is SimGenStatus.RUNNING
        for step in range(1, 4):
            assert client.send_motion(0.1 * step, INITIAL.items()) == 2
            assert client.outstanding == 2
            replies = client.receive_replies(2)
            assert [reply.status for reply in replies] == [SimGenStatus.RUNNING] * 2
        assert emulator.machine.time_nanoseconds == 300_000_000
        assert emulator.machine.motions["v2_m1"].at(300_000_000) == INITIAL["v2_m1"]
        assert client.end() is SimGenStatus.READY
        assert client.counters.sent == client.counters.replies == emulator.server.command_count
        assert client.counters.errors == client.counters.reconnects == 0


@pytest.mark.parametrize(
    "lines",
    [
        [],
        ["SC,a.scn"],
        ["SC,a.scn", "0,MOT,v1_m1,1,2,3", "0,MOT,v2_m1,1,2,3", "AR"],
        ["SC,a.scn", "0,MOT,v1_m1,1,2,3", "0,MOT,v2_m1,1,2,3", "AR_NOWAIT"],
        ["SC,a.scn", "0,MOT,v1_m1,1,2,3", "0,MOT,v2_m1,1,2,3", "RU"],
        ["SC,a.scn", "0,MOT,v1_m1,1,2,3", "0,MOT,v2_m1,1,2,3", "RU", "-,EN"],
    ],
)
def test_a_run_can_be_prepared_from_every_status(start_emulator: Start, lines: list[str]) -> None:
    with connected(start_emulator(arming_delay=0.05)) as client:
        for line in lines:
            client.command(line)
        assert client.end() is (SimGenStatus.READY if lines else SimGenStatus.NO_SCENARIO)
        assert client.prepare_run("b.scn", START, 60, INITIAL) is SimGenStatus.ARMED
        assert client.run() is SimGenStatus.RUNNING


def test_errors_name_command_and_reason(start_emulator: Start) -> None:
    with connected(start_emulator()) as client:
        with pytest.raises(SimRemoteError, match="^TR,9: trigger: one of 0, 1, 2 expected"):
            client.command("TR,9")
        client.command("SC,a.scn")
        motions = [("v1_m1", INITIAL["v1_m1"]), ("v9_m1", INITIAL["v2_m1"])]
        client.send_motion(0.0, [*motions, ("v2_m1", INITIAL["v2_m1"])])
        with pytest.raises(SimRemoteError, match=r"^0\.000,MOT,v9_m1,\.\.\.: vehicle: v9_m1 is"):
            client.receive_replies(3)
        # All three replies have been read, so the next one is that of the next command.
        assert client.command("SC_NAME").data_text == "a.scn"
        assert client.counters.errors == 2


def test_wait_for_status_gives_up(start_emulator: Start, manual_clock: ManualClock) -> None:
    emulator = start_emulator()
    with connected(emulator, monotonic=manual_clock, sleep=manual_clock.sleep) as client:
        with pytest.raises(
            SimRemoteError, match=r"status 5 \(running\) expected within 2 s, it is"
        ):
            client.wait_for_status(SimGenStatus.RUNNING, 2.0)
    assert emulator.server.command_count == pytest.approx(21, abs=1)


def test_arguments_are_checked(start_emulator: Start) -> None:
    with connected(start_emulator()) as client:
        for text in ("NULL\nNULL", "", "SC,ä.scn"):
            with pytest.raises(ValueError, match="one line of ASCII"):
                client.command(text)
        with pytest.raises(ValueError, match="^velocity_x of v1_m1"):
            client.send_motion(1.0, [("v1_m1", MotionState((1, 2, 3), (float("nan"), 0, 0)))])
        for time in (-1.0, float("nan")):
            with pytest.raises(ValueError, match="^time: "):
                client.send_motion(time, INITIAL.items())
        with pytest.raises(ValueError, match="1 replies asked for, 0 outstanding"):
            client.receive_replies(1)
        with pytest.raises(ValueError, match="^duration: "):
            client.prepare_run("a.scn", START, 1.5, INITIAL)
        with pytest.raises(ValueError, match="^start_time: "):
            client.prepare_run("a.scn", SimpleNamespace(nanoseconds=1), 1.0, INITIAL)
        client.send_motion(0.0, INITIAL.items())
        with pytest.raises(ValueError, match="2 replies have not been received"):
            client.command("NULL")


def test_reconnection_during_a_run(start_emulator: Start) -> None:
    emulator = start_emulator()
    client = connected(emulator)
    client.prepare_run("a.scn", START, 3600, INITIAL)
    client.run()
    emulator.stop()
    with pytest.raises(SimRemoteConnectionError):
        client.send_motion(1.0, INITIAL.items())
        client.receive_replies(2)
    assert not client.is_connected and client.outstanding == 0
    with pytest.raises(SimRemoteConnectionError, match="^NULL: not connected to 127.0.0.1:"):
        client.command("NULL")
    restarted = start_emulator(port=emulator.port)
    client.reconnect()
    assert client.counters.reconnects == client.counters.connection_losses == 1
    assert client.status() is SimGenStatus.NO_SCENARIO
    client.prepare_run("a.scn", START, 3600, INITIAL)
    assert client.run() is SimGenStatus.RUNNING
    assert restarted.machine.status is SimGenStatus.RUNNING
    client.close()


def test_the_run_goes_on_when_only_the_connection_is_lost(start_emulator: Start) -> None:
    emulator = start_emulator()
    client = connected(emulator)
    client.prepare_run("a.scn", START, 3600, INITIAL)
    client.run()
    client.send_motion(1.0, INITIAL.items())
    client.reconnect()
    client.receive_replies(client.send_motion(2.0, INITIAL.items()))
    assert client.counters.reconnects == 1
    assert emulator.machine.time_nanoseconds == 2 * 10**9
    client.close()


def test_connection_attempts_back_off(manual_clock: ManualClock) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    waits: list[float] = []

    def sleep(seconds: float) -> None:
        waits.append(seconds)
        manual_clock.sleep(seconds)

    client = SimRemoteClient("127.0.0.1", port, monotonic=manual_clock, sleep=sleep)
    with pytest.raises(SimRemoteConnectionError, match=f"127.0.0.1:{port} within 10 s"):
        client.connect(timeout=10.0)
    assert waits == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.6, 2.0, 2.0, 2.0])
    assert not client.try_connect()


def test_no_reply_in_time_closes_the_connection(fake_simulator: Callable[[bytes], int]) -> None:
    client = SimRemoteClient("127.0.0.1", fake_simulator(b"<msg><status> 2"), timeout=0.05)
    client.connect()
    with pytest.raises(SimRemoteTimeoutError, match=r"^NULL: no reply within 0\.05 s"):
        client.command("NULL")
    assert not client.is_connected


@pytest.mark.parametrize(
    ("answer", "problem"),
    [
        (b"", "connection"),
        (b"<msg><sta!", "connection"),
        (b"hello</msg>", "reply: "),
        (b"<msg><status> 99 </status></msg>", "status: "),
        (b"\xff\xfe</msg>", "reply: "),
    ],
)
def test_unusable_replies(
    fake_simulator: Callable[[bytes], int], answer: bytes, problem: str
) -> None:
    client = SimRemoteClient("127.0.0.1", fake_simulator(answer), timeout=10.0)
    client.connect()
    with pytest.raises(SimRemoteConnectionError, match=f"^NULL: {problem}"):
        client.command("NULL")
    assert not client.is_connected and client.counters.connection_losses == 1


def test_reply_with_blanks_and_line_ends(fake_simulator: Callable[[bytes], int]) -> None:
    answer = b"\r\n<msg>\n<status> 5 </status>\n<data>\n 12.5 \n</data>\n</msg>\r\n"
    with SimRemoteClient("127.0.0.1", fake_simulator(answer), timeout=10.0) as client:
        assert client.command("-,TIME").data_text == "12.5"
