"""Integers of satellites whose phases were broken, found again, all of them together.

In scintillation arcs break every minute or so, that of L2 every few seconds, and the relative
navigation filter cannot fix integers there. Both integers of a new arc follow from two numbers:
the wide lane from the Melbourne-Wuebbena combination, whose receiver bias other satellites have
shown, and the differential TEC that is predicted: from the constant between the receivers, the
level that the satellite had before, and the density between the spacecraft. One cycle more on both
signals is 0.51 TECU, one wide lane more at least 0.24 TECU and two 0.03 TECU, so that either number
helps the other. Where one of the signals was not interrupted, its integer is known, and only one is
looked for: a cycle of L2 alone is 2.3 TECU, so that a second of contents decides, whatever the
codes say.

The errors of the predictions have parts in common, above all that of the density where no satellite
has kept its integers. Therefore the pairs of all satellites are tried together, the covariance of
the predictions with them: integer least squares, in which the nearest vectors are found satellite
by satellite, those first whose prediction is best. A pair is accepted when it fits and is the same
in all vectors that are nearly as good as the best one. Multipath of the codes does not average out
in a minute: how far wide lanes of fixed satellites are from their common bias shows it.

References
----------
Melbourne (1985) and Wuebbena (1985), Proc. First Int. Symposium on Precise Positioning with GPS.
Teunissen (1995), The least-squares ambiguity decorrelation adjustment, J. Geodesy 70, 65-82.
"""

from __future__ import annotations

import math
from collections.abc import Container, Hashable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.vectors import FloatArray
from vtff_iono.links.geometry_free import tecu_per_metre

__all__ = ["FloatingContent", "IntegerResolver", "WeightedMean"]

# Fewest seconds of data for a decision.
_FEWEST_SECONDS = 4
# Largest square of the errors over their sigmas of the pair that is taken, and how much larger that
# of all pairs together must be with every other pair.
_LARGEST_SQUARE = 16.0
_MARGIN = 25.0
# Wide lanes that are tried to either side, and sigmas of a prediction within which integers are.
_WIDE_LANES_TRIED = 4
_SIGMAS_TRIED = 4.0
_MOST_TRIED = 40
# Vectors of some satellites that are kept while others are missing: those that are at most twice
# the margin worse than the best one.
_VECTORS_KEPT = 400
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


class FloatingContent(NamedTuple):
    """A second of a link without integers.

    Attributes
    ----------
    arc : hashable
        Satellite and arcs of both receivers.
    wide_lane_cycles : float
        Mean wide lane of the single difference.
    samples : int
        Number of samples of the means.
    excess_tecu, sigma_tecu : float
        Differential TEC of the phases without integers less the predicted one, and the sigma of
        the former. What more it scatters by shows from second to second.
    known : tuple of float or None
        Integers of the signals that were not interrupted, cycles.
    """

    arc: Hashable
    wide_lane_cycles: float
    samples: int
    excess_tecu: float
    sigma_tecu: float
    known: tuple[float | None, float | None] = (None, None)


