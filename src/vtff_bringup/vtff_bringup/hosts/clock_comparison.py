"""Comparison of the clocks of two machines by an exchange of times."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

__all__ = ["EXCHANGES", "ClockComparison", "compare_clocks"]

#: Exchanges of times from which a comparison is made.
EXCHANGES = 10

#: Difference of clocks from which a run in real time warns, s.
TOLERATED_OFFSET = 0.1


@dataclasses.dataclass(frozen=True)
class ClockComparison:
    """Offset of a clock.

    Attributes
    ----------
    offset
        By how much the other clock is ahead, s.
    uncertainty
        Half of the round trip, s: the offset cannot be wrong by more.
    """

    offset: float
    uncertainty: float

    @property
    def is_tolerated(self) -> bool:
        """Whether the clocks agree as far as a run in real time needs it."""
        return abs(self.offset) - self.uncertainty <= TOLERATED_OFFSET

    def describe(self, host: str) -> str:
        """Return the comparison as words."""
        direction = "ahead" if self.offset >= 0.0 else "behind"
        return (
            f"clock of '{host}': {abs(self.offset) * 1e3:.3f} ms {direction}, "
            f"+- {self.uncertainty * 1e3:.3f} ms"
        )


def compare_clocks(exchanges: Sequence[tuple[float, float, float]]) -> ClockComparison:
    """Return the offset that the fastest exchange tells.

    Parameters
    ----------
    exchanges
        For each exchange: time here when the question left, time there when it arrived, time here
        when the answer arrived; s.

    Raises
    ------
    ValueError
        If there is no exchange.
    """
    left, there, back = min(exchanges, key=lambda times: times[2] - times[0])
    return ClockComparison(there - (left + back) / 2.0, max(0.0, (back - left) / 2.0))
