"""Reconfiguration: bounds of theory, limits, honest failure, passive safety."""

import math

import numpy as np
import pytest

from vtff_control.guidance.free_drift import FreeDrift, closest_of_paths, fly_drifts
from vtff_control.guidance.reconfiguration import ReconfigurationPlanner
from vtff_control.guidance.reconfiguration_plan import (
    InfeasibleReconfigurationError,
    ReconfigurationLimits,
)
from vtff_dynamics.constants import GM_EARTH, J2_EARTH
from vtff_dynamics.frames.rtn import deputy_state_gcrf
from vtff_dynamics.orbit.elements import ClassicalElements
from vtff_dynamics.relative.designs import projected_circular_track_normal
from vtff_dynamics.relative.linearised import linearise_motion
from vtff_dynamics.relative.relative_elements import control_matrix, linear_map_rtn

AXIS = 6.9e6
MEAN_MOTION = math.sqrt(GM_EARTH / AXIS**3)
PERIOD = 2.0 * math.pi / MEAN_MOTION
CAP = 2e-5


def motion(orbits, steps, extra=0, j2=0.0):
    state = ClassicalElements(AXIS, 0.0, 1.2, 0.0, 0.0, 0.0).to_state()
    return linearise_motion(state, orbits * PERIOD / steps, steps + extra, j2)


def states_of(elements, latitude):
    return linear_map_rtn(MEAN_MOTION, latitude) @ np.asarray(elements, dtype=float).T


def crossing():
    """Two spacecraft 30 m apart along-track that change sides."""
    initial = np.zeros((2, 6))
    initial[:, 1] = 15.0, -15.0
    return initial, initial[::-1].copy()


def test_inclination_change_costs_what_one_impulse_does():
    # A change of delta i_x has its impulse at u = 0, in the middle of the span.
    steps = 60
    elements = np.array([[0.0, 200.0, 0.0, 0.0, 0.0, 0.0]])
    wanted = elements + [0.0, 0.0, 0.0, 0.0, 3.0, 0.0]
    # The argument of latitude is zero at the start: whole orbits on both sides of u = 2 pi.
    planner = ReconfigurationPlanner(motion(2.0, steps), 1, ReconfigurationLimits(1e-3))
    plan = planner.plan(states_of(elements, 0.0).T, states_of(wanted, 4.0 * math.pi).T)
    least = 3.0 * MEAN_MOTION
    assert plan.velocity_changes[0] == pytest.approx(least, rel=0.01)
    assert plan.velocity_changes[0] > least * (1.0 - 1e-6)
    effect = control_matrix(MEAN_MOTION, 0.0)[4, 2]
    assert effect == pytest.approx(1.0 / MEAN_MOTION)
    np.testing.assert_allclose(plan.states[0, -1], states_of(wanted, 4.0 * math.pi).T[0], atol=2e-3)


def test_limits_hold_between_the_steps_and_warm_start_agrees():
    initial, final = crossing()
    # Few long steps, so that a limit at the steps alone would be broken between them.
    path = motion(1.0, 24)
    planner = ReconfigurationPlanner(path, 2, ReconfigurationLimits(CAP, 12.0))
    plan = planner.plan(initial, final)
    assert np.abs(plan.accelerations).max() <= CAP * (1.0 + 1e-9)
    np.testing.assert_allclose(plan.states[:, -1], final, atol=1e-4)
    # Flown again in much shorter steps.
    fine = motion(1.0, 24 * 20)
    positions = fine.fly(initial, np.repeat(plan.accelerations, 20, axis=1))[:, :, :3]
    closest = np.linalg.norm(positions[1] - positions[0], axis=1).min()
    assert closest >= 12.0 - 1e-3
    assert plan.closest_approach == pytest.approx(closest, abs=0.05)
    again = planner.plan(initial, final, plan)
    assert again.passes < plan.passes
    assert again.velocity_changes.sum() <= plan.velocity_changes.sum() * 1.01
    assert again.closest_approach >= 12.0 - 1e-3


def test_objectives_and_axes():
    initial, final = crossing()
    path = motion(1.0, 40)
    plans = {
        (objective, axes): ReconfigurationPlanner(
            path, 2, ReconfigurationLimits(CAP, 0.0, axes, objective)
        ).plan(initial, final)
        for objective, axes in [
            ("norms", "RTN"),
            ("axes", "RTN"),
            ("energy", "RTN"),
            ("norms", "TN"),
        ]
    }
    norms = {key: plan.velocity_changes.sum() for key, plan in plans.items()}
    sums = {key: plan.velocity_changes_axes.sum() for key, plan in plans.items()}
    squares = {key: (plan.accelerations**2).sum() for key, plan in plans.items()}
    assert min(norms, key=norms.get) in (("norms", "RTN"), ("norms", "TN"))
    assert sums["axes", "RTN"] <= min(sums.values()) * (1.0 + 1e-4)
    assert squares["energy", "RTN"] == min(squares.values())
    assert not plans["norms", "TN"].accelerations[:, :, 0].any()


