"""Pseudo-terminal and TCP port of the emulated receiver."""

from __future__ import annotations

import contextlib
import os
import pathlib
import random
import selectors
import socket
import termios
import time
import tty

import pytest
from encoder_test_support import receiver_log

from vtff_gnss.novatel import ReceiverLogStream
from vtff_sim_bridge.receiver.receiver_firmware import ReceiverFirmware
from vtff_sim_bridge.receiver.receiver_port import (
    CONGESTION_BYTES,
    MAXIMUM_PENDING_BYTES,
    ReceiverPort,
)

OK = b"\r\n<OK\r\n[COM1]"
PATIENCE = 20.0


@pytest.fixture
def make_port(tmp_path):
    """Return a function that makes a port with the symlink `tmp_path/receiver`."""
    made = []

    def make(receiver: ReceiverFirmware | None = None, **options) -> ReceiverPort:
        options.setdefault("symlink", tmp_path / "receiver")
        made.append(ReceiverPort(receiver or ReceiverFirmware(), **options))
        return made[-1]

    yield make
    for port in made:
        with contextlib.suppress(ValueError):
            port.close()


class Client:
    """A driver that opens the name, without blocking."""

    def __init__(self, path: pathlib.Path, baud: int = termios.B9600) -> None:
        self.descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self.descriptor)
        attributes = termios.tcgetattr(self.descriptor)
        attributes[4] = attributes[5] = baud
        termios.tcsetattr(self.descriptor, termios.TCSANOW, attributes)

    def read(self, count: int = 65536) -> bytes:
        try:
            return os.read(self.descriptor, count)
        except BlockingIOError:
            return b""

    def write(self, content: bytes) -> None:
        os.write(self.descriptor, content)

    def close(self) -> None:
        os.close(self.descriptor)


def exchange(port: ReceiverPort, read, is_complete) -> bytes:
    """Let a selector loop watch the port until the client has what it waits for."""
    content = b""
    deadline = time.monotonic() + PATIENCE
    with selectors.DefaultSelector() as selector:
        selector.register(port, selectors.EVENT_READ)
        while not is_complete(content):
            assert time.monotonic() < deadline, content[-200:]
            if selector.select(0.005):
                port.process()
            content += read()
    return content


def test_commands_through_a_pseudo_terminal(make_port, tmp_path):
    port = make_port()
    assert (tmp_path / "receiver").is_symlink() and port.is_plugged
    port.send(b"nobody hears this")
    assert port.unheard_bytes == 17
    client = Client(tmp_path / "receiver")
    client.write(b"UNLOGALL\r\nLOG RANGEB ONTIME 1\r\n")
    assert exchange(port, client.read, lambda c: len(c) >= 2 * len(OK)) == 2 * OK
    port.send(b"\x00\x03\x04\x0a\x0d\x11\x13\x1a\x7f\xff")
    content = exchange(port, client.read, lambda c: len(c) >= 10)
    assert content == b"\x00\x03\x04\x0a\x0d\x11\x13\x1a\x7f\xff"
    assert port.unheard_bytes == 17
    client.close()


def test_a_port_wakes_up_for_space_only_while_bytes_wait(make_port, tmp_path):
    port = make_port()
    client = Client(tmp_path / "receiver")
    content = bytes(range(256)) * 20
    port.send(content)
    with selectors.DefaultSelector() as selector:
        selector.register(port, selectors.EVENT_READ)
        while selector.select(0.0):
            port.process()
        assert port.pending_bytes == 0
        assert len(client.read()) > 0
        assert selector.select(0.2) == []
        port.send(20 * content)
        assert port.pending_bytes > 0
        received = exchange(port, client.read, lambda c: port.pending_bytes == 0)
        assert received
        assert selector.select(0.2) == []
    client.close()


@pytest.mark.parametrize("seed", range(5))
def test_logs_arrive_unchanged_in_random_chunks(make_port, tmp_path, seed):
    content = receiver_log(20 + 10 * seed) + random.Random(seed).randbytes(50_000)
    generator = random.Random(seed)
    port = make_port()
    client = Client(tmp_path / "receiver")
    stream, events, received, position = ReceiverLogStream(), [], b"", 0
    deadline = time.monotonic() + PATIENCE
    while len(received) < len(content):
        assert time.monotonic() < deadline
        if position < len(content) and not port.is_congested:
            length = generator.choice((1, 7, 100, 3000, 20000))
            port.send(content[position : position + length])
            position += length
        chunk = client.read(generator.choice((1, 13, 500, 65536)))
        received += chunk
        events += stream.feed(chunk)
        port.process()
    assert received == content
    assert port.dropped_bytes == port.unheard_bytes == 0
    whole = ReceiverLogStream()
    assert len(events + stream.close()) == len(whole.feed(content) + whole.close())
    assert stream.counters == whole.counters
    client.close()


