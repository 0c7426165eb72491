"""The session against emulated receivers behind real pseudo-terminals and TCP ports."""

from __future__ import annotations

import os
import random
import select
import socket
import threading
import time
import tty

import pytest
from encoder_test_support import receiver_log
from receiver_port_support import (
    COMMANDS,
    Outputs,
    epoch_time,
    serving,
    until,
)
from shared_data import require_shared

from vtff_gnss.novatel import CommandResponse, ReceiverLogStream, read_log
from vtff_gnss.observations import ObservationEpoch
from vtff_nav.receiver.live_port import PortError, live_address, open_port
from vtff_nav.receiver.port_watch import PortWatch
from vtff_nav.receiver.receiver_session import ReceiverSession, SessionSettings
from vtff_sim_bridge.receiver.receiver_firmware import ReceiverFirmware

BAUD = 460800


class Driver:
    """A session on a named port, driven by the wall clock."""

    def __init__(self, name: str, commands=COMMANDS, **settings):
        address = live_address(name)
        self.stream = ReceiverLogStream()
        self.events = []
        self.session = ReceiverSession(
            lambda: open_port(address, BAUD),
            self.stream,
            SessionSettings(commands=commands, shortest_pause=0.02, longest_pause=0.1, **settings),
        )

    def advance(self) -> None:
        self.events += self.session.advance(time.monotonic())

    @property
    def epoch_times(self):
        return [e.time for e in self.events if isinstance(e, ObservationEpoch)]


@pytest.fixture
def link(tmp_path):
    return tmp_path / "receiver"


def names(link, served):
    return {"pty": f"serial://{link}", "tcp": f"tcp://127.0.0.1:{served.port.tcp_port}"}


@pytest.mark.parametrize("kind", ["pty", "tcp"])
def test_configure_and_read(link, kind):
    with serving(ReceiverFirmware(baud=BAUD), symlink=link, tcp_port=0) as served:
        driver = Driver(names(link, served)[kind])
        until(lambda: driver.session.is_running, driver.advance)
        assert len(served.receiver.active_logs) == 3
        served.advance(40, Outputs(signals=36))
        until(lambda: len(driver.epoch_times) == 40, driver.advance)
        assert driver.epoch_times == [epoch_time(number) for number in range(40)]
        assert driver.stream.counters.frames_crc_bad == 0
        assert driver.session.baud == (BAUD if kind == "pty" else None)
        driver.session.close()


@pytest.mark.parametrize("kind", ["pty", "tcp"])
def test_unplugged_and_plugged_in_again(link, kind):
    with serving(ReceiverFirmware(baud=BAUD), symlink=link, tcp_port=0) as served:
        driver = Driver(names(link, served)[kind])
        until(lambda: driver.session.is_running, driver.advance)
        with served.lock:
            served.port.unplug()
        until(lambda: driver.session.problem, driver.advance)
        until(lambda: "open" in driver.session.problem or kind == "tcp", driver.advance)
        with served.lock:
            served.port.plug()
        until(lambda: driver.session.is_running, driver.advance)
        served.advance(3, Outputs())
        until(lambda: len(driver.epoch_times) == 3, driver.advance)
        assert driver.session.reconnects >= 1
        assert driver.session.configurations >= 2
        driver.session.close()


def test_power_cycle_at_the_factory_rate(link):
    with serving(ReceiverFirmware(baud=9600), symlink=link, checks_baud=True) as served:
        driver = Driver(str(link), command_timeout=0.1, receiver_timeout=0.3)
        until(lambda: driver.session.is_running, driver.advance)
        assert served.receiver.baud == BAUD
        with served.lock:
            served.port.send(served.receiver.power_cycle())
        assert (served.receiver.baud, served.receiver.active_logs) == (9600, ())
        until(lambda: driver.session.configurations == 2, driver.advance)
        assert served.receiver.baud == BAUD
        served.advance(3, Outputs())
        until(lambda: len(driver.epoch_times) == 3, driver.advance)
        driver.session.close()


def test_the_port_appears_later(link):
    driver = Driver(f"serial://{link}")
    for _ in range(5):
        driver.advance()
    assert driver.session.problem == f"cannot open {link}: no such device"
    with serving(ReceiverFirmware(baud=BAUD), symlink=link):
        until(lambda: driver.session.is_running, driver.advance)
        driver.session.close()


def test_a_port_in_use_is_named(link):
    with serving(ReceiverFirmware(baud=BAUD), symlink=link):
        first = open_port(live_address(str(link)), BAUD)
        with pytest.raises(PortError, match="another program uses it"):
            open_port(live_address(str(link)), BAUD)
        first.close()
        first.close()


