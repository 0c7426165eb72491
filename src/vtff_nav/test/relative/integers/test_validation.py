"""Ratio test with a fixed failure rate and partial resolution, against simulation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vtff_nav.relative.integers.validation import FixStatus, partial_fix, ratio_threshold


def model_covariance(
    generator: np.random.Generator, satellites: int, phase_sigma: float, code_sigma: float
) -> np.ndarray:
    """Return the covariance of single-epoch L1 double-differenced ambiguities, cycles^2."""
    azimuth = generator.uniform(0.0, 2.0 * np.pi, satellites)
    elevation = np.arcsin(generator.uniform(0.1, 1.0, satellites))
    directions = np.column_stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    difference = np.hstack([-np.ones((satellites - 1, 1)), np.eye(satellites - 1)])
    weight = np.linalg.inv(2.0 * difference @ difference.T)
    design = difference @ directions
    position = np.linalg.inv(design.T @ weight @ design / code_sigma**2)
    covariance = design @ position @ design.T + 2.0 * phase_sigma**2 * difference @ difference.T
    return covariance / 0.1902936728**2


@pytest.mark.parametrize("n", [1, 2, 6, 12, 30, 66, 80])
@pytest.mark.parametrize("failure_rate", [0.001, 0.01])
def test_threshold_is_one_for_strong_models_and_infinite_for_weak_ones(n, failure_rate):
    assert ratio_threshold(0.9 * failure_rate, n, failure_rate) == 1.0
    assert ratio_threshold(0.21, n, failure_rate) == np.inf
    assert ratio_threshold(float("nan"), n, failure_rate) == np.inf
    rates = np.linspace(failure_rate, 0.2, 30)
    thresholds = [ratio_threshold(rate, n, failure_rate) for rate in rates]
    assert thresholds == sorted(thresholds)
    assert min(thresholds) >= 1.0


def test_threshold_of_a_published_row():
    # Hou et al. (2016), supplement: n = 12, failure rate 0.001, and one of 0.05 without test.
    assert ratio_threshold(0.05, 12) == pytest.approx(1.0 / (0.0636 * 0.05**-0.3737 + 0.2505))


def test_parameters_without_a_table_are_errors():
    with pytest.raises(ValueError, match="failure_rate: 0.001 or 0.01"):
        ratio_threshold(0.05, 3, 0.02)
    with pytest.raises(ValueError, match="ambiguities"):
        ratio_threshold(0.05, 0)
    with pytest.raises(ValueError, match="shapes"):
        partial_fix([1.0], np.eye(2))


@pytest.mark.parametrize("failure_rate", [0.001, 0.01])
def test_accepted_wrong_fixes_are_as_rare_as_promised(failure_rate):
    """Whatever is fixed, all or a part, is wrong at most twice as often as the rate: two tests."""
    generator = np.random.default_rng(2024)
    draws, wrong, fixed = 0, 0, 0
    for satellites in (5, 6, 7, 8, 10):
        for _ in range(5):
            covariance = model_covariance(generator, satellites, 1e-3, 0.3)
            root = np.linalg.cholesky(covariance)
            for _ in range(120):
                ambiguities = root @ generator.normal(size=satellites - 1)
                result = partial_fix(
                    ambiguities, covariance, 1.0 - failure_rate, failure_rate=failure_rate
                )
                draws += 1
                fixed += result.status in (FixStatus.FIXED, FixStatus.PARTIAL)
                wrong += bool(result.integers.any())
    assert fixed > 0.3 * draws
    limit = 2.0 * failure_rate * draws
    assert wrong <= limit + 3.0 * np.sqrt(limit)


@settings(max_examples=40)
@given(st.integers(4, 12), st.integers(0, 2**32 - 1))
def test_result_is_the_conditional_solution(satellites, seed):
    generator = np.random.default_rng(seed)
    covariance = model_covariance(generator, satellites, 1e-3, 0.6)
    n = satellites - 1
    truth = generator.integers(-5_000_000, 5_000_000, n)
    ambiguities = truth + np.linalg.cholesky(covariance) @ generator.normal(size=n)
    result = partial_fix(ambiguities, covariance)
    combination = result.transformation.astype(float)
    k = combination.shape[1]
    assert k == len(result.integers)
    assert (k == n) == (result.status is FixStatus.FIXED)
    assert (0 < k < n) == (result.status is FixStatus.PARTIAL)
    assert bool(result.reason) != (result.status is FixStatus.FIXED)
    if k == 0:
        np.testing.assert_array_equal(result.ambiguities, ambiguities)
        np.testing.assert_array_equal(result.covariance, covariance)
        return
    np.testing.assert_allclose(
        result.transformation.T @ result.ambiguities, result.integers, atol=1e-4
    )
    # Independent: the measurement update with the integers as exact observations.
    crossed = covariance @ combination
    inner = combination.T @ crossed
    misfit = (
        result.integers - result.transformation.T @ truth - combination.T @ (ambiguities - truth)
    )
    expected = ambiguities + crossed @ np.linalg.solve(inner, misfit)
    scale = np.sqrt(covariance.diagonal().max())
    np.testing.assert_allclose(result.ambiguities, expected, atol=1e-6 * scale, rtol=0.0)
    reduced = covariance - crossed @ np.linalg.solve(inner, crossed.T)
    np.testing.assert_allclose(result.covariance, reduced, atol=1e-6 * scale**2)
    assert misfit @ np.linalg.solve(inner, misfit) == pytest.approx(result.squared_norm, rel=1e-5)
    assert np.linalg.eigvalsh(result.covariance).min() > -1e-9 * scale**2
    whole = result.ambiguities[result.determined]
    np.testing.assert_array_equal(whole, np.rint(whole))
    assert not result.covariance[result.determined].any()


def test_a_new_satellite_without_information_does_not_keep_the_others_from_being_fixed():
    generator = np.random.default_rng(3)
    covariance = np.zeros((8, 8))
    covariance[:7, :7] = model_covariance(generator, 8, 1e-3, 0.05)
    covariance[7, 7] = 1e4
    truth = np.arange(8) - 3
    noise = np.linalg.cholesky(covariance) @ generator.normal(size=8)
    result = partial_fix(truth + noise, covariance)
    assert result.status is FixStatus.PARTIAL
    np.testing.assert_array_equal(result.determined, [True] * 7 + [False])
    np.testing.assert_array_equal(result.ambiguities[:7], truth[:7])
    assert result.covariance[7, 7] == pytest.approx(1e4)
    assert "7 of 8 fixed" in result.reason


def test_integers_that_do_not_fit_are_refused():
    """A biased model: precise enough to be sure, but half a cycle beside every integer."""
    covariance = 1e-4 * (np.eye(5) + 0.5)
    result = partial_fix(np.full(5, 0.4), covariance)
    assert result.status is FixStatus.RESIDUAL
    assert "squared norm" in result.reason
    assert result.transformation.shape == (5, 0)


def test_a_tie_is_refused():
    result = partial_fix([0.5], [[0.2]], success_rate=0.5)
    assert result.status in (FixStatus.RATIO, FixStatus.WEAK)


def test_minimum_ratio_is_asked_for_in_any_case():
    covariance = 0.02 * np.eye(4)
    assert partial_fix([0.1, 0.0, 0.2, 0.0], covariance).status is FixStatus.FIXED
    refused = partial_fix([0.1, 0.0, 0.2, 0.0], covariance, minimum_ratio=1000.0)
    assert refused.status is FixStatus.RATIO
    assert "1000.00 needed" in refused.reason


@pytest.mark.parametrize(
    ("ambiguities", "covariance"),
    [
        ([0.1, 0.2], np.zeros((2, 2))),
        ([0.1, 0.2], np.full((2, 2), np.nan)),
        ([0.1, np.inf], np.eye(2)),
    ],
)
def test_bad_numbers_are_a_clear_result(ambiguities, covariance):
    result = partial_fix(ambiguities, covariance)
    assert result.status is FixStatus.BAD_INPUT
    assert result.reason
    assert result.integers.shape == (0,)


def test_no_ambiguities():
    result = partial_fix(np.zeros(0), np.zeros((0, 0)))
    assert result.status is FixStatus.BAD_INPUT
    assert result.reason == "no ambiguities"
    assert result.integers.shape == (0,)
