"""The `can_thruster_emulator` executable: what a thruster looks like from its CAN bus.

It knows its controller by the frames alone: their layout is that of the DBC file, their meaning
that of docs/can.md. It caps and rounds commands, answers each with a report, gives a sign of life
once a second, and cuts the thrust when no command has come for two seconds.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import logging
import math
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can
import cantools

from vtff_node.can_bus.connection import FIRST_RETRY, BusConnection, open_bus
from vtff_node.process.lifeline import watch_lifeline
from vtff_node.process.stop_signals import StopRequest
from vtff_sim_bridge.thruster.device_frames import decode_frame, encode_frame

LOGGER = logging.getLogger("can_thruster_emulator")

CLOCK_MODES = ("lockstep", "realtime")
ACCELERATION_CAP = 1.4  # m/s2 on each axis, paper 000 appendix A
QUANTUM = 1e-5  # m/s2, impulse bit over a step of 1 s: the resolution of the frames
WATCHDOG_TIMEOUT = 2.0  # s
HEARTBEAT_INTERVAL = 1.0  # s of wall time
LONGEST_WAIT = 0.2  # s, bounds the reaction to a signal

MODE_OFF = 0
MODE_THRUST = 1
STATE_READY = 0
STATE_THRUSTING = 1
STATE_WATCHDOG = 2
STATE_FAULT = 3

_WEEK = 604_800_000  # ms
_LARGEST_COUNTER = 0xFFFF
_NO_THRUST = (0, 0, 0)


@dataclass(frozen=True)
class Device:
    """Limits of a thruster, m/s2 on each axis.

    Parameters
    ----------
    acceleration_cap, quantum, smallest
        As in `CanThruster`.
    """

    acceleration_cap: float = ACCELERATION_CAP
    quantum: float = QUANTUM
    smallest: float = 0.0


#: Thrusters by name. The QinetiQ T5 gives 1 to 25 mN in steps of 12 uN (Edwards and others 2004,
#: ESA SP-569), here on 1600 kg.
DEVICES = {"reference": Device(), "t5": Device(25e-3 / 1600.0, 7.5e-9, 1e-3 / 1600.0)}


@dataclass(frozen=True)
class _Command:
    """Both halves of a command, accelerations in counts of the frames' resolution."""

    sequence: int
    week: int
    time_of_week: int  # ms
    counts: tuple[int, int, int]
    mode: int

    @property
    def start(self) -> int:
        """GPS time at which the thrust starts, in ms."""
        return self.week * _WEEK + self.time_of_week


