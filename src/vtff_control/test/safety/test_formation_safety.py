"""Decisions of the safety monitor."""

import ast
import dataclasses
import pathlib
import subprocess
import sys

import numpy as np
import pytest
from safety_samples import CHIEF, COVARIANCE, SETTING, heard, relative

import vtff_control.safety
from vtff_control.safety.formation_safety import (
    MODE_EVADE,
    MODE_HOLD,
    MODE_MONITOR,
    MODE_WATCH,
    FormationSafety,
    SafetySetting,
    SpacecraftInput,
)
from vtff_dynamics.frames.rtn import (
    deputy_state_gcrf,
    relative_state_rtn,
    rotation_gcrf_to_rtn,
)
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.relative.designs import helix
from vtff_dynamics.relative.relative_elements import relative_state_of_elements


def monitor(*deputies, setting=SETTING):
    return FormationSafety("chief", deputies or ("deputy",), setting)


def coast(state, seconds, chief=CHIEF):
    """Return relative states and chiefs of free flight, second by second."""
    states = np.array([chief, deputy_state_gcrf(chief, state)])
    flown = free_flight(states, np.arange(float(seconds)))
    return [(relative_state_rtn(*moment), moment[0]) for moment in flown]


def test_it_imports_neither_guidance_nor_controllers():
    folder = pathlib.Path(vtff_control.safety.__file__).parent
    for path in folder.glob("*.py"):
        for statement in ast.walk(ast.parse(path.read_text())):
            names = []
            if isinstance(statement, ast.ImportFrom):
                names = [statement.module or ""]
            elif isinstance(statement, ast.Import):
                names = [alias.name for alias in statement.names]
            for name in names:
                assert not name.startswith("vtff_control") or name.startswith("vtff_control.safety")


def test_a_formation_that_stays_clear_is_passed_through():
    step = monitor().step({"deputy": heard(relative(t=100.0), (1e-5, 0.0, 0.0))})
    decision = step.decisions["deputy"]
    assert decision.command_rtn is None
    assert decision.mode == MODE_MONITOR
    assert not decision.isolated.any()
    (pair,) = step.pairs
    assert (pair.first, pair.second) == ("chief", "deputy")
    assert 90.0 < pair.separation <= 100.0


def test_a_powered_approach_is_watched_and_passed_through():
    step = monitor().step({"deputy": heard(relative(t=600.0, vt=-20.0), (0.0, 0.5, 0.0))})
    decision = step.decisions["deputy"]
    assert decision.mode == MODE_WATCH
    assert decision.command_rtn is None
    assert "chief-deputy" in decision.reason


def test_the_last_way_out_is_taken_before_it_closes():
    """A controller that pushes on: the deputy is taken over while 30 m can be kept."""
    safety, state, chief = monitor(), relative(t=600.0, vt=-20.0), CHIEF
    waiting, closest, modes = np.zeros(3), np.inf, []
    for _ in range(120):
        decision = safety.step(
            {"deputy": heard(state, (0.0, -0.3, 0.0), waiting, chief)}
        ).decisions["deputy"]
        command = np.array([0.0, -0.3, 0.0])
        if decision.command_rtn is not None:
            command = decision.command_rtn
        states = np.array([chief, deputy_state_gcrf(chief, state)])
        states = free_flight(states, [0.0, 1.0])[-1]
        chief = states[0]
        state = relative_state_rtn(*states)
        state += np.concatenate((0.5 * waiting, waiting))
        waiting = command
        closest = min(closest, np.linalg.norm(state[:3]))
        modes.append(decision.mode)
    assert modes[0] == MODE_WATCH
    assert modes[-1] == MODE_HOLD
    assert "the last way out closes" in decision.reason
    assert 30.0 <= closest < 60.0


