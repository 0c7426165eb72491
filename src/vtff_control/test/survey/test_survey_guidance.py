"""Decisions of a survey: it learns, plans once and drifts; not without support or navigation."""

import math

import numpy as np
import pytest

from vtff_control.guidance.interface import FormationState
from vtff_control.guidance.requests import ModeRequest, ReconfigurationRequest
from vtff_control.survey.goals import SurveyGoal
from vtff_control.survey.relative_orbits import RelativeEllipse, is_safe
from vtff_control.survey.survey_guidance import SurveyGuidance
from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf
from vtff_dynamics.frames.rtn import deputy_state_gcrf, relative_state_rtn
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.orbit.mean_elements import osculating_elements, state_from_elements
from vtff_dynamics.relative.relative_elements import relative_state_of_mean_elements
from vtff_dynamics.time.timescales import GpsTime, parse_epoch

CHIEF_MEAN = np.array([6.79e6, 0.3, 0.0, 0.0, math.radians(10.0), 1.0])
START = parse_epoch("2016-03-21T01:00:00 GPS").to_unix_nanoseconds()
STEP = 30.0
AZIMUTHS = {(0, 1): 0.7, (0, 2): 2.0, (0, 3): 4.0, (0, 4): 5.0}
BEHIND = [(0, 3), (0, 4)]
AHEAD = [(0, 1), (0, 2)]


class Survey:
    """A survey on a free flight: walls are where the chief is at given times; nobody thrusts."""

    def __init__(self, walls=(), **parameters):
        self.guidance = SurveyGuidance("chief", ("deputy",), **parameters)
        self.guidance.goal = SurveyGoal()
        chief = state_from_elements(osculating_elements(CHIEF_MEAN))
        design = RelativeEllipse(300.0, 210.0, 0.0, 2000.0).designs(1)[0]
        deputy = deputy_state_gcrf(chief, relative_state_of_mean_elements(CHIEF_MEAN, design))
        self.times = np.arange(0.0, 9000.0, STEP)
        self.states = free_flight(np.array([chief, deputy]), self.times)
        self.walls_of = {"chief": walls, "deputy": walls}
        self.sigma = 1e-3
        self.mode = "free_drift"
        self.asked = []
        self.phases = []

    def fly(self, until, refused=""):
        for index, time in enumerate(self.times.tolist()):
            if len(self.phases) > index or time > until:
                continue
            stamp = START + round(time * 1e9)
            chief, deputy = self.states[index]
            state = FormationState(
                stamp,
                chief,
                {"deputy": relative_state_rtn(chief, deputy)},
                {"deputy": self.sigma**2 * np.eye(6)},
            )
            self._tell(time)
            result = self.guidance.step(stamp, state, self.mode)
            self.phases.append(result.phase)
            if result.request is not None:
                self.asked.append(result.request)
                if refused:
                    self.guidance.refused(refused)
                elif isinstance(result.request, ModeRequest):
                    self.mode = "free_drift"
                else:
                    self.mode = "reconfigure"
        return self

    def _tell(self, now):
        for name, walls in self.walls_of.items():
            s4 = {ray: 0.6 if _is_inside(ray, now, walls) else 0.03 for ray in AZIMUTHS}
            self.guidance.add_scintillation(START + round(now * 1e9), STEP, name, AZIMUTHS, s4)
            for begin, end in walls:
                for time, rays, is_entry in ((begin, BEHIND, True), (end, AHEAD, False)):
                    if now - STEP < time <= now:
                        for ray in rays:
                            stamp = START + round(time * 1e9)
                            self.guidance.add_edge(stamp, 1.0, name, ray, is_entry)


def _is_inside(ray, now, walls):
    """Rays ahead look into a bubble a minute before it is entered, rays behind a minute longer."""
    before, after = (60.0, 0.0) if ray in AHEAD else (0.0, 60.0)
    return any(begin - before < now <= end + after for begin, end in walls)


BUBBLES = ((1005.0, 1095.0), (1305.0, 1425.0), (1635.0, 1725.0))


