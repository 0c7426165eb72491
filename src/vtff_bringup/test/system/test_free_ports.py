"""Ports for emulators: free for TCP and UDP, and none that the system gives to other sockets."""

import socket

import pytest

from vtff_bringup.system import free_ports
from vtff_bringup.system.free_ports import choose_free_port


@pytest.fixture
def three_ports(monkeypatch):
    """Leave three ports to choose from."""
    ports = sorted({choose_free_port() for _ in range(50)})[:3]
    monkeypatch.setattr(free_ports, "_UPPER_PORTS", ports)
    return ports


@pytest.mark.parametrize("kind", [socket.SOCK_STREAM, socket.SOCK_DGRAM])
@pytest.mark.parametrize("address", ["127.0.0.1", ""])
def test_a_port_of_another_program_is_not_chosen(three_ports, kind, address):
    occupied, first, second = three_ports
    with socket.socket(socket.AF_INET, kind) as other:
        other.bind((address, occupied))
        if kind == socket.SOCK_STREAM:
            other.listen()
        assert {choose_free_port() for _ in range(50)} == {first, second}


def test_ports_of_a_run_differ(three_ports):
    first = choose_free_port()
    second = choose_free_port([first])
    third = choose_free_port([first, second])
    assert {first, second, third} == set(three_ports)
    assert choose_free_port(three_ports) not in three_ports


def test_no_port_is_one_that_any_socket_may_get():
    """A process of the run could get it for a socket of its own before the emulator opens it."""
    automatic = free_ports._automatic_ports()
    if set(free_ports._UPPER_PORTS) <= set(automatic):
        pytest.skip("this system gives every upper port to sockets")
    assert all(choose_free_port() not in automatic for _ in range(20))


def test_a_system_that_gives_every_port_away_still_has_one(monkeypatch):
    monkeypatch.setattr(free_ports, "_automatic_ports", lambda: range(65536))
    assert 0 < choose_free_port() < 65536
