"""The relative filter over a recorded flight: its errors, their consistency, its integers."""

from __future__ import annotations

import collections
import dataclasses
import math
import pathlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vtff_control.thruster.thruster import Thruster
from vtff_control.tracking.sdre import SdreController, SdreDesign
from vtff_dynamics.frames.rtn import relative_state_rtn
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.signals import SignalKey
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.estimator import CdgpsEstimator
from vtff_nav.relative.common.estimator_setting import EstimatorSetting
from vtff_nav.relative.common.solution import (
    AMBIGUITY_FIXED,
    AMBIGUITY_HELD,
    SOLUTION_FIXED,
    SOLUTION_NONE,
    RelativeSolution,
)
from vtff_nav.relative.shipped_estimators import make_cdgps
from vtff_sim_bridge.gnss.configuration import GnssConfiguration
from vtff_sim_bridge.truth.scenario import Scenario

from .bound import bound_rms
from .prediction import ErrorPrediction
from .recording import EmulatedFormation, Recording, Second, load_or_fly
from .worlds import FIRST_SECOND, KEEPING_SECOND, WORLDS, WhiteNoise, World

__all__ = ["Figures", "Flight", "Integers", "Log", "Loop", "fly", "run_filter", "summarise"]

_CAP = 1.4  # m/s2, as in config/params
_QUANTUM = 1e-5  # m/s2, as in config/can
_BURN = 1e-2  # m/s2: smallest thrust of a burn
_AFTER_OUTAGE = 30.0  # s
_LONGEST_WRONG = 2.0  # s: integers that were wrong for longer count
_WRONG_CYCLES = 0.25
# Columns of `Flight.rows`.
_TIME, _ERROR, _SIGMA, _NEES_R, _NEES_V, _FIXED, _SOLVED, _DEGRADED, _THRUST = range(9)
_PREDICTED_R, _PREDICTED_V = 9, 10


@dataclass(frozen=True)
class Loop:
    """What a closed loop has kept.

    Parameters
    ----------
    keeping : tuple of 3 float
        RMS deviation from the target from `KEEPING_SECOND` on, R, T and N, m.
    keeping_dv_per_hour : float
        Sum of the velocity changes of all axes from then on, m/s per hour.
    closest : float
        Smallest distance from the chief, m.
    dv : float
        Sum of all velocity changes, m/s.
    last_minute : float
        Largest distance from the target in the last minute, m.
    """

    keeping: tuple[float, ...]
    keeping_dv_per_hour: float
    closest: float
    dv: float
    last_minute: float


class Integers:
    """Counts the integers that a filter rests on, and those that are not the truth."""

    def __init__(self) -> None:
        self.count = 0
        self.wrong = 0
        self.wrong_long = 0
        self._since: dict[SignalKey, float] = {}

    def add(
        self, elapsed: float, solution: RelativeSolution, cycles: dict[SignalKey, float]
    ) -> None:
        """Add a solution and the true ambiguities of its time.

        All integers of a group (signals that share a receiver bias) may be off by the same number,
        which the bias takes up; wrong are those that are off otherwise than most.
        """
        table = solution.ambiguities
        excess: dict[tuple[int, int, int], dict[SignalKey, float]] = {}
        if solution.solution != SOLUTION_NONE:
            rows = zip(
                table.system.tolist(),
                table.prn.tolist(),
                table.band.tolist(),
                table.attribute.tolist(),
                table.ambiguity_cycles.tolist(),
                table.state.tolist(),
                strict=True,
            )
            for system, prn, band, attribute, value, state in rows:
                key = SignalKey(system, prn, band, attribute)
                if state in (AMBIGUITY_FIXED, AMBIGUITY_HELD) and key in cycles:
                    excess.setdefault(key.group, {})[key] = value - cycles[key]
        wrong: dict[SignalKey, float] = {}
        for of_group in excess.values():
            votes = collections.Counter(round(2.0 * value) for value in of_group.values())
            common = votes.most_common(1)[0][0] / 2.0
            self.count += len(of_group)
            for key, value in of_group.items():
                if abs(value - common) > _WRONG_CYCLES:
                    wrong[key] = self._since.get(key, elapsed)
        self._since = wrong
        self.wrong += len(wrong)
        self.wrong_long += sum(elapsed - since > _LONGEST_WRONG for since in wrong.values())


