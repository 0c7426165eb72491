"""Live ports of a receiver: serial lines and TCP connections, whose calls never wait."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import socket
import stat
import termios
from dataclasses import dataclass
from typing import Protocol

import serial

__all__ = [
    "LivePort",
    "PortAddress",
    "PortError",
    "SerialPort",
    "TcpPort",
    "live_address",
    "open_port",
]

READ_LENGTH = 1 << 16

#: Errors that pyserial does not convert; `termios.error` is no OSError.
_LINE_ERRORS = (OSError, ValueError, termios.error)
_GONE = (errno.ENOENT, errno.ENODEV, errno.ENXIO)


class PortError(OSError):
    """A live port cannot be opened or has been lost; the text says why in one line."""


@dataclass(frozen=True)
class PortAddress:
    """Address of a live receiver.

    Parameters
    ----------
    path : str
        Device of a serial line, or a pseudo-terminal; empty for TCP.
    host, tcp_port : str, int
        Address of a TCP port.
    """

    path: str = ""
    host: str = ""
    tcp_port: int = 0

    def __str__(self) -> str:
        return self.path or f"{self.host}:{self.tcp_port}"


class LivePort(Protocol):
    """A live port of a receiver; no method waits."""

    baud: int | None
    """Rate in bit/s; None if the port has no rate."""

    def fileno(self) -> int:
        """Return the descriptor, for a selector."""

    def read(self) -> bytes:
        """Return the bytes that have arrived, maybe none; raise `PortError` if the port is lost."""

    def write(self, content: bytes | bytearray) -> int:
        """Write the bytes that fit, return their number; raise `PortError` if the port is lost."""

    def set_baud(self, baud: int) -> None:
        """Change the rate; raise `PortError` if the port cannot."""

    def close(self) -> None:
        """Close the port; a second call does nothing."""


def live_address(port: str) -> PortAddress | None:
    """Return the address of a live port; None if the name is that of a file.

    Parameters
    ----------
    port
        ``serial://<device>``, ``/dev/...``, the path of any character device (a pseudo-terminal
        or a symlink to one), or ``tcp://<host>:<port>``. With ``serial://`` the device need not
        exist yet.

    Raises
    ------
    ValueError
        If a ``serial://`` or ``tcp://`` name is incomplete.
    """
    scheme, separator, rest = port.partition("://")
    if separator:
        if scheme.lower() == "tcp":
            return _tcp_address(port, rest)
        if scheme.lower() != "serial":
            return None
        if not rest:
            raise ValueError(f"port '{port}' names no device; use serial://<device>")
        return PortAddress(path=rest)
    return PortAddress(path=port) if port.startswith("/dev/") or _is_device(port) else None


def _tcp_address(port: str, rest: str) -> PortAddress:
    host, _, number = rest.rpartition(":")
    host = host.strip("[]")
    if not host or not number.isdecimal() or not 0 < int(number) < 65536:
        raise ValueError(f"port '{port}': use tcp://<host>:<port>")
    return PortAddress(host=host, tcp_port=int(number))


def _is_device(path: str) -> bool:
    try:
        return stat.S_ISCHR(os.stat(path).st_mode)
    except (OSError, ValueError):
        return False


def open_port(address: PortAddress, baud: int) -> LivePort:
    """Open a live port.

    Raises
    ------
    PortError
        If the port cannot be opened now.
    """
    return SerialPort(address.path, baud) if address.path else TcpPort(address)


class SerialPort:
    """A serial line, 8N1 without flow control, or a pseudo-terminal.

    Raises
    ------
    PortError
        If the line cannot be opened, or another program has opened it.
    """

    def __init__(self, path: str, baud: int) -> None:
        self._path = path
        try:
            self._line = serial.Serial(path, baud, timeout=0, write_timeout=0, exclusive=True)
        except _LINE_ERRORS as error:
            raise PortError(f"cannot open {path}: {_describe_error(error)}") from error
        self._descriptor = int(self._line.fileno())
        self.baud: int | None = baud

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._descriptor

    # The descriptor of pyserial does not block; its own read and write would call select first.

    def read(self) -> bytes:
        """Return the bytes that have arrived."""
        try:
            content = os.read(self._descriptor, READ_LENGTH)
        except (BlockingIOError, InterruptedError):
            return b""
        except OSError as error:
            raise PortError(f"{self._path} was lost: {_describe_error(error)}") from error
        # No bytes are read from a device that was unplugged, and from a line that is silent.
        if not content and self._has_hung_up():
            raise PortError(f"{self._path} was lost: the device has gone")
        return content

    def _has_hung_up(self) -> bool:
        poll = select.poll()
        poll.register(self._descriptor, select.POLLIN)
        ended = select.POLLHUP | select.POLLERR | select.POLLNVAL
        return any(events & ended for _, events in poll.poll(0))

    def write(self, content: bytes | bytearray) -> int:
        """Write the bytes that fit."""
        try:
            return os.write(self._descriptor, content)
        except (BlockingIOError, InterruptedError):
            return 0
        except OSError as error:
            raise PortError(f"{self._path} was lost: {_describe_error(error)}") from error

    def set_baud(self, baud: int) -> None:
        """Change the rate of this side."""
        try:
            self._line.baudrate = baud
        except _LINE_ERRORS as error:
            raise PortError(
                f"{self._path}: cannot set {baud} baud: {_describe_error(error)}"
            ) from error
        self.baud = baud

    def close(self) -> None:
        """Close the line; unsent bytes are dropped, because closing would wait for them."""
        if self._line.is_open:
            with contextlib.suppress(*_LINE_ERRORS):
                self._line.reset_output_buffer()
        with contextlib.suppress(*_LINE_ERRORS):
            self._line.close()


class TcpPort:
    """A TCP connection to a receiver or a terminal server, made in the background.

    Raises
    ------
    PortError
        If the host is unknown or refuses at once.
    """

    baud: int | None = None

    def __init__(self, address: PortAddress) -> None:
        self._name = str(address)
        try:
            family, kind, protocol, _, where = socket.getaddrinfo(
                address.host, address.tcp_port, type=socket.SOCK_STREAM
            )[0]
            self._socket = socket.socket(family, kind, protocol)
        except OSError as error:
            raise PortError(f"cannot connect to {self._name}: {_describe_error(error)}") from error
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        code = self._socket.connect_ex(where)
        if code not in (0, errno.EINPROGRESS):
            self._socket.close()
            raise PortError(f"cannot connect to {self._name}: {os.strerror(code)}")

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._socket.fileno()

    def read(self) -> bytes:
        """Return the bytes that have arrived."""
        try:
            content = self._socket.recv(READ_LENGTH)
        except (BlockingIOError, InterruptedError):
            return b""
        except OSError as error:
            # The connection is not established yet.
            if error.errno == errno.ENOTCONN:
                return b""
            raise PortError(f"connection to {self._name}: {_describe_error(error)}") from error
        if not content:
            raise PortError(f"connection to {self._name}: closed by the other side")
        return content

    def write(self, content: bytes | bytearray) -> int:
        """Write the bytes that fit; none before the connection is established."""
        try:
            return self._socket.send(content)
        except (BlockingIOError, InterruptedError):
            return 0
        except OSError as error:
            if error.errno == errno.ENOTCONN:
                return 0
            raise PortError(f"connection to {self._name}: {_describe_error(error)}") from error

    def set_baud(self, baud: int) -> None:
        """Refuse: a TCP connection has no rate."""
        raise PortError(f"connection to {self._name}: has no baud rate")

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()


def _describe_error(error: BaseException) -> str:
    """Return the reason in a few words; pyserial hides the error number of the system."""
    number = getattr(error, "errno", None)
    inner = error.__context__ if number is None else None
    if number is None and isinstance(inner or error, (OSError, termios.error)):
        arguments = (inner or error).args
        number = arguments[0] if arguments and isinstance(arguments[0], int) else None
    if number in _GONE:
        return "no such device"
    if number in (errno.EWOULDBLOCK, errno.EBUSY):
        return "another program uses it"
    if number == errno.ENOTTY:
        return "it is no serial line"
    text = os.strerror(number) if number else str(error)
    return " ".join(text.split())
