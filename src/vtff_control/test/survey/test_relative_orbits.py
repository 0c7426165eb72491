"""Ellipses: what they sample, what they cost, and that they are safe."""

import math

import numpy as np
import pytest

from vtff_control.guidance.requests import RequestError
from vtff_control.survey.goals import SurveyGoal, read_goals
from vtff_control.survey.prediction import PredictedCrossing
from vtff_control.survey.relative_orbits import (
    EllipseLimits,
    RelativeEllipse,
    cheapest_transfer,
    choose_ellipse,
    information,
    is_safe,
)
from vtff_dynamics.frames.rtn import deputy_state_gcrf, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.orbit.mean_elements import osculating_elements, state_from_elements
from vtff_dynamics.relative.relative_elements import relative_state_of_mean_elements

CHIEF = np.array([6.79e6, 0.3, 0.0, 0.0, math.radians(10.0), 1.0])
RATE = math.sqrt(3.986004415e14 / CHIEF[0] ** 3)
LIMITS = EllipseLimits()
CURRENT = RelativeEllipse(300.0, 210.0, 0.0, 2000.0).designs(1)[0]


def crossings(*latitudes_deg):
    return [
        PredictedCrossing(i, i % 2 == 0, "chief", 6000.0 + 100.0 * i, 1.0, 0.0, math.radians(u))
        for i, u in enumerate(latitudes_deg)
    ]


def altitudes(design, latitudes):
    """Return how far a deputy is above the chief at arguments of latitude, by flown orbits, m."""
    chief = state_from_elements(osculating_elements(CHIEF))
    deputy = deputy_state_gcrf(chief, relative_state_of_mean_elements(CHIEF, design))
    times = np.linspace(0.0, 2.0 * math.pi / RATE, 400)
    flown = free_flight(np.array([chief, deputy]), times)
    argument = []
    for state in flown[:, 0]:
        radial, _, normal = rotation_gcrf_to_rtn(state)
        node = np.cross([0.0, 0.0, 1.0], normal)
        node /= np.linalg.norm(node)
        argument.append(math.atan2(radial @ np.cross(normal, node), radial @ node))
    above = np.linalg.norm(flown[:, 1, :3], axis=1) - np.linalg.norm(flown[:, 0, :3], axis=1)
    nearest = [int(np.argmin(np.abs(np.array(argument) - u))) for u in latitudes]
    distance = np.linalg.norm(flown[:, 1, :3] - flown[:, 0, :3], axis=1)
    return above[nearest], distance.min()


def test_chosen_ellipse_has_the_altitude_difference_in_flown_orbits():
    ahead = crossings(20.0, 30.0, 55.0, 65.0)
    goal = SurveyGoal("edge_altitudes", 2000.0)
    ellipse = choose_ellipse(ahead, goal, CURRENT, LIMITS, RATE, 0.5)
    (design,) = ellipse.designs(1)
    assert information(ahead, goal, design) >= 4.0
    above, closest = altitudes(design, [c.mean_latitude for c in ahead])
    assert (np.abs(above) >= 2000.0).all()
    assert closest > LIMITS.separation
    # No larger than the four need: 2.2 km over the cosine of half their spread, and a grid step.
    assert ellipse.size <= 2200.0 / math.cos(math.radians(22.5)) + 300.0


@pytest.mark.parametrize(("worth", "sampled"), [(0.2, 0.0), (1.0, 1.0)])
def test_a_crossing_is_sampled_if_it_is_worth_its_velocity_change(worth, sampled):
    # For the last one, a right angle away, the ellipse has to be 0.9 km larger: 0.5 m/s.
    ahead = crossings(*[25.0] * 8, 115.0)
    goal = SurveyGoal("edge_altitudes", 2000.0)
    ellipse = choose_ellipse(ahead, goal, CURRENT, LIMITS, RATE, worth)
    assert information(ahead, goal, ellipse.designs(1)[0]) == pytest.approx(8.0 + sampled, abs=0.2)


def test_both_walls_count_only_together():
    goal = SurveyGoal("both_walls", 2000.0)
    design = RelativeEllipse(2400.0, 210.0, 0.0, 0.0).designs(1)[0]
    assert information(crossings(0.0, 5.0), goal, design) == pytest.approx(2.0, abs=0.05)
    assert information(crossings(0.0, 60.0), goal, design) < 0.1


def test_profile_wants_many_differences():
    goal = SurveyGoal("profile", 3000.0)
    spread = crossings(*range(0, 180, 12))
    one_place = crossings(*[10.0] * 15)
    design = RelativeEllipse(3000.0, 210.0, 0.0, 0.0).designs(1)[0]
    assert information(spread, goal, design) > 6.0
    assert information(one_place, goal, design) == 1.0


def test_all_pairs_of_three_deputies_are_safe():
    designs = RelativeEllipse(3000.0, 3.2 * LIMITS.separation, 1.0, 2000.0).designs(3)
    assert is_safe(designs, LIMITS.separation)
    assert not is_safe(designs, 1.2 * LIMITS.separation)
    # Perpendicular vectors meet in the radial-normal plane.
    crossed = np.array([0.0, 0.0, 1000.0, 0.0, 0.0, 500.0])
    assert not is_safe([crossed], 10.0)


def test_nothing_beyond_the_budget():
    goal = SurveyGoal("edge_altitudes", 2000.0)
    ahead = crossings(20.0, 30.0)
    assert choose_ellipse(ahead, goal, CURRENT, LIMITS, RATE, 0.5, 1.0, 0.1) is None


def test_transfer_costs_no_less_than_the_bound_and_less_than_twice_it():
    goal = SurveyGoal("edge_altitudes", 2000.0)
    ellipse = choose_ellipse(crossings(20.0, 60.0), goal, CURRENT, LIMITS, RATE, 0.5)
    transfer = cheapest_transfer(ellipse, CURRENT, CHIEF, RATE, 1.05)
    # Half of the mean motion times the change of the eccentricity vector, in-plane.
    change = ellipse.designs(1)[0] - CURRENT
    bound = 0.5 * RATE * math.hypot(change[2], change[3])
    assert bound * 0.99 <= transfer.velocity_change <= 2.0 * bound


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("0", "time and kind expected"),
        ("x edge_altitudes", "time: a number expected, got 'x'"),
        ("-1 profile", "time: 0 s or more"),
        ("0 loop", "kind: one of edge_altitudes, both_walls, profile, default expected"),
        ("0 profile altitude_difference=-1", "more than 0 m expected, got -1"),
        ("0 profile size=3", "'size=3': name=value expected"),
    ],
)
def test_timeline_that_cannot_be_read(line, reason):
    with pytest.raises(RequestError, match=reason):
        read_goals([line])


def test_timeline_is_in_order():
    goals = read_goals(["900 default", "0 both_walls altitude_difference=1500"])
    assert [(timed.time, timed.goal.kind) for timed in goals] == [
        (0.0, "both_walls"),
        (900.0, "default"),
    ]
    assert goals[0].goal.altitude_difference == 1500.0