def test_what_cannot_be_met_is_named():
    initial, final = crossing()
    path = motion(0.5, 20)
    weak = ReconfigurationPlanner(path, 2, ReconfigurationLimits(1e-7, 5.0))
    with pytest.raises(InfeasibleReconfigurationError, match="acceleration_cap") as caught:
        weak.plan(initial, final)
    assert caught.value.constraint == "acceleration_cap"
    # With a hair more than what is needed it goes (the other spacecraft aside).
    enough = caught.value.reachable * 1.001
    ReconfigurationPlanner(path, 2, ReconfigurationLimits(enough, 0.0)).plan(initial, final)
    with pytest.raises(InfeasibleReconfigurationError, match="acceleration_cap"):
        less = caught.value.reachable * 0.99
        ReconfigurationPlanner(path, 2, ReconfigurationLimits(less, 0.0)).plan(initial, final)

    near = ReconfigurationPlanner(path, 2, ReconfigurationLimits(enough * 1.02, 29.5))
    with pytest.raises(InfeasibleReconfigurationError, match="reachable within the cap") as caught:
        near.plan(initial, final)
    assert caught.value.constraint == "closest_approach"
    assert 0.0 <= caught.value.reachable < 29.5
    with pytest.raises(InfeasibleReconfigurationError, match="apart at the start") as caught:
        ReconfigurationPlanner(path, 2, ReconfigurationLimits(CAP, 31.0)).plan(initial, final)
    assert caught.value.reachable == pytest.approx(30.0)
    with pytest.raises(InfeasibleReconfigurationError, match="no thrust along N alone"):
        ReconfigurationPlanner(path, 2, ReconfigurationLimits(CAP, 5.0, "N")).plan(initial, final)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"acceleration_cap": 0.0}, "acceleration_cap"),
        ({"acceleration_cap": 1.0, "closest_approach": -1.0}, "closest_approach"),
        ({"acceleration_cap": 1.0, "axes": "RX"}, "axes"),
        ({"acceleration_cap": 1.0, "objective": "fuel"}, "objective"),
    ],
)
def test_bad_limits(values, text):
    with pytest.raises(ValueError, match=text):
        ReconfigurationLimits(**values)


def test_loss_of_thrust_is_safe_at_every_step():
    # At rest one above the other across the orbital plane: drifting, they cross in the plane 6.2 m
    # apart, until thrust has widened that.
    steps, orbit = 30, 40
    path = motion(0.75, steps, orbit)
    initial = np.zeros((2, 6))
    initial[:, 1:3] = [0.0, -5.4], [6.2, 5.4]
    circles = [projected_circular_track_normal(15.0, phase) for phase in (0.0, 4.0)]
    final = states_of(circles, 1.5 * math.pi).T
    limits = ReconfigurationLimits(CAP, 10.0)
    drift = FreeDrift(path, steps, 2)
    own = drift.closest(initial[:, np.newaxis])[0]
    assert own == pytest.approx(6.2, abs=1e-3)
    unsafe = ReconfigurationPlanner(path.first(steps), 2, limits).plan(initial, final)
    assert unsafe.closest_drifts is None
    assert drift.closest(unsafe.states).min() < own - 0.5
    planner = ReconfigurationPlanner(path, 2, limits, steps)
    plan = planner.plan(initial, final)
    assert plan.safe_step == planner.first_safe_step(initial) > 0
    assert plan.closest_drifts.min() >= own - 1e-3
    assert plan.closest_drifts[plan.safe_step :].min() >= 10.0 - 1e-3
    assert plan.velocity_changes.sum() >= unsafe.velocity_changes.sum()
    # The drift after the loss at one step, by the motion itself.
    stopped = np.zeros((2, path.count, 3))
    stopped[:, :11] = plan.accelerations[:, :11]
    positions = path.fly_within(initial, stopped)[:, 11 : 11 + orbit].reshape(2, -1, 3)
    closest = np.linalg.norm(positions[1] - positions[0], axis=1).min()
    # Between samples of a drift a chord is nearer than the path, by 0.5 % where it turns by 11 deg.
    assert closest == pytest.approx(plan.closest_drifts[11], rel=0.005)


@pytest.mark.parametrize(("distance", "least", "most"), [(20.0, 0.0, 0.01), (18000.0, 20.0, 1e4)])
def test_drifts_bend_from_linear_motion_by_the_square_of_the_distance(distance, least, most):
    steps, samples = 4, 120
    path = motion(0.05, steps, samples, J2_EARTH)
    references = path.states_reference_gcrf
    states = np.zeros((2, steps + 1, 6))
    states[1, :, 1] = distance
    gcrf = [
        [deputy_state_gcrf(references[j], states[i, j]) for i in (0, 1)] for j in range(steps + 1)
    ]
    linear = FreeDrift(path, steps, 2)
    true = fly_drifts(gcrf, references, path.step)
    bends = true - linear.paths(states)
    assert true[0, 0, 0] == pytest.approx([0.0, distance, 0.0], abs=1e-6)
    assert least <= np.linalg.norm(bends, axis=3).max() <= most
    linear.bends = bends
    assert linear.closest(states) == pytest.approx(closest_of_paths(true), abs=1e-6)
