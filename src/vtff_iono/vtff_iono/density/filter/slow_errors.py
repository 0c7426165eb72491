"""Slow errors of differential contents, measured from how satellites disagree with each other.

Multipath, variations of phase centres and what a mapping leaves out are of centimetres, other for
each satellite, and change within minutes. Their size and correlation time are not assumed: what is
left of the contents of a second when everything that all satellites share is removed shows both.
Seconds that follow each other have nearly the same errors, so that minutes of them are few samples:
the sigma contains that it is known from few.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray
from vtff_iono.density.filter.kernels import slow_residuals

__all__ = ["CORRELATION_TIME", "SIGMA", "SlowErrors", "SlowTable", "add_epoch"]

# What is taken to be until it is measured: sigma, TECU (1.5 mm on each of four phases), and
# correlation time, s, and as how many satellite-seconds of measurements they count; those of the
# sigma count less and less, over a time of `_FORGOTTEN`, s. At first the sigma is known as from
# `_FIRST_SAMPLES` samples that are independent, each of which lasts for the correlation time, and
# that time as from six.
_FIRST_SIGMA, _FIRST_TIME = 0.03, 100.0
_FIRST_WEIGHT, _FIRST_WEIGHT_OF_TIME = 50.0, 600.0
_FIRST_SAMPLES = 4.0
_FORGOTTEN = 30.0
# From fewer independent samples than this no variance is known any better.
_FEWEST_SAMPLES = 3.0
# s; over which the measurements are averaged.
_MEMORY = 900.0
# s; correlation is measured over this time.
_LAG = 20.0
_SHORTEST_TIME, _LONGEST_TIME = 20.0, 1000.0
_FEWEST_DEGREES = 0.5
# A residual counts at most as this many sigmas: one wrong integer is no multipath.
_LARGEST_SIGMAS = 4.0
_SMALLEST_SIGMA = 1e-4  # TECU
_FIRST_VARIANCE = _FIRST_SIGMA**2


# Places of `SlowTable.values`: what `SlowErrors` tells, then sums of weighted measurements.
SIGMA, CORRELATION_TIME = 0, 1
_FIRST_WEIGHT_LEFT, _SQUARE, _WEIGHT, _PRODUCT, _OF_PRODUCT, _LAST_TIME = range(2, 8)
_VALUES = 8
# Epochs and satellites for which there is room at first.
_EPOCHS, _SATELLITES = 32, 16


class SlowTable(NamedTuple):
    """The numbers of `SlowErrors`, which compiled functions change in place.

    Attributes
    ----------
    values : ndarray, shape (8,)
        Sigma, TECU, correlation time, s, the part of the first weight that is left, the sums of
        squares, of their weights, of products over the lag and of the squares beside them, and the
        time of the last epoch, s.
    time : ndarray, shape (k,)
        Epochs of the last seconds, s, as a ring.
    satellite, residual : ndarray of int64 and float, shape (k, m)
        Satellites of these epochs, and their residuals, TECU.
    size : ndarray of int64, shape (k,)
        Number of satellites of each epoch.
    span : ndarray of int64, shape (2,)
        Row of the first epoch, and number of epochs.
    """

    values: FloatArray
    time: FloatArray
    satellite: npt.NDArray[np.int64]
    residual: FloatArray
    size: npt.NDArray[np.int64]
    span: npt.NDArray[np.int64]


class SlowErrors:
    """Sigma and correlation time of the slow error of a satellite, the same for all of them.

    Attributes
    ----------
    table : SlowTable
        Another one after `reserve`.
    """

    def __init__(self) -> None:
        self.table = _empty_table(_EPOCHS, _SATELLITES)
        values = self.table.values
        values[_FIRST_WEIGHT_LEFT] = _FIRST_WEIGHT
        values[_OF_PRODUCT] = _FIRST_WEIGHT_OF_TIME * _FIRST_VARIANCE
        values[_PRODUCT] = values[_OF_PRODUCT] * math.exp(-_LAG / _FIRST_TIME)
        values[_LAST_TIME] = math.nan
        _renew(values)

    @property
    def sigma(self) -> float:
        """TECU: root of the expected variance, known from few independent samples."""
        return float(self.table.values[SIGMA])

    @property
    def correlation_time(self) -> float:
        """Time after which the correlation is 1/e, s."""
        return float(self.table.values[CORRELATION_TIME])

    def reserve(self, satellites: int) -> None:
        """Have room for another epoch of a number of satellites."""
        old = self.table
        epochs, width = old.residual.shape
        first, count = old.span.tolist()
        if count < epochs and satellites <= width:
            return
        new = _empty_table(2 * epochs, max(width, 2 * satellites))
        rows = (first + np.arange(count)) % epochs
        new.values[:] = old.values
        new.time[:count], new.size[:count] = old.time[rows], old.size[rows]
        new.satellite[:count, :width] = old.satellite[rows]
        new.residual[:count, :width] = old.residual[rows]
        new.span[1] = count
        self.table = new

    def add(
        self,
        time: float,
        satellites: npt.NDArray[np.int64],
        observed: FloatArray,
        common: FloatArray,
        common_sigma: FloatArray,
        fast_variance: FloatArray,
    ) -> None:
        """Add an epoch; arguments as in `add_epoch`."""
        self.reserve(len(observed))
        add_epoch(self.table, time, satellites, observed, common, common_sigma, fast_variance)


def _empty_table(epochs: int, satellites: int) -> SlowTable:
    """Return a table with room for epochs of satellites, all of it zero."""
    return SlowTable(
        np.zeros(_VALUES),
        np.zeros(epochs),
        np.zeros((epochs, satellites), dtype=np.int64),
        np.zeros((epochs, satellites)),
        np.zeros(epochs, dtype=np.int64),
        np.zeros(2, dtype=np.int64),
    )


@compiled
def _expected_sigma(values):  # type: ignore[no-untyped-def]
    """Return the sigma, TECU: root of the expected variance, known from few samples."""
    first_weight = values[_FIRST_WEIGHT_LEFT]
    squares = max(0.0, values[_SQUARE]) + first_weight * _FIRST_VARIANCE
    weight = values[_WEIGHT] + first_weight
    # An exponential correlation makes of a time as many independent squares (Bartlett 1946).
    samples = weight / values[CORRELATION_TIME]
    samples += _FIRST_SAMPLES * first_weight / _FIRST_WEIGHT
    # Mean of the inverse gamma distribution of a variance (Gelman and others, Bayesian Data
    # Analysis, section 2.6).
    samples = max(samples, _FEWEST_SAMPLES)
    variance = squares / weight * samples / (samples - 2.0)
    return max(math.sqrt(variance), _SMALLEST_SIGMA)


@compiled
def _expected_time(values):  # type: ignore[no-untyped-def]
    """Return the time after which the correlation is 1/e, s."""
    correlation = values[_PRODUCT] / max(values[_OF_PRODUCT], 1e-12)
    if not 0.0 < correlation < 1.0:
        return _SHORTEST_TIME if correlation <= 0.0 else _LONGEST_TIME
    return min(max(-_LAG / math.log(correlation), _SHORTEST_TIME), _LONGEST_TIME)


@compiled
def _renew(values):  # type: ignore[no-untyped-def]
    """Compute sigma and correlation time anew from the sums of measurements."""
    values[CORRELATION_TIME] = _expected_time(values)
    values[SIGMA] = _expected_sigma(values)


@compiled
def add_epoch(  # type: ignore[no-untyped-def]
    table, time, satellites, observed, common, common_sigma, fast_variance
):
    """Add an epoch to a table that has room for it.

    Parameters
    ----------
    table : SlowTable
    time : float
        s, increasing.
    satellites : ndarray of int64, shape (n,)
    observed : ndarray, shape (n,)
        Contents, TECU.
    common : ndarray, shape (n, p)
        Derivatives with respect to what all satellites share, and is removed. What is estimated
        from the contents belongs to it: it takes part of the slow errors with it.
    common_sigma : ndarray, shape (p,)
        Sigma of what is shared before any content; infinite for what only the contents tell.
    fast_variance : ndarray, shape (n,)
        Variance of the errors that are independent from epoch to epoch, TECU^2.
    """
    values = table.values
    elapsed = 0.0
    if not math.isnan(values[_LAST_TIME]):
        elapsed = max(0.0, time - values[_LAST_TIME])
    values[_LAST_TIME] = time
    is_determined, weight, residual, freedom = slow_residuals(
        observed, common, common_sigma, fast_variance, values[SIGMA] ** 2
    )
    if not is_determined or freedom.sum() < _FEWEST_DEGREES:
        return
    kept = math.exp(-elapsed / _MEMORY)
    for place in (_SQUARE, _WEIGHT, _PRODUCT, _OF_PRODUCT):
        values[place] *= kept
    values[_FIRST_WEIGHT_LEFT] *= math.exp(-elapsed / _FORGOTTEN)
    _renew(values)
    variance = values[SIGMA] ** 2
    largest_fast = max(values[SIGMA], _FIRST_SIGMA) ** 2
    trust, fast = np.zeros(len(residual)), freedom * fast_variance
    for row in range(len(residual)):
        sigmas = min(max(residual[row], -_LARGEST_SIGMAS), _LARGEST_SIGMAS)
        residual[row] = sigmas / weight[row]
        # Satellites that fluctuate fast tell little about slow errors, and where they fluctuate by
        # more than these, only how well the sigma of the fluctuations is known.
        if not fast_variance[row] > largest_fast:
            trust[row] = (variance * weight[row] ** 2) ** 2 + 1e-3
    values[_SQUARE] += trust @ (residual**2 - fast)
    values[_WEIGHT] += trust @ freedom
    _add_products(table, time, satellites, residual, fast, trust)
    _renew(values)


@compiled
def _last_row(satellites, number):  # type: ignore[no-untyped-def]
    """Return the last row of a satellite, -1 for none."""
    for row in range(len(satellites) - 1, -1, -1):
        if satellites[row] == number:
            return row
    return -1


@compiled
def _add_products(table, time, satellites, residual, fast, trust):  # type: ignore[no-untyped-def]
    """Add products of residuals now and a lag before, which tell the correlation.

    `fast` are the variances of the fast errors in the residuals (TECU^2), `trust` their weights;
    all have the shape (n,), the other arguments are those of `add_epoch`.
    """
    values, span, epochs = table.values, table.span, len(table.time)
    before = -1
    while span[1] > 0 and time - table.time[span[0]] >= _LAG:
        before = span[0]
        span[0] = (span[0] + 1) % epochs
        span[1] -= 1
    if before >= 0:
        satellites_before = table.satellite[before, : table.size[before]]
        for row in range(len(residual)):
            # The last link of a satellite stands for all its links.
            then = _last_row(satellites_before, satellites[row])
            if then < 0:
                continue
            now = residual[_last_row(satellites, satellites[row])]
            earlier = table.residual[before, then]
            values[_PRODUCT] += trust[row] * now * earlier
            squares = 0.5 * (now**2 + earlier**2)
            values[_OF_PRODUCT] += trust[row] * max(squares - fast[row], 0.0)
    last = (span[0] + span[1]) % epochs
    span[1] += 1
    table.time[last], table.size[last] = time, len(residual)
    for row in range(len(residual)):
        table.satellite[last, row] = satellites[row]
        table.residual[last, row] = residual[row]
