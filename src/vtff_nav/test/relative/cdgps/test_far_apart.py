"""Spacecraft so far apart that an error of the chief's orbit is one of their difference too."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from cdgps_test_support import CHIEF, configuration, fly, simulate

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_nav.relative.cdgps import estimator as estimator_module
from vtff_nav.relative.cdgps.estimator import CdgpsEstimator
from vtff_nav.relative.cdgps.filter import RelativeFilter
from vtff_nav.relative.common.solution import SOLUTION_FIXED
from vtff_sim_bridge.truth.scenario import state_ahead_on_orbit

DISTANCE = 600e3  # m: what 10 cm of the chief do to a difference is 3 mm
SECONDS, FIRST = 25, 5
SEEDS = (1, 2, 3)
DEPUTY = state_ahead_on_orbit(CHIEF, DISTANCE)


@pytest.fixture(scope="module")
def scenarios():
    return [simulate(SECONDS, DEPUTY, seed) for seed in SEEDS]


def never_joint(monkeypatch):
    monkeypatch.setattr(estimator_module, "_JOINT_DISTANCE", np.inf)


def mean_nees(flights):
    """Return the mean of e' P^-1 e of the relative position over its degrees of freedom."""
    return np.mean([flight.normalised_squares()[FIRST:] / 3.0 for flight in flights])


def chief_rms(flights):
    """Return the 3-D RMS of the error of the chief's position, m."""
    errors = np.concatenate([flight.error_chief[FIRST:] for flight in flights])
    return np.sqrt(np.mean(np.sum(errors**2, axis=1)))


def test_both_orbits_are_estimated_together(scenarios, monkeypatch):
    """The covariance is honest, and the integers of the difference tell of the chief, too."""
    together = [fly(scenario, configuration()) for scenario in scenarios]
    never_joint(monkeypatch)
    apart = [fly(scenario, configuration()) for scenario in scenarios]
    assert 0.5 < mean_nees(together) < 1.5 < mean_nees(apart)
    assert chief_rms(together) < 0.7 * chief_rms(apart)
    assert all(flight.is_fixed[FIRST:].all() for flight in together)


@pytest.mark.parametrize("change", ["near again", "difference lost"])
def test_the_orbit_of_the_chief_outlives_the_difference(scenarios, monkeypatch, change):
    scenario = scenarios[0]
    estimator = CdgpsEstimator(configuration(longest_prediction=3.0), scenario.ephemerides)
    errors = []
    for second in range(SECONDS):
        time = scenario.start + float(second)
        deputy = scenario.deputy.get(time)
        if second == 10 and change == "near again":
            never_joint(monkeypatch)
        if 10 <= second < 15 and change == "difference lost":
            deputy = None
        solution = estimator.process(time, scenario.chief.get(time), deputy)
        errors.append(solution.position_chief_gcrf - scenario.chief_gcrf[second][:3])
    assert solution.solution == SOLUTION_FIXED
    assert np.linalg.norm(errors[-1]) < 1.0


def misplaced(scenario, sigma):
    """Return a scenario whose messages have wrong places along the orbits and wrong clocks, m."""
    random = np.random.default_rng(7)
    errors: dict[tuple[int, int], np.ndarray] = {}
    moved = []
    for ephemeris in scenario.ephemerides:
        satellite = (ephemeris.system, ephemeris.prn)
        along, clock = errors.setdefault(satellite, sigma * random.standard_normal(2))
        changes = {
            "mean_anomaly": ephemeris.mean_anomaly + along / ephemeris.semi_major_axis,
            "af0": ephemeris.af0 + clock / SPEED_OF_LIGHT,
        }
        moved.append(dataclasses.replace(ephemeris, **changes))
    return dataclasses.replace(scenario, ephemerides=moved)


def sigmas(flight):
    """Return the stated 3-D sigma of the relative position of each epoch, m."""
    return np.array([np.sqrt(np.trace(s.covariance_position_itrf)) for s in flight.solutions])


def test_phases_of_both_tell_whether_satellites_are_where_they_say(scenarios):
    """Exact messages are believed within 20 s, and those that are 2 m wrong are not."""
    exact = [fly(scenario, configuration()) for scenario in scenarios]
    wrong = [fly(misplaced(scenario, 2.0), configuration()) for scenario in scenarios]
    print("sigmas", [sigmas(flight)[-1] for flight in (*exact, *wrong)], mean_nees(wrong))
    assert max(sigmas(flight)[20] for flight in exact) < 0.02
    assert min(sigmas(flight)[20:].min() for flight in wrong) > 0.03
    assert 0.3 < mean_nees(wrong) < 2.0


def test_offsets_that_are_not_there_leave_what_phases_told():
    """As if the filter had never had them: the motion is known as with exact satellites."""
    motion = np.concatenate((DEPUTY - CHIEF, np.zeros(3)))
    relative = RelativeFilter(configuration(), motion, np.eye(9), 0.0)
    satellite, distance = (0, 5), 2e7
    relative.expect_satellite_offsets(2.0, {satellite}, distance)
    state = relative.state
    design = np.zeros((1, len(state)))
    design[0, 0], design[0, state.index(("satellite_offset", satellite))] = 1.0, DISTANCE / distance
    empty = np.zeros((1, 0))
    state.update(state.innovation(design, np.array([0.5]), np.array([1e-6]), empty))
    assert state.sigma(("motion", 0)) == pytest.approx(2.0 * DISTANCE / distance, rel=0.01)
    relative.expect_satellite_offsets(0.0, {satellite}, distance)
    assert ("satellite_offset", satellite) not in state
    assert state.sigma(("motion", 0)) < 1.5e-3


def test_offsets_stand_in_the_order_of_satellites():
    """Sums over the state then have the same bits, whatever was in view before."""
    motion = np.concatenate((DEPUTY - CHIEF, np.zeros(3)))
    relative = RelativeFilter(configuration(), motion, np.eye(9), 0.0)
    satellites = [(0, prn) for prn in range(1, 33)]
    relative.expect_satellite_offsets(2.0, set(reversed(satellites)), 2e7)
    assert [satellite for _, satellite in relative.state.labels_of("satellite_offset")] == (
        satellites
    )
