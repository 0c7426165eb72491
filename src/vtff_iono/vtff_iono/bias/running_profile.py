"""The density profile that an orbit has measured so far, completed by a model of the layer."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import WGS84_SEMI_MAJOR_AXIS
from vtff_dynamics.vectors import FloatArray
from vtff_iono.geometry.mapping import profile_content

__all__ = [
    "CONSTANT",
    "PEAK_UNIT",
    "SHAPE",
    "SIZE",
    "ProfileTable",
    "RunningProfile",
    "absorb_density",
    "mean_between",
    "means_of_samples",
    "move_constant",
    "reshape_and_resize",
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


class ProfileTable(NamedTuple):
    """The arrays of a `RunningProfile`, which compiled functions change in place.

    Attributes
    ----------
    altitude : ndarray, shape (n,)
        m, increasing.
    densities : ndarray, shape (6, n)
        As in `RunningProfile.densities`.
    weight : ndarray, shape (n,)
        Sum of one over the variances of what was measured, zero where nothing was.
    shape : ndarray, shape (3,)
        Scale heights of the model below and above its peak, and altitude of the peak, m.
    scale : ndarray, shape (1,)
        Factor of the model, electrons per cubic metre.
    """

    altitude: FloatArray
    densities: FloatArray
    weight: FloatArray
    shape: FloatArray
    scale: FloatArray


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
    table : ProfileTable
    """

    def __init__(
        self,
        peak_altitude: float = 375e3,
        scale_height_bottom: float = 55e3,
        scale_height_top: float = 65e3,
    ) -> None:
        altitude = np.concatenate(
            (
                np.arange(_LOWEST, _DENSE_TOP, _STEP),
                np.arange(_DENSE_TOP, _HIGHEST + _TOP_STEP, _TOP_STEP),
            )
        )
        self.table = ProfileTable(
            altitude,
            np.zeros((CONSTANT + 1, len(altitude))),
            np.zeros(len(altitude)),
            np.array([scale_height_bottom, scale_height_top, peak_altitude]),
            np.ones(1),
        )
        self.resize(1.0)
        self.resize(_CONTENT_TECU / self.content_above(_LOWEST))

    @property
    def altitude(self) -> FloatArray:
        """Altitudes of the table, m, increasing, shape (n,)."""
        return self.table.altitude

    @property
    def density(self) -> FloatArray:
        """Density at these altitudes, electrons per cubic metre, (n,); it changes in place."""
        return np.asarray(self.table.densities[0])

    def densities(self) -> FloatArray:
        """Return the density and its derivatives, shape (6, n).

        The derivatives are those with respect to the logarithm of the size of the model (row
        `SIZE`), to its shape in the units of `reshape` (`SHAPE`), both zero where the density was
        measured, and to the constant of the contents that were measured, TECU (`CONSTANT`), zero
        elsewhere.
        """
        return np.array(self.table.densities)

    def reshape(self, change: FloatArray) -> None:
        """Change the shape of the model.

        Parameters
        ----------
        change : ndarray, shape (3,)
            Changes of the logarithms of the scale heights below and above the peak, and of the
            altitude of the peak in units of `PEAK_UNIT`.
        """
        reshape_and_resize(self.table, np.exp(change[:2]), float(change[2]), 1.0)

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
        reshape_and_resize(self.table, np.ones(2), 0.0, factor)

    def move_constant(self, change: float) -> None:
        """Correct what was measured: the constant is more by a change, TECU, than was believed."""
        move_constant(self.table, change)

    def loosen_constant(self, part: float) -> None:
        """Let only a part of what the constant proves to be off be so since the measurements.

        The part is that of the variance of the constant before it has drifted; it is zero where
        another constant takes its place.
        """
        self.table.densities[CONSTANT] *= part

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
        absorb_density(self.table, altitude_first, altitude_second, density, sigma, per_constant)


@compiled
def move_constant(table, change):  # type: ignore[no-untyped-def]
    """Correct what a table has measured; arguments as in `RunningProfile.move_constant`."""
    density, per_constant = table.densities[0], table.densities[CONSTANT]
    for row in range(len(density)):
        if per_constant[row] != 0.0:
            density[row] = max(density[row] + change * per_constant[row], 0.0)


@compiled
def absorb_density(  # type: ignore[no-untyped-def]
    table, altitude_first, altitude_second, density, sigma, per_constant
):
    """Add a measured density to a table; arguments as in `RunningProfile.absorb`."""
    low, high = min(altitude_first, altitude_second), max(altitude_first, altitude_second)
    middle, half_width = 0.5 * (low + high), 0.5 * max(high - low, _STEP)
    first = np.searchsorted(table.altitude, middle - half_width)
    end = np.searchsorted(table.altitude, middle + half_width, "right")
    sample_weight = 1.0 / sigma**2
    densities = table.densities
    for row in range(first, end):
        weight = min(table.weight[row], _MEMORY_SAMPLES * sample_weight) + sample_weight
        part = sample_weight / weight
        densities[0, row] += part * (max(density, 0.0) - densities[0, row])
        densities[CONSTANT, row] += part * (per_constant - densities[CONSTANT, row])
        # The model and its derivatives end where a density was measured.
        for kind in range(SIZE, CONSTANT):
            densities[kind, row] = 0.0
        table.weight[row] = weight


@compiled
def reshape_and_resize(table, height_factors, change_of_peak, factor):  # type: ignore[no-untyped-def]
    """Change the shape and the size of the model of a table; see `reshape` and `resize`.

    Scale heights are multiplied by `height_factors`, (2,). The modelled densities, and the
    derivatives of them, are computed anew.
    """
    shape, densities = table.shape, table.densities
    shape[:2] *= height_factors
    shape[2] += PEAK_UNIT * change_of_peak
    for place in range(3):
        shape[place] = min(max(shape[place], _SMALLEST_SHAPE[place]), _LARGEST_SHAPE[place])
    scale, peak = table.scale[0], shape[2]
    table.scale[0] *= factor
    middle = np.searchsorted(table.altitude, peak)
    for side in range(2):
        rows = slice(0, middle) if side == 0 else slice(middle, len(table.altitude))
        altitude, weight, height = table.altitude[rows], table.weight[rows], shape[side]
        density, of_size, of_peak = densities[0, rows], densities[SIZE, rows], densities[4, rows]
        of_height, of_other = densities[2 + side, rows], densities[3 - side, rows]
        for row in range(len(altitude)):
            if weight[row] > 0.0:
                continue
            distance = (altitude[row] - peak) / height
            exponential = math.exp(-distance)
            # Chapman (1931), alpha layer: exp((1 - z - exp(-z)) / 2).
            value = scale * math.exp(0.5 * (1.0 - distance - exponential)) * factor
            slope = 0.5 * value * (1.0 - exponential)
            density[row] = of_size[row] = value
            of_height[row], of_other[row] = distance * slope, 0.0
            of_peak[row] = slope * PEAK_UNIT / height


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
