"""A second of the density filter in one compiled call.

A second has a dozen satellites: each call of a compiled function, and each operation on an array,
costs more than its arithmetic. All that the filter keeps is in tables, which change in place.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU
from vtff_iono.bias.running_profile import (
    CONSTANT,
    absorb_density,
    mean_between,
    move_constant,
    reshape_and_resize,
)
from vtff_iono.density.filter.content_design import content_design, vertical_design
from vtff_iono.density.filter.kernels import (
    CHANGE,
    COMMON,
    DENSITY,
    FIRST_SHAPE,
    SHAPE_NUMBERS,
    WITHOUT_PAST,
    correct,
    examine,
    forget_density,
    likely_contents,
    predict,
    satellite_densities,
    unsaid_variances,
)
from vtff_iono.density.filter.slow_errors import CORRELATION_TIME, SIGMA, add_epoch

__all__ = [
    "BIAS",
    "BIAS_SIGMA",
    "COMMON_SIGMA",
    "EPOCH_DENSITY",
    "EPOCH_SIGMA",
    "FAST_SIGMA",
    "HEIGHTS",
    "IS_BIAS_NEW",
    "IS_CHECKED",
    "KEPT",
    "LAST_TIME",
    "SLOW_TIME",
    "SLOW_VARIANCE",
    "FilterTable",
    "choose_contents",
    "pass_to",
    "past_second",
    "predicted_contents",
    "update_model",
    "update_second",
]

HEIGHTS = slice(FIRST_SHAPE, FIRST_SHAPE + 2)
"""Places of the changes of the logarithms of the scale heights in the state."""

LAST_TIME, SLOW_VARIANCE, IS_BIAS_NEW, IS_CHECKED = range(4)
"""Places of `FilterTable.memory`."""

EPOCH_DENSITY, EPOCH_SIGMA, FAST_SIGMA, SLOW_TIME, COMMON_SIGMA, BIAS, BIAS_SIGMA = range(7)
"""Places of the numbers of an epoch that `update_second` returns."""

KEPT = 600.0
"""s; a satellite that was not observed for longer has no slow error that is remembered."""

_NUMBERS_OF_EPOCH = 7
# Electrons per cubic metre; a density may differ from a profile without any by this much.
_LEAST_SPREAD = 1e11
# TECU; a cycle of both signals more, 0.52 TECU, is hidden in more noise than this.
_LARGEST_NOISE = 0.2
# A size of the layer that is known to this fraction is given to the model.
_KNOWN_MAPPING = 0.2


class FilterTable(NamedTuple):
    """Estimates of the filter.

    Attributes
    ----------
    state, covariance : ndarray, shapes (COMMON + k,), (COMMON + k, COMMON + k)
        b in TECU, a, density in TECU per metre, shape of the layer, c, and the slow errors of k
        satellites in TECU.
    satellite : ndarray of int64, shape (k,)
        Satellites of the slow errors.
    seen : ndarray, shape (k,)
        When they were last observed, s.
    memory : ndarray, shape (4,)
        Time of the last epoch, s, NaN at first; variance of the slow errors that was believed then,
        TECU^2; whether b is new, and whether so many contents have agreed that the past tells of b,
        a and density what the covariance says (one or zero).
    """

    state: FloatArray
    covariance: FloatArray
    satellite: npt.NDArray[np.int64]
    seen: FloatArray
    memory: FloatArray


@compiled
def choose_contents(  # type: ignore[no-untyped-def]
    table, time, elevation_chief, elevation_deputy, observed, sigma, satellite, elevation_mask
):
    """Return which contents are used and how many, and whether all their satellites have places.

    Used are those that are known and come from high enough. The time at which satellites were seen
    is set; no place is there either while one of another satellite is kept for too long.
    """
    used, count, is_arranged = np.zeros(len(observed), dtype=np.bool_), 0, True
    for row in range(len(observed)):
        lowest = min(elevation_chief[row], elevation_deputy[row])
        if not (
            math.isfinite(observed[row]) and math.isfinite(sigma[row]) and lowest >= elevation_mask
        ):
            continue
        used[row] = True
        count += 1
        place = _place_of(table.satellite, satellite[row])
        if place < 0:
            is_arranged = False
        else:
            table.seen[place] = time
    for last in table.seen:
        is_arranged = is_arranged and time - last < KEPT
    return used, count, is_arranged


@compiled
def _place_of(satellites, number):  # type: ignore[no-untyped-def]
    """Return the row of a satellite, -1 for none."""
    for row in range(len(satellites)):
        if satellites[row] == number:
            return row
    return -1


@compiled
def _places(table, satellite):  # type: ignore[no-untyped-def]
    """Return the places of the slow errors of satellites (n,) in the state; -1 for none."""
    places = np.empty(len(satellite), dtype=np.int64)
    for row in range(len(satellite)):
        place = _place_of(table.satellite, satellite[row])
        places[row] = COMMON + place if place >= 0 else -1
    return places


@compiled
def pass_to(table, settings, profile, slow, time):  # type: ignore[no-untyped-def]
    """Predict the state at a time; return how long that is after the last one, s."""
    memory, values = table.memory, slow.values
    elapsed = 0.0 if math.isnan(memory[LAST_TIME]) else max(0.0, time - memory[LAST_TIME])
    memory[LAST_TIME] = time
    # What the errors of measurements prove to be changes what was learned from them.
    variance = values[SIGMA] ** 2
    ratio = variance / memory[SLOW_VARIANCE]
    memory[SLOW_VARIANCE] = variance
    decay = math.exp(-elapsed / values[CORRELATION_TIME])
    gained = settings.walk * elapsed
    gained[COMMON] = variance * (1.0 - decay * decay)
    # What the constant has drifted by since is no error of what was measured before.
    known = table.covariance[0, 0]
    profile.densities[CONSTANT] *= known / (known + gained[0])
    predict(
        table.state,
        table.covariance,
        ratio,
        decay,
        gained,
        settings.first_variance,
        settings.density_variance,
    )
    return elapsed


@compiled
def _correct_all(table, profile, design, residual, variance):  # type: ignore[no-untyped-def]
    """Update the filter and what was measured with the same constant; return the gain.

    Arguments as in `kernels.correct`.
    """
    before = table.state[0]
    gain = correct(table.state, table.covariance, design, residual, variance)
    move_constant(profile, table.state[0] - before)
    return gain


@compiled
def _add_content(  # type: ignore[no-untyped-def]
    table, settings, profile, rays, altitude, vtec_tecu, sigma_tecu, elapsed
):
    """Learn from an absolute content how large the layer above an altitude (m) is.

    Its error is that of the receiver bias and hardly changes: all contents of `content_time`
    together count as one.
    """
    if not (math.isfinite(vtec_tecu) and 0.0 < sigma_tecu < math.inf and elapsed > 0.0):
        return
    design, modelled = vertical_design(altitude, profile, rays, table.state)
    repeated = max(1.0, 2.0 * settings.content_time / elapsed)
    residual = np.full(1, vtec_tecu - modelled)
    _correct_all(table, profile, design, residual, np.full(1, repeated * sigma_tecu**2))


@compiled
def _examine_contents(  # type: ignore[no-untyped-def]
    table, settings, common, places, residual, fast_variance, is_independent
):
    """Compare contents with each other and the past; raise variances (TECU^2, in place).

    Returns the design, the rows that are kept, how many of these check the others, and whether they
    are enough for that. Arguments are those of `kernels.compare`, contents less those that are
    modelled, TECU, and those of `update_second`.
    """
    is_checked = table.memory[IS_CHECKED] > 0.0
    design, innovation, spread, is_wrong, is_any_off, unknown = examine(
        common,
        places,
        table.state,
        table.covariance,
        residual,
        fast_variance,
        is_checked,
        settings.outlier_sigmas,
        settings.outlier_tecu,
    )
    kept = np.flatnonzero(~is_wrong)
    if is_checked and is_any_off:
        fast_variance[kept] += unsaid_variances(
            innovation[kept], spread[kept][:, kept], unknown, settings.outlier_sigmas
        )
    # Where noise hides a wrong integer, a satellite checks nothing.
    count = 0
    for row in kept:
        count += is_independent[row] and fast_variance[row] < _LARGEST_NOISE**2
    return design, kept, count, count >= unknown + settings.spare_satellites


@compiled
def _keep_positive(table, settings, profile):  # type: ignore[no-untyped-def]
    """Pull an impossible density to zero."""
    sigma = math.sqrt(table.covariance[DENSITY, DENSITY])
    if table.state[DENSITY] < -settings.negative_sigmas * sigma:
        design = np.zeros((1, len(table.state)))
        design[0, DENSITY] = 1.0
        _correct_all(table, profile, design, np.zeros(1), np.full(1, sigma**2))


@compiled
def _describe_epoch(  # type: ignore[no-untyped-def]
    table, slow, separation, used, kept, common, residual, fast_variance, gain, horizontal_sigma
):
    """Return what the filter tells of an epoch: its numbers (7,), rows (3, n), and outliers (n,).

    Some of all n satellites are `used`, and rows of these `kept`; the other arrays are those of the
    satellites that are used, `gain` that of those that are kept. The rows are the density from each
    satellite, its sigma, and its slow part, see `DensityEpoch`; the numbers are in their order.
    """
    rows_used = np.flatnonzero(used)
    is_outlier = used.copy()
    rows = np.full((3, len(used)), math.nan)
    rows[2] = 0.0
    slow_sigma = slow.values[SIGMA]
    variances = fast_variance[kept]
    single = satellite_densities(
        common[kept],
        residual[kept],
        variances + slow_sigma**2,
        table.state,
        table.covariance,
    )
    slow_parts = slow_sigma * gain[DENSITY]
    squares, fast = slow_parts @ slow_parts, gain[DENSITY] ** 2 @ variances
    variance = table.covariance[DENSITY, DENSITY]
    # What the past tells of slow errors is no error any more.
    left = min(max(variance - fast, 0.0) / max(squares, 1e-30), 1.0)
    for row in range(len(kept)):
        place = rows_used[kept[row]]
        is_outlier[place] = False
        rows[0, place] = ELECTRONS_PER_TECU * single[0, row]
        rows[1, place] = ELECTRONS_PER_TECU * single[1, row]
        rows[2, place] = slow_parts[row] * math.sqrt(left) * ELECTRONS_PER_TECU
    common_variance = max(variance - fast - left * squares, 0.0)
    whole = variance + (horizontal_sigma / separation) ** 2
    numbers = np.empty(_NUMBERS_OF_EPOCH)
    numbers[EPOCH_DENSITY] = table.state[DENSITY] * ELECTRONS_PER_TECU
    numbers[EPOCH_SIGMA] = math.sqrt(whole) * ELECTRONS_PER_TECU
    numbers[FAST_SIGMA] = math.sqrt(fast) * ELECTRONS_PER_TECU
    numbers[SLOW_TIME] = slow.values[CORRELATION_TIME]
    numbers[COMMON_SIGMA] = math.sqrt(common_variance) * ELECTRONS_PER_TECU
    numbers[BIAS] = table.state[0]
    numbers[BIAS_SIGMA] = math.sqrt(table.covariance[0, 0])
    return numbers, rows, is_outlier


@compiled
def update_second(  # type: ignore[no-untyped-def]
    table,
    settings,
    profile,
    slow,
    rays,
    time,
    altitude_chief,
    altitude_deputy,
    cosine_chief,
    cosine_deputy,
    sine,
    observed,
    sigma,
    satellite,
    used,
    vtec_chief,
    vtec_sigma,
    horizontal_sigma,
    is_independent,
    constant_sigma,
):
    """Update the filter with the contents of a second, of which some are used.

    Parameters
    ----------
    table : FilterTable
        All satellites that are used have a place in it.
    settings : FilterSettings
    profile, slow, rays : ProfileTable, SlowTable, RayTable
        The last two have room for the second.
    time : float
        s.
    used : ndarray of bool, shape (n,)
        As of `choose_contents`; at least one is used.
    altitude_chief, ..., constant_sigma
        As in `ElectronDensityEstimator.update`.

    Returns
    -------
    is_told : bool
        Whether there is an epoch; if not, the other results mean nothing.
    numbers, rows, is_outlier : ndarray, shapes (7,), (3, n), (n,)
        As of `_describe_epoch`.
    learned : ndarray, shape (3,)
        Density, its sigma and how it changes with b, which `update_model` adds to the profile,
        electrons per cubic metre, and these per TECU; NaN for none.
    """
    elapsed = pass_to(table, settings, profile, slow, time)
    _add_content(table, settings, profile, rays, altitude_chief, vtec_chief, vtec_sigma, elapsed)
    common, modelled = content_design(
        cosine_chief[used],
        cosine_deputy[used],
        sine[used],
        altitude_chief,
        altitude_deputy,
        profile,
        rays,
        table.state,
    )
    residual = observed[used] - modelled
    fast_variance = sigma[used] ** 2 + (settings.mapping_noise * common[:, CHANGE]) ** 2
    memory = table.memory
    if memory[IS_BIAS_NEW] > 0.0:
        # It contains integers and may be anything: the first contents tell where it is.
        memory[IS_BIAS_NEW] = 0.0
        table.state[0] = np.median(residual)
    satellites = satellite[used]
    design, kept, count, has_check = _examine_contents(
        table,
        settings,
        common,
        _places(table, satellites),
        residual,
        fast_variance,
        is_independent[used],
    )
    if memory[IS_CHECKED] > 0.0 and not has_check:
        return False, np.empty(0), np.empty((0, 0)), np.zeros(0, dtype=np.bool_), np.empty(0)
    add_epoch(
        slow,
        time,
        satellites[kept],
        residual[kept],
        common[kept],
        settings.loose_sigma,
        fast_variance[kept],
    )
    gain = _correct_all(table, profile, design[kept], residual[kept], fast_variance[kept])
    _keep_positive(table, settings, profile)
    separation = altitude_deputy - altitude_chief
    numbers, rows, is_outlier = _describe_epoch(
        table,
        slow,
        separation,
        used,
        kept,
        common,
        residual,
        fast_variance,
        gain,
        horizontal_sigma,
    )
    learned = np.full(3, math.nan)
    if count >= WITHOUT_PAST + settings.spare_satellites:
        memory[IS_CHECKED] = 1.0
    density, density_sigma = numbers[EPOCH_DENSITY], numbers[EPOCH_SIGMA]
    if not (has_check and density_sigma <= settings.largest_sigma):
        numbers[EPOCH_DENSITY] = numbers[EPOCH_SIGMA] = math.nan
        return True, numbers, rows, is_outlier, learned
    learned[0], learned[1] = density, density_sigma
    learned[2] = table.covariance[DENSITY, 0] / table.covariance[0, 0] * ELECTRONS_PER_TECU
    if constant_sigma > 0.0:
        # With another constant all that was learned is another one too.
        shift = constant_sigma * ELECTRONS_PER_TECU
        numbers[EPOCH_SIGMA] = math.hypot(density_sigma, shift * np.sum(gain[DENSITY]))
        rows_used = np.flatnonzero(used)
        for row in range(len(rows_used)):
            of_satellite = shift / abs(common[row, DENSITY])
            rows[1, rows_used[row]] = math.hypot(rows[1, rows_used[row]], of_satellite)
    return True, numbers, rows, is_outlier, learned


@compiled
def update_model(table, profile, height_factors, altitude_chief, altitude_deputy, learned):  # type: ignore[no-untyped-def]
    """Give the model layer the size and the shape that are estimated, and add what was learned.

    Parameters
    ----------
    table, profile, altitude_chief, altitude_deputy
        As in `update_second`.
    height_factors : ndarray, shape (2,)
        Exponentials of the estimated changes of the scale heights, `HEIGHTS` of the state.
    learned : ndarray, shape (3,)
        As of `update_second`.
    """
    state, covariance = table.state, table.covariance
    change_of_peak = state[FIRST_SHAPE + 2]
    state[FIRST_SHAPE : FIRST_SHAPE + SHAPE_NUMBERS] = 0.0
    factor = 1.0 + state[1]
    if factor > 0.0 and covariance[1, 1] < (_KNOWN_MAPPING * factor) ** 2:
        state[1] = 0.0
        covariance[1, :] /= factor
        covariance[:, 1] /= factor
    else:
        factor = 1.0
    reshape_and_resize(profile, height_factors, change_of_peak, factor)
    density, sigma, per_constant = learned
    if not math.isnan(density):
        absorb_density(profile, altitude_chief, altitude_deputy, density, sigma, per_constant)


@compiled
def past_second(  # type: ignore[no-untyped-def]
    table,
    settings,
    profile,
    slow,
    rays,
    elapsed,
    altitude_chief,
    altitude_deputy,
    cosine_chief,
    cosine_deputy,
    sine,
    observed,
    sigma,
    satellite,
    used,
    horizontal_sigma,
):
    """Return what is known now of the contents of a second of the past; `table` is given up.

    Arguments as in `update_second`, but `elapsed`, the time since then, s. Returned are whether
    there is a density, and its numbers, rows and outliers.
    """
    forget_density(table.state, table.covariance, settings.density_variance)
    common, modelled = content_design(
        cosine_chief[used],
        cosine_deputy[used],
        sine[used],
        altitude_chief,
        altitude_deputy,
        profile,
        rays,
        table.state,
    )
    residual = observed[used] - modelled
    places = _places(table, satellite[used])
    # The slow errors of then are not all those of now.
    lost = 1.0 - math.exp(-2.0 * elapsed / slow.values[CORRELATION_TIME])
    variance = sigma[used] ** 2 + (settings.mapping_noise * common[:, CHANGE]) ** 2
    variance += np.where(places < 0, 1.0, lost) * slow.values[SIGMA] ** 2
    independent = np.ones(len(residual), dtype=np.bool_)
    design, kept, _, has_check = _examine_contents(
        table, settings, common, places, residual, variance, independent
    )
    if not has_check:
        return False, np.empty(0), np.empty((0, 0)), np.zeros(0, dtype=np.bool_)
    gain = correct(table.state, table.covariance, design[kept], residual[kept], variance[kept])
    separation = altitude_deputy - altitude_chief
    numbers, rows, is_outlier = _describe_epoch(
        table,
        slow,
        separation,
        used,
        kept,
        common,
        residual,
        variance,
        gain,
        horizontal_sigma,
    )
    return numbers[EPOCH_SIGMA] <= settings.largest_sigma, numbers, rows, is_outlier


@compiled
def predicted_contents(  # type: ignore[no-untyped-def]
    table,
    settings,
    profile,
    slow,
    rays,
    altitude_chief,
    altitude_deputy,
    cosine_chief,
    cosine_deputy,
    sine,
    satellite,
):
    """Return the contents that are predicted, TECU, (n,), and their covariance.

    Arguments as in `update_second`, results as of `ElectronDensityEstimator.predicted_stec`.
    """
    common, modelled = content_design(
        cosine_chief,
        cosine_deputy,
        sine,
        altitude_chief,
        altitude_deputy,
        profile,
        rays,
        table.state,
    )
    places = _places(table, satellite)
    own = (settings.mapping_noise * common[:, CHANGE]) ** 2
    own += np.where(places < 0, slow.values[SIGMA] ** 2, 0.0)
    # The density of the profile, and its own size.
    low, high = min(altitude_chief, altitude_deputy), max(altitude_chief, altitude_deputy)
    density = mean_between(low, high, profile.altitude, profile.densities[0]) / ELECTRONS_PER_TECU
    return likely_contents(
        common,
        modelled,
        places,
        table.state,
        table.covariance,
        own,
        density,
        (density + _LEAST_SPREAD / ELECTRONS_PER_TECU) ** 2,
    )
