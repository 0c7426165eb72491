"""Guidance of FFLAS under the safety monitor: nothing in order is disturbed, a failure is held."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from vtff_analysis.fflas.reconfiguration import FFLAS_PERIOD
from vtff_control.guidance.formation_guidance import (
    FormationGuidance,
    FormationGuidanceParameters,
)
from vtff_control.guidance.formations import read_formations
from vtff_control.guidance.interface import FormationState, GuidanceSetting
from vtff_control.guidance.requests import ReconfigurationRequest
from vtff_control.safety.formation_safety import (
    MODE_EVADE,
    FormationSafety,
    SafetySetting,
    SpacecraftInput,
)
from vtff_control.thruster.thruster import Thruster
from vtff_node.executables import share_file
from vtff_node.plain_yaml import parse_yaml
from vtff_sim_bridge.truth.scenario import load_scenario

NAMES = ("alpha", "bravo", "charlie")
SIGMA = np.array([2e-3] * 3 + [1e-5] * 3)  # what the filters state in `vtff run fflas`


def parameters(file):
    text = Path(share_file("vtff_bringup", f"config/params/{file}")).read_text(encoding="utf-8")
    return parse_yaml(text)["/**"]["ros__parameters"]


class Flight:
    """The system fflas_software without ROS, with drawn navigation and the safety monitor.

    Truth is the emulator's, with JGM-3 8x8; the monitor and the guidance know J2.
    """

    def __init__(self, seed=1):
        scenario = load_scenario(share_file("vtff_bringup", "config/scenario/fflas_software.yaml"))
        self.truth, self.step_time = scenario.formation_truth(), scenario.step
        file = share_file("vtff_bringup", "config/formation/fflas.yaml")
        formations = read_formations(parse_yaml(Path(file).read_text()), "fflas.yaml", NAMES)
        setting = GuidanceSetting(NAMES[0], NAMES[1:], self.step_time, formations=formations)
        self.guidance = FormationGuidance(setting, FormationGuidanceParameters("triangle"))
        self.setting = SafetySetting(
            hard_radius=scenario.hard_radius,
            step=self.step_time,
            **parameters("formation_safety_t5.yaml"),
        )
        self.safety = FormationSafety(NAMES[0], NAMES[1:], self.setting, chief_thrusts=True)
        thruster = parameters("thruster_t5.yaml")
        self.thrusters = {
            name: Thruster(step=self.step_time, delay_steps=1, **thruster) for name in NAMES
        }
        self.scheduled = {name: {} for name in NAMES}
        self.isolated = {name: np.zeros(3, dtype=bool) for name in NAMES}
        self.generator = np.random.default_rng(seed)
        self.closest, self.steps = math.inf, []

    @property
    def time(self):
        return len(self.steps) * self.step_time

    def fly(self, stuck=None, has_guidance=True):
        """Fly a step; `stuck` is what a thruster gives whatever it is told, without a report."""
        chief = self.truth.state_gcrf(NAMES[0])
        states = {
            name: self.truth.relative_state_rtn(name) + SIGMA * self.generator.normal(size=6)
            for name in NAMES[1:]
        }
        covariances = dict.fromkeys(states, np.diag(SIGMA**2))
        stamp = self.truth.time.nanoseconds
        commands = dict.fromkeys(NAMES)
        if has_guidance:
            result = self.guidance.step(FormationState(stamp, chief, states, covariances))
            commands = {name: result.targets[name].acceleration_rtn for name in NAMES}
        reports = {name: self.scheduled[name].pop(stamp, np.zeros(3)) for name in NAMES}
        inputs = {
            name: SpacecraftInput(
                states.get(name), covariances.get(name), chief, reports[name], commands[name]
            )
            for name in NAMES
        }
        step = self.safety.step(inputs)
        for name, decision in step.decisions.items():
            command = commands[name] if decision.command_rtn is None else decision.command_rtn
            if command is not None:
                told = self.thrusters[name].command(stamp, np.where(decision.isolated, 0, command))
                self.scheduled[name][told.start_stamp] = told.acceleration_rtn
        thrusts = dict(reports)
        for name, value in (stuck or {}).items():
            thrusts[name] = np.where(self.isolated[name], 0.0, value)
        self.isolated = {name: decision.isolated for name, decision in step.decisions.items()}
        self.truth.advance(thrusts)
        positions = [np.zeros(3), *(self.truth.relative_state_rtn(name)[:3] for name in NAMES[1:])]
        distances = [np.linalg.norm(b - a) for a, b in itertools.combinations(positions, 2)]
        self.closest = min(self.closest, *distances)
        self.steps.append(step)
        return step

    def until(self, time, **arguments):
        while self.time < time:
            self.fly(**arguments)
        return self

    def reasons(self):
        """Return why spacecraft were taken over."""
        decisions = self.steps[-1].decisions
        return {name: d.reason for name, d in decisions.items() if d.mode >= MODE_EVADE}


def reconfiguring(seed, until):
    flight = Flight(seed).until(60.0)
    flight.guidance.request(ReconfigurationRequest("pco", 4560.0))
    return flight.until(until)


def test_guidance_that_dies_in_a_burn_is_replaced_by_an_evasive_manoeuvre():
    """The plan is passively unsafe here: without the monitor two come to 2 m."""
    flight = reconfiguring(1, 210.0)
    assert not flight.reasons()
    flight.until(1900.0, has_guidance=False)
    assert flight.closest >= flight.setting.hard_radius + 1.0
    reasons = flight.reasons()
    assert "no commands" in reasons["bravo"]
    assert "bravo evades" in reasons["alpha"]
    # What it was taken over for.
    first = next(
        step for step in flight.steps if any(d.mode >= MODE_EVADE for d in step.decisions.values())
    )
    assert min(pair.separation for pair in first.pairs) < flight.setting.hard_radius


@pytest.mark.slow
def test_a_reconfiguration_and_an_orbit_of_keeping_are_left_alone():
    flight = reconfiguring(2, 4620.0 + FFLAS_PERIOD)
    assert not flight.reasons()
    assert flight.closest >= 10.0
    # It was no sinecure: with the thrust off two would have met.
    assert min(pair.separation for step in flight.steps for pair in step.pairs) < 4.0


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_an_engine_that_sticks_is_named_and_isolated(name):
    flight = reconfiguring(3, 360.0)
    stuck = {name: np.array([0.0, 1.5e-5, 0.0])}
    flight.until(440.0, stuck=stuck)
    reasons = flight.reasons()
    assert "stuck on along T" in reasons[name]
    decisions = flight.steps[-1].decisions
    assert [other for other in NAMES if decisions[other].isolated.any()] == [name]
    flight.until(440.0 + FFLAS_PERIOD, stuck=stuck)
    assert flight.closest >= flight.setting.hard_radius
