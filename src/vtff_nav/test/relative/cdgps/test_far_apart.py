"""Spacecraft so far apart that an error of the chief's orbit is one of their difference too."""

from __future__ import annotations

import numpy as np
import pytest
from cdgps_test_support import CHIEF, configuration, fly, simulate

from vtff_nav.relative.cdgps import estimator as estimator_module
from vtff_nav.relative.cdgps.estimator import CdgpsEstimator
from vtff_nav.relative.common.solution import SOLUTION_FIXED
from vtff_sim_bridge.truth.scenario import state_ahead_on_orbit

DISTANCE = 600e3  # m: what 10 cm of the chief do to a difference is 3 mm
SECONDS, FIRST = 25, 5
SEEDS = (1, 2, 3)


@pytest.fixture(scope="module")
def scenarios():
    deputy = state_ahead_on_orbit(CHIEF, DISTANCE)
    return [simulate(SECONDS, deputy, seed) for seed in SEEDS]


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
