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
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU
from vtff_iono.edges.content_noise import slow_basis
from vtff_iono.edges.crossing_fit import (
    DEPTH_UNIT,
    Window,
    WindowSatellite,
    difference_and_mean,
    fit_line,
    fit_widths,
)
from vtff_iono.edges.wall_width import WidthsByShape, combine_widths
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
# m; altitudes that are searched to either side, more for a wide wall: this part of its width.
_SEARCH = 500.0
_SEARCH_OF_WIDTH = 0.3
# The fit has gone astray if it ends farther from where the density has shown the edge, or with a
# wall that is wider by this factor than all that are tried.
_FARTHEST = 2.0
_WIDEST = 40e3
_LEAST_SIGNIFICANCE = 5.0
# Error of the altitude from what the model leaves out, m: the third order of density with depth;
# and of a wall that does not rise linearly, as a part of its width.
_MODEL_SIGMA = 5.0
_SHAPE_SIGMA = 0.02


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
    widths: WidthsByShape

    @property
    def width(self) -> float:
        """Width over which the density changes, m."""
        return combine_widths(self.widths)[0]

    @property
    def width_sigma(self) -> float:
        """Sigma of the width, m."""
        return combine_widths(self.widths)[1]


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
    fit = fit_line(fitted_window, altitude, reach, width, dense_side, samples)
    if fit is None:
        return None
    widths = fit_widths(fitted_window, fit, dense_side, samples)
    if widths is None:
        return None
    altitudes, covariance = fit.wall.altitude, fit.covariance
    # Contents are those above a spacecraft: they fall while it climbs.
    density = -dense_side * fit.change * ELECTRONS_PER_TECU / DEPTH_UNIT
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
        widths=widths,
    )


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
) -> Window:
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
            WindowSatellite(
                slow=slow_basis(time_from_middle[good], half_window, arc.ravel()),
                observed=difference_and_mean(content),
                path=1.0 / np.sin(elevation[:, good]),
                samples=samples[good],
            )
        )
    return Window(altitudes[:, usable], satellites)