def test_plans_once_the_walls_of_a_pass_are_known_and_drifts_after_the_arrival():
    survey = Survey(BUBBLES).fly(3000.0)
    (request,) = survey.asked
    assert isinstance(request, ReconfigurationRequest)
    assert is_safe([request.designs["deputy"]], 200.0)
    assert not request.designs["chief"].any()
    assert len(survey.guidance.estimate.walls) == 6
    (plan,) = survey.guidance.plans
    assert plan.gain > plan.gain_before + plan.velocity_change / 0.5
    assert plan.time > 1725.0
    # The crossings to come, by the flown orbit and the drift of the prior: within its sigma.
    coming = [c for c in survey.guidance.predictions if c.spacecraft == "chief"]
    assert len(coming) >= 12
    moment = GpsTime.from_unix_nanoseconds(START)
    first = coming[0]
    times = np.append(np.arange(0.0, first.time, 15.0), first.time)
    flown = free_flight(survey.states[0, :1], times)[:, 0, :3]
    longitudes = []
    for index in (67, -1):  # 1005 s, and then
        position = rotation_gcrf_to_itrf(moment + float(times[index])) @ flown[index]
        longitudes.append(math.atan2(position[1], position[0]))
    moved = longitudes[1] - longitudes[0]
    drifted = 75.0 * (first.time - 1005.0) / 6.75e6
    assert abs(moved - drifted) * 6.75e6 < 20e3
    survey.mode = "keep"
    survey.fly(3100.0)
    assert survey.asked[1:] == [ModeRequest("free_drift")]
    assert survey.phases[-1] == "survey"
    assert math.isfinite(survey.guidance.arrived)


def test_nothing_is_planned_without_walls():
    survey = Survey().fly(6000.0)
    assert survey.asked == []
    assert set(survey.phases) == {"default"}


def test_no_goal_no_manoeuvre():
    survey = Survey(BUBBLES)
    survey.guidance.goal = None
    survey.fly(4000.0)
    assert survey.asked == []


def test_false_edges_are_left_out():
    survey = Survey()
    for time in (500.0, 1500.0):
        survey.fly(time)
        for name in ("chief", "deputy"):
            for ray in BEHIND:
                survey.guidance.add_edge(START + round(time * 1e9), 0.5, name, ray, True)
    survey.fly(6000.0)
    assert survey.asked == []
    assert len(survey.guidance.crossings) == 4
    assert "4 unsupported crossings left out" in survey.guidance.reason


def test_degraded_navigation_ends_in_a_drift():
    survey = Survey(BUBBLES).fly(2500.0)
    assert survey.phases[-1] == "transfer"
    survey.sigma = 50.0
    survey.fly(2700.0)
    assert survey.asked[1:] == [ModeRequest("free_drift")]
    assert survey.phases[-1] == "degraded"
    # With navigation again, it plans again from where it is.
    survey.sigma = 1e-3
    survey.fly(3000.0)
    assert isinstance(survey.asked[-1], ReconfigurationRequest)
    assert len(survey.guidance.plans) == 2


def test_crossings_that_no_navigation_has_seen_are_nowhere():
    whole = Survey(BUBBLES).fly(2300.0)
    survey = Survey(BUBBLES).fly(1200.0)
    survey.sigma = 50.0
    survey.fly(1500.0)
    assert survey.phases[-1] == "degraded"
    survey.sigma = 1e-3
    survey.fly(2300.0)
    walls = [whole.guidance.estimate.walls[index] for index in (0, 1, 4, 5)]
    for wall, known in zip(survey.guidance.estimate.walls, walls, strict=True):
        assert wall.longitude == pytest.approx(known.longitude, abs=1e-6)


def test_predictions_name_the_wall_and_go_on_in_a_transfer():
    survey = Survey(BUBBLES)
    # Walls that one spacecraft alone has told come first and are not predicted.
    survey.walls_of["chief"] = ((645.0, 705.0), *BUBBLES)
    survey.fly(3000.0)
    walls, predictions = survey.guidance.estimate.walls, survey.guidance.predictions
    assert survey.phases[-1] == "transfer"
    assert [len(wall.spacecraft) for wall in walls] == [1, 1] + [2] * 6
    assert {prediction.wall for prediction in predictions} == {2, 3, 4, 5, 6, 7}
    assert all(p.is_entry == walls[p.wall].is_entry for p in predictions)
    assert predictions[0].time > 3000.0


def test_a_refused_request_is_no_plan():
    survey = Survey(BUBBLES).fly(2700.0, refused="impossible")
    assert len(survey.asked) == 1
    assert survey.guidance.plans == []
    assert survey.guidance.reason == "refused: impossible"
    survey.fly(3200.0, refused="impossible")
    assert len(survey.asked) == 2
    assert not math.isfinite(survey.guidance.arrived)


@pytest.mark.parametrize("kind", ["both_walls", "profile"])
def test_other_goals_are_planned(kind):
    survey = Survey(BUBBLES)
    survey.guidance.goal = SurveyGoal(kind, 2000.0)
    survey.fly(3000.0)
    assert len(survey.asked) == 1


def test_reset_forgets():
    survey = Survey(BUBBLES).fly(3000.0)
    survey.guidance.reset()
    assert survey.guidance.plans == []
    assert survey.guidance.estimate.walls == []
    assert math.isnan(survey.guidance.seconds(START))
