"""Arithmetic of the noise models, compiled: sixty models of the errors of two dozen signals."""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND

__all__ = [
    "adjust",
    "collect_residuals",
    "common_unknowns",
    "count_codes",
    "equivalent_variances",
    "expect_slow_error",
    "ratios_of_means",
    "update_models",
]


@compiled
def adjust(values, sigma, design, prior):  # type: ignore[no-untyped-def]
    """Return the residuals of a least-squares adjustment and the redundancy numbers.

    Arguments are those of `Redundancy.of`, results the fields of `Redundancy`.
    """
    count, unknowns, sets = len(values), design.shape[1], values.shape[1]
    whitened, scaled = np.empty((count, unknowns)), np.empty((count, sets))
    for n in range(count):
        for p in range(unknowns):
            whitened[n, p] = design[n, p] / sigma[n]
        for k in range(sets):
            scaled[n, k] = values[n, k] / sigma[n]
    normal = whitened.T @ whitened
    # A trace of a prior keeps unknowns that the epoch cannot tell apart from each other.
    for p in range(unknowns):
        normal[p, p] += prior[p] + 1e-9 * normal[p, p] + 1e-30
    gain = np.linalg.solve(normal, whitened.T.copy())
    unknown = gain @ scaled
    residual, number = np.empty((count, sets)), np.empty(count)
    for n in range(count):
        explained = 0.0
        for p in range(unknowns):
            explained += whitened[n, p] * gain[p, n]
        number[n] = 1.0 - explained
        scale = sigma[n] / math.sqrt(max(number[n], 1e-6))
        for k in range(sets):
            fitted = 0.0
            for p in range(unknowns):
                fitted += whitened[n, p] * unknown[p, k]
            residual[n, k] = scale * (scaled[n, k] - fitted)
    return residual, number


@compiled
def update_models(  # type: ignore[no-untyped-def]
    mean, variance, log_likelihood, sigmas, times, gaps, residual, number, noise, largest, smallest
):
    """Carry the slow errors that each model expects over a time, and weigh them, in place.

    Parameters
    ----------
    mean, variance : ndarray, shape (models, n)
        Expected slow errors of n signals, m, and their variances, m2.
    log_likelihood : ndarray, shape (models,)
    sigmas, times : ndarray, shape (models,)
        Sigma (m) and correlation time (s) of each model; the widest model is the last one.
    gaps : ndarray, shape (n,)
        Since the last residual of each signal, s.
    residual, number : ndarray, shape (n,)
        See `Redundancy`.
    noise : ndarray, shape (n,)
        Variances of the white noise, m2.
    largest, smallest : float
        Normalised residual beyond which, and redundancy number below which, it is no sample.

    Returns
    -------
    bool
        Whether there was any sample.
    """
    models, count = mean.shape
    # The widest model decides what is no sample of any.
    is_sample = np.empty(count, np.bool_)
    has_sample = False
    for n in range(count):
        widest = sigmas[models - 1] ** 2 + noise[n]
        is_sample[n] = number[n] > smallest and residual[n] ** 2 < largest**2 * widest
        has_sample = has_sample or is_sample[n]
    for model in range(models):
        steady, terms = sigmas[model] ** 2, 0.0
        decay, last_gap = 1.0, 0.0
        for n in range(count):
            if gaps[n] != last_gap:
                last_gap = gaps[n]
                decay = math.exp(-last_gap / times[model])
            expected = decay * mean[model, n]
            spread = decay**2 * variance[model, n] + (1.0 - decay**2) * steady
            if is_sample[n]:
                total, error = spread + noise[n], residual[n] - expected
                # Residuals of an epoch depend on each other: they count as the redundancy.
                terms -= 0.5 * number[n] * (math.log(total) + error**2 / total)
                gain = spread / total
                expected += gain * error
                spread *= 1.0 - gain
            mean[model, n], variance[model, n] = expected, spread
        log_likelihood[model] += terms
    if has_sample:
        log_likelihood -= log_likelihood.max()
    return has_sample