def test_a_refused_connection_is_named():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        number = listener.getsockname()[1]
    driver = Driver(f"tcp://127.0.0.1:{number}")
    until(lambda: driver.session.problem, driver.advance)
    assert driver.session.problem == f"connection to 127.0.0.1:{number}: Connection refused" or (
        driver.session.problem == f"cannot connect to 127.0.0.1:{number}: Connection refused"
    )


def test_a_device_that_is_no_serial_line_is_named():
    with pytest.raises(PortError, match="cannot open /dev/null: it is no serial line"):
        open_port(live_address("/dev/null"), BAUD)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("/dev/ttyUSB7", "/dev/ttyUSB7"),
        ("serial://ports/chief", "ports/chief"),
        ("SERIAL:///dev/ttyS0", "/dev/ttyS0"),
        ("tcp://192.0.2.1:3001", "192.0.2.1:3001"),
        ("tcp://[2001:db8::1]:3001", "2001:db8::1:3001"),
        ("file:///dev/ttyS0", "None"),
        ("receiver.gps", "None"),
        ("udp://192.0.2.1:1", "None"),
        ("", "None"),
    ],
)
def test_names_of_ports(name, expected):
    assert str(live_address(name)) == expected


@pytest.mark.parametrize(
    "name", ["tcp://host", "tcp://:1", "tcp://host:0", "tcp://h:70000", "serial://"]
)
def test_incomplete_names_are_refused(name):
    with pytest.raises(ValueError, match="use (tcp|serial)://"):
        live_address(name)


def test_the_path_of_a_device_is_live(link):
    assert live_address(str(link)) is None
    with serving(ReceiverFirmware(), symlink=link):
        assert live_address(str(link)).path == str(link)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_log_through_a_pseudo_terminal_is_what_it_is_from_file(tmp_path, seed):
    path = tmp_path / "receiver.gps"
    path.write_bytes(receiver_log(100))
    events = assert_through_pseudo_terminal(path, seed)
    assert sum(isinstance(event, ObservationEpoch) for event in events) >= 100


def test_real_logs_through_a_pseudo_terminal_are_what_they_are_from_file():
    folder = require_shared("data/oem")
    assert all(live_address(str(path)) is None for path in folder.iterdir())
    for name in ("gavlab_test2_rcvr2.dat", "rtklib_oemv_200911218.gps"):
        for seed in (1, 2):
            assert_through_pseudo_terminal(require_shared(f"data/oem/{name}"), seed)


def assert_through_pseudo_terminal(path, seed):
    """Send a file in pieces through a pseudo-terminal; return what the driver made of it."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    driver = Driver(os.ttyname(theirs), commands=(), receiver_timeout=3600.0)
    driver.advance()
    content, generator = path.read_bytes(), random.Random(seed)

    def send() -> None:
        position = 0
        while position < len(content):
            end = position + generator.randint(1, 3000)
            position += os.write(ours, content[position:end])

    sender = threading.Thread(target=send)
    sender.start()
    until(lambda: driver.session.bytes_received == len(content), driver.advance)
    sender.join()
    driver.events += driver.stream.close()
    driver.session.close()
    os.close(ours)
    os.close(theirs)
    expected = [event for event in read_log(path) if not isinstance(event, CommandResponse)]
    assert driver.events == expected
    return driver.events


def test_the_watch_wakes_once_until_it_is_armed_again():
    ours, theirs = os.pipe()
    woken = threading.Semaphore(0)
    watch = PortWatch(woken.release)
    watch.watch(ours)
    os.write(theirs, b"x")
    assert woken.acquire(timeout=10.0)
    assert not woken.acquire(timeout=0.05)
    watch.arm()
    assert woken.acquire(timeout=10.0)
    os.read(ours, 1)
    watch.arm()
    assert not woken.acquire(timeout=0.05)
    watch.watch(None)
    watch.close()
    watch.close()
    os.close(ours)
    os.close(theirs)


def test_a_slow_receiver_is_read_as_it_comes(link):
    """With a baud limit the bytes of an epoch come with later ones, but all come."""
    receiver = ReceiverFirmware(baud=BAUD, limits_baud=True)
    with serving(receiver, symlink=link) as served:
        driver = Driver(str(link))
        until(lambda: driver.session.is_running, driver.advance)
        served.advance(200, Outputs(signals=36))
        until(lambda: len(driver.epoch_times) >= 198, driver.advance)
        assert driver.epoch_times == [epoch_time(n) for n in range(len(driver.epoch_times))]
        assert driver.stream.counters.frames_crc_bad == 0
        driver.session.close()


def test_closing_does_not_wait_for_bytes_that_nobody_reads():
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    port = open_port(live_address(os.ttyname(theirs)), BAUD)
    while port.write(b"x" * 4096):
        pass
    port.close()
    assert select.select([ours], [], [], 0)[0] in ([], [ours])
    os.close(ours)
    os.close(theirs)
