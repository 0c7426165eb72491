"""The safety monitor: drawn faults that it must survive, and nominal flights that it must leave be.

The faults are those of `vtff_analysis.closed_loop.drawn_faults`: truth by the propagator, drawn
navigation; with --chief-thrusts the chief flies to a place of its own meanwhile, and every second
thruster that fails is the chief's. The nominal flights are the world `realistic_loop` of
bench_realism.py: both emulated receivers, the relative filter, controller and thruster, with the
monitor between them; an intervention of the monitor is a false alarm.
"""

from __future__ import annotations

import argparse
import collections
import math
import multiprocessing
import signal
import sys
from dataclasses import dataclass

import numpy as np
from realism.recording import EmulatedFormation
from realism.worlds import WORLDS

from vtff_analysis.closed_loop.drawn_faults import HARD_RADIUS, draw_fault_case, fly_fault_case
from vtff_control.safety.formation_safety import (
    MODE_EVADE,
    MODE_WATCH,
    FormationSafety,
    SafetySetting,
    SpacecraftInput,
)
from vtff_control.thruster.thruster import Thruster
from vtff_control.tracking.sdre import SdreController, SdreDesign
from vtff_dynamics.vectors import FloatArray
from vtff_nav.relative.common.estimator_setting import EstimatorSetting
from vtff_nav.relative.common.solution import SOLUTION_NONE
from vtff_nav.relative.shipped_estimators import make_cdgps
from vtff_node.executables import share_file
from vtff_sim_bridge.truth.scenario import load_scenario

_CAP = 1.4  # m/s2, as in config/params
_QUANTUM = 1e-5  # m/s2, as in config/can
_WORLD = "realistic_loop"

EXAMPLES = """\
examples:
  bench_safety.py                               # 200 faults, then 20 flights of half an hour
  bench_safety.py --faults 24 --flights 0
  bench_safety.py --flights 0 --chief-thrusts
  bench_safety.py --faults 0 --flights 2 --seconds 600"""


@dataclass(frozen=True)
class FaultOutcome:
    """Outcome of a drawn fault."""

    seed: int
    formation: str
    fault: str
    is_of_chief: bool
    closest: float
    isolated_after: float
    is_taken_over: bool
    reason: str


@dataclass(frozen=True)
class FlightOutcome:
    """Outcome of a nominal flight."""

    seed: int
    seconds: int
    watched: int
    alarms: int
    closest: float
    reason: str


