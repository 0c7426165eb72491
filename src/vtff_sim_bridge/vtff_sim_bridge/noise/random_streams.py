"""Random numbers of the GNSS simulation: one stream for each receiver, signal and effect.

Every number has an address (run, effect, receiver, signal, time), from which its generator is
seeded. So what is drawn does not depend on the order of the calls, and switching an effect on
leaves all others as they are.
"""

from __future__ import annotations

import enum
import zlib
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "EPOCHS_PER_SECOND",
    "EPOCH_NANOSECONDS",
    "Effect",
    "NoiseField",
    "generator",
    "receiver_number",
]

EPOCHS_PER_SECOND = 20
"""Rate at which receivers measure."""
EPOCH_NANOSECONDS = NANOSECONDS_PER_SECOND // EPOCHS_PER_SECOND

_LARGEST_WORD = 2**32 - 1
_BLOCK_SECONDS = 64
_BLOCK_EPOCHS = _BLOCK_SECONDS * EPOCHS_PER_SECOND


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


class NoiseField:
    """White noise of unit variance of all links of a receiver, 20 numbers a second.

    Parameters
    ----------
    seed : int
        Seed of the run.
    effect : Effect
        Effect that the noise stands for.
    addresses : sequence of tuple of int
        Address of each link: receiver, system, satellite, band, attribute.
    """

    def __init__(self, seed: int, effect: Effect, addresses: Sequence[tuple[int, ...]]) -> None:
        self._seed = seed
        self._effect = effect
        self._addresses = addresses
        self._numbers: FloatArray = np.zeros((_BLOCK_SECONDS, len(addresses), EPOCHS_PER_SECOND))
        self._block = np.full(len(addresses), -1, dtype=np.int64)
        self._last_rows: npt.NDArray[np.intp] | None = None
        self._last_block = -1

    def second(self, second: int, rows: npt.NDArray[np.intp]) -> FloatArray:
        """Return the noise of links in a second of the run, shape (20, number of rows)."""
        return np.asarray(self.of_all_links(second, rows)[rows].T)

    def of_all_links(self, second: int, rows: npt.NDArray[np.intp]) -> FloatArray:
        """Return a view of the noise in a second, shape (links, 20); only `rows` are true."""
        block, within = divmod(second, _BLOCK_SECONDS)
        if rows is not self._last_rows or block != self._last_block:
            self._last_rows, self._last_block = rows, block
            for row in rows[self._block[rows] != block].tolist():
                stream = generator(self._seed, self._effect, *self._addresses[row], block)
                drawn = stream.standard_normal(_BLOCK_EPOCHS)
                self._numbers[:, row] = drawn.reshape(_BLOCK_SECONDS, EPOCHS_PER_SECOND)
                self._block[row] = block
        return np.asarray(self._numbers[within])
