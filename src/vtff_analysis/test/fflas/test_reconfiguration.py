"""Paper 002's reconfiguration: the plan within its bounds, and flown again in nonlinear motion."""

import numpy as np
import pytest

from vtff_analysis.fflas.reconfiguration import (
    FFLAS_MASS,
    FFLAS_PERIOD,
    FFLAS_THRUST,
    ORBITS,
    STEPS,
    fly_reconfiguration,
    formation_states,
    reconfiguration_planner,
    triangle_states,
)
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.relative.separation import closest_on_path

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
    # Losses in the middle of steps, by the motion itself: safe, too, but for steps that are told.
    during = plan.closest_drifts_during[plan.safe_step :]
    assert (during < 9.9).sum() <= 2
    flight = flown.flight
    middles = plan.step * (np.arange(plan.safe_step, STEPS) + 0.5)
    indices = np.searchsorted(flight.times, middles - 1e-6)
    np.testing.assert_allclose(flight.times[indices], middles, atol=1e-6)
    starts = flight.states_gcrf[indices, 1:].reshape(-1, 6)
    drifts = free_flight(starts, np.arange(0.0, FFLAS_PERIOD, 10.0))[..., :3]
    drifts = drifts.reshape(-1, len(indices), 3, 3)
    for index, told in enumerate(during):
        lost = min(
            closest_on_path(drifts[:, index, second] - drifts[:, index, first])
            for first, second in ((0, 1), (0, 2), (1, 2))
        )
        assert lost >= min(9.9, told - 0.3)
    assert flown.closest_approach >= 10.0
