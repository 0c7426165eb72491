"""Signal levels of a vehicle as SimREMOTE commands them: POW_LEV and POW_ON.

``POW_LEV,<antenna>,<dB>,<constellation>,<id>,<multipath>,<mode>,<all>,<frequency>,
<all frequencies>,<all transmitter types>``, and ``POW_ON,<antenna>,<0 or 1>,`` with the same
fields but those of the frequency. The level is relative to the reference (-130 dBm for GPS L1),
which stands for the C/N0 of the configuration. What the last fields mean rests on one public
client; so here all frequencies of a satellite share one level, and a command for one frequency,
for one simulator channel (mode 1) or for a multipath copy has no effect but a warning.
"""

from __future__ import annotations

import bisect
import logging
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import SYSTEM_GALILEO, SYSTEM_GPS
from vtff_sim_bridge.noise.random_streams import EPOCH_NANOSECONDS, EPOCHS_PER_SECOND
from vtff_sim_bridge.simremote.power_command import PowerCommand

__all__ = ["PowerLevels"]

LOGGER = logging.getLogger("simgen_emulator")

_SYSTEMS = {"GPS": SYSTEM_GPS, "GALILEO": SYSTEM_GALILEO}
_NUMBERS = 64
_OFF_DB = -200.0
_FIELDS = {"POW_LEV": 10, "POW_ON": 8}


class PowerLevels:
    """Levels of all satellites at one vehicle.

    Parameters
    ----------
    commands : sequence of PowerCommand
        Commands for all vehicles; may grow, also by commands for later times.
    vehicle : str
        Such as ``v1_m1``; its antennas are ``v1_a1`` and so on.
    """

    def __init__(self, commands: Sequence[PowerCommand], vehicle: str) -> None:
        self._commands = commands
        self._prefix = vehicle.partition("_")[0] + "_"
        self._seen = 0
        self._waiting: list[tuple[int, int, PowerCommand]] = []
        self._level_db: FloatArray = np.zeros((8, _NUMBERS))
        self._is_on: npt.NDArray[np.bool_] = np.ones((8, _NUMBERS), dtype=bool)
        self._has_changed = False

    def offsets_db(
        self, second: int, emitted: slice, satellites: Sequence[tuple[int, int]]
    ) -> FloatArray | None:
        """Return what the levels add to C/N0 at the epochs of a second.

        Parameters
        ----------
        second : int
        emitted : slice
            Which of the 20, after those of the last call; the others are not asked for.
        satellites : sequence of (int, int)
            System and number.

        Returns
        -------
        ndarray, shape (20, n), or None
            dB; very low where a signal is off; None if nothing was ever commanded.
        """
        for number in range(self._seen, len(self._commands)):
            command = self._commands[number]
            if (command.antenna_id or "").startswith(self._prefix) and command.verb in _FIELDS:
                bisect.insort(self._waiting, (command.time_nanoseconds, number, command))
        self._seen = len(self._commands)
        if not self._waiting and not self._has_changed:
            return None
        system, number = np.array(satellites, dtype=np.intp).reshape(-1, 2).T
        offsets = np.zeros((EPOCHS_PER_SECOND, len(satellites)))
        begin = (second - 1) * EPOCHS_PER_SECOND + 1
        for index in range(EPOCHS_PER_SECOND)[emitted]:
            time = (begin + index) * EPOCH_NANOSECONDS
            while self._waiting and self._waiting[0][0] <= time:
                self._apply(self._waiting.pop(0)[2])
            offsets[index] = np.where(
                self._is_on[system, number], self._level_db[system, number], _OFF_DB
            )
        return offsets

    def _apply(self, command: PowerCommand) -> None:
        satellites = self._satellites_of(command)
        if satellites is None or command.value is None:
            LOGGER.warning(
                "%s,%s: no effect, only all frequencies of satellites by number are emulated",
                command.verb,
                ",".join(command.arguments),
            )
            return
        self._has_changed = True
        if command.verb == "POW_ON":
            self._is_on[satellites] = command.value > 0.0
        else:
            self._level_db[satellites] = command.value

    @staticmethod
    def _satellites_of(command: PowerCommand) -> tuple[slice | int, slice | int] | None:
        """Return the satellites that a command concerns; None if it is not emulated."""
        texts = command.arguments[2:]
        names, numbers = texts[:1], texts[1:]
        if not names or names[0].upper() not in _SYSTEMS:
            return None
        try:
            values = [int(text) for text in numbers]
        except ValueError:
            return None
        # Omitted fields at the end are taken as: direct path, by number, one satellite, all else.
        identifier, multipath, mode, all_satellites = (values + [0] * 4)[:4]
        rest = values[4:]
        all_types = rest[-1] if len(command.arguments) == _FIELDS[command.verb] and rest else 0
        if command.verb == "POW_LEV" and len(rest) >= 2 and not rest[1]:
            return None
        if multipath or (mode and not all_satellites):
            return None
        system: slice | int = slice(None) if all_types else _SYSTEMS[names[0].upper()]
        if all_satellites:
            return system, slice(None)
        return (system, identifier) if 0 < identifier < _NUMBERS else None