@dataclass(frozen=True, eq=False)
class Flight:
    """Outcome of a flight: a row for each epoch, and counts of integers."""

    rows: FloatArray
    integers: int
    wrong_integers: int
    wrong_integers_long: int
    first_fixed: float
    bound_rms: float = math.nan
    loop: Loop | None = None


def run_filter(recording: Recording, world: World, setting: EstimatorSetting) -> Flight:
    """Run a filter over a recording."""
    estimator = make_cdgps(world.change_setting(setting))
    noise = world.white_noise
    prediction = None if noise is None else ErrorPrediction(estimator, noise)
    log = Log()
    for index, second in enumerate(recording):
        for ephemeris in second.ephemerides:
            estimator.add_ephemeris(ephemeris)
        if index % world.interval == 0:
            solution, predicted = _solve(estimator, second, prediction)
            log.add(index, second, solution, predicted)
        if second.thrust_rtn.any():
            estimator.add_thrust(second.time, 1.0, second.thrust_rtn)
    return log.flight()


def _solve(
    estimator: CdgpsEstimator, second: Second, prediction: ErrorPrediction | None
) -> tuple[RelativeSolution, tuple[float, float]]:
    """Return the solution of an epoch, and the NEES that is predicted for it."""
    if prediction is None:
        return estimator.process(second.time, *second.epochs), (math.nan, math.nan)
    prediction.expect(second)
    solution = estimator.process(second.time, *second.epochs)
    return solution, prediction.nees(second, solution)


def fly_closed_loop(
    scenario: Scenario,
    gnss: GnssConfiguration,
    setting: EstimatorSetting,
    noise: WhiteNoise | None = None,
) -> Flight:
    """Fly with the controller of the shipped systems on the solutions of the filter.

    The thruster has the delay of a step and the resolution of its CAN frames. The NEES is predicted
    for `noise`.
    """
    formation, estimator = EmulatedFormation(gnss, scenario), make_cdgps(setting)
    prediction = None if noise is None else ErrorPrediction(estimator, noise)
    controller = SdreController(SdreDesign("navigation_aware", acceleration_cap=_CAP))
    thruster = Thruster(acceleration_cap=_CAP, quantum=_QUANTUM, delay_steps=1, step=1.0)
    target = scenario.deputies[0].target_rtn
    assert target is not None
    scheduled: dict[int, FloatArray] = {}
    log, deviations, distances, thrusts = Log(), [], [], []
    for index in range(round(scenario.duration)):
        stamp = formation.truth.time.nanoseconds
        applied = scheduled.pop(stamp, np.zeros(3))
        second = formation.measure(applied)
        for ephemeris in second.ephemerides:
            estimator.add_ephemeris(ephemeris)
        solution, predicted = _solve(estimator, second, prediction)
        log.add(index, second, solution, predicted)
        if applied.any():
            estimator.add_thrust(second.time, 1.0, applied)
        command = np.zeros(3)
        if solution.solution == SOLUTION_NONE:
            controller.reset()
        else:
            chief = (solution.position_chief_gcrf, solution.velocity_chief_gcrf)
            estimate = (solution.position_rtn, solution.velocity_rtn)
            command = controller.control(
                np.concatenate(estimate),
                np.concatenate(chief),
                target,
                stamp,
                solution.covariance_rtn,
            ).acceleration_rtn
        thrust = thruster.command(stamp, command)
        scheduled[thrust.start_stamp] = thrust.acceleration_rtn
        truth = relative_state_rtn(second.state_chief_gcrf, second.state_deputy_gcrf)
        deviations.append(truth[:3] - target[:3])
        distances.append(float(np.linalg.norm(truth[:3])))
        thrusts.append(applied)
        formation.advance(applied)
    deviation, thrust_rtn = np.array(deviations), np.abs(thrusts)
    kept = deviation[KEEPING_SECOND:]
    loop = Loop(
        keeping=tuple(_rms(axis) for axis in kept.T),
        keeping_dv_per_hour=3600.0 * 3.0 * _mean(thrust_rtn[KEEPING_SECOND:].ravel()),
        closest=min(distances),
        dv=float(thrust_rtn.sum()),
        last_minute=float(np.linalg.norm(deviation[-60:], axis=1).max()),
    )
    return dataclasses.replace(log.flight(), loop=loop)


