"""Whether integers agree with contents, codes and geometry of a second, compiled.

Satellites whose integers are right show the bias of the wide lanes by codes, and how far wide lanes
by codes and by geometry are off: see `vtff_iono.density.integer_resolution`.
"""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray
from vtff_iono.density.fluctuations import FEWEST_WITNESSES, LARGE_SCATTER
from vtff_iono.density.phase_differences import (
    DEVIATION,
    DEVIATION_SQUARED,
    GEOMETRIC,
    STEC,
    STEP_SQUARED,
    WIDE_LANE,
)

__all__ = [
    "BIAS_COUNT",
    "BIAS_MEAN",
    "BIAS_SQUARES",
    "BIAS_WEIGHT",
    "FEWEST_SECONDS",
    "OF_CODES",
    "OF_GEOMETRY",
    "add_geometric",
    "add_resolved",
    "find_wrong_integers",
    "first_measured",
    "forget_bias",
    "wide_lane_error",
]

BIAS_WEIGHT, BIAS_COUNT, BIAS_MEAN, BIAS_SQUARES = range(4)
"""Places of the running mean of wide lanes by codes, cycles, see `WeightedMean`, in an array of
what was measured."""

OF_CODES, OF_GEOMETRY = 4, 6
"""Places of the variances of errors of wide lanes by codes and by geometry, cycles^2; each is
followed by the number of its measurements."""

FEWEST_SECONDS = 4
"""Fewest seconds of data for a decision."""

_MEASURED = 8
# Sigma of the slow error of a wide lane at first, cycles, and as how many seconds it counts; s over
# which it is averaged.
_FIRST_CODE_SIGMA, _FIRST_SECONDS, _CODE_MEMORY = 0.1, 10.0, 3000.0
# The same of the wide lane that the geometry shows, whose memory is that of seconds of a dozen
# satellites: relative navigation errs more after a fade.
_FIRST_GEOMETRIC_SIGMA, _GEOMETRIC_MEMORY = 0.05, 300.0
# Cycles; wide lanes with more noise do not show the errors of the geometry.
_LARGEST_NOISE = 0.1
# The integers of a satellite are wrong when its content (see `DensitySettings.outlier_sigmas`) or
# its wide lane is off by more than both.
_WRONG_WIDE_LANE_SIGMAS = 5.0
_WRONG_WIDE_LANE = 0.5  # cycles


def first_measured() -> FloatArray:
    """Return an array of what was measured, shape (8,), before any measurement."""
    measured = np.zeros(_MEASURED)
    measured[OF_CODES], measured[OF_GEOMETRY] = _FIRST_CODE_SIGMA**2, _FIRST_GEOMETRIC_SIGMA**2
    measured[OF_CODES + 1] = measured[OF_GEOMETRY + 1] = _FIRST_SECONDS
    return measured


def forget_bias(measured: FloatArray) -> None:
    """Forget the bias of wide lanes by codes, in place."""
    measured[: BIAS_SQUARES + 1] = 0.0


@compiled
def _add_square(measured, place, square, memory):  # type: ignore[no-untyped-def]
    """Add the square of an error to a variance, in place; `memory` is its largest weight."""
    measured[place + 1] = min(measured[place + 1] + 1.0, memory)
    measured[place] += (square - measured[place]) / measured[place + 1]


@compiled
def add_resolved(measured, wide_lane, samples):  # type: ignore[no-untyped-def]
    """Add the mean wide lane of a satellite less its integers, which is the common bias, cycles."""
    if not math.isfinite(wide_lane):
        return
    # West (1979), updating mean and variance estimates.
    measured[BIAS_WEIGHT] += samples
    measured[BIAS_COUNT] += 1.0
    deviation = wide_lane - measured[BIAS_MEAN]
    measured[BIAS_MEAN] += samples / measured[BIAS_WEIGHT] * deviation
    measured[BIAS_SQUARES] += samples * deviation * (wide_lane - measured[BIAS_MEAN])
    if measured[BIAS_COUNT] >= FEWEST_SECONDS:
        square = (wide_lane - measured[BIAS_MEAN]) ** 2
        _add_square(measured, OF_CODES, square, _CODE_MEMORY)


@compiled
def wide_lane_error(measured, wide_lane):  # type: ignore[no-untyped-def]
    """Return how far a wide lane less its integers is from the common bias; NaN at first."""
    if measured[BIAS_COUNT] < FEWEST_SECONDS:
        return math.nan
    return wide_lane - measured[BIAS_MEAN]


@compiled
def add_geometric(measured, errors, sigma, noise_square):  # type: ignore[no-untyped-def]
    """Add what wide lanes by geometry are off for satellites with integers in a second.

    `errors` are those less their median, cycles, `sigma` the sigmas of the contents, TECU, both of
    shape (n,); `noise_square` as in `find_wrong_integers`.
    """
    count = len(errors)
    if count < 2:
        return
    share = (count - 1) / count
    for row in range(count):
        noise = noise_square * sigma[row] ** 2
        if noise < _LARGEST_NOISE**2:
            square = max(errors[row] * errors[row] / share - noise, 0.0)
            _add_square(measured, OF_GEOMETRY, square, _GEOMETRIC_MEMORY)


