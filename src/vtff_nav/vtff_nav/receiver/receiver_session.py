"""A session with a live receiver: connect, find the baud rate, configure, read, recover.

No call waits: the caller calls `ReceiverSession.advance` repeatedly with the wall time. Work that
takes several exchanges with the receiver is a procedure of a `CommandDialogue`.
"""

from __future__ import annotations

import enum
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from vtff_gnss.novatel import (
    CommandResponse,
    Event,
    ReceiverLogStream,
    ReceiverVersion,
)
from vtff_nav.receiver.command_dialogue import CommandDialogue, Procedure
from vtff_nav.receiver.live_port import LivePort, PortError

__all__ = ["CommandRequest", "ReceiverSession", "SessionSettings", "SessionState"]

#: Rates of NovAtel ports (OEM7 manual, SERIALCONFIG), the most likely rates first: 9600 is the
#: factory setting.
STANDARD_BAUDS = (9600, 115200, 460800, 230400, 921600, 57600, 38400, 19200, 4800, 2400)
#: A command without side effects that every receiver answers; its log names the receiver.
PROBE_COMMAND = "LOG VERSIONB ONCE"
#: Time that a receiver needs to change its rate, s.
BAUD_CHANGE_TIME = 0.1
#: Time for which a port may be absent before it is a problem, s: emulators make their ports while
#: the drivers start.
OPENING_PATIENCE = 5.0
#: Numbers of bytes without an intact log that indicate another baud rate: the first at any time,
#: the second after the time-out.
UNINTELLIGIBLE_BYTES = 32768
UNINTELLIGIBLE_BYTES_LATER = 2048
#: Largest factor of the time-out for silence, which grows while configuring does not help.
LONGEST_PATIENCE = 8.0
#: Largest number of reads in one call, so that a flood of bytes does not block the caller.
READS_PER_CALL = 64


class SessionState(enum.Enum):
    """State of a session, with its text for /diagnostics."""

    ABSENT = "no connection"
    SEARCHING = "looking for the receiver"
    CONFIGURING = "sending commands"
    RUNNING = "running"


@dataclass(frozen=True)
class SessionSettings:
    """Commands, time-outs and attempts of a session; times are wall time in s.

    Parameters
    ----------
    commands : tuple of str
        Commands that are sent one after another when the receiver answers. Without commands the
        session never sends anything and reads the receiver as it is.
    searches_baud : bool
        Try other rates if nothing intelligible comes at the rate of the port, and then set the
        receiver to the rate of the port.
    receiver_timeout : float
        Silence after which the session looks for the receiver again; infinite for never.
    command_timeout : float
        Longest wait for an answer.
    command_attempts : int
        Number of attempts for a command that is not answered.
    refused_attempts : int
        Number of attempts for a command that is answered by <ERROR.
    shortest_pause, longest_pause : float
        Limits of the pause between attempts, which is doubled each time.
    """

    commands: tuple[str, ...] = ()
    searches_baud: bool = True
    receiver_timeout: float = 3.0
    command_timeout: float = 1.0
    command_attempts: int = 10
    refused_attempts: int = 3
    shortest_pause: float = 0.2
    longest_pause: float = 5.0


@dataclass
class CommandRequest:
    """A command of a caller; `answer` stays None if no answer comes before the deadline."""

    command: str
    deadline: float
    answer: CommandResponse | None = None
    is_over: bool = False


class _ReceiverSilentError(Exception):
    """The receiver does not answer at any rate."""


