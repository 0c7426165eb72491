"""Frames between the controller and a thruster on a CAN bus, seen from the controller.

Identifiers, bits, scales and ranges are those of a DBC file (config/can/vtff_thruster.dbc), which
stands for the layout in vtff and in the tools of others; docs/can.md says what it means. A
command and a report need two frames each: both halves carry the same sequence number, and every
frame a checksum.
"""

from __future__ import annotations

import pathlib
from dataclasses import dataclass

import can
import numpy as np
import numpy.typing as npt

from vtff_control.bus.database import load_messages
from vtff_control.bus.frames import encode_frame, find_damage
from vtff_dynamics.constants import NANOSECONDS_PER_MILLISECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray, is_finite

MODE_OFF = 0
MODE_THRUST = 1

_SIGNALS = {
    "ThrustCommandRT": ("Checksum", "Sequence", "GpsWeek", "AccelerationR", "AccelerationT"),
    "ThrustCommandN": ("Checksum", "Sequence", "AccelerationN", "TimeOfWeek", "Mode"),
    "ThrustReportRT": (
        "Checksum", "Sequence", "SaturatedR", "SaturatedT", "SaturatedN", "Watchdog", "Fault",
        "AccelerationR", "AccelerationT",
    ),
    "ThrustReportN": ("Checksum", "Sequence", "AccelerationN", "TimeOfWeek"),
    "ThrusterHeartbeat": (
        "Checksum", "Sequence", "State", "RejectedFrames", "SequenceGaps", "Uptime",
    ),
    "ThrusterIsolation": ("Checksum", "IsolatedR", "IsolatedT", "IsolatedN"),
}  # fmt: skip


class FrameError(ValueError):
    """A frame of the thruster is damaged or lacks its other half; the text says which."""


@dataclass(frozen=True)
class ThrustReport:
    """Report of a thruster on a command.

    Attributes
    ----------
    sequence
        Sequence number of the command, 0 to 15.
    time_of_week_milliseconds
        GPS time of week at which the thrust starts, as the command had it.
    acceleration_rtn
        Acceleration in m/s2 after cap and quantum, shape (3,), RTN axes of the chief at the start.
    saturated
        True if the cap limited an axis.
    watchdog
        True if the thruster's watchdog has cut the thrust since the report before.
    fault
        True if the thruster refused the command.
    """

    sequence: int
    time_of_week_milliseconds: int
    acceleration_rtn: FloatArray
    saturated: bool
    watchdog: bool
    fault: bool


@dataclass(frozen=True)
class ThrusterHeartbeat:
    """A thruster's sign of life.

    Attributes
    ----------
    sequence
        Number of the heartbeat, 0 to 15.
    state
        Name of the state in the DBC file: Ready, Thrusting, Watchdog or Fault.
    rejected_frames, sequence_gaps
        Damaged command frames and jumps of the command sequence, as the thruster counts them.
    uptime
        Seconds since the thruster started.
    """

    sequence: int
    state: str
    rejected_frames: int
    sequence_gaps: int
    uptime: int


