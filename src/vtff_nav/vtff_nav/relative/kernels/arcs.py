"""Tests of the phases of an epoch against those of the last one, compiled.

Columns of arcs are by `SignalPlaces.of`. A loop over the signals in Python costs fifty times what
its arithmetic does.
"""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND

__all__ = ["find_arc_breaks", "has_lock_restarted", "record_arcs"]

# Change of a geometry-free phase in a second that the ionosphere may cause, m.
_GEOMETRY_FREE_ALLOWANCE = 0.01
_GEOMETRY_FREE_SIGMAS = 5.0


@compiled
def find_arc_breaks(  # type: ignore[no-untyped-def]
    places,
    time,
    interval,
    satellite,
    is_lock_lost,
    half_cycles,
    is_parity_known,
    lock_time,
    phase,
    phase_variance,
    is_open,
    last_times,
    last_numbers,
    last_half_cycles,
    last_is_parity_known,
):
    """Return why the arcs of n signals have ended, and how many there were.

    Parameters
    ----------
    places : ndarray of int, shape (n,)
        Places of the signals in the columns of arcs.
    time : int
        Epoch, GPS, ns.
    interval : float
        Since the last epoch, s.
    satellite, ..., phase_variance : ndarray, shape (n,)
        Columns of `SingleDifferences`; `lock_time` has shape (2, n).
    is_open, ..., last_is_parity_known : ndarray, shape (places,)
        Columns of `ArcBook`; `last_numbers` has shape (4, places).

    Returns
    -------
    reasons : ndarray of int64, shape (n,)
        0 for arcs that go on and signals without one, else the index in `ARC_BREAKS`.
    arcs, breaks : int
        Number of signals with an arc, and of arcs that have ended.
    """
    count = len(places)
    reasons = np.zeros(count, np.int64)
    arcs, breaks = 0, 0
    for n in range(count):
        place = places[n]
        if not is_open[place]:
            continue
        arcs += 1
        gap = (time - last_times[place]) / NANOSECONDS_PER_SECOND
        has_kept_lock = lock_time[0, n] >= gap and lock_time[1, n] >= gap
        if is_lock_lost[n]:
            reasons[n] = 1
        elif half_cycles[n] != last_half_cycles[place]:
            reasons[n] = 2
        elif is_parity_known[n] and not last_is_parity_known[place]:
            reasons[n] = 3
        elif gap > 1.5 * interval and not has_kept_lock:
            reasons[n] = 4
        elif has_lock_restarted(lock_time[0, n], last_numbers[2, place], gap):
            reasons[n] = 5
        elif has_lock_restarted(lock_time[1, n], last_numbers[3, place], gap):
            reasons[n] = 5
        breaks += reasons[n] != 0
    # Signals that follow each other are of one satellite, or the next one begins.
    has_jumped = np.zeros(count, np.bool_)
    for n in range(count - 1):
        first, second = places[n], places[n + 1]
        if satellite[n] != satellite[n + 1] or not (is_open[first] and is_open[second]):
            continue
        if reasons[n] or reasons[n + 1] or last_times[first] != last_times[second]:
            continue
        jump = (phase[n] - phase[n + 1]) - (last_numbers[0, first] - last_numbers[0, second])
        noise = phase_variance[n] + phase_variance[n + 1]
        noise = noise + last_numbers[1, first] + last_numbers[1, second]
        if abs(jump) > _GEOMETRY_FREE_SIGMAS * math.sqrt(noise) + _GEOMETRY_FREE_ALLOWANCE:
            has_jumped[n] = has_jumped[n + 1] = True
    for n in range(count):
        if has_jumped[n]:
            reasons[n] = 6
            breaks += 1
    return reasons, arcs, breaks


@compiled
def has_lock_restarted(now, before, gap):  # type: ignore[no-untyped-def]
    """Return whether a lock time is shorter than it was, or should be by now.

    Parameters
    ----------
    now, before : float
        Lock times now and at the last epoch, s. Lock times that saturate do not grow; compressed
        logs have units of 1/32 s.
    gap : float
        Since the last epoch, s.
    """
    return now < before and now < before + gap - 0.1 and math.isfinite(now)


@compiled
def record_arcs(  # type: ignore[no-untyped-def]
    places,
    time,
    phase,
    phase_variance,
    lock_time,
    half_cycles,
    is_parity_known,
    is_open,
    last_times,
    last_numbers,
    last_half_cycles,
    last_is_parity_known,
    epochs,
):
    """Keep the measurements of an epoch in the columns of arcs; see `find_arc_breaks`.

    `epochs` counts the epochs of each arc.
    """
    for n in range(len(places)):
        place = places[n]
        if not is_open[place]:
            continue
        last_times[place] = time
        last_numbers[0, place], last_numbers[1, place] = phase[n], phase_variance[n]
        last_numbers[2, place], last_numbers[3, place] = lock_time[0, n], lock_time[1, n]
        last_half_cycles[place] = half_cycles[n]
        last_is_parity_known[place] = is_parity_known[n]
        epochs[place] += 1
