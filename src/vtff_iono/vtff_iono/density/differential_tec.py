"""Differential TEC between two receivers from fixed integers, and its average over a second."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.frames.geodetic import rotation_itrf_to_enu
from vtff_dynamics.vectors import FloatArray
from vtff_iono.links.geometry_free import tecu_per_metre
from vtff_iono.links.windows import WindowBuffer

__all__ = [
    "SecondAverage",
    "SecondMeans",
    "compile_kernels",
    "differential_stec",
    "horizontal_sigma",
]


def differential_stec(
    phase_first_cycles: npt.ArrayLike,
    phase_second_cycles: npt.ArrayLike,
    ambiguity_first_cycles: npt.ArrayLike,
    ambiguity_second_cycles: npt.ArrayLike,
    frequency_first: float,
    frequency_second: float,
) -> FloatArray:
    """Return the slant TEC of the deputy less that of the chief, TECU.

    Parameters
    ----------
    phase_first_cycles, phase_second_cycles : array_like
        Carrier phases deputy minus chief at one receiver time, cycles, RINEX sign.
    ambiguity_first_cycles, ambiguity_second_cycles : array_like
        Integers of these phases, which are subtracted. Integers of double differences leave those
        of the reference satellite open: the result then contains one constant that is common to all
        satellites, as the difference of the inter-frequency biases of the receivers is.
    frequency_first, frequency_second : float
        Carrier frequencies, Hz.
    """
    first = np.asarray(phase_first_cycles, dtype=float) - ambiguity_first_cycles
    second = np.asarray(phase_second_cycles, dtype=float) - ambiguity_second_cycles
    ranges = first * (SPEED_OF_LIGHT / frequency_first) - second * (
        SPEED_OF_LIGHT / frequency_second
    )
    return np.asarray(ranges * tecu_per_metre(frequency_first, frequency_second))


def horizontal_sigma(
    gradient_sigma: FloatArray,
    position_chief_itrf: FloatArray,
    position_deputy_itrf: FloatArray,
) -> float:
    """Return the sigma of what vertical contents differ by from one receiver to the other, TECU.

    Parameters
    ----------
    gradient_sigma : ndarray, shape (2,)
        Sigmas of the gradients of the vertical content to the east and north, TECU/m.
    position_chief_itrf, position_deputy_itrf : ndarray, shape (3,)
        Positions of the receivers, m.
    """
    rotation = rotation_itrf_to_enu(position_chief_itrf)
    distance = rotation[:2] @ (position_deputy_itrf - position_chief_itrf)
    return float(np.linalg.norm(gradient_sigma * distance))


class SecondMeans(NamedTuple):
    """Means of one second; arrays of shape (n,), one row for each number, in ascending order.

    Attributes
    ----------
    time : float
        Mean time of the epochs, GPS time, ns since 1980-01-06.
    number : ndarray of int64
        Number of the series that each row belongs to.
    columns : dict of str to ndarray
        Means by name.
    samples : ndarray of int64
        Number of samples of each mean.
    """

    time: float
    number: npt.NDArray[np.int64]
    columns: dict[str, FloatArray]
    samples: npt.NDArray[np.int64]


class SecondAverage:
    """Averages rows over whole seconds, those of each number apart.

    Geometry is averaged with the observations, so that their means belong together while both
    change. A mean of 20 samples has 0.22 of the white noise of one sample.

    Parameters
    ----------
    coverage_minimum : int
        Fewest samples of a number in a second; with fewer it has no mean.
    """

    def __init__(self, coverage_minimum: int = 1) -> None:
        self._buffer = WindowBuffer(1.0)
        self._coverage_minimum = coverage_minimum

    def update(
        self,
        time: npt.NDArray[np.int64],
        number: npt.NDArray[np.int64],
        columns: Mapping[str, FloatArray],
    ) -> Iterator[SecondMeans]:
        """Add rows and yield the means of the seconds that they end.

        Parameters
        ----------
        time : ndarray of int64, shape (n,)
            GPS time, ns since 1980-01-06, not decreasing.
        number : ndarray of int64, shape (n,)
            Number of the series of each row: a satellite has another series after its ambiguity
            has changed.
        columns : mapping of str to ndarray, shape (n,)
            Quantities; one that is NaN in a row makes the mean NaN.
        """
        for _, window in self._buffer.update(time, {"number": number, **columns}):
            yield self._means(window)

    def _means(self, window: dict[str, npt.NDArray[Any]]) -> SecondMeans:
        names = [name for name in window if name not in ("time", "number")]
        columns = np.array([window[name] for name in names])
        number, samples, means = _means_by_number(window["number"], columns)
        kept = samples >= self._coverage_minimum
        time = window["time"]
        epochs = time[np.flatnonzero(np.diff(time, prepend=time[0] - 1))]
        middle = float(epochs[0]) + float(np.mean(epochs - epochs[0]))
        means_kept = dict(zip(names, means[:, kept], strict=True))
        return SecondMeans(middle, number[kept], means_kept, samples[kept])


@compiled
def _means_by_number(number, columns):  # type: ignore[no-untyped-def]
    """Return the numbers (k,), ascending, how often each occurs, and means of columns, (m, k).

    `number` has shape (n,), `columns` (m, n).
    """
    found = np.unique(number)
    samples = np.zeros(len(found), dtype=np.int64)
    means = np.zeros((len(columns), len(found)))
    place = np.searchsorted(found, number)
    for row in range(len(number)):
        samples[place[row]] += 1
        for column in range(len(columns)):
            means[column, place[row]] += columns[column, row]
    return found, samples, means / samples


def compile_kernels() -> None:
    """Compile the means of a second."""
    _means_by_number(np.zeros(1, dtype=np.int64), np.zeros((1, 1)))
