"""A wall fitted to the density between two spacecraft along one climb or descent."""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.compiled import compiled

__all__ = [
    "DISTANCE",
    "FEWEST_SAMPLES",
    "KINK",
    "LAYER",
    "PARABOLA",
    "SAMPLE_COLUMNS",
    "SMOOTH_WALL",
    "WALL",
    "factorise_errors",
    "fit_means",
    "fit_wall",
    "mean_samples",
    "place_means",
]

WALL, PARABOLA, LAYER, KINK, SMOOTH_WALL = range(5)
"""Kinds of `fit_wall`."""

SAMPLE_COLUMNS = 5
"""Columns of the samples of `fit_wall`."""

DISTANCE = 1
"""Column of the distance from the wall in the means of samples."""

FEWEST_SAMPLES = 6
"""Fewest samples of a fit."""

# What `fit_wall` returns without a fit.
_NO_FIT = (False, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0.0)
# Largest difference of the densities beside a wall over their mean: neither is negative.
_LARGEST_CONTRAST = 1.9
# Most passes in which the density beside a wall is a straight line.
_PASSES_OF_LINE = 2
# Smallest growth of a density over the window that is no straight line.
_LEAST_GROWTH = 1e-6
# Largest change of the logarithm of a density in a pass, and largest logarithm (1/m3).
_LARGEST_STEP, _LARGEST_POWER = 1.0, 40.0


@compiled
def fit_wall(  # type: ignore[no-untyped-def]
    samples,
    slow,
    direction,
    middle,
    reach,
    width,
    length,
    slow_time,
    steepest,
    most_means,
    fewest,
    passes,
    kind,
):
    """Fit a line and a wall to densities by generalised least squares.

    Parameters
    ----------
    samples : ndarray, shape (n, 5)
        Time, s, altitude, m, density and sigmas of its fast and of its common error, 1/m3.
    slow : ndarray, shape (n, m)
        Change of the densities by one sigma of each slow error, 1/m3.
    direction : float
        1 in a climb, -1 in a descent.
    middle, reach : float
        Altitude of the wall times the direction, and the distance by which the slope is counted, m.
    width, length : float
        Width of the wall and length over which it is smeared, m.
    slow_time : float
        Correlation time of the slow errors, s.
    steepest : float
        Sigma of the change of the logarithm of the density with altitude where there is no wall,
        1/m.
    most_means : int
        Largest number of means of samples that follow each other which are fitted.
    fewest : int
        Fewest means on either side of the wall.
    passes : int
        1: the line goes on behind the wall; 2: its slope is in proportion to the density there,
        which the first pass tells; 3: it is so on all the way, as below the peak of a layer.
    kind : int
        `WALL`, which rises linearly, `SMOOTH_WALL`, which rises as the error function with the same
        second moment, or what is fitted instead: `PARABOLA`, `KINK` in the middle, or `LAYER`, a
        density whose logarithm is a parabola, no steeper and no thinner than layers are, which is
        fitted in `passes`.

    Returns
    -------
    is_fitted : bool
        Whether there are enough samples on both sides.
    level, slope, change, sigma : float
        Density in the middle, its change by the line over `reach`, that by the wall along the
        motion and its sigma, which contains what is no line and no wall, 1/m3.
    misfit : float
        Sum of the squares of the residuals over their sigmas.
    freedom : int
        Number of means beyond the parameters.
    correlation : float
        That of the residuals of means that follow each other, whose errors should have none.
    """
    if len(samples) < FEWEST_SAMPLES:
        return _NO_FIT
    means, parts, number = mean_samples(samples, slow, most_means)
    place_means(means, samples, number, direction, middle)
    half_length = 0.5 * (width + length)
    before = behind = 0
    for row in range(len(means)):
        before += means[row, DISTANCE] < -half_length
        behind += means[row, DISTANCE] > half_length
    if min(before, behind) < fewest:
        return _NO_FIT
    is_positive, factor, mean_variance = factorise_errors(means, parts, number, slow_time)
    if not is_positive:
        return _NO_FIT
    return fit_means(means, factor, mean_variance, reach, width, length, steepest, passes, kind)


