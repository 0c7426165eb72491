"""Noise of contents about an edge, against covariances that are written out."""

import numpy as np
import pytest

from vtff_iono.edges.content_noise import (
    MOST_MODES,
    mode_variances,
    side_sigmas,
    slow_basis,
    white_sigma,
)

RATE = 10
HALF_WINDOW = 50.0
TIME = np.arange(-50 * RATE, 50 * RATE + 1) / RATE
# Long arcs, and in the middle of the window a short one.
ARCS = np.digitize(TIME, [-12.0, -9.0, 20.0])


@pytest.mark.parametrize("ratio", [1.0, 4.0])
def test_whitened_products_are_those_of_the_inverse_covariance(ratio):
    relative = np.where(TIME < 5.0, ratio, 1.0)
    basis = slow_basis(TIME, HALF_WINDOW, ARCS).with_noise(np.array([relative, 1.0 / relative]))
    generator = np.random.default_rng(0)
    rows, others = generator.standard_normal((2, 2, len(TIME)))
    sigma = np.array([0.3, 0.05])
    variances = 2.0 ** -np.arange(2.0 * MOST_MODES).reshape(2, MOST_MODES)
    for column in range(2):
        # What is unknown has a variance that is beyond all others.
        of_columns = np.full(basis.columns.shape[2], 1e8)
        modes = len(of_columns) - basis.unknown
        of_columns[basis.unknown :] = variances[column, :modes]
        covariance = sigma[column] ** 2 * np.eye(len(TIME))
        covariance += (basis.columns[column] * of_columns) @ basis.columns[column].T
        covariance *= np.outer(basis.relative[column], basis.relative[column])
        expected = rows[column] @ np.linalg.solve(covariance, others[column])
        first, second = (
            basis.whitening(sigma, variances).apply(each)[column] for each in (rows, others)
        )
        assert first @ second == pytest.approx(expected, rel=1e-4)


def test_arcs_and_a_parabola_are_unknown_and_more_degrees_belong_to_longer_windows():
    basis = slow_basis(TIME, HALF_WINDOW, ARCS)
    assert basis.functions.T @ basis.functions == pytest.approx(
        np.eye(basis.functions.shape[1]), abs=1e-9
    )
    content = np.array([3.0, -1.0, 7.0, 2.0])[ARCS] + 0.1 * TIME - 0.02 * TIME**2
    unknown = basis.unknown_columns[0]
    left = content - unknown @ (unknown.T @ content)
    assert np.abs(left).max() < 1e-9
    short = slow_basis(TIME[400:601], 10.0, np.zeros(201, dtype=np.int64))
    assert short.functions.shape[1] == short.unknown
    assert np.isnan(short.modes(np.zeros((2, 201)))).all()


@pytest.mark.parametrize("arcs", [1, 24])
def test_white_noise_is_told_beside_many_short_arcs(arcs):
    arc = (np.arange(len(TIME)) * arcs) // len(TIME)
    basis = slow_basis(TIME, HALF_WINDOW, arc)
    generator = np.random.default_rng(1)
    variances = [
        white_sigma(
            basis.remove(0.2 * generator.standard_normal((2, len(TIME)))), (40,), basis.columns
        )
        ** 2
        for _ in range(100)
    ]
    # The largest of two estimates is a little too large.
    assert 0.9 < np.sqrt(np.mean(variances)) / 0.2 < 1.35


def test_noise_of_one_side_is_told_where_it_breaks_arcs():
    """Taken together it hides: constants of short arcs take the noise of that side away."""
    generator = np.random.default_rng(4)
    inside = (TIME > 0.0).astype(float)
    arc = np.where(TIME > 0.0, 1 + (TIME // 6.0).astype(int), 0)
    basis = slow_basis(TIME, HALF_WINDOW, arc)
    # Noise that is known to be uneven is told as it is: before, polynomials carry it to both sides.
    for relative, accuracy in ((np.ones(len(TIME)), 0.4), (0.2 + 0.8 * inside, 0.2)):
        basis = basis.with_noise(np.tile(relative, (2, 1)))
        rows = [
            basis.remove((0.05 + 0.25 * inside) * generator.standard_normal((2, len(TIME))))
            for _ in range(8)
        ]
        outer, inner = side_sigmas(rows, [basis] * 8, 40, [inside] * 8)
        assert outer == pytest.approx(0.05, rel=accuracy)
        assert inner == pytest.approx(0.3, rel=accuracy)
    nothing = side_sigmas(rows[:1], [basis], 4000, [inside])
    assert (nothing == 1.0).all()


@pytest.mark.parametrize("power", [2.0, 8.0])
def test_variances_are_those_of_drawn_coefficients(power):
    generator = np.random.default_rng(2)
    degree = np.arange(MOST_MODES) + 3.0
    true = 0.4 * (3.0 / degree) ** power
    sigma = np.full((9, 2), 0.1)
    logarithms = []
    for _ in range(40):
        scatter = np.sqrt(true + sigma[:, :, np.newaxis] ** 2)
        found = mode_variances(scatter * generator.standard_normal((9, 2, MOST_MODES)), sigma)
        logarithms.append(np.log((found[..., 0] + 0.01) / (true[0] + 0.01)))
    assert abs(np.mean(logarithms)) < 0.3
    nothing = mode_variances(0.1 * generator.standard_normal((9, 2, MOST_MODES)), sigma)
    assert np.median(nothing) < 0.01


def test_a_satellite_that_scatters_more_has_larger_variances():
    generator = np.random.default_rng(3)
    coefficients = 0.1 * generator.standard_normal((9, 2, MOST_MODES))
    coefficients[4] *= 6.0
    coefficients[:, :, 5:] = np.nan
    found = mode_variances(coefficients, np.full((9, 2), 0.1))
    assert (found[4, :, 0] > 4.0 * np.delete(found, 4, axis=0)[:, :, 0].max(axis=0)).all()
