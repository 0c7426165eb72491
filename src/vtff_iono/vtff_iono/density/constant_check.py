"""The constant of all satellites after all have lost their integers, against the one before.

Where all integers were lost, those that are found again may be wrong alike: signals that went on
through a fade, from which the others follow, may have wound up by a cycle. All contents are then
off by a cycle of both signals, 0.51 TECU, which neither wide lanes nor the satellites among
themselves show. Contents that are compared with the constant before show it once they are quiet
enough. Until then nothing tells which is right, and the density is as unsure as that: each number
of cycles has a probability, and what all contents may be off by belongs to the sigma.

The probability before any content is that of a walk by single cycles, up and down alike, whose
steps are a Poisson process: the difference of two Poisson variables (Skellam 1946, J. Royal
Statistical Society 109:296). The rate of the steps is measured: how often integers that had proved
right became wrong while the phases seemed to go on and fluctuated. Few of them say little of a
rate, which is that of Jeffreys' prior (half a step more than were seen). The walk lasts for as long
as no density checks the integers.
"""

from __future__ import annotations

import copy
import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_iono.density.electron_density import ElectronDensityEstimator

__all__ = ["ConstantCheck", "ConstantVerdict", "walk_probability"]

# By how many cycles of both signals the integers of all links are tried to be off, and by how much
# the sum of the squares of contents over their sigmas must be less than with any other number.
_SHIFTS_TRIED, _MARGIN_OF_SHIFT = (-2, -1, 0, 1, 2), 25.0
# What a link that contradicts the others adds to that sum, whatever it is off by.
_SQUARE_OF_OUTLIER = 25.0
# Nothing is told or learned from contents that speak for a shift by so much.
_DOUBT_OF_SHIFT = 9.0
# Fewest links with integers that decide.
_FEWEST_LINKS = 4
# Places at which the characteristic function of a walk is summed, and the most steps for which they
# are enough; with more the numbers of cycles that are tried are as probable as each other.
_PLACES, _MOST_STEPS = 256, 1000.0
# Probabilities are as good as zero below this, where rounding decides their signs.
_LEAST_PROBABILITY = 1e-15


class ConstantVerdict(NamedTuple):
    """The verdict of a second of contents on the constant.

    Attributes
    ----------
    may_use : bool
        Whether something may be told and learned of the contents.
    spread_tecu : float
        Sigma of what all contents may be off by together, TECU.
    estimator : ElectronDensityEstimator or None
        The one to go on with, whose constant is the one before and the cycles that were found; None
        where the present one is right or nothing is certain.
    """

    may_use: bool
    spread_tecu: float
    estimator: ElectronDensityEstimator | None