class Log:
    """Takes the solutions of a flight."""

    def __init__(self) -> None:
        self._integers = Integers()
        self._rows: list[tuple[float, ...]] = []
        self._first_fixed = math.inf

    def add(
        self,
        elapsed: int,
        second: Second,
        solution: RelativeSolution,
        predicted_nees: tuple[float, float] = (math.nan, math.nan),
    ) -> None:
        """Add the solution of an epoch, `elapsed` seconds into the flight.

        `predicted_nees` is the NEES of position and velocity that theory gives.
        """
        self._integers.add(elapsed, solution, second.cycles)
        is_fixed = solution.solution == SOLUTION_FIXED
        if is_fixed:
            self._first_fixed = min(self._first_fixed, elapsed)
        truth = relative_state_rtn(second.state_chief_gcrf, second.state_deputy_gcrf)
        error = np.concatenate((solution.position_rtn, solution.velocity_rtn)) - truth
        covariance = solution.covariance_rtn
        is_solved = solution.solution != SOLUTION_NONE and bool(np.isfinite(error).all())
        nees = [math.nan, math.nan]
        if is_solved:
            nees = [
                float(error[axes] @ np.linalg.solve(covariance[axes, axes], error[axes])) / 3.0
                for axes in (slice(0, 3), slice(3, 6))
            ]
        self._rows.append(
            (
                elapsed,
                float(np.linalg.norm(error[:3])),
                float(np.sqrt(np.trace(covariance[:3, :3]))),
                *nees,
                is_fixed,
                is_solved,
                bool(solution.degraded),
                float(np.linalg.norm(second.thrust_rtn)),
                *predicted_nees,
            )
        )

    def flight(self) -> Flight:
        """Return what was logged."""
        integers = self._integers
        return Flight(
            np.array(self._rows, dtype=float),
            integers.count,
            integers.wrong,
            integers.wrong_long,
            self._first_fixed,
        )


@dataclass(frozen=True)
class Figures:
    """Figures of the flights of a world; lengths in mm, shares in %, NaN where there is none.

    Parameters
    ----------
    rms, median_rms, worst_rms : float
        RMS of the 3-D error of position over all flights, and median and largest of the flights.
    largest, sigma : float
        Largest error; RMS of the stated sigma.
    nees_position, nees_velocity : float
        Mean of e' P^-1 e over its degrees of freedom: 1 is honest.
    nees_scatter : float
        Standard error of `nees_position`, from the scatter of the flights.
    burn_position, burn_velocity : float
        NEES while the thruster gives more than 1 cm/s2.
    outage_position, outage_velocity : float
        NEES in the outages.
    predicted_position, predicted_velocity : float
        NEES that theory gives for this filter in this world.
    predicted_burn_position, predicted_burn_velocity : float
        The same in burns.
    fixed, degraded, absent : float
        Shares of the epochs outside of outages.
    integers, wrong, wrong_long : int
        Integers that epochs rest on; wrong ones; those wrong for more than 2 s.
    loops : tuple of Loop
        Loops of the flights with a closed loop.
    bound : float
        RMS that the covariance bound gives.
    recovery : float
        Longest time from the end of an outage to a fixed solution, s.
    """

    rms: float
    median_rms: float
    worst_rms: float
    largest: float
    sigma: float
    nees_position: float
    nees_velocity: float
    nees_scatter: float
    burn_position: float
    burn_velocity: float
    outage_position: float
    outage_velocity: float
    predicted_position: float
    predicted_velocity: float
    predicted_burn_position: float
    predicted_burn_velocity: float
    fixed: float
    degraded: float
    absent: float
    integers: int
    wrong: int
    wrong_long: int
    recovery: float
    bound: float
    loops: tuple[Loop, ...]


