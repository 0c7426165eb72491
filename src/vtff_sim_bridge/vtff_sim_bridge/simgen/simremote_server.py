"""TCP and UDP side of the SimGEN emulator: one thread, a plain selector loop.

Every text command of a connection gets one XML reply, in order. A command ends with CR, LF or
both, or with nothing: what has come is then taken as a command after a short silence, because real
clients do all of this. A client that does not read its replies, or waits for AR, is not read from,
so that nothing grows without bound.
"""

from __future__ import annotations

import logging
import selectors
import socket
import time
from collections import deque
from typing import Protocol

from vtff_sim_bridge.simgen.emulator_state import CommandRefusedError, ScenarioMachine
from vtff_sim_bridge.simremote.language import Reply, SimRemoteSyntaxError, format_reply
from vtff_sim_bridge.simremote.motion import MotionError
from vtff_sim_bridge.simremote.udp_motion import parse_datagram

LOGGER = logging.getLogger("simgen_emulator")

TAIL_SILENCE = 0.020
"""Silence in s after which an unterminated command is complete."""
INTERRUPTION = 2.0
"""Silence in s after which the rest of a client that terminates its commands is a command.

A shorter silence means that the client was interrupted in sending.
"""
MAXIMUM_LINE_BYTES = 16384
"""Longest command; a MOT command has some 500 bytes."""
_RECEIVE_BYTES = 65536
_PORT_ATTEMPTS = 20


class Companion(Protocol):
    """Something else that the loop of the server serves: receivers that follow the scenario."""

    @property
    def is_congested(self) -> bool:
        """Whether the next command has to wait until `process` has done something."""

    def fileno(self) -> int:
        """Return a descriptor that is readable when `process` has something to do."""

    def process(self) -> None:
        """Do what there is to do, without waiting."""


class CommandSplitter:
    """Cuts a byte stream into commands at CR and LF; blank commands are dropped."""

    def __init__(self) -> None:
        self._tail = b""
        self._discarding = False
        self._terminates = False

    @property
    def silence(self) -> float:
        """Silence in s after which what waits is a whole command."""
        return INTERRUPTION if self._terminates else TAIL_SILENCE

    @property
    def has_tail(self) -> bool:
        """Whether bytes wait for the end of their command."""
        return bool(self._tail) or self._discarding

    def feed(self, received: bytes) -> list[bytes]:
        """Return the commands that these bytes complete.

        A command longer than `MAXIMUM_LINE_BYTES` is cut off there, so that it is refused as one
        command when its end comes.
        """
        lines = (self._tail + received).replace(b"\r", b"\n").split(b"\n")
        tail = lines.pop()
        self._terminates |= bool(lines)
        if self._discarding and lines:
            lines[0] = self._tail
            self._discarding = False
        elif self._discarding:
            tail = self._tail
        if len(tail) > MAXIMUM_LINE_BYTES:
            self._discarding = True
            tail = tail[: MAXIMUM_LINE_BYTES + 1]
        self._tail = tail
        return [line for line in lines if line and not line.isspace()]

    def flush(self) -> list[bytes]:
        """Return the unterminated rest as a command."""
        tail, self._tail, self._discarding = self._tail, b"", False
        return [] if not tail or tail.isspace() else [tail]


class _Connection:
    """Connection of one client."""

    def __init__(self, connection: socket.socket, name: str) -> None:
        self.socket = connection
        self.name = name
        self.splitter = CommandSplitter()
        self.commands: deque[bytes] = deque()
        self.outgoing = b""
        self.tail_due: float | None = None
        self.waits_for_reply = False
        self.waits_for_companion = False
        self.ended = False
        self.events = 0

    def seconds_to_tail(self) -> float | None:
        """Return after how many seconds an unterminated command is complete, None if never.

        While the connection is not read from, silence says nothing.
        """
        if self.tail_due is None or self.events != selectors.EVENT_READ:
            return None
        return max(0.0, self.tail_due - time.monotonic())


