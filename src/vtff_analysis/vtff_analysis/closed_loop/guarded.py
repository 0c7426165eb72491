"""Closed loop with the safety monitor between controllers and thrusters, and with faults.

Truth by the propagator, drawn navigation, the shipped controller and thruster, and
`vtff_control.safety`: the twin of a graph with formation_safety in which everything but the monitor
may fail.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from vtff_analysis.closed_loop.drawn_navigation import DrawnNavigation, NavigationErrorModel
from vtff_control.safety.formation_safety import (
    MODE_EVADE,
    MODE_HOLD,
    MODE_MONITOR,
    FormationSafety,
    SafetySetting,
    SpacecraftDecision,
    SpacecraftInput,
)
from vtff_control.thruster.thruster import Thruster
from vtff_control.tracking.sdre import SdreController, SdreDesign
from vtff_dynamics.frames.rtn import deputy_state_gcrf, relative_state_rtn
from vtff_dynamics.orbit.gravity import predict_state
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_sim_bridge.truth.scenario import Scenario

__all__ = ["ChiefFlight", "GuardedResult", "SpacecraftFault", "simulate_guarded"]


@dataclass(frozen=True)
class SpacecraftFault:
    """What fails on a spacecraft, at a time in s since the start; defaults: nothing does.

    Parameters
    ----------
    stuck_on : tuple of 3 float
        Acceleration that its thruster gives from ``thruster_time`` on, m/s2; axes of 0 work on.
    stuck_off : tuple of 3 bool
        Axes that give nothing from then on.
    thruster_time
        When the thruster fails.
    is_reported
        True if the thruster reports what it does, else what it was told.
    thruster_scale
        True over reported thrust of a thruster that works.
    navigation_bias
        Error of the position in RTN from the start, which no covariance contains, m.
    receiver_dead
        When its receiver dies: no state comes any more.
    controller_killed
        When its controller ends: no command comes any more.
    controller_silent : tuple of 2 float
        From when to when its controller commands zero.
    late_share
        Share of the states and of the commands that come too late to be used.
    """

    stuck_on: tuple[float, float, float] = (0.0, 0.0, 0.0)
    stuck_off: tuple[bool, bool, bool] = (False, False, False)
    thruster_time: float = math.inf
    is_reported: bool = False
    thruster_scale: float = 1.0
    navigation_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    receiver_dead: float = math.inf
    controller_killed: float = math.inf
    controller_silent: tuple[float, float] = (math.inf, math.inf)
    late_share: float = 0.0


@dataclass(frozen=True)
class ChiefFlight:
    """A chief that thrusts: it flies to an orbit beside its own, and keeps its place on that orbit.

    Parameters
    ----------
    offset
        Place of that orbit in the RTN axes of the start, m.
    navigation
        Errors of its absolute navigation.
    fault
        Failures of the chief.
    """

    offset: tuple[float, float, float]
    navigation: NavigationErrorModel = NavigationErrorModel(0.5, 5e-3)  # as in reference_orbit
    fault: SpacecraftFault = SpacecraftFault()


@dataclass(frozen=True, eq=False)
class GuardedResult:
    """History of a guarded flight.

    Attributes
    ----------
    relative_rtn
        True relative state of each deputy at every step, m and m/s, shape (n + 1, 6).
    applied_rtn
        True thrust of each that thrusts over every step, m/s2, shape (n, 3).
    modes
        Mode of each of them at every step, shape (n,).
    reasons
        Why one of them was taken over; empty if it was not.
    isolated_time
        When the first axis of one of them was isolated, s; infinite if none was.
    watched_time
        When the monitor first told that a pair would not stay clear, s.
    closest
        Smallest true distance of each pair, m.
    """

    relative_rtn: dict[str, FloatArray]
    applied_rtn: dict[str, FloatArray]
    modes: dict[str, np.ndarray[tuple[int], np.dtype[np.int_]]]
    reasons: dict[str, str]
    isolated_time: dict[str, float]
    watched_time: dict[str, float]
    closest: dict[tuple[str, str], float]

    def taken_over_time(self, spacecraft: str) -> float:
        """Return when the monitor took a spacecraft over, s; infinite if it did not."""
        taken = np.flatnonzero(self.modes[spacecraft] >= MODE_EVADE)
        return float(taken[0]) if taken.size else math.inf


@dataclass(eq=False)
class _Craft:
    """A spacecraft of the loop that thrusts."""

    target: FloatArray | None
    navigation: DrawnNavigation
    controller: SdreController
    thruster: Thruster
    fault: SpacecraftFault
    generator: np.random.Generator
    scheduled: dict[int, FloatArray] = field(default_factory=dict)
    isolated: np.ndarray[tuple[int], np.dtype[np.bool_]] = field(
        default_factory=lambda: np.zeros(3, dtype=bool)
    )
    states: list[FloatArray] = field(default_factory=list)
    applied: list[FloatArray] = field(default_factory=list)
    modes: list[int] = field(default_factory=list)
    reason: str = ""
    isolated_time: float = math.inf
    watched_time: float = math.inf


def simulate_guarded(
    scenario: Scenario,
    design: SdreDesign,
    setting: SafetySetting | None,
    navigation: NavigationErrorModel,
    faults: Mapping[str, SpacecraftFault] | None = None,
    duration: float | None = None,
    quantum: float = 0.0,
    chief_flight: ChiefFlight | None = None,
) -> GuardedResult:
    """Fly a scenario with faults, guarded by the safety monitor.

    Parameters
    ----------
    scenario
        Initial states, forces, targets; a deputy without a target is not controlled.
    design
        Controller of each deputy.
    setting
        Setting of the safety monitor; None flies without a monitor.
    navigation
        Errors of navigation; each deputy draws its own.
    faults
        By deputy.
    duration
        s, by default that of the scenario.
    quantum
        Acceleration quantum of the thrusters, m/s2.
    chief_flight
        What the chief does; None for one without a thruster.
    """
    steps = round((scenario.duration if duration is None else duration) / scenario.step)
    truth = scenario.formation_truth()
    guarded = {
        deputy.name: _make_craft(
            scenario,
            design,
            deputy.target_rtn,
            dataclasses.replace(navigation, seed=navigation.seed + index),
            (faults or {}).get(deputy.name, SpacecraftFault()),
            np.random.default_rng([navigation.seed, index, 1]),
            quantum,
        )
        for index, deputy in enumerate(scenario.deputies)
    }
    deputies = dict(guarded)
    reference = truth.state_gcrf(truth.chief)
    if chief_flight is not None:
        offset = np.array([*chief_flight.offset, 0.0, 0.0, 0.0])
        reference = deputy_state_gcrf(reference, offset)
        guarded[truth.chief] = _make_craft(
            scenario,
            design,
            np.zeros(6),
            dataclasses.replace(chief_flight.navigation, seed=navigation.seed),
            chief_flight.fault,
            np.random.default_rng([navigation.seed, len(deputies), 1]),
            quantum,
        )
    safety = None
    if setting is not None:
        safety = FormationSafety(truth.chief, list(deputies), setting, chief_flight is not None)
    for step in range(steps):
        time, chief = step * scenario.step, truth.state_gcrf(truth.chief)
        inputs = {}
        reported_chief = np.zeros(3)
        if truth.chief in guarded:
            craft = guarded[truth.chief]
            place = relative_state_rtn(reference, chief)
            heard = _observe(craft, truth.time, time, reference, place, np.zeros(3))
            assert heard.reported_rtn is not None
            reported_chief = heard.reported_rtn
            inputs[truth.chief] = SpacecraftInput(
                None, None, None, reported_chief, heard.command_rtn
            )
            reference = predict_state(reference, scenario.step)
        for name, craft in deputies.items():
            relative = truth.relative_state_rtn(name)
            craft.states.append(relative)
            inputs[name] = _observe(craft, truth.time, time, chief, relative, reported_chief)
        decisions = {} if safety is None else safety.step(inputs).decisions
        thrusts = {}
        for name, craft in guarded.items():
            command = inputs[name].command_rtn
            if name in decisions:
                command = _follow(craft, decisions[name], command, time)
            thrusts[name] = _thrust(craft, truth.time.nanoseconds, time, command)
        truth.advance(thrusts)
    for name, craft in deputies.items():
        craft.states.append(truth.relative_state_rtn(name))
    return _result(truth.chief, deputies, guarded)


def _make_craft(
    scenario: Scenario,
    design: SdreDesign,
    target: FloatArray | None,
    navigation: NavigationErrorModel,
    fault: SpacecraftFault,
    generator: np.random.Generator,
    quantum: float,
) -> _Craft:
    return _Craft(
        target,
        DrawnNavigation(navigation, scenario.force_model, scenario.step),
        SdreController(design),
        Thruster(design.acceleration_cap, quantum, design.delay_steps, scenario.step),
        fault,
        generator,
    )


def _follow(
    craft: _Craft, decision: SpacecraftDecision, command: FloatArray | None, time: float
) -> FloatArray | None:
    """Note what the monitor decides, and return the command that the thruster gets."""
    craft.modes.append(decision.mode)
    if decision.mode in (MODE_EVADE, MODE_HOLD):
        craft.reason = decision.reason
    if decision.mode != MODE_MONITOR:
        craft.watched_time = min(craft.watched_time, time)
    if decision.isolated.any():
        craft.isolated_time = min(craft.isolated_time, time)
    craft.isolated = decision.isolated
    return command if decision.command_rtn is None else decision.command_rtn


def _observe(
    deputy: _Craft,
    now: GpsTime,
    time: float,
    chief: FloatArray,
    relative: FloatArray,
    reported_chief: FloatArray,
) -> SpacecraftInput:
    """Return what the monitor hears of a deputy: navigation, report and command of now."""
    fault = deputy.fault
    estimate, covariance = deputy.navigation.estimate(now, time, chief, relative)
    estimate = estimate + np.array([*fault.navigation_bias, 0.0, 0.0, 0.0])
    stamp = now.nanoseconds
    reported = deputy.scheduled.get(stamp, np.zeros(3))
    if fault.is_reported:
        reported = _true_thrust(deputy, time, reported)
    deputy.navigation.add_thrust(reported - reported_chief)
    is_heard = time < fault.receiver_dead
    command = None
    if deputy.target is not None and is_heard and time < fault.controller_killed:
        command = deputy.controller.control(
            estimate, chief, deputy.target, stamp, covariance
        ).acceleration_rtn
        if fault.controller_silent[0] <= time < fault.controller_silent[1]:
            command = np.zeros(3)
    state_late, command_late = deputy.generator.random(2) < fault.late_share
    if not is_heard or state_late:
        return SpacecraftInput(None, None, None, reported, None if command_late else command)
    return SpacecraftInput(estimate, covariance, chief, reported, None if command_late else command)


def _true_thrust(deputy: _Craft, time: float, told: FloatArray) -> FloatArray:
    """Return what a thruster gives when it is told a thrust, m/s2, shape (3,)."""
    fault = deputy.fault
    thrust = told * fault.thruster_scale
    if time >= fault.thruster_time:
        stuck_on = np.array(fault.stuck_on)
        thrust = np.where(fault.stuck_off, 0.0, np.where(stuck_on != 0.0, stuck_on, thrust))
    return np.where(deputy.isolated, 0.0, thrust)


def _thrust(deputy: _Craft, stamp: int, time: float, command: FloatArray | None) -> FloatArray:
    """Give the command to the thruster, and return the true thrust of the step that begins."""
    if command is not None:
        scheduled = deputy.thruster.command(stamp, np.where(deputy.isolated, 0.0, command))
        deputy.scheduled[scheduled.start_stamp] = scheduled.acceleration_rtn
    told = deputy.scheduled.pop(stamp, np.zeros(3))
    thrust = _true_thrust(deputy, time, told)
    deputy.applied.append(thrust)
    return thrust


def _result(
    chief: str, deputies: Mapping[str, _Craft], guarded: Mapping[str, _Craft]
) -> GuardedResult:
    states = {name: np.array(craft.states) for name, craft in deputies.items()}
    positions = {chief: np.zeros_like(next(iter(states.values()))), **states}
    names = list(positions)
    return GuardedResult(
        states,
        {name: np.array(craft.applied) for name, craft in guarded.items()},
        {name: np.array(craft.modes, dtype=int) for name, craft in guarded.items()},
        {name: craft.reason for name, craft in guarded.items()},
        {name: craft.isolated_time for name, craft in guarded.items()},
        {name: craft.watched_time for name, craft in guarded.items()},
        {
            (first, second): float(
                np.linalg.norm((positions[second] - positions[first])[:, :3], axis=1).min()
            )
            for index, first in enumerate(names)
            for second in names[index + 1 :]
        },
    )
