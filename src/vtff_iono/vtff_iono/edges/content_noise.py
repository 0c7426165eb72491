"""Noise of the contents of a satellite about an edge, and the whitening of contents by it.

Besides white noise, which scintillation and the receivers make, contents have slow parts: the
content above the edge while the elevation changes, gradients, multipath. A constant of each arc and
a parabola in time are unknown altogether. What is slower than noise is known in size only: the
coefficients of the Legendre polynomials of degree 3 and more have variances that fall with a power
of the degree, as those of a random walk (degree^-2), of its integral (degree^-4) and of smoother
functions do. Size and power are those under which the coefficients that were measured are most
likely (Rasmussen and Williams 2006, Gaussian Processes for Machine Learning, section 5.4.1). How
far a wide wall may be feigned by what is slow is thereby in its sigmas, and thin walls lose little.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray

__all__ = [
    "MOST_MODES",
    "ContentNoise",
    "SlowBasis",
    "first_noise",
    "mode_variances",
    "noise_of_residuals",
    "side_sigmas",
    "slow_basis",
    "white_sigma",
]

# Degree of the polynomial in time whose coefficients are unknown altogether.
_DEGREE = 2
# s and degrees: so long a part of the window is one more degree, up to the highest.
_TIME_OF_DEGREE, _HIGHEST_DEGREE = 12.0, 10
MOST_MODES = _HIGHEST_DEGREE - _DEGREE
"""Number of columns of variances by degree."""

# Powers of the degree, and sizes as parts of the white variance; the likeliest are taken.
_POWERS = np.array([2.0, 4.0, 6.0, 8.0, 12.0])
_SIZES = np.concatenate(([0.0], np.logspace(-2.0, 5.0, 29)))
# Number of coefficients of a satellite for which the scatter of all of them stands.
_OF_ALL = 4.0
# Independent means on each side of a wall from which its noise is known.
_LEAST_FREEDOM = 8.0
# TECU^2; smallest variance of a sample.
_LEAST_VARIANCE = 1e-12


@dataclass(frozen=True, eq=False)
class SlowBasis:
    """Functions of time that stand for what is slow, orthonormal where noise is even.

    Parameters
    ----------
    functions : ndarray, shape (k, p)
        Constants of the arcs and polynomials, by their degree.
    relative : ndarray, shape (2, k)
        Size of the white noise of the rows at each sample, as a part of their sigmas.
    columns : ndarray, shape (2, k, p)
        The functions over that size, orthonormal.
    unknown : int
        How many of them, the first, have coefficients of any size.
    """

    functions: FloatArray
    relative: FloatArray
    columns: FloatArray
    unknown: int

    @property
    def unknown_columns(self) -> FloatArray:
        """Columns whose coefficients are of any size, shape (2, k, unknown)."""
        return self.columns[:, :, : self.unknown]

    def with_noise(self, relative: FloatArray) -> SlowBasis:
        """Return the basis where the noise is of another size, shape (2, k)."""
        columns = np.linalg.qr(self.functions / relative[:, :, np.newaxis])[0]
        return SlowBasis(self.functions, relative, columns, self.unknown)

    def remove(self, rows: FloatArray) -> FloatArray:
        """Return rows, shape (2, k), in parts of their noise and less all that is slow."""
        scaled = rows / self.relative
        return np.asarray(scaled - _combined(self.columns, _coefficients(self.columns, scaled)))

    def whitening(self, sigma: FloatArray, variances: FloatArray) -> PairWhitening:
        """Return what makes rows whose noise has the covariance of one.

        Parameters
        ----------
        sigma : ndarray, shape (2,)
            White noise of the rows, where its relative size is one.
        variances : ndarray, shape (2, MOST_MODES)
            Variances of the coefficients of degree 3 and more, TECU^2.
        """
        part = np.ones((2, self.functions.shape[1]))
        modes = part.shape[1] - self.unknown
        ratio = variances[:, :modes] / sigma[:, np.newaxis] ** 2
        part[:, self.unknown :] -= 1.0 / np.sqrt(1.0 + ratio)
        return PairWhitening(self.columns, self.relative * sigma[:, np.newaxis], part)

    def modes(self, rows: FloatArray) -> FloatArray:
        """Return coefficients of degree 3 and more, shape (2, MOST_MODES); NaN without one."""
        result = np.full((len(rows), MOST_MODES), np.nan)
        found = _coefficients(self.columns[:, :, self.unknown :], rows / self.relative)
        result[:, : found.shape[1]] = found
        return result


@dataclass(frozen=True, eq=False)
class PairWhitening:
    """Makes pairs of rows whose noise has the covariance of one.

    Parameters
    ----------
    columns : ndarray, shape (2, k, p)
        As in `SlowBasis`.
    scale : ndarray, shape (2, k)
        Sigmas of the white noise.
    part : ndarray, shape (2, p)
        Part of what rows have of each column that is removed.
    """

    columns: FloatArray
    scale: FloatArray
    part: FloatArray

    def apply(self, rows: FloatArray) -> FloatArray:
        """Return rows, shape (..., 2, k), in units of their noise."""
        scaled = rows / self.scale
        scaled -= _combined(self.columns, _coefficients(self.columns, scaled) * self.part)
        return scaled


def slow_basis(
    time_from_middle: FloatArray, half_window: float, arc: npt.NDArray[np.integer]
) -> SlowBasis:
    """Return the functions of k samples with even noise.

    Parameters
    ----------
    time_from_middle : ndarray, shape (k,)
        s.
    half_window : float
        Time of the first and last sample that there may be, from the middle, s.
    arc : ndarray of int, shape (k,)
        Number of the arc of each sample, from 0.
    """
    degree = round(2.0 * half_window / _TIME_OF_DEGREE)
    degree = min(max(degree, _DEGREE), _HIGHEST_DEGREE)
    constants = np.eye(arc.max() + 1)[arc]
    powers = np.polynomial.legendre.legvander(time_from_middle / half_window, degree)[:, 1:]
    columns, _ = np.linalg.qr(np.column_stack((constants, powers)))
    even = np.ones((2, len(arc)))
    return SlowBasis(
        columns, even, np.broadcast_to(columns, (2, *columns.shape)), constants.shape[1] + _DEGREE
    )


def _coefficients(columns: FloatArray, rows: FloatArray) -> FloatArray:
    """Return what rows, shape (..., 2, k), have of columns, shape (2, k, p): (..., 2, p)."""
    return np.asarray(np.matmul(rows[..., np.newaxis, :], columns)[..., 0, :])


def _combined(columns: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Return the sums of columns, (2, k, p), with coefficients, (..., 2, p): (..., 2, k)."""
    return np.asarray(np.matmul(columns, coefficients[..., np.newaxis])[..., 0])


