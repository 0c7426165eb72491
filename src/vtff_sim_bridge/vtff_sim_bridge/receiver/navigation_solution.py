"""Fix and clock of a simulated receiver from what it has measured."""

from __future__ import annotations

import math
import operator
from collections.abc import Collection
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.time.timescales import GpsTime, leap_seconds
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.fix import STATUS_NONE, STATUS_SINGLE, Fix, ReceiverTime
from vtff_sim_bridge.gnss.link_plan import LinkPlan
from vtff_sim_bridge.receiver.measurements import Measurements
from vtff_sim_bridge.receiver.point_solution import (
    RangeEquations,
    ionosphere_free_factors,
    solve_points,
)

__all__ = ["NavigationSolver"]

_SOLUTION_TYPE_SINGLE = 16
_NAN = (math.nan,) * 3
_SMALLEST_CODE_SIGMA = 1e-3
_SMALLEST_RATE_SIGMA = 1e-4


class _Choice(NamedTuple):
    """Links of an epoch that a solution is made of, while the same ones are tracked; n satellites.

    Parameters
    ----------
    plan, tracked, received
        What they were chosen from; `tracked` are the bytes of the truth values.
    satellites_tracked : int
    column : ndarray of int, shape (n,)
        Columns of the satellites.
    first, second : ndarray of int, shape (n,)
        Links whose pseudoranges are combined; twice the same where there is one only.
    factors : ndarray, shape (2, n)
        Factors of their pseudoranges.
    system : ndarray of int, shape (n,)
    systems : ndarray of int, shape (any,)
        Those that there are, in order.
    """

    plan: LinkPlan
    tracked: bytes
    received: Collection[tuple[int, int]]
    satellites_tracked: int
    column: npt.NDArray[np.int64]
    first: npt.NDArray[np.int64]
    second: npt.NDArray[np.int64]
    factors: FloatArray
    system: npt.NDArray[np.int64]
    systems: npt.NDArray[np.int64]


