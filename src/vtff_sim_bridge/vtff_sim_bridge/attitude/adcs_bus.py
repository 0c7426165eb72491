"""The emulated ADCS module as its CAN bus shows it: reports as frames, commands answered.

It knows its controller by the frames alone: their layout is that of the DBC file, their meaning
that of docs/can.md.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import cantools
import numpy as np

from vtff_dynamics.vectors import FloatArray
from vtff_node.can_bus.connection import FIRST_RETRY, BusConnection
from vtff_sim_bridge.thruster.device_frames import decode_frame, encode_frame

__all__ = ["AdcsBus", "AdcsModulePort"]

_NAMES = (
    "AdcsCommand",
    "AdcsFiring",
    "AdcsAnswer",
    "AdcsTime",
    "AdcsMagnetometer",
    "AdcsStatus",
)
_PULSES = ("PulseX", "PulseY", "PulseZ")
_FIELD = ("FieldX", "FieldY", "FieldZ")
_WEEK = 60_480_000  # steps of 10 ms


class AdcsModulePort:
    """The module without the bus: reports and commands in, frames out.

    Parameters
    ----------
    dbc_file
        Path of the DBC file.
    longest_pulse
        Longest pulse that leaves the quiet window free, steps.
    largest_wheel_speed_rpm
        Largest speed that the wheel reaches.

    Attributes
    ----------
    commands, rejected_frames
        Counts since the start; a repeated command does not count.

    Raises
    ------
    ValueError
        If the file is not that of an ADCS module.
    """

    def __init__(
        self, dbc_file: str | Path, longest_pulse: int = 400, largest_wheel_speed_rpm: float = 5e3
    ) -> None:
        try:
            database: Any = cantools.database.load_file(str(dbc_file), database_format="dbc")
            self._messages: dict[str, Any] = {
                name: database.get_message_by_name(name) for name in _NAMES
            }
        except (OSError, UnicodeDecodeError, KeyError, cantools.database.Error) as error:
            raise ValueError(f"{dbc_file}: not the DBC file of an ADCS module: {error}") from error
        self._commands = {
            self._messages[name].frame_id: self._messages[name]
            for name in ("AdcsCommand", "AdcsFiring")
        }
        field = self._messages["AdcsMagnetometer"].get_signal_by_name("FieldX")
        self._field_scale = float(field.scale)
        self._largest_field = 2 ** (field.length - 1) - 1
        self._wheel_scale = float(
            self._messages["AdcsStatus"].get_signal_by_name("WheelSpeed").scale
        )
        self._longest_pulse = longest_pulse
        self._largest_wheel = math.floor(largest_wheel_speed_rpm / self._wheel_scale + 1e-9)
        self._reports = 0
        self._firing: dict[str, int] | None = None
        self._last: int | None = None
        self.commands = 0
        self.rejected_frames = 0

    def report(
        self,
        time_of_week: float,
        period: float,
        field_body: FloatArray,
        pulse_steps: tuple[int, int, int],
        wheel_command_rpm: float,
        wheel_speed_rpm: float,
    ) -> list[can.Message]:
        """Return the frames of a report; see `vtff_control.adcs.frames.AdcsModuleReport`.

        Parameters
        ----------
        time_of_week, period
            s.
        field_body
            T, shape (count, 3); at most three samples.
        pulse_steps, wheel_command_rpm, wheel_speed_rpm
            Pulses given, wheel speed commanded and measured.
        """
        sequence = self._reports % 16
        self._reports += 1
        first = {
            "Sequence": sequence,
            "TimeOfWeek": round(time_of_week * 100.0) % _WEEK,
            "WheelCommand": self._wheel_count(wheel_command_rpm),
            "Samples": len(field_body),
            "Period": round(10.0 * period),
        }
        counts = np.clip(
            np.rint(field_body / self._field_scale), -self._largest_field, self._largest_field
        )
        samples = [
            {"Sequence": sequence, "Sample": number}
            | dict(zip(_FIELD, (int(value) for value in row), strict=True))
            for number, row in enumerate(counts)
        ]
        last = {"Sequence": sequence, "WheelSpeed": self._wheel_count(wheel_speed_rpm)}
        last |= dict(zip(_PULSES, pulse_steps, strict=True))
        return [
            self._frame("AdcsTime", first),
            *(self._frame("AdcsMagnetometer", sample) for sample in samples),
            self._frame("AdcsStatus", last),
        ]

    def receive(self, frame: can.Message) -> list[can.Message]:
        """Take a frame of the bus; return the answer if it completes a command."""
        message = self._commands.get(frame.arbitration_id)
        if message is None or frame.is_extended_id or frame.is_error_frame:
            return []
        values = decode_frame(message, frame)
        if values is None:
            self.rejected_frames += 1
            return []
        if message.name == "AdcsFiring":
            self._firing = values
            return []
        firing, self._firing = self._firing, None
        self.commands += values["Sequence"] != self._last
        self._last = values["Sequence"]
        largest, longest = self._largest_wheel, self._longest_pulse
        answer = {
            "Sequence": values["Sequence"],
            "Fires": int(firing is not None and firing["Sequence"] == values["Sequence"]),
            "WheelSpeed": max(-largest, min(largest, values["WheelSpeed"])),
        }
        answer |= {name: max(-longest, min(longest, values[name])) for name in _PULSES}
        return [self._frame("AdcsAnswer", answer)]

    def _wheel_count(self, speed_rpm: float) -> int:
        return round(speed_rpm / self._wheel_scale)

    def _frame(self, name: str, values: dict[str, int]) -> can.Message:
        return encode_frame(self._messages[name], values)


class AdcsBus:
    """The bus of the emulated module: a thread answers commands, any other sends reports.

    A bus that fails is opened again.

    Parameters
    ----------
    port : AdcsModulePort
    open_bus
        Called without arguments to open the bus.
    """

    LONGEST_WAIT = 0.1  # s

    def __init__(self, port: AdcsModulePort, open_bus: Callable[[], can.BusABC]) -> None:
        self._port = port
        self._connection = BusConnection(open_bus)
        self._lock = threading.Lock()  # frames of a report and of an answer do not mix
        self._stopped = threading.Event()
        self.is_off = False
        self._thread = threading.Thread(target=self._serve, daemon=True, name="adcs bus")

    @property
    def problem(self) -> str:
        """Why the bus is not there, one line; empty if it is."""
        return self._connection.problem

    def start(self) -> None:
        """Open the bus and begin to answer.

        Raises
        ------
        can.CanInterfaceNotImplementedError
            If the interface does not exist.
        """
        self._connection.connect()
        self._thread.start()

    def send(self, frames: list[can.Message]) -> None:
        """Send frames, unless the bus is off."""
        with self._lock:
            if not self.is_off:
                self._connection.send(frames, self.LONGEST_WAIT)

    def close(self) -> None:
        """End the thread and close the bus."""
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join()
        self._connection.close()

    def _serve(self) -> None:
        while not self._stopped.is_set():
            if not self._connection.connect():
                self._stopped.wait(FIRST_RETRY)
                continue
            frame = self._connection.receive(self.LONGEST_WAIT)
            if frame is not None and not self.is_off:
                answers = self._port.receive(frame)
                if answers:
                    self.send(answers)
