"""Client of SimGEN's remote control: commands with time-outs, pipelined motion, reconnection."""

from __future__ import annotations

import logging
import socket
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_sim_bridge.simremote.language import (
    DEFAULT_PORT,
    Reply,
    SimGenStatus,
    SimRemoteSyntaxError,
    format_calendar,
    format_duration,
    format_motion,
    parse_reply,
)
from vtff_sim_bridge.simremote.motion import MotionState

LOGGER = logging.getLogger("simremote_client")

_REPLY_END = b"</msg>"
_MAXIMUM_REPLY_BYTES = 1 << 20


class SimRemoteError(Exception):
    """The simulator refused a command or gave no usable reply; the message names the command."""


class SimRemoteConnectionError(SimRemoteError):
    """There is no connection to the simulator, or it was lost; `reconnect` may help."""


class SimRemoteTimeoutError(SimRemoteConnectionError):
    """The simulator did not answer in time.

    The connection is closed then, because later replies could no longer be matched.
    """


@dataclass
class ClientCounters:
    """Numbers of commands, replies, errors and connections since the client was made."""

    sent: int = 0
    replies: int = 0
    errors: int = 0
    connection_losses: int = 0
    reconnects: int = 0


class SimRemoteClient:
    """One connection to SimGEN (or its emulator).

    Parameters
    ----------
    host, port : str, int
        Address of the simulator.
    timeout : float
        Longest wait for a reply and for one attempt to connect, s.
    arm_timeout : float
        Longest wait for the reply to AR and to a RU that arms, s; a real unit takes 25 to 40 s.
    reconnect_delay_initial, reconnect_delay_maximum : float
        Wait between attempts to connect, s: doubled each time up to the maximum.
    line_ending : str
        Text that ends a command.
    monotonic, sleep : callable
        Wall clock in s and how to wait for it.

    Attributes
    ----------
    timeout : float
        As given; it may be changed at any time.
    counters : ClientCounters
    """

    def __init__(
        self,
        host: str,
        port: int = DEFAULT_PORT,
        timeout: float = 1.0,
        *,
        arm_timeout: float = 40.0,
        reconnect_delay_initial: float = 0.1,
        reconnect_delay_maximum: float = 2.0,
        line_ending: str = "\n",
        monotonic: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._address = (host, port)
        self.timeout = timeout
        self._arm_timeout = arm_timeout
        self._delay_initial = reconnect_delay_initial
        self._delay_maximum = reconnect_delay_maximum
        self._line_ending = line_ending
        self._monotonic = monotonic
        self._sleep = sleep
        self._socket: socket.socket | None = None
        self._received = bytearray()
        self._unanswered: deque[str] = deque()
        self._was_connected = False
        self._next_attempt = 0.0
        self._delay = reconnect_delay_initial
        self.counters = ClientCounters()

    @property
    def is_connected(self) -> bool:
        """Whether there is a connection, as far as is known without using it."""
        return self._socket is not None

    @property
    def outstanding(self) -> int:
        """Number of commands sent whose replies have not been received."""
        return len(self._unanswered)

    def __enter__(self) -> SimRemoteClient:
        """Connect."""
        self.connect()
        return self

    def __exit__(self, *_: object) -> None:
        """Close the connection."""
        self.close()

    def connect(self, timeout: float = 10.0) -> None:
        """Connect, trying again with growing waits; at once if connected already.

        Raises
        ------
        SimRemoteConnectionError
            If no attempt succeeds within `timeout` seconds.
        """
        deadline = self._monotonic() + timeout
        while not self.try_connect():
            now = self._monotonic()
            if self._next_attempt > deadline:
                host, port = self._address
                raise SimRemoteConnectionError(
                    f"no simulator answers at {host}:{port} within {timeout:g} s"
                )
            self._sleep(max(0.0, self._next_attempt - now))

    def reconnect(self, timeout: float = 10.0) -> None:
        """Drop the connection and the unanswered commands, and connect as `connect` does."""
        self.close()
        self.connect(timeout)

    def try_connect(self) -> bool:
        """Attempt once to connect if an attempt is due; return whether there is a connection.

        A caller that must not block for long calls this once per step instead of `connect`.
        """
        if self._socket is not None:
            return True
        if self._monotonic() < self._next_attempt:
            return False
        try:
            connection = socket.create_connection(self._address, timeout=self.timeout)
        except OSError as error:
            LOGGER.debug("no connection to %s:%d: %s", *self._address, error)
            self._next_attempt = self._monotonic() + self._delay
            self._delay = min(2.0 * self._delay, self._delay_maximum)
            return False
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket = connection
        self._delay = self._delay_initial
        if self._was_connected:
            self.counters.reconnects += 1
            LOGGER.warning("connected to %s:%d again", *self._address)
        self._was_connected = True
        return True

    def close(self) -> None:
        """Close the connection; replies not received are lost."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
        self._received.clear()
        self._unanswered.clear()

    def command(self, text: str, timeout: float | None = None) -> Reply:
        """Send one command and return its reply.

        Parameters
        ----------
        text : str
            The command line without line ending.
        timeout : float, optional
            Longest wait for the reply, s; `timeout` of the client if absent.

        Raises
        ------
        SimRemoteError
            If the simulator reports an error; the message has the command and the error.
        SimRemoteConnectionError
            If the connection is lost or the reply does not come in time.
        ValueError
            If the text is not one line of ASCII, or replies to motion have not been received.
        """
        if self._unanswered:
            raise ValueError(f"{len(self._unanswered)} replies have not been received yet")
        self._send([text])
        return self.receive_replies(1, timeout)[0]

    def send_motion(self, time: float, motions: Iterable[tuple[str, MotionState]]) -> int:
        """Send one MOT command per vehicle; as `send_motions` for one time."""
        return self.send_motions([(time, motions)])

    def send_motions(self, steps: Iterable[tuple[float, Iterable[tuple[str, MotionState]]]]) -> int:
        """Send one MOT command per time and vehicle, all in one write, without awaiting replies.

        Numbers are the shortest decimals that read back exactly (at most 17 significant digits,
        no exponent), so a command has some 500 bytes.

        Parameters
        ----------
        steps : iterable of (float, iterable of (str, MotionState))
            Time into the run at which the motions hold, s, kept to the nanosecond; vehicle id and
            motion of each vehicle then.

        Returns
        -------
        int
            Number of commands sent, for `receive_replies`.

        Raises
        ------
        SimRemoteConnectionError
            If the connection is lost.
        ValueError
            If a time is negative or a number is not finite; the message names the field.
        """
        lines = []
        for time_into_run, motions in steps:
            if not 0.0 <= time_into_run < float("inf"):
                raise ValueError(f"time: 0 s or more expected, got {time_into_run}")
            stamp = round(time_into_run * NANOSECONDS_PER_SECOND)
            lines += [format_motion(stamp, vehicle_id, state) for vehicle_id, state in motions]
        self._send(lines)
        return len(lines)

    def receive_replies(self, count: int, timeout: float | None = None) -> list[Reply]:
        """Return the next replies, in the order of the commands.

        All replies are received before an error in one of them is raised.

        Raises
        ------
        SimRemoteError, SimRemoteConnectionError
            As in `command`; the first command with an error is named.
        ValueError
            If fewer commands than that are unanswered.
        """
        if count > len(self._unanswered):
            raise ValueError(f"{count} replies asked for, {len(self._unanswered)} outstanding")
        wait = self.timeout if timeout is None else timeout
        deadline = self._monotonic() + wait
        replies: list[Reply] = []
        failures: list[str] = []
        for _ in range(count):
            text = self._receive_one(deadline, wait)
            command = self._unanswered.popleft()
            try:
                reply = parse_reply(text)
            except SimRemoteSyntaxError as error:
                self._lose()
                raise SimRemoteConnectionError(f"{_short(command)}: {error}") from None
            self.counters.replies += 1
            replies.append(reply)
            if reply.failure is not None:
                self.counters.errors += 1
                failures.append(f"{_short(command)}: {reply.failure}")
        if failures:
            raise SimRemoteError(failures[0])
        return replies

    def status(self) -> SimGenStatus:
        """Ask for the status (NULL); errors as in `command`."""
        return self.command("NULL").status

    def wait_for_status(
        self, status: SimGenStatus, timeout: float, interval: float = 0.1
    ) -> SimGenStatus:
        """Ask for the status until it is the wanted status.

        Raises
        ------
        SimRemoteError
            If the status is not reached within `timeout` seconds, or as in `command`.
        """
        deadline = self._monotonic() + timeout
        while (current := self.status()) is not status:
            if self._monotonic() >= deadline:
                raise SimRemoteError(
                    f"NULL: status {status:d} ({status.name.lower()}) expected within "
                    f"{timeout:g} s, it is {current:d} ({current.name.lower()})"
                )
            self._sleep(interval)
        return status

    def prepare_run(
        self,
        scenario: str,
        start_time: GpsTime,
        duration: float,
        initial_motion: Mapping[str, MotionState],
        load_timeout: float = 30.0,
    ) -> SimGenStatus:
        """Load a scenario, set start, trigger and the motion at time 0, and arm.

        A scenario that is still running or armed is ended first.

        Parameters
        ----------
        scenario : str
            Path of the .scn file on the simulator.
        start_time : GpsTime
            Start of the scenario, a whole second. It is sent as GPS time.
        duration : float
            Whole seconds.
        initial_motion : mapping of str to MotionState
            Motion of every vehicle at the start.
        load_timeout : float
            Longest wait for the scenario to load, s.

        Returns
        -------
        SimGenStatus
            ``ARMED``.

        Raises
        ------
        SimRemoteError
            If a command is refused or a status is not reached.
        ValueError
            If start or duration are not whole seconds.
        """
        start_seconds, rest = divmod(start_time.nanoseconds, NANOSECONDS_PER_SECOND)
        if rest:
            raise ValueError(f"start_time: a whole second expected, got {start_time}")
        if duration != int(duration) or duration <= 0:
            raise ValueError(f"duration: whole seconds above 0 expected, got {duration}")
        self.end()
        self.command(f"SC,{scenario}")
        self.wait_for_status(SimGenStatus.READY, load_timeout)
        start = format_calendar(start_seconds).upper()
        self.command(f"-,START_TIME,{start},{format_duration(int(duration))}")
        self.command("-,TR,0")
        self.receive_replies(self.send_motion(0.0, initial_motion.items()))
        self.command("-,AR", timeout=self._arm_timeout)
        return self.wait_for_status(SimGenStatus.ARMED, self._arm_timeout)

    def run(self) -> SimGenStatus:
        """Start the run and return its status, ``RUNNING``; errors as in `command`."""
        self.command("-,RU", timeout=self._arm_timeout)
        return self.wait_for_status(SimGenStatus.RUNNING, self._arm_timeout)

    def end(self) -> SimGenStatus:
        """End a run in any state and rewind; return the status, ``READY`` if there is a scenario.

        An armed scenario cannot be ended by SimGEN, so it is run first.

        Raises
        ------
        SimRemoteError
            As in `command`.
        """
        status = self.status()
        if status is SimGenStatus.NO_SCENARIO or status is SimGenStatus.READY:
            return status
        if status is SimGenStatus.LOADING:
            return self.wait_for_status(SimGenStatus.READY, self._arm_timeout)
        if status is SimGenStatus.ARMING:
            status = self.wait_for_status(SimGenStatus.ARMED, self._arm_timeout)
        if status is SimGenStatus.ARMED:
            status = self.run()
        if status is not SimGenStatus.ENDED:
            status = self.command("-,EN,1").status
        if status is SimGenStatus.ENDED:
            self.command("-,RW")
        return self.wait_for_status(SimGenStatus.READY, self._arm_timeout)

    def _send(self, lines: list[str]) -> None:
        """Send command lines in one write."""
        for line in lines:
            if not line.isascii() or not line.isprintable() or not line.strip():
                raise ValueError(f"command: one line of ASCII expected, got {line!r}")
        if self._socket is None:
            host, port = self._address
            raise SimRemoteConnectionError(f"{_short(lines[0])}: not connected to {host}:{port}")
        ending = self._line_ending
        try:
            self._socket.settimeout(self.timeout)
            self._socket.sendall((ending.join(lines) + ending).encode("ascii"))
        except OSError as error:
            self._lose()
            raise SimRemoteConnectionError(
                f"{_short(lines[0])}: connection lost while sending: {error}"
            ) from None
        self.counters.sent += len(lines)
        self._unanswered.extend(lines)

    def _receive_one(self, deadline: float, wait: float) -> str:
        """Return the text of the next reply."""
        received = self._received
        while (end := received.find(_REPLY_END)) < 0:
            remaining = deadline - self._monotonic()
            problem = None
            error_type: type[SimRemoteConnectionError] = SimRemoteConnectionError
            if remaining <= 0.0:
                problem, error_type = f"no reply within {wait:g} s", SimRemoteTimeoutError
            elif len(received) > _MAXIMUM_REPLY_BYTES:
                problem = f"reply without end after {len(received)} bytes"
            else:
                try:
                    problem = self._receive_more(remaining)
                except TimeoutError:
                    continue
            if problem is not None:
                command = self._unanswered[0]
                self._lose()
                raise error_type(f"{_short(command)}: {problem}")
        end += len(_REPLY_END)
        text = received[:end].decode("utf-8", "replace")
        del received[:end]
        return text

    def _receive_more(self, remaining: float) -> str | None:
        """Wait for bytes; return the problem as a text, None if there is none."""
        if self._socket is None:
            return "not connected"
        self._socket.settimeout(remaining)
        try:
            received = self._socket.recv(65536)
        except TimeoutError:
            raise
        except OSError as error:
            return f"connection lost: {error}"
        if not received:
            return "connection closed by the simulator"
        self._received += received
        return None

    def _lose(self) -> None:
        """Count and close a connection that is no longer of use."""
        self.counters.connection_losses += 1
        self._next_attempt = 0.0
        self._delay = self._delay_initial
        self.close()
        LOGGER.warning("connection to %s:%d lost", *self._address)


def _short(command: str) -> str:
    """Return a command for an error message; of a motion command its first three fields."""
    fields = command.split(",")
    return command if len(fields) <= 8 else ",".join((*fields[:3], "..."))