class ThrusterFrames:
    """Encoder of commands, decoder of reports and heartbeats.

    Parameters
    ----------
    dbc_file
        Path of the DBC file.

    Attributes
    ----------
    resolution
        Smallest difference of two accelerations in m/s2.
    largest_acceleration
        Largest acceleration in m/s2 that a frame can hold, on either side of zero.
    sequence_modulus
        Sequence numbers run from 0 to one less.

    Raises
    ------
    ValueError
        If the file cannot be read or lacks a message or signal; the message names it.
    """

    def __init__(self, dbc_file: str | pathlib.Path) -> None:
        self._messages = load_messages(dbc_file, _SIGNALS)
        self._by_identifier = {
            self._messages[name].frame_id: self._messages[name]
            for name in ("ThrustReportRT", "ThrustReportN", "ThrusterHeartbeat")
        }
        command = self._messages["ThrustCommandRT"]
        acceleration = command.get_signal_by_name("AccelerationR")
        self.resolution = float(acceleration.scale)
        # The range is symmetric: the most negative number of the signal is not used.
        self._largest_count = 2 ** (acceleration.length - 1) - 1
        self.largest_acceleration = self._largest_count * self.resolution
        self.sequence_modulus = 2 ** command.get_signal_by_name("Sequence").length
        self._week_modulus = 2 ** command.get_signal_by_name("GpsWeek").length
        self._states = self._messages["ThrusterHeartbeat"].get_signal_by_name("State").choices or {}
        self._first_half: dict[str, int] | None = None

    def encode_command(
        self,
        sequence: int,
        start: GpsTime,
        acceleration_rtn: npt.ArrayLike,
        mode: int = MODE_THRUST,
    ) -> tuple[can.Message, can.Message]:
        """Return the two frames of a command.

        Parameters
        ----------
        sequence
            Number of the command, 0 to ``sequence_modulus - 1``.
        start
            Time at which the thrust starts; whole milliseconds count.
        acceleration_rtn
            Acceleration in m/s2, shape (3,); rounded to the resolution, a tie to even.
        mode
            `MODE_THRUST`, or `MODE_OFF` to switch the thruster off.

        Raises
        ------
        ValueError
            If a value does not fit; the message names it.
        """
        if not 0 <= sequence < self.sequence_modulus:
            raise ValueError(f"sequence: 0 to {self.sequence_modulus - 1} expected, got {sequence}")
        if mode not in (MODE_OFF, MODE_THRUST):
            raise ValueError(f"mode: MODE_OFF or MODE_THRUST expected, got {mode}")
        quotients = np.asarray(acceleration_rtn, dtype=float) / self.resolution
        counts = None
        if quotients.shape == (3,) and is_finite(quotients):
            counts = [round(quotient) for quotient in quotients.tolist()]
        if counts is None or max(map(abs, counts)) > self._largest_count:
            raise ValueError(
                f"acceleration_rtn: three numbers within +-{self.largest_acceleration:g} m/s2 "
                f"expected, got {acceleration_rtn!r}"
            )
        radial, along_track, normal = counts
        first = {
            "Sequence": sequence,
            "GpsWeek": start.week % self._week_modulus,
            "AccelerationR": radial,
            "AccelerationT": along_track,
        }
        second = {
            "Sequence": sequence,
            "AccelerationN": normal,
            "TimeOfWeek": time_of_week_milliseconds(start),
            "Mode": mode,
        }
        return self._frame("ThrustCommandRT", first), self._frame("ThrustCommandN", second)

    def encode_isolation(self, axes: npt.ArrayLike) -> can.Message:
        """Return the frame that shuts off axes of the thruster, and opens the others.

        Parameters
        ----------
        axes
            Whether R, T and N are shut off, shape (3,).
        """
        radial, along_track, normal = (bool(is_isolated) for is_isolated in np.asarray(axes))
        values = {"IsolatedR": radial, "IsolatedT": along_track, "IsolatedN": normal}
        return self._frame("ThrusterIsolation", {key: int(value) for key, value in values.items()})

    def decode(self, frame: can.Message) -> ThrustReport | ThrusterHeartbeat | None:
        """Take the next frame of the bus.

        Parameters
        ----------
        frame
            Any frame; those of other senders are ignored.

        Returns
        -------
        ThrustReport, ThrusterHeartbeat or None
            A report with its second half, a heartbeat, or None.

        Raises
        ------
        FrameError
            If a frame of the thruster has a wrong length, a wrong checksum or no other half. The
            next frame can be decoded.
        """
        message = self._by_identifier.get(frame.arbitration_id)
        if message is None or frame.is_extended_id or frame.is_error_frame:
            return None
        first, self._first_half = self._first_half, None
        if damage := find_damage(message, frame):
            raise FrameError(damage)
        values = message.decode(bytes(frame.data), decode_choices=False, scaling=False)
        if message.name == "ThrusterHeartbeat":
            self._first_half = first  # it may come between the halves of a report
            return self._heartbeat(values)
        if message.name == "ThrustReportRT":
            self._first_half = values
            if first is not None:
                raise FrameError("ThrustReportRT: ThrustReportN expected")
            return None
        if first is None or first["Sequence"] != values["Sequence"]:
            raise FrameError("ThrustReportN: no ThrustReportRT of the same sequence number")
        return self._report(first, values)

    def _frame(self, name: str, values: dict[str, int]) -> can.Message:
        return encode_frame(self._messages[name], values)

    def _report(self, first: dict[str, int], second: dict[str, int]) -> ThrustReport:
        counts = (first["AccelerationR"], first["AccelerationT"], second["AccelerationN"])
        return ThrustReport(
            sequence=second["Sequence"],
            time_of_week_milliseconds=second["TimeOfWeek"],
            acceleration_rtn=np.array(counts) * self.resolution,
            saturated=bool(first["SaturatedR"] or first["SaturatedT"] or first["SaturatedN"]),
            watchdog=bool(first["Watchdog"]),
            fault=bool(first["Fault"]),
        )

    def _heartbeat(self, values: dict[str, int]) -> ThrusterHeartbeat:
        return ThrusterHeartbeat(
            sequence=values["Sequence"],
            state=str(self._states.get(values["State"], values["State"])),
            rejected_frames=values["RejectedFrames"],
            sequence_gaps=values["SequenceGaps"],
            uptime=values["Uptime"],
        )


def time_of_week_milliseconds(time: GpsTime) -> int:
    """Return the GPS time of week in whole milliseconds, the rest cut off."""
    return time.time_of_week_nanoseconds // NANOSECONDS_PER_MILLISECOND