@compiled
def mean_samples(samples, slow, most_means):  # type: ignore[no-untyped-def]
    """Return means of samples that follow each other, without their distances from a wall.

    Parameters
    ----------
    samples, slow, most_means
        As in `fit_wall`; one sample or more.

    Returns
    -------
    means : ndarray, shape (k, 5)
        Time, distance from the wall, density, and variances of its fast and common error.
    parts : ndarray, shape (k, m)
        Changes of the densities by one sigma of each slow error.
    number : ndarray, shape (k,)
        Number of samples of each mean.
    """
    count = len(samples)
    groups = min(count, most_means)
    number = np.zeros(groups)
    means = np.zeros((groups, SAMPLE_COLUMNS))
    parts = np.zeros((groups, slow.shape[1]))
    for row in range(count):
        group = row * groups // count
        number[group] += 1.0
        means[group, 0] += samples[row, 0] - samples[0, 0]
        means[group, 2] += samples[row, 2]
        means[group, 3] += samples[row, 3] ** 2
        means[group, 4] += samples[row, 4] ** 2
        for column in range(slow.shape[1]):
            parts[group, column] += slow[row, column]
    for group in range(groups):
        for column in range(SAMPLE_COLUMNS):
            means[group, column] /= number[group]
        for column in range(slow.shape[1]):
            parts[group, column] /= number[group]
    return means, parts, number


