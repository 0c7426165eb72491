"""Compiled steps of the density filter: prediction in time, comparison, update.

A second has a dozen satellites, and the state some twenty numbers: array operations on so few cost
ten times what the arithmetic does. A content that is not a number makes its results so, too.

The state is that of `vtff_iono.density.electron_density`: `COMMON` numbers that all satellites
share, then the slow error of each satellite.
"""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.compiled import compiled

__all__ = [
    "CHANGE",
    "COMMON",
    "DENSITY",
    "FIRST_SHAPE",
    "LAYER",
    "SHAPE_NUMBERS",
    "WITHOUT_PAST",
    "compare",
    "correct",
    "examine",
    "find_contradictions",
    "forget_density",
    "likely_contents",
    "pass_time",
    "predict",
    "satellite_densities",
    "scale_of_learned",
    "slow_residuals",
    "unsaid_variances",
]

COMMON = 7
"""States that all satellites share: b, a, the density, the shape of the layer, and c."""

DENSITY = 2
"""Place of the density in the state."""

FIRST_SHAPE, SHAPE_NUMBERS, CHANGE = 3, 3, 6
"""Place of the first number of the shape of the layer, how many there are, and place of c."""

LAYER = (1, *range(FIRST_SHAPE, FIRST_SHAPE + SHAPE_NUMBERS), CHANGE)
"""Places of the states that describe the layer, all but b and the density."""

WITHOUT_PAST = 3
"""How many common states have no past at first."""

# The columns of a design are not independent where a pivot is smaller than this part of the
# largest one.
_SMALLEST_PIVOT = 1e-9


@compiled
def _factorise(matrix):  # type: ignore[no-untyped-def]
    """Return the lower Cholesky factor of a positive definite matrix."""
    lower = np.zeros(matrix.shape)
    for row in range(len(matrix)):
        for column in range(row + 1):
            total = matrix[row, column]
            for place in range(column):
                total -= lower[row, place] * lower[column, place]
            if row == column:
                lower[row, row] = math.sqrt(total)
            else:
                lower[row, column] = total / lower[column, column]
    return lower


@compiled
def _solve(lower, right):  # type: ignore[no-untyped-def]
    """Solve equations with the factor of their matrix for right-hand sides (n, k), in place."""
    size, columns = right.shape
    for row in range(size):
        for place in range(row):
            for column in range(columns):
                right[row, column] -= lower[row, place] * right[place, column]
        for column in range(columns):
            right[row, column] /= lower[row, row]
    for row in range(size - 1, -1, -1):
        for place in range(row + 1, size):
            for column in range(columns):
                right[row, column] -= lower[place, row] * right[place, column]
        for column in range(columns):
            right[row, column] /= lower[row, row]


@compiled
def pass_time(state, covariance, scale, decay, gained):  # type: ignore[no-untyped-def]
    """Predict state and covariance, both in place.

    Parameters
    ----------
    state, covariance : ndarray, shapes (m,), (m, m)
    scale : ndarray, shape (COMMON + 1,)
        Factors of the sigmas of the common states, and of the slow errors: errors that prove
        larger or smaller than was believed.
    decay : float
        Factor by which a slow error decays.
    gained : ndarray, shape (COMMON + 1,)
        Variance that each common state gains, and that a slow error gains.
    """
    size = len(state)
    factor = np.empty(size)
    factor[:COMMON] = scale[:COMMON]
    for place in range(COMMON, size):
        state[place] *= decay
        factor[place] = scale[COMMON] * decay
    for row in range(size):
        for column in range(size):
            covariance[row, column] *= factor[row] * factor[column]
        covariance[row, row] += gained[min(row, COMMON)]


@compiled
def forget_density(state, covariance, variance):  # type: ignore[no-untyped-def]
    """Forget the density, whose variance is then a given one, in state and covariance in place."""
    state[DENSITY] = 0.0
    covariance[DENSITY, :] = 0.0
    covariance[:, DENSITY] = 0.0
    covariance[DENSITY, DENSITY] = variance


