"""Integers of satellites whose phases were broken, found again, all of them together.

In scintillation arcs break every minute or so, that of L2 every few seconds, and the relative
navigation filter cannot fix integers there. Both integers of a new arc follow from two numbers:
the wide lane, and the differential TEC that is predicted: from the constant between the receivers,
the level that the satellite had before, and the density between the spacecraft. One cycle more on
both signals is 0.51 TECU, one wide lane more at least 0.24 TECU and two 0.03 TECU, so that either
number helps the other. Where one of the signals was not interrupted, its integer is known, and only
one is looked for: a cycle of L2 alone is 2.3 TECU, so that a second of contents decides, whatever
the codes say.

The wide lane is seen twice. The range between the spacecraft along each ray is known from relative
navigation to centimetres, and a wide lane is 0.86 m: beside satellites with integers, which show
the difference of the receiver clocks, one second of phases tells it to a twentieth of a cycle. The
codes tell it too (Melbourne-Wuebbena), with a constant bias that satellites with integers have
shown, but multipath makes it err by a third of a cycle for minutes. How far either is off for
satellites with integers is measured.

The errors of the predictions have parts in common, above all that of the density where no satellite
has kept its integers. Therefore the pairs of all satellites are tried together, the covariance of
the predictions with them: integer least squares, in which the nearest vectors are found satellite
by satellite, those first whose prediction is best. A pair is accepted when it fits and is the same
in all vectors that are nearly as good as the best one.

References
----------
Melbourne (1985) and Wuebbena (1985), Proc. First Int. Symposium on Precise Positioning with GPS.
Teunissen (1995), The least-squares ambiguity decorrelation adjustment, J. Geodesy 70, 65-82.
"""

from __future__ import annotations

import math
from collections.abc import Container, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from scipy.special import chdtri

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import DELAY_PER_TECU
from vtff_iono.density.integer_judgement import (
    BIAS_SQUARES,
    FEWEST_SECONDS,
    OF_CODES,
    OF_GEOMETRY,
    add_geometric,
    add_resolved,
    first_measured,
    forget_bias,
    wide_lane_error,
)
from vtff_iono.links.geometry_free import tecu_per_metre

__all__ = ["FloatingContent", "IntegerResolver", "WeightedMean"]

_Numbers = TypeVar("_Numbers", float, FloatArray)

