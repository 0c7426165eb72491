"""Arithmetic of the noise models, compiled: sixty models of the errors of two dozen signals."""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.compiled import compiled

__all__ = ["adjust", "expect_slow_error", "update_models"]


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
