"""Random numbers of the GNSS simulation: one stream for each receiver, signal and effect.

Every number has an address (run, effect, receiver, signal, time), from which its generator is
seeded. So what is drawn does not depend on the order of the calls, and switching an effect on
leaves all others as they are.
"""

from __future__ import annotations

import abc
import enum
import zlib
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "BLOCK_EPOCHS",
    "BLOCK_SECONDS",
    "EPOCHS_PER_SECOND",
    "EPOCH_NANOSECONDS",
    "Effect",
    "EpochField",
    "NoiseField",
    "generator",
    "receiver_number",
]

EPOCHS_PER_SECOND = 20
"""Rate at which receivers measure."""
EPOCH_NANOSECONDS = NANOSECONDS_PER_SECOND // EPOCHS_PER_SECOND
BLOCK_SECONDS = 64
"""Time for which an `EpochField` draws at once, s."""
BLOCK_EPOCHS = BLOCK_SECONDS * EPOCHS_PER_SECOND

_LARGEST_WORD = 2**32 - 1


class Effect(enum.IntEnum):
    """Effect that a stream serves; the numbers are part of every seed and must not change."""

    CODE_NOISE = 1
    PHASE_NOISE = 2
    DOPPLER_NOISE = 3
    CN0_NOISE = 4
    RECEIVER_CLOCK = 5
    CLOCK_STEERING = 6
    AMBIGUITY = 7
    SATELLITE_BIAS = 8
    ORBIT_ERROR = 9
    SCINTILLATION = 10
    MULTIPATH = 11
    BYTE_FAULT = 12
    CODE_MULTIPATH = 13
    PHASE_MULTIPATH = 14
    CODE_LINE_BIAS = 15
    PHASE_LINE_BIAS = 16
    ORBIT_DRIFT = 17
    EPHEMERIS_UPLOAD = 18
    IONOSPHERIC_WAVE = 19
    NOISE_SLIP = 20
    NOISE_SLIP_SIGN = 21
    ELECTRON_DENSITY = 22
    RAY_EDGE = 23
    RANGE_SENSOR = 24
    SENSOR_MISALIGNMENT = 25
    FIX_POSITION = 26
    FIX_VELOCITY = 27


def receiver_number(name: str) -> int:
    """Return the number of a receiver in seeds: it does not depend on the other receivers."""
    return zlib.crc32(name.encode())


def generator(seed: int, effect: Effect, *address: int) -> np.random.Generator:
    """Return the generator of an address; `seed` and `address` are not negative."""
    numbers = (seed, int(effect), *address)
    if max(numbers) > _LARGEST_WORD:
        return np.random.default_rng(np.random.SeedSequence(numbers))
    # The same stream: to take the numbers apart into words takes longer than all the rest.
    words = np.array(numbers, dtype=np.uint32)
    return np.random.default_rng(np.random.SeedSequence(words))  # type: ignore[arg-type]


class EpochField(abc.ABC):
    """Random numbers at the 20 epochs of every second, for some addresses.

    They are drawn for 64 s at once when they are asked for.

    Parameters
    ----------
    seed : int
        Seed of the run.
    effect : Effect
        Effect that the numbers stand for.
    addresses : sequence of tuple of int
        Address of each row, as of a link: receiver, system, satellite, band, attribute.
    """

    def __init__(self, seed: int, effect: Effect, addresses: Sequence[tuple[int, ...]]) -> None:
        self._seed = seed
        self._effect = effect
        self._addresses = addresses
        self._numbers: FloatArray = np.zeros((BLOCK_SECONDS, len(addresses), EPOCHS_PER_SECOND))
        #: Block of each row of the numbers; -1 before the first.
        self._block = np.full(len(addresses), -1, dtype=np.int64)
        self._last_rows: npt.NDArray[np.intp] | None = None
        self._last_block = -1

    def second(self, second: int, rows: npt.NDArray[np.intp]) -> FloatArray:
        """Return the numbers of rows in a second of the run, shape (20, number of rows)."""
        return np.asarray(self.of_all_links(second, rows)[rows].T)

    def of_all_links(self, second: int, rows: npt.NDArray[np.intp]) -> FloatArray:
        """Return a view of the numbers in a second, shape (addresses, 20); only `rows` are true."""
        block, within = divmod(second, BLOCK_SECONDS)
        if rows is not self._last_rows or block != self._last_block:
            self._last_rows, self._last_block = rows, block
            for row in rows[self._block[rows] != block].tolist():
                self._fill(row, block)
                self._block[row] = block
        return np.asarray(self._numbers[within])

    @abc.abstractmethod
    def _fill(self, row: int, block: int) -> None:
        """Fill in the numbers of a row in a block."""

    def _stream(self, row: int, block: int) -> np.random.Generator:
        """Return the generator of a row in a block."""
        return generator(self._seed, self._effect, *self._addresses[row], block)


class NoiseField(EpochField):
    """White noise of unit variance."""

    def _fill(self, row: int, block: int) -> None:
        """Draw the noise of a block."""
        drawn = self._stream(row, block).standard_normal(BLOCK_EPOCHS)
        self._numbers[:, row] = drawn.reshape(BLOCK_SECONDS, EPOCHS_PER_SECOND)
