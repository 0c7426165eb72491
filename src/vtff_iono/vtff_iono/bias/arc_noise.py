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

__all__ = ["ArcNoise", "ArcOrder", "Whitening", "estimate_noise"]

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

    def find_best(powers: range, times: range, ratios: range) -> tuple[int, int, int]:
        """Return the most likely one of candidates."""
        for power, time in itertools.product(powers, times):
            new = [ratio for ratio in ratios if (power, time, ratio) not in known]
            if not new:
                continue
            found = _likelihoods(
                ordered,
                order.mapping,
                mappings[power],
                np.array([_RATIOS[ratio] for ratio in new]),
                decays[time],
                variance,
            )
            for ratio, *of_ratio in zip(new, *found.tolist(), strict=True):
                known[power, time, ratio] = of_ratio[0], of_ratio[1]
        candidates = itertools.product(powers, times, ratios)
        return max(candidates, key=lambda candidate: known[candidate][0])

    sizes = len(_POWERS), len(_TIMES), len(_RATIOS)
    if near is None:
        best = find_best(*map(range, sizes))
    else:
        best = (
            _POWERS.index(near.power),
            int(np.argmin(np.abs(np.log(_TIMES) - math.log(near.time)))),
            int(np.argmin(np.abs(np.array(_RATIOS) - near.slow / near.white))),
        )
        while True:
            around = [range(max(k - 1, 0), min(k + 2, n)) for k, n in zip(best, sizes, strict=True)]
            better = find_best(*around)
            if known[better][0] <= known[best][0]:
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
        # Numbers of their own: so the compiler knows that writing a result does not change them.
        kept, learned = decay[number], gain[number]
        size, factor = scale[number], response[number]
        for column in range(width):
            expected = kept * state[column]
            innovation = columns[row, column] - factor * expected
            result[row, column] = size * innovation
            state[column] = expected + learned * innovation
    return result


@compiled
def _likelihoods(residual, mapping, vertical, ratios, decay, variance):  # type: ignore[no-untyped-def]
    """Return logarithms of restricted likelihoods less a constant, and the white variances, (2, r).

    They are those of r ratios of slow and white noise (`ratios`), whose white variances are the
    most likely ones: the steps of one ratio wait for each other, those of several do not. The
    response of the samples to the slow noise is a ratio times `vertical` (n,), `variance` (n,) is
    relative to that of the white noise. A constant and a multiple of `mapping` are left out of each
    arc.
    """
    count, number = len(residual), len(ratios)
    # The states of the filters of the constant, of the mapping and of the residual.
    states = np.zeros((number, 3))
    # Sums of products of their innovations: of the constant with itself, the mapping and the
    # residual, of the mapping with itself and the residual, and of the residual with itself.
    sums = np.zeros((number, 6))
    # The logarithm of a product of many variances costs as much as that of one.
    spreads, products = np.ones(number), np.ones(number)
    logarithms, totals = np.zeros(number), np.zeros(number)
    degrees = np.zeros(number, dtype=np.int64)
    for row in range(count + 1):
        if row == count or decay[row] == 0.0:
            # An arc has ended: what its constant and its mapping explain is taken off.
            for k in range(number):
                one_one, one_mapping, one_residual = sums[k, 0], sums[k, 1], sums[k, 2]
                mapping_mapping, mapping_residual = sums[k, 3], sums[k, 4]
                residual_residual = sums[k, 5]
                if one_one > _PIVOT_LEAST:
                    factor = one_mapping / one_one
                    mapping_mapping -= factor * one_mapping
                    mapping_residual -= factor * one_residual
                    residual_residual -= one_residual / one_one * one_residual
                    logarithms[k] += np.log(one_one)
                    degrees[k] -= 1
                if mapping_mapping > _PIVOT_LEAST:
                    residual_residual -= mapping_residual / mapping_mapping * mapping_residual
                    logarithms[k] += np.log(mapping_mapping)
                    degrees[k] -= 1
                totals[k] += max(residual_residual, 0.0)
            states[:] = 0.0
            sums[:] = 0.0
        if row == count:
            break
        of_decay, of_mapping, of_residual = decay[row], mapping[row], residual[row]
        white, of_vertical = variance[row], vertical[row]
        for k in range(number):
            response = ratios[k] * of_vertical
            spread = 1.0 - of_decay * of_decay * (1.0 - spreads[k])
            of_innovation = response * response * spread + white
            per_variance = 1.0 / of_innovation
            gain = spread * response * per_variance
            one_expected = of_decay * states[k, 0]
            mapping_expected = of_decay * states[k, 1]
            residual_expected = of_decay * states[k, 2]
            one = 1.0 - response * one_expected
            other = of_mapping - response * mapping_expected
            last = of_residual - response * residual_expected
            states[k, 0] = one_expected + gain * one
            states[k, 1] = mapping_expected + gain * other
            states[k, 2] = residual_expected + gain * last
            one_scaled, other_scaled = one * per_variance, other * per_variance
            sums[k, 0] += one_scaled * one
            sums[k, 1] += one_scaled * other
            sums[k, 2] += one_scaled * last
            sums[k, 3] += other_scaled * other
            sums[k, 4] += other_scaled * last
            sums[k, 5] += last * per_variance * last
            spreads[k] = spread * (1.0 - gain * response)
            products[k] *= of_innovation
            if not _PRODUCT_LEAST < products[k] < _PRODUCT_MOST:
                logarithms[k] += np.log(products[k])
                products[k] = 1.0
            degrees[k] += 1
    result = np.empty((2, number))
    for k in range(number):
        freedom = max(degrees[k], 1)
        result[1, k] = max(totals[k] / freedom, 1e-12)
        logarithm = logarithms[k] + np.log(products[k])
        result[0, k] = -0.5 * (logarithm + freedom * np.log(result[1, k]))
    return result