@compiled
def _find_contradicted(  # type: ignore[no-untyped-def]
    columns, sigma, is_off, measured, cycles_per_tecu, noise_square, relative_sigma
):
    """Return which links have integers whose wide lane relative navigation contradicts, (n,).

    The links that agree show how well it knows them. Arguments as in `find_wrong_integers`;
    `is_off` are links that are known to be wrong.
    """
    contradicts = np.zeros(len(sigma), dtype=np.bool_)
    shown, rows = np.empty(len(sigma)), np.empty(len(sigma), dtype=np.int64)
    count = 0
    for row in range(len(sigma)):
        value = columns[GEOMETRIC, row] - cycles_per_tecu * columns[STEC, row]
        if not is_off[row] and math.isfinite(value + sigma[row] + relative_sigma):
            shown[count], rows[count] = value, row
            count += 1
    if count < FEWEST_WITNESSES:
        return contradicts
    # The median is right while most are.
    errors = shown[:count] - np.median(shown[:count])
    lasting = measured[OF_GEOMETRY] + relative_sigma**2
    agree = np.ones(count, dtype=np.bool_)
    for place in range(count):
        row = rows[place]
        variance = noise_square * sigma[row] ** 2 + lasting
        limit = max(_WRONG_WIDE_LANE_SIGMAS * math.sqrt(variance), _WRONG_WIDE_LANE)
        if abs(errors[place]) > limit:
            contradicts[row] = True
            agree[place] = False
    add_geometric(measured, errors[agree], sigma[rows[:count][agree]], noise_square)
    return contradicts


@compiled
def find_wrong_integers(  # type: ignore[no-untyped-def]
    columns,
    samples,
    errors,
    spread,
    sigma,
    is_outlier,
    measured,
    cycles_per_tecu,
    noise_square,
    relative_sigma,
    outlier_sigmas,
    outlier_tecu,
    least_noise,
):
    """Find the links with integers whose contents or wide lanes do not agree with the others.

    Parameters
    ----------
    columns : ndarray, shape (8, n)
        Means of the columns of `phase_differences`.
    samples : ndarray of int64, shape (n,)
        Number of samples of each mean.
    errors : ndarray, shape (n,)
        Measured less predicted contents, TECU.
    spread, sigma : ndarray, shape (n,)
        Sigmas of predictions and measurements, TECU.
    is_outlier : ndarray of bool, shape (n,)
        Links that are known to be wrong.
    measured : ndarray, shape (8,)
        Measurements so far, see `first_measured`; the links that agree are added.
    cycles_per_tecu, noise_square : float
        Wide lanes of a content, cycles per TECU, and variance of the noise of a wide lane over that
        of the content, 1/TECU^2.
    relative_sigma : float
        Sigma of the relative position, wide lanes.
    outlier_sigmas, outlier_tecu : float
        As in `DensitySettings`.
    least_noise : float
        Smallest variance of the white noise of a sample, TECU^2.

    Returns
    -------
    is_wrong : ndarray of bool, shape (n,)
    is_any_wrong : bool
    fluctuates : ndarray of bool, shape (n,)
        Links whose samples scatter by more than their noise.
    """
    count = len(errors)
    is_wrong, fluctuates = np.zeros(count, dtype=np.bool_), np.zeros(count, dtype=np.bool_)
    for row in range(count):
        largest = max(outlier_sigmas * math.hypot(spread[row], sigma[row]), outlier_tecu)
        is_wrong[row] = is_outlier[row] or abs(errors[row]) > largest
        noise = 0.5 * columns[STEP_SQUARED, row]
        if noise < least_noise:  # what is not known stays so
            noise = least_noise
        scatter = columns[DEVIATION_SQUARED, row] - columns[DEVIATION, row] ** 2
        fluctuates[row] = scatter > LARGE_SCATTER * noise
    contradicts = _find_contradicted(
        columns, sigma, is_wrong, measured, cycles_per_tecu, noise_square, relative_sigma
    )
    is_any_wrong = False
    for row in range(count):
        wide_lane = columns[WIDE_LANE, row]
        error = abs(wide_lane_error(measured, wide_lane))
        limit = max(_WRONG_WIDE_LANE, _WRONG_WIDE_LANE_SIGMAS * math.sqrt(measured[OF_CODES]))
        is_wrong[row] = is_wrong[row] or contradicts[row] or error > limit
        is_any_wrong = is_any_wrong or is_wrong[row]
        if not is_wrong[row]:
            add_resolved(measured, wide_lane, float(samples[row]))
    return is_wrong, is_any_wrong, fluctuates