def test_it_stays_taken_over_until_the_reset():
    safety = monitor()
    for state, chief in coast(relative(t=400.0, vt=-15.0), 4):
        decision = safety.step({"deputy": heard(state, chief=chief)}).decisions["deputy"]
    assert decision.mode == MODE_EVADE
    assert "nobody acts" in decision.reason
    far = heard(relative(t=5000.0), (0.1, 0.0, 0.0))
    decision = safety.step({"deputy": far}).decisions["deputy"]
    assert decision.mode == MODE_HOLD
    np.testing.assert_array_equal(decision.command_rtn, 0.0)
    safety.reset("deputy")
    decision = safety.step({"deputy": far}).decisions["deputy"]
    assert decision.mode == MODE_MONITOR
    assert decision.command_rtn is None
    with pytest.raises(KeyError):
        safety.reset("nobody")


def test_it_does_not_matter_which_state_came_first():
    """Each filter has an idea of its own of where the chief is."""
    in_order, reversed_order = (FormationSafety("chief", ("one", "two"), SETTING) for _ in range(2))
    elsewhere = CHIEF + np.array([40.0, -30.0, 20.0, 0.02, 0.01, -0.03])
    inputs = {
        "one": heard(relative(t=120.0, vt=-2.0)),
        "two": heard(relative(t=-200.0, n=50.0), chief=elsewhere),
    }
    first = in_order.step(inputs)
    second = reversed_order.step(dict(reversed(inputs.items())))
    assert first.pairs == second.pairs


def test_a_report_that_nobody_commanded_isolates_the_axis():
    safety = monitor()
    safety.step({"deputy": heard(relative(t=100.0), (0.0, 0.0, 0.0))})
    decision = safety.step(
        {"deputy": heard(relative(t=100.0), (0.0, 0.0, 0.0), (0.0, -0.9, 0.0))}
    ).decisions["deputy"]
    assert decision.isolated.tolist() == [False, True, False]
    assert "stuck on along T" in decision.reason
    assert decision.command_rtn[1] == 0.0


def test_a_report_of_less_than_half_isolates_the_axis():
    safety = monitor()
    for _ in range(3):
        decision = safety.step(
            {"deputy": heard(relative(t=1000.0), (0.0, 0.8, 0.0), (0.0, 0.0, 0.0))}
        ).decisions["deputy"]
    assert decision.isolated.tolist() == [False, True, False]
    assert "stuck off or weak along T" in decision.reason


def test_a_deputy_without_navigation_is_predicted_with_growing_covariance():
    safety = monitor(setting=SafetySetting(hard_radius=30.0, acceleration_cap=1.4, orbits=0.2))
    first = safety.step({"deputy": heard(relative(t=400.0))}).pairs[0]
    silent = SpacecraftInput(command_rtn=np.zeros(3), reported_rtn=np.zeros(3))
    for _ in range(300):
        last = safety.step({"deputy": silent}).pairs[0]
    assert last.sigmas < first.sigmas
    # It drifts as free flight does, and evades before its sigma reaches the chief.
    poor = monitor(setting=SafetySetting(hard_radius=30.0, acceleration_cap=1.4, orbits=1.0))
    state = heard(relative(t=100.0))
    blurred = SpacecraftInput(
        state.relative_rtn, 400.0 * COVARIANCE, CHIEF, np.zeros(3), np.zeros(3)
    )
    poor.step({"deputy": blurred})
    reasons = ""
    for _ in range(300):
        decision = poor.step({"deputy": SpacecraftInput()}).decisions["deputy"]
        if decision.mode == MODE_EVADE:
            reasons = decision.reason
            break
    assert "no commands" in reasons


def test_pairs_of_deputies_count():
    """Two deputies meet far from the chief; one of them is moved away."""
    setting = SafetySetting(hard_radius=30.0, acceleration_cap=1.4)
    safety = FormationSafety("a", ("b", "c"), setting)
    states = {"b": relative(t=3000.0, vt=-4.0), "c": relative(t=2700.0, vt=4.0)}
    flights = zip(*(coast(state, 5) for state in states.values()), strict=True)
    for moments in flights:
        step = safety.step(
            {
                name: heard(state, chief=chief)
                for name, (state, chief) in zip(states, moments, strict=True)
            }
        )
    assert [(pair.first, pair.second) for pair in step.pairs] == [
        ("a", "b"),
        ("a", "c"),
        ("b", "c"),
    ]
    assert step.pairs[2].separation < 30.0
    assert step.decisions["b"].mode == MODE_EVADE


