"""Differential TEC between two receivers from fixed integers, and its average over a second."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.vectors import FloatArray
from vtff_iono.links.geometry_free import tecu_per_metre
from vtff_iono.links.windows import WindowBuffer

__all__ = ["SecondAverage", "differential_stec"]


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
        Their integers, which are subtracted. Where they come from double differences, those of
        the reference satellite are arbitrary: the result then has one constant in common for all
        satellites, as it has from the difference of the receivers' inter-frequency biases.
    frequency_first, frequency_second : float
        Hz.
    """
    first = np.asarray(phase_first_cycles, dtype=float) - ambiguity_first_cycles
    second = np.asarray(phase_second_cycles, dtype=float) - ambiguity_second_cycles
    ranges = first * (SPEED_OF_LIGHT / frequency_first) - second * (
        SPEED_OF_LIGHT / frequency_second
    )
    return np.asarray(ranges * tecu_per_metre(frequency_first, frequency_second))


class SecondAverage:
    """Averages rows of satellites over whole seconds.

    Geometry is averaged with the observations, so that their means belong together while both
    change. 20 samples of white noise leave 0.22 of the noise of one.

    Parameters
    ----------
    coverage_minimum : int
        Fewest samples of a satellite in a second; with fewer it has no row.
    """

    def __init__(self, coverage_minimum: int = 1) -> None:
        self._buffer = WindowBuffer(1.0)
        self._coverage_minimum = coverage_minimum

    def update(
        self,
        time: npt.NDArray[np.int64],
        satellite: npt.NDArray[np.int64],
        columns: Mapping[str, FloatArray],
    ) -> Iterator[
        tuple[float, npt.NDArray[np.int64], dict[str, FloatArray], npt.NDArray[np.int64]]
    ]:
        """Take rows in and yield the means of the seconds that they end.

        Parameters
        ----------
        time : ndarray of int64, shape (n,)
            GPS time, ns since 1980-01-06, not decreasing.
        satellite : ndarray of int64, shape (n,)
            What is averaged apart; give another number when an ambiguity changes.
        columns : mapping of str to ndarray, shape (n,)
            Quantities; one that is NaN in a row makes the mean NaN.

        Yields
        ------
        time : float
            Mean time of the samples, ns since 1980-01-06.
        satellite, means, samples
            Satellites in ascending order, their means by name, and the number of samples.
        """
        for _, window in self._buffer.update(time, {"satellite": satellite, **columns}):
            yield self._means(window)

    def flush(
        self,
    ) -> Iterator[
        tuple[float, npt.NDArray[np.int64], dict[str, FloatArray], npt.NDArray[np.int64]]
    ]:
        """Yield the last second, which may be short."""
        for _, window in self._buffer.flush():
            yield self._means(window)

    def _means(
        self,
        window: dict[str, npt.NDArray],  # type: ignore[type-arg]
    ) -> tuple[float, npt.NDArray[np.int64], dict[str, FloatArray], npt.NDArray[np.int64]]:
        satellite, inverse, samples = np.unique(
            window["satellite"], return_inverse=True, return_counts=True
        )
        kept = samples >= self._coverage_minimum
        epochs = np.unique(window["time"])
        middle = float(epochs[0]) + float(np.mean(epochs - epochs[0]))
        means = {
            name: (np.bincount(inverse, column) / samples)[kept]
            for name, column in window.items()
            if name not in ("time", "satellite")
        }
        return middle, satellite[kept], means, samples[kept]
