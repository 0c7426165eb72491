"""The orbit raising of the paper: what is not fitted, and the laws behind it."""

from __future__ import annotations

import numpy as np
import pytest

from vtff_analysis.attitude.orbit_raising import fly_orbit_raising


@pytest.fixture(scope="module")
def campaign():
    return fly_orbit_raising()


def test_figures_that_are_not_fitted_are_those_of_the_paper(campaign):
    assert campaign.peak_deg == pytest.approx(124.0, rel=0.2)
    assert campaign.peak_day == pytest.approx(75.0, abs=3.0)  # 11 September
    assert campaign.raised_day == pytest.approx(83.0, abs=5.0)  # 19 September
    assert campaign.perigee_period == pytest.approx(115.0, rel=0.03)


def test_fitted_numbers_are_those_of_a_small_satellite(campaign):
    """Some metres a day; a raise in October below that of firings of full strength, 1.4 km."""
    assert 2.0 < campaign.decay_difference < 20.0
    assert 0.0 < campaign.last_firings < 1400.0
    late = campaign.days > 250.0
    assert np.all(np.diff(campaign.axis_difference[late]) < 0.0)


def test_separation_is_the_integral_of_the_drift(campaign):
    """Kepler's third law by itself; J2 changes the drift by less than 1 %."""
    motion = np.sqrt(3.986004418e14 / 7.082e6**3)
    drift = -1.5 * motion / 7.082e6 * campaign.axis_difference * 8640.0
    expected = np.degrees(np.concatenate(([0.0], np.cumsum(0.5 * (drift[1:] + drift[:-1])))))
    np.testing.assert_allclose(campaign.separation_deg, expected, rtol=0.01, atol=2.5)


def test_eccentricity_swings_with_the_perigee(campaign):
    """Between firings the vector turns about the point of J3, a turn in its period."""
    free = campaign.days < 60.0
    assert 1e-4 < np.ptp(campaign.eccentricity[free])
    assert campaign.eccentricity.max() < 4e-3
