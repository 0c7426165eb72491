"""The emulator over real sockets: line endings, several clients, junk, clean end."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from simremote_test_support import datagram_of

from vtff_sim_bridge.simgen.emulator_state import ScenarioMachine
from vtff_sim_bridge.simgen.simgen_emulator import main, write_port_file
from vtff_sim_bridge.simgen.simremote_server import (
    MAXIMUM_LINE_BYTES,
    TAIL_SILENCE,
    CommandSplitter,
)
from vtff_sim_bridge.simremote.language import Reply, SimGenStatus, parse_reply
from vtff_sim_bridge.simremote.motion import MotionState
from vtff_sim_bridge.simremote.udp_motion import MotionDatagram

if TYPE_CHECKING:
    from conftest import RunningEmulator

Start = Callable[..., "RunningEmulator"]
INITIAL = b"0,MOT,v1_m1,7e6,0,0\n0,MOT,v2_m1,7.1e6,0,0\n"


def receive(connection: socket.socket, count: int) -> list[Reply]:
    """Return exactly this many replies; fail if bytes are left over."""
    received = b""
    while received.count(b"</msg>") < count:
        part = connection.recv(65536)
        assert part, f"closed after {received!r}"
        received += part
    replies = re.findall(rb"<msg>.*?</msg>", received, re.DOTALL)
    assert b"".join(replies) == received and len(replies) == count
    return [parse_reply(reply.decode()) for reply in replies]


def ask(connection: socket.socket, *commands: bytes) -> list[Reply]:
    connection.sendall(b"".join(command + b"\n" for command in commands))
    return receive(connection, len(commands))


def test_each_command_gets_one_reply_in_order(start_emulator: Start) -> None:
    with start_emulator().connect() as connection:
        replies = ask(connection, b"NULL", b"SC,a.scn", b"BAD", b"SC_NAME", *INITIAL.splitlines())
        assert [reply.status for reply in replies] == [0, 2, 2, 2, 2, 2]
        assert "BAD" in str(replies[2].error_text) and replies[3].data_text == "a.scn"


@pytest.mark.parametrize("ending", [b"\n", b"\r\n", b"\r", b"\n\r", b"\n\n"])
def test_line_endings_split_at_every_byte(ending: bytes) -> None:
    stream = b"".join(command + ending for command in (b"NULL", b"-,TIME", b"SC,a b.scn"))
    expected = [b"NULL", b"-,TIME", b"SC,a b.scn"]
    for first in range(len(stream) + 1):
        for second in range(first, len(stream) + 1):
            splitter = CommandSplitter()
            parts = (stream[:first], stream[first:second], stream[second:])
            assert [line for part in parts for line in splitter.feed(part)] == expected
            assert splitter.flush() == []


@pytest.mark.parametrize("ending", [b"\n", b"\r\n", b""])
def test_line_endings_over_tcp(start_emulator: Start, ending: bytes) -> None:
    with start_emulator().connect() as connection:
        for command, status in ((b"NULL", 0), (b"SC,a.scn", 2), (b"null", 2)):
            connection.sendall(command + ending)
            assert receive(connection, 1)[0].status == status


def test_one_connection_per_unterminated_command(start_emulator: Start) -> None:
    emulator = start_emulator()
    for command, status in ((b"SC,a.scn", 2), (b"-,NULL", 2)):
        with emulator.connect() as connection:
            connection.sendall(command)
            connection.shutdown(socket.SHUT_WR)
            assert receive(connection, 1)[0].status == status
            assert connection.recv(1) == b""


def test_a_client_that_terminates_its_commands_may_be_interrupted_in_one(
    start_emulator: Start,
) -> None:
    """On a busy machine the rest of a packet may come late."""
    with start_emulator().connect() as connection:
        connection.sendall(b"SC,a.scn\nSC_N")
        time.sleep(5 * TAIL_SILENCE)
        connection.sendall(b"AME\n")
        replies = receive(connection, 2)
        assert [reply.status for reply in replies] == [2, 2]
        assert replies[1].data_text == "a.scn"


def test_the_time_in_which_commands_are_carried_out_is_no_silence(start_emulator: Start) -> None:
    emulator = start_emulator(clock_mode="lockstep")
    emulator.machine.observers.append(lambda time_: time.sleep(0.2 if time_ else 0.0))
    with emulator.connect() as connection:
        ask(connection, b"SC,a.scn", *INITIAL.splitlines(), b"RU")
        steps = b"1,MOT,v1_m1,7e6,0,0\n1,MOT,v2_m1,7.1e6,0,0\n"
        connection.sendall(steps + b"2,MOT,v1_m1,7e6")
        time.sleep(0.05)
        connection.sendall(b",1,0\n")
        assert [reply.error_text for reply in receive(connection, 3)] == [None] * 3


def test_several_clients_share_the_simulator(start_emulator: Start) -> None:
    emulator = start_emulator()
    connections = [emulator.connect() for _ in range(5)]
    try:
        assert ask(connections[0], b"SC,a.scn")[0].status == 2
        for connection in connections:
            connection.sendall(b"NULL\nSC_NAME\n")
        for connection in reversed(connections):
            assert [reply.data_text for reply in receive(connection, 2)] == [None, "a.scn"]
    finally:
        for connection in connections:
            connection.close()


def test_arming_blocks_its_client_and_no_other(start_emulator: Start) -> None:
    # The delay is far longer than the test; it is ended by hand, so nothing depends on it.
    emulator = start_emulator(arming_delay=1000.0)
    with emulator.connect() as arming, emulator.connect() as other:
        ask(arming, b"SC,a.scn", *INITIAL.splitlines())
        arming.sendall(b"AR\nNULL\n")
        while ask(other, b"NULL")[0].status is not SimGenStatus.ARMING:
            pass
        arming.setblocking(False)
        with pytest.raises(BlockingIOError):
            arming.recv(1)
        arming.settimeout(10.0)
        emulator.machine._busy_until = 0.0
        assert ask(other, b"NULL")[0].status is SimGenStatus.ARMED
        assert [reply.status for reply in receive(arming, 2)] == [4, 4]


def test_a_client_that_leaves_while_arming_does_no_harm(start_emulator: Start) -> None:
    emulator = start_emulator(arming_delay=0.05)
    with emulator.connect() as connection:
        ask(connection, b"SC,a.scn", *INITIAL.splitlines())
        connection.sendall(b"AR\n")
    with emulator.connect() as connection:
        while ask(connection, b"NULL")[0].status is not SimGenStatus.ARMED:
            time.sleep(0.01)


def test_a_client_that_does_not_read_is_not_read_from(start_emulator: Start) -> None:
    emulator = start_emulator()
    with emulator.connect() as greedy, emulator.connect() as other:
        greedy.settimeout(0.2)
        sent = 0
        block = b"*IDN?\n" * 1000
        with pytest.raises(TimeoutError):
            for _ in range(5000):
                sent += greedy.send(block)
        assert ask(other, b"NULL")[0].status == 0
        assert sent < 5000 * len(block)


def test_overlong_command_is_refused_once(start_emulator: Start) -> None:
    with start_emulator().connect() as connection:
        connection.sendall(b"x" * (3 * MAXIMUM_LINE_BYTES) + b"\nNULL\n")
        refused, accepted = receive(connection, 2)
        assert "longer than" in str(refused.error_text) and accepted.failure is None


@pytest.fixture
def emulator(start_emulator: Start) -> RunningEmulator:
    """Return one emulator that all examples of a property share."""
    return start_emulator()


commands = st.binary(min_size=1, max_size=60).map(
    lambda junk: junk.replace(b"\n", b"?").replace(b"\r", b"?")
) | st.sampled_from([b"SC,a.scn", b"RU", b"-,EN,1", b"0,MOT,v1_m1,1,2,3", b"1,MOT,,", b"TR,0"])


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(commands.filter(lambda line: not line.isspace()), min_size=1, max_size=20))
def test_junk_gets_one_reply_per_command(emulator: RunningEmulator, lines: list[bytes]) -> None:
    with emulator.connect() as connection:
        ask(connection, *lines)
        assert ask(connection, b"*IDN?")[0].failure is None


@given(st.lists(st.binary(max_size=40), max_size=20))
def test_splitter_keeps_every_byte_but_line_ends(parts: list[bytes]) -> None:
    splitter = CommandSplitter()
    found = [line for part in parts for line in splitter.feed(part)] + splitter.flush()
    whole = b"".join(parts).replace(b"\r", b"\n").split(b"\n")
    assert found == [line for line in whole if line.strip()]


def test_udp_motion_and_text_share_the_port(start_emulator: Start) -> None:
    emulator = start_emulator(accepts_udp=True)
    with emulator.connect() as connection, socket.socket(type=socket.SOCK_DGRAM) as datagrams:
        datagrams.connect(("127.0.0.1", emulator.port))
        ask(connection, b"SC,a.scn")
        datagrams.send(b"junk")
        for vehicle in ("v1_m1", "v2_m1", "v3_m1"):
            motion = MotionState((7e6, 0.0, 0.0), (0.0, 7e3, 0.0))
            datagrams.send(datagram_of(MotionDatagram(vehicle, motion, 0), vehicle == "v2_m1"))
        while emulator.server.datagram_count < 4:
            ask(connection, b"NULL")
        assert emulator.server.refused_datagram_count == 2
        assert ask(connection, b"RU")[0].status == 5
        assert emulator.machine.motions["v2_m1"].at(10**9).position_itrf == (7e6, 7e3, 0.0)


def started_process(folder: Path, *options: str) -> tuple[subprocess.Popen[bytes], int]:
    port_file = folder / "port"
    process = subprocess.Popen(
        [sys.executable, "-m", "vtff_sim_bridge.simgen.simgen_emulator", "--port", "0"]
        + ["--port-file", str(port_file), *options],
        stderr=subprocess.PIPE,
    )
    while not port_file.exists():
        assert process.poll() is None
        time.sleep(0.01)
    return process, int(port_file.read_text())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_executable_serves_and_ends_cleanly(tmp_path: Path, number: signal.Signals) -> None:
    process, port = started_process(tmp_path, "--vehicles", "v1_m1", "--clock", "realtime", "--udp")
    try:
        with socket.create_connection(("127.0.0.1", port), timeout=10.0) as connection:
            replies = ask(connection, b"SC,a.scn", b"0,MOT,v1_m1,7e6,0,0", b"RU")
            assert replies[-1].status == 5
            process.send_signal(number)
            _, log = process.communicate(timeout=20.0)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 0
    assert b"Traceback" not in log and b"3 commands, 0 errors" in log


def test_a_taken_port_is_one_clear_line(
    start_emulator: Start, caplog: pytest.LogCaptureFixture
) -> None:
    port = start_emulator().port
    assert main(["--port", str(port)]) == 1
    assert len(caplog.messages) == 1 and f"127.0.0.1:{port}" in caplog.messages[0]
    assert main(["--port", "0", "--vehicles", "chief"]) == 2
    assert "vehicle: an id such as v1_m1 expected, got 'chief'" in caplog.messages[1]


def test_options_are_checked(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["--port", "70000"])
    assert stopped.value.code == 2
    assert "0 to 65535" in capsys.readouterr().err


def test_help_teaches_a_session(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    text = capsys.readouterr().out
    session = text.partition("a session")[2].partition("clock modes")[0].splitlines()[1:]
    assert "lockstep" in text and "realtime" in text
    # The session that the help shows must work as written.
    machine = ScenarioMachine(["v1_m1"])
    typed = [re.split(r"\s{3,}", line.strip()) for line in session if line.strip()]
    assert len(typed) == 10
    for command, *shown in typed:
        reply = machine.execute(command)
        assert reply is not None and reply.failure is None, (command, reply)
        status = re.search(r"status (\d)", " ".join(shown))
        if status:
            assert reply.status == int(status[1])


def test_port_file_is_whole(tmp_path: Path) -> None:
    write_port_file(tmp_path / "port", 15650)
    assert (tmp_path / "port").read_text() == "15650\n"
    assert [path.name for path in tmp_path.iterdir()] == ["port"]


def test_the_emulator_needs_no_ros() -> None:
    code = (
        "import sys; before = set(sys.modules); import vtff_sim_bridge.simgen.simgen_emulator; "
        "print({'rclpy'} & (set(sys.modules) - before))"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert shown.stdout.strip() == b"set()"
