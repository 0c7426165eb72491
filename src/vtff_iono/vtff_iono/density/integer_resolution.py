"""Integers of satellites whose phases were broken, found again beside those that hold.

In scintillation arcs break every minute or so, and the relative navigation filter cannot fix
integers there. While other satellites still have their integers, both integers of a new arc follow
without a search: the wide lane from the Melbourne-Wuebbena combination, whose receiver bias the
other satellites show; then the second integer from the differential TEC that the other satellites
predict. One cycle more on both signals is 0.51 TECU, many times the error of the prediction.

An integer is accepted when the mean is nearer to it than to any other integer by a multiple of the
sigma of the mean.

References
----------
Melbourne (1985) and Wuebbena (1985), Proc. First Int. Symposium on Precise Positioning with GPS.
"""

from __future__ import annotations

import math
from collections.abc import Container, Hashable
from dataclasses import dataclass

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_iono.links.geometry_free import tecu_per_metre

__all__ = ["IntegerResolver", "WeightedMean"]

# Fewest seconds of data for a decision, and the margin to the next integer in sigmas.
_FEWEST_SECONDS = 4
_MARGIN_SIGMAS = 5.0
# Smallest sigmas: of the mean wide lane, cycles, and of the lasting error of a prediction, TECU.
_WIDE_LANE_FLOOR = 0.02
_PREDICTION_FLOOR = 0.02


@dataclass
class WeightedMean:
    """Running mean and scatter of weighted samples."""

    weight: float = 0.0
    count: int = 0
    mean: float = 0.0
    squares: float = 0.0

    def add(self, value: float, weight: float = 1.0) -> None:
        """Add a sample (West 1979, updating mean and variance estimates)."""
        self.weight += weight
        self.count += 1
        deviation = value - self.mean
        self.mean += weight / self.weight * deviation
        self.squares += weight * deviation * (value - self.mean)

    def sigma(self) -> float:
        """Return the sigma of the mean; infinite for fewer than two samples."""
        if self.count < 2:
            return math.inf
        return math.sqrt(self.squares / self.weight / (self.count - 1))


class IntegerResolver:
    """Finds the integers of two signals of single differences, second by second.

    Parameters
    ----------
    frequency_first, frequency_second : float
        Carrier frequencies of the two signals, Hz.
    """

    def __init__(self, frequency_first: float, frequency_second: float) -> None:
        scale = tecu_per_metre(frequency_first, frequency_second)
        self._first_tecu = scale * SPEED_OF_LIGHT / frequency_first
        self._both_tecu = self._first_tecu - scale * SPEED_OF_LIGHT / frequency_second
        self._bias = WeightedMean()
        # Mean wide lane and mean excess content of each arc without integers.
        self._unresolved: dict[Hashable, tuple[WeightedMean, WeightedMean]] = {}

    def __len__(self) -> int:
        """Return the number of arcs whose samples are kept because they have no integers yet."""
        return len(self._unresolved)

    def reset(self) -> None:
        """Forget everything, because the integers have another datum."""
        self._bias = WeightedMean()
        self._unresolved.clear()

    def keep_only(self, arcs: Container[Hashable]) -> None:
        """Forget the samples of all other arcs, which have ended without integers."""
        for arc in [arc for arc in self._unresolved if arc not in arcs]:
            del self._unresolved[arc]

    def add_resolved(self, wide_lane_cycles: float, samples: int) -> None:
        """Add the mean wide lane of a satellite less its integers, which is the common bias."""
        if math.isfinite(wide_lane_cycles):
            self._bias.add(wide_lane_cycles, float(samples))

    def wide_lane_error(self, wide_lane_cycles: float) -> float:
        """Return how far a wide lane less its integers is from the common bias; NaN at first."""
        if self._bias.count < _FEWEST_SECONDS:
            return math.nan
        return wide_lane_cycles - self._bias.mean

    def resolve(
        self,
        arc: Hashable,
        wide_lane_cycles: float,
        samples: int,
        excess_tecu: float,
    ) -> tuple[float, float] | None:
        """Add a second of an arc without integers and return both integers once they are certain.

        Parameters
        ----------
        arc : hashable
            Satellite and arcs of both receivers.
        wide_lane_cycles, samples : float, int
            Mean wide lane of the single difference, and of how many samples it is the mean.
        excess_tecu : float
            Differential TEC of the phases without integers less the prediction of the other
            satellites. The noise of both shows in its scatter.
        """
        if not math.isfinite(wide_lane_cycles + excess_tecu):
            return None
        wide_lane, excess = self._unresolved.setdefault(arc, (WeightedMean(), WeightedMean()))
        wide_lane.add(wide_lane_cycles, float(samples))
        excess.add(excess_tecu)
        if excess.count < _FEWEST_SECONDS or self._bias.count < _FEWEST_SECONDS:
            return None
        wide_sigma = math.hypot(max(wide_lane.sigma(), _WIDE_LANE_FLOOR), self._bias.sigma())
        wide = _round_if_certain(wide_lane.mean - self._bias.mean, wide_sigma)
        if wide is None:
            return None
        # S = K (l1 n1 - l2 n2) with n1 = wide + n2.
        second_mean = (excess.mean - self._first_tecu * wide) / self._both_tecu
        sigma = math.hypot(excess.sigma(), _PREDICTION_FLOOR)
        second = _round_if_certain(second_mean, sigma / abs(self._both_tecu))
        if second is None:
            return None
        del self._unresolved[arc]
        return wide + second, second


def _round_if_certain(value: float, sigma: float) -> float | None:
    """Return the nearest integer if no other integer is possible, else None."""
    nearest = float(round(value))
    return nearest if 0.5 - abs(value - nearest) > _MARGIN_SIGMAS * sigma else None
