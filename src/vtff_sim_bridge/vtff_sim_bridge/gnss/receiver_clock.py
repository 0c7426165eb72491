"""Receiver clocks: an oscillator with white and random-walk frequency noise, and its steering."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray
from vtff_sim_bridge.noise.random_streams import EPOCHS_PER_SECOND, Effect, generator

__all__ = ["OSCILLATORS", "ClockModel", "ReceiverClock"]

OSCILLATORS: dict[str, tuple[float, float]] = {
    "perfect": (0.0, 0.0),
    "TCXO": (2e-19, 2e-20),
    "OCXO": (8e-20, 4e-23),
    "CSAC": (1.8e-19, 1.5e-28),
}
"""h0 (s) and h-2 (1/s). TCXO and OCXO: Brown and Hwang, Introduction to Random Signals and Applied
Kalman Filtering, table of Allan variance coefficients of timing standards. CSAC: Microchip SA.45s
data sheet, Allan deviation 3e-10 at 1 s falling with the square root of time to 1e-11 at 1e5 s."""

_STEP = 1.0 / EPOCHS_PER_SECOND
# Noise is drawn for so many seconds at once.
_BLOCK_SECONDS = 64


@dataclass(frozen=True)
class ClockModel:
    """Clock of a receiver.

    Parameters
    ----------
    oscillator : str
        One of `OSCILLATORS`.
    initial_offset : float
        Receiver clock less GPS time at the start, s.
    initial_drift : float
        Derivative of the clock offset at the start, s/s.
    is_steered : bool
        Once a second the receiver measures its offset and steers the oscillator, as a NovAtel
        receiver does with CLOCKADJUST enabled.
    steering_frequency : float
        Natural frequency of the critically damped steering loop, rad/s.
    steering_sigma : float
        Noise of the measured offset, s.

    Raises
    ------
    ValueError
        If a parameter is out of range.
    """

    oscillator: str = "TCXO"
    initial_offset: float = 0.0
    initial_drift: float = 0.0
    is_steered: bool = True
    steering_frequency: float = 0.1
    steering_sigma: float = 1e-9

    def __post_init__(self) -> None:
        """Check the parameters."""
        if self.oscillator not in OSCILLATORS:
            raise ValueError(
                f"oscillator: one of {', '.join(OSCILLATORS)} expected, got {self.oscillator!r}"
            )
        if not 0.0 < self.steering_frequency <= 0.5:
            raise ValueError("steering_frequency: more than 0 and at most 0.5 rad/s expected")
        if not self.steering_sigma >= 0.0:
            raise ValueError("steering_sigma: 0 s or more expected")
        if abs(self.initial_offset) > 0.01 or abs(self.initial_drift) > 1e-4:
            raise ValueError("initial_offset, initial_drift: at most 0.01 s and 1e-4 expected")


class ReceiverClock:
    """Offset and drift of a receiver clock at the 20 epochs of consecutive seconds.

    Parameters
    ----------
    model : ClockModel
    seed, receiver : int
        Seed of the run, and number of the receiver.
    jumps : sequence of (int, float)
        Scheduled jumps: number of the epoch since the start, offset added from it on, s.

    Notes
    -----
    Two-state model with the process noise of white frequency noise h0 / 2 and random-walk
    frequency noise 2 pi^2 h-2 (Brown and Hwang, section on clock modelling).
    """

    def __init__(
        self,
        model: ClockModel,
        seed: int,
        receiver: int,
        jumps: Sequence[tuple[int, float]] = (),
    ) -> None:
        self._model = model
        self._offset = model.initial_offset
        self._drift = model.initial_drift
        self._jumps = dict(jumps)
        h0, h_2 = OSCILLATORS[model.oscillator]
        white, walk = 0.5 * h0, 2.0 * math.pi**2 * h_2
        # Lower Cholesky factor of the process noise of one step, order (drift, offset).
        self._drift_sigma = math.sqrt(walk * _STEP)
        self._correlated = 0.5 * _STEP * self._drift_sigma
        self._offset_sigma = math.sqrt(white * _STEP + walk * _STEP**3 / 12.0)
        self._generator = generator(seed, Effect.RECEIVER_CLOCK, receiver)
        self._steering_generator = generator(seed, Effect.CLOCK_STEERING, receiver)
        self._noise: FloatArray = np.empty((0, EPOCHS_PER_SECOND, 2))
        self._steering_noise: list[float] = []
        self._second = 0
        self._offsets: FloatArray = np.full(EPOCHS_PER_SECOND, self._offset)
        self._drifts: FloatArray = np.full(EPOCHS_PER_SECOND, self._drift)

    def second(self, second: int) -> tuple[FloatArray, FloatArray]:
        """Return offset (s) and drift (s/s), shape (20,), at the epochs of a second.

        The drift is the mean over the 0.05 s before: white frequency noise has no other.
        Second k holds the epochs after k - 1 s up to and including k s; second 0 only the start.

        Raises
        ------
        ValueError
            If seconds are asked for backwards: the clock goes on only.
        """
        if second < self._second:
            raise ValueError(f"second: {second} is before {self._second}")
        while self._second < second:
            self._second += 1
            self._advance()
        return self._offsets, self._drifts

    def _advance(self) -> None:
        within = (self._second - 1) % _BLOCK_SECONDS
        if within == 0:
            self._noise = self._generator.standard_normal((_BLOCK_SECONDS, EPOCHS_PER_SECOND, 2))
        acceleration = self._steering(within) if self._model.is_steered else 0.0
        jumps = np.zeros(EPOCHS_PER_SECOND)
        for epoch, jump in self._jumps.items():
            if 0 < epoch - (self._second - 1) * EPOCHS_PER_SECOND <= EPOCHS_PER_SECOND:
                jumps[(epoch - 1) % EPOCHS_PER_SECOND] = jump
        self._offsets, self._drifts, self._drift = _advance_clock(
            self._offset,
            self._drift,
            acceleration,
            self._noise[within],
            jumps,
            self._drift_sigma,
            self._correlated,
            self._offset_sigma,
        )
        self._offset = float(self._offsets[-1])

    def _steering(self, within: int) -> float:
        """Return the drift rate that the receiver commands for the next second, 1/s."""
        if within == 0:
            self._steering_noise = self._steering_generator.standard_normal(_BLOCK_SECONDS).tolist()
        noise = self._model.steering_sigma * self._steering_noise[within]
        frequency = self._model.steering_frequency
        return -frequency * (frequency * (self._offset + noise) + 2.0 * self._drift)


@compiled
def _advance_clock(  # type: ignore[no-untyped-def]
    offset, drift, acceleration, noise, jumps, drift_sigma, correlated, offset_sigma
):
    """Return offset (s) and drift (s/s) at epochs, (k,), and the drift of the oscillator at last.

    `noise` (k, 2) is of unit variance; `jumps` (k,) are added to the offset from an epoch on, s.
    """
    offsets, drifts = np.empty(len(jumps)), np.empty(len(jumps))
    for k in range(len(jumps)):
        change = _STEP * (drift + 0.5 * _STEP * acceleration)
        change += correlated * noise[k, 0] + offset_sigma * noise[k, 1]
        offset += change + jumps[k]
        drift += _STEP * acceleration + drift_sigma * noise[k, 0]
        offsets[k] = offset
        drifts[k] = change / _STEP
    return offsets, drifts, drift
