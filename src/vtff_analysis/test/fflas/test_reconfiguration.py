"""Paper 002's reconfiguration: the plan within its bounds, and flown again in nonlinear motion."""

import numpy as np
import pytest

from vtff_analysis.fflas.reconfiguration import (
    FFLAS_MASS,
    FFLAS_PERIOD,
    FFLAS_THRUST,
    ORBITS,
    fly_reconfiguration,
    formation_states,
    reconfiguration_planner,
    triangle_states,
)

FINAL = formation_states("pco", ORBITS * FFLAS_PERIOD)


@pytest.mark.parametrize(
    ("objective", "axes", "each", "total"),
    [
        ("norms", "RTN", 2.0, (5.0, 5.4)),
        ("axes", "RTN", 2.5, (0, 6.3)),
        ("axes", "TN", 3.1, (0, 7.9)),
    ],
)
def test_velocity_changes_and_closest_approach(objective, axes, each, total):
    plan = reconfiguration_planner(objective, axes).plan(triangle_states(), FINAL)
    flown = fly_reconfiguration(plan, FINAL)
    changes = plan.velocity_changes if objective == "norms" else plan.velocity_changes_axes.sum(1)
    assert 100.0 * changes.max() <= each
    assert total[0] <= 100.0 * changes.sum() <= total[1]
    assert np.abs(plan.accelerations).max() <= FFLAS_THRUST / FFLAS_MASS * (1.0 + 1e-9)
    assert plan.closest_approach >= 10.0
    assert flown.closest_approach >= 10.0
    assert flown.closest_approach == pytest.approx(plan.closest_approach, abs=2e-3)
    assert flown.arrival_error < 2e-3


def test_passive_safety_in_nonlinear_motion():
    plan = reconfiguration_planner(drift_orbits=1.0).plan(triangle_states(), FINAL)
    flown = fly_reconfiguration(plan, FINAL)
    assert plan.safe_step == 2
    own_drift = flown.closest_drifts[0]
    assert own_drift == pytest.approx(6.24, abs=0.05)
    assert flown.closest_drifts.min() >= own_drift - 1e-3
    assert flown.closest_drifts[plan.safe_step :].min() >= 10.0
    assert flown.closest_approach >= 10.0
