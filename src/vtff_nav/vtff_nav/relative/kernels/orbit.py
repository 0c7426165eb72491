"""The measurement model of the orbit filter, compiled."""

from __future__ import annotations

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND, SPEED_OF_LIGHT
from vtff_nav.relative.kernels.arcs import has_lock_restarted

__all__ = ["find_carrier_breaks", "orbit_measurements", "predict_codes", "record_carriers"]


@compiled
def orbit_measurements(  # type: ignore[no-untyped-def]
    mean,
    position,
    position_relative,
    ambiguities,
    range_errors,
    code_rows,
    columns,
    shares,
    direction,
    range_rate,
    residuals,
    sigmas,
    system,
    systems,
):
    """Return the linear model of the codes of some of n satellites, and of the phases of all.

    Parameters
    ----------
    mean : ndarray, shape (members,)
        Mean of the state.
    position, position_relative : int
        First column of the position, and of that of the deputy less it; -1 if it is no member.
    ambiguities : ndarray of int, shape (n,)
        Columns of the ambiguities of the phases.
    range_errors : ndarray of int, shape (k,)
        Columns of the range errors of the satellites with codes.
    code_rows : ndarray of int, shape (k,)
        Which of the n satellites these are.
    columns : ndarray of int, shape (n,)
        Satellites in the columns of the next two.
    shares : ndarray, shape (2, n)
        Shares of the deputy in codes and phases.
    direction : ndarray, shape (2, m, 3)
        From chief and deputy to the satellites.
    range_rate : ndarray, shape (2, m)
        m/s.
    residuals, sigmas : ndarray, shape (2, n)
        Codes and phases less predicted ranges and clocks, and their sigmas, m.
    system, systems : ndarray of int, shape (n,) and (s,)
        System of each satellite, and those with a clock of their own.

    Returns
    -------
    design : ndarray, shape (k + n, members)
    values, variances : ndarray, shape (k + n,)
    nuisance : ndarray, shape (k + n, s)
    """
    codes, count = len(code_rows), len(columns)
    size = codes + count
    design = np.zeros((size, len(mean)))
    values, variances = np.empty(size), np.empty(size)
    nuisance = np.zeros((size, len(systems)))
    for index in range(size):
        kind = 0 if index < codes else 1
        row = code_rows[index] if kind == 0 else index - codes
        column = columns[row]
        for axis in range(3):
            ray = direction[0, column, axis]
            if position_relative >= 0:
                share, ray_deputy = shares[kind, row], direction[1, column, axis]
                ray += share * (ray_deputy - ray)
                design[index, position_relative + axis] = -share * ray_deputy
            design[index, position + axis] = -ray
        values[index], variances[index] = residuals[kind, row], sigmas[kind, row] ** 2
        if kind == 1:
            design[index, ambiguities[row]] = 1.0
            values[index] -= mean[ambiguities[row]]
        for clock in range(len(systems)):
            if system[row] == systems[clock]:
                nuisance[index, clock] = 1.0 - range_rate[0, column] / SPEED_OF_LIGHT
    for code in range(codes):
        error = range_errors[code]
        for index in (code, codes + code_rows[code]):
            design[index, error] = 1.0
            values[index] -= mean[error]
    return design, values, variances, nuisance


@compiled
def predict_codes(columns, ranges, clocks, elevation, clock):  # type: ignore[no-untyped-def]
    """Return the predicted codes of n satellites at the chief, m, and their elevations, rad.

    Parameters
    ----------
    columns : ndarray of int, shape (n,)
        Satellites in the columns of the next three.
    ranges, clocks, elevation : ndarray, shape (2, m)
        See `Geometry`.
    clock : float
        Receiver clock, m.
    """
    predicted, elevations = np.empty(len(columns)), np.empty(len(columns))
    for n in range(len(columns)):
        column = columns[n]
        predicted[n] = ranges[0, column] - clocks[0, column] + clock
        elevations[n] = elevation[0, column]
    return predicted, elevations


@compiled
def find_carrier_breaks(  # type: ignore[no-untyped-def]
    places,
    time,
    is_lock_lost,
    half_cycles,
    lock_time,
    last_times,
    last_half_cycles,
    last_lock_times,
):
    """Return which of n carrier combinations have another ambiguity than at their last epoch.

    Parameters
    ----------
    places : ndarray of int, shape (n,)
        Places of the combinations in the columns of the last epoch, which follow.
    time : int
        Epoch, GPS, ns.
    is_lock_lost, half_cycles, lock_time : ndarray, shape (n,), (n,) and (n, 2)
        Columns of `Combinations`.
    last_times, last_half_cycles, last_lock_times : ndarray, shape (places,), the last (places, 2)
        The last epoch of each, ns, -1 without one, and what the receiver said then.
    """
    is_broken = np.zeros(len(places), np.bool_)
    for n in range(len(places)):
        place = places[n]
        if not 0 <= last_times[place] < time:
            continue
        gap = (time - last_times[place]) / NANOSECONDS_PER_SECOND
        is_broken[n] = is_lock_lost[n] or half_cycles[n] != last_half_cycles[place]
        for carrier in range(2):
            before = last_lock_times[place, carrier]
            if has_lock_restarted(lock_time[n, carrier], before, gap):
                is_broken[n] = True
    return is_broken


@compiled
def record_carriers(  # type: ignore[no-untyped-def]
    places, time, half_cycles, lock_time, last_times, last_half_cycles, last_lock_times
):
    """Keep what a receiver says of the carriers of an epoch; see `find_carrier_breaks`."""
    for n in range(len(places)):
        place = places[n]
        last_times[place], last_half_cycles[place] = time, half_cycles[n]
        for carrier in range(2):
            last_lock_times[place, carrier] = lock_time[n, carrier]
