"""How much the contents of satellites fluctuate, compiled: what samples and changes show of it.

A second alone may be quiet by chance, so that the seconds before it count too. Of fades that last
half a second a third of the variance shows as scatter, the rest is in the mean of the second.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray
from vtff_iono.density.phase_differences import (
    DEVIATION,
    DEVIATION_SQUARED,
    GEOMETRIC,
    STEC,
    STEP_SQUARED,
)

__all__ = [
    "FEWEST_WITNESSES",
    "LARGE_SCATTER",
    "FluctuationTable",
    "LastErrors",
    "add_changes",
    "empty_fluctuations",
    "empty_last_errors",
    "mean_over_scatter",
    "measure_fades",
    "raise_doubted",
    "weigh_contents",
]

LARGE_SCATTER = 2.0
"""A scatter that exceeds the variance of the noise by this factor is scintillation."""

FEWEST_WITNESSES = 2
"""Fewest links with integers whose density is believed where integers of others are looked for: one
may have slipped unseen."""

# Variance of the mean of a second over the scatter within it: of faster fades little is in the
# mean. It is measured by the changes from second to second; at first it is that of fades of half a
# second, which counts as so many seconds of satellites.
_FIRST_MEAN_OVER_SCATTER, _FIRST_WEIGHT = 2.0, 20.0
_SMALLEST_RATIO, _LARGEST_RATIO = 0.05, 10.0
# A change counts at most as this many times its expected variance: a wrong integer is no fade.
_LARGEST_CHANGE = 16.0
# The same for a change from one second to the next, which has a single degree of freedom.
_LARGE_CHANGE = 9.0
_SCATTER_MEMORY = 15.0  # seconds
# Fluctuations have ended when in so many seconds the fluctuation of so many satellite-seconds or
# more is below the remembered one by more than this factor: one fade ends by chance, not all.
_SECONDS_OF_END, _FEWEST_OF_END, _MARGIN_OF_END = 3, 9, 4.0
_SATELLITES = 5.0  # that fluctuate at once, as a rule
# Numbers of satellites are less than this.
_NUMBERS = 256
_OF_MEANS, _OF_SCATTER = 0, 1


class FluctuationTable(NamedTuple):
    """Fluctuations that the seconds so far have shown, by number of the satellite; NaN for none.

    Attributes
    ----------
    excess : ndarray, shape (256,)
        Variance that scintillation adds to the samples of each satellite, TECU^2.
    recent : ndarray, shape (3, 256)
        That variance from each of the last seconds alone, the last second last.
    seconds : ndarray of int64, shape (1,)
        Number of these seconds.
    sums : ndarray, shape (2,)
        Variances of means, and scatters, whose ratio says how long fades last: sums of late.
    last_fixed : ndarray, shape (256,)
        Content of each satellite with integers less the predicted one a second ago, TECU.
    """

    excess: FloatArray
    recent: FloatArray
    seconds: npt.NDArray[np.int64]
    sums: FloatArray
    last_fixed: FloatArray


class LastErrors(NamedTuple):
    """Contents of links less the predicted ones of a second, shape (n,).

    Attributes
    ----------
    number : ndarray of int64, shape (n,)
        Stretches of the links.
    integers : ndarray, shape (n, 2)
        Their integers, cycles; NaN for those that are not known.
    error : ndarray, shape (n,)
        TECU.
    """

    number: npt.NDArray[np.int64]
    integers: FloatArray
    error: FloatArray


def empty_fluctuations() -> FluctuationTable:
    """Return a table of no second."""
    return FluctuationTable(
        np.full(_NUMBERS, math.nan),
        np.full((_SECONDS_OF_END, _NUMBERS), math.nan),
        np.zeros(1, dtype=np.int64),
        np.array([_FIRST_MEAN_OVER_SCATTER * _FIRST_WEIGHT, _FIRST_WEIGHT]),
        np.full(_NUMBERS, math.nan),
    )


def empty_last_errors() -> LastErrors:
    """Return the errors of no link."""
    return LastErrors(np.zeros(0, dtype=np.int64), np.zeros((0, 2)), np.zeros(0))


@compiled
def mean_over_scatter(table):  # type: ignore[no-untyped-def]
    """Return the variance of the mean of a second over the scatter within it."""
    ratio = table.sums[_OF_MEANS] / max(table.sums[_OF_SCATTER], 1e-12)
    return min(max(ratio, _SMALLEST_RATIO), _LARGEST_RATIO)


@compiled
def _fluctuation_left(table):  # type: ignore[no-untyped-def]
    """Return the part of the remembered fluctuation that there may still be."""
    count, parts = 0, np.empty(_SECONDS_OF_END * _NUMBERS)
    for second in range(_SECONDS_OF_END):
        for prn in range(_NUMBERS):
            value = table.recent[second, prn]
            if not math.isnan(value) and table.excess[prn] > 0.0:
                parts[count] = value / table.excess[prn]
                count += 1
    if count < _FEWEST_OF_END or table.seconds[0] < _SECONDS_OF_END:
        return 1.0
    return min(1.0, _MARGIN_OF_END * (np.sum(parts[:count]) / count))


@compiled
def weigh_contents(table, prn, samples, columns, least_noise):  # type: ignore[no-untyped-def]
    """Return the sigma of mean contents: white noise, and what scintillation adds to it.

    Both are measured: the changes from sample to sample show the white noise (von Neumann 1941),
    the rest of the scatter is a slow fluctuation.

    Parameters
    ----------
    table : FluctuationTable
        The second is added to it.
    prn, samples : ndarray of int64, shape (n,)
        Satellite and number of samples of each link.
    columns : ndarray, shape (8, n)
        Means of the columns of `phase_differences`.
    least_noise : float
        Smallest variance of the white noise of a sample, TECU^2.

    Returns
    -------
    ndarray, shape (n,)
        TECU.
    """
    count = len(prn)
    sigma, excess, white = np.empty(count), np.zeros(count), np.empty(count)
    recent = table.recent
    for second in range(_SECONDS_OF_END - 1):
        recent[second] = recent[second + 1]
    recent[_SECONDS_OF_END - 1] = math.nan
    table.seconds[0] = min(table.seconds[0] + 1, _SECONDS_OF_END)
    for row in range(count):
        white[row] = 0.5 * columns[STEP_SQUARED, row]
        if white[row] < least_noise:  # what is not known stays so
            white[row] = least_noise
        scatter = columns[DEVIATION_SQUARED, row] - columns[DEVIATION, row] ** 2
        if scatter > LARGE_SCATTER * white[row]:
            excess[row] = scatter - white[row]
        number = prn[row]
        mean = excess[row] if math.isnan(table.excess[number]) else table.excess[number]
        table.excess[number] = mean + (excess[row] - mean) / _SCATTER_MEMORY
        recent[_SECONDS_OF_END - 1, number] = excess[row]
    left, ratio = _fluctuation_left(table), mean_over_scatter(table)
    for row in range(count):
        most = max(excess[row], left * table.excess[prn[row]])
        sigma[row] = math.sqrt(white[row] / samples[row] + most * ratio)
    return sigma


@compiled
def raise_doubted(  # type: ignore[no-untyped-def]
    table, prn, has_integers, columns, sigma, cycles_per_tecu, noise_square, lasting_variance
):
    """Raise the sigmas (TECU, in place) of contents that geometry shows to fluctuate more.

    A second of samples shows little of slow fades, and the seconds before were quieter. What bends
    the phases, and with them the contents, bends their wide lanes.

    Parameters
    ----------
    table, prn, columns
        As in `weigh_contents`.
    has_integers : ndarray of bool, shape (n,)
    sigma : ndarray, shape (n,)
        Sigmas of the contents, TECU.
    cycles_per_tecu, noise_square, lasting_variance : float
        Wide lanes of a content, and what makes their variance by geometry, see
        `IntegerResolver.geometric_variance`.
    """
    rows = np.empty(len(prn), dtype=np.int64)
    count, fluctuating = 0, 0
    for row in range(len(prn)):
        shown = columns[GEOMETRIC, row] - cycles_per_tecu * columns[STEC, row]
        if has_integers[row] and math.isfinite(shown + sigma[row]):
            rows[count] = row
            count += 1
            fluctuating += table.excess[prn[row]] > 0.0
    if fluctuating == 0 or count < FEWEST_WITNESSES:
        return
    rows = rows[:count]
    values = columns[GEOMETRIC][rows] - cycles_per_tecu * columns[STEC][rows]
    weights = 1.0 / (noise_square * sigma[rows] ** 2 + lasting_variance)
    whole = np.sum(weights)
    mean = weights @ values / whole
    chosen = table.excess[prn[rows]] > 0.0
    squares = np.sum(weights[chosen] * (values[chosen] - mean) ** 2)
    # All that fluctuate do so alike. The clock has taken a part of their errors.
    expected = fluctuating - np.sum(weights[chosen]) / whole
    sigma[rows[chosen]] *= math.sqrt(max(squares / max(expected, 0.5), 1.0))


@compiled
def measure_fades(table, prn, samples, columns, errors, sigma):  # type: ignore[no-untyped-def]
    """Measure how much of the fluctuation of a second is in its mean, and how much within it.

    `errors` are contents of links with integers less the predicted ones, `sigma` their own sigmas,
    TECU; the other arguments are those of `weigh_contents`.
    """
    # Satellites in the order of their first links, each with the error of its last one.
    satellites, now = np.empty(len(prn), dtype=np.int64), np.empty(len(prn))
    count = 0
    for row in range(len(prn)):
        place = 0
        while place < count and satellites[place] != prn[row]:
            place += 1
        satellites[place], now[place] = prn[row], errors[row]
        count = max(count, place + 1)
    # All errors of a second share the density that is estimated from them.
    share = max(count - 1, 1) / max(count, 1)
    of_means, of_scatter, fading = 0.0, 0.0, 0
    for row in range(count):
        noise = 0.5 * columns[STEP_SQUARED, row]
        scatter = columns[DEVIATION_SQUARED, row] - columns[DEVIATION, row] ** 2
        change = 0.5 * (now[row] - table.last_fixed[satellites[row]]) ** 2 / share
        # Neither a satellite without an orbit nor one that is not used tells anything.
        if scatter <= LARGE_SCATTER * noise or not math.isfinite(change + sigma[row]):
            continue
        change = min(change, _LARGEST_CHANGE * sigma[row] ** 2)
        weight = 1.0 / sigma[row] ** 2
        of_means += weight * (change - noise / samples[row])
        of_scatter += weight * (scatter - noise)
        fading += 1
    table.last_fixed[:] = math.nan
    for row in range(count):
        table.last_fixed[satellites[row]] = now[row]
    if fading > 0 and of_scatter > 0.0:
        kept = math.exp(-fading / (_SCATTER_MEMORY * _SATELLITES))
        table.sums[_OF_MEANS] = kept * table.sums[_OF_MEANS] + fading * of_means / of_scatter
        table.sums[_OF_SCATTER] = kept * table.sums[_OF_SCATTER] + fading


@compiled
def add_changes(table, prn, samples, columns, last, now, least_noise):  # type: ignore[no-untyped-def]
    """Let changes from second to second count as fluctuation where they exceed the noise.

    Fades that last for seconds hardly show in the scatter of one. `last` and `now` are `LastErrors`
    of both seconds, the latter of the rows of the other arguments, see `weigh_contents`.
    """
    recent = table.recent[_SECONDS_OF_END - 1]
    for row in range(len(prn)):
        before = len(last.number) - 1
        while before >= 0 and not (
            last.number[before] == now.number[row]
            and _is_same(last.integers[before, 0], now.integers[row, 0])
            and _is_same(last.integers[before, 1], now.integers[row, 1])
        ):
            before -= 1
        if before < 0:
            continue
        noise = 0.5 * columns[STEP_SQUARED, row] / samples[row]
        change = 0.5 * (now.error[row] - last.error[before]) ** 2
        if change > _LARGE_CHANGE * max(noise, least_noise):
            number = prn[row]
            mean = table.excess[number]
            table.excess[number] = max(mean, mean + (change - mean) / _SCATTER_MEMORY)
            shown = 0.0 if math.isnan(recent[number]) else recent[number]
            recent[number] = max(shown, change)


@compiled
def _is_same(first, second):  # type: ignore[no-untyped-def]
    """Return whether two integers, cycles, are the same one, or neither is known."""
    return first == second or (math.isnan(first) and math.isnan(second))
