"""Integers of satellites whose phases were broken, found again beside those that hold.

In scintillation arcs break every minute or so, and the relative navigation filter cannot fix
integers there. While other satellites still have theirs, both integers of a new arc follow without
a guess: the wide lane from the Melbourne-Wuebbena combination, because its receiver bias is known
from the others; then the second integer from the differential TEC that the others predict. One
cycle more on both signals is 0.51 TECU, many times the error of the prediction.

An integer is accepted when the mean is nearer to it than to any other by a multiple of its sigma.

References
----------
Melbourne (1985) and Wuebbena (1985), Proc. First Int. Symposium on Precise Positioning with GPS.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_iono.links.geometry_free import tecu_per_metre

__all__ = ["IntegerResolver"]

# Seconds that a decision needs at least, and the margin in sigmas to the next integer.
_FEWEST_SECONDS = 4
_MARGIN_SIGMAS = 5.0
# Least sigmas: of the mean wide lane, cycles, and of a prediction's error that lasts, TECU.
_WIDE_LANE_FLOOR = 0.02
_PREDICTION_FLOOR = 0.02


@dataclass
class _Mean:
    """Mean and scatter of samples with weights."""

    weight: float = 0.0
    count: int = 0
    mean: float = 0.0
    squares: float = 0.0

    def add(self, value: float, weight: float = 1.0) -> None:
        self.weight += weight
        self.count += 1
        deviation = value - self.mean
        self.mean += weight / self.weight * deviation
        self.squares += weight * deviation * (value - self.mean)

    def sigma(self) -> float:
        """Return the sigma of the mean."""
        if self.count < 2:
            return math.inf
        return math.sqrt(self.squares / self.weight / (self.count - 1))


class IntegerResolver:
    """Finds integers of single differences of two signals, second by second.

    Parameters
    ----------
    frequency_first, frequency_second : float
        Hz.
    """

    def __init__(self, frequency_first: float, frequency_second: float) -> None:
        scale = tecu_per_metre(frequency_first, frequency_second)
        self._first_tecu = scale * SPEED_OF_LIGHT / frequency_first
        self._both_tecu = self._first_tecu - scale * SPEED_OF_LIGHT / frequency_second
        self._bias = _Mean()
        self._open: dict[Hashable, tuple[_Mean, _Mean]] = {}

    def reset(self) -> None:
        """Forget everything: the integers have another datum."""
        self._bias = _Mean()
        self._open.clear()

    def add_known(self, wide_lane_cycles: float, samples: int) -> None:
        """Take the mean wide lane of a satellite less its integers, which is the common bias."""
        if math.isfinite(wide_lane_cycles):
            self._bias.add(wide_lane_cycles, float(samples))

    def wide_lane_error(self, wide_lane_cycles: float) -> float:
        """Return how far a wide lane less its integers is from the common bias; NaN at first."""
        if self._bias.count < _FEWEST_SECONDS:
            return math.nan
        return wide_lane_cycles - self._bias.mean

    def add_unknown(
        self,
        arc: Hashable,
        wide_lane_cycles: float,
        samples: int,
        excess_tecu: float,
    ) -> tuple[float, float] | None:
        """Take a second of an arc without integers and return both once they are certain.

        Parameters
        ----------
        arc : hashable
            Satellite and arcs of both receivers.
        wide_lane_cycles, samples : float, int
            Mean of the single difference, and how many samples it is of.
        excess_tecu : float
            Differential TEC of the phases without integers less the prediction of the others. The
            noise of both shows in its scatter.
        """
        if not math.isfinite(wide_lane_cycles + excess_tecu):
            return None
        wide_lane, excess = self._open.setdefault(arc, (_Mean(), _Mean()))
        wide_lane.add(wide_lane_cycles, float(samples))
        excess.add(excess_tecu)
        if excess.count < _FEWEST_SECONDS or self._bias.count < _FEWEST_SECONDS:
            return None
        wide_sigma = math.hypot(max(wide_lane.sigma(), _WIDE_LANE_FLOOR), self._bias.sigma())
        wide = _certain(wide_lane.mean - self._bias.mean, wide_sigma)
        if wide is None:
            return None
        # S = K (l1 n1 - l2 n2) with n1 = wide + n2.
        second = (excess.mean - self._first_tecu * wide) / self._both_tecu
        sigma = math.hypot(excess.sigma(), _PREDICTION_FLOOR)
        found = _certain(second, sigma / abs(self._both_tecu))
        if found is None:
            return None
        del self._open[arc]
        return wide + found, found


def _certain(value: float, sigma: float) -> float | None:
    """Return the nearest integer if no other one is possible, else None."""
    nearest = float(round(value))
    return nearest if 0.5 - abs(value - nearest) > _MARGIN_SIGMAS * sigma else None
