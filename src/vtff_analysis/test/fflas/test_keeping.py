"""Keeping of the formations of paper 002, on truth and on drawn navigation."""

import pytest

from vtff_analysis.closed_loop.drawn_navigation import NavigationErrorModel
from vtff_analysis.fflas.keeping import keep_formation
from vtff_analysis.fflas.reconfiguration import FFLAS_PERIOD

LIMITS = {"pco": 25.5, "helix": 12.0}


def check(flight):
    assert flight.velocity_change_per_day.max() <= 0.010
    assert flight.rms.max() <= 0.05
    assert flight.closest_pair >= LIMITS[flight.formation]
    if flight.formation == "helix":
        assert flight.closest_pair_radial_normal >= 12.0


def test_an_orbit_and_a_half_on_truth():
    check(keep_formation("pco", 2.5 * FFLAS_PERIOD))


@pytest.mark.slow
def test_a_day_on_truth():
    flights = [keep_formation(formation) for formation in LIMITS]
    costs = []
    for flight in flights:
        check(flight)
        costs.append(flight.velocity_change_per_day.sum())
    assert costs[1] == pytest.approx(costs[0], rel=0.2)


@pytest.mark.slow
def test_three_hours_on_drawn_navigation():
    for seed in (31, 32):
        errors = NavigationErrorModel(1e-3, 1e-5, 100.0, seed=seed)
        flight = keep_formation("pco", 10800.0 + FFLAS_PERIOD, navigation=errors)
        assert flight.velocity_change_per_day.max() <= 0.012
        assert flight.rms.max() <= 0.06
        assert flight.closest_pair >= 20.0
