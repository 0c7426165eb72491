"""The measurement model of single differences, and the search for their faults, compiled.

Dozens of array operations on two dozen signals cost twenty times what their arithmetic does.
"""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.compiled import compiled

__all__ = ["find_worst_measurement", "leave_one_out", "model_differences"]


@compiled
def model_differences(  # type: ignore[no-untyped-def]
    mean,
    chief_position,
    direction,
    direction_chief,
    predicted_range,
    clock_rate,
    plasma_columns,
    plasma_delay,
    plasma_total,
    all_waves,
    wave_columns,
    wave_delay,
    antenna_columns,
    antenna_derivatives,
    antenna_totals,
    troposphere_column,
    troposphere,
    phase_columns,
    code_columns,
    slow_columns,
    offset_columns,
    ray_turn,
    cycles,
    wavelength,
    noise_growth,
    code,
    phase,
    code_variance,
    phase_variance,
    further,
):
    """Return the linear model of n codes, n phases and `further` measurements, in this order.

    Parameters
    ----------
    mean : ndarray, shape (members,)
        Mean of the state, which begins with the position of the deputy relative to the chief.
    chief_position : int
        First column of the position of the chief; -1 where it is no member.
    direction, direction_chief : ndarray, shape (n, 3)
        See `Sky`.
    predicted_range : ndarray, shape (n,)
        Predicted differences without what is in the state, with the receiver clocks, m.
    clock_rate : ndarray, shape (n,)
        See `Sky`.
    plasma_columns : ndarray of int, shape (p,)
        Members of layers and shells; none where the plasma is no member.
    plasma_delay : ndarray, shape (n, p)
        Derivatives of the codes by them.
    plasma_total : ndarray, shape (n,)
        What codes are delayed by them, m.
    all_waves : ndarray of int, shape (w,)
        Members of waves; `wave_columns` are those of the signals, and `wave_delay`, shape (n,), are
        the derivatives of their codes.
    antenna_columns : ndarray of int, shape (k,)
        Members of lever arms and attitudes.
    antenna_derivatives : ndarray, shape (n, k)
    antenna_totals : ndarray, shape (2, n)
        What lever arms, and what attitudes, lengthen codes and phases by, m.
    troposphere_column : int
        Its member; -1 without.
    troposphere : ndarray, shape (n,)
        See `Sky`.
    phase_columns, code_columns, slow_columns, offset_columns, cycles : ndarray, shape (n,)
        See `ArcColumns`.
    ray_turn : ndarray, shape (n,)
        See `Sky`.
    wavelength, noise_growth, code, phase, code_variance, phase_variance : ndarray, shape (n,)
        Columns of `SingleDifferences`.
    further : int
        Number of rows that are left at the end.

    Returns
    -------
    design : ndarray, shape (2 n + further, members)
    values, variances : ndarray, shape (2 n + further,)
        Measured less predicted, m, and variances of the noise, m2.
    nuisance : ndarray, shape (2 n + further, 1)
        Derivatives by the difference of the receiver clocks; none where n is 0.
    """
    count = len(code)
    size = 2 * count + further
    design = np.zeros((size, len(mean)))
    values, variances = np.zeros(size), np.zeros(size)
    nuisance = np.zeros((size, min(count, 1)))
    for n in range(count):
        m = count + n
        predicted_code = predicted_phase = predicted_range[n]
        for axis in range(3):
            design[n, axis] = design[m, axis] = -direction[n, axis]
            if chief_position >= 0:
                # Both antennas are off by the error of the chief's position, along two rays.
                both = direction_chief[n, axis] - direction[n, axis]
                design[n, chief_position + axis] = design[m, chief_position + axis] = both
        if len(plasma_columns):
            # The ionosphere delays codes and advances phases.
            for p in range(len(plasma_columns)):
                design[n, plasma_columns[p]] = plasma_delay[n, p]
                design[m, plasma_columns[p]] = -plasma_delay[n, p]
            total = plasma_total[n]
            if len(all_waves):
                for w in range(len(all_waves)):
                    design[n, all_waves[w]] = -0.0
                design[n, wave_columns[n]] = wave_delay[n]
                design[m, wave_columns[n]] = -wave_delay[n]
                total += wave_delay[n] * mean[wave_columns[n]]
            predicted_code += total
            predicted_phase -= total
        if len(antenna_columns):
            for k in range(len(antenna_columns)):
                design[n, antenna_columns[k]] = antenna_derivatives[n, k]
                design[m, antenna_columns[k]] = antenna_derivatives[n, k]
            predicted_code = predicted_code + antenna_totals[0, n] + antenna_totals[1, n]
            predicted_phase = predicted_phase + antenna_totals[0, n] + antenna_totals[1, n]
        if troposphere_column >= 0:
            design[n, troposphere_column] = design[m, troposphere_column] = troposphere[n]
            predicted_code += troposphere[n] * mean[troposphere_column]
            predicted_phase += troposphere[n] * mean[troposphere_column]
        design[m, phase_columns[n]] = 1.0
        column = offset_columns[n]
        if column >= 0:
            # Errors of a satellite across its rays turn these.
            design[n, column] = design[m, column] = ray_turn[n]
            predicted_code += ray_turn[n] * mean[column]
            predicted_phase += ray_turn[n] * mean[column]
        slow_error, column = 0.0, slow_columns[n]
        if column >= 0:
            design[m, column] = noise_growth[n]
            slow_error = noise_growth[n] * mean[column]
        column = code_columns[n]
        if column >= 0:
            design[n, column] = 1.0
            predicted_code += mean[column]
        predicted_phase += mean[phase_columns[n]] + slow_error + cycles[n] * wavelength[n]
        values[n], values[m] = code[n] - predicted_code, phase[n] - predicted_phase
        variances[n], variances[m] = code_variance[n], phase_variance[n]
        nuisance[n, 0] = nuisance[m, 0] = clock_rate[n]
    return design, values, variances, nuisance


@compiled
def leave_one_out(weight, weighted, variances, is_used):  # type: ignore[no-untyped-def]
    """Return the residual of each of m measurements against all others, and its variance, (m,).

    Parameters
    ----------
    weight : ndarray, shape (m, m)
        See `Innovation`.
    weighted : ndarray, shape (m,)
        Its product with the values.
    variances : ndarray, shape (m,)
    is_used : ndarray of bool, shape (m,)
    """
    count = len(weighted)
    residual, variance = np.zeros(count), np.full(count, np.inf)
    for m in range(count):
        if is_used[m] and weight[m, m] > 1e-6 / variances[m]:
            residual[m], variance[m] = weighted[m] / weight[m, m], 1.0 / weight[m, m]
    return residual, variance


@compiled
def find_worst_measurement(residual, variance, noise, is_scattered, slip, limit):  # type: ignore[no-untyped-def]
    """Return the measurement that fits worst, -1 if all do; see `reject_faults`.

    Parameters
    ----------
    residual, variance : ndarray, shape (m,)
        See `leave_one_out`.
    noise : ndarray, shape (m,)
    is_scattered : ndarray of bool, shape (n,)
    slip : ndarray, shape (n,)
        Residuals of the phases beyond which they have slipped, m.
    limit : float
    """
    count, worst, largest = len(slip), 0, -math.inf
    for m in range(len(residual)):
        normalised = abs(residual[m]) / math.sqrt(variance[m])
        n = m - count
        if 0 <= n < count and is_scattered[n] and variance[m] < 2.0 * noise[m]:
            if abs(residual[m]) > slip[n]:
                normalised += limit
        if math.isnan(normalised):
            return m
        if normalised > largest:
            worst, largest = m, normalised
    return worst if largest > limit else -1