def test_a_passively_safe_formation_needs_no_commands():
    safety = monitor()
    state = relative_state_of_elements(CHIEF, helix(60.0, 60.0, 0.3))
    for _ in range(20):
        decision = safety.step({"deputy": heard(state, None)}).decisions["deputy"]
    assert decision.mode == MODE_MONITOR


def test_wrong_settings_and_names_are_named():
    with pytest.raises(ValueError, match="hard_radius: more than 0"):
        SafetySetting(hard_radius=0.0)
    with pytest.raises(ValueError, match="probability: less than 0.5"):
        SafetySetting(probability=0.7)
    with pytest.raises(ValueError, match="different names"):
        FormationSafety("chief", ("a", "a"), SETTING)
    with pytest.raises(ValueError, match="at least one"):
        FormationSafety("chief", (), SETTING)


def test_before_any_navigation_commands_pass():
    decision = monitor().step({"deputy": SpacecraftInput(command_rtn=np.zeros(3))})
    assert decision.pairs == []
    assert decision.decisions["deputy"].command_rtn is None


def test_far_apart_a_poor_velocity_is_no_reason_to_take_over():
    """15 km and 10 m/s: after ten minutes nothing is clear, whatever the deputy does."""
    state = np.array([-1000.0, -15e3, 0.0, 0.0, 1.6, 0.0])
    blurred = np.diag([5.0**2] * 3 + [10.0**2] * 3)
    start = SpacecraftInput(state, blurred, CHIEF, np.zeros(3), np.array([0.0, -1.0, 0.0]))
    decision = monitor().step({"deputy": start}).decisions["deputy"]
    assert decision.mode == MODE_MONITOR and decision.command_rtn is None
    assert "not good enough" in decision.reason


def test_a_filter_that_has_just_started_is_not_judged_by():
    """Its velocity has a sigma of 30 m/s: nothing would be clear, and nothing would help."""
    blurred = np.diag([0.01**2] * 3 + [30.0**2] * 3)
    state = relative(t=1000.0)
    start = SpacecraftInput(state, blurred, CHIEF, np.zeros(3), np.array([0.0, -1.0, 0.0]))
    safety = monitor()
    step = safety.step({"deputy": start})
    assert step.decisions["deputy"].mode == MODE_MONITOR
    assert step.decisions["deputy"].command_rtn is None
    assert "not good enough" in step.decisions["deputy"].reason
    assert step.pairs == []
    # Later such a state is worth less than the prediction from the one before.
    (first, second) = coast(state, 2)
    safety.step({"deputy": heard(first[0], chief=first[1])})
    again = SpacecraftInput(second[0], blurred, second[1], np.zeros(3), np.array([0.0, 1e-4, 0.0]))
    step = safety.step({"deputy": again})
    assert step.pairs[0].violation_time == np.inf
    assert step.decisions["deputy"].reason == ""


@pytest.mark.parametrize("is_stuck", [False, True])
def test_a_link_that_is_cut_does_not_accuse_the_thruster(is_stuck):
    """Ten seconds without reports and measurements; the thruster ends its thrust after two.

    A thruster that goes on pushing is named when navigation is back.
    """
    safety = monitor()
    states = np.array([CHIEF, deputy_state_gcrf(CHIEF, relative(t=5000.0))])
    push = np.array([0.0, 1.0, 0.0])
    believed_states = states
    for second in range(40):
        is_cut = 15 <= second < 25
        flown = push if 1 <= second < 17 or (is_stuck and second >= 17) else np.zeros(3)
        command = push if second < 14 else np.zeros(3)
        if is_cut:  # navigation believes that nothing pushes
            believed_states = free_flight(believed_states, [0.0, 1.0])[-1]
        else:
            believed_states = states
        believed = relative_state_rtn(*believed_states)
        reported = None if is_cut else (flown if second < 15 else np.zeros(3))
        given = SpacecraftInput(
            believed, COVARIANCE, states[0], reported, command, is_predicted=is_cut
        )
        decision = safety.step({"deputy": given}).decisions["deputy"]
        if decision.isolated.any():
            break
        acceleration = rotation_gcrf_to_rtn(states[0]).T @ flown
        states = free_flight(states, [0.0, 1.0])[-1]
        states[1] += np.concatenate((0.5 * acceleration, acceleration))
    if is_stuck:
        assert 25 <= second <= 28
        assert decision.isolated.tolist() == [False, True, False]
        assert "stuck on along T" in decision.reason
    else:
        assert second == 39
        assert not decision.reason