class ReceiverSession:
    """Keeps one receiver connected, configured and read.

    Parameters
    ----------
    open_port : callable
        Opens the port; raises `PortError` if the port cannot be opened now.
    stream : ReceiverLogStream
        Decoder of the received bytes.
    settings : SessionSettings
    report : callable, optional
        ``report(is_problem, text)`` is called with messages for the operator.
    on_port : callable, optional
        Called with each port that was opened, and with None before the port is closed.

    Attributes
    ----------
    state : SessionState
    problem : str
        The current problem; empty if there is none.
    last_problem : str
        The most recent problem, which may be over.
    refused : dict of str to str
        Answer by command, for commands of the list that were refused or not answered.
    version : ReceiverVersion or None
        Model, serial number and firmware; None before the receiver has reported them.
    connections, configurations : int
        How often the port was opened, and how often the whole command list was sent.
    bytes_received : int
        Number of bytes read so far.
    """

    def __init__(
        self,
        open_port: Callable[[], LivePort],
        stream: ReceiverLogStream,
        settings: SessionSettings,
        report: Callable[[bool, str], None] = lambda is_problem, text: None,
        on_port: Callable[[LivePort | None], None] = lambda port: None,
    ) -> None:
        self._open_port = open_port
        self._stream = stream
        self._settings = settings
        self._report = report
        self._on_port = on_port
        self.state = SessionState.ABSENT
        self.problem = ""
        self.last_problem = ""
        self._told_problem = ""
        self.refused: dict[str, str] = {}
        self.version: ReceiverVersion | None = None
        self.connections = 0
        self.configurations = 0
        self.bytes_received = 0
        self._port: LivePort | None = None
        self._nominal_baud: int | None = None
        self._now = 0.0
        self._open_next = 0.0
        self._first_attempt: float | None = None
        self._pause = settings.shortest_pause
        self._dialogue = CommandDialogue()
        self._wanted_again = ""
        self._requests: deque[CommandRequest] = deque()
        self._request: CommandRequest | None = None
        self._patience = settings.receiver_timeout
        self._has_sent_since_configured = False
        self._heard_at = 0.0
        self._understood_at = 0.0
        self._bytes_since_understood = 0
        self._understood_count = 0

    # ---- for the caller ----------------------------------------------------------------------

    @property
    def is_running(self) -> bool:
        """Whether the receiver is configured and its logs are read."""
        return self.state is SessionState.RUNNING and not self._wanted_again

    @property
    def baud(self) -> int | None:
        """Rate of the open port, bit/s; None without a port or without a rate."""
        return None if self._port is None else self._port.baud

    @property
    def reconnects(self) -> int:
        """Number of times that the port was opened again."""
        return max(0, self.connections - 1)

    def advance(self, now: float) -> list[Event]:
        """Read and send without waiting, and return the decoded events.

        Parameters
        ----------
        now
            Wall time, s; it must not decrease.
        """
        self._now = self._dialogue.now = now
        if self._port is None and not self._connect():
            self._expire_requests()
            return []
        events: list[Event] = []
        try:
            self._send_outgoing()
            events = self._read()
            self._advance_procedures()
            self._send_outgoing()
        except PortError as error:
            events += self._disconnect(str(error))
        except _ReceiverSilentError as error:
            events += self._disconnect(str(error))
        return events

    def request(self, command: str, deadline: float) -> CommandRequest:
        """Queue a command; `advance` sends it and puts its answer into the returned request."""
        request = CommandRequest(command, deadline)
        self._requests.append(request)
        return request

    def configure_again(self, reason: str) -> None:
        """Look for the receiver on the open port and send the command list again."""
        if self._settings.commands:
            self._wanted_again = reason

    def close(self) -> None:
        """Close the port."""
        if self._port is not None:
            self._on_port(None)
            self._port.close()
            self._port = None
        self.state = SessionState.ABSENT

    # ---- port --------------------------------------------------------------------------------

    def _connect(self) -> bool:
        if self._now < self._open_next:
            return False
        try:
            self._port = self._open_port()
        except PortError as error:
            if self._first_attempt is None:
                self._first_attempt = self._now
            is_late = self._now - self._first_attempt >= OPENING_PATIENCE
            self._note_problem(str(error), is_told=self.connections > 0 or is_late)
            self._back_off()
            return False
        self.connections += 1
        self._wanted_again = ""
        self._nominal_baud = self._port.baud
        self._on_port(self._port)
        self._forget_silence()
        if self._settings.commands:
            self._dialogue.begin(self._find_and_configure())
        else:
            self._enter_running()
        return True

    def _disconnect(self, reason: str) -> list[Event]:
        self._note_problem(reason)
        self.close()
        self._dialogue.stop()
        self._back_off()
        return self._stream.close()

    def _back_off(self) -> None:
        self._open_next = self._now + self._pause
        self._pause = min(2.0 * self._pause, self._settings.longest_pause)

    def _send_outgoing(self) -> None:
        outgoing = self._dialogue.outgoing
        if self._port is not None and outgoing:
            del outgoing[: self._port.write(outgoing)]

    def _read(self) -> list[Event]:
        """Read and decode; answers to commands go to the dialogue."""
        content = self._read_port()
        if not content:
            return []
        self.bytes_received += len(content)
        self._heard_at = self._now
        self._has_sent_since_configured |= self.is_running
        self._bytes_since_understood += len(content)
        events: list[Event] = []
        for event in self._stream.feed(content):
            if isinstance(event, CommandResponse):
                self._dialogue.take_answer(event)
                continue
            if isinstance(event, ReceiverVersion):
                self.version = event
            events.append(event)
        understood = self._stream.counters.frames_good + self._stream.counters.responses
        if understood > self._understood_count:
            self._understood_count = understood
            self._understood_at = self._now
            self._bytes_since_understood = 0
            if not self._settings.commands:
                self.problem = self._told_problem = ""
        return events

    def _read_port(self) -> bytes:
        """Return all bytes that have arrived: a pseudo-terminal gives 4 kB at a time."""
        assert self._port is not None
        content = bytearray()
        try:
            for _ in range(READS_PER_CALL):
                chunk = self._port.read()
                if not chunk:
                    break
                content += chunk
        except PortError:
            if not content:  # otherwise the next call tells it again
                raise
        return bytes(content)

    # ---- procedures --------------------------------------------------------------------------

    def _advance_procedures(self) -> None:
        """Handle time-outs, check that the receiver is heard, and begin queued commands."""
        self._dialogue.pass_time()
        if self._dialogue.is_idle and self.state is SessionState.RUNNING:
            self._check_reception()
        self._expire_requests()
        if self._dialogue.is_idle and self.is_running and self._requests:
            self._dialogue.begin(self._send_request(self._requests.popleft()))

    def _check_reception(self) -> None:
        """Look for the receiver again if it is silent or sends at another rate."""
        if self._has_sent_since_configured:
            self._patience = self._settings.receiver_timeout
        patience = self._patience
        is_late = self._now - self._understood_at > patience
        limit = UNINTELLIGIBLE_BYTES_LATER if is_late else UNINTELLIGIBLE_BYTES
        reason, self._wanted_again = self._wanted_again, ""
        if self._now - self._heard_at > patience:
            reason = f"nothing was received for {patience:g} s"
        elif self._bytes_since_understood > limit:
            reason = f"{self._bytes_since_understood} bytes without a log: wrong baud rate?"
        if not reason:
            return
        # Back off: a receiver that answers may have no logs to send yet.
        self._patience = min(2.0 * patience, LONGEST_PATIENCE * self._settings.receiver_timeout)
        self._note_problem(reason)
        self._forget_silence()
        if self._settings.commands:
            self._dialogue.begin(self._find_and_configure())

    def _forget_silence(self) -> None:
        self._heard_at = self._understood_at = self._now
        self._bytes_since_understood = 0

    def _find_and_configure(self) -> Procedure[None]:
        """Find the receiver and send it the command list."""
        self.state = SessionState.SEARCHING
        yield from self._find_receiver()
        self.state = SessionState.CONFIGURING
        self.refused.clear()
        for command in self._settings.commands:
            if not (yield from self._configure(command)):
                break
        self.configurations += 1
        self._enter_running()

    def _enter_running(self) -> None:
        self.state = SessionState.RUNNING
        self._has_sent_since_configured = False
        self._pause = self._settings.shortest_pause
        self._forget_silence()
        self.problem = "; ".join(f"'{c}': {text}" for c, text in self.refused.items())
        self._told_problem = self.problem
        rate = "" if self.baud is None else f" at {self.baud} baud"
        self._report(False, f"receiver is running{rate}, configured {self.configurations} times")

    def _find_receiver(self) -> Procedure[None]:
        """Find the receiver and its rate, and set it to the rate of the port."""
        nominal = self._nominal_baud
        others = STANDARD_BAUDS if self._settings.searches_baud and nominal is not None else ()
        for baud in (nominal, *(rate for rate in others if rate != nominal)):
            self._set_baud(baud)
            if (yield from self._probe()):
                break
        else:
            self._set_baud(nominal)
            at_rate = "" if nominal is None else f" at {nominal} baud"
            at_others = " nor at any other standard rate" if others else ""
            raise _ReceiverSilentError(f"the receiver does not answer{at_rate}{at_others}")
        if baud == nominal:
            return
        self._report(True, f"the receiver was found at {baud} baud and is set to {nominal}")
        command = f"SERIALCONFIG THISPORT {nominal} N 8 1 N OFF"
        answer = yield from self._dialogue.ask(command, self._settings.command_timeout)
        if answer is not None and not answer.is_ok:
            self._note_problem(f"the receiver refuses {nominal} baud: {answer.text}")
            return
        yield from self._dialogue.pause(BAUD_CHANGE_TIME)
        self._set_baud(nominal)
        if not (yield from self._probe()):
            raise _ReceiverSilentError(f"the receiver was lost on changing to {nominal} baud")

    def _probe(self) -> Procedure[bool]:
        """Return whether the receiver is heard: it answers, or an intact log comes."""
        good_before = self._stream.counters.frames_good
        self._dialogue.outgoing += (
            b"\r\n"  # ends a command that the receiver may have read in part at another rate
        )
        is_nominal = self.baud == self._nominal_baud
        timeout = self._settings.command_timeout * (1.0 if is_nominal else 0.5)
        answer = yield from self._dialogue.ask(PROBE_COMMAND, timeout)
        return answer is not None or self._stream.counters.frames_good > good_before

    def _set_baud(self, baud: int | None) -> None:
        if self._port is not None and baud is not None and self._port.baud != baud:
            self._dialogue.outgoing.clear()
            self._port.set_baud(baud)

    def _configure(self, command: str) -> Procedure[bool]:
        """Send a command of the list until it is accepted; return whether to send the next."""
        good_before = self._stream.counters.frames_good
        pause = self._settings.shortest_pause / 2.0
        for attempt in range(1, self._settings.command_attempts + 1):
            answer = yield from self._dialogue.ask(command, self._settings.command_timeout)
            if answer is not None and answer.is_ok:
                self.refused.pop(command, None)
                return True
            self.refused[command] = "no answer" if answer is None else answer.text
            self._note_problem(f"command '{command}', attempt {attempt}: {self.refused[command]}")
            if answer is not None and attempt >= self._settings.refused_attempts:
                return True
            yield from self._dialogue.pause(pause)
            pause = min(2.0 * pause, self._settings.command_timeout)
        if self._stream.counters.frames_good == good_before:
            raise _ReceiverSilentError(f"command '{command}' is not answered")
        return False  # the receiver sends logs but does not hear: read them as they are

    def _send_request(self, request: CommandRequest) -> Procedure[None]:
        self._request = request
        timeout = request.deadline - self._now
        request.answer = yield from self._dialogue.ask(request.command, timeout)
        request.is_over = True
        self._request = None

    def _expire_requests(self) -> None:
        while self._requests and self._now >= self._requests[0].deadline:
            self._requests.popleft().is_over = True
        if self._request is not None and self._now >= self._request.deadline:
            self._request.is_over = True

    def _note_problem(self, text: str, *, is_told: bool = True) -> None:
        self.problem = self.last_problem = text
        if is_told and text != self._told_problem:
            self._told_problem = text
            self._report(True, text)
