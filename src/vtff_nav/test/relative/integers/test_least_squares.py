"""Integer least squares: published vectors, brute force, RTKLIB, bad covariances."""

from __future__ import annotations

import itertools
import json
import pathlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shared_data import needs_shared, shared_folder

from vtff_nav.relative.integers.least_squares import (
    IntegerStatus,
    bootstrapped_success_rate,
    decorrelate,
    search,
    search_decorrelated,
)

REPOSITORY = pathlib.Path(__file__).resolve().parents[5]
VECTORS = shared_folder() / "data/navigation/lambda_vectors.json"
needs_vectors = needs_shared("data/navigation/lambda_vectors.json")


def vectors() -> list[dict]:
    return json.loads(VECTORS.read_text(encoding="utf-8"))["vectors"]


def random_covariance(generator: np.random.Generator, n: int, spread: float = 3.0) -> np.ndarray:
    """Return a covariance with the shape of a short carrier-phase model: 3 weak directions."""
    design = generator.normal(size=(n, 3))
    weak = design @ np.diag(10.0 ** generator.uniform(0.0, spread, 3)) @ design.T
    return weak + np.diag(generator.uniform(1e-3, 1e-2, n))


def squared_norm(ambiguities: np.ndarray, integers: np.ndarray, covariance: np.ndarray) -> float:
    residual = ambiguities - integers
    return float(residual @ np.linalg.solve(covariance, residual))


@needs_vectors
def test_known_vectors():
    assert {v["n"] for v in vectors()} >= {1, 3, 6, 12, 20, 40}
    for vector in vectors():
        print(vector["name"])  # shown where one of them fails
        assert_known_vector(vector)


def assert_known_vector(vector):
    solution = search(vector["float"], vector["cov"])
    assert solution.status is IntegerStatus.OK
    assert solution.reason == ""
    np.testing.assert_array_equal(solution.candidates, vector["fixed"])
    np.testing.assert_allclose(solution.squared_norms, vector["sqnorm"], rtol=1e-8)
    if "ratio" in vector:
        assert solution.ratio == pytest.approx(vector["ratio"], rel=1e-8)
    if "Ps_bootstrap" in vector:
        assert solution.success_rate == pytest.approx(vector["Ps_bootstrap"], rel=1e-8)
    published = vector.get("published_expected")
    if published:
        np.testing.assert_array_equal(solution.candidates, published["fixed"])
        np.testing.assert_allclose(solution.squared_norms, published["sqnorm"], rtol=1e-6)


