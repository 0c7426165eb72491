"""State machine of the SimGEN emulator: scenario states 0 to 7, commands, scenario time.

`ScenarioMachine` takes one command line and returns one reply; it does no input or output and
reads the wall clock only through the callable that it is given. Scenario time runs in one of two
ways. `realtime`: with the wall clock from RU on. `lockstep`: it is the newest time stamp for which
every vehicle has a motion command, so that a run is as fast as its client and repeatable.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime, leap_seconds
from vtff_sim_bridge.simremote.language import (
    Command,
    Reply,
    SimGenStatus,
    SimRemoteSyntaxError,
    format_calendar,
    format_duration,
    parse_antenna_id,
    parse_calendar,
    parse_command,
    parse_duration,
    parse_geodetic_motion,
    parse_motion,
    parse_number,
    parse_vehicle_id,
    quote,
)
from vtff_sim_bridge.simremote.motion import (
    GeodeticMotionState,
    MotionError,
    MotionState,
    VehicleMotion,
)
from vtff_sim_bridge.simremote.power_command import PowerCommand

LOGGER = logging.getLogger("simgen_emulator")

CLOCK_MODES = ("lockstep", "realtime")
IDENTITY = "Spirent SimGEN, emulated by vtff"
DEFAULT_START_TIME = "01-Jan-2016 00:00:00"
"""Start that a loaded scenario has until START_TIME; the emulator does not read .scn files."""
DEFAULT_DURATION = 86400
"""Duration in s that a loaded scenario has until START_TIME gives one."""
MAXIMUM_POWER_COMMANDS = 10_000
"""Most power commands that a scenario stores."""
ITERATION_PERIOD_NANOSECONDS = 10_000_000
"""Step of scenario time in realtime mode: SimGEN's common iteration rate of 10 ms."""

_NOT_RUNNING_TEXT = "scenario is loading or has ended"
_BEFORE_RUN = (SimGenStatus.READY, SimGenStatus.ARMING, SimGenStatus.ARMED)
_MOTION_ALLOWED = (*_BEFORE_RUN, SimGenStatus.RUNNING, SimGenStatus.PAUSED)
_IN_RUN = (SimGenStatus.RUNNING, SimGenStatus.PAUSED)


class CommandRefusedError(Exception):
    """A well-formed command that the simulator does not do now, or not at all."""


class _Rule(NamedTuple):
    """Rule of a verb: its handler, and the words that the grammar allows around it."""

    handler: Callable[[ScenarioMachine, Command], str | None]
    maximum_arguments: int
    needs_timestamp: bool = False
    takes_time: bool = False


