"""The emulated CAN bus: frames cross between programs of this machine and reach no other one."""

from __future__ import annotations

import socket

import can
import pytest

from vtff_node.can_bus.loopback import LoopbackCanBus

GROUP = "239.74.163.2"


@pytest.fixture
def port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_frames_cross_in_order(port):
    with LoopbackCanBus(GROUP, port) as first, LoopbackCanBus(GROUP, port) as second:
        for number in range(5):
            first.send(can.Message(arbitration_id=number, data=[number], is_extended_id=False))
        received = [second.recv(5.0) for _ in range(5)]
    assert [(frame.arbitration_id, bytes(frame.data)) for frame in received] == [
        (number, bytes([number])) for number in range(5)
    ]


def test_nothing_listens_on_other_interfaces(port):
    """A datagram to an address of this machine does not reach the bus, as it did."""
    with LoopbackCanBus(GROUP, port) as bus:
        assert bus._multicast._socket.getsockname() == (GROUP, port)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(b"x", ("127.0.0.1", port))
        assert bus.recv(0.2) is None


@pytest.mark.parametrize("group", ["ff15:7079:7468:6f6e:6465:6d6f:6d63:6173", "127.0.0.1"])
def test_another_address_is_refused(group, port):
    with pytest.raises(can.CanInitializationError):
        LoopbackCanBus(group, port)