@compiled
def scale_of_learned(ratio, variance, first_variance):  # type: ignore[no-untyped-def]
    """Return the factors of the sigmas of states that measurements have told, shape (n,).

    One over the variance of a state is that before any measurement and that of the measurements.
    The latter were believed to have another variance.

    Parameters
    ----------
    ratio : float
        Variance of the measurements over that which was believed.
    variance, first_variance : ndarray, shape (n,)
        Variances of the states now, and before any measurement.
    """
    part = np.maximum(1.0 - variance / first_variance, 0.0)
    return 1.0 / np.sqrt(1.0 + part * (1.0 / ratio - 1.0))


@compiled
def predict(  # type: ignore[no-untyped-def]
    state, covariance, ratio, decay, gained, first_variance, density_variance
):
    """Predict state and covariance of the next epoch, both in place.

    Parameters
    ----------
    state, covariance, decay, gained
        As in `pass_time`.
    ratio : float
        Variance of the slow errors over that which was believed until now. Where errors prove
        larger or smaller than was believed, so does what they have done so far to b and m, and to
        what describes the layer.
    first_variance : ndarray, shape (5,)
        Variances of what describes the layer before any content, which they never exceed.
    density_variance : float
        Variance of the density, which is new at each epoch.
    """
    known = np.empty(len(LAYER))
    for number in range(len(LAYER)):
        known[number] = covariance[LAYER[number], LAYER[number]]
    of_layer = scale_of_learned(ratio, known, first_variance)
    scale = np.full(COMMON + 1, math.sqrt(ratio))
    for number in range(len(LAYER)):
        scale[LAYER[number]] = of_layer[number]
    pass_time(state, covariance, scale, decay, gained)
    for number in range(len(LAYER)):
        place = LAYER[number]
        if covariance[place, place] > first_variance[number]:
            covariance[place, place] = first_variance[number]
    forget_density(state, covariance, density_variance)


@compiled
def compare(common, places, state, covariance, own_variance):  # type: ignore[no-untyped-def]
    """Return the design of contents, the contents of the state, and their covariance.

    Parameters
    ----------
    common : ndarray, shape (n, COMMON)
        Derivatives of the contents with respect to the common states.
    places : ndarray of int64, shape (n,)
        Place of the slow error of each satellite in the state; -1 for none.
    state, covariance : ndarray, shapes (m,), (m, m)
    own_variance : ndarray, shape (n,)
        Variance of each content that is not of the state.

    Returns
    -------
    design, contents, spread : ndarray, shapes (n, m), (n,), (n, n)
    """
    design = np.zeros((len(common), len(state)))
    for row in range(len(common)):
        design[row, :COMMON] = common[row]
        if places[row] >= 0:
            design[row, places[row]] = 1.0
    spread = design @ covariance @ np.ascontiguousarray(design.T)
    for row in range(len(common)):
        spread[row, row] += own_variance[row]
    return design, design @ state, spread


@compiled
def likely_contents(  # type: ignore[no-untyped-def]
    common, modelled, places, state, covariance, own_variance, density, density_variance
):
    """Return contents with a density that is likely beforehand, (n,), and their covariance.

    Parameters
    ----------
    common, places, state, covariance, own_variance
        As in `compare`; a satellite without a place has the variance of the slow error in its own.
    modelled : ndarray, shape (n,)
        Contents of a state of zero.
    density, density_variance : float
        Likely density and its variance.
    """
    size = len(state)
    gain = covariance[:, DENSITY] / (covariance[DENSITY, DENSITY] + density_variance)
    likely, spread_of_state = np.empty(size), np.empty((size, size))
    for row in range(size):
        likely[row] = state[row] + gain[row] * (density - state[DENSITY])
        for column in range(size):
            change = gain[row] * covariance[DENSITY, column]
            spread_of_state[row, column] = covariance[row, column] - change
    _, contents, spread = compare(common, places, likely, spread_of_state, own_variance)
    return modelled + contents, spread


