"""Electron density between two spacecraft from their differential TEC.

The deputy flies dh above the chief (below it for a negative dh). The slant content of a satellite
differs between them for three reasons:

    S_deputy - S_chief = b + (1 + c) (G + a G') - N dh / sin(E) + m.

- b is one constant for all satellites: inter-frequency phase biases of the receivers, and integers
  of the reference satellite.
- G is the difference that the layer above makes, because the two spacecraft see a satellite at
  different elevations; G' is the part of it that has not been measured.
- The last term contains the electrons between the two altitudes. A layer that begins at the
  receiver is crossed at the elevation E of the ray there, along dh / sin(E), and not along the
  mapping factor of everything above.

- m is a slow error of each satellite, such as multipath.

G is computed through the running profile: measured densities where the orbit has been, a layer
model elsewhere. The model layer has another size, by the factor 1 + a, and another shape (its scale
heights and the altitude of its peak), which are estimated. What was measured has the error that b
had then: all of it is corrected as b becomes better known, and the filter knows that G changes with
b. The ionosphere of another time and place differs by a common factor 1 + c; what else G errs by is
a noise in proportion to it. Absolute contents above the chief tell of the layer as well, with their
sigma. A Kalman filter estimates b, which drifts with the temperature of the receivers, a, c, the
shape and m, which change slowly, and N, which is new each second. Low satellites separate b from N;
satellites ahead and behind show a and c. How large m is and how fast it changes is measured
(`vtff_iono.density.slow_errors`), so that the sigma of N is that of the data.

A satellite whose content is not what all others and its own past predict is left out: its integers
are wrong. A density well below zero is impossible: it is pulled to zero, which is information about
b. A density that the data do not tell is withheld.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU
from vtff_iono.bias.running_profile import RunningProfile
from vtff_iono.density import kernels
from vtff_iono.density.content_design import content_design, vertical_design
from vtff_iono.density.kernels import (
    CHANGE,
    COMMON,
    DENSITY,
    FIRST_SHAPE,
    LAYER,
    SHAPE_NUMBERS,
    WITHOUT_PAST,
)
from vtff_iono.density.slow_errors import SlowErrors
from vtff_iono.geometry.satellite_geometry import ELEVATION_MASK_DEG

__all__ = ["DensityEpoch", "DensitySettings", "ElectronDensityEstimator", "compile_kernels"]

# Places of the shape of the layer in the state, and those of all that describes the layer.
_SHAPE = slice(FIRST_SHAPE, FIRST_SHAPE + SHAPE_NUMBERS)
_LAYER = np.array(LAYER)
# Cosine of the elevation of the zenith.
_COSINE_OF_ZENITH = np.cos(np.array([0.5 * math.pi]))
# Sigma of the shape of the layer, in its units, and of c, of which only the contents tell.
_ANY_SHAPE = 1.0
# s; a satellite that was not observed for longer has no slow error that is remembered.
_KEPT = 600.0
# TECU; a constant that is known to less is told apart from the next pair of integers, see
# `DensitySettings.outlier_tecu`.
_KNOWN_BIAS = 0.2
# Electrons per cubic metre; a density may differ from a profile without any by this much.
_LEAST_SPREAD = 1e11
# TECU; a cycle of both signals more, 0.52 TECU, is hidden in more noise than this.
_LARGEST_NOISE = 0.2
# A size of the layer that is known to this fraction is given to the model.
_KNOWN_MAPPING = 0.2


@dataclass(frozen=True)
class DensitySettings:
    """Assumptions of the filter.

    Parameters
    ----------
    elevation_mask : float
        Lowest elevation of a satellite at both spacecraft, rad.
    bias_sigma_tecu, bias_walk_tecu : float
        Sigma of b at first, TECU, and its random walk, TECU per square root of s. Lines of two
        receivers and two signals that drift smoothly by 0.5 mm in a quarter of an orbit.
    mapping_sigma, mapping_walk : float
        Sigma of a at first, and the random walk of a and c per square root of s.
    change_sigma : float
        Sigma of c, which never exceeds it.
    content_time : float
        Time over which the error of absolute contents is the same, s: that of the receiver bias.
    shape_sigma, shape_walk : float
        Sigma of the logarithms of the scale heights of the model layer below and above its peak,
        and of the altitude of the peak in units of `PEAK_UNIT`; their random walk per square root
        of s. Contents are linear in the shape for changes of this size only.
    mapping_noise : float
        Sigma of the error of G that is not common to all satellites, as a fraction of G.
    separation_minimum : float
        Smallest vertical separation at which a density is estimated, m.
    negative_sigmas : float
        A density this many sigmas below zero is impossible.
    gradient_sigma_tecu_per_deg : float
        Horizontal gradient of the vertical content between the spacecraft, along their track,
        until the contents of all directions have shown how large gradients are.
    outlier_sigmas, outlier_tecu : float
        A content that is off by more than both is none of this satellite with these integers: a
        cycle of both signals is 0.5, other pairs of small integers are 0.24 TECU and more.
    density_sigma : float
        A priori sigma of the density of each epoch, electrons per cubic metre: far more than there
        is, because what all epochs together would learn from it must be nothing.
    largest_sigma : float
        A density with a larger sigma is withheld, electrons per cubic metre.
    spare_satellites : int
        A density is withheld, and nothing is learned from its contents, unless there are so many
        satellites more than states in common that are not known: a single wrong integer could not
        be told from the right ones. A satellite whose noise hides a wrong integer does not count,
        nor does one whose content has just chosen its integers.
        What the past has told to better than `outlier_tecu` is known, as a rule b and a, once as
        many satellites as are needed without a past have agreed.
    """

    elevation_mask: float = math.radians(ELEVATION_MASK_DEG)
    bias_sigma_tecu: float = 100.0
    bias_walk_tecu: float = 1e-4
    mapping_sigma: float = 2.0
    mapping_walk: float = 0.002
    change_sigma: float = 0.1
    content_time: float = 3600.0
    shape_sigma: float = 0.15
    shape_walk: float = 0.003
    mapping_noise: float = 0.01
    separation_minimum: float = 20.0
    negative_sigmas: float = 2.0
    gradient_sigma_tecu_per_deg: float = 0.02
    outlier_sigmas: float = 5.0
    outlier_tecu: float = 0.1
    density_sigma: float = 1e14
    largest_sigma: float = 1e12
    spare_satellites: int = 2


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
    fast_sigma, slow_time : float
        Sigma of the errors of the density that are independent from epoch to epoch, electrons per
        cubic metre, and correlation time of the slow ones, s. An error of b, which hardly changes,
        is in `common_sigma`.
    slow_parts : ndarray
        By how much one sigma of the slow error of each satellite moves the density, electrons per
        cubic metre: where other satellites are used, the slow error is another one at once.
    common_sigma : float
        Sigma of the rest, which all epochs share: errors of b, a, c and of the shape of the layer.
    density_satellite, sigma_satellite : ndarray
        Density from each satellite alone, with the common b and a, and its sigma; NaN for a
        satellite that is not used.
    is_outlier : ndarray of bool
        Which satellites contradict the others and their own past, and were left out.
    bias_tecu, bias_sigma_tecu : float
        The constant b and its sigma, TECU.
    """

    altitude: float
    separation: float
    density: float
    sigma: float
    fast_sigma: float
    slow_time: float
    slow_parts: FloatArray
    common_sigma: float
    density_satellite: FloatArray
    sigma_satellite: FloatArray
    is_outlier: npt.NDArray[np.bool_]
    bias_tecu: float
    bias_sigma_tecu: float


