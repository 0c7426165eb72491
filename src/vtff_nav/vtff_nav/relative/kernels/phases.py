"""Scatter and changes of the phases of an epoch, compiled."""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND, SPEED_OF_LIGHT

__all__ = ["MEMORY_EPOCHS", "change_phases", "forget_scatter", "learn_scatter"]

#: Epochs over which a variance is averaged: the error of the mean is a third of it.
MEMORY_EPOCHS = 10
# The stated variance is not believed if the mean of so many normalised squares is larger. Without
# scatter the probability of that is less than 1e-4.
_LARGEST_MEAN_SQUARE = 4.0


@compiled
def learn_scatter(  # type: ignore[no-untyped-def]
    places,
    time,
    residual,
    variance,
    noise,
    stated_variance,
    is_used,
    is_fault,
    unseen,
    two,
    seen_times,
    known_times,
    numbers,
):
    """Update the excess variances of n phases in place; return those that were too small.

    Parameters
    ----------
    places : ndarray of int, shape (n,)
        See `SignalPlaces.of`.
    time : int
        Epoch, GPS, ns.
    residual, variance, noise : ndarray, shape (2 n or more,)
        Residuals of codes and phases against all others (m), their variances, and those of the
        noise, m2.
    stated_variance : ndarray, shape (n,)
        Variances of the phases that the receivers state, m2.
    is_used : ndarray of bool, shape (2 n or more,)
    is_fault : ndarray of bool, shape (n,)
        Whether a phase did not fit with the variance used so far.
    unseen : float
        Excess of signals whose own cannot be seen, m2.
    two : float
        2.0, which the compiler must not know: the square of the C library's power, which Python
        takes, is not always the product.
    seen_times, known_times : ndarray of int, shape (places,)
        Last epoch of each signal, and last one with a precise residual, ns; -1 before.
    numbers : ndarray, shape (3, places)
        Excess variance, m2, mean of half the squared differences of successive residuals over the
        stated variance, and residual of the last epoch, m, NaN if it was too imprecise.

    Returns
    -------
    missing : ndarray, shape (n,)
        By how much the excess was too small, m2.
    new : int
        Number of signals that were not known.
    """
    count = len(places)
    missing = np.zeros(count)
    new = 0
    for n in range(count):
        place, m = places[n], count + n
        if seen_times[place] < 0:
            known_times[place] = -1
            numbers[0, place], numbers[1, place], numbers[2, place] = 0.0, 1.0, math.nan
            new += 1
        seen_times[place] = time
        before, stated = numbers[0, place], stated_variance[n]
        # The residual is precise if the noise of the phase itself is most of its variance. It is
        # not with ambiguities that are still unknown.
        if not (variance[m] < 2.0 * noise[m] and is_used[m]):
            numbers[2, place] = math.nan
            if before < unseen:
                missing[n] = unseen - before
                numbers[0, place] = unseen
            continue
        known_times[place] = time
        excess, mean_square = before, numbers[1, place]
        # Successive differences (von Neumann 1941) leave out motion or plasma that was not
        # predicted: both change the residuals slowly.
        square = 0.5 * math.pow(residual[m] - numbers[2, place], two)
        if math.isfinite(square):
            mean_square += (square / stated - mean_square) / MEMORY_EPOCHS
        if is_fault[n]:
            excess = max(excess, math.pow(residual[m], two) - stated)
        elif excess > 0.0 and math.isfinite(square):
            excess += (square - stated - excess) / MEMORY_EPOCHS
        elif mean_square > _LARGEST_MEAN_SQUARE:
            excess = (mean_square - 1.0) * stated
        # An excess below the stated variance is not more than the error of its estimate.
        if 0.0 < excess < stated:
            excess, mean_square = 0.0, 1.0
        numbers[0, place], numbers[1, place], numbers[2, place] = excess, mean_square, residual[m]
        if excess > before and (is_fault[n] or before == 0.0):
            missing[n] = excess - before
    return missing, new


@compiled
def forget_scatter(places, time, longest_absence, seen_times, numbers):  # type: ignore[no-untyped-def]
    """Forget signals that were not seen for long; return how many, and whether any has an excess.

    Parameters
    ----------
    places : ndarray of int, shape (k,)
        Signals that are known.
    longest_absence : float
        s.

    Others are those of `learn_scatter`.
    """
    forgotten, has_excess = 0, False
    for n in range(len(places)):
        place = places[n]
        if (time - seen_times[place]) / NANOSECONDS_PER_SECOND > longest_absence:
            seen_times[place], numbers[0, place] = -1, 0.0
            forgotten += 1
        has_excess = has_excess or numbers[0, place] > 0.0
    return forgotten, has_excess


@compiled
def change_phases(  # type: ignore[no-untyped-def]
    rows,
    last_rows,
    residual,
    last_residual,
    variance,
    last_variance,
    direction,
    clock_rate,
    further_variance,
):
    """Return the changes of n phases since the last epoch, and what they depend on.

    Parameters
    ----------
    rows, last_rows : ndarray of int, shape (n,)
        Rows of the signals now and at the last epoch.
    residual, last_residual, variance, last_variance, direction, clock_rate : ndarray
        See `PhaseChanges`.
    further_variance : float
        What changes besides noise, m2.

    Returns
    -------
    change : ndarray, shape (n,)
        Less their median, m: the clock may have jumped by any number of metres, which a square
        would not forgive.
    variance : ndarray, shape (n,)
        m2.
    design, weighted : ndarray, shape (n, 5)
        Derivatives by motion, clock and time of reception, and these over the variance.
    """
    count = len(rows)
    change, total = np.empty(count), np.empty(count)
    design, weighted = np.empty((count, 5)), np.empty((count, 5))
    for n in range(count):
        change[n] = residual[rows[n]] - last_residual[last_rows[n]]
    ordered = np.sort(change)
    middle = ordered[count // 2]
    if count % 2 == 0:
        middle = 0.5 * (ordered[count // 2 - 1] + middle)
    for n in range(count):
        row = rows[n]
        change[n] -= middle
        total[n] = variance[row] + last_variance[last_rows[n]] + further_variance
        for axis in range(3):
            design[n, axis] = -direction[row, axis]
        design[n, 3] = 1.0
        design[n, 4] = SPEED_OF_LIGHT * (clock_rate[row] - 1.0)
        for k in range(5):
            weighted[n, k] = design[n, k] / total[n]
    return change, total, design, weighted
