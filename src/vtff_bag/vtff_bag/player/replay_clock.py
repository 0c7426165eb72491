"""Time of a replay: recorded time that follows the wall clock at a rate, with pauses."""

from __future__ import annotations

import time
from collections.abc import Callable

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND

SMALLEST_RATE = 1e-3
LARGEST_RATE = 1e6


class ReplayClock:
    """Recorded time as a function of wall time (as rosbag2's ``TimeControllerClock``).

    Parameters
    ----------
    start
        Recorded time at which the clock begins, ns since 1970.
    rate
        Recorded seconds per second of wall time.
    paused
        Whether the clock stands still until `resume`.
    steady_clock
        Function that returns wall time in s.

    Raises
    ------
    ValueError
        If the rate is not between `SMALLEST_RATE` and `LARGEST_RATE`.
    """

    def __init__(
        self,
        start: int,
        rate: float = 1.0,
        *,
        paused: bool = False,
        steady_clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._steady_clock = steady_clock
        self._rate = checked_rate(rate)
        self._paused = paused
        self._reference = start
        self._reference_wall = steady_clock()

    @property
    def rate(self) -> float:
        """Recorded seconds per second of wall time while the clock runs."""
        return self._rate

    @property
    def paused(self) -> bool:
        """Whether the clock stands still."""
        return self._paused

    def now(self) -> int:
        """Return the recorded time, ns since 1970."""
        if self._paused:
            return self._reference
        elapsed = self._steady_clock() - self._reference_wall
        return self._reference + round(elapsed * self._rate * NANOSECONDS_PER_SECOND)

    def pause(self) -> None:
        """Stop the clock at its current time."""
        self.jump(self.now())
        self._paused = True

    def resume(self) -> None:
        """Let the clock run again from its current time."""
        self.jump(self.now())
        self._paused = False

    def set_rate(self, rate: float) -> None:
        """Change the rate without a jump of the time.

        Raises
        ------
        ValueError
            If the rate is not between `SMALLEST_RATE` and `LARGEST_RATE`.
        """
        checked = checked_rate(rate)
        self.jump(self.now())
        self._rate = checked

    def jump(self, nanoseconds: int) -> None:
        """Set the clock to a recorded time, ns since 1970."""
        self._reference = nanoseconds
        self._reference_wall = self._steady_clock()


def checked_rate(rate: float) -> float:
    """Return the rate.

    Raises
    ------
    ValueError
        If the rate is not between `SMALLEST_RATE` and `LARGEST_RATE`.
    """
    if not SMALLEST_RATE <= rate <= LARGEST_RATE:
        raise ValueError(f"rate {rate:g} is not between {SMALLEST_RATE:g} and {LARGEST_RATE:g}")
    return float(rate)
