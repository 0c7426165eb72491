"""The density profile that an orbit has measured so far, on top of a layer model."""

from __future__ import annotations

import numpy as np

from vtff_dynamics.constants import WGS84_SEMI_MAJOR_AXIS
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU
from vtff_iono.geometry.mapping import profile_content

__all__ = ["RunningProfile"]

_STEP = 1e3
_LOWEST, _DENSE_TOP, _HIGHEST = 100e3, 800e3, 2000e3
_TOP_STEP = 20e3
# A pass counts as much as this many of its samples, so that the next one can correct it.
_MEMORY_SAMPLES = 10.0
_SCALE_GAIN = 0.05
_CONTENT_TECU = 20.0


class RunningProfile:
    """Electron density against altitude: measured where the orbit has been, modelled elsewhere.

    The model is a Chapman layer whose size follows the vertical content. It only serves to map
    slant rays; where spacecraft have measured, the measurement takes its place.

    Parameters
    ----------
    peak_altitude, scale_height_bottom, scale_height_top : float
        Of the model, m.

    Attributes
    ----------
    altitude : ndarray, shape (n,)
        m, increasing.
    density : ndarray, shape (n,)
        Electrons per cubic metre.
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
        height = np.where(self.altitude < peak_altitude, scale_height_bottom, scale_height_top)
        argument = (self.altitude - peak_altitude) / height
        # Chapman (1931), alpha layer: exp((1 - z - exp(-z)) / 2).
        self.density: FloatArray = np.exp(0.5 * (1.0 - argument - np.exp(-argument)))
        self.density *= _CONTENT_TECU / self.content_above(_LOWEST)
        self._weight = np.zeros(len(self.altitude))

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
        if high - low < 1.0:
            return float(np.interp(low, self.altitude, self.density))
        content = self.content_above(low) - self.content_above(high)
        return content * ELECTRONS_PER_TECU / (high - low)

    def scale_model(self, altitude: float, vtec_tecu: float) -> None:
        """Scale what is not measured towards a vertical content above an altitude (m)."""
        measured = self._weight > 0.0
        kept = self.density
        self.density = np.where(measured, kept, 0.0)
        known = self.content_above(altitude)
        self.density = np.where(measured, 0.0, kept)
        modelled = self.content_above(altitude)
        self.density = kept
        if modelled <= 0.0:
            return
        wanted = max(vtec_tecu - known, 0.05 * vtec_tecu) / modelled
        gain = 1.0 if not measured.any() else _SCALE_GAIN
        self.density = np.where(measured, kept, kept * (1.0 + gain * (wanted - 1.0)))

    def absorb(
        self, altitude_first: float, altitude_second: float, density: float, sigma: float
    ) -> None:
        """Take in a mean density between two altitudes (m) with its sigma."""
        low, high = sorted((altitude_first, altitude_second))
        middle, half = 0.5 * (low + high), 0.5 * max(high - low, _STEP)
        chosen = np.abs(self.altitude - middle) <= half
        new = 1.0 / sigma**2
        weight = np.minimum(self._weight[chosen], _MEMORY_SAMPLES * new)
        weight = weight + new
        change = max(density, 0.0) - self.density[chosen]
        self.density = self.density.copy()
        self.density[chosen] += new / weight * change
        self._weight[chosen] = weight