class ScenarioMachine:
    """State of the emulated simulator.

    Parameters
    ----------
    vehicle_ids : sequence of str
        Vehicles of the scenario, such as ``("v1_m1", "v2_m1")``.
    clock_mode : {"lockstep", "realtime"}
        Clock that drives scenario time.
    arming_delay, loading_delay : float
        Wall time that AR and SC take, s (a real unit needs 25 to 40 s to arm).
    monotonic : callable
        Wall clock in s.

    Attributes
    ----------
    status : SimGenStatus
        Where the scenario is.
    motions : dict of str to VehicleMotion
        Motion of every vehicle. At a time observer's call it reaches back to the call before.
    power_commands : list of PowerCommand
        Power commands since the scenario was loaded or rewound.
    start_time_seconds : int
        Start of the scenario, s since 1980-01-06 00:00:00 GPS. That START_TIME is GPS time, and
        not UTC, is an assumption.
    duration_seconds : int
        Length of the scenario.
    observers : list of callable
        Each is called with the time into the run in nanoseconds: with 0 when a run starts, then
        whenever scenario time has advanced.

    Raises
    ------
    ValueError
        If a parameter is out of range.
    """

    def __init__(
        self,
        vehicle_ids: Sequence[str],
        *,
        clock_mode: str = "lockstep",
        arming_delay: float = 0.0,
        loading_delay: float = 0.0,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        if clock_mode not in CLOCK_MODES:
            raise ValueError(f"clock_mode: one of {CLOCK_MODES} expected, got {clock_mode!r}")
        if not (arming_delay >= 0.0 and loading_delay >= 0.0):
            raise ValueError("arming_delay and loading_delay: 0 s or more expected")
        ids = [parse_vehicle_id(vehicle_id) for vehicle_id in vehicle_ids]
        if not ids or len(set(ids)) < len(ids):
            raise ValueError(f"vehicle_ids: different ids expected, got {list(vehicle_ids)}")
        self._clock_mode = clock_mode
        self._arming_delay = arming_delay
        self._loading_delay = loading_delay
        self._monotonic = monotonic
        self.motions = {vehicle_id: VehicleMotion() for vehicle_id in ids}
        self.observers: list[Callable[[int], None]] = []
        self.status = SimGenStatus.NO_SCENARIO
        self.scenario_path = ""
        self.power_commands: list[PowerCommand] = []
        self.start_time_seconds = parse_calendar(DEFAULT_START_TIME)
        self.duration_seconds = DEFAULT_DURATION
        self._time = 0
        self._run_began = 0.0
        self._busy_until = 0.0
        self._runs_when_armed = False

    @property
    def is_lockstep(self) -> bool:
        """Whether the motion commands drive the time into the run, not the wall clock."""
        return self._clock_mode == "lockstep"

    @property
    def time_nanoseconds(self) -> int:
        """Time into the run, ns: 0 before it, the last value after it."""
        return self._time

    def execute(self, line: str) -> Reply | None:
        """Carry out one command line.

        Returns
        -------
        Reply or None
            The reply; None when it has to wait: AR and RU answer once arming is over. The caller
            then asks `deferred_reply` and gives no other line of that client before.
        """
        self.poll()
        try:
            command = parse_command(line)
            text = self._rule_of(command).handler(self, command)
        except (SimRemoteSyntaxError, CommandRefusedError, MotionError) as error:
            return Reply(self.status, error_text=str(error))
        if self.status is SimGenStatus.ARMING and command.verb in ("AR", "RU"):
            return None
        return Reply(self.status, text)

    def deferred_reply(self) -> Reply | None:
        """Return the reply to a waiting AR or RU, None while arming goes on."""
        self.poll()
        return None if self.status is SimGenStatus.ARMING else Reply(self.status)

    def command_motion(
        self,
        vehicle_id: str,
        time_nanoseconds: int | None,
        motion: MotionState | GeodeticMotionState,
    ) -> None:
        """Take a motion command, whatever way it came.

        Raises
        ------
        CommandRefusedError
            If the vehicle is unknown or there is no scenario that could move.
        MotionError
            If the vehicle has too many commands waiting.
        """
        if self.status not in _MOTION_ALLOWED:
            self._require(_MOTION_ALLOWED, "motion")
        vehicle = self._vehicle(vehicle_id)
        stamp = self._time if time_nanoseconds is None else time_nanoseconds
        if isinstance(motion, GeodeticMotionState):
            motion = motion.to_earth_fixed()
        vehicle.command(stamp, motion)
        if self.status is SimGenStatus.RUNNING and self._clock_mode == "lockstep":
            if stamp > self._time and self._all_have_command_at(stamp):
                self._advance_to(stamp)

    def poll(self) -> None:
        """Make the changes that the wall clock brings: loaded, armed, time into the run."""
        if self.status is SimGenStatus.LOADING and self._monotonic() >= self._busy_until:
            self._change_to(SimGenStatus.READY)
        elif self.status is SimGenStatus.ARMING and self._monotonic() >= self._busy_until:
            self._change_to(SimGenStatus.ARMED)
            if self._runs_when_armed:
                self._start_run()
        elif self.status is SimGenStatus.RUNNING and self._clock_mode == "realtime":
            elapsed = int((self._monotonic() - self._run_began) * NANOSECONDS_PER_SECOND)
            elapsed -= elapsed % ITERATION_PERIOD_NANOSECONDS
            if elapsed > self._time:
                self._advance_to(elapsed)

    def seconds_to_next_change(self) -> float | None:
        """Return after how many seconds `poll` has something to do; None if never by itself."""
        if self.status in (SimGenStatus.LOADING, SimGenStatus.ARMING):
            return max(0.0, self._busy_until - self._monotonic())
        if self.status is SimGenStatus.RUNNING and self._clock_mode == "realtime":
            if self.observers:
                next_time = self._time + ITERATION_PERIOD_NANOSECONDS
            else:
                next_time = self.duration_seconds * NANOSECONDS_PER_SECOND
            due = self._run_began + next_time / NANOSECONDS_PER_SECOND
            return max(0.0, due - self._monotonic())
        return None

    # States and time

    def _change_to(self, status: SimGenStatus) -> None:
        if status is not self.status:
            LOGGER.info("%s -> %s", self.status.name, status.name)
        self.status = status

    def _arm(self, then_run: bool) -> None:
        """Begin to arm; it is over at once without an arming delay."""
        for vehicle_id, motion in self.motions.items():
            if not motion.has_command_at(0):
                raise CommandRefusedError(
                    f"{vehicle_id} has no motion at time 0: send MOT, MOTB or INIT_POS first"
                )
        self._runs_when_armed = then_run
        self._busy_until = self._monotonic() + self._arming_delay
        self._change_to(SimGenStatus.ARMING)
        if self._arming_delay == 0.0:
            self.poll()

    def _start_run(self) -> None:
        self._runs_when_armed = False
        self._run_began = self._monotonic()
        self._time = 0
        self._change_to(SimGenStatus.RUNNING)
        self._advance_to(0)
        if self._clock_mode == "lockstep":
            for stamp in next(iter(self.motions.values())).command_times_after(0):
                if self.status is SimGenStatus.RUNNING and self._all_have_command_at(stamp):
                    self._advance_to(stamp)

    def _advance_to(self, time_nanoseconds: int) -> None:
        """Advance scenario time, at most to the end of the scenario, and tell the observers."""
        end = self.duration_seconds * NANOSECONDS_PER_SECOND
        self._time = min(time_nanoseconds, end)
        for observer in self.observers:
            observer(self._time)
        for motion in self.motions.values():
            motion.forget_before(self._time)
        if self._time == end:
            self._change_to(SimGenStatus.ENDED)

    def _rewind(self) -> None:
        """Go back to the start; commands of the last run must not steer the next one."""
        self._time = 0
        self.power_commands.clear()
        for motion in self.motions.values():
            motion.clear()
        self._change_to(SimGenStatus.READY)

    def _all_have_command_at(self, time_nanoseconds: int) -> bool:
        return all(motion.has_command_at(time_nanoseconds) for motion in self.motions.values())

    # Checks

    def _rule_of(self, command: Command) -> _Rule:
        rule = _RULES.get(command.verb)
        if rule is None:
            raise CommandRefusedError(f"verb: {quote(command.verb)} is not emulated")
        if rule.needs_timestamp and not command.has_timestamp:
            raise SimRemoteSyntaxError(
                f"timestamp: {command.verb} needs one, such as '-,{command.verb}'"
            )
        if command.time_nanoseconds is not None and not rule.takes_time:
            raise CommandRefusedError(f"timestamp: only '-' is emulated for {command.verb}")
        if len(command.arguments) > rule.maximum_arguments:
            raise SimRemoteSyntaxError(
                f"argument {rule.maximum_arguments + 1}: {command.verb} takes at most "
                f"{rule.maximum_arguments}, got {len(command.arguments)}"
            )
        return rule

    def _vehicle(self, vehicle_id: str) -> VehicleMotion:
        vehicle = self.motions.get(vehicle_id)
        if vehicle is None:
            names = ", ".join(self.motions)
            raise CommandRefusedError(f"vehicle: {vehicle_id} is not in the scenario ({names})")
        return vehicle

    def _require(self, allowed: Sequence[SimGenStatus], what: str) -> None:
        if self.status not in allowed:
            names = " or ".join(f"{status:d} ({status.name.lower()})" for status in allowed)
            raise CommandRefusedError(
                f"{what} needs status {names}; it is {self.status:d} ({self.status.name.lower()})"
            )

    # Handlers of the verbs, in the order of the table below

    def _no_operation(self, command: Command) -> None:
        """Do nothing: the reply carries the status."""

    def _identify(self, command: Command) -> str:
        return IDENTITY

    def _select_scenario(self, command: Command) -> None:
        path = ",".join(command.arguments)
        if not path:
            raise SimRemoteSyntaxError("scenario: a path is missing")
        self._require((SimGenStatus.NO_SCENARIO, SimGenStatus.READY), "SC")
        self.scenario_path = path
        self.power_commands.clear()
        self.start_time_seconds = parse_calendar(DEFAULT_START_TIME)
        self.duration_seconds = DEFAULT_DURATION
        for motion in self.motions.values():
            motion.clear()
        self._busy_until = self._monotonic() + self._loading_delay
        self._change_to(SimGenStatus.LOADING)
        if self._loading_delay == 0.0:
            self.poll()

    def _scenario_name(self, command: Command) -> str:
        if command.arguments and command.arguments[0].lower() != "includepath":
            raise SimRemoteSyntaxError(
                f"argument 1: 'includepath' expected, got {quote(command.arguments[0])}"
            )
        path = self.scenario_path
        return path if command.arguments else path.replace("\\", "/").rpartition("/")[2]

    def _scenario_duration(self, command: Command) -> str:
        return format_duration(self.duration_seconds)

    def _start_time_text(self, command: Command) -> str:
        return format_calendar(self.start_time_seconds)

    def _set_start_time(self, command: Command) -> None:
        start = parse_calendar(command.arguments[0] if command.arguments else "")
        duration = self.duration_seconds
        if len(command.arguments) > 1:
            duration = parse_duration(command.arguments[1])
            if duration == 0:
                raise SimRemoteSyntaxError("duration: more than 0 s expected")
        self._require((SimGenStatus.READY,), "START_TIME")
        self.start_time_seconds = start
        self.duration_seconds = duration

    def _set_trigger(self, command: Command) -> None:
        mode = _whole_number("trigger", command.arguments, (0, 1, 2))
        self._require(_BEFORE_RUN, "TR")
        if mode != 0:
            raise CommandRefusedError("trigger: the emulator has no trigger input, only TR,0 works")

    def _arm_command(self, command: Command) -> None:
        self._require((SimGenStatus.READY,), command.verb)
        self._arm(then_run=False)

    def _run_command(self, command: Command) -> None:
        self._require(_BEFORE_RUN, command.verb)
        if self.status is SimGenStatus.ARMED:
            self._start_run()
        elif self.status is SimGenStatus.ARMING:
            self._runs_when_armed = True
        else:
            self._arm(then_run=True)

    def _end_run(self, command: Command) -> None:
        mode = _whole_number("stop_mode", command.arguments[:1] or ("0",), (0, 1))
        if self.status in (SimGenStatus.ARMING, SimGenStatus.ARMED):
            raise CommandRefusedError("an armed scenario cannot be ended: send RU, then EN")
        self._require((*_IN_RUN, SimGenStatus.ENDED), "EN")
        self._change_to(SimGenStatus.ENDED)
        if mode == 1:
            self._rewind()

    def _rewind_command(self, command: Command) -> None:
        self._require((SimGenStatus.READY, SimGenStatus.ENDED), "RW")
        if self.status is SimGenStatus.ENDED:
            self._rewind()

    def _time_text(self, command: Command) -> str:
        if self.status not in _IN_RUN:
            return _NOT_RUNNING_TEXT
        return f"{self._time / NANOSECONDS_PER_SECOND:.3f}"

    def _gps_seconds(self) -> int:
        return self.start_time_seconds + self._time // NANOSECONDS_PER_SECOND

    def _gps_time_text(self, command: Command) -> str:
        return str(self._gps_seconds())

    def _utc_time_text(self, command: Command) -> str:
        seconds = self._gps_seconds()
        seconds -= leap_seconds(GpsTime(seconds * NANOSECONDS_PER_SECOND))
        milliseconds = self._time // 1_000_000 % 1000
        return f"{format_calendar(seconds)}.{milliseconds:03d}"

    def _initial_position(self, command: Command) -> None:
        if len(command.arguments) != 4:
            raise SimRemoteSyntaxError(
                f"INIT_POS: vehicle, latitude, longitude and height expected, "
                f"got {len(command.arguments)} arguments"
            )
        vehicle = self._vehicle(parse_vehicle_id(command.arguments[0]))
        latitude_deg, longitude_deg, height = (
            parse_number(field, text)
            for field, text in zip(
                ("latitude", "longitude", "height"), command.arguments[1:], strict=True
            )
        )
        if abs(latitude_deg) > 90.0:
            raise SimRemoteSyntaxError(f"latitude: -90 to 90 deg expected, got {latitude_deg:g}")
        if abs(longitude_deg) > 360.0:
            raise SimRemoteSyntaxError(
                f"longitude: -360 to 360 deg expected, got {longitude_deg:g}"
            )
        self._require((SimGenStatus.READY,), "INIT_POS")
        position = (math.radians(latitude_deg), math.radians(longitude_deg), height)
        vehicle.command(0, GeodeticMotionState(position).to_earth_fixed())

    def _store_power(self, command: Command) -> None:
        verb, arguments = command.verb, command.arguments
        self._require(_MOTION_ALLOWED, verb)
        antenna_id, value = None, None
        values = arguments
        if verb != "REF_DBM":
            antenna_id = parse_antenna_id(arguments[0] if arguments else "")
            self._vehicle(antenna_id.partition("_")[0] + "_m1")
            values = arguments[1:]
        if verb == "POW_ON":
            value = float(_whole_number("switch", values[:1], (0, 1)))
        elif verb != "POW_MODE":
            value = parse_number("level", values[0] if values else "")
        stamp = self._time if command.time_nanoseconds is None else command.time_nanoseconds
        if len(self.power_commands) >= MAXIMUM_POWER_COMMANDS:
            raise CommandRefusedError(f"{MAXIMUM_POWER_COMMANDS} power commands are stored already")
        self.power_commands.append(PowerCommand(verb, stamp, antenna_id, value, arguments))

    def _motion_command(self, command: Command) -> None:
        vehicle_id, motion = parse_motion(command.arguments)
        self.command_motion(vehicle_id, command.time_nanoseconds, motion)

    def _geodetic_motion_command(self, command: Command) -> None:
        vehicle_id, motion = parse_geodetic_motion(command.arguments)
        self.command_motion(vehicle_id, command.time_nanoseconds, motion)


def _whole_number(field: str, texts: Sequence[str], allowed: tuple[int, ...]) -> int:
    """Return the first text as one of some whole numbers."""
    text = texts[0] if texts else ""
    for number in allowed:
        if text == str(number):
            return number
    choices = ", ".join(map(str, allowed))
    raise SimRemoteSyntaxError(f"{field}: one of {choices} expected, got {quote(text)}")


_MANY = 64
_RULES: dict[str, _Rule] = {
    "NULL": _Rule(ScenarioMachine._no_operation, 0),
    "*IDN?": _Rule(ScenarioMachine._identify, 0),
    "SC": _Rule(ScenarioMachine._select_scenario, _MANY),
    "SC_NAME": _Rule(ScenarioMachine._scenario_name, 1),
    "SC_DURATION": _Rule(ScenarioMachine._scenario_duration, 0),
    "STTIME": _Rule(ScenarioMachine._start_time_text, 0),
    "START_TIME": _Rule(ScenarioMachine._set_start_time, 3),
    "TR": _Rule(ScenarioMachine._set_trigger, 1),
    "AR": _Rule(ScenarioMachine._arm_command, 0),
    "AR_NOWAIT": _Rule(ScenarioMachine._arm_command, 0),
    "RU": _Rule(ScenarioMachine._run_command, 0),
    "RU_NOWAIT": _Rule(ScenarioMachine._run_command, 0),
    "EN": _Rule(ScenarioMachine._end_run, 2, needs_timestamp=True),
    "RW": _Rule(ScenarioMachine._rewind_command, 0),
    "TIME": _Rule(ScenarioMachine._time_text, 0, needs_timestamp=True),
    "GPS_TIME": _Rule(ScenarioMachine._gps_time_text, 0, needs_timestamp=True),
    "UTC_TIME": _Rule(ScenarioMachine._utc_time_text, 0, needs_timestamp=True),
    "INIT_POS": _Rule(ScenarioMachine._initial_position, 4, needs_timestamp=True),
    "POW_LEV": _Rule(ScenarioMachine._store_power, _MANY, needs_timestamp=True, takes_time=True),
    "POW_ON": _Rule(ScenarioMachine._store_power, _MANY, needs_timestamp=True, takes_time=True),
    "POW_MODE": _Rule(ScenarioMachine._store_power, _MANY, takes_time=True),
    "REF_DBM": _Rule(ScenarioMachine._store_power, 1, takes_time=True),
    "MOT": _Rule(ScenarioMachine._motion_command, _MANY, needs_timestamp=True, takes_time=True),
    "MOTB": _Rule(
        ScenarioMachine._geodetic_motion_command, _MANY, needs_timestamp=True, takes_time=True
    ),
}
