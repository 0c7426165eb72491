"""Messages between the parts of a run: JSON objects, one a line, over a TCP connection."""

from __future__ import annotations

import contextlib
import json
import select
import socket
import threading
from typing import Any

from vtff_bringup.run.host_session import HostError

__all__ = ["Channel"]

#: Largest message, bytes. The largest one that is sent has the message counts of all nodes.
LARGEST_MESSAGE = 4 << 20

SEND_LIMIT = 5.0  # s after which a message that cannot be sent ends the connection


class Channel:
    """One connection between two parts; messages may be sent from any thread.

    Parameters
    ----------
    connection
        The connected socket; it is closed with the channel.
    """

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._received = bytearray()
        self._lock = threading.Lock()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, message: dict[str, Any]) -> None:
        """Send a message.

        Raises
        ------
        HostError
            If the connection is gone.
        """
        line = json.dumps(message, default=str).encode() + b"\n"
        try:
            with self._lock:
                self._connection.settimeout(SEND_LIMIT)
                self._connection.sendall(line)
        except OSError as error:
            raise HostError(f"the connection is gone: {error.strerror or error}") from error

    def receive(self, timeout: float | None = None) -> dict[str, Any]:
        """Return the next message.

        Parameters
        ----------
        timeout
            Longest wait in s; None for no limit.

        Raises
        ------
        HostError
            If the connection is gone, no message comes in time, or it is none of vtff.
        """
        while b"\n" not in self._received:
            if len(self._received) > LARGEST_MESSAGE:
                raise HostError("a message is too long")
            content = self._receive_bytes(timeout)
            if not content:
                raise HostError("the connection was closed")
            self._received += content
        line, _, rest = bytes(self._received).partition(b"\n")
        self._received = bytearray(rest)
        try:
            message = json.loads(line)
        except (ValueError, RecursionError):
            message = None
        if not isinstance(message, dict):
            raise HostError("what came is no message of vtff")
        return message

    def wait(self, timeout: float) -> bool:
        """Return whether there is something to receive within a time, s."""
        if b"\n" in self._received:
            return True
        with contextlib.suppress(OSError, ValueError):
            return bool(select.select([self._connection], [], [], timeout)[0])
        return True  # `receive` tells what is wrong

    def _receive_bytes(self, timeout: float | None) -> bytes:
        # The time-out of the socket belongs to `send`, which may run in another thread.
        try:
            if not select.select([self._connection], [], [], timeout)[0]:
                raise HostError(f"no answer within {timeout:g} s")
            return self._connection.recv(65536)
        except (OSError, ValueError) as error:
            raise HostError(f"the connection is gone: {error}") from error

    def close(self) -> None:
        """Close the connection; a thread that receives from it is woken."""
        with contextlib.suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)
        self._connection.close()
