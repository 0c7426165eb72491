"""From the columns of an epoch to combinations of carriers and receivers, compiled.

An array operation on a dozen satellites costs twenty times what its arithmetic does.
"""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_gnss.constants import (
    FLAG_CODE_VALID,
    FLAG_HALF_CYCLE_ADDED,
    FLAG_LOCK_LOST,
    FLAG_PARITY_KNOWN,
    FLAG_PHASE_VALID,
)

__all__ = [
    "clock_from_codes",
    "combine_carriers",
    "combine_receivers",
    "difference_receivers",
    "mean_of_combinations",
    "read_signals",
]

_CODE_AND_PHASE_VALID = FLAG_CODE_VALID | FLAG_PHASE_VALID


@compiled
def read_signals(  # type: ignore[no-untyped-def]
    order,
    satellite,
    carrier,
    wavelength,
    has_ephemeris,
    flags,
    pseudorange,
    carrier_phase_cycles,
    pseudorange_sigma,
    carrier_phase_sigma_cycles,
    doppler_hz,
    lock_time,
    sigmas,
    smallest_sigmas,
    use_receiver_sigmas,
):
    """Return the signals of an epoch that have valid code and phase, the first of each carrier.

    Parameters
    ----------
    order : ndarray of int, shape (n,)
        Rows of n signals in the columns of the epoch, the preferred one of a carrier first.
    satellite, carrier, wavelength : ndarray, shape (n,)
        Their satellites, carriers and wavelengths, m.
    has_ephemeris : ndarray of bool
        Whether a satellite number has an ephemeris.
    flags, ..., lock_time : ndarray, shape (k,)
        Columns of `ObservationEpoch`: flags, pseudorange, carrier phase, sigmas of both, Doppler
        shift and lock time.
    sigmas, smallest_sigmas : ndarray, shape (2,)
        Sigmas of code and phase where the receiver states none, and lower limits of those that it
        states, m.
    use_receiver_sigmas : bool

    Returns
    -------
    rows : ndarray of int, shape (m,)
        Which of the n signals are used.
    numbers : ndarray, shape (6, m)
        Pseudorange, carrier range, their sigmas, range rate (m, m/s) and lock time (s).
    flags_used : ndarray, shape (m,)
        Their flags.
    """
    count = len(carrier)
    rows, numbers = np.empty(count, np.int64), np.empty((6, count))
    flags_used = np.empty(count, flags.dtype)
    size, last = 0, -1
    for n in range(count):
        if carrier[n] == last or not has_ephemeris[satellite[n]]:
            continue
        row = order[n]
        carrier_range = wavelength[n] * carrier_phase_cycles[row]
        if flags[row] & _CODE_AND_PHASE_VALID != _CODE_AND_PHASE_VALID or not math.isfinite(
            pseudorange[row] + carrier_range
        ):
            continue
        last, rows[size], flags_used[size] = carrier[n], n, flags[row]
        code_sigma, phase_sigma = sigmas[0], sigmas[1]
        if use_receiver_sigmas:
            stated = float(pseudorange_sigma[row])
            if stated > 0.0:
                code_sigma = max(stated, smallest_sigmas[0])
            stated = float(carrier_phase_sigma_cycles[row]) * wavelength[n]
            if stated > 0.0:
                phase_sigma = max(stated, smallest_sigmas[1])
        numbers[0, size], numbers[1, size] = pseudorange[row], carrier_range
        numbers[2, size], numbers[3, size] = code_sigma, phase_sigma
        numbers[4, size] = -wavelength[n] * float(doppler_hz[row])
        numbers[5, size] = float(lock_time[row])
        size += 1
    return rows[:size].copy(), numbers[:, :size].copy(), flags_used[:size].copy()


