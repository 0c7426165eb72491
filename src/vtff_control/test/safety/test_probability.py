"""Probabilities of coming too near, against Monte Carlo."""

import numpy as np
import pytest

from vtff_control.safety.probability import (
    encounter_probability,
    instantaneous_probability,
    sigma_bound_probability,
)

SAMPLES = 400_000


def covariance(seed, sizes):
    axes = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
    return axes @ np.diag(np.square(sizes)) @ axes.T


@pytest.mark.parametrize(
    ("position", "sizes", "radius"),
    [
        ((20.0, -10.0, 5.0), (5.0, 8.0, 12.0), 10.0),
        ((0.0, 0.0, 0.0), (3.0, 0.5, 20.0), 10.0),
        ((9.9, 0.0, 0.0), (0.01, 0.02, 0.01), 10.0),  # far sharper than the sphere
        ((50.0, 40.0, -30.0), (100.0, 3.0, 60.0), 30.0),
        ((2.0, 1.0, 0.0), (300.0, 200.0, 100.0), 30.0),  # far wider
    ],
)
def test_instantaneous_probability(position, sizes, radius):
    matrix = covariance(3, sizes)
    drawn = np.random.default_rng(5).multivariate_normal(position, matrix, SAMPLES)
    share = np.mean(np.linalg.norm(drawn, axis=1) < radius)
    error = 4.0 * np.sqrt(max(share * (1.0 - share), 1.0 / SAMPLES) / SAMPLES)
    assert instantaneous_probability(position, matrix, radius) == pytest.approx(share, abs=error)


@pytest.mark.parametrize(
    ("position", "sizes"),
    [((25.0, 0.0, 10.0), (9.0, 4.0, 30.0)), ((0.0, 3.0, 0.0), (9.0, 9.0, 2.0))],
)
def test_encounter_probability(position, sizes):
    velocity = np.cross(position, [0.3, -0.2, 0.9])
    velocity *= 14.0 / np.linalg.norm(velocity)
    matrix = covariance(7, sizes)
    drawn = np.random.default_rng(6).multivariate_normal(position, matrix, SAMPLES)
    # The closest point of the straight fly-by of every sample.
    along = drawn @ velocity / (velocity @ velocity)
    closest = np.linalg.norm(drawn - along[:, np.newaxis] * velocity, axis=1)
    share = np.mean(closest < 20.0)
    error = 4.0 * np.sqrt(share * (1.0 - share) / SAMPLES)
    assert encounter_probability(position, velocity, matrix, 20.0) == pytest.approx(
        share, abs=error
    )


def test_a_fly_by_without_velocity_is_refused():
    with pytest.raises(ValueError, match="velocity"):
        encounter_probability([1.0, 0.0, 0.0], np.zeros(3), np.eye(3), 1.0)


def test_bound_of_a_plane():
    assert sigma_bound_probability(0.0) == 0.5
    assert sigma_bound_probability(3.719) == pytest.approx(1e-4, rel=1e-2)
