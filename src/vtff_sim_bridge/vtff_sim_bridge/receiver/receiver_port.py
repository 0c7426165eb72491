"""Ports of an emulated receiver: a pseudo-terminal with a stable name, and TCP, with one content.

A `ReceiverPort` waits for nothing. It has one file descriptor, so that any selector loop can watch
it: ``selector.register(port, selectors.EVENT_READ)``, and `process` when it is readable.
"""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import pathlib
import select
import socket
import termios
import tty

from vtff_sim_bridge.receiver.receiver_firmware import ReceiverFirmware

LOGGER = logging.getLogger("simgen_emulator")

MAXIMUM_PENDING_BYTES = 1 << 20
"""Most bytes that wait for one client; what does not fit is dropped."""
CONGESTION_BYTES = 1 << 16
"""Waiting bytes of one client above which a port is congested."""
_READ_BYTES = 65536
# Edge-triggered, because the absence of a client is a state that lasts.
_TERMINAL_EVENTS = select.EPOLLIN | select.EPOLLET
_BAUD_BY_CODE = {
    getattr(termios, name): int(name[1:])
    for name in dir(termios)
    if name[0] == "B" and name[1:].isdigit()
}


class _PseudoTerminal:
    """The receiver's side of a pseudo-terminal whose other side is named by a symlink.

    The other side is held by nobody but the client. So its absence shows as a hang-up, what is
    sent then goes nowhere, as on a serial line, and nothing old waits for the next client.
    """

    def __init__(self, path: pathlib.Path) -> None:
        self._path = path
        self.descriptor, client_side = os.openpty()
        self._client_name = os.ttyname(client_side)
        tty.setraw(client_side)
        os.close(client_side)
        os.set_blocking(self.descriptor, False)
        self._poll = select.poll()
        self._poll.register(self.descriptor, 0)
        try:
            self._link()
        except OSError:
            os.close(self.descriptor)
            raise

    def _link(self) -> None:
        if self._path.exists() and not self._path.is_symlink():
            raise FileExistsError(errno.EEXIST, "is there and is no symlink", str(self._path))
        new = self._path.with_name(f".{self._path.name}.{os.getpid()}")
        new.unlink(missing_ok=True)
        new.symlink_to(self._client_name)
        new.replace(self._path)

    @property
    def has_client(self) -> bool:
        """Whether somebody has the other side open."""
        return not self._poll.poll(0)

    def baud(self) -> int | None:
        """Return the rate that the client has set, None for one without a name."""
        return _BAUD_BY_CODE.get(termios.tcgetattr(self.descriptor)[5])

    def read(self) -> bytes:
        """Return what the client has written; nothing if it is gone."""
        try:
            return os.read(self.descriptor, _READ_BYTES)
        except (BlockingIOError, InterruptedError):
            return b""
        except OSError as error:
            if error.errno == errno.EIO:
                return b""
            raise

    def write_all(self, content: bytes | bytearray) -> int:
        """Write as much as fits; return how much that is."""
        with memoryview(content) as view:
            written = 0
            while written < len(content):
                try:
                    written += os.write(self.descriptor, view[written:])
                except (BlockingIOError, InterruptedError):
                    break
        return written

    def forget(self) -> None:
        """Throw away what the last client did not read, and its line settings."""
        client_side = os.open(self._client_name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            tty.setraw(client_side, termios.TCSANOW)
            termios.tcflush(client_side, termios.TCIOFLUSH)
        finally:
            os.close(client_side)

    def close(self) -> None:
        """Hang up; remove the symlink if it is still ours."""
        with contextlib.suppress(OSError):
            if os.readlink(self._path) == self._client_name:
                self._path.unlink()
        os.close(self.descriptor)


class ReceiverPort:
    """Serves one emulated receiver over a pseudo-terminal, over TCP, or both.

    All clients get the same bytes, and each may send commands. What a client does not take waits
    for it up to `MAXIMUM_PENDING_BYTES`; in lockstep go on only while `is_congested` is False, then
    nothing is ever dropped.

    Parameters
    ----------
    receiver : ReceiverFirmware
        Receiver that obeys the commands.
    symlink : path-like, optional
        Name that a driver opens; no pseudo-terminal without it. An old symlink is replaced.
    tcp_host, tcp_port : str, int
        Address to listen on; port 0 takes a free one, None listens on none.
    checks_baud : bool
        Make bytes unreadable in both directions while the client of the pseudo-terminal has set
        another rate than the receiver.

    Attributes
    ----------
    tcp_port : int or None
        The TCP port that is listened on.
    sent_bytes, dropped_bytes, unheard_bytes : int
        Bytes taken by `send`; bytes of it that a client was too slow for; bytes that were sent
        while nobody listened.

    Raises
    ------
    OSError
        If the symlink cannot be made or the address cannot be listened on.
    """

    def __init__(
        self,
        receiver: ReceiverFirmware,
        symlink: str | os.PathLike[str] | None = None,
        *,
        tcp_host: str = "127.0.0.1",
        tcp_port: int | None = None,
        checks_baud: bool = False,
    ) -> None:
        self._receiver = receiver
        self._symlink = None if symlink is None else pathlib.Path(symlink)
        self._checks_baud = checks_baud
        self.sent_bytes = 0
        self.dropped_bytes = 0
        self.unheard_bytes = 0
        self._terminal: _PseudoTerminal | None = None
        self._terminal_pending = bytearray()
        self._had_client = False
        self._waits_for_space = False
        self._clients: dict[int, tuple[socket.socket, bytearray]] = {}
        self._listener: socket.socket | None = None
        self._epoll = select.epoll()
        try:
            if tcp_port is not None:
                self._listener = socket.create_server((tcp_host, tcp_port), backlog=4)
                self._listener.setblocking(False)
                self._epoll.register(self._listener.fileno(), select.EPOLLIN)
            self.plug()
        except OSError:
            self.close()
            raise
        self.tcp_port = None if self._listener is None else self._listener.getsockname()[1]

    def fileno(self) -> int:
        """Return a descriptor that is readable when `process` has something to do."""
        return self._epoll.fileno()

    @property
    def is_plugged(self) -> bool:
        """Whether the cable of the pseudo-terminal is plugged in."""
        return self._terminal is not None

    @property
    def pending_bytes(self) -> int:
        """Bytes that wait for the slowest client."""
        pending = [len(waiting) for _, waiting in self._clients.values()]
        return max([*pending, len(self._terminal_pending)])

    @property
    def is_congested(self) -> bool:
        """Whether a client is so slow that the caller should wait for it, if it can."""
        return self.pending_bytes > CONGESTION_BYTES

    def plug(self) -> None:
        """Plug the cable in: make the pseudo-terminal and its symlink; nothing if plugged.

        Raises
        ------
        OSError
            If the symlink cannot be made.
        """
        if self._terminal is None and self._symlink is not None:
            self._terminal = _PseudoTerminal(self._symlink)
            self._epoll.register(self._terminal.descriptor, _TERMINAL_EVENTS)

    def unplug(self) -> None:
        """Pull the cable: clients are hung up, the symlink goes away; nothing if not plugged."""
        for descriptor in list(self._clients):
            self._drop(descriptor)
        if self._terminal is not None:
            self._epoll.unregister(self._terminal.descriptor)
            self._terminal.close()
            self._terminal = None
        self._waits_for_space = False
        self._terminal_pending.clear()
        self._had_client = False

    def close(self) -> None:
        """Close everything and remove the symlink."""
        self.unplug()
        if self._listener is not None:
            self._listener.close()
        self._epoll.close()

    def send(self, content: bytes) -> None:
        """Send bytes to every client, as far as they take them now; the rest waits."""
        self._send(content, self._receiver.baud)

    def _send(self, content: bytes, baud: int) -> None:
        if not content:
            return
        self.sent_bytes += len(content)
        is_heard = bool(self._clients)
        for descriptor in list(self._clients):
            self._put(self._clients[descriptor][1], content)
            self._write_client(descriptor)
        if self._terminal is not None:
            self._notice_client(self._terminal)
            if self._had_client:
                is_heard = True
                self._send_on_terminal(self._terminal, self._on_line(content, baud))
        if not is_heard:
            self.unheard_bytes += len(content)

    def _send_on_terminal(self, terminal: _PseudoTerminal, content: bytes) -> None:
        if self._terminal_pending:
            self._put(self._terminal_pending, content)
            self._write_terminal(terminal)
            return
        written = terminal.write_all(content)
        self._put(self._terminal_pending, content[written:])
        self._watch_space(terminal)

    def send_waiting(self) -> None:
        """Send what waits for the client of the pseudo-terminal, as far as it takes it now."""
        if self._terminal is not None and self._terminal_pending:
            self._write_terminal(self._terminal)

    def process(self) -> None:
        """Do what is to be done: take clients and commands, send answers and what waits."""
        for descriptor, events in self._epoll.poll(0):
            if self._listener is not None and descriptor == self._listener.fileno():
                self._accept()
            elif descriptor in self._clients:
                if events & ~select.EPOLLOUT:
                    self._read_client(descriptor)
                if descriptor in self._clients:
                    self._write_client(descriptor)
            elif self._terminal is not None and descriptor == self._terminal.descriptor:
                if events & ~select.EPOLLOUT:
                    self._serve_terminal(self._terminal)
                self._write_terminal(self._terminal)

    def _serve_terminal(self, terminal: _PseudoTerminal) -> None:
        while content := terminal.read():
            self._had_client = True
            if not self._is_other_baud(self._receiver.baud):
                self._obey(content)
        self._notice_client(terminal)

    def _notice_client(self, terminal: _PseudoTerminal) -> None:
        has_client = terminal.has_client
        if self._had_client and not has_client:
            self._terminal_pending.clear()
            terminal.forget()
            LOGGER.info("%s: the client has gone", self._symlink)
        self._had_client = has_client

    def _is_other_baud(self, baud: int) -> bool:
        return self._checks_baud and self._terminal is not None and self._terminal.baud() != baud

    def _on_line(self, content: bytes, baud: int) -> bytes:
        """Return what the client of the pseudo-terminal samples, at its own rate."""
        if not self._is_other_baud(baud):
            return content
        return bytes((byte * 167 + 0x80 + position) & 0xFF for position, byte in enumerate(content))

    def _obey(self, content: bytes) -> None:
        # The answer to a change of the baud rate still comes at the old one.
        baud = self._receiver.baud
        self._send(self._receiver.receive(content), baud)

    def _put(self, pending: bytearray, content: bytes) -> None:
        if len(pending) + len(content) > MAXIMUM_PENDING_BYTES:
            self.dropped_bytes += len(content)
        else:
            pending += content

    def _write_terminal(self, terminal: _PseudoTerminal) -> None:
        """Write what waits; what does not fit now is written when there is space."""
        if self._terminal_pending:
            del self._terminal_pending[: terminal.write_all(self._terminal_pending)]
        self._watch_space(terminal)

    def _watch_space(self, terminal: _PseudoTerminal) -> None:
        waits = bool(self._terminal_pending)
        if waits != self._waits_for_space:
            self._waits_for_space = waits
            space = select.EPOLLOUT if waits else 0
            self._epoll.modify(terminal.descriptor, _TERMINAL_EVENTS | space)

    def _accept(self) -> None:
        if self._listener is None:
            return
        try:
            client, address = self._listener.accept()
        except OSError as error:
            LOGGER.warning("a receiver client could not be accepted: %s", error)
            return
        if self._symlink is not None and self._terminal is None:
            client.close()
            return
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._clients[client.fileno()] = (client, bytearray())
        self._epoll.register(client.fileno(), select.EPOLLIN)
        LOGGER.info("receiver client %s:%s connected", *address[:2])

    def _drop(self, descriptor: int) -> None:
        client, _ = self._clients.pop(descriptor)
        self._epoll.unregister(descriptor)
        client.close()

    def _read_client(self, descriptor: int) -> None:
        try:
            content = self._clients[descriptor][0].recv(_READ_BYTES)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            self._drop(descriptor)
            return
        if content:
            self._obey(content)
        else:
            self._drop(descriptor)

    def _write_client(self, descriptor: int) -> None:
        client, pending = self._clients[descriptor]
        try:
            while pending:
                del pending[: client.send(pending)]
        except (BlockingIOError, InterruptedError):
            self._epoll.modify(descriptor, select.EPOLLIN | select.EPOLLOUT)
            return
        except OSError:
            self._drop(descriptor)
            return
        self._epoll.modify(descriptor, select.EPOLLIN)