def main() -> int:
    """Fly and print; return 1 if something must not have happened."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    parser = argparse.ArgumentParser(
        description=__doc__, epilog=EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--faults", type=int, default=200, help="drawn faults (200)")
    parser.add_argument(
        "--chief-thrusts", action="store_true", help="in the faults, the chief thrusts too"
    )
    parser.add_argument("--flights", type=int, default=20, help="nominal flights (20)")
    parser.add_argument("--seconds", type=int, default=1800, help="length of one (1800)")
    parser.add_argument("--first-seed", type=int, default=1, help="seed of the first flight (1)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (1)")
    given = parser.parse_args()
    for name, least in (
        ("faults", 0),
        ("flights", 0),
        ("seconds", 60),
        ("first_seed", 0),
        ("jobs", 1),
    ):
        if getattr(given, name) < least:
            parser.error(f"--{name.replace('_', '-')}: {least} or more expected")
    try:
        with multiprocessing.Pool(given.jobs, _ignore_interrupts) as pool:
            faults = _fly_faults(pool, given.faults, given.chief_thrusts)
            flights = _fly_nominal(pool, given.flights, given.seconds, given.first_seed)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    return int(not (faults and flights))


def _ignore_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def fly_fault(job: tuple[int, bool]) -> FaultOutcome:
    """Fly a drawn fault."""
    seed, chief_thrusts = job
    case = draw_fault_case(
        load_scenario(share_file("vtff_bringup", "config/scenario/reference.yaml")),
        seed,
        chief_thrusts,
    )
    result = fly_fault_case(case)
    failing = case.failing_name
    return FaultOutcome(
        seed,
        case.formation,
        case.fault,
        failing == case.scenario.chief.name,
        min(result.closest.values()),
        result.isolated_time[failing] - case.failing.thruster_time,
        math.isfinite(result.taken_over_time(failing)),
        result.reasons[failing],
    )


def fly_nominal(job: tuple[int, int]) -> FlightOutcome:
    """Fly the realistic world with the monitor between controller and thruster."""
    seed, seconds = job
    world = WORLDS[_WORLD]
    scenario, gnss = world.make(seed, seconds)
    formation = EmulatedFormation(gnss, scenario)
    estimator = make_cdgps(world.change_setting(EstimatorSetting()))
    controller = SdreController(SdreDesign("navigation_aware", acceleration_cap=_CAP))
    thruster = Thruster(acceleration_cap=_CAP, quantum=_QUANTUM, delay_steps=1, step=1.0)
    safety = FormationSafety(
        "chief", ["deputy"], SafetySetting(hard_radius=HARD_RADIUS, acceleration_cap=_CAP)
    )
    target = scenario.deputies[0].target_rtn
    assert target is not None
    scheduled: dict[int, FloatArray] = {}
    watched = alarms = 0
    closest, reason = math.inf, ""
    for _ in range(round(scenario.duration)):
        stamp = formation.truth.time.nanoseconds
        applied = scheduled.pop(stamp, np.zeros(3))
        second = formation.measure(applied)
        for ephemeris in second.ephemerides:
            estimator.add_ephemeris(ephemeris)
        solution = estimator.process(second.time, *second.epochs)
        if applied.any():
            estimator.add_thrust(second.time, 1.0, applied)
        command = np.zeros(3)
        heard = SpacecraftInput(reported_rtn=applied, command_rtn=command)
        if solution.solution == SOLUTION_NONE:
            controller.reset()
        else:
            relative = np.concatenate((solution.position_rtn, solution.velocity_rtn))
            chief = np.concatenate((solution.position_chief_gcrf, solution.velocity_chief_gcrf))
            covariance = solution.covariance_rtn
            command = controller.control(
                relative, chief, target, stamp, covariance
            ).acceleration_rtn
            heard = SpacecraftInput(relative, covariance, chief, applied, command)
        decision = safety.step({"deputy": heard}).decisions["deputy"]
        watched += decision.mode == MODE_WATCH
        alarms += decision.mode >= MODE_EVADE
        reason = reason or (decision.reason if decision.mode >= MODE_EVADE else "")
        if decision.command_rtn is not None:
            command = decision.command_rtn
        thrust = thruster.command(stamp, command)
        scheduled[thrust.start_stamp] = thrust.acceleration_rtn
        closest = min(
            closest, float(np.linalg.norm(formation.truth.relative_state_rtn("deputy")[:3]))
        )
        formation.advance(applied)
    return FlightOutcome(seed, round(scenario.duration), watched, alarms, closest, reason)


def _fly_faults(
    pool: multiprocessing.pool.Pool,  # type: ignore[name-defined]
    count: int,
    chief_thrusts: bool,
) -> bool:
    """Fly and print the faults; return whether nobody came inside, and all was isolated in time."""
    if not count:
        return True
    outcomes = []
    for outcome in pool.imap(fly_fault, [(seed, chief_thrusts) for seed in range(count)]):
        outcomes.append(outcome)
        late = outcome.fault == "stuck_on" and not outcome.isolated_after <= 2.0
        if outcome.closest < HARD_RADIUS or late:
            print(f"  FAILED {outcome}", flush=True)
    chief = ", the chief thrusts" if chief_thrusts else ""
    print(f"{count} drawn faults, hard radius {HARD_RADIUS:g} m{chief}")
    print(f"{'fault':<18} {'cases':>5} {'closest':>9} {'taken over':>10} {'isolated after':>15}")
    by_fault = collections.defaultdict(list)
    for outcome in outcomes:
        by_fault[outcome.fault + (", chief's" if outcome.is_of_chief else "")].append(outcome)
    for fault, group in by_fault.items():
        isolated = [o.isolated_after for o in group if o.fault == "stuck_on"]
        print(
            f"{fault:<18} {len(group):>5} {min(o.closest for o in group):>7.1f} m "
            f"{sum(o.is_taken_over for o in group):>10} "
            f"{f'{max(isolated):.0f} s at most' if isolated else '-':>15}"
        )
    inside = sum(outcome.closest < HARD_RADIUS for outcome in outcomes)
    print(f"inside the hard radius: {inside}", flush=True)
    late = any(o.fault == "stuck_on" and not o.isolated_after <= 2.0 for o in outcomes)
    return not inside and not late


def _fly_nominal(
    pool: multiprocessing.pool.Pool,  # type: ignore[name-defined]
    count: int,
    seconds: int,
    first_seed: int,
) -> bool:
    """Fly and print the nominal flights; return whether the monitor left all of them be."""
    if not count:
        return True
    print(f"{count} flights of {seconds} s in the world {_WORLD}")
    print(f"{'seed':>4} {'watched':>8} {'taken over':>10} {'closest':>9}")
    jobs = [(seed, seconds) for seed in range(first_seed, first_seed + count)]
    total = alarms = 0
    for outcome in pool.imap(fly_nominal, jobs):
        total += outcome.seconds
        alarms += outcome.alarms
        print(
            f"{outcome.seed:>4} {outcome.watched:>6} s {outcome.alarms:>8} s "
            f"{outcome.closest:>7.1f} m  {outcome.reason}",
            flush=True,
        )
    print(f"{total / 3600.0:.1f} h, {alarms} s taken over")
    return not alarms


if __name__ == "__main__":
    raise SystemExit(main())