# Largest square of the errors over their sigmas of the pair that is taken, and how much larger that
# of all pairs together must be with every other pair.
_LARGEST_SQUARE = 16.0
_MARGIN = 25.0
# Probability that the sum of squares of right errors is larger.
_RARE = 1e-3
# Wide lanes that are tried to either side, and sigmas of a prediction within which integers are.
_WIDE_LANES_TRIED = 4
_SIGMAS_TRIED = 4.0
_MOST_TRIED = 40
# Vectors of some satellites that are kept while others are missing: those that are at most twice
# the margin worse than the best one.
_VECTORS_KEPT = 400
# Smallest sigmas: of the mean wide lanes by codes and by geometry, cycles, and of the lasting error
# of a prediction, TECU.
_WIDE_LANE_FLOOR, _GEOMETRIC_FLOOR = 0.02, 0.02
_PREDICTION_FLOOR = 0.02
# s after which the slow error of a wide lane by codes has another value.
_WIDE_LANE_TIME = 200.0


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
    geometric_cycles : float
        Wide lane of the phases less that of ranges, predicted content and clocks; NaN without.
    """

    arc: Hashable
    wide_lane_cycles: float
    samples: int
    excess_tecu: float
    sigma_tecu: float
    known: tuple[float | None, float | None] = (None, None)
    geometric_cycles: float = math.nan


class _FloatingErrors(NamedTuple):
    """Means of a link: wide lanes by codes and by geometry, cycles, and excess content, TECU.

    The bias of the wide lane by codes is removed. `noise_variance` is that of the noise of the
    content, TECU^2, which the wide lane by geometry shares; `geometric` is NaN where there is none.
    """

    wide_lane: float
    wide_lane_sigma: float
    excess: float
    noise_variance: float
    known: tuple[float | None, float | None]
    geometric: float


class IntegerResolver:
    """Finds the integers of two signals of single differences, second by second.

    Parameters
    ----------
    frequency_first, frequency_second : float
        Carrier frequencies of the two signals, Hz.

    Attributes
    ----------
    cycles_per_tecu, noise_square : float
        As in `vtff_iono.density.integer_judgement.find_wrong_integers`.
    measured : ndarray, shape (8,)
        Wide lanes of the satellites with integers, as there.
    """

    def __init__(self, frequency_first: float, frequency_second: float) -> None:
        scale = tecu_per_metre(frequency_first, frequency_second)
        self._first_tecu = scale * SPEED_OF_LIGHT / frequency_first
        second_tecu = scale * SPEED_OF_LIGHT / frequency_second
        self._both_tecu = self._first_tecu - second_tecu
        delay = DELAY_PER_TECU / SPEED_OF_LIGHT
        self.cycles_per_tecu = delay * (1.0 / frequency_second - 1.0 / frequency_first)
        # Noise of the phases of both signals, equal in cycles, in a wide lane, relative to that in
        # the content: its variance, 1/TECU^2, and its covariance with that, 1/TECU.
        square = self._first_tecu**2 + second_tecu**2
        self.noise_square = 2.0 / square
        self._noise_product = (self._first_tecu + second_tecu) / square
        self.measured = first_measured()
        # Mean wide lane, excess content and wide lane by geometry of each arc without integers.
        self._unresolved: dict[Hashable, tuple[WeightedMean, WeightedMean, WeightedMean]] = {}

    @property
    def _bias(self) -> WeightedMean:
        """Wide lanes by codes of satellites with integers, cycles."""
        weight, count, mean, squares = self.measured[: BIAS_SQUARES + 1].tolist()
        return WeightedMean(weight, int(count), mean, squares)

    def __len__(self) -> int:
        """Return the number of arcs whose samples are kept because they have no integers yet."""
        return len(self._unresolved)

    def reset(self) -> None:
        """Forget everything, because the integers have another datum."""
        forget_bias(self.measured)
        self._unresolved.clear()

    def keep_only(self, arcs: Container[Hashable]) -> None:
        """Forget the samples of all other arcs, which have ended without integers."""
        for arc in [arc for arc in self._unresolved if arc not in arcs]:
            del self._unresolved[arc]

    def add_resolved(self, wide_lane_cycles: float, samples: int) -> None:
        """Add the mean wide lane of a satellite less its integers, which is the common bias."""
        add_resolved(self.measured, wide_lane_cycles, float(samples))

    @property
    def wide_lane_sigma(self) -> float:
        """Sigma of the wide lane of a second of a satellite with integers, by codes, cycles."""
        return math.sqrt(self.measured[OF_CODES])

    @property
    def geometric_sigma(self) -> float:
        """Sigma of the lasting errors of wide lanes by geometry, cycles."""
        return math.sqrt(self.measured[OF_GEOMETRY])

    def geometric_variance(self, content_sigma: _Numbers, relative_sigma_cycles: float) -> _Numbers:
        """Return the variance of wide lanes by geometry of a second, cycles^2.

        `content_sigma` is that of the contents, TECU; `relative_sigma_cycles` is that of the
        position of one spacecraft from the other.
        """
        lasting = self.geometric_sigma**2 + relative_sigma_cycles**2
        return self.noise_square * content_sigma**2 + lasting

    def add_geometric(self, errors: Sequence[tuple[float, float]]) -> None:
        """Add what wide lanes by geometry are off for satellites with integers in a second.

        `errors` are those less their median, which is the difference of the clocks, cycles, and the
        sigmas of the contents, TECU.
        """
        values = np.array(errors, dtype=float).reshape(-1, 2)
        add_geometric(self.measured, values[:, 0].copy(), values[:, 1].copy(), self.noise_square)

    def wide_lane_error(self, wide_lane_cycles: float) -> float:
        """Return how far a wide lane less its integers is from the common bias; NaN at first."""
        return float(wide_lane_error(self.measured, wide_lane_cycles))

    def resolve(
        self,
        contents: Sequence[FloatingContent],
        covariance: FloatArray,
        is_density_known: bool = True,
        clock_variance: float = 0.0,
        relative_sigma_cycles: float = 0.0,
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
        clock_variance : float
            Variance of the difference of the clocks that was removed from wide lanes by geometry,
            cycles^2.
        relative_sigma_cycles : float
            As in `geometric_variance`.
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
        lasting = self.geometric_sigma**2 + relative_sigma_cycles**2
        joint = self._joint_covariance(
            errors, covariance[np.ix_(chosen, chosen)], clock_variance, lasting
        )
        found = self._search(errors, joint)
        result: dict[Hashable, tuple[float, float]] = {}
        for index, pair in found.items():
            arc = contents[chosen[index]].arc
            result[arc] = pair
            del self._unresolved[arc]
        return result

    def find_shift(
        self,
        excess_tecu: float,
        variance: float,
        wide_lanes: FloatArray,
        known: tuple[float | None, float | None],
    ) -> tuple[float, float] | None:
        """Return the two integers by which all links are off, if these are certain.

        Parameters
        ----------
        excess_tecu, variance : float
            Excess of all contents over their predictions, TECU, and its variance.
        wide_lanes : ndarray, shape (n,)
            Mean wide lanes of a second, less the integers that are off, cycles.
        known : tuple of float or None
            Either integer if it is known.
        """
        if self._bias.count < FEWEST_SECONDS or not np.isfinite(wide_lanes).all():
            return None
        scatter = max(self.wide_lane_sigma, float(np.std(wide_lanes)), _WIDE_LANE_FLOOR)
        errors = _FloatingErrors(
            float(np.mean(wide_lanes)) - self._bias.mean,
            math.hypot(scatter / math.sqrt(len(wide_lanes)), self._bias.sigma()),
            excess_tecu,
            variance,
            known,
            math.nan,
        )
        joint = self._joint_covariance([errors], np.zeros((1, 1)), 0.0, 0.0)
        return self._search([errors], joint).get(0)

    def agree_with_codes(self, wide_lanes: Mapping[Hashable, float]) -> bool:
        """Return whether the codes allow that integers which nothing has checked are right.

        Codes tell the wide lanes of all links but for one bias, whatever the positions are. A wrong
        position, which makes integers that fit it, moves them by other amounts for each satellite.

        Parameters
        ----------
        wide_lanes : mapping of hashable to float
            Integer of the first signal less that of the second, cycles, by arc.
        """
        told = {
            arc: mean
            for arc, (mean, _, _) in self._unresolved.items()
            if arc in wide_lanes and mean.count >= FEWEST_SECONDS
        }
        freedom = len(told) - 1
        if freedom < 1:
            return False
        errors = np.array([mean.mean - wide_lanes[arc] for arc, mean in told.items()])
        weights = np.array([self._code_sigma(mean) for mean in told.values()]) ** -2.0
        squares = float(weights @ (errors - weights @ errors / weights.sum()) ** 2)
        return squares <= float(chdtri(freedom, _RARE))

    def _code_sigma(self, wide_lane: WeightedMean) -> float:
        """Return the sigma of the mean wide lane of a link by codes, cycles."""
        lasting = self.wide_lane_sigma / math.sqrt(1.0 + wide_lane.count / _WIDE_LANE_TIME)
        return max(wide_lane.sigma(), lasting, _WIDE_LANE_FLOOR)

    def _errors(self, content: FloatingContent, is_density_known: bool) -> _FloatingErrors | None:
        """Add a second of a link; return its means, or None if they are too few for a decision."""
        wide_lane, excess, by_geometry = self._unresolved.setdefault(
            content.arc, (WeightedMean(), WeightedMean(), WeightedMean())
        )
        wide_lane.add(content.wide_lane_cycles, float(content.samples))
        geometric = content.geometric_cycles
        if is_density_known:
            excess.add(content.excess_tecu)
        if math.isfinite(geometric):
            by_geometry.add(geometric)
            geometric = by_geometry.mean
        is_told = content.known != (None, None) or math.isfinite(geometric)
        has_wide_lane = self._bias.count >= FEWEST_SECONDS
        if not is_told and (wide_lane.count < FEWEST_SECONDS or not has_wide_lane):
            return None
        mean, sigma = content.excess_tecu, content.sigma_tecu
        if is_density_known:
            scatter = excess.sigma() if excess.count >= FEWEST_SECONDS else 0.0
            mean, sigma = excess.mean, max(scatter, sigma / math.sqrt(excess.count))
        wide_error, wide_sigma = 0.0, math.inf
        if has_wide_lane:
            wide_sigma = math.hypot(self._code_sigma(wide_lane), self._bias.sigma())
            wide_error = wide_lane.mean - self._bias.mean
        return _FloatingErrors(wide_error, wide_sigma, mean, sigma**2, content.known, geometric)

    def _pairs(
        self,
        errors: _FloatingErrors,
        middle_of_wide_lanes: float,
        excess: FloatArray,
        spread: float,
    ) -> tuple[FloatArray, FloatArray]:
        """Return pairs of integers (m, p, 2) near to contents (m), TECU, and their contents (m, p).

        `spread` is the distance from the contents within which pairs are looked for, TECU, and
        `middle_of_wide_lanes` the wide lane around which they are looked for, cycles.
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
            wide = round(middle_of_wide_lanes) + np.arange(
                -_WIDE_LANES_TRIED, _WIDE_LANES_TRIED + 1.0
            )
            middle = (excess[:, np.newaxis] - self._first_tecu * wide) / self._both_tecu
            seconds = around(middle, self._both_tecu)
            firsts = (seconds + wide[:, np.newaxis]).reshape(len(excess), -1)
            seconds = seconds.reshape(len(excess), -1)
        return (
            np.stack((firsts, seconds), axis=-1),
            self._first_tecu * firsts - second_tecu * seconds,
        )

    def _joint_covariance(
        self,
        errors: list[_FloatingErrors],
        covariance: FloatArray,
        clock_variance: float,
        lasting_variance: float,
    ) -> FloatArray:
        """Return the covariance of contents and of wide lanes by geometry, shape (2, n, 2, n).

        An error of the predicted content is one of the wide lane from which it was removed, and
        noise of the phases is in both. `covariance` is that of the predictions, TECU^2; those of
        the clocks and of what lasts of the errors of wide lanes are in cycles^2.
        """
        noise = np.diag([error.noise_variance for error in errors])
        floor = _PREDICTION_FLOOR**2 * np.eye(len(errors))
        joint = np.empty((2, len(errors), 2, len(errors)))
        joint[0, :, 0] = covariance + noise + floor
        product = self.cycles_per_tecu * covariance + self._noise_product * noise
        joint[0, :, 1] = joint[1, :, 0] = product
        joint[1, :, 1] = self.cycles_per_tecu**2 * covariance + self.noise_square * noise
        joint[1, :, 1] += clock_variance
        lasting = np.full(len(errors), lasting_variance + _GEOMETRIC_FLOOR**2)
        joint[1, :, 1] += np.diag(lasting)
        return joint

    def _search(
        self, errors: list[_FloatingErrors], joint: FloatArray
    ) -> dict[int, tuple[float, float]]:
        """Return the pairs of integers that are certain, by the index of their link.

        A link whose content no integers explain beside the others is left out, and the rest tried
        again. `joint` is that of `_joint_covariance`.
        """
        links = np.argsort(np.diag(joint[0, :, 0]), kind="stable")
        while len(links):
            chosen = [errors[link] for link in links.tolist()]
            pairs, squares = self._nearest_vectors(chosen, joint[:, links][:, :, :, links])
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
        self, errors: list[_FloatingErrors], joint: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the vectors of pairs of integers (m, n, 2) with the smallest squares, best first.

        The squares are told for each link, (m, n): of its content and of its wide lane by geometry,
        given those of the links before it, over their sigmas, and of its wide lane by codes.
        `joint` is that of `_joint_covariance`.
        """
        count = len(errors)
        # A content and a wide lane by geometry for each link, where it has one.
        has_geometry = np.isfinite([error.geometric for error in errors])
        place_of_content = np.arange(count) + np.cumsum(has_geometry) - has_geometry
        size = count + int(has_geometry.sum())
        order = np.empty(size, dtype=np.int64)
        order[place_of_content] = np.arange(count)
        order[place_of_content[has_geometry] + 1] = count + np.flatnonzero(has_geometry)
        table = joint.reshape(2 * count, 2 * count)
        lower = np.linalg.cholesky(table[np.ix_(order, order)])
        pairs, squares = np.zeros((1, count, 2)), np.zeros((1, count))
        normalized = np.zeros((1, size))
        for link, error in enumerate(errors):
            place = int(place_of_content[link])
            sigma = float(lower[place, place])
            excess = error.excess - normalized[:, :place] @ lower[place, :place]
            middle = error.geometric if has_geometry[link] else error.wide_lane
            tried, content = self._pairs(error, middle, excess, _SIGMAS_TRIED * sigma)
            of_content = (excess[:, np.newaxis] - content) / sigma
            wide_lane = tried[..., 0] - tried[..., 1]
            square = of_content**2 + ((error.wide_lane - wide_lane) / error.wide_lane_sigma) ** 2
            if has_geometry[link]:
                row = lower[place + 1]
                rest = error.geometric - normalized[:, :place] @ row[:place]
                of_geometry = rest[:, np.newaxis] - wide_lane - row[place] * of_content
                of_geometry /= row[place + 1]
                square = square + of_geometry**2
            total = (squares.sum(axis=1)[:, np.newaxis] + square).ravel()
            best = np.argsort(total, kind="stable")[:_VECTORS_KEPT]
            best = best[total[best] <= total[best[0]] + 2.0 * _MARGIN]
            before, which = np.divmod(best, square.shape[1])
            pairs, squares, normalized = (rows[before] for rows in (pairs, squares, normalized))
            pairs[:, link] = tried[before, which]
            squares[:, link] = square[before, which]
            normalized[:, place] = of_content[before, which]
            if has_geometry[link]:
                normalized[:, place + 1] = of_geometry[before, which]
        return pairs, squares