class SimRemoteServer:
    """Serves a `ScenarioMachine` on a TCP port.

    Parameters
    ----------
    machine : ScenarioMachine
        State machine that carries the commands out.
    host, port : str, int
        Address to listen on; port 0 takes a free one.
    accepts_udp : bool
        Also take binary motion datagrams on the same port number.
    companion : Companion, optional
        Is served by the same loop, and can hold commands back.

    Attributes
    ----------
    port : int
        The port that is listened on.
    command_count, error_count, datagram_count, refused_datagram_count : int
        Text commands, error replies, datagrams, and datagrams that were not carried out.

    Raises
    ------
    OSError
        If the address cannot be listened on.
    """

    def __init__(
        self,
        machine: ScenarioMachine,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        accepts_udp: bool = False,
        companion: Companion | None = None,
    ) -> None:
        self._machine = machine
        self._companion = companion
        self._connections: dict[int, _Connection] = {}
        self._stopping = False
        self.command_count = 0
        self.error_count = 0
        self.datagram_count = 0
        self.refused_datagram_count = 0
        self._listener, self._datagrams = _listening_sockets(host, port, accepts_udp)
        self.port: int = self._listener.getsockname()[1]
        self._selector = selectors.DefaultSelector()
        self._wake_receiver, self._wake_sender = socket.socketpair()
        for waiting in (self._listener, self._datagrams, self._wake_receiver):
            if waiting is not None:
                waiting.setblocking(False)
                self._selector.register(waiting, selectors.EVENT_READ, None)
        self._wake_sender.setblocking(False)
        if companion is not None:
            self._selector.register(companion, selectors.EVENT_READ, None)

    @property
    def wakeup_descriptor(self) -> int:
        """File descriptor to which a signal handler's byte can be written to wake the loop."""
        return self._wake_sender.fileno()

    def serve(self) -> None:
        """Serve until `stop` is called."""
        while not self._stopping:
            self.step(None)

    def stop(self) -> None:
        """Make `serve` return; may be called from a signal handler or another thread."""
        self._stopping = True
        try:
            self._wake_sender.send(b"\0")
        except BlockingIOError:
            # Bytes wait already, so the loop wakes up anyway.
            return

    def close(self) -> None:
        """Close every socket."""
        for connection in list(self._connections.values()):
            self._drop(connection)
        self._selector.close()
        for open_socket in (
            self._listener,
            self._datagrams,
            self._wake_receiver,
            self._wake_sender,
        ):
            if open_socket is not None:
                open_socket.close()

    def step(self, timeout: float | None) -> None:
        """Wait for something to do, at most `timeout` seconds, and do it."""
        for key, events in self._selector.select(self._wait_time(timeout)):
            if key.data is not None:
                if events & selectors.EVENT_WRITE:
                    self._write(key.data)
                else:
                    self._read(key.data)
            elif key.fileobj is self._listener:
                self._accept()
            elif key.fileobj is self._datagrams:
                self._read_datagrams()
            elif self._companion is not None and key.fileobj is self._companion:
                self._companion.process()
            else:
                self._wake_receiver.recv(_RECEIVE_BYTES)
        self._machine.poll()
        self._take_what_is_due()

    def _wait_time(self, timeout: float | None) -> float | None:
        """Return how long the selector may wait."""
        times = [timeout, self._machine.seconds_to_next_change()]
        times += [connection.seconds_to_tail() for connection in self._connections.values()]
        return min((seconds for seconds in times if seconds is not None), default=None)

    def _take_what_is_due(self) -> None:
        """Complete unterminated commands after their silence, and waiting replies."""
        for connection in list(self._connections.values()):
            if connection.seconds_to_tail() == 0.0:
                connection.tail_due = None
                connection.commands.extend(connection.splitter.flush())
                self._carry_out(connection)
            elif connection.waits_for_reply or connection.waits_for_companion:
                self._carry_out(connection)

    def _accept(self) -> None:
        try:
            accepted, address = self._listener.accept()
        except OSError as error:
            LOGGER.warning("a client could not be accepted: %s", error)
            return
        accepted.setblocking(False)
        accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection = _Connection(accepted, f"{address[0]}:{address[1]}")
        self._connections[accepted.fileno()] = connection
        self._listen_to(connection)
        LOGGER.info("client %s connected", connection.name)

    def _drop(self, connection: _Connection) -> None:
        if connection.events:
            self._selector.unregister(connection.socket)
        del self._connections[connection.socket.fileno()]
        connection.socket.close()
        LOGGER.info("client %s disconnected", connection.name)

    def _listen_to(self, connection: _Connection) -> None:
        """Watch a connection for what is needed next: writing, reading, or nothing."""
        if connection.outgoing:
            events = selectors.EVENT_WRITE
        elif connection.waits_for_reply or connection.waits_for_companion or connection.ended:
            events = 0
        else:
            events = selectors.EVENT_READ
        if events == connection.events:
            return
        if connection.events == 0:
            self._selector.register(connection.socket, events, connection)
        elif events == 0:
            self._selector.unregister(connection.socket)
        else:
            self._selector.modify(connection.socket, events, connection)
        connection.events = events

    def _read(self, connection: _Connection) -> None:
        try:
            received = connection.socket.recv(_RECEIVE_BYTES)
        except BlockingIOError:
            return
        except OSError:
            self._drop(connection)
            return
        if received:
            connection.commands.extend(connection.splitter.feed(received))
        else:
            connection.commands.extend(connection.splitter.flush())
            connection.ended = True
        connection.tail_due = None
        self._carry_out(connection)
        # To carry commands out may take longer than the silence, and is none of the client.
        if connection.splitter.has_tail:
            connection.tail_due = time.monotonic() + connection.splitter.silence

    def _carry_out(self, connection: _Connection) -> None:
        """Carry out the commands of a connection up to one whose reply must wait."""
        replies: list[str] = []
        commands = connection.commands
        if connection.waits_for_reply:
            reply = self._machine.deferred_reply()
            if reply is None:
                return
            connection.waits_for_reply = False
            replies.append(self._reply_text(reply))
        connection.waits_for_companion = False
        while commands:
            if self._companion is not None and self._companion.is_congested:
                connection.waits_for_companion = True
                break
            command = commands.popleft()
            reply = self._execute(command)
            if LOGGER.isEnabledFor(logging.DEBUG):
                LOGGER.debug("%s: %r -> %s", connection.name, command, reply)
            if reply is None:
                connection.waits_for_reply = True
                break
            replies.append(self._reply_text(reply))
        if replies:
            connection.outgoing += "".join(replies).encode("ascii", "xmlcharrefreplace")
        self._write(connection)

    def _execute(self, command: bytes) -> Reply | None:
        self.command_count += 1
        if len(command) > MAXIMUM_LINE_BYTES:
            return Reply(
                self._machine.status,
                error_text=f"command: longer than {MAXIMUM_LINE_BYTES} bytes",
            )
        return self._machine.execute(command.decode("ascii", "replace"))

    def _reply_text(self, reply: Reply) -> str:
        if reply.error_text is not None:
            self.error_count += 1
        return format_reply(reply)

    def _write(self, connection: _Connection) -> None:
        if connection.outgoing:
            try:
                sent = connection.socket.send(connection.outgoing)
            except BlockingIOError:
                sent = 0
            except OSError:
                self._drop(connection)
                return
            connection.outgoing = connection.outgoing[sent:]
        waits = connection.waits_for_reply or connection.waits_for_companion
        if connection.ended and not connection.outgoing and not waits:
            self._drop(connection)
        else:
            self._listen_to(connection)

    def _read_datagrams(self) -> None:
        """Carry out one motion datagram; UDP has no replies, so refusals are counted and logged."""
        if self._datagrams is None:
            return
        try:
            datagram = self._datagrams.recv(_RECEIVE_BYTES)
        except OSError:
            return
        self.datagram_count += 1
        try:
            command = parse_datagram(datagram)
            self._machine.poll()
            self._machine.command_motion(
                command.vehicle_id, command.time_nanoseconds, command.motion
            )
        except (SimRemoteSyntaxError, CommandRefusedError, MotionError) as error:
            self.refused_datagram_count += 1
            LOGGER.warning("motion datagram refused: %s", error)


def _listening_sockets(
    host: str, port: int, accepts_udp: bool
) -> tuple[socket.socket, socket.socket | None]:
    """Return a listening TCP socket and, if wanted, a UDP socket on the same port number."""
    for attempts_left in reversed(range(_PORT_ATTEMPTS)):
        listener = socket.create_server((host, port), backlog=16)
        if not accepts_udp:
            return listener, None
        datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            datagrams.bind((host, listener.getsockname()[1]))
        except OSError:
            datagrams.close()
            listener.close()
            # A free TCP port may be taken for UDP; another free one is tried.
            if port != 0 or attempts_left == 0:
                raise
        else:
            return listener, datagrams
    raise AssertionError("unreachable")
