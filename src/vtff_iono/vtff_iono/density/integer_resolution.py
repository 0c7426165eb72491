"""Integers of satellites whose phases were broken, found again beside those that hold.

In scintillation arcs break every minute or so, and the relative navigation filter cannot fix
integers there. While other satellites still have their integers, both integers of a new arc follow
from two numbers: the wide lane from the Melbourne-Wuebbena combination, whose receiver bias the
other satellites show, and the differential TEC that the other satellites, and the level that this
one had before, predict. One cycle more on both signals is 0.51 TECU, one wide lane more at least
0.24 TECU and two 0.03 TECU, so that either number helps the other.

Where one of the signals was not interrupted, its integer is known, and only one is looked for: a
cycle of L2 alone is 2.3 TECU, so that a second of contents decides, whatever the codes say.

A pair is accepted when it fits, and no other pair of integers is nearly as good. Multipath of the
codes does not average out in a minute: how far wide lanes of fixed satellites are from their common
bias shows it.

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

# Fewest seconds of data for a decision.
_FEWEST_SECONDS = 4
# Largest square of the errors over their sigmas of the pair that is taken, and how much larger that
# of every other pair must be.
_LARGEST_SQUARE = 16.0
_MARGIN = 25.0
# Wide lanes that are tried to either side.
_WIDE_LANES_TRIED = 4
# Smallest sigmas: of the mean wide lane, cycles, and of the lasting error of a prediction, TECU.
_WIDE_LANE_FLOOR = 0.02
_PREDICTION_FLOOR = 0.02
# Sigma of the slow error of a wide lane at first, cycles, and as how many seconds it counts; s over
# which it is averaged, and after which it has another value.
_FIRST_WIDE_LANE_SIGMA, _FIRST_SECONDS = 0.1, 10.0
_WIDE_LANE_MEMORY, _WIDE_LANE_TIME = 3000.0, 200.0


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
        self._wide_lane_square = _FIRST_WIDE_LANE_SIGMA**2
        self._wide_lane_count = _FIRST_SECONDS
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
        if not math.isfinite(wide_lane_cycles):
            return
        self._bias.add(wide_lane_cycles, float(samples))
        if self._bias.count >= _FEWEST_SECONDS:
            error = wide_lane_cycles - self._bias.mean
            self._wide_lane_count = min(self._wide_lane_count + 1.0, _WIDE_LANE_MEMORY)
            change = error * error - self._wide_lane_square
            self._wide_lane_square += change / self._wide_lane_count

    @property
    def wide_lane_sigma(self) -> float:
        """Sigma of the wide lane of a second of a satellite with integers, cycles."""
        return math.sqrt(self._wide_lane_square)

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
        excess_sigma_tecu: float,
        prediction_sigma_tecu: float,
        known: tuple[float | None, float | None] = (None, None),
    ) -> tuple[float, float] | None:
        """Add a second of an arc without integers and return both integers once they are certain.

        Parameters
        ----------
        arc : hashable
            Satellite and arcs of both receivers.
        wide_lane_cycles, samples : float, int
            Mean wide lane of the single difference, and of how many samples it is the mean.
        excess_tecu, excess_sigma_tecu, prediction_sigma_tecu : float
            Differential TEC of the phases without integers less the prediction of the other
            satellites, and the sigmas of either. What more there is shows in the scatter.
        known : tuple of float or None
            Integers of the signals that were not interrupted, cycles.
        """
        if not math.isfinite(wide_lane_cycles + excess_tecu):
            return None
        wide_lane, excess = self._unresolved.setdefault(arc, (WeightedMean(), WeightedMean()))
        wide_lane.add(wide_lane_cycles, float(samples))
        excess.add(excess_tecu)
        has_known = known != (None, None)
        has_wide_lane = self._bias.count >= _FEWEST_SECONDS
        if not has_known and (excess.count < _FEWEST_SECONDS or not has_wide_lane):
            return None
        scatter = excess.sigma() if excess.count >= _FEWEST_SECONDS else 0.0
        sigma = math.hypot(
            max(scatter, excess_sigma_tecu / math.sqrt(excess.count)),
            max(prediction_sigma_tecu, _PREDICTION_FLOOR),
        )
        wide_error, wide_sigma = 0.0, math.inf
        if has_wide_lane:
            lasting = self.wide_lane_sigma / math.sqrt(1.0 + excess.count / _WIDE_LANE_TIME)
            wide_sigma = math.hypot(
                max(wide_lane.sigma(), lasting, _WIDE_LANE_FLOOR), self._bias.sigma()
            )
            wide_error = wide_lane.mean - self._bias.mean
        pairs = (
            self._pairs_with(known, excess.mean)
            if has_known
            else self._pairs_near(round(wide_error), excess.mean)
        )
        integers = self._best_pair(pairs, wide_error, wide_sigma, excess.mean, sigma)
        if integers is not None:
            del self._unresolved[arc]
        return integers

    def _pairs_near(self, wide_lane: int, excess: float) -> list[tuple[float, float]]:
        """Return pairs of integers whose wide lane and content (TECU) are near to given ones."""
        pairs = []
        for wide in range(wide_lane - _WIDE_LANES_TRIED, wide_lane + _WIDE_LANES_TRIED + 1):
            # S = K (l1 n1 - l2 n2) with n1 = wide + n2.
            middle = round((excess - self._first_tecu * wide) / self._both_tecu)
            pairs += [(float(wide + n), float(n)) for n in (middle - 1, middle, middle + 1)]
        return pairs

    def _pairs_with(
        self, known: tuple[float | None, float | None], excess: float
    ) -> list[tuple[float, float]]:
        """Return pairs of which one integer is known whose content is near to a given one, TECU."""
        first, second = known
        second_tecu = self._first_tecu - self._both_tecu
        if first is not None:
            middle = round((self._first_tecu * first - excess) / second_tecu)
            return [(first, float(n)) for n in (middle - 1, middle, middle + 1)]
        assert second is not None
        middle = round((excess + second_tecu * second) / self._first_tecu)
        return [(float(n), second) for n in (middle - 1, middle, middle + 1)]

    def _best_pair(
        self,
        pairs: list[tuple[float, float]],
        wide_lane: float,
        wide_sigma: float,
        excess: float,
        sigma: float,
    ) -> tuple[float, float] | None:
        """Return the pair of integers that fits, if no other pair fits nearly as well."""
        squares = []
        for first, second in pairs:
            error = excess - self._first_tecu * (first - second) - self._both_tecu * second
            square = ((wide_lane - (first - second)) / wide_sigma) ** 2 + (error / sigma) ** 2
            squares.append((square, first, second))
        squares.sort()
        best, other = squares[0], squares[1]
        if best[0] > _LARGEST_SQUARE or other[0] - best[0] < _MARGIN:
            return None
        return best[1], best[2]
