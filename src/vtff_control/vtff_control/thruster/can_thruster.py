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
from vtff_node.loopback_can_bus import LoopbackCanBus

RESEND_INTERVAL = 0.2  # s without an answer after which a command is sent again
FIRST_RETRY = 0.1  # s from a loss of the bus to the first attempt to open it again
LONGEST_RETRY = 2.0  # s, bound of the doubling pause between attempts

_BUS_ERRORS = (can.CanError, OSError)


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


def open_bus(interface: str, channel: str, port: int = 0) -> can.BusABC:
    """Open a CAN bus.

    Parameters
    ----------
    interface
        Interface of python-can: virtual (within a process), socketcan, that of an adapter, or
        udp_multicast, which reaches the programs of this machine only.
    channel
        Name of the bus: any text, vcan0, or an address of a multicast group.
    port
        UDP port of udp_multicast, 0 for its default; of no meaning otherwise.

    Raises
    ------
    can.CanError or OSError
        If it cannot be opened; `can.CanInterfaceNotImplementedError` if it never can.
    """
    if interface == "udp_multicast":
        return LoopbackCanBus(channel, port)
    return can.Bus(channel, interface)


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
    counters
        What has happened so far.
    heartbeat
        Newest sign of life, or None.
    heard_at
        ``clock()`` at the newest report or heartbeat, or None.
    problem
        Why the bus is not there, one line; empty if it is.
    watchdog_trips
        Reports that told of a cut by the thruster's watchdog.
    """

    def __init__(
        self,
        frames: ThrusterFrames,
        open_bus: Callable[[], can.BusABC],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.counters = LinkCounters()
        self.heartbeat: ThrusterHeartbeat | None = None
        self.heard_at: float | None = None
        self.problem = ""
        self.watchdog_trips = 0
        self._frames = frames
        self._open_bus = open_bus
        self._clock = clock
        self._bus: can.BusABC | None = None
        self._retry_at = -float("inf")
        self._retry_pause = FIRST_RETRY
        self._sequence = frames.sequence_modulus - 1
        self._isolation: tuple[can.Message, ...] = ()
        self._open_command: tuple[can.Message, ...] | None = None
        self._open_time_of_week = 0
        self._resend_at = 0.0

    def connect(self) -> bool:
        """Open the bus if it is not open and the next attempt is due; return whether it is open.

        Raises
        ------
        can.CanInterfaceNotImplementedError
            If the interface does not exist: no later attempt can help.
        """
        if self._bus is None and self._clock() >= self._retry_at:
            try:
                self._bus = self._open_bus()
            except can.CanInterfaceNotImplementedError:
                raise
            except _BUS_ERRORS as error:
                self._lose_bus(error)
            else:
                self.problem = ""
                self._retry_pause = FIRST_RETRY
        return self._bus is not None

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
            Longest wait in s of wall time; the command stays open when it is over.

        Returns
        -------
        ThrustReport or None
            The report of this very command, which is no longer open then; or None.
        """
        deadline = self._clock() + timeout
        while self._open_command is not None and (now := self._clock()) < deadline:
            if now >= self._resend_at:
                self._resend_at = now + RESEND_INTERVAL
                self.counters.resent += 1
                self._send(self._open_command)
            if not self.connect():
                time.sleep(min(deadline - now, FIRST_RETRY))
                continue
            frame = self._receive(min(deadline, self._resend_at) - now)
            report = None if frame is None else self._take(frame)
            if report is not None and self._is_awaited(report):
                self._open_command = None
                self.counters.reports += 1
                return report
        return None

    def give_up(self) -> None:
        """Close the open command, if there is one, and count it as never answered."""
        if self._open_command is not None:
            self._open_command = None
            self.counters.timeouts += 1

    def poll(self) -> None:
        """Take all waiting frames unless a command is open: its report must not be lost."""
        while self._open_command is None and (frame := self._receive(0.0)) is not None:
            report = self._take(frame)
            # A second answer to a repeated command is expected; a watchdog report comes unasked.
            if report is not None and report.sequence != self._sequence:
                self.counters.sequence_gaps += not report.watchdog

    def close(self) -> None:
        """Close the bus."""
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None

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
        if not self.connect():
            return
        assert self._bus is not None
        try:
            for frame in command:
                self._bus.send(frame, timeout=RESEND_INTERVAL)
        except _BUS_ERRORS as error:
            self._lose_bus(error)

    def _receive(self, timeout: float) -> can.Message | None:
        if not self.connect():
            return None
        assert self._bus is not None
        try:
            return self._bus.recv(timeout)
        except _BUS_ERRORS as error:
            self._lose_bus(error)
            return None

    def _lose_bus(self, error: Exception) -> None:
        self.counters.bus_errors += 1
        self.problem = str(error) or type(error).__name__
        bus, self._bus = self._bus, None
        self._retry_at = self._clock() + self._retry_pause
        self._retry_pause = min(2.0 * self._retry_pause, LONGEST_RETRY)
        if bus is not None:
            try:
                bus.shutdown()
            except _BUS_ERRORS as close_error:
                self.problem += f"; closing it failed too: {close_error}"
