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
    FLAG_PHASE_VALID,
)

__all__ = ["combine_carriers", "combine_receivers", "read_signals"]

_CODE_AND_PHASE_VALID = FLAG_CODE_VALID | FLAG_PHASE_VALID


@compiled
def read_signals(  # type: ignore[no-untyped-def]
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
    satellite, carrier, wavelength : ndarray, shape (n,)
        Satellites and carriers of n signals, the preferred one of a carrier first, and their
        wavelengths, m.
    has_ephemeris : ndarray of bool
        Whether a satellite number has an ephemeris.
    flags, ..., lock_time : ndarray, shape (n,)
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
    """
    count = len(carrier)
    rows, numbers = np.empty(count, np.int64), np.empty((6, count))
    size, last = 0, -1
    for n in range(count):
        if carrier[n] == last or not has_ephemeris[satellite[n]]:
            continue
        carrier_range = wavelength[n] * carrier_phase_cycles[n]
        if flags[n] & _CODE_AND_PHASE_VALID != _CODE_AND_PHASE_VALID or not math.isfinite(
            pseudorange[n] + carrier_range
        ):
            continue
        last, rows[size] = carrier[n], n
        code_sigma, phase_sigma = sigmas[0], sigmas[1]
        if use_receiver_sigmas:
            stated = float(pseudorange_sigma[n])
            if stated > 0.0:
                code_sigma = max(stated, smallest_sigmas[0])
            stated = float(carrier_phase_sigma_cycles[n]) * wavelength[n]
            if stated > 0.0:
                phase_sigma = max(stated, smallest_sigmas[1])
        numbers[0, size], numbers[1, size] = pseudorange[n], carrier_range
        numbers[2, size], numbers[3, size] = code_sigma, phase_sigma
        numbers[4, size] = -wavelength[n] * float(doppler_hz[n])
        numbers[5, size] = float(lock_time[n])
        size += 1
    return rows[:size].copy(), numbers[:, :size].copy()


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
