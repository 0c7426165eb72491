"""The width of a wall, by the densities between the spacecraft and by the contents of each.

Nobody knows in advance how the density changes within a wall. Two shapes are tried, each as likely
as the other beforehand: a straight line, the sharpest that a wall of its width can be, and the
error function, to which whatever is smeared several times comes. Both are described by the width of
the straight line of the same second moment (3.46 standard deviations of the error function), on
which contents beside a thin wall depend. What the data tell of the shape counts; what they leave
open is in the sigma (the average over models: Hoeting et al. 1999, Statistical Science 14:382).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

from vtff_dynamics.vectors import FloatArray

__all__ = [
    "WALL_SHAPES",
    "WidthsByShape",
    "combine_widths",
    "shape_misfits",
    "wall_integrals",
]

WALL_SHAPES = ("line", "error function")
"""Shapes of walls that are tried, in the order of `WidthsByShape`."""

# m; the widest wall, and the step of the widths that are tried.
_WIDEST, _STEP = 40e3, 20.0
# Quantiles of the normal distribution over which probabilities of shapes are averaged.
_QUANTILES = special.ndtri((np.arange(99) + 0.5) / 99.0)
_LEAST_PROBABILITY = 1e-9
# Standard deviation of a straight line of the width of one.
_DEVIATION = 1.0 / math.sqrt(12.0)


@dataclass(frozen=True, eq=False)
class WidthsByShape:
    """Widths of a wall for each of `WALL_SHAPES`.

    Parameters
    ----------
    width : ndarray, shape (2,)
        Likeliest width, m.
    sigma : ndarray, shape (2,)
        Its sigma, m, or that of its square, m^2.
    misfit : ndarray, shape (2,)
        Sum of squares over sigmas where that width has it; only differences count.
    is_of_square : bool
        Whether the sigma is that of the square.
    """

    width: FloatArray
    sigma: FloatArray
    misfit: FloatArray
    is_of_square: bool = False

    def misfits(self, width: FloatArray) -> FloatArray:
        """Return the misfits of n widths for each shape beyond `misfit`, shape (2, n)."""
        power = 2 if self.is_of_square else 1
        apart = width**power - self.width[:, np.newaxis] ** power
        return np.asarray((apart / self.sigma[:, np.newaxis]) ** 2)

    def width_sigma(self) -> FloatArray:
        """Return the sigmas of the widths, (2,), m."""
        if not self.is_of_square:
            return self.sigma
        # d(W^2) = 2 W dW; the square itself where W is below its sigma.
        return np.minimum(np.sqrt(self.sigma), 0.5 * self.sigma / np.maximum(self.width, 1.0))


def combine_widths(*told: WidthsByShape) -> tuple[float, float]:
    """Return the width of a wall and its sigma, m: mean and scatter of all that are not negative.

    Densities rest on levels, which integers give; contents on slopes, mostly those of the mean of
    both spacecraft. Their errors are taken as independent (correlation 0.2 in drawn bubbles,
    benchmarks/README.md). Where they disagree by more than their sigmas, with the shape in which
    they do so least, both count as so much less sure (Birge 1932, Physical Review 40:207).

    Parameters
    ----------
    told : WidthsByShape
        One, or those by densities and by contents.
    """
    width, weight = _weights(told)
    of_width = weight.sum(axis=0)
    mean = float(of_width @ width)
    return mean, math.sqrt(float(of_width @ (width - mean) ** 2) + _STEP**2 / 12.0)


def _weights(told: tuple[WidthsByShape, ...]) -> tuple[FloatArray, FloatArray]:
    """Return n widths, m, and their probabilities with each shape, (2, n)."""
    width = np.arange(0.0, _WIDEST + _STEP, _STEP)
    misfit = np.sum([one.misfits(width) for one in told], axis=0)
    if len(told) > 1:
        apart = np.ptp([one.width for one in told], axis=0)
        sigma = np.sqrt(np.sum([one.width_sigma() ** 2 for one in told], axis=0))
        misfit /= max(1.0, float(np.min(apart / sigma))) ** 2
    misfit += np.sum([one.misfit for one in told], axis=0)[:, np.newaxis]
    weight = np.exp(-0.5 * (misfit - misfit.min()))
    return width, weight / weight.sum()


def shape_misfits(costs: FloatArray) -> FloatArray:
    """Return the misfits of shapes, (2,): satellites tell of them what they agree about.

    Satellites of which some are better with one shape and some with the other tell little, however
    large the sum of squares is that they differ by: something else is wrong with them. The
    probability of a shape is the mean over all sums that as many such satellites might have given
    (Yao et al. 2018, Bayesian Analysis 13:917, pseudo-BMA+).

    Parameters
    ----------
    costs : ndarray, shape (2, m)
        Sums of squares over sigmas of m satellites for each shape.
    """
    difference = costs[1] - costs[0]
    count = len(difference)
    scatter = math.sqrt(count * float(np.var(difference, ddof=1))) if count > 1 else 0.0
    sums = float(difference.sum()) + scatter * _QUANTILES
    line = float(np.mean(special.expit(0.5 * sums)))
    return -2.0 * np.log(np.maximum([line, 1.0 - line], _LEAST_PROBABILITY))


def wall_integrals(shape: int, depth: FloatArray, width: float) -> tuple[FloatArray, FloatArray]:
    """Return the integrals of a wall, and of the wall times the depth, up to a depth.

    Parameters
    ----------
    shape : int
        Index in `WALL_SHAPES`.
    depth : ndarray
        Distance from the middle to the dense side.
    width : float
        In the unit of the depth.
    """
    if shape:
        sigma = _DEVIATION * width
        place = depth / sigma
        part = special.ndtr(place)
        slope = sigma * np.exp(-0.5 * place**2) / math.sqrt(2.0 * math.pi)
        return depth * part + slope, 0.5 * ((depth**2 - sigma**2) * part + depth * slope)
    half = 0.5 * width
    within, beyond = np.clip(depth, -half, half), np.maximum(depth, half)
    constant = (within + half) ** 2 / (4.0 * half) + (beyond - half)
    # The integrals of x (x + half) / (2 half) up to the inner side, and of x from there.
    linear = (within**3 / 3.0 + half * within**2 / 2.0) / (2.0 * half) - half**2 / 12.0
    linear += 0.5 * (beyond**2 - half**2)
    return constant, linear