@compiled
def _find_contradictions(  # type: ignore[no-untyped-def]
    innovation, covariance, unknown, largest_sigmas, largest_error
):
    """Return which contents contradict the others, and whether any other is off by more sigmas.

    Arguments as in `find_contradictions`.
    """
    is_wrong = np.zeros(len(innovation), dtype=np.bool_)
    while True:
        kept = np.flatnonzero(~is_wrong)
        if len(kept) <= unknown:
            return is_wrong, False
        inverse = np.eye(len(kept))
        _solve(_factorise(covariance[kept][:, kept]), inverse)
        # Content less prediction of the others, and in its sigmas.
        worst, largest_ratio, error_of_worst = -1, -1.0, 0.0
        for row in range(len(kept)):
            error = 0.0
            for column in range(len(kept)):
                error += inverse[row, column] * innovation[kept[column]]
            error /= inverse[row, row]
            ratio = abs(error) * math.sqrt(inverse[row, row])
            if ratio > largest_ratio:
                worst, largest_ratio, error_of_worst = row, ratio, error
        if not (largest_ratio > largest_sigmas and abs(error_of_worst) > largest_error):
            return is_wrong, largest_ratio > largest_sigmas and abs(error_of_worst) > 0.0
        is_wrong[kept[worst]] = True


@compiled
def find_contradictions(  # type: ignore[no-untyped-def]
    innovation, covariance, unknown, largest_sigmas, largest_error
):
    """Return which contents contradict the others and the past, one by one (Baarda 1968), (n,).

    Each content is compared with what all others that are kept, and the state, predict of it.

    Parameters
    ----------
    innovation, covariance : ndarray, shapes (n,), (n, n)
        Contents less those that the state predicts, and their covariance.
    unknown : int
        States without a past: so many contents are kept in any case.
    largest_sigmas, largest_error : float
        A content contradicts if it is off by more than both.
    """
    is_wrong, _ = _find_contradictions(
        innovation, covariance, unknown, largest_sigmas, largest_error
    )
    return is_wrong


@compiled
def unsaid_variances(innovation, covariance, unknown, largest_sigmas):  # type: ignore[no-untyped-def]
    """Return the variances that contents must have beside those they came with, TECU^2, (n,).

    A content that contradicts the others by less than any integer makes has begun to fluctuate:
    within a second a fade that begins hardly shows. Arguments as in `find_contradictions`.
    """
    variance = np.zeros(len(innovation))
    is_off, _ = _find_contradictions(innovation, covariance, unknown, largest_sigmas, 0.0)
    others, off = np.flatnonzero(~is_off), np.flatnonzero(is_off)
    if len(off) == 0:
        return variance
    of_others = covariance[others]
    gain = np.linalg.solve(of_others[:, others], of_others[:, off])
    expected = np.empty(len(off))
    if len(off) == 1:
        expected[0] = gain[:, 0].copy() @ innovation[others]
    else:
        expected[:] = np.ascontiguousarray(gain).T @ innovation[others]
    variance[off] = (innovation[off] - expected) ** 2
    return variance


@compiled
def examine(  # type: ignore[no-untyped-def]
    common,
    places,
    state,
    covariance,
    residual,
    fast_variance,
    is_checked,
    largest_sigmas,
    largest_error,
):
    """Compare contents with each other and the past.

    Parameters
    ----------
    common, places, state, covariance
        As in `compare`.
    residual, fast_variance : ndarray, shape (n,)
        Contents less those that are modelled, and the variances of their fast errors.
    is_checked : bool
        Whether so many contents have agreed that the past tells of b, a and density what the
        covariance says.
    largest_sigmas, largest_error : float
        As in `find_contradictions`.

    Returns
    -------
    design : ndarray, shape (n, m)
    innovation, spread : ndarray, shapes (n,), (n, n)
        Contents less those that the state predicts, and their covariance.
    is_wrong : ndarray of bool, shape (n,)
        As `find_contradictions` returns them.
    is_any_off : bool
        Whether another content is off by more sigmas than these, though not by as much.
    unknown : int
        How many of b, a and density the past does not tell to the size of an error.
    """
    design, contents, spread = compare(common, places, state, covariance, fast_variance)
    unknown = WITHOUT_PAST
    if is_checked:
        # What all contents share of a is as b is; the density is new.
        effect_of_bias = math.sqrt(covariance[0, 0])
        range_of_size = common[:, 1].max() - common[:, 1].min()
        effect_of_size = math.sqrt(covariance[1, 1]) * range_of_size
        effect_of_density = math.sqrt(covariance[DENSITY, DENSITY]) * math.inf
        unknown = 0
        unknown += effect_of_bias > largest_error
        unknown += effect_of_size > largest_error
        unknown += effect_of_density > largest_error
    innovation = residual - contents
    is_wrong, is_any_off = _find_contradictions(
        innovation, spread, unknown, largest_sigmas, largest_error
    )
    return design, innovation, spread, is_wrong, is_any_off, unknown


