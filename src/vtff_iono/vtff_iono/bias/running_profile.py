"""The density profile that an orbit has measured so far, completed by a model of the layer."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import WGS84_SEMI_MAJOR_AXIS
from vtff_dynamics.vectors import FloatArray
from vtff_iono.geometry.mapping import profile_content

__all__ = [
    "CONSTANT",
    "PEAK_UNIT",
    "SHAPE",
    "SIZE",
    "RunningProfile",
    "mean_between",
    "means_of_samples",
]

PEAK_UNIT = 100e3
"""Unit of a change of the altitude of the peak, m."""

SIZE, SHAPE, CONSTANT = 1, slice(2, 5), 5
"""Rows of `RunningProfile.densities`, derivatives with respect to the size and the shape of the
model, and to the constant of all contents."""

# Altitudes of the table, m: fine steps up to the highest orbits, coarse steps above.
_STEP, _TOP_STEP = 1e3, 20e3
_LOWEST, _DENSE_TOP, _HIGHEST = 100e3, 800e3, 2000e3
# All samples so far together count as much as this many samples, so that the next pass can correct
# the density.
_MEMORY_SAMPLES = 10.0
# Vertical content of the model at first, TECU.
_CONTENT_TECU = 20.0
# m; scale heights below and above the peak, and altitude of the peak.
_SMALLEST_SHAPE, _LARGEST_SHAPE = (15e3, 15e3, 200e3), (150e3, 200e3, 600e3)
# Two altitudes that are closer than this, m, are the same.
_SMALLEST_SEPARATION = 1.0


class RunningProfile:
    """Electron density against altitude: measured where the orbit has been, modelled elsewhere.

    The model is a Chapman layer whose size and shape can be changed (`resize`, `reshape`). It only
    serves to map slant rays; where spacecraft have measured the density, the measurement replaces
    it.

    Densities are measured from contents that have a constant in common, which is at first not known
    well. As it becomes better known, what was measured before is corrected (`move_constant`).

    Parameters
    ----------
    peak_altitude, scale_height_bottom, scale_height_top : float
        Altitude of the peak of the model, and its scale heights below and above the peak, m.

    Attributes
    ----------
    altitude : ndarray, shape (n,)
        Altitudes of the table, m, increasing.
    density : ndarray, shape (n,)
        Density at these altitudes, electrons per cubic metre.
    """

    def __init__(
        self,
        peak_altitude: float = 375e3,
        scale_height_bottom: float = 55e3,
        scale_height_top: float = 65e3,
    ) -> None:
        self.altitude: FloatArray = np.concatenate(
            (
                np.arange(_LOWEST, _DENSE_TOP, _STEP),
                np.arange(_DENSE_TOP, _HIGHEST + _TOP_STEP, _TOP_STEP),
            )
        )
        self._shape = np.array([scale_height_bottom, scale_height_top, peak_altitude])
        # The row of the shape that is the scale height of each altitude, the distance of the
        # altitude from the peak in that height, and the exponential of the negative distance.
        self._layer: tuple[npt.NDArray[np.int64], FloatArray, FloatArray]
        self._layer = _distances_from_peak(self.altitude, self._shape)
        self._weight = np.zeros(len(self.altitude))
        self._scale = 1.0
        self.density: FloatArray = self._with_model(np.zeros(len(self.altitude)))
        self._scale = _CONTENT_TECU / self.content_above(_LOWEST)
        self.density = self._with_model(self.density)
        # By how much what was measured is more where the constant is more by 1 TECU, 1/m3.
        self._per_constant = np.zeros(len(self.altitude))
        # `densities`, and the density that they are of.
        self._densities = np.zeros((0, len(self.altitude)))
        self._described: FloatArray | None = None

    def _with_model(self, density: FloatArray) -> FloatArray:
        """Return a density (n,) with that of the model where none was measured."""
        completed: FloatArray = _with_layer(density, self._weight, *self._layer[1:], self._scale)
        return completed

    def densities(self) -> FloatArray:
        """Return the density and its derivatives, shape (6, n).

        The derivatives are those with respect to the logarithm of the size of the model (row
        `SIZE`), to its shape in the units of `reshape` (`SHAPE`), both zero where the density was
        measured, and to the constant of the contents that were measured, TECU (`CONSTANT`), zero
        elsewhere.
        """
        # Each change makes another array of the density.
        if self._described is not self.density:
            self._densities = _with_derivatives(
                self.density, self._weight, *self._layer, self._shape, self._per_constant
            )
            self._described = self.density
        return self._densities

    def reshape(self, change: FloatArray) -> None:
        """Change the shape of the model.

        Parameters
        ----------
        change : ndarray, shape (3,)
            Changes of the logarithms of the scale heights below and above the peak, and of the
            altitude of the peak in units of `PEAK_UNIT`.
        """
        self._shape = _changed_shape(self._shape, np.exp(change[:2]), change[2])
        self._layer = _distances_from_peak(self.altitude, self._shape)
        self.density = self._with_model(self.density)

    def content_above(self, altitude: float) -> float:
        """Return the vertical content above an altitude (m), TECU."""
        radius = WGS84_SEMI_MAJOR_AXIS + altitude
        return float(profile_content(0.5 * np.pi, radius, self.altitude, self.density))

    def mean_density(self, altitude_first: float, altitude_second: float) -> float:
        """Return the mean density between two altitudes (m), electrons per cubic metre."""
        low, high = sorted((altitude_first, altitude_second))
        return float(mean_between(low, high, self.altitude, self.density))

    def resize(self, factor: float) -> None:
        """Multiply the modelled densities by a factor."""
        self._scale *= factor
        self.density = np.where(self._weight > 0.0, self.density, self.density * factor)

    def move_constant(self, change: float) -> None:
        """Correct what was measured: the constant is more by a change, TECU, than was believed."""
        if change != 0.0:
            self.density = np.maximum(self.density + change * self._per_constant, 0.0)

    def loosen_constant(self, part: float) -> None:
        """Let only a part of what the constant proves to be off be so since the measurements.

        The part is that of the variance of the constant before it has drifted; it is zero where
        another constant takes its place.
        """
        self._per_constant *= part
        self._described = None

    def absorb(
        self,
        altitude_first: float,
        altitude_second: float,
        density: float,
        sigma: float,
        per_constant: float = 0.0,
    ) -> None:
        """Add a measured mean density between two altitudes.

        Parameters
        ----------
        altitude_first, altitude_second : float
            m.
        density, sigma : float
            Mean density and its sigma, electrons per cubic metre.
        per_constant : float
            By how much the density is more where the constant of the contents is more, electrons
            per cubic metre and TECU.
        """
        low, high = sorted((altitude_first, altitude_second))
        middle, half_width = 0.5 * (low + high), 0.5 * max(high - low, _STEP)
        between = slice(
            np.searchsorted(self.altitude, middle - half_width),
            np.searchsorted(self.altitude, middle + half_width, "right"),
        )
        sample_weight = 1.0 / sigma**2
        weight = np.minimum(self._weight[between], _MEMORY_SAMPLES * sample_weight)
        weight = weight + sample_weight
        change = max(density, 0.0) - self.density[between]
        self.density = self.density.copy()
        self.density[between] += sample_weight / weight * change
        change_per_constant = per_constant - self._per_constant[between]
        self._per_constant[between] += sample_weight / weight * change_per_constant
        self._weight[between] = weight


@compiled
def _distances_from_peak(altitude, shape):  # type: ignore[no-untyped-def]
    """Return how far altitudes (n,), m, are from the peak of a layer of a shape, and what follows.

    `shape` holds the scale heights below and above the peak, and its altitude, m. Returned are of
    each altitude the row of its scale height in the shape, the distance from the peak, positive
    above it, in that height, and the exponential of the negative distance.
    """
    side = np.empty(len(altitude), dtype=np.int64)
    distance, exponential = np.empty(len(altitude)), np.empty(len(altitude))
    for row in range(len(altitude)):
        side[row] = 0 if altitude[row] < shape[2] else 1
        distance[row] = (altitude[row] - shape[2]) / shape[side[row]]
        exponential[row] = math.exp(-distance[row])
    return side, distance, exponential


@compiled
def _changed_shape(shape, factor, change):  # type: ignore[no-untyped-def]
    """Return a shape within its limits, (3,), whose heights are multiplied by factors (2,)."""
    changed = np.empty(3)
    for place in range(2):
        changed[place] = shape[place] * factor[place]
    changed[2] = shape[2] + PEAK_UNIT * change
    for place in range(3):
        if changed[place] < _SMALLEST_SHAPE[place]:
            changed[place] = _SMALLEST_SHAPE[place]
        elif changed[place] > _LARGEST_SHAPE[place]:
            changed[place] = _LARGEST_SHAPE[place]
    return changed


@compiled
def _with_layer(density, weight, distance, exponential, scale):  # type: ignore[no-untyped-def]
    """Return densities (n,), those of a layer of a size where none was measured.

    `distance` and `exponential` are those of `_distances_from_peak`.
    """
    result = np.empty(len(density))
    for row in range(len(density)):
        if weight[row] > 0.0:
            result[row] = density[row]
        else:
            # Chapman (1931), alpha layer: exp((1 - z - exp(-z)) / 2).
            layer = math.exp(0.5 * (1.0 - distance[row] - exponential[row]))
            result[row] = scale * layer
    return result


@compiled
def _with_derivatives(  # type: ignore[no-untyped-def]
    density, weight, side, distance, exponential, shape, per_constant
):
    """Return densities (n,) and their derivatives, (6, n), see `RunningProfile.densities`.

    `weight` is positive where the density was measured; `side`, `distance`, `exponential` and
    `shape` are those of `_distances_from_peak`.
    """
    result = np.zeros((6, len(density)))
    for row in range(len(density)):
        result[0, row] = density[row]
        if weight[row] > 0.0:
            result[CONSTANT, row] = per_constant[row]
            continue
        result[SIZE, row] = density[row]
        slope = 0.5 * density[row] * (1.0 - exponential[row])
        result[2 + side[row], row] = distance[row] * slope
        result[4, row] = slope * PEAK_UNIT / shape[side[row]]
    return result


@compiled
def mean_between(low, high, altitude, density):  # type: ignore[no-untyped-def]
    """Return the mean of a density (n,), linear between its altitudes (n,), between two of them."""
    before, after = np.interp(np.array([low, high]), altitude, density)
    if high - low < _SMALLEST_SEPARATION:
        return before
    start, total = low, 0.0
    first, end = np.searchsorted(altitude, low, "right"), np.searchsorted(altitude, high)
    for row in range(first, end):
        total += 0.5 * (before + density[row]) * (altitude[row] - start)
        before, start = density[row], altitude[row]
    return (total + 0.5 * (before + after) * (high - start)) / (high - low)


@compiled
def means_of_samples(low, high, altitude, densities):  # type: ignore[no-untyped-def]
    """Return the means of the rows of densities (k, n) at two altitudes and those between, (k,)."""
    first = np.searchsorted(altitude, low, "right")
    end = max(first, np.searchsorted(altitude, high))  # less where both are the same altitude
    ends = np.array([low, high])
    means = np.empty(len(densities))
    for k in range(len(densities)):
        total = np.interp(ends, altitude, densities[k]).sum() + densities[k, first:end].sum()
        means[k] = total / (2 + end - first)
    return means
