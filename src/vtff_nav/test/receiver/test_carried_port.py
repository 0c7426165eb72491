"""Ports whose bytes a thread in C carries to a pipe, over real pseudo-terminals."""

from __future__ import annotations

import errno
import os
import random
import select
import threading
import time
import tty
from collections.abc import Iterator

import pytest
from receiver_port_support import until

from vtff_nav.receiver import live_port
from vtff_nav.receiver.live_port import (
    PIPE_SIZE,
    CarriedPort,
    PortError,
    live_address,
    load_carry,
    open_port,
)

BAUD = 460800
carry = load_carry()

pytestmark = pytest.mark.skipif(carry is None, reason="there is no C compiler")


class Line:
    """A pseudo-terminal, and a carried port on it."""

    def __init__(self) -> None:
        self.ours, theirs = os.openpty()
        tty.setraw(theirs)
        self.port = CarriedPort(open_port(live_address(os.ttyname(theirs)), BAUD), carry)
        os.close(theirs)
        self.content = b""

    def read(self) -> None:
        self.content += self.port.read()

    def unplug(self) -> None:
        if self.ours >= 0:
            os.close(self.ours)
        self.ours = -1


@pytest.fixture
def line() -> Iterator[Line]:
    made = Line()
    yield made
    made.port.close()
    made.unplug()


def carriers() -> int:
    return sum(thread.name == "port carrier" for thread in threading.enumerate())


def test_all_bytes_come_in_order_however_they_are_sent(line):
    generator = random.Random(5)
    sent = generator.randbytes(1_000_000)

    def send() -> None:
        position = 0
        while position < len(sent):
            position += os.write(line.ours, sent[position : position + generator.randint(1, 5000)])

    sender = threading.Thread(target=send)
    sender.start()
    until(lambda: len(line.content) == len(sent), line.read)
    sender.join()
    assert line.content == sent


def test_what_a_terminal_does_not_hold_is_there_in_one_read(line):
    """A second of a receiver at 20 Hz; the terminal alone gives 4 kB at a read."""
    sent = random.Random(6).randbytes(25_000)
    os.set_blocking(line.ours, False)
    position = 0

    def send() -> None:
        nonlocal position
        try:
            position += os.write(line.ours, sent[position:])
        except BlockingIOError:
            time.sleep(0.001)

    until(lambda: position == len(sent), send)
    until(lambda: select.select([line.port], [], [], 0.0)[0], lambda: time.sleep(0.01))
    time.sleep(0.2)
    assert line.port.read() == sent
    assert line.port.read() == b""


def test_a_line_that_is_lost_tells_so_after_its_last_bytes(line):
    os.write(line.ours, b"last words")
    until(lambda: select.select([line.port], [], [], 0.1)[0], lambda: None)
    line.unplug()

    def read_until_lost() -> bool:
        try:
            line.read()
        except PortError as error:
            assert "was lost" in str(error)
            return True
        return False

    until(read_until_lost, lambda: time.sleep(0.001))
    assert line.content == b"last words"
    assert carriers() == 0


def test_closing_ends_the_thread_also_while_nobody_reads(line):
    assert carriers() == 1
    os.set_blocking(line.ours, False)
    written, quiet_since = 0, time.monotonic()
    while time.monotonic() - quiet_since < 0.2:
        try:
            written += os.write(line.ours, b"x" * 4096)
            quiet_since = time.monotonic()
        except BlockingIOError:
            time.sleep(0.001)
    assert written > PIPE_SIZE // 2, "the thread waits for room in the pipe"
    line.port.close()
    assert carriers() == 0
    line.port.close()


def test_the_other_direction_is_that_of_the_port(line):
    assert line.port.write(b"LOG VERSIONB ONCE\r\n") == 19
    assert os.read(line.ours, 100) == b"LOG VERSIONB ONCE\r\n"
    line.port.set_baud(9600)
    assert line.port.baud == 9600


def test_a_forked_process_that_holds_the_pipe_hides_no_loss(line):
    held = os.dup(line.port._sink)
    line.unplug()

    def is_lost() -> bool:
        try:
            return bool(line.port.read())
        except PortError:
            return True

    until(is_lost, lambda: time.sleep(0.001))
    os.close(held)


def test_closing_waits_for_no_other_holder_of_a_full_pipe(line):
    held = os.dup(line.port.fileno())
    os.set_blocking(line.ours, False)
    quiet_since = time.monotonic()
    while time.monotonic() - quiet_since < 0.2:
        try:
            os.write(line.ours, b"x" * 4096)
            quiet_since = time.monotonic()
        except BlockingIOError:
            time.sleep(0.001)
    line.port.close()
    assert carriers() == 0
    os.close(held)


def test_a_thread_that_ends_is_told(line, monkeypatch):
    """And a port from which nobody carries any more is not readable for ever without a word."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    port = CarriedPort(open_port(live_address(os.ttyname(theirs)), BAUD), lambda *ends: None)
    until(lambda: port._has_ended, lambda: time.sleep(0.001))
    with pytest.raises(PortError, match="its thread has ended"):
        port.read()
    port.close()
    os.close(ours)
    os.close(theirs)


def test_without_descriptors_the_port_is_closed_and_tells(monkeypatch):
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    port = open_port(live_address(os.ttyname(theirs)), BAUD)
    first = os.pipe()
    made = iter([first])

    def pipe() -> tuple[int, int]:
        try:
            return next(made)
        except StopIteration:
            raise OSError(errno.EMFILE, "Too many open files") from None

    monkeypatch.setattr(os, "pipe", pipe)
    with pytest.raises(PortError, match="Too many open files"):
        CarriedPort(port, carry)
    for descriptor in (*first, port.fileno()):
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(descriptor)
    os.close(ours)
    os.close(theirs)


def test_without_a_compiler_there_is_no_function(monkeypatch):
    monkeypatch.setattr(live_port, "load_module_in_c", lambda name, source: None)
    load_carry.cache_clear()
    assert load_carry() is None
    load_carry.cache_clear()
