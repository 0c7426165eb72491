"""First-order Gauss-Markov processes of the GNSS simulation, with the streams of `random_streams`.

What a process is at a time depends on its address and that time only, not on which times were asked
for before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray
from vtff_sim_bridge.noise.random_streams import (
    BLOCK_EPOCHS,
    BLOCK_SECONDS,
    EPOCHS_PER_SECOND,
    Effect,
    EpochField,
    generator,
)

__all__ = ["GaussMarkovField", "SlowGaussMarkov"]

_KNOTS_PER_CORRELATION_TIME = 24
_BLOCK_KNOTS = 64


class GaussMarkovField(EpochField):
    """Processes of unit variance at the 20 epochs of every second, one for each address.

    The autocorrelation is ``exp(-|t| / correlation_time)`` from the start of the run on.

    Parameters
    ----------
    seed : int
        Seed of the run.
    effect : Effect
        Effect that the processes stand for.
    addresses : sequence of tuple of int
        Address of each process.
    correlation_time : float
        s.
    """

    def __init__(
        self,
        seed: int,
        effect: Effect,
        addresses: Sequence[tuple[int, ...]],
        correlation_time: float,
    ) -> None:
        super().__init__(seed, effect, addresses)
        self._decay = math.exp(-1.0 / (EPOCHS_PER_SECOND * correlation_time))
        self._gain = math.sqrt(1.0 - self._decay**2)

    def _fill(self, row: int, block: int) -> None:
        """Compute the process of a block from that of the blocks before."""
        known = int(self._block[row])
        for number in range(known + 1 if known < block else 0, block + 1):
            stream = self._stream(row, number)
            before = self._numbers[-1, row, -1] if number else stream.standard_normal()
            draws = stream.standard_normal((BLOCK_EPOCHS, 1))
            _continue_processes(draws, np.array([before]), self._decay, self._gain)
            self._numbers[:, row] = draws.reshape(BLOCK_SECONDS, EPOCHS_PER_SECOND)


class SlowGaussMarkov:
    """Processes of unit variance that have a rate, for errors that drift in hours.

    They are Gauss-Markov at knots, 24 in a correlation time, and straight lines between them, where
    the variance is down to 0.98.

    Parameters
    ----------
    seed : int
        Seed of the run.
    effect : Effect
        Effect that the processes stand for.
    address : tuple of int
        Address of this group of processes.
    count : int
        Number of processes.
    correlation_time : float
        s.
    """

    def __init__(
        self,
        seed: int,
        effect: Effect,
        address: tuple[int, ...],
        count: int,
        correlation_time: float,
    ) -> None:
        self._seed = seed
        self._effect = effect
        self._address = address
        self._interval = correlation_time / _KNOTS_PER_CORRELATION_TIME
        self._decay = math.exp(-1.0 / _KNOTS_PER_CORRELATION_TIME)
        self._knots: FloatArray = generator(seed, effect, *address, 0).standard_normal((1, count))

    def at(self, elapsed: npt.ArrayLike) -> FloatArray:
        """Return the processes at times into the run in s, shape (k,), as an array (k, count)."""
        place = np.asarray(elapsed, dtype=float) / self._interval
        place = np.maximum(place, 0.0)
        while len(self._knots) < place.max() + 2.0:
            self._add_block()
        index = place.astype(int)
        part = (place - index)[:, None]
        return np.asarray((1.0 - part) * self._knots[index] + part * self._knots[index + 1])

    def _add_block(self) -> None:
        """Compute the next knots."""
        number = (len(self._knots) - 1) // _BLOCK_KNOTS + 1
        stream = generator(self._seed, self._effect, *self._address, number)
        draws = stream.standard_normal((_BLOCK_KNOTS, self._knots.shape[1]))
        gain = math.sqrt(1.0 - self._decay**2)
        _continue_processes(draws, self._knots[-1].copy(), self._decay, gain)
        self._knots = np.concatenate((self._knots, draws))


@compiled
def _continue_processes(draws, before, decay, gain):  # type: ignore[no-untyped-def]
    """Replace normal draws (n, m) by processes, whose values before these are given, shape (m,).

    scipy.signal.lfilter gives the same bits, but takes a second to import.
    """
    for row in draws:
        for place in range(len(row)):
            before[place] = gain * row[place] + decay * before[place]
            row[place] = before[place]