@compiled
def combine_carriers(  # type: ignore[no-untyped-def]
    first,
    second,
    is_dual,
    factor_first,
    factor_second,
    pseudorange,
    delay,
    carrier_range,
    code_sigma,
    phase_sigma,
    range_rate,
    flags,
    lock_time,
):
    """Return combinations of the first two carriers of n satellites; see `Combinations`.

    Parameters
    ----------
    first, second, is_dual, factor_first, factor_second : ndarray, shape (n,)
        Rows of the carriers, whether they are two, and the factors of the combination.
    pseudorange, delay, carrier_range, code_sigma, phase_sigma, range_rate, flags, lock_time
        Columns of signals; `delay` is that of the code against the broadcast clock, m.

    Returns
    -------
    numbers : ndarray, shape (5, n)
        Code, phase, code sigma, phase sigma, range rate.
    is_lost : ndarray of bool, shape (n,)
    half_cycles : ndarray of int64, shape (n,)
    lock_times : ndarray, shape (n, 2)
    """
    count = len(first)
    numbers, lock_times = np.empty((5, count)), np.empty((count, 2))
    is_lost, half_cycles = np.empty(count, np.bool_), np.empty(count, np.int64)
    for n in range(count):
        a, b = first[n], second[n]
        factor_a, factor_b = factor_first[n], factor_second[n]
        code = pseudorange[a] - delay[a]
        numbers[0, n] = factor_a * code + factor_b * (pseudorange[b] - delay[b])
        numbers[2, n] = math.hypot(factor_a * code_sigma[a], factor_b * code_sigma[b])
        if is_dual[n]:
            numbers[1, n] = factor_a * carrier_range[a] + factor_b * carrier_range[b]
            numbers[3, n] = math.hypot(factor_a * phase_sigma[a], factor_b * phase_sigma[b])
        else:
            numbers[1, n] = 0.5 * (code + carrier_range[a])
            numbers[3, n] = 0.5 * math.hypot(code_sigma[a], phase_sigma[a])
        numbers[4, n] = range_rate[a]
        is_lost[n] = (flags[a] | flags[b]) & FLAG_LOCK_LOST != 0
        half_cycles[n] = 0
        if flags[a] & FLAG_HALF_CYCLE_ADDED:
            half_cycles[n] += 1
        if flags[b] & FLAG_HALF_CYCLE_ADDED:
            half_cycles[n] += 2
        lock_times[n, 0], lock_times[n, 1] = lock_time[a], lock_time[b]
    return numbers, is_lost, half_cycles, lock_times


