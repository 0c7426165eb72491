"""Link to one run of SimGEN: start, the motion of each step, end, and lost connections."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_sim_bridge.simremote.client import (
    ClientCounters,
    SimRemoteClient,
    SimRemoteConnectionError,
    SimRemoteError,
)
from vtff_sim_bridge.simremote.language import SimGenStatus
from vtff_sim_bridge.simremote.motion import MotionState

LOGGER = logging.getLogger("simgen_link")

#: Motion of each spacecraft, or a function that computes it.
Motions = Mapping[str, npt.NDArray[np.float64]]
#: Time into the run, s, and the motion of each vehicle then.
_Step = tuple[float, list[tuple[str, MotionState]]]


class SimGenLink:
    """Drives the vehicles of one SimGEN run.

    Parameters
    ----------
    client
        Client of SimREMOTE; not yet connected.
    spacecraft
        Names in the order of the vehicles of SimGEN: the first is ``v1_m1``.
    reconnect_timeout
        Lockstep: wall time, s, to wait for a lost connection before that is an error. Real time:
        None; a step without a connection is skipped and the next step connects again.
    patience_while_running
        Longest wait for a reply and for an attempt to connect while the run lasts, s; None for
        that of the client. In real time it is a part of a step, so that a link that is cut makes
        no step late.
    steps_together
        Steps whose motion is sent in one packet; the replies are then taken before the next packet.
        More than one only where nothing waits for what SimGEN does with a step: each exchange wakes
        two processes, which costs as much as the rest of a step. Steps without a reply are sent
        again after a lost connection.

    Attributes
    ----------
    problem
        The current problem of the connection; empty if there is none.
    """

    def __init__(
        self,
        client: SimRemoteClient,
        spacecraft: Sequence[str],
        reconnect_timeout: float | None,
        patience_while_running: float | None = None,
        steps_together: int = 1,
    ) -> None:
        self._client = client
        self._vehicles = {name: f"v{number}_m1" for number, name in enumerate(spacecraft, start=1)}
        self._reconnect_timeout = reconnect_timeout
        self._patience = client.timeout
        self._patience_while_running = patience_while_running
        self._steps_together = steps_together
        self._waiting: list[tuple[float, Motions | Callable[[], Motions]]] = []
        self._unsent: list[_Step] = []
        self._unanswered: list[_Step] = []
        self._awaited_replies = 0
        self._started = False
        self.problem = ""

    @property
    def counters(self) -> ClientCounters:
        """Commands, replies, errors and reconnections so far."""
        return self._client.counters

    def start(
        self,
        scenario: str,
        epoch: GpsTime,
        duration: float,
        motions: Motions,
    ) -> None:
        """Connect, load the scenario, place the vehicles, arm and run.

        Parameters
        ----------
        scenario
            Scenario file on the SimGEN host.
        epoch, duration
            Start and length (s) of the run.
        motions
            Initial motion of each spacecraft, shape (4, 3): position, velocity, acceleration
            and jerk in ITRF; shape (8, 3) with an attitude, see `motion_state`.

        Raises
        ------
        SimRemoteError
            If SimGEN cannot be reached or refuses a command; the text names the command.
        """
        self._client.connect()
        initial = {self._vehicles[name]: motion_state(motion) for name, motion in motions.items()}
        self._client.prepare_run(scenario, epoch, duration, initial)
        self._client.run()
        self._started = True
        if self._patience_while_running is not None:
            self._client.timeout = min(self._patience, self._patience_while_running)

    def time_into_run(self) -> float:
        """Ask SimGEN for the seconds since the start of the run.

        Raises
        ------
        SimRemoteError
            If SimGEN does not answer with a number.
        """
        reply = self._client.command("-,TIME")
        try:
            return float(reply.data_text or "")
        except ValueError:
            raise SimRemoteError(f"-,TIME: a number expected, got {reply.data_text!r}") from None

    def send(
        self,
        time: float,
        motions: Motions | Callable[[], Motions],
    ) -> None:
        """Send the motion of every spacecraft for a time (s into the run), in one packet.

        With `steps_together` the motion waits for that of further steps.

        Parameters
        ----------
        time
            s into the run.
        motions
            Motion of each spacecraft as for `start`, or a function that returns it. The function is
            called when the motion is sent: to compute many steps in a row is faster.

        Raises
        ------
        SimRemoteError
            If the connection is lost and cannot be restored, or SimGEN no longer runs; also where
            replies to earlier steps are taken, as in `receive`.
        """
        self._waiting.append((time, motions))
        if len(self._unsent) + len(self._waiting) >= self._steps_together:
            self._compute_waiting()
            self._receive_all()
            self._send_all()

    def receive(self) -> None:
        """Receive the replies to the commands that were sent, unless several steps go together.

        Raises
        ------
        SimRemoteError
            If SimGEN reports an error, or the connection is lost and not restored in time.
        """
        if self._steps_together == 1:
            self._receive_all()

    def complete(self) -> None:
        """Send the motion that waits for further steps, and receive all replies.

        Raises
        ------
        SimRemoteError
            As in `send` and `receive`.
        """
        self._compute_waiting()
        self._receive_all()
        self._send_all()
        self._receive_all()

    def _compute_waiting(self) -> None:
        """Compute the steps that wait, while SimGEN is still busy with those before.

        Where one cannot be computed, none of them is sent, at that time or later.
        """
        waiting, self._waiting = self._waiting, []
        self._unsent += [self._commands(*each) for each in waiting]

    def _commands(self, time: float, motions: Motions | Callable[[], Motions]) -> _Step:
        """Return the motion of the vehicles at a time."""
        computed = motions() if callable(motions) else motions
        return time, [
            (self._vehicles[name], motion_state(motion)) for name, motion in computed.items()
        ]

    def _send_all(self) -> None:
        steps, self._unsent = self._unsent, []
        if not steps:
            return
        for attempt in range(2):
            try:
                if not self._client.is_connected and not self._connect_again():
                    return
                self._awaited_replies = self._client.send_motions(steps)
                self._unanswered = steps
                return
            except SimRemoteConnectionError as error:
                self._note_lost_connection(error, final=attempt > 0)

    def _receive_all(self) -> None:
        awaited, self._awaited_replies = self._awaited_replies, 0
        if not awaited:
            return
        try:
            self._client.receive_replies(awaited)
        except SimRemoteConnectionError as error:
            self._note_lost_connection(error, final=False)
            if self._steps_together > 1:  # alone, a step has been overtaken by the next
                self._unsent = self._unanswered + self._unsent

    def stop(self) -> None:
        """End the run, if it was started, and close the connection.

        Raises
        ------
        SimRemoteError
            If SimGEN does not end the run.
        """
        self._client.timeout = self._patience
        try:
            try:
                self._receive_all()
            finally:
                if self._started and self._client.is_connected:
                    self._client.end()
        finally:
            self._client.close()

    def _connect_again(self) -> bool:
        if self._reconnect_timeout is not None:
            self._client.connect(self._reconnect_timeout)
        elif not self._client.try_connect():
            return False
        status = self._client.status()
        if status is not SimGenStatus.RUNNING:
            raise SimRemoteError(
                f"SimGEN answers again but no longer runs (status {status:d}, "
                f"{status.name.lower()})"
            )
        self.problem = ""
        return True

    def _note_lost_connection(self, error: SimRemoteConnectionError, *, final: bool) -> None:
        self.problem = str(error)
        LOGGER.warning("%s", error)
        if final and self._reconnect_timeout is not None:
            raise error


def motion_state(motion: npt.NDArray[np.float64]) -> MotionState:
    """Return a motion array as the fields of a MOT command.

    Parameters
    ----------
    motion : ndarray, shape (4, 3) or (8, 3)
        Position and its derivatives in ITRF, and attitude and its derivatives; without these the
        body stays aligned with north, east and down.
    """
    return MotionState(*map(tuple, motion.tolist()))
