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
(`vtff_iono.density.filter.slow_errors`), so that the sigma of N is that of the data.

A satellite whose content is not what all others and its own past predict is left out: its integers
are wrong. A density well below zero is impossible: it is pulled to zero, which is information about
b. A density that the data do not tell is withheld.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_iono.bias.running_profile import RunningProfile
from vtff_iono.density.filter import second
from vtff_iono.density.filter.content_design import elevation_functions, empty_rays
from vtff_iono.density.filter.kernels import (
    COMMON,
    LAYER,
    WITHOUT_PAST,
    find_contradictions,
)
from vtff_iono.density.filter.settings import DensitySettings, filter_settings
from vtff_iono.density.filter.slow_errors import SlowErrors

__all__ = ["DensityEpoch", "ElectronDensityEstimator"]

# TECU; a constant that is known to less is told apart from the next pair of integers, see
# `DensitySettings.outlier_tecu`.
_KNOWN_BIAS = 0.2
# Satellites in a second for whose rays there is room at first.
_ROOM = 16


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
        self.slow_errors = SlowErrors()
        self._filter_settings = filter_settings(settings)
        covariance = np.zeros((COMMON, COMMON))
        layer = list(LAYER)
        covariance[layer, layer] = self._filter_settings.first_variance
        self._table = second.FilterTable(
            np.zeros(COMMON),
            covariance,
            np.zeros(0, dtype=np.int64),
            np.zeros(0),
            np.array([math.nan, self.slow_errors.sigma**2, 0.0, 0.0]),
        )
        self._rays = empty_rays(4 * _ROOM + 1, len(self.profile.altitude))
        self.reset_bias()

    @property
    def _state(self) -> FloatArray:
        return self._table.state

    @property
    def _covariance(self) -> FloatArray:
        return self._table.covariance

    def reset_bias(self) -> None:
        """Forget b, because the integers have another datum."""
        self._table.memory[second.IS_BIAS_NEW] = 1.0
        self._table.memory[second.IS_CHECKED] = 0.0
        self.profile.loosen_constant(0.0)
        self._state[0] = 0.0
        self._covariance[0, :] = self._covariance[:, 0] = 0.0
        self._covariance[0, 0] = self._settings.bias_sigma_tecu**2

    def shift_bias(self, change_tecu: float) -> None:
        """Take integers into account by which all contents are larger than before, TECU."""
        self._state[0] += change_tecu

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
        observed = _as_rows(differential_stec_tecu)
        sigma = _as_rows(sigma_tecu)
        chief, deputy = _as_rows(elevation_chief), _as_rows(elevation_deputy)
        numbers = np.arange(len(observed)) if satellite is None else _as_numbers(satellite)
        separation = altitude_deputy - altitude_chief
        middle = 0.5 * (altitude_chief + altitude_deputy)
        if abs(separation) < self._settings.separation_minimum:
            return self._without_density(middle, separation, len(observed))
        time = float(time)
        used, count, is_arranged = second.choose_contents(
            self._table,
            time,
            chief,
            deputy,
            observed,
            sigma,
            numbers,
            self._settings.elevation_mask,
        )
        if not count:
            return self._without_density(middle, separation, len(observed))
        if not is_arranged:
            self._arrange(time, numbers[used])
        self._reserve(len(observed))
        independent = (
            np.ones(len(observed), dtype=bool)
            if is_independent is None
            else np.asarray(is_independent, dtype=bool)
        )
        is_told, values, rows, is_outlier, learned = second.update_second(
            self._table,
            self._filter_settings,
            self.profile.table,
            self.slow_errors.table,
            self._rays,
            time,
            float(altitude_chief),
            float(altitude_deputy),
            *elevation_functions(chief, deputy),
            observed,
            sigma,
            numbers,
            used,
            float(vtec_chief_tecu),
            float(vtec_sigma_tecu),
            float(horizontal_sigma_tecu),
            independent,
            float(constant_sigma_tecu),
        )
        if not is_told:
            return self._without_density(middle, separation, len(observed))
        second.update_model(
            self._table,
            self.profile.table,
            np.exp(self._state[second.HEIGHTS]),
            float(altitude_chief),
            float(altitude_deputy),
            learned,
        )
        return _epoch(middle, separation, values, rows, is_outlier)

    def past_density(
        self,
        elapsed: float,
        altitude_chief: float,
        altitude_deputy: float,
        elevation_chief: FloatArray,
        elevation_deputy: FloatArray,
        differential_stec_tecu: FloatArray,
        sigma_tecu: FloatArray,
        satellite: npt.ArrayLike,
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
        separation = altitude_deputy - altitude_chief
        middle = 0.5 * (altitude_chief + altitude_deputy)
        nothing = self._without_density(middle, separation, len(differential_stec_tecu))
        chief, deputy = _as_rows(elevation_chief), _as_rows(elevation_deputy)
        observed, sigma = _as_rows(differential_stec_tecu), _as_rows(sigma_tecu)
        numbers = _as_numbers(satellite)
        now = copy.deepcopy(self._table)
        used, count, _ = second.choose_contents(
            now, math.nan, chief, deputy, observed, sigma, numbers, self._settings.elevation_mask
        )
        if not (self._table.memory[second.IS_CHECKED] and count):
            return nothing
        self._reserve(len(observed))
        is_told, values, rows, is_outlier = second.past_second(
            now,
            self._filter_settings,
            self.profile.table,
            self.slow_errors.table,
            self._rays,
            float(elapsed),
            float(altitude_chief),
            float(altitude_deputy),
            *elevation_functions(chief, deputy),
            observed,
            sigma,
            numbers,
            used,
            float(horizontal_sigma_tecu),
        )
        return _epoch(middle, separation, values, rows, is_outlier) if is_told else nothing

    @property
    def has_bias(self) -> bool:
        """Whether contents have told anything of b."""
        return not self._table.memory[second.IS_BIAS_NEW]

    @property
    def is_bias_known(self) -> bool:
        """Whether satellites enough have agreed on b, and it is known to less than an integer."""
        is_checked = bool(self._table.memory[second.IS_CHECKED])
        return is_checked and bool(self._covariance[0, 0] < _KNOWN_BIAS**2)

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
        if not time <= self._table.memory[second.LAST_TIME]:
            self._arrange(time, np.zeros(0, dtype=np.int64))
            second.pass_to(
                self._table,
                self._filter_settings,
                self.profile.table,
                self.slow_errors.table,
                float(time),
            )
        chief, deputy = _as_rows(elevation_chief), _as_rows(elevation_deputy)
        numbers = np.arange(len(chief)) if satellite is None else _as_numbers(satellite)
        self._reserve(len(chief))
        contents, spread = second.predicted_contents(
            self._table,
            self._filter_settings,
            self.profile.table,
            self.slow_errors.table,
            self._rays,
            float(altitude_chief),
            float(altitude_deputy),
            *elevation_functions(chief, deputy),
            numbers,
        )
        return contents, spread

    def _reserve(self, satellites: int) -> None:
        """Have room for a second of satellites."""
        self.slow_errors.reserve(satellites)
        # Rays of contents that are measured, of those that are predicted, and that to the zenith.
        if len(self._rays.perigee) < 4 * satellites + 1:
            self._rays = empty_rays(8 * satellites + 1, len(self.profile.altitude))

    def _arrange(self, time: float, satellites: npt.NDArray[np.int64]) -> None:
        """Give each satellite that is observed a place in the state, forget those long gone."""
        old = self._table
        seen = dict(zip(old.satellite.tolist(), old.seen.tolist(), strict=True))
        seen |= dict.fromkeys(satellites.tolist(), time)
        seen = {number: last for number, last in seen.items() if time - last < second.KEPT}
        place = {number: COMMON + row for row, number in enumerate(old.satellite.tolist())}
        if seen.keys() == place.keys():
            old.seen[:] = list(seen.values())
            return
        size = COMMON + len(seen)
        state, covariance = np.zeros(size), np.zeros((size, size))
        source = [*range(COMMON), *(place[number] for number in seen if number in place)]
        to = [row for row, number in enumerate(seen, COMMON) if number in place]
        to = [*range(COMMON), *to]
        state[to] = old.state[source]
        covariance[np.ix_(to, to)] = old.covariance[np.ix_(source, source)]
        for row, number in enumerate(seen, COMMON):
            if number not in place:
                covariance[row, row] = self.slow_errors.sigma**2
        self._table = second.FilterTable(
            state,
            covariance,
            np.array(list(seen), dtype=np.int64),
            np.array(list(seen.values()), dtype=float),
            old.memory,
        )

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
        found: npt.NDArray[np.bool_] = find_contradictions(
            innovation,
            covariance,
            unknown,
            self._settings.outlier_sigmas,
            self._settings.outlier_tecu,
        )
        return found

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


def _as_rows(values: npt.ArrayLike) -> FloatArray:
    """Return numbers of satellites as compiled functions want them."""
    return np.ascontiguousarray(values, dtype=float)


def _as_numbers(satellites: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Return numbers of satellites as compiled functions want them."""
    return np.ascontiguousarray(satellites, dtype=np.int64)


def _epoch(
    altitude: float,
    separation: float,
    values: FloatArray,
    rows: FloatArray,
    is_outlier: npt.NDArray[np.bool_],
) -> DensityEpoch:
    """Return the epoch that compiled functions have told; arguments as of `update_second`."""
    density, sigma, fast, slow_time, common, bias, bias_sigma = values.tolist()
    return DensityEpoch(
        altitude=altitude,
        separation=separation,
        density=density,
        sigma=sigma,
        fast_sigma=fast,
        slow_time=slow_time,
        slow_parts=rows[2],
        common_sigma=common,
        density_satellite=rows[0],
        sigma_satellite=rows[1],
        is_outlier=is_outlier,
        bias_tecu=bias,
        bias_sigma_tecu=bias_sigma,
    )
