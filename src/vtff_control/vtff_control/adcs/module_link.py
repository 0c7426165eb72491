"""Exchange with one ADCS module on a CAN bus: reports in, commands out, answers in."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import can

from vtff_control.adcs.frames import (
    AdcsAnswer,
    AdcsFrameError,
    AdcsFrames,
    AdcsModuleReport,
    same_time_of_week,
)
from vtff_node.can_bus.connection import FIRST_RETRY, BusConnection

__all__ = ["AdcsCounters", "AdcsLink"]

RESEND_INTERVAL = 0.2  # s without an answer after which a command is sent again


@dataclass
class AdcsCounters:
    """Counts of events on the link since its start.

    Attributes
    ----------
    reports, missed_reports
        Reports that came, and periods without one.
    commands, answers, resent, unanswered
        Commands given, answered, sent again, never answered.
    rejected_frames
        Frames of the module that were damaged or out of turn.
    """

    reports: int = 0
    missed_reports: int = 0
    commands: int = 0
    answers: int = 0
    resent: int = 0
    unanswered: int = 0
    rejected_frames: int = 0


class AdcsLink:
    """The exchange, from one thread. The bus is opened again when it fails; nothing is raised.

    Parameters
    ----------
    frames : AdcsFrames
    open_bus
        Called without arguments to open the bus.
    on_frame
        Called with each frame that was sent or received, for a log.
    clock
        Monotonic seconds of wall time.

    Attributes
    ----------
    bus
        The connection.
    counters
        Events of the link so far.
    heard_at
        ``clock()`` at the newest frame of the module, or None.
    """

    def __init__(
        self,
        frames: AdcsFrames,
        open_bus: Callable[[], can.BusABC],
        on_frame: Callable[[can.Message], None] = lambda frame: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.bus = BusConnection(open_bus, clock)
        self.counters = AdcsCounters()
        self.heard_at: float | None = None
        self._frames = frames
        self._on_frame = on_frame
        self._clock = clock
        self._sequence = frames.sequence_modulus - 1
        self._command: tuple[can.Message, ...] = ()
        self._resend_at = 0.0

    def wait_for_report(
        self, timeout: float, time_of_week: float | None = None
    ) -> AdcsModuleReport | None:
        """Return the report of a time of week, s, or with None the next; None if none comes.

        Reports of other times are left out.

        Parameters
        ----------
        timeout
            Longest wait in s of wall time. Frames that have come by then are read, also where the
            wait is already over: the process may have been busy with something else.
        time_of_week
            GPS time of week at the end of the period.
        """
        deadline = self._clock() + timeout
        while True:
            now = self._clock()
            is_heard, content = self._next(max(0.0, deadline - now))
            if isinstance(content, AdcsModuleReport) and (
                time_of_week is None or same_time_of_week(content.time_of_week, time_of_week)
            ):
                self.counters.reports += 1
                return content
            if not is_heard and now >= deadline:
                return None

    def send_command(
        self,
        pulse_steps: tuple[int, int, int],
        wheel_speed_rpm: float,
        mode: int = 0,
        firing: tuple[int, int] = (0, 0),
    ) -> None:
        """Send a command; one before it that is still open is given up.

        Raises
        ------
        ValueError
            If a value does not fit the frames.
        """
        sequence = (self._sequence + 1) % self._frames.sequence_modulus
        command = self._frames.encode_command(sequence, pulse_steps, wheel_speed_rpm, mode, firing)
        self.give_up()
        self._sequence, self._command = sequence, command
        self._resend_at = self._clock() + RESEND_INTERVAL
        self.counters.commands += 1
        self._send()

    def wait_for_answer(self, timeout: float) -> AdcsAnswer | None:
        """Wait for the answer to the open command, and send the command again when due.

        Parameters
        ----------
        timeout
            Longest wait in s of wall time; the command stays open when it is over. Frames that have
            come by then are read.
        """
        deadline = self._clock() + timeout
        while self._command:
            now = self._clock()
            if self._resend_at <= now < deadline:
                self._resend_at = now + RESEND_INTERVAL
                self.counters.resent += 1
                self._send()
            is_heard, content = self._next(max(0.0, min(deadline, self._resend_at) - now))
            if isinstance(content, AdcsAnswer) and content.sequence == self._sequence:
                self._command = ()
                self.counters.answers += 1
                return content
            if not is_heard and now >= deadline:
                return None
        return None

    def give_up(self) -> None:
        """Close the open command, if there is one, and count it as never answered."""
        if self._command:
            self._command = ()
            self.counters.unanswered += 1

    def close(self) -> None:
        """Close the bus."""
        self.bus.close()

    def _send(self) -> None:
        self.bus.send(self._command, RESEND_INTERVAL)
        for frame in self._command:
            self._on_frame(frame)

    def _next(self, timeout: float) -> tuple[bool, AdcsAnswer | AdcsModuleReport | None]:
        """Return whether there is a frame, and what it completes.

        A bus that is not there takes the time.
        """
        if not self.bus.connect():
            time.sleep(min(timeout, FIRST_RETRY))
            return False, None
        frame = self.bus.receive(timeout)
        if frame is None:
            return False, None
        if frame.arbitration_id not in self._frames.command_identifiers:
            self._on_frame(frame)  # those that it sent are noted already
        try:
            content = self._frames.decode(frame)
        except AdcsFrameError:
            self.counters.rejected_frames += 1
            return True, None
        if content is not None:
            self.heard_at = self._clock()
        return True, content
