"""The search for walls along a profile of densities: all windows, all places and widths at once."""

from __future__ import annotations

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_iono.edges.wall_fit import (
    FEWEST_SAMPLES,
    WALL,
    factorise_errors,
    fit_means,
    fit_wall,
    mean_samples,
    place_means,
)

__all__ = [
    "FEWEST_AT_END",
    "MEANS",
    "STEEPEST",
    "find_walls",
    "fit_places",
]

MEANS = 24
"""Largest number of means that a fit uses."""

FEWEST_AT_END = 1
"""Fewest means on either side of a wall where densities have ended or go on again."""

STEEPEST = 1.0 / 10e3
"""Sigma of how fast the logarithm of the density changes with altitude beside a wall, 1/m.

Below the peak of a layer it is the inverse of a part of the scale height (Chapman 1931).
"""

# A distance between densities is a gap if it is longer than the mean one by this factor.
_GAP = 3.0
# A change of this part of the sigmas that are asked for is told as a doubtful edge.
_DOUBTFUL = 0.8
# Where the straight line goes against the wall by more than this part, it may be the foot of a
# wider wall beside it: it is thinner than what smears it, whose shape is known, and no kink fits
# nearly as well.
_SHAPE_AGAINST = 1.0
# The change of a wall is at least this part of what the straight line changes over the window.
_SHAPE = 0.3
# Numbers that `find_walls` returns of each wall.
_COLUMNS = 10


@compiled
def find_walls(  # type: ignore[no-untyped-def]
    samples,
    slow,
    direction,
    length,
    slow_time,
    widths,
    reaches,
    examined_to,
    last,
    has_ended,
    fewest,
    sigmas,
    relative_change,
):
    """Fit a line and a wall in the middle of each window, in all places that are new.

    Parameters
    ----------
    samples, slow, direction, length, slow_time, fewest
        As in `fit_wall`.
    widths, reaches : ndarray, shape (k,)
        Widths of the walls of the windows, and the half windows, m.
    examined_to : ndarray, shape (k,)
        Places up to which each window was fitted, altitude times the direction, m; in place.
    last : float
        Place behind which there are no densities, m: windows end there.
    has_ended : bool
        Whether densities had ended before these samples.
    sigmas, relative_change : float
        As in `DensityEdgeDetector`.

    Returns
    -------
    ndarray, shape (walls, 10)
        The walls that are large enough: number of the window, fewest means on either side, place,
        m, level, slope, change, sigma, misfit and freedom, as `fit_wall` has them, and one where
        the slope goes against the change.
    """
    advance = direction * samples[:, 1]
    count = len(advance)
    begins, ends = np.empty(len(widths), np.int64), np.empty(len(widths), np.int64)
    most = 0
    for window in range(len(widths)):
        begins[window] = np.searchsorted(advance, examined_to[window], side="right")
        ends[window] = np.searchsorted(advance, last - reaches[window], side="right")
        most += 2 * max(ends[window] - begins[window], 0)
    walls, found = np.empty((most, _COLUMNS)), 0
    longest = _GAP * (advance[-1] - advance[0]) / max(count - 1, 1)
    for window in range(len(widths)):
        width, reach = widths[window], reaches[window]
        if ends[window] > begins[window]:
            examined_to[window] = advance[ends[window] - 1]
        for number in range(begins[window], ends[window]):
            gap = advance[number] - advance[number - 1] if number > 0 else 0.0
            # A wall may be in a gap too.
            for is_in_gap in (True, False):
                if is_in_gap and not gap > longest:
                    continue
                middle = advance[number] - 0.5 * gap if is_in_gap else advance[number]
                first = np.searchsorted(advance, middle - reach)
                end = np.searchsorted(advance, middle + reach)
                # What is missing before densities go on does not come any more either.
                is_cut = has_ended and advance[0] > middle - reach
                fewest_here = FEWEST_AT_END if is_cut else fewest
                is_fitted, level, slope, change, sigma, misfit, freedom, _ = fit_wall(
                    samples[first:end],
                    slow[first:end],
                    direction,
                    middle,
                    reach,
                    width,
                    length,
                    slow_time,
                    STEEPEST,
                    MEANS,
                    fewest_here,
                    1,
                    WALL,
                )
                if not is_fitted:
                    continue
                before, after = level - 0.5 * change, level + 0.5 * change
                largest, size = max(before, after), abs(change)
                is_against = slope * change < 0.0 and size < _SHAPE_AGAINST * 2.0 * abs(slope)
                if (
                    largest > 0.0
                    and min(before, after) >= -sigmas * sigma
                    and size >= _DOUBTFUL * sigmas * sigma
                    and size >= relative_change * largest
                    and size >= _SHAPE * 2.0 * abs(slope)
                    and not (is_against and width > length)
                ):
                    wall = walls[found]
                    wall[0], wall[1], wall[2] = window, fewest_here, middle
                    wall[3], wall[4], wall[5], wall[6] = level, slope, change, sigma
                    wall[7], wall[8], wall[9] = misfit, freedom, is_against
                    found += 1
    return walls[:found]


@compiled
def fit_places(  # type: ignore[no-untyped-def]
    samples,
    slow,
    direction,
    places,
    reach,
    widths,
    length,
    slow_time,
    most_means,
    passes,
    kinds,
):
    """Fit walls in all places, of all kinds, passes and widths, to the same densities.

    The errors of the densities do not depend on the wall: they are looked at once.

    Parameters
    ----------
    samples, slow, direction, reach, length, slow_time, most_means
        As in `fit_wall`.
    places : ndarray, shape (p,)
        Places of the wall, altitude times the direction, m.
    widths, passes, kinds : ndarray, shapes (w,), (s,) and (k,), of float, int and int
        As in `fit_wall`.

    Returns
    -------
    ndarray, shape (6, k, s, w, p)
        Level, change, sigma, misfit, freedom and correlation, as `fit_wall` returns them; the
        misfit is infinite where there is no fit.
    """
    fits = np.zeros((6, len(kinds), len(passes), len(widths), len(places)))
    fits[3] = np.inf
    if len(samples) < FEWEST_SAMPLES:
        return fits
    means, parts, number = mean_samples(samples, slow, most_means)
    is_positive, factor, mean_variance = factorise_errors(means, parts, number, slow_time)
    if not is_positive:
        return fits
    for place in range(len(places)):
        place_means(means, samples, number, direction, places[place])
        for kind in range(len(kinds)):
            for times in range(len(passes)):
                for width in range(len(widths)):
                    is_fitted, level, _, change, sigma, misfit, freedom, correlation = fit_means(
                        means,
                        factor,
                        mean_variance,
                        reach,
                        widths[width],
                        length,
                        STEEPEST,
                        passes[times],
                        kinds[kind],
                    )
                    if is_fitted:
                        fit = fits[:, kind, times, width, place]
                        fit[0], fit[1], fit[2] = level, change, sigma
                        fit[3], fit[4], fit[5] = misfit, freedom, correlation
    return fits
