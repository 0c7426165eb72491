"""A thruster on a CAN bus: commands out, reports and heartbeats in, and a bus that may go away."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import can
import numpy as np
import numpy.typing as npt

from vtff_control.thruster.can_frames import (
    MODE_THRUST,
    FrameError,
    ThrusterFrames,
    ThrusterHeartbeat,
    ThrustReport,
    time_of_week_milliseconds,
)
from vtff_dynamics.time.timescales import GpsTime
from vtff_node.can_bus.connection import FIRST_RETRY, BusConnection

RESEND_INTERVAL = 0.2  # s without an answer after which a command is sent again


@dataclass
class LinkCounters:
    """Counts of events on the link since its start.

    Attributes
    ----------
    commands, reports
        Commands given, and those that were answered.
    resent
        Repetitions of a command that was not answered at once.
    timeouts
        Commands that were never answered.
    sequence_gaps
        Jumps of the heartbeat's number, and reports that answer another command.
    rejected_frames
        Frames of the thruster that were damaged or lacked their other half.
    bus_errors
        Times that the bus failed or could not be opened.
    """

    commands: int = 0
    reports: int = 0
    resent: int = 0
    timeouts: int = 0
    sequence_gaps: int = 0
    rejected_frames: int = 0
    bus_errors: int = 0


class ThrusterLink:
    """Exchange of commands and reports with one thruster, from one thread.

    The bus is opened at first use. When it fails, it is closed and opened again with growing
    pauses; nothing is raised.

    Parameters
    ----------
    frames
        Encoder and decoder.
    open_bus
        Called without arguments to open the bus.
    clock
        Monotonic seconds of wall time.

    Attributes
    ----------
    heartbeat
        Newest sign of life, or None.
    heard_at
        ``clock()`` at the newest report or heartbeat, or None.
    watchdog_trips
        Reports that told of a cut by the thruster's watchdog.
    """

    def __init__(
        self,
        frames: ThrusterFrames,
        open_bus: Callable[[], can.BusABC],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._counters = LinkCounters()
        self.heartbeat: ThrusterHeartbeat | None = None
        self.heard_at: float | None = None
        self.watchdog_trips = 0
        self._frames = frames
        self._bus = BusConnection(open_bus, clock)
        self._clock = clock
        self._sequence = frames.sequence_modulus - 1
        self._isolation: tuple[can.Message, ...] = ()
        self._open_command: tuple[can.Message, ...] | None = None
        self._open_time_of_week = 0
        self._resend_at = 0.0

    @property
    def problem(self) -> str:
        """Why the bus is not there, one line; empty if it is."""
        return self._bus.problem

    @property
    def counters(self) -> LinkCounters:
        """Counts of events."""
        self._counters.bus_errors = self._bus.errors
        return self._counters

    def connect(self) -> bool:
        """Open the bus if it is not open and the next attempt is due; return whether it is open.

        Raises
        ------
        can.CanInterfaceNotImplementedError
            If the interface does not exist: no later attempt can help.
        """
        return self._bus.connect()

    def send_command(
        self, start: GpsTime, acceleration_rtn: npt.ArrayLike, mode: int = MODE_THRUST
    ) -> None:
        """Send a command; a command before it that is still open is given up.

        Parameters
        ----------
        start
            Time at which the thrust starts.
        acceleration_rtn
            Acceleration in m/s2, shape (3,), RTN axes of the chief at the start.
        mode
            `MODE_THRUST` or `MODE_OFF`.

        Raises
        ------
        ValueError
            If a value does not fit the frames.
        """
        sequence = (self._sequence + 1) % self._frames.sequence_modulus
        command = self._frames.encode_command(sequence, start, acceleration_rtn, mode)
        self.give_up()
        self.poll()
        self._sequence = sequence
        self._open_command = command
        self._open_time_of_week = time_of_week_milliseconds(start)
        self._resend_at = self._clock() + RESEND_INTERVAL
        self.counters.commands += 1
        self._send((*self._isolation, *command))

    def isolate(self, axes: npt.ArrayLike) -> None:
        """Shut off axes of the thruster, now and again before every command.

        The frame has no answer; it is sent again before each command, so that a thruster that has
        restarted, or lost it, shuts them off too.

        Parameters
        ----------
        axes
            Whether R, T and N are shut off, shape (3,).
        """
        self._isolation = (self._frames.encode_isolation(axes),)
        self._send(self._isolation)
        if not np.any(axes):
            self._isolation = ()

    def wait_for_report(self, timeout: float) -> ThrustReport | None:
        """Wait for the report of the open command, and send the command again when due.

        A repeated command keeps its sequence number; a thruster answers it again without acting
        twice.

        Parameters
        ----------
        timeout
            Longest wait in s of wall time; the command stays open when it is over. Frames that have
            come by then are read, also where the wait is already over: the process may have been
            busy with something else.

        Returns
        -------
        ThrustReport or None
            The report of this very command, which is no longer open then; or None.
        """
        deadline = self._clock() + timeout
        while self._open_command is not None:
            now = self._clock()
            if self._resend_at <= now < deadline:
                self._resend_at = now + RESEND_INTERVAL
                self.counters.resent += 1
                self._send(self._open_command)
            frame = None
            if self.connect():
                frame = self._bus.receive(max(0.0, min(deadline, self._resend_at) - now))
            elif now < deadline:
                time.sleep(min(deadline - now, FIRST_RETRY))
            report = None if frame is None else self._take(frame)
            if report is not None and self._is_awaited(report):
                self._open_command = None
                self.counters.reports += 1
                return report
            if frame is None and now >= deadline:
                return None
        return None

    def give_up(self) -> None:
        """Close the open command, if there is one, and count it as never answered."""
        if self._open_command is not None:
            self._open_command = None
            self.counters.timeouts += 1

    def poll(self) -> None:
        """Take all waiting frames unless a command is open: its report must not be lost."""
        while self._open_command is None and (frame := self._bus.receive(0.0)) is not None:
            report = self._take(frame)
            # A second answer to a repeated command is expected; a watchdog report comes unasked.
            if report is not None and report.sequence != self._sequence:
                self.counters.sequence_gaps += not report.watchdog

    def close(self) -> None:
        """Close the bus."""
        self._bus.close()

    def _is_awaited(self, report: ThrustReport) -> bool:
        """Return whether a report answers the open command; count one that answers another."""
        wanted = (self._sequence, self._open_time_of_week)
        if (report.sequence, report.time_of_week_milliseconds) == wanted:
            return True
        # A watchdog report is sent unasked and repeats the number of the command before.
        self.counters.sequence_gaps += not report.watchdog
        return False

    def _take(self, frame: can.Message) -> ThrustReport | None:
        """Decode a frame, keep a heartbeat, return a report."""
        try:
            content = self._frames.decode(frame)
        except FrameError:
            self.counters.rejected_frames += 1
            return None
        if content is None:
            return None
        self.heard_at = self._clock()
        if isinstance(content, ThrustReport):
            self.watchdog_trips += content.watchdog
            return content
        previous, self.heartbeat = self.heartbeat, content
        # A thruster that has restarted begins anew: that is no gap.
        if previous is not None and content.uptime >= previous.uptime:
            expected = (previous.sequence + 1) % self._frames.sequence_modulus
            self.counters.sequence_gaps += content.sequence != expected
        return None

    def _send(self, command: tuple[can.Message, ...]) -> None:
        self._bus.send(command, RESEND_INTERVAL)
