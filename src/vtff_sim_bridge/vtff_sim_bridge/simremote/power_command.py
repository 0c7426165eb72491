"""Commands of the signal power as SimREMOTE sends them; the emulated SimGEN stores them."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["PowerCommand"]


class PowerCommand(NamedTuple):
    """A stored POW_LEV, POW_ON, POW_MODE or REF_DBM command.

    `value` is the level in dB, the switch (0 or 1), or the reference in dBm; None for POW_MODE.
    `arguments` are all arguments as received: the meaning of the last fields of POW_LEV rests on
    one source, so only the consumer that needs them reads them.
    """

    verb: str
    time_nanoseconds: int
    antenna_id: str | None
    value: float | None
    arguments: tuple[str, ...]
