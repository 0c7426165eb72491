"""Scheduled faults of simulated receivers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vtff_sim_bridge.gnss.signal_table import SIGNALS, satellite_from_name
from vtff_sim_bridge.noise.random_streams import EPOCHS_PER_SECOND, Effect, generator

__all__ = ["FAULT_KINDS", "ByteFaults", "Fault"]

FAULT_KINDS = (
    "slip",
    "half_cycle",
    "outage",
    "clock_jump",
    "silent",
    "corrupted_bytes",
    "dropped_bytes",
)
"""See `Fault.kind`."""

_POINT_KINDS = ("slip", "half_cycle", "clock_jump")
_LONGEST_DROP_BYTES = 200


@dataclass(frozen=True)
class Fault:
    """One fault of one receiver.

    Parameters
    ----------
    kind : str
        slip
            The carrier phase of a signal changes by `cycles`.
        half_cycle
            The carrier phase changes by half a cycle, and so does the half-cycle bit of the
            tracking status.
        outage
            Signals cannot be tracked: those of `satellite` and `signal` as far as given.
        clock_jump
            The receiver clock jumps by `seconds`.
        silent
            The receiver works on but sends nothing.
        corrupted_bytes, dropped_bytes
            Each byte sent is, with the probability `rate`, replaced by another, or the first of
            1 to 200 bytes that are not sent.
    receiver : str
        Name of the receiver.
    time : float
        Time into the run, s: of the first epoch at which the fault shows.
    duration : float
        s; for the kinds that last.
    satellite, signal : str
        Such as ``G05`` and ``G1C``; empty for all.
    cycles : float
        Whole number of cycles; positive makes the phase (RINEX sign) greater.
    is_silent_slip : bool
        The lock time of a slip grows on, as if the receiver had not noticed.
    seconds : float
        Jump of the clock.
    rate : float
        Probability for each byte.

    Raises
    ------
    ValueError
        If a field does not fit the kind.
    """

    kind: str
    receiver: str
    time: float
    duration: float = 0.0
    satellite: str = ""
    signal: str = ""
    cycles: float = 0.0
    is_silent_slip: bool = True
    seconds: float = 0.0
    rate: float = 0.0

    def __post_init__(self) -> None:
        """Check the fields."""
        if self.kind not in FAULT_KINDS:
            raise ValueError(f"kind: one of {', '.join(FAULT_KINDS)} expected, got {self.kind!r}")
        if not self.time >= 0.0:
            raise ValueError("time: 0 s or more expected")
        if self.satellite:
            satellite_from_name(self.satellite)
        if self.signal and self.signal not in SIGNALS:
            raise ValueError(f"signal: one of {', '.join(SIGNALS)} expected, got {self.signal!r}")
        if self.kind in _POINT_KINDS:
            if self.duration != 0.0:
                raise ValueError(f"duration: a {self.kind} has none")
        elif not self.duration > 0.0:
            raise ValueError(f"duration: {self.kind} needs more than 0 s")
        if (self.cycles != 0.0) != (self.kind == "slip") or self.cycles % 1.0:
            raise ValueError("cycles: a slip, and nothing else, needs a whole number but 0")
        if (self.seconds != 0.0) != (self.kind == "clock_jump") or abs(self.seconds) > 0.01:
            raise ValueError("seconds: a clock_jump, and nothing else, needs some, at most 0.01")
        if (self.rate != 0.0) != self.kind.endswith("_bytes") or not 0.0 <= self.rate <= 1.0:
            raise ValueError("rate: only faults of bytes need one, more than 0 and at most 1")

    @property
    def first_epoch(self) -> int:
        """Number of the first epoch, counted from the start, at which the fault shows."""
        return -int(-round(self.time * 1e6) // round(1e6 / EPOCHS_PER_SECOND))

    @property
    def end_epoch(self) -> int:
        """Number of the first epoch at which a lasting fault is over."""
        return -int(-round((self.time + self.duration) * 1e6) // round(1e6 / EPOCHS_PER_SECOND))

    def is_active(self, epoch: int) -> bool:
        """Return whether a lasting fault is there at an epoch."""
        return self.first_epoch <= epoch < self.end_epoch

    def concerns(self, system: int, prn: int, signal: str) -> bool:
        """Return whether the fault concerns a signal of a satellite."""
        if self.satellite and satellite_from_name(self.satellite) != (system, prn):
            return False
        return self.signal in ("", signal)


class ByteFaults:
    """Faults of the bytes that a receiver sends.

    Parameters
    ----------
    faults : sequence of Fault
        Faults of one receiver; kinds that do not concern bytes are left out.
    seed, receiver : int
        Seed of the run, and number of the receiver.
    """

    def __init__(self, faults: Sequence[Fault], seed: int, receiver: int) -> None:
        self._faults = [
            f for f in faults if f.kind in ("silent", "corrupted_bytes", "dropped_bytes")
        ]
        self._seed = seed
        self._receiver = receiver
        self.changed_bytes = 0

    def apply(self, content: bytes, epoch: int) -> bytes:
        """Return the bytes of an epoch that the faults leave, changed where they change them."""
        for number, fault in enumerate(self._faults):
            if content and fault.is_active(epoch):
                content = self._apply_fault(fault, number, content, epoch)
        return content

    def _apply_fault(self, fault: Fault, number: int, content: bytes, epoch: int) -> bytes:
        if fault.kind == "silent":
            self.changed_bytes += len(content)
            return b""
        random = generator(self._seed, Effect.BYTE_FAULT, self._receiver, number, epoch)
        places = np.flatnonzero(random.random(len(content)) < fault.rate)
        if fault.kind == "corrupted_bytes":
            self.changed_bytes += len(places)
            changed = np.frombuffer(content, dtype=np.uint8).copy()
            changed[places] ^= random.integers(1, 256, len(places), dtype=np.uint8)
            return bytes(changed)
        is_kept = np.ones(len(content), dtype=bool)
        for first in places.tolist():
            is_kept[first : first + int(random.integers(1, _LONGEST_DROP_BYTES + 1))] = False
        self.changed_bytes += int(len(content) - np.count_nonzero(is_kept))
        return bytes(np.frombuffer(content, dtype=np.uint8)[is_kept])
