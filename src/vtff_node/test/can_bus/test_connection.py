"""A bus that fails, is opened again, and is shared by a receiving and a sending thread."""

import threading

import can
import pytest

from vtff_node.can_bus.connection import FIRST_RETRY, LONGEST_RETRY, BusConnection


class Bus:
    """A bus that fails when it is told to."""

    def __init__(self):
        self.sent, self.is_open = [], True
        self.fails = False

    def send(self, frame, timeout):
        if self.fails:
            raise can.CanOperationError("off")
        self.sent.append(frame)

    def recv(self, timeout):
        if not self.is_open:
            raise ValueError("file descriptor cannot be a negative integer (-1)")
        if self.fails:
            raise OSError("gone")
        return None

    def shutdown(self):
        self.is_open = False


@pytest.fixture
def buses():
    return []


@pytest.fixture
def connection(buses):
    def open_bus():
        buses.append(Bus())
        return buses[-1]

    now = [0.0]
    made = BusConnection(open_bus, lambda: now[0])
    made.wait = lambda seconds: now.__setitem__(0, now[0] + seconds)
    return made


def test_a_bus_that_fails_is_opened_again_after_a_pause(connection, buses):
    for count in range(1, 4):
        assert connection.connect() and connection.problem == "" and len(buses) == count
        buses[-1].fails = True
        connection.send(["frame"], 0.1)
        assert connection.problem == "off" and connection.errors == count
        assert not buses[-1].is_open and not connection.connect()
        connection.wait(0.99 * FIRST_RETRY)
        assert not connection.connect()
        connection.wait(0.02 * FIRST_RETRY)


def test_attempts_that_fail_are_made_more_and_more_seldom(connection):
    def refuse():
        raise OSError("none")

    connection._open_bus, attempts = refuse, []
    for tenth in range(200):
        errors = connection.errors
        connection.connect()
        if connection.errors > errors:
            attempts.append(tenth)
        connection.wait(0.1)
    pauses = [0.1 * (after - before) for before, after in zip(attempts, attempts[1:], strict=False)]
    assert pauses[:5] == sorted(pauses[:5]) and pauses[0] <= 2 * FIRST_RETRY
    assert all(LONGEST_RETRY - 0.01 <= pause <= LONGEST_RETRY + 0.11 for pause in pauses[5:])


def test_a_bus_that_the_other_thread_lost_is_not_lost_twice(connection, buses):
    assert connection.connect()
    buses[0].recv = lambda timeout: (connection.send(["frame"], 0.1), Bus.recv(buses[0], 0.1))
    buses[0].fails = True
    assert connection.receive(0.1) is None  # the send within it has closed the bus
    assert connection.errors == 1 and connection.problem == "off"


def test_an_error_of_an_open_bus_is_not_hidden(connection, buses):
    assert connection.connect()

    def refuse(timeout):
        raise ValueError("no such frame")

    buses[0].recv = refuse
    with pytest.raises(ValueError, match="no such frame"):
        connection.receive(0.1)


def test_two_threads_use_one_bus_that_fails_at_any_time(buses):
    """Each frame is sent on an open bus or counted as an error; nothing escapes a thread."""

    def open_bus():
        buses.append(Bus())
        return buses[-1]

    connection = BusConnection(open_bus, lambda: float(len(buses)) * 1e9)  # always due
    escaped = []

    def use(act):
        try:
            for number in range(3000):
                act(number)
        except Exception as error:
            escaped.append(error)

    def send(number):
        connection.send([number], 0.1)
        if number % 7 == 0 and buses:
            buses[-1].fails = True

    threads = [
        threading.Thread(target=use, args=(act,))
        for act in (send, lambda number: connection.receive(0.0))
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    connection.close()
    assert escaped == [] and not any(bus.is_open for bus in buses)
    assert connection.errors in (len(buses), len(buses) - 1)