def white_sigma(rows: FloatArray, samples: tuple[int, ...], removed: FloatArray) -> FloatArray:
    """Return the sigma, (2,), of white noise that is as dense as rows are at low frequencies.

    Parameters
    ----------
    rows : ndarray, shape (2, k)
        Residuals.
    samples : tuple of int
        Numbers of samples whose means are taken.
    removed : ndarray, shape (2, k, p)
        Orthonormal functions that were removed.
    """
    variances = [np.mean(np.diff(rows) ** 2, axis=1) / 2.0, np.full(2, _LEAST_VARIANCE)]
    for in_mean in samples:
        squares, freedom = _density(rows, in_mean, removed)
        variances.append(squares / np.maximum(freedom, 1.0))
    return np.asarray(np.sqrt(np.max(variances, axis=0)))


def side_sigmas(
    rows: Sequence[FloatArray],
    bases: Sequence[SlowBasis],
    samples: int,
    inside: Sequence[FloatArray],
) -> FloatArray:
    """Return how large white noise is outside and inside of a wall: rows of shape (2, 2).

    Scintillation is on one side of the wall, and breaks arcs there. It is taken as that of all
    satellites together: of one with short arcs little can be seen.

    Parameters
    ----------
    rows : sequence of ndarray, shape (2, k)
        Residuals of each satellite after `SlowBasis.remove`, in units of its sigma.
    bases : sequence of SlowBasis
    samples : int
        Number of samples whose means are taken.
    inside : sequence of ndarray, shape (k,)
        Which part of the wall a sample is inside of: 0 to 1.
    """
    result = np.ones((2, 2))
    for side in range(2):
        squares, freedom, fast, number = np.zeros(2), np.zeros(2), np.zeros(2), 0
        for of_satellite, basis, part in zip(rows, bases, inside, strict=True):
            there = part == float(side)
            if np.count_nonzero(there) < samples:
                continue
            size = basis.relative[:, there].mean(axis=1) ** 2
            found = _density(of_satellite[:, there], samples, basis.columns[:, there])
            squares += found[0] * size
            freedom += found[1]
            changes = np.diff(of_satellite[:, there])
            fast += np.sum(changes**2, axis=1) / 2.0 * size
            number += changes.shape[1]
        if not freedom.min(initial=math.inf) >= _LEAST_FREEDOM:
            return np.ones((2, 2))
        result[side] = np.maximum(squares / freedom, fast / number)
    return np.asarray(np.sqrt(result))


