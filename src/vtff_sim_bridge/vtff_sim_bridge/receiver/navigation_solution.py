"""Fix and clock of a simulated receiver from what it has measured."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.time.timescales import GpsTime, leap_seconds
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.fix import STATUS_NONE, STATUS_SINGLE, Fix, ReceiverTime
from vtff_sim_bridge.receiver.measurements import Measurements
from vtff_sim_bridge.receiver.point_solution import RangeEquations, ionosphere_free, solve_point

__all__ = ["solve_navigation"]

_SOLUTION_TYPE_SINGLE = 16


def solve_navigation(
    measured: Measurements, index: int, time: GpsTime, received: Collection[tuple[int, int]]
) -> tuple[Fix, ReceiverTime]:
    """Return the solution of an epoch.

    Parameters
    ----------
    measured : Measurements
    index : int
        Index of the epoch in `measured`.
    time : GpsTime
        Time tag of the epoch.
    received : collection of (int, int)
        Satellites (system, number) whose ephemeris the receiver has.
    """
    tracked = measured.tracked_satellites(index)
    positions, rates = _build_equations(measured, index, received)
    solution, motion = solve_point(positions), solve_point(rates)
    utc_offset = -float(leap_seconds(time))
    nan = (math.nan,) * 3
    if solution is None:
        fix = Fix(
            time=time,
            status=STATUS_NONE,
            receiver_solution_type=0,
            position=nan,
            velocity=nan,
            position_sigma=nan,
            velocity_sigma=nan,
            velocity_latency=0.0,
            satellites_tracked=len(tracked),
            satellites_used=0,
            clock_offset=math.nan,
            clock_offset_sigma=math.nan,
        )
        return fix, ReceiverTime(time, False, 0.0, 0.0, utc_offset)
    velocity, velocity_sigma = nan, nan
    if motion is not None:
        velocity = _triple(measured.signals.velocity_itrf[index] + motion.correction)
        velocity_sigma = _triple(motion.sigma)
    fix = Fix(
        time=time,
        status=STATUS_SINGLE,
        receiver_solution_type=_SOLUTION_TYPE_SINGLE,
        position=_triple(measured.signals.position_itrf[index] + solution.correction),
        velocity=velocity,
        position_sigma=_triple(solution.sigma),
        velocity_sigma=velocity_sigma,
        velocity_latency=0.0,
        satellites_tracked=len(tracked),
        satellites_used=len(positions.excess),
        clock_offset=solution.clock,
        clock_offset_sigma=solution.clock_sigma,
    )
    return fix, ReceiverTime(time, True, solution.clock, solution.clock_sigma, utc_offset)


def _build_equations(
    measured: Measurements, index: int, received: Collection[tuple[int, int]]
) -> tuple[RangeEquations, RangeEquations]:
    """Return the equations of position and velocity, linear about the true state.

    Satellites are where the broadcast says at the true time of transmission; that of the
    measured pseudorange differs by nanoseconds, in which they move by micrometres. Two
    frequencies are combined free of the ionosphere.
    """
    signals, observables = measured.signals, measured.observables
    plan, line_of_sight = signals.plan, signals.line_of_sight
    columns, excess, sigma, rates, rate_sigma = [], [], [], [], []
    links_of: dict[int, list[int]] = {}
    for link in np.flatnonzero(measured.tracks.is_tracked[index]).tolist():
        links_of.setdefault(int(plan.satellite[link]), []).append(link)
    for column, links in links_of.items():
        if plan.satellites[column] not in received:
            continue
        first, last = links[0], links[-1]
        code = observables.pseudorange[index] - plan.broadcast_delay
        code_sigma = observables.sigmas.code[index]
        combined, total = code[first], float(code_sigma[first])
        if plan.band[first] == 1 and last != first:
            second = links[1]
            combined, factor_first, factor_second = ionosphere_free(
                first=code[first],
                second=code[second],
                frequency_first=float(plan.frequency[first]),
                frequency_second=float(plan.frequency[second]),
            )
            total = math.hypot(factor_first * code_sigma[first], factor_second * code_sigma[second])
        clock = SPEED_OF_LIGHT * line_of_sight.clock_offset_satellite[index, column]
        columns.append(column)
        excess.append(combined + clock - line_of_sight.range[index, column])
        sigma.append(max(total, 1e-3))
        rate = -observables.doppler_hz[index, first] * plan.wavelength[first]
        drift = SPEED_OF_LIGHT * line_of_sight.clock_drift_satellite[index, column]
        rates.append(rate + drift - line_of_sight.range_rate[index, column])
        rate_sigma.append(max(float(observables.sigmas.doppler[index, first]), 1e-4))
    direction = line_of_sight.direction_itrf[index, columns].reshape(-1, 3)
    system = np.array([plan.satellites[column][0] for column in columns], dtype=np.int64)
    return (
        RangeEquations(direction, np.array(excess), np.array(sigma), system),
        RangeEquations(direction, np.array(rates), np.array(rate_sigma), system),
    )


def _triple(vector: FloatArray) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return (x, y, z)