@compiled
def place_means(means, samples, number, direction, middle):  # type: ignore[no-untyped-def]
    """Set the distances of means from a wall; arguments as in `fit_wall` and `mean_samples`."""
    count, groups = len(samples), len(means)
    means[:, DISTANCE] = 0.0
    for row in range(count):
        means[row * groups // count, DISTANCE] += direction * samples[row, 1] - middle
    for group in range(groups):
        means[group, DISTANCE] /= number[group]


@compiled
def factorise_errors(means, parts, number, slow_time):  # type: ignore[no-untyped-def]
    """Return the factor that makes the errors of means independent; see `mean_samples`.

    Returns
    -------
    is_positive : bool
        Whether the covariance has a factor.
    factor : ndarray, shape (k, k)
        Cholesky factor of the covariance of the means, a lower triangle.
    mean_variance : float
        Mean of their variances.
    """
    groups = len(means)
    factor = np.zeros((groups, groups))
    mean_variance = 0.0
    for row in range(groups):
        for other in range(row + 1):
            total = 0.0
            for column in range(parts.shape[1]):
                total += parts[row, column] * parts[other, column]
            total *= math.exp(-abs(means[row, 0] - means[other, 0]) / slow_time)
            # Errors of an estimate and of a better one differ by what was learned between them.
            total += min(means[row, 4], means[other, 4])
            if row == other:
                total += means[row, 3] / number[row]
                mean_variance += total / groups
            for column in range(other):
                total -= factor[row, column] * factor[other, column]
            if row > other:
                factor[row, other] = total / factor[other, other]
            elif total > 0.0:
                factor[row, row] = math.sqrt(total)
            else:
                return False, factor, mean_variance
    return True, factor, mean_variance


@compiled
def _wall_shape(distance, reach, width, length, kind):  # type: ignore[no-untyped-def]
    """Return the part of a wall at a distance from its middle, or of what is fitted instead."""
    rounded, smeared = max(width, 1e-3), max(length, 1e-3)
    if kind == SMOOTH_WALL:
        # What is smeared is the integral of the error function, at both ends of the length.
        deviation = rounded / math.sqrt(12.0)
        part = -0.5
        for side in (-1.0, 1.0):
            place = distance + 0.5 * side * smeared
            normal_place = place / deviation
            integral = 0.5 * place * (1.0 + math.erf(normal_place / math.sqrt(2.0)))
            density = math.exp(-0.5 * normal_place**2) / math.sqrt(2.0 * math.pi)
            part += side * (integral + deviation * density) / smeared
        return part
    if kind != WALL:
        return abs(distance) / reach if kind == KINK else (distance / reach) ** 2
    # A wall that rises linearly over its width, averaged over the length.
    return (
        max(distance + 0.5 * (rounded + smeared), 0.0) ** 2
        - max(distance - 0.5 * (rounded - smeared), 0.0) ** 2
        - max(distance - 0.5 * (smeared - rounded), 0.0) ** 2
        + max(distance - 0.5 * (rounded + smeared), 0.0) ** 2
    ) / (2.0 * rounded * smeared) - 0.5


@compiled
def fit_means(  # type: ignore[no-untyped-def]
    means, factor, mean_variance, reach, width, length, steepest, passes, kind
):
    """Fit a line and a wall to means of samples.

    Parameters
    ----------
    means, factor, mean_variance
        As `mean_samples`, `place_means` and `factorise_errors` return them.
    reach, width, length, steepest, passes, kind
        As in `fit_wall`, as what is returned.
    """
    groups = len(means)
    walls = np.empty(groups)
    mean_density = 0.0
    for row in range(groups):
        mean_density += means[row, 2] / groups
        walls[row] = _wall_shape(means[row, DISTANCE], reach, width, length, kind)
    slope_sigma = steepest * reach * (abs(mean_density) + math.sqrt(mean_variance))
    # A layer begins as a constant; its parameters are the logarithm of the density, how that
    # changes over `reach`, and its curvature.
    layer = np.zeros(3)
    layer[0] = math.log(max(mean_density, math.sqrt(mean_variance)))
    log_slope_sigma = steepest * reach
    log_curvature_sigma = 0.25 * log_slope_sigma**2
    solution, ratio, growth = np.zeros(3), 0.0, 0.0
    table = np.empty((groups, 4))  # columns of the design, and the density
    variance = 0.0
    for _ in range(passes):
        for row in range(groups):
            table[row, 0] = 1.0
            place = means[row, DISTANCE] / reach
            if abs(growth) > _LEAST_GROWTH:
                place = (math.exp(growth * place) - 1.0) / growth
            table[row, 1] = place * (1.0 + ratio * walls[row])
            table[row, 2] = walls[row]
            table[row, 3] = means[row, 2]
            if kind == LAYER:
                power = layer[0] + layer[1] * table[row, 1] + layer[2] * table[row, 2]
                density = math.exp(min(power, _LARGEST_POWER))
                table[row, 3] -= density
                for column in range(3):
                    table[row, column] *= density
            for column in range(4):
                total = table[row, column]
                for other in range(row):
                    total -= factor[row, other] * table[other, column]
                table[row, column] = total / factor[row, row]
        normal = np.zeros((3, 4))
        for row in range(groups):
            for column in range(3):
                for other in range(4):
                    normal[column, other] += table[row, column] * table[row, other]
        if kind == LAYER:
            for column, known in ((1, log_slope_sigma), (2, log_curvature_sigma)):
                normal[column, column] += 1.0 / known**2
                normal[column, 3] -= layer[column] / known**2
        else:
            normal[1, 1] += 1.0 / slope_sigma**2
        # The cofactors of the symmetric normal matrix, whose last column gives the change.
        a, b, c = normal[0, 0], normal[0, 1], normal[0, 2]
        d, e, f = normal[1, 1], normal[1, 2], normal[2, 2]
        inverse = np.array(
            [
                [d * f - e * e, c * e - b * f, b * e - c * d],
                [c * e - b * f, a * f - c * c, b * c - a * e],
                [b * e - c * d, b * c - a * e, a * d - b * b],
            ]
        )
        determinant = a * inverse[0, 0] + b * inverse[1, 0] + c * inverse[2, 0]
        if not determinant > 0.0:
            return _NO_FIT
        for row in range(3):
            solution[row] = 0.0
            for column in range(3):
                solution[row] += inverse[row, column] * normal[column, 3] / determinant
        variance = inverse[2, 2] / determinant
        if kind == LAYER:
            for row in range(3):
                layer[row] += min(max(solution[row], -_LARGEST_STEP), _LARGEST_STEP)
        elif solution[0] > 0.0:
            ratio = solution[2] / solution[0]
            ratio = min(max(ratio, -_LARGEST_CONTRAST), _LARGEST_CONTRAST)
            if kind in (WALL, SMOOTH_WALL) and passes > _PASSES_OF_LINE:
                growth = solution[1] / solution[0]
                growth = min(max(growth, -_LARGEST_STEP), _LARGEST_STEP)
    misfit = (solution[1] / slope_sigma) ** 2
    if kind == LAYER:
        misfit = (layer[1] / log_slope_sigma) ** 2 + (layer[2] / log_curvature_sigma) ** 2
    of_residuals, products, last_residual = 0.0, 0.0, 0.0
    for row in range(groups):
        residual = table[row, 3]
        for column in range(3):
            residual -= table[row, column] * solution[column]
        of_residuals += residual * residual
        products += residual * last_residual
        last_residual = residual
    misfit += of_residuals
    correlation = products / max(of_residuals, 1e-12)
    # What is no line and no wall of this width is an error too.
    freedom = max(1, groups - 3)
    variance *= max(1.0, misfit / freedom)
    sigma = math.sqrt(variance)
    return True, solution[0], solution[1], solution[2], sigma, misfit, freedom, correlation
