"""Frames between a controller and an ADCS module on a CAN bus, seen from the controller.

Identifiers, bits, scales and ranges are those of a DBC file (config/can/vtff_adcs.dbc); docs/can.md
says what it means. A report is a first frame, one frame for each sample of the magnetometer, and a
last frame, all with the same sequence number; a command is one frame, with a firing two.
"""

from __future__ import annotations

import math
import pathlib
from dataclasses import dataclass
from typing import Any

import can
import numpy as np

from vtff_control.bus.database import load_messages
from vtff_control.bus.frames import encode_frame, find_damage
from vtff_dynamics.vectors import FloatArray

__all__ = ["AdcsAnswer", "AdcsFrameError", "AdcsFrames", "AdcsModuleReport"]

_PULSES = ("PulseX", "PulseY", "PulseZ")
_FIELD = ("FieldX", "FieldY", "FieldZ")
_SIGNALS = {
    "AdcsCommand": ("Checksum", "Sequence", "Mode", *_PULSES, "WheelSpeed"),
    "AdcsFiring": ("Checksum", "Sequence", "Start", "Duration"),
    "AdcsAnswer": ("Checksum", "Sequence", "Fires", *_PULSES, "WheelSpeed"),
    "AdcsTime": ("Checksum", "Sequence", "TimeOfWeek", "WheelCommand", "Samples", "Period"),
    "AdcsMagnetometer": ("Checksum", "Sequence", "Sample", *_FIELD),
    "AdcsStatus": ("Checksum", "Sequence", *_PULSES, "WheelSpeed"),
}


class AdcsFrameError(ValueError):
    """A frame of the module is damaged or out of turn; the text says which."""


@dataclass(frozen=True)
class AdcsAnswer:
    """Answer of the module to a command: what it will give in the period.

    Attributes
    ----------
    sequence
        Sequence number of the command.
    pulse_steps
        Steps of the pulses, with the sign of the moment.
    wheel_speed_rpm
        Speed at the end of the period.
    fires
        True if the thruster will fire as told.
    """

    sequence: int
    pulse_steps: tuple[int, int, int]
    wheel_speed_rpm: float
    fires: bool


@dataclass(frozen=True)
class AdcsModuleReport:
    """Report of the module at the end of a period.

    Attributes
    ----------
    sequence
        Number of the report, 0 to 15.
    time_of_week
        GPS time of week at the end of the period, s.
    period
        Length of the period, s; 0 before the first.
    field_body
        Samples of the magnetometer, T, shape (count, 3), in the order of time.
    pulse_steps
        Pulses given.
    wheel_command_rpm, wheel_speed_rpm
        Speed that the wheel was told to have now, and the measured one.
    """

    sequence: int
    time_of_week: float
    period: float
    field_body: FloatArray
    pulse_steps: tuple[int, int, int]
    wheel_command_rpm: float
    wheel_speed_rpm: float


