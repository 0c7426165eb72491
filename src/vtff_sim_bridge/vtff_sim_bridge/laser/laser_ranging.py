"""Measurements of a laser ranging instrument with a latency (Oh et al. 2016, paper 004, eq. 9)."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["LaserRanging"]


@dataclass(frozen=True)
class LaserRanging:
    """A laser between two spacecraft: range plus latency times range rate plus noise.

    Parameters
    ----------
    latency : float
        s, kappa of the paper, where it is -5.15e-3: the low-pass filter of the interferometer
        gives the range of 5.15 ms ago.
    range_sigma : float
        White noise, m. The paper does not give it.
    maximum_range : float
        m; further away there is no echo.
    seed : int
    link : str
        Names the pair of spacecraft; each link has noise of its own.

    Raises
    ------
    ValueError
        If noise or maximum range is negative.
    """

    latency: float = -5.15e-3
    range_sigma: float = 1e-4
    maximum_range: float = 20e3
    seed: int = 1
    link: str = "deputy"

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.range_sigma < 0.0 or self.maximum_range < 0.0 or self.seed < 0:
            raise ValueError("range_sigma, maximum_range and seed must not be negative")

    def measure(
        self, stamp_nanoseconds: int, position: npt.ArrayLike, velocity: npt.ArrayLike
    ) -> float:
        """Return the measured range in m, NaN without an echo.

        Parameters
        ----------
        stamp_nanoseconds : int
            Time of the measurement; the noise depends on it, not on the order of the calls.
        position, velocity : array_like, shape (3,)
            State of one spacecraft relative to the other, m and m/s, in any frame: range and range
            rate are the same in all.
        """
        position, velocity = np.asarray(position, float), np.asarray(velocity, float)
        distance = float(np.linalg.norm(position))
        if not 0.0 < distance <= self.maximum_range:
            return float("nan")
        address = (self.seed, zlib.crc32(self.link.encode()), stamp_nanoseconds)
        noise = np.random.default_rng(np.random.SeedSequence(address)).standard_normal()
        range_rate = float(position @ velocity) / distance
        return distance + self.latency * range_rate + self.range_sigma * float(noise)