@compiled
def expect_slow_error(log_weight, sigmas, times):  # type: ignore[no-untyped-def]
    """Return the probability of the first model, and sigma and time expected of the others.

    Parameters
    ----------
    log_weight : ndarray, shape (models,)
        Logarithms of the probabilities of the models, but for a common term.
    sigmas, times : ndarray, shape (models,)
        m and s.
    """
    largest = log_weight.max()
    none, others, square, weighted_time = math.exp(log_weight[0] - largest), 0.0, 0.0, 0.0
    for model in range(1, len(log_weight)):
        weight = math.exp(log_weight[model] - largest)
        others += weight
        square += weight * sigmas[model] ** 2
        weighted_time += weight * sigmas[model] ** 2 * times[model]
    if others == 0.0:
        return 1.0, 0.0, 0.0
    return none / (none + others), math.sqrt(square / others), weighted_time / square


@compiled
def count_codes(  # type: ignore[no-untyped-def]
    places,
    time,
    longest_absence,
    noise_growth,
    code_variance,
    phase_variance,
    code_factor,
    phase_factor,
    times,
    counts,
):
    """Return the white variances of n codes and phases; count the epochs of each code.

    Parameters
    ----------
    places : ndarray of int, shape (n,)
        See `SignalPlaces.of`.
    time : int
        Epoch, GPS, ns.
    longest_absence : float
        The count begins anew after it, s.
    noise_growth, code_variance, phase_variance : ndarray, shape (n,)
        Columns of `SingleDifferences`.
    code_factor, phase_factor : float
        White factors of codes and phases.
    times, counts : ndarray of int, shape (places,)
        Last epoch of each signal, ns (-1 before the first one), and its count; they are changed.

    Returns
    -------
    numbers : ndarray, shape (3, n)
        What the growth of the noise raises variances by, the variances of codes without it, and
        those of phases with it, m2.
    epochs : ndarray of int64, shape (n,)
    """
    count = len(places)
    numbers, epochs = np.empty((3, count)), np.empty(count, np.int64)
    for n in range(count):
        place, power = places[n], noise_growth[n] ** 2
        numbers[0, n] = power
        numbers[1, n] = code_factor * code_variance[n] / power
        numbers[2, n] = phase_factor * phase_variance[n]
        absence = (time - times[place]) / NANOSECONDS_PER_SECOND
        if times[place] < 0 or absence > longest_absence:
            counts[place] = 0
        counts[place] += 1
        times[place], epochs[n] = time, counts[place]
    return numbers, epochs


@compiled
def ratios_of_means(epochs, interval, correlation_time):  # type: ignore[no-untyped-def]
    """Return the spans of the means of k and of k - 1 measurements over a time, shape (2, n).

    Parameters
    ----------
    epochs : ndarray of int, shape (n,)
        Number k of each measurement.
    interval, correlation_time : float
        s.
    """
    ratios = np.empty((2, len(epochs)))
    for n in range(len(epochs)):
        count = float(epochs[n])
        for row in range(2):
            ratios[row, n] = max(max(count - row, 1.0) * interval / correlation_time, 1e-9)
    return ratios


@compiled
def equivalent_variances(white, slow_variance, epochs, ratios, decay, largest_slow):  # type: ignore[no-untyped-def]
    """Return the variances of white noise that is worth as much as white and slow noise.

    Parameters
    ----------
    white : ndarray, shape (n,)
    slow_variance : float
        m2.
    epochs : ndarray of int, shape (n,)
    ratios, decay : ndarray, shape (2, n)
        See `ratios_of_means`, and exp(-ratios) - 1.
    largest_slow : float
        Most by which a variance exceeds that of the white component, m2.
    """
    variances = np.empty(len(white))
    for n in range(len(white)):
        gained = 0.0
        for row in range(2):
            count = float(epochs[n])
            if row == 1 and not count > 1.0:
                continue
            ratio = ratios[row, n]
            shared = 2.0 / ratio * (1.0 + decay[row, n] / ratio)
            known = max(max(count - row, 1.0), 1e-9)
            information = 1.0 / (slow_variance * shared + white[n] / known)
            gained = information if row == 0 else gained - information
        largest = white[n] + largest_slow
        variances[n] = max(1.0 / max(gained, 1.0 / largest), white[n])
    return variances


