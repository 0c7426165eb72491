"""Numbers of the tables of a solution, compiled."""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.compiled import compiled

__all__ = ["tabulate_ambiguities", "tabulate_differential_tec"]


@compiled
def tabulate_ambiguities(  # type: ignore[no-untyped-def]
    mean,
    covariance,
    phase_columns,
    has_integer,
    cycles,
    reference_cycles,
    wavelength,
    innovation_variances,
):
    """Return ambiguities and their sigmas, cycles, shape (2, n); see `ambiguity_table`.

    Parameters
    ----------
    mean, covariance : ndarray, shape (members,) and (members, members)
    phase_columns, has_integer, cycles, reference_cycles : ndarray, shape (n,)
        See `ArcColumns`.
    wavelength : ndarray, shape (n,)
        m.
    innovation_variances : ndarray, shape (2 n or more,)
        Variances of the innovations of codes, phases and more, m2.
    """
    count = len(wavelength)
    numbers = np.empty((2, count))
    for n in range(count):
        column = phase_columns[n]
        if has_integer[n]:
            numbers[0, n] = cycles[n] - reference_cycles[n]
            numbers[1, n] = math.sqrt(innovation_variances[count + n]) / wavelength[n]
        else:
            numbers[0, n] = mean[column] / wavelength[n] + cycles[n]
            numbers[1, n] = math.sqrt(max(covariance[column, column], 0.0)) / wavelength[n]
    return numbers


@compiled
def tabulate_differential_tec(  # type: ignore[no-untyped-def]
    mean,
    covariance,
    pairs,
    metres_per_tecu,
    phase_columns,
    cycles,
    wavelength,
    phase,
    phase_variance,
    elevation,
    azimuth,
):
    """Return differential TEC, its sigma (TECU), elevation and azimuth (rad), shape (4, m).

    Parameters
    ----------
    mean, covariance : ndarray, shape (members,) and (members, members)
    pairs : ndarray of int, shape (m, 2)
        Rows of two phases with integers, each.
    metres_per_tecu : ndarray, shape (m,)
        What the difference of the phases of a pair changes by, m for 1 TECU.
    phase_columns, cycles : ndarray, shape (n,)
        See `ArcColumns`.
    wavelength, phase, phase_variance, elevation, azimuth : ndarray, shape (n,)
        m, m2 and rad.
    """
    numbers = np.empty((4, len(pairs)))
    for m in range(len(pairs)):
        a, b = pairs[m, 0], pairs[m, 1]
        bias_a, bias_b = phase_columns[a], phase_columns[b]
        total = phase[a] - wavelength[a] * cycles[a]
        total -= phase[b] - wavelength[b] * cycles[b]
        total -= mean[bias_a] - mean[bias_b]
        variance = phase_variance[a] + phase_variance[b]
        variance += covariance[bias_a, bias_a] + covariance[bias_b, bias_b]
        variance -= 2.0 * covariance[bias_a, bias_b]
        numbers[0, m] = total / metres_per_tecu[m]
        numbers[1, m] = math.sqrt(max(variance, 0.0)) / abs(metres_per_tecu[m])
        numbers[2, m], numbers[3, m] = elevation[a], azimuth[a]
    return numbers
