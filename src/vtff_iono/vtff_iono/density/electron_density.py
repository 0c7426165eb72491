"""Electron density between two spacecraft from their differential TEC.

The deputy flies dh above the chief (below it for a negative dh). The slant content of a satellite
differs between them for three reasons:

    S_deputy - S_chief = b + (1 + a) G - N dh / sin(E).

- b is one constant for all satellites: inter-frequency phase biases of the receivers, and integers
  of the reference satellite.
- G is the difference that the layer above makes, because the two spacecraft see a satellite at
  different elevations.
- The last term contains the electrons between the two altitudes. A layer that begins at the
  receiver is crossed at the elevation E of the ray there, along dh / sin(E), and not along the
  mapping factor of everything above.

G is computed through the running profile: measured densities where the orbit has been, a layer
model elsewhere. The error of G is modelled as a common factor 1 + a, which is estimated, and as a
noise in proportion to G. A Kalman filter estimates b, which is constant, a, which changes slowly,
and N, which is new each second. Low satellites separate b from N; satellites ahead and behind show
a.

A density well below zero is impossible: it is pulled to zero, which is information about b.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU
from vtff_iono.bias.running_profile import RunningProfile
from vtff_iono.geometry.satellite_geometry import ELEVATION_MASK_DEG

__all__ = ["DensityEpoch", "DensitySettings", "ElectronDensityEstimator"]


@dataclass(frozen=True)
class DensitySettings:
    """Assumptions of the filter.

    Parameters
    ----------
    elevation_mask : float
        Lowest elevation of a satellite at both spacecraft, rad.
    bias_sigma_tecu, bias_walk_tecu : float
        Sigma of b at first, TECU, and its random walk, TECU per square root of s.
    mapping_sigma, mapping_walk : float
        Sigma of a at first, and its random walk per square root of s.
    mapping_noise : float
        Sigma of the error of G that is not common to all satellites, as a fraction of G.
    separation_minimum : float
        Smallest vertical separation at which a density is estimated, m.
    negative_sigmas : float
        A density this many sigmas below zero is impossible.
    """

    elevation_mask: float = math.radians(ELEVATION_MASK_DEG)
    bias_sigma_tecu: float = 100.0
    bias_walk_tecu: float = 1e-6
    mapping_sigma: float = 0.1
    mapping_walk: float = 0.002
    mapping_noise: float = 0.01
    separation_minimum: float = 20.0
    negative_sigmas: float = 2.0


@dataclass(frozen=True, eq=False)
class DensityEpoch:
    """Density between the spacecraft at one epoch; arrays of shape (n,), a row for each satellite.

    Parameters
    ----------
    altitude : float
        Altitude of the middle of the two spacecraft, m.
    separation : float
        Altitude of the deputy less that of the chief, m.
    density, sigma : float
        Density from all satellites and its sigma, electrons per cubic metre; NaN where there is no
        estimate.
    density_satellite, sigma_satellite : ndarray
        Density from each satellite alone, with the common b and a, and its sigma; NaN for a
        satellite that is not used.
    bias_tecu, bias_sigma_tecu : float
        The constant b and its sigma, TECU.
    """

    altitude: float
    separation: float
    density: float
    sigma: float
    density_satellite: FloatArray
    sigma_satellite: FloatArray
    bias_tecu: float
    bias_sigma_tecu: float


class ElectronDensityEstimator:
    """Density between two spacecraft, second by second.

    Parameters
    ----------
    settings : DensitySettings
    profile : RunningProfile, optional
        Profile to start from; a model layer by default.
    """

    def __init__(
        self,
        settings: DensitySettings = DensitySettings(),  # noqa: B008 - frozen
        profile: RunningProfile | None = None,
    ) -> None:
        self.profile = profile or RunningProfile()
        self._settings = settings
        self._last_time: float | None = None
        # State: b in TECU, a, density in TECU per metre.
        self._state = np.zeros(3)
        self._covariance = np.zeros((3, 3))
        self.reset_bias()

    def reset_bias(self) -> None:
        """Forget b, because the integers have another datum."""
        self._state[0] = 0.0
        self._covariance[0, :] = self._covariance[:, 0] = 0.0
        self._covariance[0, 0] = self._settings.bias_sigma_tecu**2
        if self._last_time is None:
            self._covariance[1, 1] = self._settings.mapping_sigma**2

    def update(
        self,
        time: float,
        altitude_chief: float,
        altitude_deputy: float,
        elevation_chief: npt.ArrayLike,
        elevation_deputy: npt.ArrayLike,
        differential_stec_tecu: npt.ArrayLike,
        sigma_tecu: npt.ArrayLike,
        vtec_chief_tecu: float = math.nan,
    ) -> DensityEpoch:
        """Return the density of one epoch.

        Parameters
        ----------
        time : float
            s from any origin, increasing.
        altitude_chief, altitude_deputy : float
            Altitudes above the ellipsoid, m.
        elevation_chief, elevation_deputy : array_like, shape (n,)
            Elevations of the satellites at both spacecraft, above the plane normal to the
            ellipsoid normal, rad.
        differential_stec_tecu, sigma_tecu : array_like, shape (n,)
            Slant content of the deputy less that of the chief, and its sigma, TECU; NaN for a
            satellite without.
        vtec_chief_tecu : float
            Absolute vertical content above the chief, TECU; NaN if unknown. The model layer is
            scaled to it.
        """
        settings = self._settings
        if math.isfinite(vtec_chief_tecu) and vtec_chief_tecu > 0.0:
            self.profile.scale_model(altitude_chief, vtec_chief_tecu)
        elevations = np.array([elevation_chief, elevation_deputy], dtype=float)
        observed = np.asarray(differential_stec_tecu, dtype=float)
        sigma = np.asarray(sigma_tecu, dtype=float)
        separation = altitude_deputy - altitude_chief
        middle = 0.5 * (altitude_chief + altitude_deputy)
        used = (
            np.isfinite(observed)
            & np.isfinite(sigma)
            & (elevations >= settings.elevation_mask).all(axis=0)
        )
        nothing = np.full(len(observed), np.nan)
        if not used.any() or abs(separation) < settings.separation_minimum:
            return self._result(middle, separation, math.nan, math.nan, nothing, nothing)
        design = self._design(elevations[:, used], altitude_chief, altitude_deputy)
        geometric = design[:, 1]
        residual = observed[used] - geometric
        variance = sigma[used] ** 2 + (settings.mapping_noise * geometric) ** 2
        self._predict(time)
        self._correct(design, residual, variance)
        self._keep_positive()
        density = float(self._state[2]) * ELECTRONS_PER_TECU
        density_sigma = math.sqrt(self._covariance[2, 2]) * ELECTRONS_PER_TECU
        if math.isfinite(density_sigma):
            self.profile.absorb(altitude_chief, altitude_deputy, density, density_sigma)
        single, single_sigma = nothing.copy(), nothing.copy()
        single[used], single_sigma[used] = self._satellite_densities(design, residual, variance)
        return self._result(middle, separation, density, density_sigma, single, single_sigma)

    def predicted_stec(
        self,
        altitude_chief: float,
        altitude_deputy: float,
        elevation_chief: npt.ArrayLike,
        elevation_deputy: npt.ArrayLike,
    ) -> FloatArray:
        """Return the differential contents that the last estimate predicts, TECU, shape (n,).

        Arguments as in `update`.
        """
        elevations = np.array([elevation_chief, elevation_deputy], dtype=float)
        design = self._design(elevations, altitude_chief, altitude_deputy)
        return np.asarray(design[:, 1] + design @ self._state)

    def _design(
        self, elevations: FloatArray, altitude_chief: float, altitude_deputy: float
    ) -> FloatArray:
        """Return the derivatives of the contents with respect to b, a and density, shape (n, 3).

        The derivative with respect to a is the modelled content: G, and the density of the profile
        between the spacecraft.
        """
        separation = altitude_deputy - altitude_chief
        modelled = self.profile.mean_density(altitude_chief, altitude_deputy)
        path = separation / np.sin(elevations.mean(axis=0))
        geometric = self._geometric(elevations, altitude_chief, altitude_deputy)
        geometric += modelled / ELECTRONS_PER_TECU * path
        return np.stack((np.ones(len(path)), geometric, -path), axis=-1)

    def _geometric(
        self, elevations: FloatArray, altitude_chief: float, altitude_deputy: float
    ) -> FloatArray:
        """Return the difference of the contents above both spacecraft in the profile, TECU."""
        deputy = self.profile.slant_content(elevations[1], altitude_deputy)
        return deputy - self.profile.slant_content(elevations[0], altitude_chief)

    def _predict(self, time: float) -> None:
        settings = self._settings
        elapsed = 0.0 if self._last_time is None else max(0.0, time - self._last_time)
        self._last_time = time
        self._covariance[0, 0] += settings.bias_walk_tecu**2 * elapsed
        self._covariance[1, 1] += settings.mapping_walk**2 * elapsed
        self._covariance[1, 1] = min(self._covariance[1, 1], settings.mapping_sigma**2)
        # The density is new at each epoch; it is below 1e14 / m3 with certainty.
        self._state[2] = 0.0
        self._covariance[2, :] = self._covariance[:, 2] = 0.0
        self._covariance[2, 2] = (1e14 / ELECTRONS_PER_TECU) ** 2

    def _correct(self, design: FloatArray, residual: FloatArray, variance: FloatArray) -> None:
        """Update the state with uncorrelated observations; the covariance stays symmetric."""
        predicted = self._covariance @ design.T
        innovation = design @ predicted + np.diag(variance)
        gain = np.linalg.solve(innovation, predicted.T).T
        self._state = self._state + gain @ (residual - design @ self._state)
        left = np.eye(3) - gain @ design
        self._covariance = left @ self._covariance @ left.T + (gain * variance) @ gain.T

    def _keep_positive(self) -> None:
        """Pull an impossible density to zero."""
        sigma = math.sqrt(self._covariance[2, 2])
        if self._state[2] < -self._settings.negative_sigmas * sigma:
            self._correct(np.array([[0.0, 0.0, 1.0]]), np.zeros(1), np.array([sigma**2]))

    def _satellite_densities(
        self, design: FloatArray, residual: FloatArray, variance: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the density from each satellite alone and its sigma, electrons per cubic metre."""
        common = design[:, :2]
        density = (residual - common @ self._state[:2]) / design[:, 2]
        spread = np.einsum("ni,ij,nj->n", common, self._covariance[:2, :2], common)
        sigma = np.sqrt(variance + spread) / np.abs(design[:, 2])
        return density * ELECTRONS_PER_TECU, sigma * ELECTRONS_PER_TECU

    def _result(
        self,
        altitude: float,
        separation: float,
        density: float,
        sigma: float,
        single: FloatArray,
        single_sigma: FloatArray,
    ) -> DensityEpoch:
        return DensityEpoch(
            altitude=altitude,
            separation=separation,
            density=density,
            sigma=sigma,
            density_satellite=single,
            sigma_satellite=single_sigma,
            bias_tecu=float(self._state[0]),
            bias_sigma_tecu=math.sqrt(self._covariance[0, 0]),
        )
