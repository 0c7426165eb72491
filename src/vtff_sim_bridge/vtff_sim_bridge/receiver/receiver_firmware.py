"""Command interpreter and log scheduler of an emulated NovAtel receiver, on scenario time.

Abbreviated ASCII commands in, answers and logs out; no input or output is done here and no wall
clock is read. Source: OEM7 Commands and Logs Reference Manual, commands LOG, UNLOG, UNLOGALL,
SERIALCONFIG; the answers are those of real receivers, the error texts those of novatel_edie's
table of responses.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal, InvalidOperation
from typing import Any

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND, SECONDS_PER_WEEK
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.novatel.definitions import MessageDecoder
from vtff_gnss.novatel.encode.frame import (
    PORT_ADDRESSES,
    TIME_STATUS_FINE_STEERING,
    HeaderSettings,
)
from vtff_gnss.novatel.encode.solution import ComponentVersion
from vtff_gnss.observations import EpochTimes
from vtff_sim_bridge.receiver.receiver_logs import (
    EVENT_TRIGGERS,
    LOG_DEFINITIONS,
    LogContext,
    LogDefinition,
    LogEncoder,
    ReceiverOutputs,
)
from vtff_sim_bridge.receiver.serial_line import DEFAULT_BAUD, SerialLine

MAXIMUM_COMMAND_BYTES = 512
BAUD_RATES = (
    300, 600, 900, 1200, 2400, 4800, 9600, 19200, 38400, 57600,
    115200, 230400, 460800, 921600,
)  # fmt: skip
DEFAULT_TRANSMIT_BUFFER_BYTES = 16384

_NANOSECONDS_PER_WEEK = SECONDS_PER_WEEK * NANOSECONDS_PER_SECOND
_SEPARATORS = b" ,\t"
_TO_BLANKS = bytes.maketrans(_SEPARATORS, b" " * len(_SEPARATORS))
_MINIMUM_PERIOD = Decimal("0.05")
_SUBSECOND_PERIODS = tuple(Decimal(p) for p in ("0.05", "0.1", "0.2", "0.25", "0.5"))
_PORTS = ("COM1", "COM2", "COM3", "USB1", "USB2", "USB3")
_ALL_PORTS = "ALL_PORTS"
_KNOWN_TRIGGERS = ("ONNEW", "ONCHANGED", "ONTIME", "ONNEXT", "ONCE", "ONMARK", "ONALL")
_OVERRUN_BIT = {"COM1": 1 << 8, "COM2": 1 << 9, "COM3": 1 << 10}

# Commands that a receiver obeys without anything in its logs changing here.
_IGNORED_COMMANDS = frozenset(
    "ANTENNAPOWER ASSIGN ASSIGNALL CLOCKADJUST CLOCKOFFSET COMCONTROL CSMOOTH DATUM DYNAMICS ECHO "
    "ECUTOFF ELEVATIONCUTOFF EXTERNALCLOCK FIX FREQUENCYOUT GALECUTOFF INTERFACEMODE LOCKOUT "
    "MAGVAR NMEATALKER PDPFILTER POSAVE PPSCONTROL PSRDIFFSOURCE PSRDIFFTIMEOUT RAIMMODE "
    "RTKDYNAMICS RTKSOURCE SBASCONTROL SELECTCHANCONFIG SETIONOTYPE SETUTCLEAPSECONDS "
    "STATUSCONFIG UNASSIGN UNASSIGNALL UNDULATION UNLOCKOUT UNLOCKOUTALL USERDATUM".split()
)


class CommandError(ValueError):
    """A command that the receiver refuses; the text is that of its answer."""


@dataclass
class _LogRequest:
    """One LOG command in force; `since` is the epoch before it, None for the first one."""

    definition: LogDefinition
    order: int
    format_suffix: str
    trigger: str
    period_nanoseconds: int
    offset_nanoseconds: int
    is_held: bool
    encoder: LogEncoder
    since: GpsTime | None = None
    last_sequence: object = None
    last_items: dict[object, Any] = field(default_factory=dict)

    def due_epochs(self, times_of_week: Sequence[int]) -> Sequence[int]:
        """Return the indices of the epochs, at times of the week in ns, at which it may be due.

        What is no matter of time is so at the first one: nothing is received within.
        """
        if self.trigger != "ONTIME":
            return (0,)
        offset, period = self.offset_nanoseconds, self.period_nanoseconds
        return [k for k, time in enumerate(times_of_week) if (time - offset) % period == 0]

    def choose(self, items: Sequence[Any]) -> list[Any]:
        """Return the items to send: with ONNEW and ONCHANGED those not sent before."""
        is_event = self.trigger in EVENT_TRIGGERS
        if is_event:
            if items is self.last_sequence:
                return []
            self.last_sequence = items
        accepts = self.definition.accepts
        if accepts is not None:
            items = [item for item in items if accepts(item)]
        return [item for item in items if self._is_news(item)] if is_event else list(items)

    def _is_news(self, item: Any) -> bool:
        is_ephemeris = isinstance(item, BroadcastEphemeris)
        key = (item.system, item.prn) if is_ephemeris else None
        last = self.last_items.get(key)
        self.last_items[key] = item
        if last is None and self.trigger == "ONNEW" and self.since is not None:
            # Data without a time of reception were received before the LOG command.
            return is_ephemeris and item.time > self.since
        if is_ephemeris and last is not None and self.trigger == "ONCHANGED":
            last = replace(last, time=item.time)
        return bool(item != last)


class ReceiverFirmware:
    """One port of a receiver: obeys commands and sends the logs that are due.

    A second LOG command for a log replaces the first and is answered with OK, even if the two are
    the same: one other simulator refuses it, but NovAtel's table of answers has no text for a
    refusal. LOG commands for other ports are accepted, and their logs are not sent. The log of a
    ONCE command is sent at the next epoch, VERSION at once. ONCHANGED sends the present data at the
    next epoch and from then on every change. ONNEW sends only data received after the command; an
    ephemeris that a satellite repeats after 30 s is new.

    Parameters
    ----------
    port_name : str
        "COM1" to "COM3".
    settings : HeaderSettings
        Headers of the logs; the port address is that of `port_name`.
    baud : int
        Rate of the port until SERIALCONFIG.
    limits_baud : bool
        Carry no more than the line can: an epoch's bytes come with the following epochs, frames
        for which the transmit buffer has no room are dropped, and the overrun bit of the receiver
        status is set from then on.
    transmit_buffer_bytes : int
        Size of the transmit buffer.
    versions : sequence of ComponentVersion
        Components that VERSION lists.
    definitions : sequence of LogDefinition
        The logs, in the order of sending.

    Attributes
    ----------
    time_status, receiver_status : int
        For headers of logs without their own; set by the caller when they change.

    Raises
    ------
    ValueError
        If the port or the baud rate does not exist.
    """

    def __init__(
        self,
        port_name: str = "COM1",
        settings: HeaderSettings | None = None,
        *,
        baud: int = DEFAULT_BAUD,
        limits_baud: bool = False,
        transmit_buffer_bytes: int = DEFAULT_TRANSMIT_BUFFER_BYTES,
        versions: Sequence[ComponentVersion] = (ComponentVersion(),),
        definitions: Sequence[LogDefinition] = LOG_DEFINITIONS,
    ) -> None:
        if port_name not in PORT_ADDRESSES:
            raise ValueError(f"port_name: {port_name!r} is not one of {sorted(PORT_ADDRESSES)}")
        if baud not in BAUD_RATES:
            raise ValueError(f"baud: {baud} is not one of {BAUD_RATES}")
        self.port_name = port_name
        self.time_status = TIME_STATUS_FINE_STEERING
        self.receiver_status = 0
        self._settings = replace(
            settings or HeaderSettings(), port_address=PORT_ADDRESSES[port_name]
        )
        self._versions = versions
        self._definitions = {d.name: (order, d) for order, d in enumerate(definitions)}
        self._line = SerialLine(limits_baud, transmit_buffer_bytes)
        self._line.baud = baud
        self._saved: tuple[dict[tuple[str, str, str], _LogRequest], int, int] = ({}, baud, 10)
        self._requests: dict[tuple[str, str, str], _LogRequest] = {}
        self._schedule: list[tuple[tuple[str, str, str], _LogRequest]] | None = None
        self._time: GpsTime | None = None
        self._has_overrun = False
        self._tail = b""
        self._decoder: MessageDecoder | None = None
        self._at_once: list[bytes] = []
        self._commands: Mapping[str, Callable[[list[str]], None]] = {
            "LOG": self._log,
            "UNLOG": self._unlog,
            "UNLOGALL": self._unlogall,
            "SERIALCONFIG": self._serialconfig,
            "COM": self._serialconfig,
            "SAVECONFIG": self._saveconfig,
            "RESET": self._reset,
        }

    @property
    def baud(self) -> int:
        """Rate of the port in bit/s."""
        return self._line.baud

    @property
    def link_load_percent(self) -> float:
        """Bits of all logs of the last second of scenario time, relative to the baud rate."""
        return self._line.load_percent()

    @property
    def waiting_bytes(self) -> int:
        """Bytes in the transmit buffer; always 0 without a baud limit."""
        return len(self._line.waiting)

    @property
    def dropped_frames(self) -> int:
        """Logs dropped so far because the transmit buffer was full."""
        return self._line.dropped_frames

    @property
    def active_logs(self) -> tuple[str, ...]:
        """LOG commands in force on this port, e.g. ``"RANGEB ONTIME 0.05"``."""
        return tuple(
            f"{name}{suffix} {request.trigger}"
            + (
                f" {request.period_nanoseconds / NANOSECONDS_PER_SECOND:g}"
                if request.trigger == "ONTIME"
                else ""
            )
            for (port, name, suffix), request in self._requests.items()
            if port == self.port_name
        )

    def receive(self, content: bytes) -> bytes:
        """Take bytes from the host and return the bytes to send back now.

        Commands end with CR, LF or both. With a baud limit and a transmit buffer that is not
        empty, the answers come behind its bytes with the next epochs.
        """
        lines = (self._tail + content).replace(b"\n", b"\r").split(b"\r")
        # One byte more than allowed is kept, so that the end of a long line is refused too.
        self._tail = lines.pop()[: MAXIMUM_COMMAND_BYTES + 1]
        answer = b"".join(self._answer(line) for line in lines if line.strip(_SEPARATORS))
        if self._line.waiting:
            self._line.waiting += answer
            return b""
        return answer

    def advance(self, time: GpsTime, outputs: ReceiverOutputs) -> bytes:
        """Go on to an epoch and return the bytes that the port sends, see `advance_epochs`."""
        return self.advance_epochs(EpochTimes((time.nanoseconds,)), outputs)[0]

    def advance_epochs(self, times: EpochTimes, outputs: ReceiverOutputs) -> list[bytes]:
        """Go on over epochs and return the bytes that the port sends at each.

        Parameters
        ----------
        times : EpochTimes
            Epochs one after the other, later than all before; a log ONTIME is sent if the time
            is a multiple of its period after its offset.
        outputs : ReceiverOutputs
            Solutions and messages that logs are made of; its series goes on with these epochs.

        Raises
        ------
        ValueError
            If a time is not later than the epoch before.
        """
        if self._line.is_limited and len(times) > 1:
            # Frames tell whether those of the epoch before were dropped.
            return [self.advance(time, outputs) for time in times]
        nanoseconds = times.nanoseconds
        before = nanoseconds if self._time is None else [self._time.nanoseconds, *nanoseconds]
        if any(map(operator.ge, before, before[1:])):
            raise ValueError(f"time: from {times[0]} on one is not later than that before")
        frames: list[list[bytes]] = [[] for _ in range(len(times))]
        times_of_week = [time % _NANOSECONDS_PER_WEEK for time in nanoseconds]
        done = []
        for key, request in self._requests_in_order():
            due = request.due_epochs(times_of_week)
            if due:
                self._add_frames(frames, request, due, times, outputs)
            if request.trigger == "ONCE":
                done.append(key)
        for key in done:
            del self._requests[key]
            self._schedule = None
        self._time = times[-1]
        dropped = self._line.dropped_frames
        contents = self._line.send(nanoseconds, frames)
        self._has_overrun |= self._line.dropped_frames > dropped
        return contents

    def _add_frames(
        self,
        frames: list[list[bytes]],
        request: _LogRequest,
        due: Sequence[int],
        times: EpochTimes,
        outputs: ReceiverOutputs,
    ) -> None:
        """Add those of a log at the epochs at which it is due."""
        for k in due:
            self._time = time = times[k]
            items = request.choose(request.definition.items(outputs, time))
            if items:
                frames[k] += [self._frame(request, item) for item in items]

    def _requests_in_order(self) -> list[tuple[tuple[str, str, str], _LogRequest]]:
        """Return the logs of this port in the order of sending."""
        if self._schedule is None:
            requests = [entry for entry in self._requests.items() if entry[0][0] == self.port_name]
            self._schedule = sorted(requests, key=lambda entry: entry[1].order)
        return self._schedule

    def power_cycle(self) -> bytes:
        """Start again with the saved configuration; return what the port sends when it is up."""
        self._tail = b""
        return self._restart()

    def _restart(self) -> bytes:
        self._schedule = None
        requests, self._line.baud, self._line.bits_per_byte = self._saved
        self._requests = {
            key: replace(
                request,
                encoder=request.definition.make_encoder(),
                since=None,
                last_sequence=None,
                last_items={},
            )
            for key, request in requests.items()
        }
        self._line.waiting.clear()
        self._has_overrun = False
        return self._prompt()

    def _prompt(self) -> bytes:
        return f"\r\n[{self.port_name}]".encode("ascii")

    def _answer(self, line: bytes) -> bytes:
        self._at_once = []
        self._schedule = None
        try:
            if len(line) > MAXIMUM_COMMAND_BYTES:
                raise CommandError("Message is incorrect")
            separated = line.translate(_TO_BLANKS)
            text = "".join(chr(b) if 32 <= b < 127 else "?" for b in separated)
            verb, *arguments = text.upper().split()
            if verb in self._commands:
                self._commands[verb](arguments)
            elif verb not in _IGNORED_COMMANDS:
                raise _invalid_field(verb)
            answer = "OK"
        except CommandError as error:
            answer = f"ERROR:{error}"
        return f"\r\n<{answer}".encode("ascii") + self._prompt() + b"".join(self._at_once)

    def _context(self) -> LogContext:
        """Return what the headers of all logs of the present epoch have in common."""
        overrun = _OVERRUN_BIT[self.port_name] if self._has_overrun else 0
        status = self.receiver_status | overrun
        return LogContext(self._time, self._settings, self.time_status, status, self._versions)

    def _frame(self, request: _LogRequest, item: Any) -> bytes:
        frame = request.encoder(item, self._context())
        if request.format_suffix == "B":
            return frame
        if self._decoder is None:
            self._decoder = MessageDecoder()
        message = self._decoder.decode(frame)
        if message is None:
            raise ValueError(f"{request.definition.name}: has no ASCII form")
        text = message.to_ascii() if request.format_suffix == "A" else message.to_abbrev_ascii()
        return bytes(text.message)

    def _take_port(self, arguments: list[str], default: str) -> str:
        """Take a port from the front of the arguments."""
        if arguments and arguments[0] in (*_PORTS, _ALL_PORTS, "THISPORT"):
            port = arguments.pop(0)
            return self.port_name if port == "THISPORT" else port
        return default

    def _take_log(self, arguments: list[str]) -> tuple[str, str]:
        """Take the name of a log from the front of the arguments; return name and format."""
        if not arguments:
            raise CommandError("Message missing field")
        token = arguments.pop(0)
        if token in self._definitions:
            return token, ""
        if token[:-1] in self._definitions and token[-1] in "AB":
            return token[:-1], token[-1]
        raise _invalid_field(token)

    def _log(self, arguments: list[str]) -> None:
        port = self._take_port(arguments, self.port_name)
        if port == _ALL_PORTS:
            raise _invalid_field(port)
        name, suffix = self._take_log(arguments)
        order, definition = self._definitions[name]
        trigger = arguments.pop(0) if arguments else "ONCE"
        if trigger not in _KNOWN_TRIGGERS:
            raise _invalid_field(trigger)
        if trigger not in definition.triggers:
            raise CommandError(f"Trigger {trigger} not valid for this log")
        period, offset = _take_period_and_offset(arguments, trigger)
        hold = arguments.pop(0) if arguments else "NOHOLD"
        if hold not in ("HOLD", "NOHOLD"):
            raise _invalid_field(hold)
        if arguments:
            raise _invalid_field(arguments[0])
        request = _LogRequest(
            definition,
            order,
            suffix,
            trigger,
            int(period * NANOSECONDS_PER_SECOND),
            int(offset * NANOSECONDS_PER_SECOND),
            hold == "HOLD",
            definition.make_encoder(),
            self._time,
        )
        if definition.is_static and trigger == "ONCE":
            if port == self.port_name:
                self._at_once.append(self._frame(request, None))
            return
        self._requests[(port, name, suffix)] = request

    def _unlog(self, arguments: list[str]) -> None:
        port = self._take_port(arguments, self.port_name)
        name, suffix = self._take_log(arguments)
        if self._requests.pop((port, name, suffix), None) is None:
            raise CommandError("Requested log does not exist")

    def _unlogall(self, arguments: list[str]) -> None:
        port = self._take_port(arguments, _ALL_PORTS)
        held = arguments.pop(0) if arguments else "FALSE"
        if held not in ("TRUE", "FALSE"):
            raise _invalid_field(held)
        self._requests = {
            key: request
            for key, request in self._requests.items()
            if port not in (_ALL_PORTS, key[0]) or (request.is_held and held == "FALSE")
        }

    def _serialconfig(self, arguments: list[str]) -> None:
        port = self._take_port(arguments, self.port_name)
        if not arguments:
            raise CommandError("Message missing field")
        if not arguments[0].isdigit():
            raise CommandError(f"Com port not supported. Field = {arguments[0]}")
        baud = int(arguments[0])
        if baud not in BAUD_RATES:
            raise CommandError("Invalid baud rate")
        settings = (arguments[1:] + ["N", "8", "1", "N", "ON"][len(arguments) - 1 :])[:5]
        allowed = (("N", "E", "O"), ("7", "8"), ("1", "2"), ("N", "XON", "CTS"), ("ON", "OFF"))
        for value, choices in zip(settings, allowed, strict=True):
            if value not in choices:
                raise _invalid_field(value)
        if port == self.port_name:
            self._line.baud = baud
            self._line.bits_per_byte = (
                1 + int(settings[1]) + (settings[0] != "N") + int(settings[2])
            )

    def _saveconfig(self, _arguments: list[str]) -> None:
        self._saved = (dict(self._requests), self._line.baud, self._line.bits_per_byte)

    def _reset(self, _arguments: list[str]) -> None:
        self._at_once.append(self._restart())


def _invalid_field(token: str) -> CommandError:
    return CommandError(f"Invalid Message. Field = {token}")


def _take_period_and_offset(arguments: list[str], trigger: str) -> tuple[Decimal, Decimal]:
    """Take period and offset, in s, from the front of the arguments; only ONTIME uses them."""
    values: list[Decimal] = []
    while arguments and len(values) < 2 and arguments[0] not in ("HOLD", "NOHOLD"):
        token = arguments.pop(0)
        try:
            value = Decimal(token)
        except InvalidOperation:
            raise _invalid_field(token) from None
        if not value.is_finite():
            raise _invalid_field(token)
        values.append(value)
    if trigger != "ONTIME":
        return Decimal(0), Decimal(0)
    if not values:
        raise CommandError("Message missing field")
    period = values[0]
    is_whole = period > 0 and period == period.to_integral_value() and period < 10**9
    if not is_whole and period not in _SUBSECOND_PERIODS:
        raise CommandError("Requested rate is invalid")
    offset = values[1] if len(values) > 1 else Decimal(0)
    if not 0 <= offset < period or offset % _MINIMUM_PERIOD:
        raise CommandError("Invalid offset.")
    return period, offset