class AdcsFrames:
    """Encoder of commands, decoder of answers and reports.

    Parameters
    ----------
    dbc_file
        Path of the DBC file.

    Attributes
    ----------
    sequence_modulus
        Sequence numbers run from 0 to one less.
    command_identifiers
        CAN identifiers of the frames that the controller sends.
    largest_pulse
        Longest pulse that a frame can hold, steps.
    largest_wheel_speed_rpm
        Largest speed that a frame can hold, either way.

    Raises
    ------
    ValueError
        If the file cannot be read or lacks a message or signal; the message names it.
    """

    def __init__(self, dbc_file: str | pathlib.Path) -> None:
        self._messages = load_messages(dbc_file, _SIGNALS)
        self._by_identifier = {message.frame_id: message for message in self._messages.values()}
        command = self._messages["AdcsCommand"]
        self.command_identifiers = frozenset(
            self._messages[name].frame_id for name in ("AdcsCommand", "AdcsFiring")
        )
        self.sequence_modulus = 2 ** command.get_signal_by_name("Sequence").length
        self.largest_pulse = 2 ** (command.get_signal_by_name("PulseX").length - 1) - 1
        wheel = command.get_signal_by_name("WheelSpeed")
        self._wheel_scale = float(wheel.scale)
        self._largest_wheel = 2 ** (wheel.length - 1) - 1
        self.largest_wheel_speed_rpm = self._largest_wheel * self._wheel_scale
        firing = self._messages["AdcsFiring"].get_signal_by_name("Start")
        self._largest_firing = 2**firing.length - 1
        self._report: dict[str, Any] | None = None
        self._samples: list[tuple[float, float, float]] = []

    def encode_command(
        self,
        sequence: int,
        pulse_steps: tuple[int, int, int],
        wheel_speed_rpm: float,
        mode: int = 0,
        firing: tuple[int, int] = (0, 0),
    ) -> tuple[can.Message, ...]:
        """Return the frames of a command: with a firing two, else one.

        Parameters
        ----------
        sequence
            Number of the command, 0 to ``sequence_modulus - 1``.
        pulse_steps
            Steps of the pulses, with the sign of the moment.
        wheel_speed_rpm
            Speed at the end of the period; rounded to the resolution of the frame.
        mode
            Number of the mode of the controller, for the record.
        firing
            Start and length of a firing of the thruster, steps; no firing with a length of 0.

        Raises
        ------
        ValueError
            If a value does not fit; the message names it.
        """
        if not 0 <= sequence < self.sequence_modulus:
            raise ValueError(f"sequence: 0 to {self.sequence_modulus - 1} expected, got {sequence}")
        if len(pulse_steps) != 3 or max(map(abs, pulse_steps)) > self.largest_pulse:
            raise ValueError(
                f"pulse_steps: three within +-{self.largest_pulse} expected, got {pulse_steps}"
            )
        if not abs(wheel_speed_rpm) <= self.largest_wheel_speed_rpm:
            raise ValueError(
                f"wheel_speed_rpm: within +-{self.largest_wheel_speed_rpm:g} rpm expected, got "
                f"{wheel_speed_rpm:g}"
            )
        if not all(0 <= steps <= self._largest_firing for steps in firing):
            raise ValueError(f"firing: 0 to {self._largest_firing} steps expected, got {firing}")
        values = dict(zip(_PULSES, pulse_steps, strict=True))
        values |= {
            "Sequence": sequence,
            "Mode": mode,
            "WheelSpeed": round(wheel_speed_rpm / self._wheel_scale),
        }
        command = self._frame("AdcsCommand", values)
        if not firing[1]:
            return (command,)
        values = {"Sequence": sequence, "Start": firing[0], "Duration": firing[1]}
        return self._frame("AdcsFiring", values), command

    def decode(self, frame: can.Message) -> AdcsAnswer | AdcsModuleReport | None:
        """Take the next frame of the bus.

        Returns
        -------
        AdcsAnswer, AdcsModuleReport or None
            A report with its last frame, an answer, or None; frames of others are ignored.

        Raises
        ------
        AdcsFrameError
            If a frame of the module has a wrong length or checksum, or a frame of its report is
            missing. The next frame can be decoded.
        """
        message = self._by_identifier.get(frame.arbitration_id)
        if message is None or frame.is_extended_id or frame.is_error_frame:
            return None
        if frame.arbitration_id in self.command_identifiers:
            return None  # our own, on a bus that gives them back, or in a log
        if damage := find_damage(message, frame):
            raise AdcsFrameError(damage)
        values = message.decode(bytes(frame.data), decode_choices=False, scaling=True)
        if message.name == "AdcsAnswer":
            return AdcsAnswer(
                values["Sequence"],
                _pulses(values),
                float(values["WheelSpeed"]),
                bool(values["Fires"]),
            )
        return self._take_part_of_report(message.name, values)

    def _take_part_of_report(self, name: str, values: dict[str, Any]) -> AdcsModuleReport | None:
        first = self._report
        if name == "AdcsTime":
            self._report, self._samples = values, []
            if first is not None:
                raise AdcsFrameError("AdcsTime: the report before it has no AdcsStatus")
            return None
        if first is None or first["Sequence"] != values["Sequence"]:
            self._report = None
            raise AdcsFrameError(f"{name}: no AdcsTime of the same sequence number")
        if name == "AdcsMagnetometer":
            if values["Sample"] != len(self._samples):
                self._report = None
                raise AdcsFrameError(
                    f"AdcsMagnetometer: sample {values['Sample']}, {len(self._samples)} expected"
                )
            x, y, z = (float(values[axis]) for axis in _FIELD)
            self._samples.append((x, y, z))
            return None
        self._report = None
        if len(self._samples) != first["Samples"]:
            raise AdcsFrameError(
                f"AdcsStatus: {len(self._samples)} samples, {first['Samples']} expected"
            )
        return AdcsModuleReport(
            values["Sequence"],
            1e-2 * first["TimeOfWeek"],
            float(first["Period"]),
            np.array(self._samples, dtype=float).reshape(-1, 3),
            _pulses(values),
            float(first["WheelCommand"]),
            float(values["WheelSpeed"]),
        )

    def _frame(self, name: str, values: dict[str, int]) -> can.Message:
        return encode_frame(self._messages[name], values)


def _pulses(values: dict[str, Any]) -> tuple[int, int, int]:
    x, y, z = (int(values[axis]) for axis in _PULSES)
    return x, y, z


def same_time_of_week(first: float, second: float) -> bool:
    """Return whether two times of week, s, are equal to the resolution of the frames."""
    return abs(math.remainder(first - second, 604800.0)) < 6e-3