@pytest.mark.parametrize(("smallest", "is_accused"), [(6.3e-7, False), (0.0, True)])
def test_thrusters_of_a_body_give_their_smallest_thrust_along_all_axes_of_the_orbit(
    smallest, is_accused
):
    """A command of 10 uN/kg along R, 1.8 deg off in the body: T5 engines round up to 1 mN."""
    setting = dataclasses.replace(SETTING, acceleration_cap=1.5625e-5, smallest_thrust=smallest)
    safety = monitor(setting=setting)
    command = np.array([-1e-5, 0.0, 0.0])
    safety.step({"deputy": heard(relative(t=100.0), command)})
    reported = np.array([-1.001e-5, 1.8e-8, 3.169e-7])  # seed 3 of reference_attitude, 1222 s
    safety.step({"deputy": heard(relative(t=100.0), (0.0, 0.0, 0.0), reported)})
    decision = safety.step({"deputy": heard(relative(t=100.0), (0.0, 0.0, 0.0))}).decisions[
        "deputy"
    ]
    assert bool(decision.isolated.any()) == is_accused
    # More than three engines can round to is a thruster that does not do what it is told.
    safety = monitor(setting=setting)
    safety.step({"deputy": heard(relative(t=100.0), command)})
    reported = np.array([-1e-5, 0.0, 6e-7])
    step = safety.step({"deputy": heard(relative(t=100.0), (0.0, 0.0, 0.0), reported)})
    assert step.decisions["deputy"].isolated.any()


def test_thrust_that_nobody_reports_makes_a_prediction_unsure():
    silent, off = monitor(), monitor()
    push = np.array([0.0, 0.5, 0.0])
    for step in range(8):
        report = push if step else np.zeros(3)
        given = SpacecraftInput(relative(t=2000.0), COVARIANCE, CHIEF, report, push, step >= 3)
        unknown = dataclasses.replace(given, reported_rtn=report if step < 3 else None)
        known = dataclasses.replace(given, reported_rtn=report if step < 3 else np.zeros(3))
        unsure = silent.step({"deputy": unknown}).pairs[0]
        sure = off.step({"deputy": known}).pairs[0]
    assert unsure.sigmas < 0.5 * sure.sigmas


def test_thrust_that_nobody_reports_counts_once_in_a_step():
    """A predicted state that is too poor to judge by, yet better than the prediction, is taken."""
    safety = monitor()
    push = np.array([0.0, 0.5, 0.0])
    for _ in range(3):
        safety.step({"deputy": heard(relative(t=2000.0), push, push)})
    track = safety._tracks["deputy"]
    poor = np.diag([800.0**2] * 3 + [1e-4**2] * 3)
    track.covariance = 4.0 * poor
    given = SpacecraftInput(relative(t=2000.0), poor, CHIEF, None, push, is_predicted=True)
    safety.step({"deputy": given})
    safety.step({"deputy": given})
    # One step without a report: between nothing and 0.5 m/s2, that is 0.25 m/s more or less.
    assert np.sqrt(track.unreported_effect[4, 4]) == pytest.approx(0.25, rel=1e-4)


