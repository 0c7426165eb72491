"""Differential TEC between two receivers from fixed integers, and its average over a second."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.frames.geodetic import geodetic_from_itrf, rotation_to_enu_at
from vtff_dynamics.vectors import FloatArray
from vtff_iono.links.geometry_free import tecu_per_metre
from vtff_iono.links.windows import WindowBuffer

__all__ = [
    "SecondAverage",
    "SecondMeans",
    "differential_stec",
    "horizontal_sigma",
    "vertical_content",
]

# Smallest elevation of the satellites that show the vertical content above the chief, rad.
_VTEC_ELEVATION = math.radians(40.0)


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
    geodetic_chief: FloatArray | None = None,
) -> float:
    """Return the sigma of what vertical contents differ by from one receiver to the other, TECU.

    Parameters
    ----------
    gradient_sigma : ndarray, shape (2,)
        Sigmas of the gradients of the vertical content to the east and north, TECU/m.
    position_chief_itrf, position_deputy_itrf : ndarray, shape (3,)
        Positions of the receivers, m.
    geodetic_chief : ndarray, shape (3,), optional
        Latitude, longitude (rad) and height of the chief, where they are known already.
    """
    if geodetic_chief is None:
        geodetic_chief = geodetic_from_itrf(position_chief_itrf)
    latitude, longitude = geodetic_chief[:2].tolist()
    rotation = rotation_to_enu_at(latitude, longitude)
    distance = rotation[:2] @ (position_deputy_itrf - position_chief_itrf)
    return float(np.linalg.norm(gradient_sigma * distance))


@compiled
def vertical_content(  # type: ignore[no-untyped-def]
    rejected, elevation, slant, slant_sigma, vertical, vertical_sigma
):
    """Return the vertical content above a spacecraft and its sigma, TECU, from high satellites.

    Parameters
    ----------
    rejected : ndarray of int, shape (n,)
        Zero for a satellite that is used.
    elevation : ndarray, shape (n,)
        rad.
    slant, slant_sigma, vertical : ndarray, shape (n,)
        Slant contents, their sigmas, and vertical contents, TECU.
    vertical_sigma : float
        Sigma of content that is not of the layer and does not tell of it, TECU.

    Returns
    -------
    content, sigma : float
        NaN without a high satellite.
    """
    contents, sigmas = np.empty(len(slant)), np.empty(len(slant))
    count = 0
    for row in range(len(slant)):
        if rejected[row] == 0 and elevation[row] > _VTEC_ELEVATION and slant[row] != 0.0:
            contents[count] = vertical[row]
            sigmas[count] = slant_sigma[row] * abs(vertical[row] / slant[row])
            count += 1
    if count == 0:
        return math.nan, math.nan
    of_layer = math.hypot(np.median(sigmas[:count]), vertical_sigma)
    return np.median(contents[:count]), of_layer


class SecondMeans(NamedTuple):
    """Means of one second; arrays of shape (n,), one row for each number, in ascending order.

    Attributes
    ----------
    time : float
        Mean time of the epochs, GPS time, ns since 1980-01-06.
    number : ndarray of int64
        Number of the series that each row belongs to.
    columns : ndarray, shape (m, n)
        Means of m quantities.
    samples : ndarray of int64
        Number of samples of each mean.
    """

    time: float
    number: npt.NDArray[np.int64]
    columns: FloatArray
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
        self._coverage_minimum = coverage_minimum
        self._buffer = WindowBuffer(1.0)

    def update(
        self,
        time: npt.NDArray[np.int64],
        number: npt.NDArray[np.int64],
        columns: FloatArray,
    ) -> Iterator[SecondMeans]:
        """Add rows and yield the means of the seconds that they end.

        Parameters
        ----------
        time : ndarray of int64, shape (n,)
            GPS time, ns since 1980-01-06, not decreasing.
        number : ndarray of int64, shape (n,)
            Number of the series of each row: a satellite has another series after its ambiguity
            has changed.
        columns : ndarray, shape (n, m)
            Quantities; one that is NaN in a row makes the mean NaN.
        """
        for _, rows in self._buffer.update(time, {"number": number, "columns": columns}):
            yield SecondMeans(
                *_means_by_number(
                    rows["time"], rows["number"], rows["columns"], self._coverage_minimum
                )
            )


@compiled
def _means_by_number(time, number, columns, fewest):  # type: ignore[no-untyped-def]
    """Return the mean time of epochs, numbers, ascending, means by number, and their samples.

    The shapes are (), (k,), (m, k) and (k,); `time` and `number` have shape (n,), `columns` (n, m).
    A number with fewer samples than `fewest` has no mean.
    """
    rows, quantities = columns.shape
    # Numbers in the order in which they appear; as a rule that of one epoch is that of the next.
    found, place = np.empty(rows, dtype=np.int64), np.empty(rows, dtype=np.int64)
    count, last = 0, -1
    for row in range(rows):
        last += 1
        if last >= count or found[last] != number[row]:
            last = 0
            while last < count and found[last] != number[row]:
                last += 1
            if last == count:
                found[count] = number[row]
                count += 1
        place[row] = last
    samples = np.zeros(count, dtype=np.int64)
    sums = np.zeros((count, quantities))
    epochs, elapsed = 0, 0.0
    for row in range(rows):
        if row == 0 or time[row] != time[row - 1]:
            epochs += 1
            elapsed += float(time[row] - time[0])
        samples[place[row]] += 1
        for column in range(quantities):
            sums[place[row], column] += columns[row, column]
    order = np.argsort(found[:count])
    kept = order[samples[order] >= fewest]
    means = np.empty((quantities, len(kept)))
    for place_of_mean in range(len(kept)):
        for column in range(quantities):
            total = sums[kept[place_of_mean], column]
            means[column, place_of_mean] = total / samples[kept[place_of_mean]]
    return float(time[0]) + elapsed / epochs, found[kept], means, samples[kept]