@compiled
def combine_receivers(values, sigmas, values_deputy, sigmas_deputy, predicted, limit):  # type: ignore[no-untyped-def]
    """Return measurements of the chief with those of the deputy as further ones.

    Parameters
    ----------
    values, values_deputy : ndarray, shape (n,)
        Codes, or phases, of both receivers, m; NaN where one of them is not known.
    sigmas, sigmas_deputy : ndarray, shape (n,)
        m.
    predicted : ndarray, shape (2, n)
        Predicted measurements of chief and deputy but for the clocks, m.
    limit : float
        Sigmas by which those of the deputy may differ; others are not used.

    Returns
    -------
    values, sigmas : ndarray, shape (n,)
        Weighted means and their sigmas, m.
    shares : ndarray, shape (n,)
        Weights of the deputy.
    """
    count = len(values)
    difference, known = np.empty(count), np.empty(count)
    size = 0
    for n in range(count):
        difference[n] = values_deputy[n] - predicted[1, n] - values[n] + predicted[0, n]
        if math.isfinite(difference[n]):
            known[size] = difference[n]
            size += 1
    mean, sigma, shares = values.copy(), sigmas.copy(), np.zeros(count)
    if size == 0:
        return mean, sigma, shares
    # The clock of the deputy is the median: a few that are wrong do not move it.
    ordered = np.sort(known[:size])
    clock = ordered[size // 2]
    if size % 2 == 0:
        clock = 0.5 * (ordered[size // 2 - 1] + clock)
    for n in range(count):
        if not math.isfinite(difference[n]):
            continue
        change = difference[n] - clock
        variance, total = sigmas[n] ** 2, sigmas[n] ** 2 + sigmas_deputy[n] ** 2
        if change**2 < limit**2 * total:
            shares[n] = variance / total
            mean[n] += shares[n] * change
            sigma[n] *= math.sqrt(1.0 - shares[n])
    return mean, sigma, shares


@compiled
def difference_receivers(  # type: ignore[no-untyped-def]
    rows_chief,
    rows_deputy,
    mixed_variance,
    pseudorange_chief,
    carrier_range_chief,
    code_sigma_chief,
    phase_sigma_chief,
    flags_chief,
    lock_time_chief,
    pseudorange_deputy,
    carrier_range_deputy,
    code_sigma_deputy,
    phase_sigma_deputy,
    flags_deputy,
    lock_time_deputy,
):
    """Return the differences of n carriers, deputy less chief; see `SingleDifferences`.

    Parameters
    ----------
    rows_chief, rows_deputy : ndarray of int, shape (n,)
        Rows of the carriers in the columns of both receivers, which follow.
    mixed_variance : ndarray, shape (n,)
        Variances of the delays between their two codes, m2.

    Returns
    -------
    numbers : ndarray, shape (4, n)
        Code, phase (m) and their variances, m2.
    lock_time : ndarray, shape (2, n)
        s.
    is_parity_known, is_lock_lost : ndarray of bool, shape (n,)
    half_cycles : ndarray of int64, shape (n,)
    """
    count = len(rows_chief)
    numbers, lock_time = np.empty((4, count)), np.empty((2, count))
    is_parity_known, is_lock_lost = np.empty(count, np.bool_), np.empty(count, np.bool_)
    half_cycles = np.empty(count, np.int64)
    for n in range(count):
        a, b = rows_chief[n], rows_deputy[n]
        numbers[0, n] = pseudorange_deputy[b] - pseudorange_chief[a]
        numbers[1, n] = carrier_range_deputy[b] - carrier_range_chief[a]
        code_variance = code_sigma_chief[a] ** 2 + code_sigma_deputy[b] ** 2
        numbers[2, n] = code_variance + mixed_variance[n]
        numbers[3, n] = phase_sigma_chief[a] ** 2 + phase_sigma_deputy[b] ** 2
        lock_time[0, n], lock_time[1, n] = lock_time_chief[a], lock_time_deputy[b]
        is_parity_known[n] = flags_chief[a] & flags_deputy[b] & FLAG_PARITY_KNOWN != 0
        is_lock_lost[n] = (flags_chief[a] | flags_deputy[b]) & FLAG_LOCK_LOST != 0
        half_cycles[n] = 0
        if flags_chief[a] & FLAG_HALF_CYCLE_ADDED:
            half_cycles[n] += 1
        if flags_deputy[b] & FLAG_HALF_CYCLE_ADDED:
            half_cycles[n] += 2
    return numbers, lock_time, is_parity_known, is_lock_lost, half_cycles


@compiled
def clock_from_codes(columns, pseudorange, ranges, clocks, receiver):  # type: ignore[no-untyped-def]
    """Return the upper median of what n codes exceed ranges by, m: the clock of a receiver.

    Parameters
    ----------
    columns : ndarray of int, shape (n,)
        Satellites of the codes in the columns of the next two.
    pseudorange : ndarray, shape (n,)
        m.
    ranges, clocks : ndarray, shape (2, m)
        See `Geometry`.
    receiver : int
        0 for the chief, 1 for the deputy.
    """
    residual = np.empty(len(columns))
    for n in range(len(columns)):
        column = columns[n]
        residual[n] = pseudorange[n] - ranges[receiver, column] + clocks[receiver, column]
    return np.sort(residual)[len(residual) // 2]


@compiled
def mean_of_combinations(  # type: ignore[no-untyped-def]
    of_chief,
    of_deputy,
    columns,
    ranges,
    clocks,
    is_lock_lost,
    code,
    code_sigma,
    phase,
    phase_sigma,
    code_deputy,
    code_sigma_deputy,
    phase_deputy,
    phase_sigma_deputy,
    largest_difference,
):
    """Return codes and phases of the chief with those of the deputy; see `mean_of_receivers`.

    Parameters
    ----------
    of_chief, of_deputy : ndarray of int, shape (k,)
        Rows of the satellites with the same carriers at both.
    columns : ndarray of int, shape (n,)
        Satellites of the chief in the columns of the next two.
    ranges, clocks : ndarray, shape (2, m)
        See `Geometry`.
    is_lock_lost, code, ..., phase_sigma_deputy : ndarray
        Columns of `Combinations` of chief and deputy.
    largest_difference : float
        Sigmas by which phases of the deputy may differ; codes may differ by any number.

    Returns
    -------
    numbers : ndarray, shape (4, n)
        Codes, their sigmas, phases and their sigmas, m.
    shares : ndarray, shape (2, n)
        Weights of the deputy in codes and phases.
    """
    count, pairs = len(code), len(of_chief)
    numbers, shares = np.empty((4, count)), np.zeros((2, count))
    for n in range(count):
        numbers[0, n], numbers[1, n] = code[n], code_sigma[n]
        numbers[2, n], numbers[3, n] = phase[n], phase_sigma[n]
    predicted = np.empty((2, pairs))
    for k in range(pairs):
        column = columns[of_chief[k]]
        for receiver in range(2):
            predicted[receiver, k] = ranges[receiver, column] - clocks[receiver, column]
    values, sigmas = np.empty(pairs), np.empty(pairs)
    values_deputy, sigmas_deputy = np.empty(pairs), np.empty(pairs)
    for kind in range(2):
        for k in range(pairs):
            a, b = of_chief[k], of_deputy[k]
            values[k], sigmas[k] = numbers[2 * kind, a], numbers[2 * kind + 1, a]
            if kind == 0:
                values_deputy[k], sigmas_deputy[k] = code_deputy[b], code_sigma_deputy[b]
            else:
                values_deputy[k], sigmas_deputy[k] = phase_deputy[b], phase_sigma_deputy[b]
                if is_lock_lost[a]:
                    values_deputy[k] = math.nan
        limit = math.inf if kind == 0 else largest_difference
        mean, sigma, weight = combine_receivers(
            values, sigmas, values_deputy, sigmas_deputy, predicted, limit
        )
        for k in range(pairs):
            a = of_chief[k]
            numbers[2 * kind, a], numbers[2 * kind + 1, a] = mean[k], sigma[k]
            shares[kind, a] = weight[k]
    return numbers, shares
