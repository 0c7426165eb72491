"""Attitude of spacecraft in a recording: true, estimated, and what their modules were told."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_node.stamps import to_nanoseconds

__all__ = ["AttitudeCollector", "AttitudeColumns", "AttitudeRecording", "CommandColumns"]

_TOPIC = re.compile(r"^/(?P<craft>.+?)/(?P<name>truth/attitude|attitude|adcs/actuation)$")


@dataclass(frozen=True, eq=False)
class AttitudeColumns:
    """A true or estimated attitude, one row for each message.

    Attributes
    ----------
    time
        ns since 1970, ascending.
    quaternion
        Body to GCRF, x, y, z, w, shape (rows, 4).
    rate_body, dipole
        rad/s and A m2, shape (rows, 3).
    state_gcrf
        Position and velocity, m and m/s, shape (rows, 6).
    wheel_speed_rpm
        rpm.
    valid
        True where the attitude may steer.
    covariance
        Covariance of rotation (rad), rate and dipole, shape (rows, 9, 9); zero for truth.
    """

    time: npt.NDArray[np.int64]
    quaternion: FloatArray
    rate_body: FloatArray
    dipole: FloatArray
    state_gcrf: FloatArray
    wheel_speed_rpm: FloatArray
    valid: npt.NDArray[np.bool_]
    covariance: FloatArray


@dataclass(frozen=True, eq=False)
class CommandColumns:
    """Commands that a module accepted, one row for each period.

    Attributes
    ----------
    time
        Start of the period, ns since 1970.
    mode
        Mode of the controller, vtff_msgs/AdcsCommand.MODE_*.
    pulse_steps
        Steps of the pulses, shape (rows, 3).
    accepted
        False where the module did not answer.
    """

    time: npt.NDArray[np.int64]
    mode: npt.NDArray[np.int64]
    pulse_steps: FloatArray
    accepted: npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class AttitudeRecording:
    """The attitude of one spacecraft; None where a topic is not in the bag."""

    truth: AttitudeColumns | None = None
    estimate: AttitudeColumns | None = None
    command: CommandColumns | None = None


class AttitudeCollector:
    """Takes the messages of attitude."""

    def __init__(self) -> None:
        self._states: dict[tuple[str, str], list[tuple[Any, ...]]] = {}
        self._commands: dict[str, list[tuple[Any, ...]]] = {}

    def handler(self, topic: str) -> Callable[[Any], None] | None:
        """Return what takes the messages of a topic; None for other topics."""
        match = _TOPIC.match(topic)
        if match is None:
            return None
        craft, name = match["craft"], match["name"]
        if name == "adcs/actuation":
            commands = self._commands.setdefault(craft, [])

            def add_command(message: Any) -> None:
                time = to_nanoseconds(message.header.stamp)
                pulses = tuple(message.pulse_steps)
                commands.append((time, message.mode, *pulses, message.accepted))

            return add_command
        states = self._states.setdefault((craft, name), [])

        def add_state(message: Any) -> None:
            states.append(
                (
                    to_nanoseconds(message.header.stamp),
                    np.concatenate(
                        (
                            message.quaternion,
                            message.rate_body,
                            message.dipole,
                            message.position_gcrf,
                            message.velocity_gcrf,
                            [message.wheel_speed_rpm, message.valid],
                        )
                    ),
                    np.array(message.covariance),
                )
            )

        return add_state

    def recordings(self) -> dict[str, AttitudeRecording]:
        """Return the attitude of each spacecraft that has any, by name."""
        names = sorted({craft for craft, _ in self._states} | set(self._commands))
        recordings = {
            name: AttitudeRecording(
                self._columns(name, "truth/attitude"),
                self._columns(name, "attitude"),
                self._command_columns(name),
            )
            for name in names
        }
        return {
            name: recording
            for name, recording in recordings.items()
            if recording.truth is not None or recording.estimate is not None
        }

    def _columns(self, craft: str, name: str) -> AttitudeColumns | None:
        rows = self._states.get((craft, name))
        if not rows:
            return None
        time, first = np.unique(np.array([row[0] for row in rows]), return_index=True)
        values = np.array([row[1] for row in rows])[first]
        covariance = np.array([row[2] for row in rows])[first].reshape(-1, 9, 9)
        return AttitudeColumns(
            time,
            values[:, :4],
            values[:, 4:7],
            values[:, 7:10],
            values[:, 10:16],
            values[:, 16],
            values[:, 17] > 0.0,
            covariance,
        )

    def _command_columns(self, craft: str) -> CommandColumns | None:
        rows = self._commands.get(craft)
        if not rows:
            return None
        time, first = np.unique(np.array([row[0] for row in rows]), return_index=True)
        values = np.array([row[1:] for row in rows], dtype=float)[first]
        return CommandColumns(time, values[:, 0].astype(int), values[:, 1:4], values[:, 4] > 0.0)
