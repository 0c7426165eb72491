"""The solver against a general minimiser that knows nothing of elimination."""

import numpy as np
import pytest
from scipy import optimize

from vtff_iono.bias.profile_solver import NormalEquations, solve_profile

SHELLS, EFFECTS, SAMPLES = 4, 3, 40
GENERATOR = np.random.default_rng(5)
PATHS = GENERATOR.uniform(0.5, 2.0, (SAMPLES, SHELLS))
COLUMNS = GENERATOR.standard_normal((SAMPLES, EFFECTS))
WEIGHT = GENERATOR.uniform(20.0, 200.0, SAMPLES)
LOG_DENSITY = np.array([0.3, -0.5, 0.1, -1.0])
STEC = PATHS @ np.exp(LOG_DENSITY) + COLUMNS @ [2.0, -0.3, 0.2]
STEC += 0.1 * GENERATOR.standard_normal(SAMPLES)
PRIOR = 0.5 * np.eye(SHELLS) + 0.2
PRIOR_VECTOR = PRIOR @ np.array([0.0, -0.3, -0.6, -0.9])
EFFECT_PRECISION = np.array([0.0, 10.0, 4.0])


def normal():
    """Return the normal equations of effects that are all shared."""
    joint = np.column_stack((COLUMNS, PATHS, STEC))
    products = (joint * WEIGHT[:, np.newaxis]).T @ joint
    return NormalEquations(EFFECTS, products, np.zeros((3, 0)), np.zeros((2, 0, len(products))))


def minus_log_posterior(unknown):
    x, u = unknown[:SHELLS], unknown[SHELLS:]
    residual = STEC - PATHS @ np.exp(x) - COLUMNS @ u
    prior = 0.5 * x @ PRIOR @ x - PRIOR_VECTOR @ x + 0.5 * EFFECT_PRECISION @ u**2
    return 0.5 * WEIGHT @ residual**2 + prior


def solution(start=0.0):
    return solve_profile(
        normal(), PRIOR, PRIOR_VECTOR, EFFECT_PRECISION, np.full(SHELLS, start, dtype=float)
    )


def test_it_is_the_maximum_of_the_posterior_density():
    found = solution()
    reference = optimize.minimize(
        minus_log_posterior, np.zeros(SHELLS + EFFECTS), method="BFGS", options={"gtol": 1e-8}
    )
    at_found = minus_log_posterior(np.concatenate((found.log_density, found.effects)))
    assert at_found - reference.fun < 5e-3
    sigma = np.sqrt(found.effect_variance)
    assert (np.abs(found.effects - reference.x[SHELLS:]) < 0.1 * sigma).all()


def test_the_start_does_not_matter():
    sigma = np.sqrt(solution().effect_variance)
    for start in (-4.0, 3.0):
        assert (np.abs(solution(start).effects - solution().effects) < 0.1 * sigma).all()


def test_variances_are_those_of_the_whole_inverse():
    found = solution()
    columns = np.hstack((PATHS * np.exp(found.log_density), COLUMNS))
    curvature = (columns * WEIGHT[:, np.newaxis]).T @ columns
    curvature[:SHELLS, :SHELLS] += PRIOR
    curvature[SHELLS:, SHELLS:] += np.diag(EFFECT_PRECISION)
    expected = np.diag(np.linalg.inv(curvature))[SHELLS:]
    assert found.effect_variance == pytest.approx(expected, rel=1e-9)


def test_effects_of_known_value_keep_it():
    """An effect whose prior variance is tiny is zero, and costs the others nothing."""
    precise = np.array([0.0, 1e12, 1e12])
    found = solve_profile(normal(), PRIOR, PRIOR_VECTOR, precise, np.zeros(SHELLS))
    assert found.effects[1:] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert found.effect_variance[1:] == pytest.approx([1e-12, 1e-12], rel=1e-3)


def test_effects_of_arcs_are_those_of_a_full_matrix():
    """Blocks of arcs that are eliminated first change nothing."""
    arc, arcs, shared = np.arange(SAMPLES) % 3, 3, EFFECTS
    both = np.array([PATHS @ np.exp(LOG_DENSITY), np.ones(SAMPLES)])
    of_arcs = np.hstack(
        [(arc[:, np.newaxis] == np.arange(arcs)) * row[:, np.newaxis] for row in both]
    )
    precision = np.concatenate((EFFECT_PRECISION, [4.0, 5.0, 6.0, 0.1, 0.2, 0.3]))
    columns = np.hstack((COLUMNS, of_arcs))
    joint = np.column_stack((columns, PATHS, STEC))
    products = (joint * WEIGHT[:, np.newaxis]).T @ joint
    no_arcs = np.zeros((3, 0)), np.zeros((2, 0, len(products)))
    full = NormalEquations(len(precision), products, *no_arcs)
    kept = np.setdiff1d(np.arange(len(products)), shared + np.arange(2 * arcs))
    first, second = shared + np.arange(arcs), shared + arcs + np.arange(arcs)
    with_arcs = NormalEquations(
        shared,
        products[np.ix_(kept, kept)],
        np.array([products[first, first], products[first, second], products[second, second]]),
        np.array([products[np.ix_(first, kept)], products[np.ix_(second, kept)]]),
    )
    expected, found = (
        solve_profile(equations, PRIOR, PRIOR_VECTOR, precision, np.zeros(SHELLS))
        for equations in (full, with_arcs)
    )
    assert found.log_density == pytest.approx(expected.log_density, rel=1e-9)
    assert found.effects == pytest.approx(expected.effects, rel=1e-9)
    assert found.effect_variance == pytest.approx(expected.effect_variance, rel=1e-9)
    assert found.shared_variance == pytest.approx(expected.effect_variance[:shared], rel=1e-9)
    functions = GENERATOR.standard_normal((5, len(precision)))
    assert found.variance(functions) == pytest.approx(expected.variance(functions), rel=1e-9)
    one_each = found.variance(np.eye(len(precision)))
    assert one_each == pytest.approx(found.effect_variance, rel=1e-9)