class ChiefFlight:
    """A formation whose chief thrusts, flown in GCRF; every spacecraft by itself."""

    def __init__(self, offsets, sigma=1e-5, seed=5):
        self.names = list(offsets)
        self.safety = FormationSafety("chief", self.names, SETTING, chief_thrusts=True)
        self.states = np.array([CHIEF, *(deputy_state_gcrf(CHIEF, o) for o in offsets.values())])
        self.sigma = sigma
        self.generator = np.random.default_rng(seed)
        # What is commanded now acts in the next step.
        self.waiting = {name: np.zeros(3) for name in ("chief", *self.names)}
        self.isolated = {name: np.zeros(3, dtype=bool) for name in self.waiting}

    def fly(self, commands, stuck=None, is_reported=False):
        """Judge one second and fly it; `stuck` is what a thruster gives whatever it is told."""
        stuck = stuck or {}
        thrusts = {
            name: np.where(self.isolated[name], 0.0, stuck.get(name, self.waiting[name]))
            for name in self.waiting
        }
        reports = thrusts if is_reported else self.waiting
        inputs = {
            "chief": SpacecraftInput(
                reported_rtn=reports["chief"], command_rtn=np.array(commands["chief"])
            )
        }
        for name, state in zip(self.names, self.states[1:], strict=True):
            relative_state = relative_state_rtn(self.states[0], state)
            relative_state[3:] += self.sigma * self.generator.standard_normal(3)
            inputs[name] = heard(
                relative_state, commands.get(name, (0.0, 0.0, 0.0)), reports[name], self.states[0]
            )
        decisions = self.safety.step(inputs).decisions
        for name, decision in decisions.items():
            passed = np.array(commands.get(name, (0.0, 0.0, 0.0)), dtype=float)
            told = passed if decision.command_rtn is None else decision.command_rtn
            self.isolated[name] = decision.isolated
            self.waiting[name] = np.where(decision.isolated, 0.0, told)
        pushes = np.array(list(thrusts.values())) @ rotation_gcrf_to_rtn(self.states[0])
        self.states = free_flight(self.states, [0.0, 1.0])[-1]
        self.states += np.concatenate((0.5 * pushes, pushes), axis=1)
        return decisions

    def distances(self):
        return np.linalg.norm(self.states[1:, :3] - self.states[0, :3], axis=1)


PAIR = {"ahead": relative(t=300.0), "behind": relative(t=-300.0)}


def test_a_chief_that_thrusts_is_no_fault_of_its_deputies():
    """Its thrust is far above what is looked at; so is that of the deputies."""
    flight = ChiefFlight(PAIR)
    for second in range(60):
        size = 0.5 if second % 20 < 10 else -0.5
        commands = {"chief": (0.0, 0.0, size), "ahead": (0.0, 0.3 * size, 0.0)}
        decisions = flight.fly(commands)
        assert all(decision.command_rtn is None for decision in decisions.values())
        assert not any(decision.isolated.any() for decision in decisions.values())


@pytest.mark.parametrize("is_reported", [False, True])
@pytest.mark.parametrize("size", [0.3, -1.4])
def test_a_chief_whose_thruster_sticks_is_named_as_the_chief(size, is_reported):
    flight = ChiefFlight(PAIR)
    for second in range(60):
        stuck = {"chief": np.array([0.0, 0.0, size])} if second >= 10 else {}
        decisions = flight.fly({"chief": (0.0, 0.0, 0.0)}, stuck, is_reported)
        if decisions["chief"].isolated.any():
            break
    assert second - 10 <= 2
    for _ in range(60):  # the seconds before remain in the past of all of them
        decisions = flight.fly({"chief": (0.0, 0.1, 0.0)}, stuck, is_reported)
    assert decisions["chief"].isolated.tolist() == [False, False, True]
    assert decisions["chief"].mode == MODE_HOLD
    np.testing.assert_array_equal(decisions["chief"].command_rtn, 0.0)
    assert "thruster stuck on along N" in decisions["chief"].reason
    for name in PAIR:
        assert not decisions[name].isolated.any()
        assert "thruster" not in decisions[name].reason
    flight.safety.reset("chief")
    assert flight.fly({"chief": (0.0, 0.0, 0.0)})["chief"].mode == MODE_MONITOR


def test_a_deputy_whose_thruster_sticks_beside_a_chief_that_thrusts():
    flight = ChiefFlight(PAIR)
    for second in range(40):
        stuck = {"behind": np.array([0.0, -0.4, 0.0])} if second >= 10 else {}
        decisions = flight.fly({"chief": (0.0, 0.0, 0.5)}, stuck)
        if decisions["behind"].isolated.any():
            break
    assert second - 10 <= 2
    assert "stuck on along T" in decisions["behind"].reason
    assert not decisions["chief"].isolated.any()
    assert not decisions["ahead"].isolated.any()