@compiled
def common_unknowns(direction, clock_rate, group_rows, groups):  # type: ignore[no-untyped-def]
    """Return the derivatives of n codes or phases by position, clock and biases, (n, 3 + groups).

    Parameters
    ----------
    direction, clock_rate : ndarray, shape (n, 3) and (n,)
        See `Sky`.
    group_rows : ndarray of int, shape (n,)
        Group of each signal; the bias of the first one is the clock.
    groups : int
        Number of groups.
    """
    count = len(clock_rate)
    common = np.zeros((count, 3 + groups))
    for n in range(count):
        for axis in range(3):
            common[n, axis] = -direction[n, axis]
        common[n, 3 + group_rows[n]] = 1.0
        common[n, 3] = clock_rate[n]
    return common


@compiled
def collect_residuals(  # type: ignore[no-untyped-def]
    places,
    time,
    last_time,
    longest_gap,
    code,
    phase,
    code_variance,
    phase_variance,
    predicted,
    integer_cycles,
    wavelength,
    is_phase_continued,
    noise_growth,
    common,
    plasma,
    times,
    levels,
):
    """Return what the noise is learnt from at an epoch, as if it had not grown; keep the levels.

    Parameters
    ----------
    places : ndarray of int, shape (n,)
        See `SignalPlaces.of`.
    time, last_time : int
        This epoch and the last one of these, GPS, ns; -1 before the first one.
    longest_gap : float
        Changes are those of a shorter time, s.
    code, ..., plasma : ndarray
        See `EpochResiduals` and `SingleDifferences`.
    times : ndarray of int, shape (places,)
        Last epoch of each signal, ns; it is changed.
    levels : ndarray, shape (2, places)
        Its code and phase less the predicted ones, m; they are changed.

    Returns
    -------
    values : ndarray, shape (2, n, 2)
        Codes and phases: changes since the last epoch, and levels, m; NaN where unknown.
    variances : ndarray, shape (2, n)
        Codes and phases, m2.
    common_scaled : ndarray, shape (n, p)
    all_scaled : ndarray, shape (n, p + q)
    """
    count, unknowns = common.shape
    values, variances = np.full((2, count, 2), np.nan), np.empty((2, count))
    common_scaled = np.empty((count, unknowns))
    all_scaled = np.empty((count, unknowns + plasma.shape[1]))
    gap = (time - last_time) / NANOSECONDS_PER_SECOND
    for n in range(count):
        place, growth = places[n], noise_growth[n]
        code_level, phase_level = code[n] - predicted[n], phase[n] - predicted[n]
        if times[place] >= 0 and times[place] == last_time and gap < longest_gap:
            values[0, n, 0] = (code_level - levels[0, place]) / growth
            if is_phase_continued[n]:
                values[1, n, 0] = (phase_level - levels[1, place]) / growth
        values[0, n, 1] = code_level / growth
        values[1, n, 1] = (phase_level - integer_cycles[n] * wavelength[n]) / growth
        times[place], levels[0, place], levels[1, place] = time, code_level, phase_level
        variances[0, n] = code_variance[n] / growth**2
        variances[1, n] = phase_variance[n] / growth**2
        for k in range(unknowns):
            common_scaled[n, k] = all_scaled[n, k] = common[n, k] / growth
        for k in range(plasma.shape[1]):
            all_scaled[n, unknowns + k] = plasma[n, k] / growth
    return values, variances, common_scaled, all_scaled
