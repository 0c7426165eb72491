"""One run of SimGEN as the bridge sees it: start, a motion per step, end, and lost connections."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence

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


class SimGenLink:
    """Drives the vehicles of one SimGEN run.

    Parameters
    ----------
    client
        Connection to SimGEN; not yet connected.
    spacecraft
        Names in the order of SimGEN's vehicles: the first is ``v1_m1``.
    reconnect_timeout
        Seconds to wait for a lost connection to come back before that is an error (lockstep);
        None never waits: a step without connection is skipped and the next one tries again
        (realtime).

    Attributes
    ----------
    problem
        What is wrong with the connection now; empty if nothing.
    """

    def __init__(
        self,
        client: SimRemoteClient,
        spacecraft: Sequence[str],
        reconnect_timeout: float | None,
    ) -> None:
        self._client = client
        self._vehicles = {name: f"v{number}_m1" for number, name in enumerate(spacecraft, start=1)}
        self._reconnect_timeout = reconnect_timeout
        self._awaited = 0
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
        motions: Mapping[str, npt.NDArray[np.float64]],
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
            and jerk in ITRF.

        Raises
        ------
        SimRemoteError
            If SimGEN is not reached or refuses a command; the text names the command.
        """
        self._client.connect()
        initial = {self._vehicles[name]: motion_state(motion) for name, motion in motions.items()}
        self._client.prepare_run(scenario, epoch, duration, initial)
        self._client.run()
        self._started = True

    def time_into_run(self) -> float:
        """Ask SimGEN for the seconds since the start of the run.

        Raises
        ------
        SimRemoteError
            If it does not answer with a number.
        """
        reply = self._client.command("-,TIME")
        try:
            return float(reply.data_text or "")
        except ValueError:
            raise SimRemoteError(f"-,TIME: a number expected, got {reply.data_text!r}") from None

    def send(self, time: float, motions: Mapping[str, npt.NDArray[np.float64]]) -> None:
        """Send the motion of every spacecraft for a time (s into the run), in one packet.

        Raises
        ------
        SimRemoteError
            If the connection is lost and does not come back, or SimGEN no longer runs.
        """
        commands = [
            (self._vehicles[name], motion_state(motion)) for name, motion in motions.items()
        ]
        for attempt in range(2):
            try:
                if not self._client.is_connected and not self._connect_again():
                    return
                self._awaited = self._client.send_motion(time, commands)
                return
            except SimRemoteConnectionError as error:
                self._lost(error, final=attempt > 0)

    def receive(self) -> None:
        """Take the replies to what was sent.

        Raises
        ------
        SimRemoteError
            If SimGEN reports an error, or the connection is lost and waiting is over.
        """
        awaited, self._awaited = self._awaited, 0
        if not awaited:
            return
        try:
            self._client.receive_replies(awaited)
        except SimRemoteConnectionError as error:
            self._lost(error, final=False)

    def stop(self) -> None:
        """End the run and close the connection; does nothing if it was not started.

        Raises
        ------
        SimRemoteError
            If SimGEN does not end the run.
        """
        try:
            try:
                self.receive()
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

    def _lost(self, error: SimRemoteConnectionError, *, final: bool) -> None:
        self.problem = str(error)
        LOGGER.warning("%s", error)
        if final and self._reconnect_timeout is not None:
            raise error


def motion_state(motion: npt.NDArray[np.float64]) -> MotionState:
    """Return a motion array (4, 3) as the fields of a MOT command; attitude and rates are zero."""
    position, velocity, acceleration, jerk = (tuple(row) for row in motion.tolist())
    return MotionState(position, velocity, acceleration, jerk)