def _density(rows: FloatArray, samples: int, removed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return sums of squares of means, as white noise of a sample has them, and their freedom.

    Both have the shape (2,). Orthonormal functions that were removed take a part of these means
    away; short arcs take little of long ones.
    """
    whole = rows.shape[1] // samples
    means = rows[:, : whole * samples].reshape(2, whole, samples).mean(axis=2)
    of_removed = removed[:, : whole * samples].reshape(2, whole, samples, -1).mean(axis=2)
    freedom = whole - samples * np.sum(of_removed**2, axis=(1, 2))
    return np.sum(means**2, axis=1) * samples, freedom


def mode_variances(coefficients: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return the likeliest variances of coefficients by degree, shape (m, 2, MOST_MODES), TECU^2.

    They are those of all satellites together, and larger for a satellite whose coefficients are.

    Parameters
    ----------
    coefficients : ndarray, shape (m, 2, MOST_MODES)
        Coefficients of the residuals of m satellites, TECU; NaN where there is none.
    sigma : ndarray, shape (m, 2)
        White noise, TECU.
    """
    degree = np.arange(MOST_MODES) + _DEGREE + 1.0
    powers = (degree[0] / degree) ** _POWERS[:, np.newaxis]
    result = np.zeros(coefficients.shape)
    for column in range(2):
        white = sigma[:, column, np.newaxis] ** 2
        shapes = np.median(white) * (_SIZES[:, np.newaxis, np.newaxis] * powers)
        shapes = shapes.reshape(-1, 1, MOST_MODES)
        square = coefficients[:, column] ** 2
        cost = np.log(white + shapes) + square / (white + shapes)
        of_all = white + shapes[int(np.argmin(np.nansum(cost, axis=(1, 2))))]
        # Each scatters by itself as if that were known from so many coefficients.
        ratio = square / of_all
        known = np.count_nonzero(np.isfinite(ratio), axis=1)
        own = (_OF_ALL + np.nansum(ratio, axis=1)) / (_OF_ALL + known)
        result[:, column] = of_all * np.maximum(own, 1.0)[:, np.newaxis] - white
    return result


@dataclass(frozen=True, eq=False)
class ContentNoise:
    """Noise of D and M of m satellites.

    Parameters
    ----------
    slow : list of SlowBasis
        Constants of the arcs and polynomials, with the relative size of white noise.
    white : ndarray, shape (m, 2)
        Sigmas of white noise, TECU.
    modes : ndarray, shape (m, 2, MOST_MODES)
        Variances of polynomials by degree, TECU^2.
    """

    slow: list[SlowBasis]
    white: FloatArray
    modes: FloatArray

    @staticmethod
    def only_white(slow: list[SlowBasis], white: FloatArray) -> ContentNoise:
        """Return noise without slow parts."""
        return ContentNoise(slow, white, np.zeros((*white.shape, MOST_MODES)))

    @functools.cached_property
    def whitenings(self) -> list[PairWhitening]:
        """What makes D and M of each satellite such that their noise has the covariance of one."""
        return [
            slow.whitening(white, modes)
            for slow, white, modes in zip(self.slow, self.white, self.modes, strict=True)
        ]

    def whiten(self, pairs: Iterable[FloatArray]) -> FloatArray:
        """Return D and M of all satellites, each of shape (..., 2, k), in units of noise.

        The result has the shape (m, ...): the numbers of all satellites one after the other.
        """
        whitened = [
            whitening.apply(pair) for whitening, pair in zip(self.whitenings, pairs, strict=True)
        ]
        before = whitened[0].shape[:-2]
        result = np.empty((sum(rows.shape[-1] for rows in whitened) * 2, *before))
        begin = 0
        for rows in whitened:
            end = begin + 2 * rows.shape[-1]
            result[begin:end] = np.moveaxis(rows.reshape(*before, end - begin), -1, 0)
            begin = end
        return result


def first_noise(
    slow: list[SlowBasis], errors: list[FloatArray], samples: tuple[int, ...]
) -> ContentNoise:
    """Return the noise that residuals show, all of it as if it were white.

    Residuals of a wall that is not yet in its place are no measure of what is slow.

    Parameters
    ----------
    slow : list of SlowBasis
        Slow functions of m satellites.
    errors : list of ndarray, shape (2, k)
        Residuals of D and M of each satellite, TECU.
    samples : tuple of int
        Numbers of samples whose means are taken.
    """
    one, none = np.ones(2), np.zeros((2, MOST_MODES))
    white = [
        white_sigma(basis.whitening(one, none).apply(error), samples, basis.unknown_columns)
        for basis, error in zip(slow, errors, strict=True)
    ]
    return ContentNoise.only_white(slow, np.array(white))


def noise_of_residuals(
    before: ContentNoise, errors: list[FloatArray], inside: list[FloatArray] | None, samples: int
) -> ContentNoise:
    """Return the noise that residuals show, even or on either side of a wall, and what is slow.

    Parameters
    ----------
    before : ContentNoise
        Noise of nearly the same residuals.
    errors : list of ndarray, shape (2, k)
        Residuals of D and M of each satellite, TECU.
    inside : list of ndarray, shape (k,), or None
        As in `side_sigmas`; None for noise that is even in time.
    samples : int
        Number of samples whose means are taken.
    """
    bases = before.slow
    if inside is not None:
        rows = [
            basis.remove(error) / sigma[:, np.newaxis]
            for basis, error, sigma in zip(bases, errors, before.white, strict=True)
        ]
        outer, inner = side_sigmas(rows, bases, samples, inside)[:, :, np.newaxis] ** 2
        # The geometric mean of the sigmas of both sides is one.
        middle = np.sqrt(outer * inner)
        bases = [
            basis.with_noise(np.sqrt((outer + (inner - outer) * part) / middle))
            for basis, part in zip(bases, inside, strict=True)
        ]
    of_satellites = list(zip(bases, errors, strict=True))
    white = [
        white_sigma(basis.remove(error), (samples,), basis.columns)
        for basis, error in of_satellites
    ]
    modes = [basis.modes(error) for basis, error in of_satellites]
    sigma = np.array(white)
    return ContentNoise(bases, sigma, mode_variances(np.array(modes), sigma))