class NavigationSolver:
    """Solves for position, velocity and clock of one receiver."""

    def __init__(self) -> None:
        self._choice: _Choice | None = None

    def solve(
        self,
        measured: Measurements,
        index: int,
        time: GpsTime,
        received: Collection[tuple[int, int]],
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
            Satellites (system, number) whose ephemeris the receiver has; another object whenever
            it changes.
        """
        plan, tracked = measured.signals.plan, measured.tracks.is_tracked[index].tobytes()
        choice = self._choice
        if (
            choice is None
            or choice.plan is not plan
            or choice.tracked != tracked
            or choice.received is not received
        ):
            choice = self._choice = _choose_links(measured, index, received)
        solutions = solve_points(_build_equations(measured, index, choice))
        utc_offset = -float(leap_seconds(time))
        if solutions is None:
            fix = Fix(
                time=time,
                status=STATUS_NONE,
                receiver_solution_type=0,
                position=_NAN,
                velocity=_NAN,
                position_sigma=_NAN,
                velocity_sigma=_NAN,
                velocity_latency=0.0,
                satellites_tracked=choice.satellites_tracked,
                satellites_used=0,
                clock_offset=math.nan,
                clock_offset_sigma=math.nan,
            )
            return fix, ReceiverTime(time, False, 0.0, 0.0, utc_offset)
        position, motion = solutions
        fix = Fix(
            time=time,
            status=STATUS_SINGLE,
            receiver_solution_type=_SOLUTION_TYPE_SINGLE,
            position=_triple(measured.signals.position_itrf[index] + position.correction),
            velocity=_triple(measured.signals.velocity_itrf[index] + motion.correction),
            position_sigma=_triple(position.sigma),
            velocity_sigma=_triple(motion.sigma),
            velocity_latency=0.0,
            satellites_tracked=choice.satellites_tracked,
            satellites_used=len(choice.column),
            clock_offset=position.clock,
            clock_offset_sigma=position.clock_sigma,
        )
        return fix, ReceiverTime(time, True, position.clock, position.clock_sigma, utc_offset)


def _choose_links(
    measured: Measurements, index: int, received: Collection[tuple[int, int]]
) -> _Choice:
    """Return the links of a solution: where there are two frequencies, free of the ionosphere."""
    plan, is_tracked = measured.signals.plan, measured.tracks.is_tracked[index]
    links_of: dict[int, list[int]] = {}
    for link in np.flatnonzero(is_tracked).tolist():
        links_of.setdefault(int(plan.satellite[link]), []).append(link)
    columns, pairs, factors = [], [], []
    for column, links in links_of.items():
        if plan.satellites[column] not in received:
            continue
        first, second, both = links[0], links[0], (1.0, 0.0)
        if plan.band[first] == 1 and len(links) > 1:
            second = links[1]
            both = ionosphere_free_factors(
                float(plan.frequency[first]), float(plan.frequency[second])
            )
        columns.append(column)
        pairs.append((first, second))
        factors.append(both)
    first_links, second_links = np.array(pairs, dtype=np.int64).reshape(-1, 2).T.copy()
    system = np.array([plan.satellites[column][0] for column in columns], dtype=np.int64)
    return _Choice(
        plan=plan,
        tracked=is_tracked.tobytes(),
        received=received,
        satellites_tracked=len(links_of),
        column=np.array(columns, dtype=np.int64),
        first=first_links,
        second=second_links,
        factors=np.array(factors).reshape(-1, 2).T.copy(),
        system=system,
        systems=np.flatnonzero(np.bincount(system)),
    )


def _build_equations(measured: Measurements, index: int, choice: _Choice) -> RangeEquations:
    """Return the equations of position and velocity, linear about the true state.

    Satellites are where the broadcast says at the true time of transmission; that of the
    measured pseudorange differs by nanoseconds, in which they move by micrometres.
    """
    observables, rays, plan = measured.observables, measured.signals.line_of_sight, choice.plan
    direction, excess = _excess_of_epoch(
        index,
        choice.column,
        choice.first,
        choice.second,
        choice.factors,
        observables.pseudorange,
        observables.doppler_hz,
        plan.broadcast_delay,
        plan.wavelength,
        rays.range,
        rays.range_rate,
        rays.clock_offset_satellite,
        rays.clock_drift_satellite,
        rays.direction_itrf,
    )
    code_sigma = observables.sigmas.code[index]
    first, second = choice.factors.tolist()
    totals = map(
        math.hypot,
        map(operator.mul, first, code_sigma[choice.first].tolist()),
        map(operator.mul, second, code_sigma[choice.second].tolist()),
    )
    sigma = np.empty(excess.shape)
    np.maximum(list(totals), _SMALLEST_CODE_SIGMA, out=sigma[0])
    np.maximum(observables.sigmas.doppler[index, choice.first], _SMALLEST_RATE_SIGMA, out=sigma[1])
    return RangeEquations(direction, excess, sigma, choice.system, choice.systems)


@compiled
def _excess_of_epoch(  # type: ignore[no-untyped-def]
    index,
    column,
    first,
    second,
    factors,
    pseudorange,
    doppler_hz,
    broadcast_delay,
    wavelength,
    distance,
    distance_rate,
    clock_offset_satellite,
    clock_drift_satellite,
    direction_itrf,
):
    """Return directions (n, 3), and measured less computed ranges (m) and rates (m/s), (2, n).

    `index` is the epoch; columns of satellites, links and factors are those of a `_Choice`.
    """
    count = len(column)
    direction, excess = np.empty((count, 3)), np.empty((2, count))
    for n in range(count):
        i, j, k = column[n], first[n], second[n]
        code = pseudorange[index, j] - broadcast_delay[j]
        if k != j:
            other = pseudorange[index, k] - broadcast_delay[k]
            code = factors[0, n] * code + factors[1, n] * other
        code += SPEED_OF_LIGHT * clock_offset_satellite[index, i]
        excess[0, n] = code - distance[index, i]
        rate = -doppler_hz[index, j] * wavelength[j]
        rate += SPEED_OF_LIGHT * clock_drift_satellite[index, i]
        excess[1, n] = rate - distance_rate[index, i]
        direction[n] = direction_itrf[index, i]
    return direction, excess


def _triple(vector: FloatArray) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return (x, y, z)