def summarise(flights: Sequence[Flight], world: World) -> Figures:
    """Return the figures of flights of one world."""
    whole = [flight.rows for flight in flights]
    inside = [_is_within(rows[:, _TIME], world.outages, 0.0) for rows in whole]
    counted = [
        rows[
            (rows[:, _TIME] >= FIRST_SECOND)
            & ~_is_within(rows[:, _TIME], world.outages, _AFTER_OUTAGE)
        ]
        for rows in whole
    ]
    together = np.concatenate(counted)
    outage = np.concatenate([rows[mask] for rows, mask in zip(whole, inside, strict=True)])
    burn = together[together[:, _THRUST] > _BURN]
    each = np.array([_rms(rows[:, _ERROR]) for rows in counted])
    nees = np.array([_mean(rows[:, _NEES_R]) for rows in counted])
    return Figures(
        rms=1e3 * _rms(together[:, _ERROR]),
        median_rms=1e3 * float(np.median(each)),
        worst_rms=1e3 * float(np.max(each)),
        largest=1e3 * _largest(together[:, _ERROR]),
        sigma=1e3 * _rms(together[:, _SIGMA]),
        nees_position=_mean(nees),
        nees_velocity=_mean(np.array([_mean(rows[:, _NEES_V]) for rows in counted])),
        nees_scatter=_standard_error(nees),
        burn_position=_mean(burn[:, _NEES_R]),
        burn_velocity=_mean(burn[:, _NEES_V]),
        outage_position=_mean(outage[:, _NEES_R]),
        outage_velocity=_mean(outage[:, _NEES_V]),
        predicted_position=_mean(together[:, _PREDICTED_R]),
        predicted_velocity=_mean(together[:, _PREDICTED_V]),
        predicted_burn_position=_mean(burn[:, _PREDICTED_R]),
        predicted_burn_velocity=_mean(burn[:, _PREDICTED_V]),
        fixed=100.0 * float(together[:, _FIXED].mean()),
        degraded=100.0 * float(together[:, _DEGRADED].mean()),
        absent=100.0 * float(1.0 - together[:, _SOLVED].mean()),
        integers=sum(flight.integers for flight in flights),
        wrong=sum(flight.wrong_integers for flight in flights),
        wrong_long=sum(flight.wrong_integers_long for flight in flights),
        bound=1e3 * _rms(np.array([flight.bound_rms for flight in flights])),
        loops=tuple(flight.loop for flight in flights if flight.loop is not None),
        recovery=max((_recovery(rows, world.outages) for rows in whole), default=math.nan),
    )


def _is_within(
    time: FloatArray, intervals: Sequence[tuple[float, float]], after: float
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which times are within intervals, or less than `after` behind one."""
    is_within = np.zeros(len(time), dtype=bool)
    for start, end in intervals:
        is_within |= (time >= start) & (time < end + after)
    return is_within


def _recovery(rows: FloatArray, outages: Sequence[tuple[float, float]]) -> float:
    """Return the longest time from the end of an outage to the next fixed solution, s."""
    fixed = rows[rows[:, _FIXED] > 0.0, _TIME]
    times = [float(np.min(fixed[fixed >= end] - end, initial=math.inf)) for _, end in outages]
    return max(times, default=math.nan)


def _rms(values: FloatArray) -> float:
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan


def _standard_error(values: FloatArray) -> float:
    """Return the standard error of the mean; NaN for a single value."""
    if len(values) < 2:
        return math.nan
    return float(np.std(values, ddof=1) / math.sqrt(len(values)))


def _mean(values: FloatArray) -> float:
    values = values[np.isfinite(values)]
    return float(values.mean()) if len(values) else math.nan


def _largest(values: FloatArray) -> float:
    values = values[np.isfinite(values)]
    return float(values.max()) if len(values) else math.nan


def fly(
    name: str,
    seed: int,
    seconds: int | None,
    setting: EstimatorSetting,
    cache: pathlib.Path | None,
) -> Flight:
    """Fly a world with a filter; a job of `bench_realism.py`."""
    world = WORLDS[name]
    if world.motion == "closed_loop":
        changed = world.change_setting(setting)
        return fly_closed_loop(*world.make(seed, seconds), changed, world.white_noise)
    recording = load_or_fly(name, world, seed, seconds, cache)
    flight = run_filter(recording, world, setting)
    if world.phase_noise is None:
        return flight
    return dataclasses.replace(
        flight,
        bound_rms=bound_rms(
            recording,
            world.phase_noise,
            world.interval,
            world.ranges,
            world.gradient_tecu_per_deg,
            CdgpsConfiguration().force_model.degree if world.has_real_gravity else None,
        ),
    )
