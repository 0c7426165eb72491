"""The UDP multicast bus of python-can on the loopback interface: its frames stay on this machine.

`can.Bus` with the interface ``udp_multicast`` listens on every interface of the machine, so that
any machine of the network could command an emulated thruster.
"""

from __future__ import annotations

import socket
import struct

import can
from can.interfaces.udp_multicast.bus import GeneralPurposeUdpMulticastBus, UdpMulticastBus

__all__ = ["LoopbackCanBus"]

DEFAULT_PORT = 43113  # that of python-can

_LOOPBACK = socket.inet_aton("127.0.0.1")
#: Options of ip(7) and socket(7) that Python does not name.
_IP_MULTICAST_ALL = 49
_SO_TIMESTAMPNS = 35


class LoopbackCanBus(UdpMulticastBus):
    """A CAN bus over UDP multicast that only programs of this machine reach.

    Frames are those of ``udp_multicast`` of python-can.

    Parameters
    ----------
    group
        IPv4 address of the multicast group.
    port
        UDP port; 0 for python-can's default.

    Raises
    ------
    can.CanInitializationError
        If the socket cannot be made.
    """

    def __init__(self, group: str, port: int = 0) -> None:
        # Not that of UdpMulticastBus, which would open a socket on every interface.
        can.BusABC.__init__(self, group)
        self._can_protocol = can.CanProtocol.CAN_20
        self._multicast = _LoopbackSocket(group, port or DEFAULT_PORT, hop_limit=0)


class _LoopbackSocket(GeneralPurposeUdpMulticastBus):
    """Sends to a group, and receives what was sent to it, on the loopback interface."""

    def _create_socket(self, address_family: socket.AddressFamily) -> socket.socket:
        if address_family != socket.AF_INET:
            raise can.CanInitializationError(f"{self.group} is no IPv4 multicast group")
        loopback_socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            loopback_socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            loopback_socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
            loopback_socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
            self.timestamp_nanosecond = True
            hop_limit = struct.pack("@I", self.hop_limit)
            loopback_socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, hop_limit)
            loopback_socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, _LOOPBACK)
            loopback_socket.bind((self.group, self.port))
            membership = socket.inet_aton(self.group) + _LOOPBACK
            loopback_socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
            # Not what comes to this group by another interface, which another program joined.
            loopback_socket.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)
        except OSError as error:
            loopback_socket.close()
            raise can.CanInitializationError(
                f"{self.group}:{self.port}: {error.strerror}"
            ) from error
        return loopback_socket
