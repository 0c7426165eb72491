"""When each of two spacecraft crosses an edge, from the slopes of their slant contents.

In a dense layer the content of a satellite at elevation E changes by N dh / sin(E) while the
spacecraft climbs by dh; in an empty layer it does not. The edge is where the change begins or ends.

Scintillation moves contents by 0.06 TECU for seconds at a time, which hides the change. But its
pattern is nearly frozen: the spacecraft that comes second meets it a lag later, so that it cancels
in the lagged difference of the two,

    D(t) = S_deputy(t + lag) - S_chief(t),

while the two changes of slope remain: they happen at an altitude, not at a place. D and the mean M
of the two series have independent noise. Both are fitted together, each weighted by the density of
its noise at low frequencies, which its residuals show. The altitudes at which the two spacecraft
cross are two parameters, the width of the wall is the third; the times follow from the motion. What
is slow, above all the content above the edge, is noise whose size the contents themselves show
(`vtff_iono.edges.content_noise`). Without scintillation the fit is that of each spacecraft by
itself, because D and M are then only another basis of the two series.

Times are those of a wall in which the density changes linearly. The width is fitted once more, to
walls of each shape of `vtff_iono.edges.wall_width`, with noise that differs between the two sides
of the wall: scintillation is on one side. Its sigma contains what the contents do not tell of the
shape.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU
from vtff_iono.edges.content_noise import (
    MOST_MODES,
    SlowBasis,
    mode_variances,
    side_sigmas,
    slow_basis,
    white_sigma,
)
from vtff_iono.edges.wall_width import (
    WALL_SHAPES,
    WidthsByShape,
    combine_widths,
    shape_misfits,
    wall_integrals,
)
from vtff_iono.geometry.satellite_geometry import ELEVATION_MASK_DEG
from vtff_iono.scintillation.fluctuation_lag import series_lag

__all__ = ["ContentSeries", "EdgeCrossing", "fit_edge_crossings"]

_ELEVATION_MASK = math.radians(ELEVATION_MASK_DEG)
_LARGEST_LAG = 5.0
# Second differences over this time show scintillation; a change of slope is short in them.
_DIFFERENCE = 0.5
_LEAST_CORRELATION = 0.5
# Fraction of the window in which a satellite must have contents.
_COVERAGE = 0.7
# s; residuals are averaged over these times to find the density of their noise: that of
# scintillation, and while slow noise is not yet known that of multipath.
_NOISE_INTERVALS = (4.0, 10.0)
# The fit and the noise that its residuals show are found in turns, each fit in at most so many
# steps, which end where the sum of squares falls by less than this. A step that does not help is
# tried again so many times, shorter (Levenberg 1944, Marquardt 1963).
_FITS, _STEPS, _SHORTER = 3, 25, 6
_LEAST_DROP = 1e-3
_DAMPING, _LESS_DAMPING, _MORE_DAMPING = 1e-3, 0.2, 5.0
# Step of the parameters for derivatives; as a part where they are larger than one.
_PARAMETER_STEP = 1e-3
# m; altitudes that are searched to either side, more for a wide wall: this part of its width.
_SEARCH = 500.0
_SEARCH_OF_WIDTH = 0.3
_SEARCH_STEPS = 20
# The fit has gone astray if it ends farther from where the density has shown the edge, or with a
# wall that is wider by this factor than all that are tried.
_FARTHEST = 2.0
_WIDEST = 40e3
_LEAST_SIGNIFICANCE = 5.0
# Error of the altitude from what the model leaves out, m: the third order of density with depth;
# and of a wall that does not rise linearly, as a part of its width.
_MODEL_SIGMA = 5.0
_SHAPE_SIGMA = 0.02
# Depths are in km and altitudes in units of 100 m, so that all parameters are near one.
_DEPTH_UNIT = 1e3
_ALTITUDE_UNIT = 100.0
# m; width of the thinnest wall, and km: what is believed of the width beforehand.
_LEAST_WIDTH = 50.0
_WIDTH_PRIOR = 20.0


@dataclass(frozen=True, eq=False)
class ContentSeries:
    """Contents that one spacecraft observes with m satellites at n even instants.

    Parameters
    ----------
    altitude : ndarray, shape (n,)
        Altitude of the spacecraft above the ellipsoid, m; NaN where unknown.
    stec : ndarray, shape (m, n)
        Contents from phases, TECU; each arc has another constant. NaN where there is no phase.
    arc : ndarray of int, shape (m, n)
        Number of the arc, positive; 0 where there is no phase.
    elevation : ndarray, shape (m, n)
        Elevation of the satellite, rad.
    """

    altitude: FloatArray
    stec: FloatArray
    arc: npt.NDArray[np.int64]
    elevation: FloatArray


@dataclass(frozen=True, eq=False)
class EdgeCrossing:
    """An edge as chief and deputy have crossed it.

    Parameters
    ----------
    time, time_sigma : ndarray, shape (2,)
        Times of the crossings, counted as the times of the samples are, and their sigmas, s.
    time_covariance : float
        Covariance of both times, s^2: what is wrong of the wall is so for both.
    altitude, altitude_sigma : ndarray, shape (2,)
        Altitudes of the crossings, and their sigmas, m.
    density : float
        Density next to the edge on its dense side less that on the other side, electrons per cubic
        metre.
    significance : float
        Square root of the drop of chi-square that the edge makes.
    lag : float
        Time after which the deputy meets the scintillation of the chief, s; 0 without
        scintillation.
    width, width_sigma : float
        Width over which the density changes, and its sigma, m.
    widths : WidthsByShape
        Widths by the shape of the wall, with the sigma of their squares, in which contents are
        linear where the wall is thin.
    """

    time: FloatArray
    time_sigma: FloatArray
    time_covariance: float
    altitude: FloatArray
    altitude_sigma: FloatArray
    density: float
    significance: float
    lag: float
    width: float
    width_sigma: float
    widths: WidthsByShape


@dataclass(frozen=True, eq=False)
class _Noise:
    """Noise of D and M of m satellites.

    Parameters
    ----------
    slow : list of SlowBasis
        Constants of the arcs and polynomials, with the relative size of white noise.
    white : ndarray, shape (m, 2)
        Sigmas of white noise, TECU.
    modes : ndarray, shape (m, 2, MOST_MODES)
        Variances of polynomials by degree, TECU^2.
    """

    slow: list[SlowBasis]
    white: FloatArray
    modes: FloatArray

    @staticmethod
    def only_white(slow: list[SlowBasis], white: FloatArray) -> _Noise:
        """Return noise without slow parts."""
        return _Noise(slow, white, np.zeros((*white.shape, MOST_MODES)))

    def whiten(self, pairs: Iterable[FloatArray]) -> FloatArray:
        """Return D and M of all satellites, each of shape (2, k), in units of noise: (m,)."""
        return np.concatenate(
            [
                slow.whiten(pair, white, modes).ravel()
                for pair, slow, white, modes in zip(
                    pairs, self.slow, self.white, self.modes, strict=True
                )
            ]
        )


@dataclass(frozen=True, eq=False)
class _Satellite:
    """Lagged difference D and mean M of the contents of a satellite, and their model; k samples.

    Parameters
    ----------
    slow : SlowBasis
        Constants of the arcs and polynomials.
    observed : ndarray, shape (2, k)
        D and M, TECU.
    path : ndarray, shape (2, k)
        Paths of the rays of chief and deputy through a layer over its height.
    samples : ndarray of int, shape (k,), or None
        Which of the samples of the window these are; None for all.
    """

    slow: SlowBasis
    observed: FloatArray
    path: FloatArray
    samples: npt.NDArray[np.intp] | None

    def change(self, vertical: FloatArray) -> FloatArray:
        """Return what vertical contents in the window add to D and M, shape (2, k)."""
        of_satellite = vertical if self.samples is None else vertical[:, self.samples]
        return _difference_and_mean(self.path * of_satellite)


@dataclass(frozen=True, eq=False)
class _Wall:
    """Altitudes at which chief and deputy cross a wall, (2,), m, its width, m, and its shape."""

    altitude: FloatArray
    width: float
    shape: int


@dataclass(frozen=True, eq=False)
class _Fit:
    """A wall that was fitted.

    Parameters
    ----------
    wall : _Wall
    noise : _Noise
    covariance : ndarray, shape (2, 2)
        Covariance of the altitudes, m^2.
    square_sigma : float
        Sigma of the square of the width, m^2.
    change : float
        Density next to the wall, TECU per kilometre.
    significance : float
        Square root of the drop of chi-square.
    """

    wall: _Wall
    noise: _Noise
    covariance: FloatArray
    square_sigma: float
    change: float
    significance: float


@dataclass(frozen=True, eq=False)
class _Window:
    """Contents of both spacecraft about a crossing, to which walls are fitted.

    Parameters
    ----------
    altitude : ndarray, shape (2, n)
        Altitudes of chief and deputy, m.
    satellites : list of _Satellite
    """

    altitude: FloatArray
    satellites: list[_Satellite]

    def whitened(self, noise: _Noise) -> FloatArray:
        """Return D and M of all satellites in units of their noise, shape (m,)."""
        return noise.whiten(satellite.observed for satellite in self.satellites)

    def design(self, noise: _Noise, wall: _Wall, dense_side: float) -> FloatArray:
        """Return what the wall adds to `whitened`, shape (m, 2); see `_wall`."""
        return np.column_stack(
            [
                noise.whiten(satellite.change(vertical) for satellite in self.satellites)
                for vertical in self._wall(wall, dense_side)
            ]
        )

    def inside(self, wall: _Wall, dense_side: float) -> list[FloatArray]:
        """Return of each satellite which part of a wall the samples have crossed, (k,)."""
        depth = dense_side * (self.altitude.mean(axis=0) - wall.altitude.mean())
        part = np.clip(0.5 + depth / wall.width, 0.0, 1.0)
        return [
            part if satellite.samples is None else part[satellite.samples]
            for satellite in self.satellites
        ]

    def residuals(self, wall: _Wall, dense_side: float, change: FloatArray) -> list[FloatArray]:
        """Return D and M of each satellite less those of the wall, TECU."""
        first, second = self._wall(wall, dense_side)
        vertical = change[0] * first + change[1] * second
        return [satellite.observed - satellite.change(vertical) for satellite in self.satellites]

    def _wall(self, wall: _Wall, dense_side: float) -> tuple[FloatArray, FloatArray]:
        """Return contents of densities that are one and the depth, each of shape (2, n).

        Both times the part of the wall that is crossed: where a part of the density is missing,
        what is missing grows with the density itself.
        """
        depth = dense_side * (self.altitude - wall.altitude[:, np.newaxis]) / _DEPTH_UNIT
        return wall_integrals(wall.shape, depth, wall.width / _DEPTH_UNIT)


def fit_edge_crossings(
    time: npt.ArrayLike,
    chief: ContentSeries,
    deputy: ContentSeries,
    altitude: float,
    is_dense_above: bool,
    half_window: float = 40.0,
    width: float = 0.0,
    altitude_sigma: float = 0.0,
) -> EdgeCrossing | None:
    """Return when chief and deputy cross an edge; None if their contents do not show it.

    Parameters
    ----------
    time : array_like, shape (n,)
        Even instants, s.
    chief, deputy : ContentSeries
        Contents of both spacecraft, with equal satellites in equal rows.
    altitude : float
        Altitude of the edge to some hundred metres, or to `altitude_sigma`, m.
    is_dense_above : bool
        Whether the dense side of the edge is above it.
    half_window : float
        Time before and after the crossing whose contents are fitted, s.
    width : float
        Width of the wall to a factor of two, m.
    altitude_sigma : float
        Sigma of the altitude, m: the edge is looked for as far from there, at least.
    """
    instants = np.asarray(time, dtype=float)
    if len(instants) < 3 or not len(chief.stec):
        return None
    interval = float(instants[1] - instants[0])
    lag = _pattern_lag(chief, deputy, interval)
    later = _advance_series(deputy, lag / interval)
    middle = _crossing(instants, 0.5 * (chief.altitude + later.altitude), altitude)
    if not math.isfinite(middle):
        return None
    window = np.abs(instants - middle) <= half_window
    fitted_window = _window(instants - middle, chief, later, window, half_window)
    if not fitted_window.satellites:
        return None
    dense_side = 1.0 if is_dense_above else -1.0
    samples = tuple(max(1, round(time_of_mean / interval)) for time_of_mean in _NOISE_INTERVALS)
    reach = max(_SEARCH + _SEARCH_OF_WIDTH * width, altitude_sigma)
    fit = _fit(fitted_window, altitude, reach, width, dense_side, samples)
    if fit is None:
        return None
    widths = _widths(fitted_window, fit, dense_side, samples)
    if widths is None:
        return None
    fitted_width, width_sigma = combine_widths(widths)
    altitudes, covariance = fit.wall.altitude, fit.covariance
    # Contents are those above a spacecraft: they fall while it climbs.
    density = -dense_side * fit.change * ELECTRONS_PER_TECU / _DEPTH_UNIT
    far = float(np.abs(altitudes - altitude).max())
    is_near = far <= _FARTHEST * reach
    is_sharp = fit.wall.width <= _WIDEST
    is_shown = density > 0.0 and fit.significance >= _LEAST_SIGNIFICANCE
    if not (is_shown and is_near and is_sharp):
        return None
    tracks = (chief.altitude, deputy.altitude)
    times = [_crossing(instants, track, at) for track, at in zip(tracks, altitudes, strict=True)]
    speeds = [_speed(instants, track, at) for track, at in zip(tracks, times, strict=True)]
    if not np.isfinite(times + speeds).all():
        return None
    # The model is wrong by the same for both.
    covariance = covariance + (_MODEL_SIGMA + _SHAPE_SIGMA * fit.wall.width) ** 2
    altitude_sigmas = np.sqrt(np.diag(covariance))
    covariance /= np.outer(speeds, speeds)
    return EdgeCrossing(
        time=np.array(times),
        time_sigma=np.sqrt(np.diag(covariance)),
        time_covariance=float(covariance[0, 1]),
        altitude=altitudes,
        altitude_sigma=altitude_sigmas,
        density=density,
        significance=fit.significance,
        lag=lag,
        width=fitted_width,
        width_sigma=width_sigma,
        widths=widths,
    )


def _difference_and_mean(pair: FloatArray) -> FloatArray:
    """Return deputy less chief, and their mean, of rows chief and deputy."""
    result = np.empty(pair.shape)
    np.subtract(pair[1], pair[0], out=result[0])
    np.add(pair[0], pair[1], out=result[1])
    result[1] *= 0.5
    return result


def _pattern_lag(chief: ContentSeries, deputy: ContentSeries, interval: float) -> float:
    """Return the lag at which the deputy meets the scintillation of the chief, s; 0 if none."""
    step = max(1, round(_DIFFERENCE / interval))
    pattern = series_lag(
        _second_difference(chief, step),
        _second_difference(deputy, step),
        1.0 / interval,
        _LARGEST_LAG,
    )
    return pattern.lag if pattern.correlation > _LEAST_CORRELATION else 0.0


def _second_difference(series: ContentSeries, step: int) -> FloatArray:
    """Return second differences of contents within arcs, zero where they cannot be formed."""
    stec, arc = series.stec, series.arc
    change = stec[:, 2 * step :] - 2.0 * stec[:, step:-step] + stec[:, : -2 * step]
    whole = (arc[:, 2 * step :] == arc[:, step:-step]) & (arc[:, step:-step] == arc[:, : -2 * step])
    return np.where(whole & np.isfinite(change), change, 0.0)


def _advance_series(series: ContentSeries, samples: float) -> ContentSeries:
    """Return a series shifted by a number of samples, linearly interpolated between samples."""
    whole = math.floor(samples)
    fraction = samples - whole

    def interpolate(rows: FloatArray) -> FloatArray:
        before, after = _shift(rows, whole, np.nan), _shift(rows, whole + 1, np.nan)
        return before if fraction == 0.0 else (1.0 - fraction) * before + fraction * after

    arc = _shift(series.arc, whole, 0)
    if fraction > 0.0:
        arc = np.where(arc == _shift(series.arc, whole + 1, 0), arc, 0)
    return ContentSeries(
        interpolate(series.altitude),
        interpolate(series.stec),
        arc,
        interpolate(series.elevation),
    )


def _shift(rows: npt.NDArray, samples: int, fill: float) -> npt.NDArray:  # type: ignore[type-arg]
    """Return rows whose sample i is the old sample i + samples."""
    result = np.full_like(rows, fill)
    count = rows.shape[-1]
    kept = max(0, count - abs(samples))
    begin = max(0, samples)
    result[..., begin - samples : begin - samples + kept] = rows[..., begin : begin + kept]
    return result


def _crossing(time: FloatArray, altitude: FloatArray, at: float) -> float:
    """Return when a monotonic altitude reaches a value; NaN if it is unknown."""
    is_finite = np.isfinite(altitude)
    if np.count_nonzero(is_finite) < 2:
        return math.nan
    seconds, heights = time[is_finite], altitude[is_finite]
    order = 1 if heights[-1] > heights[0] else -1
    return float(np.interp(at, heights[::order], seconds[::order], left=np.nan, right=np.nan))


def _speed(time: FloatArray, altitude: FloatArray, at: float) -> float:
    """Return the vertical speed at a time, m/s, from two seconds around it."""
    is_finite = np.isfinite(altitude)
    before, after = np.interp([at - 1.0, at + 1.0], time[is_finite], altitude[is_finite])
    return float(0.5 * (after - before)) or math.nan


def _window(
    time_from_middle: FloatArray,
    chief: ContentSeries,
    later: ContentSeries,
    window: npt.NDArray[np.bool_],
    half_window: float,
) -> _Window:
    """Return the contents of each satellite that both spacecraft observe in a window."""
    satellites = []
    altitudes = np.stack((chief.altitude, later.altitude))
    usable = window & np.isfinite(altitudes).all(axis=0)
    samples = np.cumsum(usable) - 1
    for row in range(len(chief.stec)):
        stec = np.stack((chief.stec[row], later.stec[row]))
        elevation = np.stack((chief.elevation[row], later.elevation[row]))
        arcs = np.stack((chief.arc[row], later.arc[row]))
        good = usable & (arcs > 0).all(axis=0) & np.isfinite(stec + elevation).all(axis=0)
        if np.count_nonzero(good) < _COVERAGE * np.count_nonzero(window):
            continue
        if elevation[:, good].min() < _ELEVATION_MASK:
            continue
        _, arc = np.unique(arcs[:, good], axis=1, return_inverse=True)
        # The constant is not needed, and digits are lost by it.
        content = stec[:, good] - stec[:, good][:, :1]
        satellites.append(
            _Satellite(
                slow=slow_basis(time_from_middle[good], half_window, arc.ravel()),
                observed=_difference_and_mean(content),
                path=1.0 / np.sin(elevation[:, good]),
                samples=None if np.array_equal(good, usable) else samples[good],
            )
        )
    return _Window(altitudes[:, usable], satellites)


def _widths(
    window: _Window, line: _Fit, dense_side: float, samples: tuple[int, ...]
) -> WidthsByShape | None:
    """Return the widths of walls of all shapes near the fit of a line; None if there are none.

    Scintillation is on one side of a wall, where it also breaks arcs. It would hide there among the
    constants of arcs, and a wall would seem better known than it is; so that the noise is that of
    either side.
    """
    fits = []
    for shape in range(len(WALL_SHAPES)):
        fit = _fit_shape(window, shape, line, dense_side, samples)
        if fit is None:
            return None
        fits.append(fit)
    return WidthsByShape(
        width=np.array([fit.wall.width for fit in fits]),
        sigma=np.array([fit.square_sigma for fit in fits]),
        misfit=shape_misfits(np.array([_costs(window, fit, fits, dense_side) for fit in fits])),
        is_of_square=True,
    )


def _costs(window: _Window, fit: _Fit, fits: list[_Fit], dense_side: float) -> FloatArray:
    """Return the sums of squares of m satellites over the noise that the fits have shown, in mean.

    With the noise of its own fit alone they would not be comparable: noise is larger where a wall
    fits worse.
    """
    ends = np.cumsum([satellite.observed.size for satellite in window.satellites])[:-1]
    costs = np.zeros(len(window.satellites))
    for other in fits:
        design = window.design(other.noise, fit.wall, dense_side)
        residual, _, _ = _solution(window.whitened(other.noise), design)
        costs += [float(part @ part) / len(fits) for part in np.split(residual, ends)]
    return costs


def _fit(
    window: _Window,
    altitude: float,
    reach: float,
    width: float,
    dense_side: float,
    samples: tuple[int, ...],
) -> _Fit | None:
    """Return the fit of a wall that rises linearly; None if contents do not determine it.

    Altitudes are searched over `reach` to either side. The noise of a satellite is even in time.
    """
    bases = [satellite.slow for satellite in window.satellites]
    wall = _Wall(np.full(2, altitude), math.hypot(width, _LEAST_WIDTH), 0)
    fit = _Fitted(window, _Noise.only_white(bases, np.ones((len(bases), 2))), wall, dense_side)
    fit.take_noise(_first_noise(bases, fit.errors(), samples))
    fit.search(reach)
    fit.improve()
    for _ in range(1, _FITS):
        fit.take_noise(_noise_of(fit.noise, fit.errors(), None, samples[0]))
        fit.improve()
    return fit.result()


def _fit_shape(
    window: _Window, shape: int, line: _Fit, dense_side: float, samples: tuple[int, ...]
) -> _Fit | None:
    """Return the fit of a wall of a shape with the noise of either side; None if there is none."""
    wall = _Wall(line.wall.altitude, line.wall.width, shape)
    fit = _Fitted(window, line.noise, wall, dense_side)
    for _ in range(1, _FITS):
        inside = window.inside(fit.wall, dense_side)
        fit.take_noise(_noise_of(fit.noise, fit.errors(), inside, samples[0]))
        fit.improve()
    return fit.result(is_jackknife=True)


class _Fitted:
    """A wall while it is fitted.

    Parameters of a fit are how far both altitudes are from a first one, and the square of the
    width, on which contents depend where it is small.
    """

    def __init__(self, window: _Window, noise: _Noise, wall: _Wall, dense_side: float) -> None:
        self.noise = noise
        self._window, self._dense_side = window, dense_side
        self._origin, self._shape = wall.altitude, wall.shape
        self._parameters = np.array([0.0, 0.0, _square_of(wall.width)])
        self._derivatives = np.empty((0, 3))
        self._observed = window.whitened(noise)

    @property
    def wall(self) -> _Wall:
        """The wall as it is fitted now."""
        return self._place(self._parameters)

    def take_noise(self, noise: _Noise) -> None:
        """Go on with another noise."""
        self.noise, self._observed = noise, self._window.whitened(noise)

    def errors(self) -> list[FloatArray]:
        """Return the residuals of D and M of each satellite, TECU."""
        _, change, _ = _solution(self._observed, self._design(self.wall))
        return self._window.residuals(self.wall, self._dense_side, change)

    def search(self, reach: float) -> None:
        """Take the best common altitude within a distance, m."""
        common = np.linspace(-reach, reach, _SEARCH_STEPS + 1) / _ALTITUDE_UNIT
        trials = [np.array([both, both, self._parameters[2]]) for both in common]
        costs = [float(np.sum(self._residuals(trial) ** 2)) for trial in trials]
        self._parameters = trials[int(np.argmin(costs))]

    def improve(self) -> None:
        """Go to the least sum of squares."""
        self._parameters, self._derivatives = _least_squares(self._residuals, self._parameters)

    def result(self, is_jackknife: bool = False) -> _Fit | None:
        """Return the fit; None if contents do not determine it."""
        information = self._derivatives.T @ self._derivatives
        # The samples do not determine the width of a thin wall; the altitudes do not depend on it.
        information[2, 2] += _WIDTH_PRIOR**-4
        if not np.linalg.cond(information) < 1e12:
            return None
        _, change, significance = _solution(self._observed, self._design(self.wall))
        residual = self._residuals(self._parameters)
        satellites = self._window.satellites
        spread = _spread(self._derivatives, residual, information, satellites, is_jackknife)
        return _Fit(
            wall=self.wall,
            noise=self.noise,
            covariance=_ALTITUDE_UNIT**2 * spread[:2, :2],
            square_sigma=math.sqrt(spread[2, 2]) * _DEPTH_UNIT**2,
            change=float(change[0]),
            significance=significance,
        )

    def _place(self, parameters: FloatArray) -> _Wall:
        altitudes = self._origin + _ALTITUDE_UNIT * parameters[:2]
        return _Wall(altitudes, _width_of(parameters[2]), self._shape)

    def _design(self, wall: _Wall) -> FloatArray:
        return self._window.design(self.noise, wall, self._dense_side)

    def _residuals(self, parameters: FloatArray) -> FloatArray:
        return _solution(self._observed, self._design(self._place(parameters)))[0]


def _spread(
    derivatives: FloatArray,
    residual: FloatArray,
    information: FloatArray,
    satellites: list[_Satellite],
    is_jackknife: bool,
) -> FloatArray:
    """Return the covariance of the parameters: that of the noise, or what satellites differ by.

    The residuals of a satellite pull the parameters to its side. Satellites err independently of
    each other, so that these pulls have a covariance of their own, whatever it is that is wrong
    with a satellite (Liang and Zeger 1986, Biometrika 73:13). In the directions in which it is
    larger, it counts: those of the mean of both altitudes, of their difference and of the width.
    """
    spread = np.linalg.inv(information)
    ends = np.cumsum([satellite.observed.size for satellite in satellites])[:-1]
    pulls = np.array(
        [
            of_satellite.T @ error
            for of_satellite, error in zip(
                np.split(derivatives, ends), np.split(residual, ends), strict=True
            )
        ]
    )
    count = len(satellites)
    moved = pulls @ spread
    if is_jackknife and count > 1:
        # A satellite of which much is known has pulled the fit to itself, and seems to agree.
        moved = np.array(
            [
                np.linalg.solve(information - of_satellite.T @ of_satellite, pull)
                for of_satellite, pull in zip(np.split(derivatives, ends), pulls, strict=True)
            ]
        )
        moved *= (count - 1) / count
    basis = np.array([[1.0, 1.0, 0.0], [-0.5, 0.5, 0.0], [0.0, 0.0, 1.0]])
    inverse = np.linalg.inv(basis)
    scatter = np.sum((moved @ inverse) ** 2, axis=0) * count / max(1, count - 1)
    stated = inverse.T @ spread @ inverse
    factor = np.sqrt(np.maximum(1.0, scatter / np.diag(stated)))
    return np.asarray(basis.T @ (stated * np.outer(factor, factor)) @ basis)


def _least_squares(
    residuals: Callable[[FloatArray], FloatArray], start: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return parameters of the least sum of squares near a start, and the derivatives there.

    Steps of the derivatives are absolute: parameters may be zero, where a relative one is lost.
    """
    parameters, value = start, residuals(start)
    cost, damping = float(value @ value), _DAMPING
    derivatives = np.empty((len(value), len(start)))
    for _ in range(_STEPS):
        for index, step in enumerate(_PARAMETER_STEP * np.maximum(1.0, np.abs(parameters))):
            beside = parameters.copy()
            beside[index] += step
            derivatives[:, index] = (residuals(beside) - value) / step
        normal, gradient = derivatives.T @ derivatives, derivatives.T @ value
        drop = 0.0
        for _ in range(_SHORTER):
            damped = normal + damping * (np.diag(np.diag(normal)) + 1e-9 * np.eye(len(start)))
            trial = parameters - np.linalg.solve(damped, gradient)
            value_there = residuals(trial)
            cost_there = float(value_there @ value_there)
            if cost_there < cost:
                drop = cost - cost_there
                parameters, value, cost = trial, value_there, cost_there
                damping *= _LESS_DAMPING
                break
            damping *= _MORE_DAMPING
        if drop < _LEAST_DROP:
            break
    return parameters, derivatives