@compiled
def correct(state, covariance, design, residual, variance):  # type: ignore[no-untyped-def]
    """Update state and covariance, both in place, with n uncorrelated observations.

    `design` (n, m) holds their derivatives, `residual` and `variance` (n,) the observations and
    their variances. The gain is returned, shape (m, n); the covariance is that of Joseph.
    """
    size = len(state)
    transposed = np.ascontiguousarray(design.T)
    predicted = covariance @ transposed
    innovation = design @ predicted
    for row in range(len(residual)):
        innovation[row, row] += variance[row]
    solution = np.ascontiguousarray(predicted.T)
    _solve(_factorise(innovation), solution)
    gain = np.ascontiguousarray(solution.T)
    state += gain @ (residual - design @ state)
    left = np.eye(size) - gain @ design
    covariance[:] = left @ covariance @ np.ascontiguousarray(left.T)
    covariance += (gain * variance) @ np.ascontiguousarray(gain.T)
    return gain


@compiled
def satellite_densities(  # type: ignore[no-untyped-def]
    common, residual, variance, state, covariance
):
    """Return the density from each satellite alone and its sigma, shape (2, n).

    The other common states are those of all satellites. `residual` and `variance` (n,) are the
    contents and the variances of their errors; the units are those of the state.
    """
    result = np.empty((2, len(residual)))
    for row in range(len(residual)):
        rest, spread = residual[row], variance[row]
        for place in range(COMMON):
            if place == DENSITY:
                continue
            rest -= common[row, place] * state[place]
            for other in range(COMMON):
                if other != DENSITY:
                    spread += common[row, place] * common[row, other] * covariance[place, other]
        result[0, row] = rest / common[row, DENSITY]
        result[1, row] = math.sqrt(spread) / abs(common[row, DENSITY])
    return result


@compiled
def slow_residuals(observed, common, common_sigma, fast_variance, variance):  # type: ignore[no-untyped-def]
    """Remove from contents what all satellites share.

    Parameters
    ----------
    observed, fast_variance : ndarray, shape (n,)
        Contents, and the variances of their fast errors.
    common : ndarray, shape (n, p)
        Derivatives with respect to what is shared.
    common_sigma : ndarray, shape (p,)
        Sigma of what is shared before any content; infinite for what only the contents tell.
    variance : float
        Variance of the slow errors.

    Returns
    -------
    is_determined : bool
        Whether the contents determine what is shared; if not, the rest means nothing.
    weight, residual, freedom : ndarray, shape (n,)
        One over the sigma of each content, its residual in sigmas, and the part of its error that
        the residual shows.
    """
    count, shared = common.shape
    weight = 1.0 / np.sqrt(fast_variance + variance)
    # The sigmas before any content are observations too, of zero.
    residual, freedom = np.zeros(count + shared), np.ones(count + shared)
    residual[:count] = observed * weight
    basis = np.zeros((shared, count + shared))
    basis[:, :count] = common.T * weight
    told = count
    for column in range(shared):
        basis[column, count + column] = 1.0 / common_sigma[column]
        told += np.isfinite(common_sigma[column])
    if told < shared:
        return False, weight, residual[:count], freedom[:count]
    # Columns at right angles, each twice made so (modified Gram-Schmidt, Bjorck 1967).
    smallest, largest = np.inf, 0.0
    for column in range(len(basis)):
        for _ in range(2):
            for before in range(column):
                basis[column] -= (basis[before] @ basis[column]) * basis[before]
        pivot = math.sqrt(basis[column] @ basis[column])
        smallest, largest = min(smallest, pivot), max(largest, pivot)
        if not pivot > 0.0:
            return False, weight, residual[:count], freedom[:count]
        basis[column] /= pivot
        residual -= (basis[column] @ residual) * basis[column]
        freedom -= basis[column] ** 2
    is_determined = smallest > _SMALLEST_PIVOT * largest
    return is_determined, weight, residual[:count], freedom[:count]
