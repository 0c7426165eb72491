"""Faults that are drawn: formations in which something fails, for the safety monitor.

A case is physically escapable: a thruster that is stuck off on every axis fails while its deputy
keeps its place, not on a powered approach, which nothing could stop then.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from vtff_analysis.closed_loop.drawn_navigation import NavigationErrorModel
from vtff_analysis.closed_loop.guarded import (
    ChiefFlight,
    GuardedResult,
    SpacecraftFault,
    simulate_guarded,
)
from vtff_control.safety.formation_safety import SafetySetting
from vtff_control.tracking.sdre import SdreDesign
from vtff_dynamics.frames.rtn import deputy_state_gcrf
from vtff_dynamics.relative.designs import helix
from vtff_dynamics.relative.relative_elements import relative_state_of_elements
from vtff_dynamics.vectors import FloatArray
from vtff_sim_bridge.truth.scenario import Scenario, Spacecraft

__all__ = ["FAULTS", "FORMATIONS", "FaultCase", "draw_fault_case", "fly_fault_case"]

FAULTS = (
    "stuck_on",
    "stuck_off",
    "navigation_bias",
    "receiver_dead",
    "late_messages",
    "controller_killed",
)
FORMATIONS = ("approach", "keeping", "two_deputies", "helix")
HARD_RADIUS = 30.0  # m
_CAP = 1.4  # m/s2
_QUANTUM = 1e-5  # m/s2


@dataclass(frozen=True, eq=False)
class FaultCase:
    """A formation in which something fails.

    Attributes
    ----------
    formation, fault
        Names from `FORMATIONS` and `FAULTS`.
    scenario
        What is flown.
    navigation
        Errors of navigation.
    failing
        What fails on the first deputy; or, with a flight of the chief in which something fails, on
        the chief.
    duration
        s.
    chief_flight
        What the chief does; None for one without a thruster.
    """

    formation: str
    fault: str
    scenario: Scenario
    navigation: NavigationErrorModel
    failing: SpacecraftFault
    duration: float
    chief_flight: ChiefFlight | None = None

    @property
    def failing_name(self) -> str:
        """Name of the spacecraft on which something fails."""
        if self.chief_flight is not None and self.chief_flight.fault == self.failing:
            return self.scenario.chief.name
        return self.scenario.deputies[0].name


def draw_fault_case(reference: Scenario, seed: int, chief_thrusts: bool = False) -> FaultCase:
    """Draw a case; formations and faults take turns, their numbers are drawn from the seed.

    Parameters
    ----------
    reference
        The scenario ``reference``: a deputy 1000 m ahead of its chief, to fly to 100 m.
    seed
        0 or more.
    chief_thrusts
        Whether the chief thrusts too, to a place some metres away; every second thruster that
        fails is the chief's then.
    """
    generator = np.random.default_rng([seed, 15])
    formation = FORMATIONS[seed % len(FORMATIONS)]
    fault = FAULTS[seed // len(FORMATIONS) % len(FAULTS)]
    scenario = _formation(reference, formation, generator)
    position_sigma = 10.0 ** generator.uniform(-3.0, -1.0)
    navigation = NavigationErrorModel(
        position_sigma, 0.01 * position_sigma, generator.choice([0.0, 30.0]), (), 0.0, seed
    )
    on_approach = formation == "approach"
    time = float(round(generator.uniform(5.0, 60.0 if on_approach else 100.0)))
    failing = _fault(fault, time, on_approach, generator)
    flight = None
    if chief_thrusts:
        r, t, n = generator.uniform(-15.0, 15.0, 3).tolist()
        flight = ChiefFlight((r, t, n))
        turn = seed // (len(FORMATIONS) * len(FAULTS))
        if fault in ("stuck_on", "stuck_off") and turn % 2:
            flight = dataclasses.replace(flight, fault=failing)
    duration = 300.0 if on_approach else 500.0
    return FaultCase(formation, fault, scenario, navigation, failing, duration, flight)


def fly_fault_case(case: FaultCase, is_guarded: bool = True) -> GuardedResult:
    """Fly a case with the safety monitor, or without."""
    setting = SafetySetting(hard_radius=HARD_RADIUS, acceleration_cap=_CAP)
    design = SdreDesign("navigation_aware", acceleration_cap=_CAP)
    deputy = case.scenario.deputies[0].name
    return simulate_guarded(
        case.scenario,
        design,
        setting if is_guarded else None,
        case.navigation,
        {deputy: case.failing} if case.failing_name == deputy else {},
        case.duration,
        _QUANTUM,
        case.chief_flight,
    )


def _formation(reference: Scenario, formation: str, generator: np.random.Generator) -> Scenario:
    """Return the scenario of a formation; the approach is the reference itself."""
    if formation == "approach":
        return reference
    (deputy,) = reference.deputies
    chief = reference.chief.state_gcrf
    side = float(generator.choice([-1.0, 1.0]))

    def craft(name: str, relative: FloatArray, is_controlled: bool = True) -> Spacecraft:
        return dataclasses.replace(
            deputy,
            name=name,
            state_gcrf=deputy_state_gcrf(chief, relative),
            target_rtn=relative if is_controlled else None,
        )

    near = np.array([0.0, side * generator.uniform(80.0, 150.0), 0.0, 0.0, 0.0, 0.0])
    if formation == "keeping":
        deputies = [craft(deputy.name, near)]
    elif formation == "two_deputies":
        deputies = [craft("first", near), craft("second", 2.0 * near)]
    else:
        phase = generator.uniform(0.0, 2.0 * np.pi)
        deputies = [
            craft(
                name,
                relative_state_of_elements(chief, helix(60.0, 80.0, phase + turn)),
                is_controlled=False,
            )
            for name, turn in (("first", 0.0), ("second", np.pi))
        ]
    return dataclasses.replace(reference, spacecraft=(reference.chief, *deputies))


def _fault(
    fault: str, time: float, on_approach: bool, generator: np.random.Generator
) -> SpacecraftFault:
    """Draw the numbers of a fault."""
    axis = int(generator.integers(3))
    scale = float(generator.uniform(0.95, 1.05))
    if fault == "stuck_on":
        size = generator.choice([-1.0, 1.0]) * _CAP * 10.0 ** generator.uniform(-1.0, 0.0)
        r, t, n = (size * (np.arange(3) == axis)).tolist()
        return SpacecraftFault(
            stuck_on=(r, t, n),
            thruster_time=time,
            is_reported=bool(generator.integers(2)),
            thruster_scale=scale,
        )
    if fault == "stuck_off":
        off = np.arange(3) == axis
        if not on_approach and generator.integers(2):
            off[:] = True
        r, t, n = off.tolist()
        return SpacecraftFault(
            stuck_off=(r, t, n),
            thruster_time=time,
            is_reported=bool(generator.integers(2)),
            thruster_scale=scale,
        )
    if fault == "navigation_bias":
        direction = generator.standard_normal(3)
        r, t, n = (0.5 * direction / np.linalg.norm(direction)).tolist()
        return SpacecraftFault(
            navigation_bias=(r, t, n), thruster_scale=scale, controller_killed=time
        )
    if fault == "receiver_dead":
        return SpacecraftFault(receiver_dead=time, thruster_scale=scale)
    if fault == "late_messages":
        late_share = float(generator.uniform(0.05, 0.4))
        return SpacecraftFault(late_share=late_share, thruster_scale=scale)
    return SpacecraftFault(controller_killed=time, thruster_scale=scale)
