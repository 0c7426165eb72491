"""Noise of the contents of arcs: white, and slow as multipath and small structures are.

What a profile and its horizontal gradients do not explain of the contents is no white noise: the
phases of an arc have noise of their own, multipath that lasts for minutes, and waves of the
ionosphere that are too short for gradients. Slow errors shift an arc by nearly as much as they are,
while white noise averages out, and a correlation of neighbouring samples does not tell how much of
the noise is slow. The model of an arc is

    y_k = h_k s_k + e_k,    h_k = slow * (slant over vertical content) ** power,

with white e_k and a first-order Markov process s_k of variance one, independent from arc to arc. A
Kalman filter of s_k, with known h_k, makes samples independent of each other (`Whitening`), and
tells how likely the residuals are. The four parameters are the most likely ones (`estimate_noise`).

References
----------
Harvey and Phillips (1979), Biometrika 66, 49 (likelihood and generalised least squares by a Kalman
filter); Patterson and Thompson (1971), Biometrika 58, 545 (likelihood without fitted means).
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray

__all__ = ["ArcNoise", "ArcOrder", "Whitening", "compile_kernels", "estimate_noise"]

# Candidates of the search: ratio of slow and white noise, time of the slow one, s, and the power of
# the mapping.
_RATIOS = (0.0, *np.geomspace(0.1, 20.0, 16).tolist())
_TIMES = tuple(np.geomspace(30.0, 960.0, 6).tolist())
_POWERS = (0.0, 1.0)
# What is left of a column of an arc explains nothing where the sum of its squares is less.
_PIVOT_LEAST = 1e-9
# Limits of a product of variances, far from those of numbers.
_PRODUCT_LEAST, _PRODUCT_MOST = 1e-100, 1e100
# Sigma of the white noise at least, TECU.
_WHITE_LEAST = 0.005


class ArcNoise(NamedTuple):
    """Noise of contents.

    Attributes
    ----------
    white : float
        Sigma of what is independent from sample to sample, TECU.
    slow : float
        Sigma of the slow noise of a vertical ray, TECU.
    time : float
        Time after which the slow noise is correlated by 1/e, s.
    power : float
        Power of slant over vertical content that the slow noise of a ray grows with.
    """

    white: float
    slow: float
    time: float
    power: float


class ArcOrder(NamedTuple):
    """The order in which samples are filtered: arc by arc, by time.

    Attributes
    ----------
    rows : ndarray of int, shape (n,)
        Samples in that order.
    step : ndarray, shape (n,)
        Time since the sample before, s; infinite for the first one of an arc.
    mapping : ndarray, shape (n,)
        Slant over vertical content.
    """

    rows: npt.NDArray[np.intp]
    step: FloatArray
    mapping: FloatArray

    @classmethod
    def of(cls, arc: npt.NDArray[np.integer], time: FloatArray, mapping: FloatArray) -> ArcOrder:
        """Return the order of samples with numbers of arcs, times (s) and mappings, all (n,)."""
        rows = np.lexsort((time, arc))
        is_first = np.diff(arc[rows], prepend=-1) != 0
        step = np.where(is_first, np.inf, np.diff(time[rows], prepend=0.0))
        return cls(rows, step, mapping[rows])


class Whitening(NamedTuple):
    """The filter that makes samples with a noise independent of each other, of variance one.

    Attributes
    ----------
    rows : ndarray of int, shape (n,)
        Samples in the order in which they are filtered.
    gain, decay, scale, response : ndarray, shape (n,)
        Gains and decays of the filter, one over the sigmas of innovations, and h.
    """

    rows: npt.NDArray[np.intp]
    gain: FloatArray
    decay: FloatArray
    scale: FloatArray
    response: FloatArray

    @classmethod
    def of(cls, order: ArcOrder, noise: ArcNoise, weight: FloatArray) -> Whitening:
        """Return the filter of samples.

        Parameters
        ----------
        order : ArcOrder
        noise : ArcNoise
        weight : ndarray, shape (n,)
            By how much the white noise of a sample counts less: its variance is divided by it.
        """
        response = noise.slow * order.mapping**noise.power
        decay = np.exp(-order.step / noise.time)
        gain, scale = _gains(response, decay, noise.white**2 / weight[order.rows])
        return cls(order.rows, gain, decay, scale, response)

    def whiten(self, columns: FloatArray) -> FloatArray:
        """Return columns (n, m) of samples as those of independent samples, (n, m)."""
        innovations: FloatArray = _innovations(
            columns, self.rows, self.gain, self.decay, self.scale, self.response
        )
        return innovations


def estimate_noise(
    residual: FloatArray, order: ArcOrder, weight: FloatArray, near: ArcNoise | None = None
) -> ArcNoise:
    """Return the noise for which the residuals of all arcs are most likely.

    Parameters
    ----------
    residual : ndarray, shape (n,)
        TECU. A level of each arc and a part of its content were fitted: what of the residuals is a
        constant or proportional to the mapping says nothing.
    order : ArcOrder
    weight : ndarray, shape (n,)
        As in `Whitening.of`.
    near : ArcNoise, optional
        The noise of nearly the same residuals, around which is searched; by default everywhere.
    """
    ordered, variance = residual[order.rows], 1.0 / weight[order.rows]
    mappings = [order.mapping**power for power in _POWERS]
    decays = [np.exp(-order.step / time) for time in _TIMES]
    known: dict[tuple[int, int, int], tuple[float, float]] = {}

    def likelihood(power: int, time: int, ratio: int) -> float:
        if (power, time, ratio) not in known:
            known[power, time, ratio] = _likelihood(
                ordered,
                order.mapping,
                _RATIOS[ratio] * mappings[power],
                decays[time],
                variance,
            )
        return known[power, time, ratio][0]

    sizes = len(_POWERS), len(_TIMES), len(_RATIOS)
    if near is None:
        best = max(np.ndindex(sizes), key=lambda point: likelihood(*point))
    else:
        best = (
            _POWERS.index(near.power),
            int(np.argmin(np.abs(np.log(_TIMES) - math.log(near.time)))),
            int(np.argmin(np.abs(np.array(_RATIOS) - near.slow / near.white))),
        )
        while True:
            around = [range(max(k - 1, 0), min(k + 2, n)) for k, n in zip(best, sizes, strict=True)]
            better = max(itertools.product(*around), key=lambda point: likelihood(*point))
            if likelihood(*better) <= likelihood(*best):
                break
            best = better
    power, time, ratio = best
    white = max(math.sqrt(known[power, time, ratio][1]), _WHITE_LEAST)
    return ArcNoise(white, _RATIOS[ratio] * white, _TIMES[time], _POWERS[power])


@compiled
def _gains(response, decay, variance):  # type: ignore[no-untyped-def]
    """Return gains and one over the sigmas of innovations, (n,) each.

    `variance` is that of the white noise; `decay` is zero for the first sample of an arc.
    """
    gain, scale = np.empty(len(response)), np.empty(len(response))
    spread = 1.0
    for row in range(len(response)):
        spread = 1.0 - decay[row] * decay[row] * (1.0 - spread)
        of_innovation = response[row] * response[row] * spread + variance[row]
        gain[row] = spread * response[row] / of_innovation
        scale[row] = 1.0 / np.sqrt(of_innovation)
        spread *= 1.0 - gain[row] * response[row]
    return gain, scale


@compiled
def _innovations(columns, rows, gain, decay, scale, response):  # type: ignore[no-untyped-def]
    """Return normalised innovations of columns (n, m) whose rows are filtered in an order.

    `rows` (n,) is that order, and the order of the rest: see `_gains`.
    """
    count, width = columns.shape
    result = np.empty((count, width))
    state = np.zeros(width)
    for number in range(count):
        row = rows[number]
        for column in range(width):
            expected = decay[number] * state[column]
            innovation = columns[row, column] - response[number] * expected
            result[row, column] = scale[number] * innovation
            state[column] = expected + gain[number] * innovation
    return result


@compiled
def _likelihood(residual, mapping, response, decay, variance):  # type: ignore[no-untyped-def]
    """Return the logarithm of the restricted likelihood less a constant, and the white variance.

    `response` and `variance` (n,) are relative to the white noise, whose variance is the most
    likely one. A constant and a multiple of `mapping` are left out of each arc.
    """
    # The states of the filters of the constant, of the mapping and of the residual.
    state_one, state_mapping, state_residual = 0.0, 0.0, 0.0
    # Sums of products of their innovations.
    one_one, one_mapping, one_residual = 0.0, 0.0, 0.0
    mapping_mapping, mapping_residual, residual_residual = 0.0, 0.0, 0.0
    # The logarithm of a product of many variances costs as much as that of one.
    spread, logarithm, product, total = 1.0, 0.0, 1.0, 0.0
    degrees = 0
    count = len(residual)
    for row in range(count + 1):
        if row == count or decay[row] == 0.0:
            # An arc has ended: what its constant and its mapping explain is taken off.
            if one_one > _PIVOT_LEAST:
                factor = one_mapping / one_one
                mapping_mapping -= factor * one_mapping
                mapping_residual -= factor * one_residual
                residual_residual -= one_residual / one_one * one_residual
                logarithm += np.log(one_one)
                degrees -= 1
            if mapping_mapping > _PIVOT_LEAST:
                residual_residual -= mapping_residual / mapping_mapping * mapping_residual
                logarithm += np.log(mapping_mapping)
                degrees -= 1
            total += max(residual_residual, 0.0)
            state_one, state_mapping, state_residual = 0.0, 0.0, 0.0
            one_one, one_mapping, one_residual = 0.0, 0.0, 0.0
            mapping_mapping, mapping_residual, residual_residual = 0.0, 0.0, 0.0
        if row == count:
            break
        spread = 1.0 - decay[row] * decay[row] * (1.0 - spread)
        of_innovation = response[row] * response[row] * spread + variance[row]
        per_variance = 1.0 / of_innovation
        gain = spread * response[row] * per_variance
        one_expected = decay[row] * state_one
        mapping_expected = decay[row] * state_mapping
        residual_expected = decay[row] * state_residual
        of_one = 1.0 - response[row] * one_expected
        of_mapping = mapping[row] - response[row] * mapping_expected
        of_residual = residual[row] - response[row] * residual_expected
        state_one = one_expected + gain * of_one
        state_mapping = mapping_expected + gain * of_mapping
        state_residual = residual_expected + gain * of_residual
        one, other, last = (
            of_one * per_variance,
            of_mapping * per_variance,
            of_residual * per_variance,
        )
        one_one += one * of_one
        one_mapping += one * of_mapping
        one_residual += one * of_residual
        mapping_mapping += other * of_mapping
        mapping_residual += other * of_residual
        residual_residual += last * of_residual
        spread *= 1.0 - gain * response[row]
        product *= of_innovation
        if not _PRODUCT_LEAST < product < _PRODUCT_MOST:
            logarithm += np.log(product)
            product = 1.0
        degrees += 1
    logarithm += np.log(product)
    degrees = max(degrees, 1)
    white = max(total / degrees, 1e-12)
    return -0.5 * (logarithm + degrees * np.log(white)), white


def compile_kernels() -> None:
    """Compile the filter, which takes a second without a cache."""
    order = ArcOrder.of(np.zeros(1, dtype=np.int64), np.zeros(1), np.ones(1))
    noise = estimate_noise(np.zeros(1), order, np.ones(1))
    Whitening.of(order, noise, np.ones(1)).whiten(np.zeros((1, 1)))