class _FloatingErrors(NamedTuple):
    """Means of a link: wide lane less the common bias, cycles, and excess content, TECU."""

    wide_lane: float
    wide_lane_sigma: float
    excess: float
    variance: float
    known: tuple[float | None, float | None]


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
        contents: Sequence[FloatingContent],
        covariance: FloatArray,
        is_density_known: bool = True,
    ) -> dict[Hashable, tuple[float, float]]:
        """Add a second of links without integers; return the integers that are certain, by arc.

        Parameters
        ----------
        contents : sequence of FloatingContent, length n
        covariance : ndarray, shape (n, n)
            Covariance of the predicted contents, TECU^2.
        is_density_known : bool
            Whether the density of this second is known from links with integers. If not, the
            errors of the predictions are of this second alone and are not averaged.
        """
        chosen: list[int] = []
        errors: list[_FloatingErrors] = []
        for row, content in enumerate(contents):
            values = content.wide_lane_cycles, content.excess_tecu, content.sigma_tecu
            if not all(map(math.isfinite, values)):
                continue
            error = self._errors(content, is_density_known)
            if error is not None:
                chosen.append(row)
                errors.append(error)
        found = self._search(errors, covariance[np.ix_(chosen, chosen)])
        result: dict[Hashable, tuple[float, float]] = {}
        for index, pair in found.items():
            arc = contents[chosen[index]].arc
            result[arc] = pair
            del self._unresolved[arc]
        return result

    def _errors(self, content: FloatingContent, is_density_known: bool) -> _FloatingErrors | None:
        """Add a second of a link; return its means, or None if they are too few for a decision."""
        wide_lane, excess = self._unresolved.setdefault(
            content.arc, (WeightedMean(), WeightedMean())
        )
        wide_lane.add(content.wide_lane_cycles, float(content.samples))
        if is_density_known:
            excess.add(content.excess_tecu)
        has_known = content.known != (None, None)
        has_wide_lane = self._bias.count >= _FEWEST_SECONDS
        if not has_known and (wide_lane.count < _FEWEST_SECONDS or not has_wide_lane):
            return None
        mean, sigma = content.excess_tecu, content.sigma_tecu
        if is_density_known:
            scatter = excess.sigma() if excess.count >= _FEWEST_SECONDS else 0.0
            mean, sigma = excess.mean, max(scatter, sigma / math.sqrt(excess.count))
        wide_error, wide_sigma = 0.0, math.inf
        if has_wide_lane:
            lasting = self.wide_lane_sigma / math.sqrt(1.0 + wide_lane.count / _WIDE_LANE_TIME)
            wide_sigma = math.hypot(
                max(wide_lane.sigma(), lasting, _WIDE_LANE_FLOOR), self._bias.sigma()
            )
            wide_error = wide_lane.mean - self._bias.mean
        variance = sigma**2 + _PREDICTION_FLOOR**2
        return _FloatingErrors(wide_error, wide_sigma, mean, variance, content.known)

    def _pairs(
        self, errors: _FloatingErrors, excess: FloatArray, spread: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return pairs of integers (m, p, 2) near to contents (m), TECU, and their contents (m, p).

        `spread` is the distance from the contents within which pairs are looked for, TECU.
        """
        second_tecu = self._first_tecu - self._both_tecu
        first, second = errors.known

        def around(middle: FloatArray, step: float) -> FloatArray:
            reach = min(1 + math.ceil(spread / abs(step)), _MOST_TRIED)
            near: FloatArray = np.rint(middle)[..., np.newaxis] + np.arange(-reach, reach + 1)
            return near

        if first is not None:
            seconds = around((self._first_tecu * first - excess) / second_tecu, second_tecu)
            firsts = np.full_like(seconds, first)
        elif second is not None:
            firsts = around((excess + second_tecu * second) / self._first_tecu, self._first_tecu)
            seconds = np.full_like(firsts, second)
        else:
            # S = K (l1 n1 - l2 n2) with n1 = wide + n2.
            wide = round(errors.wide_lane) + np.arange(-_WIDE_LANES_TRIED, _WIDE_LANES_TRIED + 1.0)
            middle = (excess[:, np.newaxis] - self._first_tecu * wide) / self._both_tecu
            seconds = around(middle, self._both_tecu)
            firsts = (seconds + wide[:, np.newaxis]).reshape(len(excess), -1)
            seconds = seconds.reshape(len(excess), -1)
        return (
            np.stack((firsts, seconds), axis=-1),
            self._first_tecu * firsts - second_tecu * seconds,
        )

    def _search(
        self, errors: list[_FloatingErrors], covariance: FloatArray
    ) -> dict[int, tuple[float, float]]:
        """Return the pairs of integers that are certain, by the index of their link.

        A link whose content no integers explain beside the others is left out, and the rest tried
        again.
        """
        covariance = covariance + np.diag([error.variance for error in errors])
        links = np.argsort(np.diag(covariance), kind="stable")
        while len(links):
            chosen = [errors[link] for link in links.tolist()]
            pairs, squares = self._nearest_vectors(chosen, covariance[np.ix_(links, links)])
            worst = int(np.argmax(squares[0]))
            if squares[0, worst] > _LARGEST_SQUARE:
                links = np.delete(links, worst)
                continue
            if len(pairs) == _VECTORS_KEPT and squares[-1].sum() - squares[0].sum() < _MARGIN:
                return {}
            is_near = squares.sum(axis=1) < squares[0].sum() + _MARGIN
            is_same = (pairs[is_near] == pairs[0]).all(axis=(0, 2))
            return {
                int(links[place]): (float(pairs[0, place, 0]), float(pairs[0, place, 1]))
                for place in np.flatnonzero(is_same).tolist()
            }
        return {}

    def _nearest_vectors(
        self, errors: list[_FloatingErrors], covariance: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the vectors of pairs of integers (m, n, 2) with the smallest squares, best first.

        The squares are told for each link, (m, n): of its content, given those of the links before
        it, over its sigma, and of its wide lane.
        """
        lower = np.linalg.cholesky(covariance)
        count = len(errors)
        pairs, squares = np.zeros((1, count, 2)), np.zeros((1, count))
        normalized = np.zeros((1, count))
        for link, error in enumerate(errors):
            sigma = float(lower[link, link])
            excess = error.excess - normalized[:, :link] @ lower[link, :link]
            tried, content = self._pairs(error, excess, _SIGMAS_TRIED * sigma)
            of_content = (excess[:, np.newaxis] - content) / sigma
            of_wide_lane = (
                error.wide_lane - (tried[..., 0] - tried[..., 1])
            ) / error.wide_lane_sigma
            square = of_content**2 + of_wide_lane**2
            total = (squares.sum(axis=1)[:, np.newaxis] + square).ravel()
            order = np.argsort(total, kind="stable")[:_VECTORS_KEPT]
            order = order[total[order] <= total[order[0]] + 2.0 * _MARGIN]
            before, which = np.divmod(order, square.shape[1])
            pairs, squares, normalized = (rows[before] for rows in (pairs, squares, normalized))
            pairs[:, link] = tried[before, which]
            squares[:, link] = square[before, which]
            normalized[:, link] = of_content[before, which]
        return pairs, squares