class ConstantCheck:
    """Compares integers that were found again after all were lost with the constant before.

    Parameters
    ----------
    cycle_tecu : float
        Content that a cycle more of both signals makes, TECU.
    """

    def __init__(self, cycle_tecu: float) -> None:
        self._cycle_tecu = cycle_tecu
        # The estimator as it was when the last link lost its integers, until the constant has
        # proved to be the same or another one.
        self._before: ElectronDensityEstimator | None = None
        # s for which no density has checked the integers since, and the last second.
        self._unchecked = 0.0
        self._last_time = math.nan
        # Integers that became wrong, and seconds of satellites in which they could have.
        self._steps, self._exposure = 0, 0.0

    @property
    def is_open(self) -> bool:
        """Whether a constant from before a loss waits for a decision."""
        return self._before is not None

    def lose(self, estimator: ElectronDensityEstimator) -> None:
        """Keep the estimator, whose last link has lost its integers, unless one is kept."""
        if self._before is None:
            self._before = copy.deepcopy(estimator)
            self._unchecked = 0.0

    def forget(self) -> None:
        """Forget the constant before, which is none of the integers that follow."""
        self._before = None

    def pass_second(self, time: float, is_checked: bool) -> None:
        """Count a second, whose density has or has not checked the integers; `time` in s."""
        elapsed = max(time - self._last_time, 0.0)
        if self._before is not None and not is_checked and math.isfinite(elapsed):
            self._unchecked += elapsed
        self._last_time = time

    def add_steps(self, steps: int, satellites: int) -> None:
        """Add a second of satellites whose integers had proved right.

        Parameters
        ----------
        steps : int
            How many of them have become wrong though their phases seemed to go on.
        satellites : int
            How many fluctuate in this second and are still right.
        """
        self._steps += steps
        self._exposure += satellites

    def compare(
        self,
        time: float,
        altitudes: tuple[float, float],
        elevation_chief: FloatArray,
        elevation_deputy: FloatArray,
        differential_stec_tecu: FloatArray,
        sigma_tecu: FloatArray,
        satellite: npt.ArrayLike,
    ) -> ConstantVerdict:
        """Return what contents of a second, with integers that were found again, tell.

        The constant that fits the integers as they are is the one before and a number of cycles of
        both signals. That number is certain where it fits much better than any other one.

        Parameters
        ----------
        time : float
            s.
        altitudes : tuple of float
            Altitudes of chief and deputy, m.
        elevation_chief, elevation_deputy, differential_stec_tecu, sigma_tecu : ndarray, shape (n,)
            As in `ElectronDensityEstimator.update`; NaN for a link that is not used.
        satellite : array_like of int, shape (n,)
        """
        before = self._before
        if before is None:
            return ConstantVerdict(True, 0.0, None)
        used = np.isfinite(differential_stec_tecu) & np.isfinite(sigma_tecu)
        if not used.any():
            return ConstantVerdict(True, 0.0, None)
        predicted, covariance = before.predicted_stec(
            time, *altitudes, elevation_chief, elevation_deputy, satellite
        )
        errors = (differential_stec_tecu - predicted)[used]
        covariance = covariance[np.ix_(used, used)] + np.diag(sigma_tecu[used] ** 2)
        squares = np.array(
            [
                self._square(before, errors - shift * self._cycle_tecu, covariance)
                for shift in _SHIFTS_TRIED
            ]
        )
        best, second = np.argsort(squares, kind="stable")[:2].tolist()
        cycles = _SHIFTS_TRIED[best]
        is_enough = np.count_nonzero(used) >= _FEWEST_LINKS
        if is_enough and squares[second] - squares[best] >= _MARGIN_OF_SHIFT:
            self._before = None
            if cycles == 0:
                return ConstantVerdict(True, 0.0, None)
            before.shift_bias(cycles * self._cycle_tecu)
            return ConstantVerdict(True, 0.0, before)
        doubt = squares[_SHIFTS_TRIED.index(0)] - squares[best]
        may_use = not is_enough or bool(doubt < _DOUBT_OF_SHIFT)
        return ConstantVerdict(may_use, self._spread(squares - squares[best]), None)

    def _square(
        self, before: ElectronDensityEstimator, innovation: FloatArray, covariance: FloatArray
    ) -> float:
        """Return the square of contents less the predicted ones (TECU) over their covariance."""
        kept = ~before.find_outliers(innovation, covariance)
        normalized = np.linalg.solve(covariance[np.ix_(kept, kept)], innovation[kept])
        # A link that contradicts the others speaks against any shift alike.
        outliers = np.count_nonzero(~kept)
        return float(innovation[kept] @ normalized) + _SQUARE_OF_OUTLIER * outliers

    def _spread(self, squares: FloatArray) -> float:
        """Return the sigma of what all contents are off by, TECU, from the squares of all shifts.

        It is that about the integers as they are, because the density is told with these.
        """
        rate = (self._steps + 0.5) / max(self._exposure, 1.0)
        shifts = np.array(_SHIFTS_TRIED)
        before = np.maximum(walk_probability(shifts, rate * self._unchecked), _LEAST_PROBABILITY)
        exponent = np.log(before) - 0.5 * squares
        weight = np.exp(exponent - exponent.max())
        return abs(self._cycle_tecu) * math.sqrt(float(weight @ shifts**2 / weight.sum()))


def walk_probability(places: np.ndarray, steps: float) -> FloatArray:
    """Return the probability that a walk by single steps, up and down alike, ends at a place.

    Parameters
    ----------
    places : ndarray of int, shape (n,)
    steps : float
        Expected number of steps, which are a Poisson process.
    """
    # Sum over the characteristic function exp(m (cos w - 1)).
    angle = 2.0 * math.pi * np.arange(_PLACES) / _PLACES
    transform = np.exp(min(steps, _MOST_STEPS) * (np.cos(angle) - 1.0))
    return np.asarray(np.cos(np.multiply.outer(places, angle)) @ transform / _PLACES)