class ElectronDensityEstimator:
    """Density between two spacecraft, second by second.

    Parameters
    ----------
    settings : DensitySettings
    profile : RunningProfile, optional
        Profile to start from; a model layer by default.

    Attributes
    ----------
    profile : RunningProfile
    slow_errors : SlowErrors
        What has been measured of the errors m.
    """

    def __init__(
        self,
        settings: DensitySettings = DensitySettings(),  # noqa: B008 - frozen
        profile: RunningProfile | None = None,
    ) -> None:
        self.profile = profile or RunningProfile()
        self._settings = settings
        self._last_time: float | None = None
        self.slow_errors = SlowErrors()
        self._slow_variance = self.slow_errors.sigma**2
        self._density_variance = (settings.density_sigma / ELECTRONS_PER_TECU) ** 2
        # Variance that each common state gains in a second; none that the slow errors gain.
        self._walk = np.zeros(COMMON + 1)
        self._walk[0] = settings.bias_walk_tecu**2
        self._walk[1] = self._walk[CHANGE] = settings.mapping_walk**2
        self._walk[_SHAPE] = settings.shape_walk**2
        # State: b in TECU, a, density in TECU per metre, shape of the layer (see
        # `DensitySettings`), c, and m of each satellite in TECU.
        self._state = np.zeros(COMMON)
        self._covariance = np.zeros((COMMON, COMMON))
        # Index in the state of each satellite, and when it was last observed.
        self._index: dict[int, int] = {}
        self._seen: dict[int, float] = {}
        sigmas = [settings.mapping_sigma, *[settings.shape_sigma] * 3, settings.change_sigma]
        # Variances of what describes the layer before any content.
        self._first_variance = np.array(sigmas) ** 2
        self._covariance[_LAYER, _LAYER] = self._first_variance
        # Sigmas of common states of which only the contents tell.
        self._loose_sigma = np.full(COMMON, math.inf)
        self._loose_sigma[_LAYER] = settings.mapping_sigma, *[_ANY_SHAPE] * 4
        self.reset_bias()

    def reset_bias(self) -> None:
        """Forget b, because the integers have another datum."""
        self._is_bias_new = True
        self._is_checked = False
        self.profile.loosen_constant(0.0)
        self._state[0] = 0.0
        self._covariance[0, :] = self._covariance[:, 0] = 0.0
        self._covariance[0, 0] = self._settings.bias_sigma_tecu**2

    def shift_bias(self, change_tecu: float) -> None:
        """Take integers into account by which all contents are larger than before, TECU."""
        self._state[0] += change_tecu

    def _add_content(
        self, altitude: float, vtec_tecu: float, sigma_tecu: float, elapsed: float
    ) -> None:
        """Learn from an absolute content how large the layer above an altitude (m) is.

        Its error is that of the receiver bias and hardly changes: all contents of `content_time`
        together count as one.
        """
        if not (math.isfinite(vtec_tecu) and 0.0 < sigma_tecu < math.inf and elapsed > 0.0):
            return
        design, modelled = vertical_design(
            _COSINE_OF_ZENITH,
            altitude,
            self.profile.altitude,
            self.profile.densities(),
            self._state,
        )
        repeated = max(1.0, 2.0 * self._settings.content_time / elapsed)
        self._correct(
            design, np.array([vtec_tecu - modelled]), np.array([repeated * sigma_tecu**2])
        )

    def _correct(
        self, design: FloatArray, residual: FloatArray, variance: FloatArray
    ) -> FloatArray:
        """Update state, covariance and what was measured with the same constant; return the gain.

        Arguments as in `kernels.correct`.
        """
        before = float(self._state[0])
        gain: FloatArray = kernels.correct(
            self._state, self._covariance, design, residual, variance
        )
        self.profile.move_constant(float(self._state[0]) - before)
        return gain

    def _update_model(self) -> None:
        """Let the model layer have the size and the shape that are estimated."""
        self.profile.reshape(self._state[_SHAPE])
        self._state[_SHAPE] = 0.0
        factor = 1.0 + float(self._state[1])
        is_known = self._covariance[1, 1] < (_KNOWN_MAPPING * factor) ** 2
        if is_known and factor > 0.0:
            self.profile.resize(factor)
            self._state[1] = 0.0
            self._covariance[1, :] /= factor
            self._covariance[:, 1] /= factor

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
        vtec_sigma_tecu: float = math.nan,
        satellite: npt.ArrayLike | None = None,
        horizontal_sigma_tecu: float = 0.0,
        is_independent: npt.ArrayLike | None = None,
        constant_sigma_tecu: float = 0.0,
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
            Slant content of the deputy less that of the chief, and the sigma of its fast errors,
            TECU; NaN for a satellite without.
        vtec_chief_tecu, vtec_sigma_tecu : float
            Absolute vertical content above the chief and its sigma, TECU; NaN if unknown.
        satellite : array_like of int, shape (n,), optional
            Numbers of the satellites; by default each row has its own satellite.
        horizontal_sigma_tecu : float
            Sigma of the difference of the vertical contents of both places at one altitude, TECU:
            it counts as density, and only the sigma knows.
        is_independent : array_like of bool, shape (n,), optional
            Whether a content tells whether others are right; by default all do. One whose integers
            it has chosen itself does not.
        constant_sigma_tecu : float
            Sigma of what all contents may be off by together because their integers are wrong
            alike, TECU: only the sigmas of the densities know.
        """
        settings = self._settings
        elevations = np.array([elevation_chief, elevation_deputy], dtype=float)
        observed = np.asarray(differential_stec_tecu, dtype=float)
        sigma = np.asarray(sigma_tecu, dtype=float)
        numbers = np.arange(len(observed)) if satellite is None else np.asarray(satellite)
        separation = altitude_deputy - altitude_chief
        middle = 0.5 * (altitude_chief + altitude_deputy)
        used = self._is_used(elevations, observed, sigma)
        if not used.any() or abs(separation) < settings.separation_minimum:
            return self._without_density(middle, separation, len(observed))
        numbers_used: list[int] = numbers[used].tolist()
        elapsed = self._predict(time, numbers_used)
        self._add_content(altitude_chief, vtec_chief_tecu, vtec_sigma_tecu, elapsed)
        common, modelled = self._design(_columns(elevations, used), altitude_chief, altitude_deputy)
        residual = observed[used] - modelled
        fast_variance = sigma[used] ** 2 + (settings.mapping_noise * common[:, CHANGE]) ** 2
        if self._is_bias_new:
            # It contains integers and may be anything: the first contents tell where it is.
            self._is_bias_new = False
            self._state[0] = float(np.median(residual))
        places = self._places(numbers_used)
        independent = (
            np.ones(len(residual), dtype=bool)
            if is_independent is None
            else np.asarray(is_independent, dtype=bool)[used]
        )
        design, kept, count, has_check = self._examine(
            common, places, residual, fast_variance, independent
        )
        if self._is_checked and not has_check:
            return self._without_density(middle, separation, len(observed))
        chosen = _index_of(kept)
        self.slow_errors.add(
            time,
            numbers[used][chosen],
            residual[chosen],
            common[chosen],
            self._loose_sigma,
            fast_variance[chosen],
        )
        gain = self._correct(design[chosen], residual[chosen], fast_variance[chosen])
        self._keep_positive()
        epoch, per_constant = self._epoch(
            middle,
            separation,
            used,
            kept,
            common,
            residual,
            fast_variance,
            gain,
            horizontal_sigma_tecu,
        )
        self._update_model()
        self._is_checked |= count >= WITHOUT_PAST + settings.spare_satellites
        if not (has_check and epoch.sigma <= settings.largest_sigma):
            return replace(epoch, density=math.nan, sigma=math.nan)
        self.profile.absorb(
            altitude_chief,
            altitude_deputy,
            epoch.density,
            epoch.sigma,
            per_constant * ELECTRONS_PER_TECU,
        )
        if constant_sigma_tecu > 0.0:
            # With another constant all that was learned is another one too.
            shift = constant_sigma_tecu * ELECTRONS_PER_TECU
            paths = np.full(len(observed), math.nan)
            paths[used] = np.abs(common[:, DENSITY])
            epoch = replace(
                epoch,
                sigma=math.hypot(epoch.sigma, shift * float(gain[DENSITY].sum())),
                sigma_satellite=np.hypot(epoch.sigma_satellite, shift / paths),
            )
        return epoch

    def past_density(
        self,
        elapsed: float,
        altitude_chief: float,
        altitude_deputy: float,
        elevation_chief: FloatArray,
        elevation_deputy: FloatArray,
        differential_stec_tecu: FloatArray,
        sigma_tecu: FloatArray,
        satellite: Sequence[int],
        horizontal_sigma_tecu: float = 0.0,
    ) -> DensityEpoch:
        """Return the density of an epoch before the last one, from what is known now.

        It serves where integers have been found only later. Nothing is learned from the contents.

        Parameters
        ----------
        elapsed : float
            Time since then, s.
        altitude_chief, altitude_deputy, elevation_chief, elevation_deputy : float or ndarray
            As in `update`, like all that follow.
        """
        now = copy.copy(self)
        now._state, now._covariance = self._state.copy(), self._covariance.copy()
        now._forget_density()
        elevations = np.array([elevation_chief, elevation_deputy])
        separation = altitude_deputy - altitude_chief
        middle = 0.5 * (altitude_chief + altitude_deputy)
        used = self._is_used(elevations, differential_stec_tecu, sigma_tecu)
        nothing = now._without_density(middle, separation, len(used))
        if not (self._is_checked and used.any()):
            return nothing
        common, modelled = now._design(_columns(elevations, used), altitude_chief, altitude_deputy)
        residual = differential_stec_tecu[used] - modelled
        places = now._places(np.asarray(satellite)[used].tolist())
        # The slow errors of then are not all those of now.
        lost = 1.0 - math.exp(-2.0 * elapsed / self.slow_errors.correlation_time)
        variance = sigma_tecu[used] ** 2
        variance += (self._settings.mapping_noise * common[:, CHANGE]) ** 2
        variance += np.where(places < 0, 1.0, lost) * self.slow_errors.sigma**2
        independent = np.ones(len(residual), dtype=bool)
        design, kept, _, has_check = now._examine(common, places, residual, variance, independent)
        if not has_check:
            return nothing
        gain = kernels.correct(
            now._state, now._covariance, design[kept], residual[kept], variance[kept]
        )
        epoch, _ = now._epoch(
            middle,
            separation,
            used,
            kept,
            common,
            residual,
            variance,
            gain,
            horizontal_sigma_tecu,
        )
        return epoch if epoch.sigma <= self._settings.largest_sigma else nothing

    def _examine(
        self,
        common: FloatArray,
        places: npt.NDArray[np.int64],
        residual: FloatArray,
        fast_variance: FloatArray,
        is_independent: npt.NDArray[np.bool_],
    ) -> tuple[FloatArray, npt.NDArray[np.bool_], int, bool]:
        """Compare contents with each other and the past; raise variances (TECU^2, in place).

        Returns the design, which contents are kept, how many of these check the others, and whether
        they are enough for that. Arguments are those of `kernels.compare`, contents less those that
        are modelled, TECU, and those of `update`.
        """
        settings = self._settings
        design, innovation, spread, is_wrong, is_any_off, unknown = kernels.examine(
            common,
            places,
            self._state,
            self._covariance,
            residual,
            fast_variance,
            self._is_checked,
            settings.outlier_sigmas,
            settings.outlier_tecu,
        )
        kept = ~is_wrong
        if self._is_checked and is_any_off:
            of_kept = spread[np.ix_(kept, kept)]
            fast_variance[kept] += self._unsaid_variance(innovation[kept], of_kept, unknown)
        # Where noise hides a wrong integer, a satellite checks nothing.
        checks = kept & is_independent & (fast_variance < _LARGEST_NOISE**2)
        count = int(np.count_nonzero(checks))
        return design, kept, count, count >= unknown + settings.spare_satellites

    def _epoch(
        self,
        altitude: float,
        separation: float,
        used: npt.NDArray[np.bool_],
        kept: npt.NDArray[np.bool_],
        common: FloatArray,
        residual: FloatArray,
        fast_variance: FloatArray,
        gain: FloatArray,
        horizontal_sigma_tecu: float,
    ) -> tuple[DensityEpoch, float]:
        """Return what the state tells of an epoch, and how its density changes with b, 1/m.

        Some of all satellites are `used`, and some of these `kept`; the other arrays are those of
        the satellites that are used, `gain` that of those that are kept.
        """
        outliers = np.zeros(len(used), dtype=bool)
        outliers[np.flatnonzero(used)[~kept]] = True
        single, single_sigma = np.full((2, len(used)), np.nan)
        chosen = _index_of(kept)
        rows = np.flatnonzero(used)[chosen]
        variances = fast_variance[chosen]
        single[rows], single_sigma[rows] = ELECTRONS_PER_TECU * kernels.satellite_densities(
            common[chosen],
            residual[chosen],
            variances + self.slow_errors.sigma**2,
            self._state,
            self._covariance,
        )
        variance = float(self._covariance[DENSITY, DENSITY])
        fast = float(gain[DENSITY] ** 2 @ variances)
        # What the past tells of slow errors is no error any more.
        parts = self.slow_errors.sigma * gain[DENSITY]
        left = max(variance - fast, 0.0) / max(float(parts @ parts), 1e-30)
        slow_parts = np.zeros(len(used))
        slow_parts[rows] = parts * math.sqrt(min(left, 1.0)) * ELECTRONS_PER_TECU
        common_variance = max(variance - fast - min(left, 1.0) * float(parts @ parts), 0.0)
        total = variance + (horizontal_sigma_tecu / separation) ** 2
        epoch = DensityEpoch(
            altitude=altitude,
            separation=separation,
            density=float(self._state[DENSITY]) * ELECTRONS_PER_TECU,
            sigma=math.sqrt(total) * ELECTRONS_PER_TECU,
            fast_sigma=math.sqrt(fast) * ELECTRONS_PER_TECU,
            slow_time=self.slow_errors.correlation_time,
            slow_parts=slow_parts,
            common_sigma=math.sqrt(common_variance) * ELECTRONS_PER_TECU,
            density_satellite=single,
            sigma_satellite=single_sigma,
            is_outlier=outliers,
            bias_tecu=float(self._state[0]),
            bias_sigma_tecu=math.sqrt(self._covariance[0, 0]),
        )
        return epoch, float(self._covariance[DENSITY, 0] / self._covariance[0, 0])

    @property
    def has_bias(self) -> bool:
        """Whether contents have told anything of b."""
        return not self._is_bias_new

    @property
    def is_bias_known(self) -> bool:
        """Whether satellites enough have agreed on b, and it is known to less than an integer."""
        return self._is_checked and bool(self._covariance[0, 0] < _KNOWN_BIAS**2)

    def predicted_stec(
        self,
        time: float,
        altitude_chief: float,
        altitude_deputy: float,
        elevation_chief: npt.ArrayLike,
        elevation_deputy: npt.ArrayLike,
        satellite: npt.ArrayLike | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the differential contents that are predicted, TECU, (n,), and their covariance.

        Arguments as in `update`. At the time of the last update its density is used; later, and
        where that was hardly told, the density is that of the profile to as much again. A satellite
        that was observed before keeps its slow error: what it has now is compared with the level
        that it had.
        """
        if self._last_time is None or time > self._last_time:
            self._predict(time, [])
        elevations = np.array([elevation_chief, elevation_deputy], dtype=float)
        numbers = np.arange(elevations.shape[1]) if satellite is None else np.asarray(satellite)
        common, modelled = self._design(elevations, altitude_chief, altitude_deputy)
        places = self._places(numbers.tolist())
        own = np.where(places < 0, self.slow_errors.sigma**2, 0.0)
        own += (self._settings.mapping_noise * common[:, CHANGE]) ** 2
        # The density of the profile, and its own size.
        density = self.profile.mean_density(altitude_chief, altitude_deputy) / ELECTRONS_PER_TECU
        contents, spread = kernels.likely_contents(
            common,
            modelled,
            places,
            self._state,
            self._covariance,
            own,
            density,
            (density + _LEAST_SPREAD / ELECTRONS_PER_TECU) ** 2,
        )
        return contents, spread

    def _is_used(
        self, elevations: FloatArray, observed: FloatArray, sigma: FloatArray
    ) -> npt.NDArray[np.bool_]:
        """Return which contents are known and come from high enough, shape (n,)."""
        lowest = np.minimum(elevations[0], elevations[1])
        used = np.isfinite(observed) & np.isfinite(sigma)
        return np.asarray(used & (lowest >= self._settings.elevation_mask))

    def _design(
        self, elevations: FloatArray, altitude_chief: float, altitude_deputy: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return derivatives (n, COMMON) and modelled contents, TECU, see `content_design`."""
        common, modelled = content_design(
            np.cos(elevations),
            np.sin(0.5 * (elevations[0] + elevations[1])),
            altitude_chief,
            altitude_deputy,
            self.profile.altitude,
            self.profile.densities(),
            self._state,
        )
        return common, modelled

    def _places(self, satellites: list[int]) -> npt.NDArray[np.int64]:
        """Return the places of the slow errors of satellites in the state; -1 for none."""
        return np.array([self._index.get(number, -1) for number in satellites], dtype=np.int64)

    def _predict(self, time: float, satellites: list[int]) -> float:
        """Predict the state at a time; return how long that is after the last one, s."""
        elapsed = 0.0 if self._last_time is None else max(0.0, time - self._last_time)
        self._last_time = time
        self._seen |= dict.fromkeys(satellites, time)
        self._arrange(time)
        # What the errors of measurements prove to be changes what was learned from them.
        variance = self.slow_errors.sigma**2
        ratio = variance / self._slow_variance
        self._slow_variance = variance
        decay = math.exp(-elapsed / self.slow_errors.correlation_time)
        gained = self._walk * elapsed
        gained[COMMON] = variance * (1.0 - decay * decay)
        # What the constant has drifted by since is no error of what was measured before.
        known = float(self._covariance[0, 0])
        self.profile.loosen_constant(known / (known + float(gained[0])))
        kernels.predict(
            self._state,
            self._covariance,
            ratio,
            decay,
            gained,
            self._first_variance,
            self._density_variance,
        )
        return elapsed

    def _forget_density(self) -> None:
        """Forget the density, which is new at each epoch."""
        kernels.forget_density(self._state, self._covariance, self._density_variance)

    def _arrange(self, time: float) -> None:
        """Give each satellite that is observed a place in the state, forget those long gone."""
        self._seen = {number: last for number, last in self._seen.items() if time - last < _KEPT}
        if self._seen.keys() == self._index.keys():
            return
        old, size = self._index, COMMON + len(self._seen)
        self._index = {number: COMMON + row for row, number in enumerate(self._seen)}
        state, covariance = np.zeros(size), np.zeros((size, size))
        shared = [number for number in self._index if number in old]
        to = [*range(COMMON), *(self._index[number] for number in shared)]
        source = [*range(COMMON), *(old[number] for number in shared)]
        state[to] = self._state[source]
        covariance[np.ix_(to, to)] = self._covariance[np.ix_(source, source)]
        for number, place in self._index.items():
            if number not in old:
                covariance[place, place] = self.slow_errors.sigma**2
        self._state, self._covariance = state, covariance

    def find_outliers(
        self, innovation: FloatArray, covariance: FloatArray
    ) -> npt.NDArray[np.bool_]:
        """Return which contents contradict the others and their prediction, shape (n,).

        Parameters
        ----------
        innovation : ndarray, shape (n,)
            Contents less those of `predicted_stec`, TECU.
        covariance : ndarray, shape (n, n)
            Their covariance, TECU^2.
        """
        unknown = 1 if self.is_bias_known else WITHOUT_PAST
        found: npt.NDArray[np.bool_] = kernels.find_contradictions(
            innovation,
            covariance,
            unknown,
            self._settings.outlier_sigmas,
            self._settings.outlier_tecu,
        )
        return found

    def _unsaid_variance(
        self, innovation: FloatArray, covariance: FloatArray, unknown: int
    ) -> FloatArray:
        """Return the variances that contents must have beside those they came with, TECU^2, (n,).

        A content that contradicts the others by less than any integer makes has begun to fluctuate:
        within a second a fade that begins hardly shows. Arguments as in `find_outliers`; `unknown`
        states have no past.
        """
        variance = np.zeros(len(innovation))
        sigmas = self._settings.outlier_sigmas
        is_off = kernels.find_contradictions(innovation, covariance, unknown, sigmas, 0.0)
        if is_off.any():
            of_others = covariance[np.ix_(~is_off, ~is_off)]
            gain = np.linalg.solve(of_others, covariance[np.ix_(~is_off, is_off)]).T
            variance[is_off] = (innovation[is_off] - gain @ innovation[~is_off]) ** 2
        return variance

    def _keep_positive(self) -> None:
        """Pull an impossible density to zero."""
        sigma = math.sqrt(self._covariance[DENSITY, DENSITY])
        if self._state[DENSITY] < -self._settings.negative_sigmas * sigma:
            design = np.zeros((1, len(self._state)))
            design[0, DENSITY] = 1.0
            self._correct(design, np.zeros(1), np.array([sigma**2]))

    def _without_density(self, altitude: float, separation: float, count: int) -> DensityEpoch:
        nothing = np.full(count, np.nan)
        return DensityEpoch(
            altitude=altitude,
            separation=separation,
            density=math.nan,
            sigma=math.nan,
            fast_sigma=math.nan,
            slow_time=math.nan,
            slow_parts=np.zeros(count),
            common_sigma=math.nan,
            density_satellite=nothing,
            sigma_satellite=nothing.copy(),
            is_outlier=np.zeros(count, dtype=bool),
            bias_tecu=float(self._state[0]),
            bias_sigma_tecu=math.sqrt(self._covariance[0, 0]),
        )


def _index_of(chosen: npt.NDArray[np.bool_]) -> slice | npt.NDArray[np.bool_]:
    """Return an index of chosen rows: of all, as a rule, it is one that makes no copy."""
    return slice(None) if chosen.all() else chosen


def _columns(rows: FloatArray, chosen: npt.NDArray[np.bool_]) -> FloatArray:
    """Return the chosen columns of rows; the result is contiguous."""
    return np.asarray(rows.take(np.flatnonzero(chosen), axis=1))


def compile_kernels() -> None:
    """Compile the steps of the filter, which takes seconds without a cache."""
    estimator = ElectronDensityEstimator()
    elevation = np.linspace(0.5, 1.5, 6)
    contents, sigma, satellites = np.zeros(6), np.full(6, 0.01), list(range(6))
    altitudes, elevations = (400e3, 401e3), (elevation, elevation)
    for second in range(2):
        estimator.update(second, *altitudes, *elevations, contents, sigma, 10.0, 1.0, satellites)
        estimator.predicted_stec(second, *altitudes, *elevations, satellites)
    estimator.past_density(1.0, *altitudes, *elevations, contents, sigma, satellites)