def test_the_client_may_close_and_come_back(make_port, tmp_path):
    port = make_port()
    for _ in range(3):
        client = Client(tmp_path / "receiver")
        client.write(b"ECHO OFF\r\n")
        assert exchange(port, client.read, lambda c: len(c) >= len(OK)) == OK
        port.send(b"x" * 100)
        client.close()
        port.process()
        before = port.unheard_bytes
        port.send(b"nobody hears this")
        assert port.unheard_bytes == before + 17
    # Neither what the last client did not read, nor what was sent to nobody, is there, even for a
    # client that does not flush its input.
    descriptor = os.open(tmp_path / "receiver", os.O_RDWR | os.O_NOCTTY)
    port.send(b"new")
    assert os.read(descriptor, 1000) == b"new"
    os.close(descriptor)


def test_an_absent_client_does_not_keep_the_loop_busy(make_port, tmp_path):
    port = make_port()
    client = Client(tmp_path / "receiver")
    client.close()
    with selectors.DefaultSelector() as selector:
        selector.register(port, selectors.EVENT_READ)
        turns = 0
        while selector.select(0.02):
            port.process()
            turns += 1
            assert turns < 10


def test_unplug_hangs_up_and_plug_comes_back_under_the_same_name(make_port, tmp_path):
    port = make_port(tcp_port=0)
    client = Client(tmp_path / "receiver")
    tcp = socket.create_connection(("127.0.0.1", port.tcp_port), timeout=PATIENCE)
    exchange(port, lambda: b"", lambda c: bool(port._clients))
    port.unplug()
    port.unplug()
    assert not (tmp_path / "receiver").is_symlink() and not port.is_plugged
    with pytest.raises(OSError):
        client.write(b"LOG VERSIONB\r\n")
    assert tcp.recv(10) == b""
    port.send(b"lost")
    assert port.unheard_bytes == 4
    client.close()
    port.plug()
    client = Client(tmp_path / "receiver")
    client.write(b"ECHO OFF\r\n")
    assert exchange(port, client.read, lambda c: len(c) >= len(OK)) == OK
    client.close()
    tcp.close()


def test_tcp_carries_the_same_bytes(make_port, tmp_path):
    port = make_port(tcp_port=0)
    client = Client(tmp_path / "receiver")
    with socket.create_connection(("127.0.0.1", port.tcp_port), timeout=PATIENCE) as tcp:
        tcp.setblocking(False)

        def receive() -> bytes:
            try:
                return tcp.recv(65536)
            except BlockingIOError:
                return b""

        tcp.sendall(b"LOG RANGEB ONTIME 1\r\n")
        assert exchange(port, receive, lambda c: len(c) >= len(OK)) == OK
        assert exchange(port, client.read, lambda c: len(c) >= len(OK)) == OK
        content = random.Random(1).randbytes(300_000)
        port.send(content)
        first = exchange(port, receive, lambda c: len(c) >= len(content))
        second = exchange(port, client.read, lambda c: len(c) >= len(content))
        assert first == second == content
    exchange(port, lambda: b"", lambda c: not port._clients)
    client.close()


def test_a_client_that_does_not_read_costs_bounded_memory(make_port, tmp_path):
    port = make_port()
    client = Client(tmp_path / "receiver")
    block = b"z" * 50_000
    for _ in range(40):
        port.send(block)
        assert port.pending_bytes <= MAXIMUM_PENDING_BYTES
    assert port.is_congested and port.pending_bytes > CONGESTION_BYTES
    assert port.dropped_bytes > 0 and port.dropped_bytes % len(block) == 0
    expected = port.sent_bytes - port.dropped_bytes
    content = exchange(port, client.read, lambda c: len(c) >= expected)
    assert len(content) == expected and not port.is_congested
    client.close()


def test_a_wrong_baud_rate_is_unreadable_in_both_directions(make_port, tmp_path):
    receiver = ReceiverFirmware(baud=115200)
    port = make_port(receiver, checks_baud=True)
    client = Client(tmp_path / "receiver", termios.B9600)
    client.write(b"LOG RANGEB ONTIME 1\r\n")
    port.send(OK)
    noise = exchange(port, client.read, lambda c: len(c) >= len(OK))
    assert noise != OK and receiver.active_logs == ()
    client.close()
    client = Client(tmp_path / "receiver", termios.B115200)
    client.write(b"SERIALCONFIG COM1 460800\r\n")
    # The answer comes at the old rate, what follows at the new one.
    assert exchange(port, client.read, lambda c: len(c) >= len(OK)) == OK
    assert receiver.baud == 460800
    port.send(OK)
    assert exchange(port, client.read, lambda c: len(c) >= len(OK)) != OK
    client.close()


def test_symlinks_are_cleaned_up_and_files_are_not_overwritten(make_port, tmp_path):
    path = tmp_path / "receiver"
    path.symlink_to("/nonexistent/old")
    port = make_port()
    assert os.readlink(path) != "/nonexistent/old"
    port.close()
    assert not path.is_symlink()
    path.write_text("a file")
    with pytest.raises(FileExistsError, match="receiver"):
        make_port()
    assert path.read_text() == "a file"
    path.unlink()
    first, second = make_port(), make_port()
    first.close()
    assert path.is_symlink()  # It is the second one's by now.
    second.close()
    assert list(tmp_path.iterdir()) == []
