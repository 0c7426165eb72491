"""The density profile that an orbit has measured so far, completed by a model of the layer."""

from __future__ import annotations

import numpy as np

from vtff_dynamics.constants import WGS84_SEMI_MAJOR_AXIS
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU
from vtff_iono.geometry.mapping import profile_content

__all__ = ["PEAK_UNIT", "RunningProfile"]

PEAK_UNIT = 100e3
"""Unit of a change of the altitude of the peak, m."""

# Altitudes of the table, m: fine steps up to the highest orbits, coarse steps above.
_STEP, _TOP_STEP = 1e3, 20e3
_LOWEST, _DENSE_TOP, _HIGHEST = 100e3, 800e3, 2000e3
# All samples so far together count as much as this many samples, so that the next pass can correct
# the density.
_MEMORY_SAMPLES = 10.0
# Fraction of the difference by which the model follows the vertical content.
_SCALE_GAIN = 0.05
# The model keeps at least this fraction of the vertical content.
_SMALLEST_FRACTION = 0.05
# Vertical content of the model at first, TECU.
_CONTENT_TECU = 20.0
# m; scale heights below and above the peak, and altitude of the peak.
_SMALLEST_SHAPE, _LARGEST_SHAPE = (15e3, 15e3, 200e3), (150e3, 200e3, 600e3)
# Two altitudes that are closer than this, m, are the same.
_SMALLEST_SEPARATION = 1.0


class RunningProfile:
    """Electron density against altitude: measured where the orbit has been, modelled elsewhere.

    The model is a Chapman layer whose size follows the vertical content, and whose shape can be
    changed (`reshape`). It only serves to map slant rays; where spacecraft have measured the
    density, the measurement replaces it.

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
        self._scale = 1.0
        self.density: FloatArray = self._layer()
        self._scale = _CONTENT_TECU / self.content_above(_LOWEST)
        self.density = self._layer()
        self._weight = np.zeros(len(self.altitude))

    def _argument(self) -> tuple[FloatArray, FloatArray]:
        """Return heights above the peak in scale heights, and these scale heights, m."""
        bottom, top, peak = self._shape.tolist()
        height = np.where(self.altitude < peak, bottom, top)
        return (self.altitude - peak) / height, height

    def _layer(self) -> FloatArray:
        """Return the density of the model."""
        argument, _ = self._argument()
        # Chapman (1931), alpha layer: exp((1 - z - exp(-z)) / 2).
        layer = np.exp(0.5 * (1.0 - argument - np.exp(-argument)))
        return np.asarray(self._scale * layer)

    def shape_densities(self) -> FloatArray:
        """Return by how much a change of shape, of one unit, changes the density, shape (3, n).

        The units are those of `reshape`; where the density was measured it does not change.
        """
        argument, height = self._argument()
        slope = np.where(self._weight > 0.0, 0.0, 0.5 * self.density * (1.0 - np.exp(-argument)))
        is_bottom = argument < 0.0
        of_height = argument * slope
        return np.stack(
            (
                np.where(is_bottom, of_height, 0.0),
                np.where(is_bottom, 0.0, of_height),
                slope * PEAK_UNIT / height,
            )
        )

    def reshape(self, change: FloatArray) -> None:
        """Change the shape of the model.

        Parameters
        ----------
        change : ndarray, shape (3,)
            Changes of the logarithms of the scale heights below and above the peak, and of the
            altitude of the peak in units of `PEAK_UNIT`.
        """
        heights = self._shape[:2] * np.exp(change[:2])
        peak = self._shape[2] + PEAK_UNIT * change[2]
        limited = np.clip([*heights, peak], _SMALLEST_SHAPE, _LARGEST_SHAPE)
        self._shape = np.asarray(limited)
        self.density = np.where(self._weight > 0.0, self.density, self._layer())

    def slant_shape_contents(self, elevation: FloatArray, altitude: float) -> FloatArray:
        """Return contents as `slant_content`, of each of `shape_densities`, shape (3, ...)."""
        radius = WGS84_SEMI_MAJOR_AXIS + altitude
        return np.stack(
            [
                profile_content(elevation, radius, self.altitude, density)
                for density in self.shape_densities()
            ]
        )

    def content_above(self, altitude: float) -> float:
        """Return the vertical content above an altitude (m), TECU."""
        radius = WGS84_SEMI_MAJOR_AXIS + altitude
        return float(profile_content(0.5 * np.pi, radius, self.altitude, self.density))

    def slant_content(self, elevation: FloatArray, altitude: float) -> FloatArray:
        """Return the contents of rays from an altitude (m) at elevations (rad), TECU."""
        radius = WGS84_SEMI_MAJOR_AXIS + altitude
        return profile_content(elevation, radius, self.altitude, self.density)

    def mean_density(self, altitude_first: float, altitude_second: float) -> float:
        """Return the mean density between two altitudes (m), electrons per cubic metre."""
        low, high = sorted((altitude_first, altitude_second))
        if high - low < _SMALLEST_SEPARATION:
            return float(np.interp(low, self.altitude, self.density))
        content = self.content_above(low) - self.content_above(high)
        return content * ELECTRONS_PER_TECU / (high - low)

    def mean_shape_densities(self, altitude_first: float, altitude_second: float) -> FloatArray:
        """Return the means of `shape_densities` between two altitudes (m), shape (3,)."""
        low, high = sorted((altitude_first, altitude_second))
        inside = self.altitude[(self.altitude > low) & (self.altitude < high)]
        altitude = np.concatenate(([low], inside, [high]))
        return np.array(
            [
                np.interp(altitude, self.altitude, density).mean()
                for density in self.shape_densities()
            ]
        )

    def scale_model(self, altitude: float, vtec_tecu: float) -> None:
        """Scale the modelled densities towards a vertical content above an altitude (m)."""
        is_measured = self._weight > 0.0
        density = self.density
        self.density = np.where(is_measured, density, 0.0)
        measured_content = self.content_above(altitude)
        self.density = np.where(is_measured, 0.0, density)
        modelled_content = self.content_above(altitude)
        self.density = density
        if modelled_content <= 0.0:
            return
        remaining = max(vtec_tecu - measured_content, _SMALLEST_FRACTION * vtec_tecu)
        ratio = remaining / modelled_content
        gain = _SCALE_GAIN if is_measured.any() else 1.0
        factor = 1.0 + gain * (ratio - 1.0)
        self._scale *= factor
        self.density = np.where(is_measured, density, density * factor)

    def absorb(
        self, altitude_first: float, altitude_second: float, density: float, sigma: float
    ) -> None:
        """Add a measured mean density between two altitudes (m), with its sigma, 1/m3."""
        low, high = sorted((altitude_first, altitude_second))
        middle, half_width = 0.5 * (low + high), 0.5 * max(high - low, _STEP)
        is_between = np.abs(self.altitude - middle) <= half_width
        sample_weight = 1.0 / sigma**2
        weight = np.minimum(self._weight[is_between], _MEMORY_SAMPLES * sample_weight)
        weight = weight + sample_weight
        change = max(density, 0.0) - self.density[is_between]
        self.density = self.density.copy()
        self.density[is_between] += sample_weight / weight * change
        self._weight[is_between] = weight