class CanThruster:
    """A thruster of three axes without the bus: frames in, frames out.

    Parameters
    ----------
    dbc_file
        Path of the DBC file with the frames.
    acceleration_cap
        Largest acceleration in m/s2 on each axis.
    quantum
        Smallest change of the acceleration in m/s2, a multiple of the resolution of the frames;
        0 means that resolution.
    watchdog_timeout
        Seconds without a command after which there is no thrust.
    clock_mode
        lockstep: the watchdog measures time by the start times in the commands; realtime: by the
        wall clock.
    smallest
        Acceleration below which the engine cannot be throttled, m/s2: an axis gives at least that,
        or nothing for a command below half of it.

    Attributes
    ----------
    commands, rejected_frames, sequence_gaps, watchdog_trips
        Counts since the start; a repeated command does not count.

    Raises
    ------
    ValueError
        If a value is out of its range; the message names the parameter.
    """

    def __init__(
        self,
        dbc_file: str | Path,
        acceleration_cap: float = ACCELERATION_CAP,
        quantum: float = QUANTUM,
        watchdog_timeout: float = WATCHDOG_TIMEOUT,
        clock_mode: str = "lockstep",
        smallest: float = 0.0,
    ) -> None:
        try:
            database: Any = cantools.database.load_file(str(dbc_file), database_format="dbc")
            self._messages: dict[str, Any] = {
                message.name: message for message in database.messages
            }
            self._command_messages = {
                self._messages[name].frame_id: self._messages[name]
                for name in ("ThrustCommandRT", "ThrustCommandN", "ThrusterIsolation")
            }
            acceleration = self._messages["ThrustReportRT"].get_signal_by_name("AccelerationR")
        except (OSError, UnicodeDecodeError, KeyError, cantools.database.Error) as error:
            raise ValueError(f"{dbc_file}: not the DBC file of a thruster: {error}") from error
        if clock_mode not in CLOCK_MODES:
            raise ValueError(f"clock_mode: one of {', '.join(CLOCK_MODES)} expected")
        if not 0.0 < watchdog_timeout < math.inf:
            raise ValueError(f"watchdog_timeout: positive seconds expected, got {watchdog_timeout}")
        sequence = self._messages["ThrustReportRT"].get_signal_by_name("Sequence")
        self._sequence_modulus = 2**sequence.length
        resolution = float(acceleration.scale)
        self._set_limits(
            acceleration_cap, quantum, resolution, 2 ** (acceleration.length - 1) - 1, smallest
        )
        self._realtime = clock_mode == "realtime"
        self._watchdog_timeout = watchdog_timeout
        self.commands = 0
        self.rejected_frames = 0
        self.sequence_gaps = 0
        self.watchdog_trips = 0
        self._state = STATE_READY
        self._isolated = (False, False, False)
        self._first_half: dict[str, int] | None = None
        self._last_command: _Command | None = None
        self._last_command_at = 0.0
        self._last_answer: list[can.Message] = []
        self._cut_since_report = False
        self._heartbeats = 0
        self._heartbeat_at = 0.0
        self._started_at: float | None = None

    def _set_limits(
        self,
        acceleration_cap: float,
        quantum: float,
        resolution: float,
        largest_count: int,
        smallest: float,
    ) -> None:
        """Turn cap and quantum into counts: on the bus, accelerations are whole numbers."""
        if not 0.0 < acceleration_cap <= largest_count * resolution:
            raise ValueError(
                f"acceleration_cap: more than 0 and at most {largest_count * resolution:g} m/s2, "
                f"which a frame can hold, expected, got {acceleration_cap}"
            )
        multiple = quantum / resolution
        if not (0.0 <= quantum < math.inf) or abs(multiple - round(multiple)) > 1e-6:
            raise ValueError(
                f"quantum: a multiple of {resolution:g} m/s2, the resolution of the frames, "
                f"expected, got {quantum}"
            )
        self._quantum = max(1, round(multiple))
        # 1.4 / 1e-5 is 139999.99...: the slack keeps a cap that is a multiple of the quantum.
        self._cap = math.floor(acceleration_cap / resolution * (1.0 + 1e-12))
        self._limit = self._cap // self._quantum * self._quantum
        if not 0.0 <= smallest <= acceleration_cap:
            raise ValueError(f"smallest: 0 to {acceleration_cap:g} m/s2 expected, got {smallest}")
        fewest = math.ceil(smallest / resolution / self._quantum - 1e-9)
        self._smallest = min(fewest * self._quantum, self._limit)

    def receive(self, frame: can.Message, now: float) -> list[can.Message]:
        """Take a frame of the bus.

        Parameters
        ----------
        frame
            Any frame; those of other senders are ignored, damaged ones counted.
        now
            Monotonic seconds of wall time.

        Returns
        -------
        list of can.Message
            The report, if the frame completes a command.
        """
        message = self._command_messages.get(frame.arbitration_id)
        if message is None or frame.is_extended_id or frame.is_error_frame:
            return []
        first = self._first_half
        if message.name != "ThrusterIsolation":
            self._first_half = None
        values = decode_frame(message, frame)
        if values is None:
            self.rejected_frames += 1
            return []
        if message.name == "ThrusterIsolation":
            self._isolate(values)
            return []
        if message.name == "ThrustCommandRT":
            self.rejected_frames += first is not None
            self._first_half = values
            return []
        if first is None or first["Sequence"] != values["Sequence"]:
            self.rejected_frames += 1
            return []
        counts = (first["AccelerationR"], first["AccelerationT"], values["AccelerationN"])
        return self._execute(
            _Command(
                values["Sequence"], first["GpsWeek"], values["TimeOfWeek"], counts, values["Mode"]
            ),
            now,
        )

    def _isolate(self, values: dict[str, int]) -> None:
        """Shut off axes, and open the others."""
        radial, in_track, cross_track = (bool(values[f"Isolated{axis}"]) for axis in "RTN")
        isolated = (radial, in_track, cross_track)
        if isolated != self._isolated:
            names = [axis for axis, is_it in zip("RTN", isolated, strict=True) if is_it]
            LOGGER.warning("isolated axes: %s", ", ".join(names) or "none")
        self._isolated = isolated

    def tick(self, now: float) -> list[can.Message]:
        """Return what is due without being asked: heartbeats, and a report of a watchdog trip.

        Parameters
        ----------
        now
            Monotonic seconds of wall time.
        """
        if self._started_at is None:
            self._started_at = self._heartbeat_at = now
        due: list[can.Message] = []
        silence = now - self._last_command_at
        if (
            self._realtime
            and self._last_command is not None
            and self._state != STATE_WATCHDOG
            and silence > self._watchdog_timeout
        ):
            LOGGER.warning("no command for %.1f s: no thrust", silence)
            self._cut()
            due += self._report(self._last_command, _NO_THRUST, (False, False, False))
        if now >= self._heartbeat_at:
            self._heartbeat_at = now + HEARTBEAT_INTERVAL
            due.append(self._heartbeat(now - self._started_at))
        return due

    def _execute(self, command: _Command, now: float) -> list[can.Message]:
        previous = self._last_command
        self._last_command_at = now
        if command == previous and self._state != STATE_WATCHDOG:
            return self._last_answer  # sent again, because the answer was lost or slow
        self.commands += 1
        if previous is not None:
            expected = (previous.sequence + 1) % self._sequence_modulus
            self.sequence_gaps += command.sequence != expected
            pause = (command.start - previous.start) * 1e-3
            if not self._realtime and pause > self._watchdog_timeout:
                self._cut()
        self._last_command = command
        fault = command.mode not in (MODE_OFF, MODE_THRUST)
        wanted = command.counts if command.mode == MODE_THRUST else _NO_THRUST
        applied = tuple(
            0 if is_isolated else self._achievable(count)
            for count, is_isolated in zip(wanted, self._isolated, strict=True)
        )
        self._state = STATE_THRUSTING if any(applied) else STATE_READY
        if fault:
            self._state = STATE_FAULT
        saturated = tuple(abs(count) > self._cap for count in wanted)
        self._last_answer = self._report(command, applied, saturated, fault)
        return self._last_answer

    def _achievable(self, count: int) -> int:
        """Return the nearest multiple of the quantum (a tie: the even one) within the limits."""
        if 2 * abs(count) < self._smallest:
            return 0
        capped = max(-self._cap, min(self._cap, count))
        rounded = round(capped / self._quantum) * self._quantum
        size = max(self._smallest, min(self._limit, abs(rounded)))
        return int(math.copysign(size, count))

    def _cut(self) -> None:
        self._state = STATE_WATCHDOG
        self._cut_since_report = True
        self.watchdog_trips += 1

    def _report(
        self,
        command: _Command,
        applied: Sequence[int],
        saturated: Sequence[bool],
        fault: bool = False,
    ) -> list[can.Message]:
        watchdog, self._cut_since_report = self._cut_since_report, False
        first = {
            "Sequence": command.sequence,
            "SaturatedR": saturated[0],
            "SaturatedT": saturated[1],
            "SaturatedN": saturated[2],
            "Watchdog": watchdog,
            "Fault": fault,
            "AccelerationR": applied[0],
            "AccelerationT": applied[1],
        }
        second = {
            "Sequence": command.sequence,
            "AccelerationN": applied[2],
            "TimeOfWeek": command.time_of_week,
        }
        return [self._frame("ThrustReportRT", first), self._frame("ThrustReportN", second)]

    def _heartbeat(self, uptime: float) -> can.Message:
        values = {
            "Sequence": self._heartbeats % self._sequence_modulus,
            "State": self._state,
            "RejectedFrames": min(self.rejected_frames, _LARGEST_COUNTER),
            "SequenceGaps": min(self.sequence_gaps, _LARGEST_COUNTER),
            "Uptime": min(int(uptime), _LARGEST_COUNTER),
        }
        self._heartbeats += 1
        return self._frame("ThrusterHeartbeat", values)

    def _frame(self, name: str, values: dict[str, int]) -> can.Message:
        return encode_frame(self._messages[name], values)


