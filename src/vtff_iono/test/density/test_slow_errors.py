"""The slow errors of contents, from few samples of them."""

import math

import numpy as np
import pytest

from vtff_iono.density.filter.kernels import scale_of_learned
from vtff_iono.density.filter.slow_errors import SlowErrors, _add_products

SATELLITES, TIME = 9, 100.0


def measured(sigma, seconds, seed):
    """Errors that are correlated over TIME, beside a constant and two other terms in common."""
    generator = np.random.default_rng(seed)
    decay = math.exp(-1.0 / TIME)
    errors = sigma * generator.standard_normal(SATELLITES)
    common = np.column_stack((np.ones(SATELLITES), *generator.uniform(1.0, 5.0, (2, SATELLITES))))
    slow = SlowErrors()
    for second in range(seconds):
        errors = decay * errors
        errors += sigma * math.sqrt(1.0 - decay**2) * generator.standard_normal(SATELLITES)
        slow.add(
            float(second),
            np.arange(SATELLITES),
            5.0 + errors + 0.004 * generator.standard_normal(SATELLITES),
            common,
            np.full(3, np.inf),
            np.full(SATELLITES, 0.004**2),
        )
    return slow


@pytest.mark.parametrize("sigma", [0.01, 0.03, 0.1])
@pytest.mark.parametrize(("seconds", "least"), [(100, 0.65), (300, 0.85)])
def test_the_sigma_contains_that_it_is_known_from_few_samples(sigma, seconds, least):
    """The square of a new error over its sigma is one on the mean, over forty flights."""
    squares = [sigma**2 / measured(sigma, seconds, seed).sigma ** 2 for seed in range(40)]
    assert least < np.mean(squares) < 1.05


def test_a_correlation_time_is_learned():
    times = [measured(0.1, 600, seed).correlation_time for seed in range(20)]
    assert 60.0 < np.median(times) < 140.0


def test_products_are_those_of_residuals_a_lag_before():
    """A ring of epochs that grows, against a list of them; two links have one satellite."""
    generator, slow, epochs = np.random.default_rng(5), SlowErrors(), []
    product = of_product = 0.0
    first = slow.table.values.copy()
    for second in range(60):
        count = 20 if second > 30 else 5
        satellites = np.append(generator.permutation(30)[: count - 1], 7)
        residual = 1e-3 * generator.standard_normal(count)
        fast, trust = np.full(count, 1e-6), generator.random(count)
        slow.reserve(count)
        _add_products(slow.table, 0.5 * second, satellites, residual, fast, trust)
        now = dict(zip(satellites.tolist(), residual.tolist(), strict=True))
        epochs.append(now)
        before = epochs[second - 40] if second >= 40 else {}
        for satellite, weight in zip(satellites.tolist(), trust.tolist(), strict=True):
            if satellite in before:
                product += weight * now[satellite] * before[satellite]
                squares = 0.5 * (now[satellite] ** 2 + before[satellite] ** 2)
                of_product += weight * max(squares - 1e-6, 0.0)
    change = np.nan_to_num(slow.table.values - first)
    places = np.flatnonzero(change)
    np.testing.assert_allclose(np.sort(change[places]), np.sort([product, of_product]), rtol=1e-9)
    assert slow.table.residual.shape[0] > 32 and slow.table.residual.shape[1] >= 20


@pytest.mark.parametrize("ratio", [0.25, 1.0, 9.0])
def test_states_are_known_as_well_as_measurements_tell(ratio):
    """Least squares with another variance; what no measurement told is known as before."""
    first, measured_variance = np.array([4.0, 0.01, 1.0]), np.array([0.01, 0.04, math.inf])
    believed = 1.0 / (1.0 / first + 1.0 / measured_variance)
    expected = 1.0 / (1.0 / first + 1.0 / (ratio * measured_variance))
    scale = scale_of_learned(ratio, believed, first)
    np.testing.assert_allclose(believed * scale**2, expected, rtol=1e-12)