@settings(max_examples=60)
@given(st.integers(1, 3), st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_brute_force(n, candidates, seed):
    generator = np.random.default_rng(seed)
    root = generator.normal(size=(n, n)) + np.diag(generator.uniform(0.3, 1.0, n))
    covariance = root @ root.T + 0.05 * np.eye(n)
    ambiguities = generator.uniform(-5.0, 5.0, n)
    solution = search(ambiguities, covariance, candidates)
    # Every vector as good as the worst candidate is within this box around the float solution.
    reach = np.sqrt(solution.squared_norms[-1] * np.diag(covariance)) + 1e-9
    axes = [
        range(int(np.ceil(a - r)), int(np.floor(a + r)) + 1)
        for a, r in zip(ambiguities, reach, strict=True)
    ]
    grid = np.array(list(itertools.product(*axes)))
    inverse = np.linalg.inv(covariance)
    residuals = ambiguities - grid
    norms = np.sort(np.einsum("ij,jk,ik->i", residuals, inverse, residuals))
    np.testing.assert_allclose(solution.squared_norms, norms[:candidates], rtol=1e-8, atol=1e-12)
    for integers, norm in zip(solution.candidates, solution.squared_norms, strict=True):
        assert squared_norm(ambiguities, integers, covariance) == pytest.approx(norm, rel=1e-8)
    assert len({tuple(row) for row in solution.candidates.tolist()}) == candidates


@settings(max_examples=40)
@given(st.integers(1, 20), st.integers(0, 2**32 - 1))
def test_decorrelation_is_unimodular_and_exact(n, seed):
    covariance = random_covariance(np.random.default_rng(seed), n)
    result = decorrelate(covariance)
    assert result.status is IntegerStatus.OK
    identity = result.transformation.T @ result.inverse_transposed
    np.testing.assert_array_equal(identity, np.eye(n, dtype=np.int64))
    decorrelated = result.transformation.T @ covariance @ result.transformation
    rebuilt = result.lower.T @ np.diag(result.conditional_variances) @ result.lower
    np.testing.assert_allclose(rebuilt, decorrelated, rtol=1e-6, atol=1e-9 * covariance.max())
    assert np.abs(np.tril(result.lower, -1)).max(initial=0.0) <= 0.5 + 1e-6
    np.testing.assert_array_equal(np.triu(result.lower), np.eye(n))
    # Neighbours are in the order in which exchanging them gains nothing.
    variances = result.conditional_variances
    exchanged = variances[:-1] + np.diag(result.lower, -1) ** 2 * variances[1:]
    assert (exchanged >= (1.0 - 2e-6) * variances[1:]).all()


@settings(max_examples=25)
@given(st.integers(2, 12), st.integers(0, 2**32 - 1))
def test_translation_and_integer_transformation_change_nothing(n, seed):
    generator = np.random.default_rng(seed)
    covariance = random_covariance(generator, n)
    ambiguities = generator.normal(size=n) * 3.0
    ambiguities = np.round(ambiguities * 2.0**20) / 2.0**20  # exact when the shift is added
    shift = generator.integers(-5_000_000, 5_000_000, n)
    plain, shifted = search(ambiguities, covariance), search(ambiguities + shift, covariance)
    np.testing.assert_array_equal(shifted.candidates, plain.candidates + shift)
    np.testing.assert_array_equal(shifted.squared_norms, plain.squared_norms)
    order = generator.permutation(n)
    permuted = search(ambiguities[order], covariance[np.ix_(order, order)])
    np.testing.assert_allclose(permuted.squared_norms, plain.squared_norms, rtol=1e-6)
    np.testing.assert_array_equal(permuted.candidates[0], plain.candidates[0][order])


def rtklib_solution(ambiguities: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, list]:
    pyrtklib = pytest.importorskip("pyrtklib")
    n = len(ambiguities)
    arrays = [pyrtklib.Arr1Ddouble(size) for size in (n, n * n, 2 * n, 2)]
    for array, content in zip(arrays, (ambiguities, covariance.ravel()), strict=False):
        for index, value in enumerate(content.tolist()):
            array[index] = value
    assert getattr(pyrtklib, "lambda")(n, 2, *arrays) == 0
    integers = np.rint([arrays[2][index] for index in range(2 * n)]).reshape(2, n)
    return integers, [arrays[3][0], arrays[3][1]]


@pytest.mark.parametrize("n", [1, 2, 5, 8, 12, 16, 20])
def test_rtklib_agrees(n):
    generator = np.random.default_rng(100 + n)
    for _ in range(10):
        covariance = random_covariance(generator, n, spread=1.5)
        ambiguities = generator.multivariate_normal(generator.integers(-9, 9, n), covariance)
        integers, norms = rtklib_solution(ambiguities, covariance)
        solution = search(ambiguities, covariance)
        np.testing.assert_allclose(solution.squared_norms, norms, rtol=1e-6)
        np.testing.assert_array_equal(solution.candidates, integers)


@pytest.mark.parametrize("n", [40, 60])
def test_many_ambiguities_of_a_strong_model_are_the_true_ones(n):
    generator = np.random.default_rng(n)
    covariance = 0.5 * random_covariance(generator, n, spread=1.0)
    truth = generator.integers(-5_000_000, 5_000_000, n)
    ambiguities = truth + np.linalg.cholesky(covariance) @ generator.normal(size=n)
    solution = search(ambiguities, covariance)
    assert solution.status is IntegerStatus.OK
    assert solution.success_rate > 0.999
    np.testing.assert_array_equal(solution.candidates[0], truth)
    for integers, norm in zip(solution.candidates, solution.squared_norms, strict=True):
        assert squared_norm(ambiguities, integers, covariance) == pytest.approx(norm, rel=1e-6)


def test_asymmetric_covariance_counts_by_its_symmetric_part():
    covariance = np.array([[6.29, 5.978, 0.544], [5.978, 6.292, 2.34], [0.544, 2.34, 6.288]])
    tilted = covariance + np.array([[0.0, 1e-6, 0.0], [-1e-6, 0.0, 0.0], [0.0, 0.0, 0.0]])
    ambiguities = [5.45, 3.1, 2.97]
    first, second = search(ambiguities, covariance), search(ambiguities, tilted)
    np.testing.assert_array_equal(first.candidates, second.candidates)
    np.testing.assert_allclose(first.squared_norms, second.squared_norms, rtol=1e-12)


def test_equal_norms_come_in_the_order_of_the_integers():
    solution = search([0.5, -0.5], np.eye(2), candidates=4)
    np.testing.assert_array_equal(solution.candidates, [[0, -1], [0, 0], [1, -1], [1, 0]])
    assert solution.ratio == 1.0


@pytest.mark.parametrize(
    ("covariance", "status", "words"),
    [
        (np.zeros((3, 3)), IntegerStatus.NOT_POSITIVE_DEFINITE, "variance 0"),
        (np.ones((3, 3)), IntegerStatus.NOT_POSITIVE_DEFINITE, "combination of the others"),
        (np.diag([1.0, -1.0, 2.0]), IntegerStatus.NOT_POSITIVE_DEFINITE, "ambiguity 1"),
        (np.array([[1.0, 2, 0], [2, 1, 0], [0, 0, 1]]), IntegerStatus.NOT_POSITIVE_DEFINITE, ""),
        (np.diag([1.0, np.nan, 1.0]), IntegerStatus.NOT_FINITE, "covariance[1, 1] is nan"),
        (np.diag([1.0, 1.0, np.inf]), IntegerStatus.NOT_FINITE, "covariance[2, 2] is inf"),
    ],
)
def test_bad_covariance_is_a_clear_result(covariance, status, words):
    solution = search([0.1, 0.2, 0.3], covariance)
    assert solution.status is status
    assert words in solution.reason
    assert solution.reason
    assert solution.candidates.shape == (0, 3)
    assert solution.success_rate == 0.0
    assert decorrelate(covariance).success_rate == 0.0


def test_bad_ambiguities_are_a_clear_result():
    assert search([np.nan, 0.0], np.eye(2)).status is IntegerStatus.NOT_FINITE
    too_large = search([0.0, 1e16], np.eye(2))
    assert too_large.status is IntegerStatus.OUT_OF_RANGE
    assert "float_ambiguities[1]" in too_large.reason


@pytest.mark.parametrize("exponent", [4, 8, 12, 14, 18])
def test_huge_condition_numbers_give_the_answer_or_a_reason(exponent):
    generator = np.random.default_rng(exponent)
    for _ in range(20):
        direction = generator.normal(size=(6, 1))
        covariance = 10.0**exponent * direction @ direction.T + np.diag(
            generator.uniform(0.5, 1.0, 6)
        )
        truth = generator.integers(-9, 9, 6)
        solution = search(truth + 1e-9 * generator.normal(size=6), covariance)
        if solution.status is IntegerStatus.OK:
            np.testing.assert_array_equal(solution.candidates[0], truth)
        else:
            assert solution.reason


def test_search_that_takes_too_long_says_so():
    generator = np.random.default_rng(5)
    root = generator.normal(size=(30, 30))
    solution = search(generator.normal(size=30), 1e4 * root @ root.T, node_limit=1000)
    assert solution.status is IntegerStatus.SEARCH_LIMIT
    assert "1000 nodes" in solution.reason
    assert solution.candidates.shape == (0, 30)


def test_shapes_that_do_not_fit_are_errors():
    with pytest.raises(ValueError, match="float_ambiguities"):
        search([1.0, 2.0], np.eye(3))
    with pytest.raises(ValueError, match="covariance"):
        decorrelate(np.ones((2, 3)))
    with pytest.raises(ValueError, match="candidates"):
        search([1.0], [[1.0]], candidates=0)


def test_no_ambiguities_are_fixed_by_nothing():
    solution = search(np.zeros(0), np.zeros((0, 0)))
    assert solution.status is IntegerStatus.OK
    assert solution.candidates.shape == (1, 0)
    assert solution.success_rate == 1.0


def bootstrap(float_ambiguities: np.ndarray, lower: np.ndarray) -> np.ndarray:
    """Round ambiguities with L of their covariance L^T D L from the last to the first.

    Each is conditioned on the integers of the later ones (Teunissen 1998, J. Geodesy 72, eq. 17).
    """
    conditional = float_ambiguities.copy()
    integers = np.zeros(len(conditional), dtype=np.int64)
    for i in range(len(conditional) - 1, -1, -1):
        integers[i] = int(np.floor(conditional[i] + 0.5))
        conditional[:i] -= lower[i, :i] * (conditional[i] - integers[i])
    return integers


def test_bootstrapping_succeeds_as_often_as_predicted():
    generator = np.random.default_rng(11)
    result = decorrelate(0.1 * random_covariance(generator, 6, spread=1.0))
    covariance = result.lower.T @ np.diag(result.conditional_variances) @ result.lower
    root = np.linalg.cholesky(covariance)
    draws = 4000
    samples = generator.normal(size=(draws, 6)) @ root.T
    bootstrapped = sum(not bootstrap(sample, result.lower).any() for sample in samples)
    rate = bootstrapped_success_rate(result.conditional_variances)
    assert 0.2 < rate < 0.98
    deviation = np.sqrt(rate * (1.0 - rate) / draws)
    assert abs(bootstrapped / draws - rate) < 4.0 * deviation
    searched = sum(
        not search_decorrelated(sample, result.lower, result.conditional_variances)
        .candidates[0]
        .any()
        for sample in samples
    )
    assert searched >= bootstrapped - 4.0 * np.sqrt(draws) * 0.1