def serve(
    thruster: CanThruster, open_bus: Callable[[], can.BusABC], stopped: Callable[[], bool]
) -> None:
    """Answer on a bus until stopped; open it again when it fails.

    Parameters
    ----------
    thruster
        The thruster.
    open_bus
        Called without arguments to open the bus.
    stopped
        Asked at least every `LONGEST_WAIT`.

    Raises
    ------
    can.CanInterfaceNotImplementedError
        If the interface does not exist.
    """
    connection = BusConnection(open_bus)
    errors = 0
    with contextlib.closing(connection):
        while not stopped():
            if not connection.connect():
                time.sleep(FIRST_RETRY)
            frame = connection.receive(LONGEST_WAIT)
            now = time.monotonic()
            answers = [] if frame is None else thruster.receive(frame, now)
            connection.send((*answers, *thruster.tick(now)), LONGEST_WAIT)
            if connection.errors > errors:
                errors = connection.errors
                LOGGER.warning("bus: %s; trying again", connection.problem)


def _limits(options: argparse.Namespace) -> dict[str, float]:
    """Return the limits of the device, with those that are given in their place."""
    limits = dataclasses.asdict(DEVICES[options.device])
    given = {name: getattr(options, name) for name in limits}
    return limits | {name: value for name, value in given.items() if value is not None}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the emulator until SIGINT, SIGTERM or SIGHUP; return the exit code."""
    options = _parser().parse_args(arguments)
    logging.basicConfig(
        level=options.log_level.upper(), format="%(name)s: %(levelname)s: %(message)s"
    )
    stop = StopRequest()
    stop.install()
    watch_lifeline()
    try:
        thruster = CanThruster(
            options.dbc,
            watchdog_timeout=options.watchdog_timeout,
            clock_mode=options.clock,
            **_limits(options),
        )
        with _lock_bus(options):
            serve(
                thruster,
                lambda: open_bus(options.interface, options.channel, options.port),
                lambda: stop.requested,
            )
    except (ValueError, can.CanInterfaceNotImplementedError) as error:
        LOGGER.error("%s", error)
        return 1
    LOGGER.info(
        "%d commands, %d rejected frames, %d sequence gaps, %d watchdog trips",
        thruster.commands,
        thruster.rejected_frames,
        thruster.sequence_gaps,
        thruster.watchdog_trips,
    )
    return 0


def _lock_bus(options: argparse.Namespace) -> socket.socket:
    """Return what keeps other emulators of this machine from the bus until it is closed.

    Two thrusters on one bus, perhaps of two runs, would both answer every command.

    Raises
    ------
    ValueError
        If another emulator has the bus.
    """
    lock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    bus = f"{options.interface} {options.channel} port {options.port}"
    try:
        lock.bind(f"\0vtff thruster {bus}")
    except OSError:
        lock.close()
        raise ValueError(
            f"another emulated thruster is on {bus}; each thruster needs a bus of its own"
        ) from None
    return lock


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="can_thruster_emulator", description="Emulator of a thruster on a CAN bus."
    )
    parser.add_argument("--dbc", type=Path, required=True, help="DBC file with the frames")
    parser.add_argument(
        "--interface",
        default="udp_multicast",
        help="interface of python-can: socketcan, ..., or udp_multicast, which stays on this "
        "machine (%(default)s)",
    )
    parser.add_argument(
        "--channel", default="239.74.163.2", help="bus of that interface (%(default)s)"
    )
    parser.add_argument(
        "--port", type=int, default=0, help="UDP port of udp_multicast, 0 = its default"
    )
    parser.add_argument(
        "--device",
        choices=DEVICES,
        default="reference",
        help="cap, quantum and smallest acceleration are those of this thruster (%(default)s)",
    )
    for name, meaning in (
        ("acceleration-cap", "largest acceleration on each axis"),
        ("quantum", "smallest change of the acceleration"),
        ("smallest", "smallest acceleration on an axis but none"),
    ):
        parser.add_argument(
            f"--{name}", type=float, metavar="M/S2", help=f"{meaning}, in place of the device's"
        )
    parser.add_argument(
        "--watchdog-timeout",
        type=float,
        default=WATCHDOG_TIMEOUT,
        metavar="SECONDS",
        help="time without a command after which there is no thrust (%(default)s)",
    )
    parser.add_argument(
        "--clock",
        choices=CLOCK_MODES,
        default="lockstep",
        help="what the watchdog goes by: the times in the commands, or the wall clock",
    )
    parser.add_argument(
        "--log-level", choices=("debug", "info", "warning", "error"), default="info"
    )
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
