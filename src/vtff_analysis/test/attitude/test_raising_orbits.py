"""Orbits of the raising campaign from GPS fixes, against the truth that they were drawn from."""

from __future__ import annotations

import numpy as np
import pytest

from vtff_analysis.attitude.orbit_raising import fly_orbit_raising
from vtff_analysis.attitude.raising_orbits import determine_raising_orbits


@pytest.fixture(scope="module")
def orbits():
    """Five arcs: two of them before the first firing."""
    return determine_raising_orbits(fly_orbit_raising(), every=60, seed=4)


def test_errors_are_those_of_the_covariance(orbits):
    inverse = np.linalg.inv(orbits.covariances)
    squares = np.einsum("ni,nij,nj->n", orbits.errors, inverse, orbits.errors) / 6.0
    assert 0.5 < squares.mean() < 1.8
    assert np.abs(orbits.errors[:, 0]).max() < 1.0  # m, where fixes err by 6


def test_the_history_is_that_of_the_campaign(orbits):
    campaign = fly_orbit_raising()
    rows = np.searchsorted(campaign.days, orbits.days)
    axes = campaign.elements_mean[rows, 0]
    np.testing.assert_allclose(orbits.elements_mean[:, 0], axes, atol=2.0)
    np.testing.assert_allclose(orbits.eccentricity, campaign.eccentricity[rows], atol=1e-6)


def test_decay_before_the_firings_is_found(orbits):
    decay, sigma = orbits.decay()
    assert orbits.before_firings.tolist() == [True] * 2 + [False] * 3
    assert decay == pytest.approx(fly_orbit_raising().decay_difference, abs=1.0)
    assert 0.0 < sigma < 0.1