def _width_of(square: float) -> float:
    """Return the width, m, of its square in units of depth, less that of the thinnest wall.

    Contents are as smooth in that number as they are in the square of the width: a root would make
    them steep where the wall is thin, and a thin wall seem well known.
    """
    return math.hypot(_DEPTH_UNIT * math.sqrt(abs(square)), _LEAST_WIDTH)


def _square_of(width: float) -> float:
    """Return the square of a width, of which `_width_of` makes it."""
    return max(0.0, width**2 - _LEAST_WIDTH**2) / _DEPTH_UNIT**2


def _solution(observed: FloatArray, design: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return residuals over their sigmas, changes of content, (2,), and significance.

    The density next to the edge and its gradient are estimated, common to all satellites.
    """
    change, *_ = np.linalg.lstsq(design, observed, rcond=None)
    residual = observed - design @ change
    drop = float(observed @ observed - residual @ residual)
    return residual, np.asarray(change), math.sqrt(max(0.0, drop))


def _first_noise(
    slow: list[SlowBasis], errors: list[FloatArray], samples: tuple[int, ...]
) -> _Noise:
    """Return the noise that residuals show, all of it as if it were white.

    Residuals of a wall that is not yet in its place are no measure of what is slow.
    """
    one, none = np.ones(2), np.zeros((2, MOST_MODES))
    white = [
        white_sigma(basis.whiten(error, one, none), samples, basis.unknown_columns)
        for basis, error in zip(slow, errors, strict=True)
    ]
    return _Noise.only_white(slow, np.array(white))


def _noise_of(
    before: _Noise, errors: list[FloatArray], inside: list[FloatArray] | None, samples: int
) -> _Noise:
    """Return the noise that residuals show, even or on either side of a wall, and what is slow."""
    bases = before.slow
    if inside is not None:
        rows = [
            basis.remove(error) / sigma[:, np.newaxis]
            for basis, error, sigma in zip(bases, errors, before.white, strict=True)
        ]
        outer, inner = side_sigmas(rows, bases, samples, inside)[:, :, np.newaxis] ** 2
        # The geometric mean of the sigmas of both sides is one.
        middle = np.sqrt(outer * inner)
        bases = [
            basis.with_noise(np.sqrt((outer + (inner - outer) * part) / middle))
            for basis, part in zip(bases, inside, strict=True)
        ]
    of_satellites = list(zip(bases, errors, strict=True))
    white = [
        white_sigma(basis.remove(error), (samples,), basis.columns)
        for basis, error in of_satellites
    ]
    modes = [basis.modes(error) for basis, error in of_satellites]
    sigma = np.array(white)
    return _Noise(bases, sigma, mode_variances(np.array(modes), sigma))
