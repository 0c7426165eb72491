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
    weighted = PATHS * WEIGHT[:, np.newaxis]
    heavy = COLUMNS * WEIGHT[:, np.newaxis]
    return NormalEquations(
        density=weighted.T @ PATHS,
        effects=heavy.T @ COLUMNS,
        mixed=heavy.T @ PATHS,
        density_vector=weighted.T @ STEC,
        effects_vector=heavy.T @ STEC,
    )


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
