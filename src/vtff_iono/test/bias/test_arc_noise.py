"""Noise of arcs against dense covariances, and draws of it that are found again."""

import numpy as np
import pytest

from vtff_iono.bias.arc_noise import (
    ArcNoise,
    ArcOrder,
    Whitening,
    _likelihoods,
    estimate_noise,
)

GENERATOR = np.random.default_rng(4)
ARCS, LENGTH, STEP = 20, 60, 20.0


def rows():
    """Numbers of arcs, times and mappings of samples, epoch by epoch."""
    arc = np.tile(np.arange(ARCS), LENGTH)
    time = np.repeat(np.arange(LENGTH), ARCS) * STEP
    mapping = 1.0 + 2.0 * ((time / STEP / LENGTH - 0.5) * (1.0 + arc / ARCS)) ** 2
    # Some samples are missing.
    kept = GENERATOR.random(len(arc)) > 0.1
    return arc[kept], time[kept], mapping[kept]


def covariance(arc, time, mapping, noise, weight):
    """Covariance of all samples, as the model is written down."""
    response = noise.slow * mapping**noise.power
    same = arc[:, None] == arc
    slow = same * np.exp(-np.abs(time[:, None] - time) / noise.time)
    return response[:, None] * slow * response + np.diag(noise.white**2 / weight)


@pytest.mark.parametrize(
    "noise", [ArcNoise(0.02, 0.05, 200.0, 1.0), ArcNoise(0.03, 0.0, 100.0, 0.0)]
)
def test_whitened_products_are_those_with_the_inverse_covariance(noise):
    arc, time, mapping = rows()
    weight = GENERATOR.uniform(0.1, 1.0, len(arc))
    columns = GENERATOR.standard_normal((len(arc), 3))
    found = Whitening.of(ArcOrder.of(arc, time, mapping), noise, weight).whiten(columns)
    matrix = covariance(arc, time, mapping, noise, weight)
    assert found.T @ found == pytest.approx(columns.T @ np.linalg.solve(matrix, columns), rel=1e-9)


def drawn(noise, seed):
    arc, time, mapping = rows()
    matrix = covariance(arc, time, mapping, noise, np.ones(len(arc)))
    value = np.linalg.cholesky(matrix) @ np.random.default_rng(seed).standard_normal(len(arc))
    return value, ArcOrder.of(arc, time, mapping), arc, mapping


@pytest.mark.parametrize(
    "noise", [ArcNoise(0.02, 0.05, 120.0, 1.0), ArcNoise(0.02, 0.04, 60.0, 0.0)]
)
def test_noise_is_found_in_residuals_whose_arcs_were_fitted(noise):
    """Without a level and a part of the content of each arc, which hide what is slow."""
    found = []
    for seed in range(6):
        value, order, arc, mapping = drawn(noise, seed)
        for number in range(ARCS):
            own = arc == number
            basis = np.stack((np.ones(own.sum()), mapping[own]), axis=1)
            value[own] -= basis @ np.linalg.lstsq(basis, value[own])[0]
        found.append(estimate_noise(value, order, np.ones(len(value))))
        near = estimate_noise(value, order, np.ones(len(value)), found[-1])
        assert near == found[-1]
    white, slow, time, power = np.transpose(found)
    assert white.mean() == pytest.approx(noise.white, rel=0.1)
    # What shifts levels is the noise of frequency zero: the variance times the time.
    assert np.mean(slow**2 * time) == pytest.approx(noise.slow**2 * noise.time, rel=0.5)
    assert (power == noise.power).mean() > 0.6


def test_white_noise_is_not_taken_for_slow():
    value, order, _, _ = drawn(ArcNoise(0.03, 0.0, 100.0, 0.0), 1)
    found = estimate_noise(value, order, np.ones(len(value)))
    assert found.white == pytest.approx(0.03, rel=0.05)
    # At frequency zero, which is what shifts levels.
    assert 2.0 * found.slow**2 * found.time < found.white**2 * STEP


def test_an_outlier_of_little_weight_does_not_count():
    value, order, _, _ = drawn(ArcNoise(0.03, 0.0, 100.0, 0.0), 2)
    weight = np.ones(len(value))
    value[::97], weight[::97] = 30.0, 1e-6
    assert estimate_noise(value, order, weight).white == pytest.approx(0.03, rel=0.1)


def test_likelihood_is_the_restricted_one_of_the_dense_covariance():
    """Patterson and Thompson: without what a constant and the mapping of each arc explain."""
    arc, time, mapping = rows()
    order = ArcOrder.of(arc, time, mapping)
    residual, weight = GENERATOR.standard_normal(len(arc)), GENERATOR.uniform(0.1, 1.0, len(arc))
    found = []
    for slow, seconds in ((0.5, 60.0), (4.0, 480.0)):
        noise = ArcNoise(1.0, slow, seconds, 1.0)
        # Another ratio beside it changes nothing.
        logarithm, white = _likelihoods(
            residual[order.rows],
            order.mapping,
            order.mapping,
            np.array([0.1, slow]),
            np.exp(-order.step / seconds),
            1.0 / weight[order.rows],
        )[:, 1]
        matrix = covariance(arc, time, mapping, noise, weight)
        is_arc = arc[:, None] == np.arange(ARCS)
        basis = np.hstack((is_arc, is_arc * mapping[:, None]))
        inverse = np.linalg.inv(matrix)
        of_basis = basis.T @ inverse @ basis
        fitted = np.linalg.solve(of_basis, basis.T @ inverse @ residual)
        degrees = len(arc) - 2 * ARCS
        expected = residual @ inverse @ (residual - basis @ fitted) / degrees
        assert white == pytest.approx(expected, rel=1e-9)
        determinants = np.linalg.slogdet(matrix)[1] + np.linalg.slogdet(of_basis)[1]
        found.append((logarithm, -0.5 * (determinants + degrees * np.log(expected))))
    for logarithm, expected in found:
        assert logarithm == pytest.approx(expected, rel=1e-9)