def test_a_single_deputy_and_its_chief_cannot_be_told_apart():
    flight = ChiefFlight({"ahead": relative(t=300.0)})
    for second in range(40):
        stuck = {"chief": np.array([0.4, 0.0, 0.0])} if second >= 10 else {}
        decisions = flight.fly({"chief": (0.0, 0.0, 0.0)}, stuck)
        if decisions["chief"].isolated.any():
            break
    assert second - 10 <= 2
    for name, other in (("ahead", "chief"), ("chief", "ahead")):
        assert decisions[name].isolated.tolist() == [True, False, False]
        assert f"its own or that of {other}" in decisions[name].reason


def test_a_chief_that_flies_into_its_deputy_is_stopped_and_evaded():
    flight = ChiefFlight(PAIR)
    closest = np.inf
    for _ in range(120):
        decisions = flight.fly({"chief": (0.0, 0.4, 0.0)})
        closest = min(closest, flight.distances().min())
    assert closest >= 30.0
    assert decisions["chief"].mode == MODE_HOLD
    assert "ahead evades" in decisions["chief"].reason
    assert decisions["ahead"].mode >= MODE_EVADE


def test_without_navigation_the_thrust_of_the_chief_is_in_the_prediction():
    """Two minutes blind while the chief thrusts: the distance is that which is flown."""
    flight = ChiefFlight({"ahead": relative(t=2000.0)})
    for _ in range(3):
        flight.fly({"chief": (0.0, 0.05, 0.0)})
    blind = {"chief": flight.waiting["chief"], "ahead": np.zeros(3)}
    for _ in range(120):
        flight.safety.step(
            {
                name: SpacecraftInput(reported_rtn=thrust, command_rtn=thrust)
                for name, thrust in blind.items()
            }
        )
        pushes = np.array(list(blind.values())) @ rotation_gcrf_to_rtn(flight.states[0])
        flight.states = free_flight(flight.states, [0.0, 1.0])[-1]
        flight.states += np.concatenate((0.5 * pushes, pushes), axis=1)
    predicted = flight.safety._tracks["ahead"].relative
    # One step behind: what was flown after it was judged.
    before = free_flight(flight.states, [0.0, -1.0])[-1]
    flown = relative_state_rtn(*before)
    assert np.linalg.norm(flown[:3] - [0.0, 2000.0, 0.0]) > 100.0
    np.testing.assert_allclose(predicted[:3], flown[:3], atol=1.0)
    # The error of its thrust is in the covariance as that of the deputy would be.
    effect = flight.safety._tracks["ahead"].thrust_effect
    assert np.abs(effect[1, 3:]).max() > 100.0


COMPILED_BEFORE_THE_FIRST_STEP = """
import numpy as np
from compiled_forms import compiled_forms
from safety_samples import CHIEF, SETTING, heard, relative
from vtff_control.safety.formation_safety import (
    MODE_EVADE, FormationSafety, SafetySetting, judge_synthetic_formation,
)

for setting in (SETTING, SafetySetting()):
    judge_synthetic_formation(setting)
    before = compiled_forms()
    assert before
    modes = set()
    for first, speed in ((600.0, -20.0), (2e4, 0.0)):
        safety = FormationSafety("chief", ("deputy",), setting)
        state = relative(t=first, vt=speed)
        for _ in range(40):
            result = safety.step({"deputy": heard(state)})
            modes.add(result.decisions["deputy"].mode)
            assert all(0.0 <= pair.probability <= 1.0 for pair in result.pairs)
            state[1] += speed
    assert MODE_EVADE in modes, modes
    assert compiled_forms() == before, (before, compiled_forms())
"""


def test_nothing_is_left_to_compile_for_the_first_step():
    """In a process of its own: other tests have compiled everything here."""
    program = f"import sys; sys.path[:0] = {sys.path!r}\n{COMPILED_BEFORE_THE_FIRST_STEP}"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
