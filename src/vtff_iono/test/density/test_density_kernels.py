"""Compiled steps of the density filter against the same formulas on arrays."""

import math

import numpy as np
import pytest

from vtff_dynamics.constants import WGS84_SEMI_MAJOR_AXIS
from vtff_gnss.constants import ELECTRONS_PER_TECU
from vtff_iono.bias.running_profile import RunningProfile
from vtff_iono.density.filter import kernels
from vtff_iono.density.filter.content_design import content_design, elevation_functions, empty_rays
from vtff_iono.density.filter.kernels import COMMON, DENSITY
from vtff_iono.geometry.mapping import profile_content


def draw_filter(seed, satellites=9, known=7):
    """State, covariance, design of the common states and places of slow errors, two without."""
    generator = np.random.default_rng(seed)
    size = COMMON + known
    root = generator.standard_normal((size, size))
    scale = np.array([2.0, 0.3, 0.01, *[0.1] * (COMMON - 3), *[0.03] * known])
    covariance = root @ root.T / size * np.outer(scale, scale)
    state = scale * generator.standard_normal(size)
    sizes = [0.0, 1.0, -1e3, *[0.3] * (COMMON - 3)]
    common = generator.standard_normal((satellites, COMMON)) * sizes
    common[:, 0] = 1.0
    places = np.append(generator.permutation(known) + COMMON, np.full(satellites - known, -1))
    return generator, state, covariance, common, places


def with_slow_errors(common, places, size):
    design = np.zeros((len(common), size))
    design[:, :COMMON] = common
    for row, place in enumerate(places):
        if place >= 0:
            design[row, place] = 1.0
    return design


def close(actual, expected):
    """Agree to 1e-9 of the largest number."""
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("seed", range(4))
def test_time_passes(seed):
    generator, state, covariance, _, _ = draw_filter(seed)
    gained = generator.random(COMMON + 1)
    scale = 0.5 + generator.random(COMMON + 1)
    factor = np.full(len(state), 0.7 * scale[COMMON])
    factor[:COMMON] = scale[:COMMON]
    gains = np.append(gained[:COMMON], np.full(len(state) - COMMON, gained[COMMON]))
    expected = np.outer(factor, factor) * covariance + np.diag(gains)
    moved = np.where(np.arange(len(state)) < COMMON, state, 0.7 * state)
    kernels.pass_time(state, covariance, scale, 0.7, gained)
    close(covariance, expected)
    close(state, moved)


@pytest.mark.parametrize("seed", range(4))
def test_contents_are_compared(seed):
    generator, state, covariance, common, places = draw_filter(seed)
    own = 1e-4 * (1.0 + generator.random(len(common)))
    design, contents, spread = kernels.compare(common, places, state, covariance, own)
    expected = with_slow_errors(common, places, len(state))
    np.testing.assert_array_equal(design, expected)
    close(contents, expected @ state)
    close(spread, expected @ covariance @ expected.T + np.diag(own))


@pytest.mark.parametrize("seed", range(4))
def test_contents_correct_the_state(seed):
    """Least squares of the contents and of the prediction, each over its sigma."""
    generator, state, covariance, common, places = draw_filter(seed)
    design = with_slow_errors(common, places, len(state))
    variance = 1e-4 * (1.0 + generator.random(len(common)))
    residual = design @ state + 0.05 * generator.standard_normal(len(common))
    prior = np.linalg.inv(np.linalg.cholesky(covariance))
    weight = 1.0 / np.sqrt(variance)
    rows = np.vstack((prior, design * weight[:, np.newaxis]))
    basis, triangle = np.linalg.qr(rows)
    inverse = np.linalg.inv(triangle)
    expected = inverse @ (basis.T @ np.concatenate((prior @ state, residual * weight)))
    gain = kernels.correct(state, covariance, design, residual, variance)
    sigma = np.sqrt(np.diag(inverse @ inverse.T))
    np.testing.assert_array_less(np.abs(state - expected), 1e-6 * sigma)
    scale = np.outer(sigma, sigma)
    np.testing.assert_allclose(covariance / scale, inverse @ inverse.T / scale, atol=1e-6)
    normal = inverse @ inverse.T @ design.T / variance
    np.testing.assert_allclose(gain, normal, atol=1e-6 * np.abs(normal).max())


def contradictions(innovation, covariance, unknown):
    """Contents that all others do not predict, by conditional expectation of each."""
    kept = list(range(len(innovation)))
    while len(kept) > unknown:
        errors, ratios = [], []
        for row in kept:
            others = [other for other in kept if other != row]
            gain = np.linalg.solve(covariance[np.ix_(others, others)], covariance[others, row])
            errors.append(innovation[row] - gain @ innovation[others])
            variance = covariance[row, row] - gain @ covariance[others, row]
            ratios.append(abs(errors[-1]) / math.sqrt(variance))
        worst = int(np.argmax(ratios))
        if ratios[worst] <= 5.0 or abs(errors[worst]) <= 0.1:
            break
        del kept[worst]
    return np.isin(np.arange(len(innovation)), kept, invert=True)


@pytest.mark.parametrize("seed", range(8))
def test_wrong_contents_are_found_one_by_one(seed):
    generator = np.random.default_rng(seed)
    root = generator.standard_normal((8, 8))
    covariance = 1e-4 * root @ root.T + 1e-2 * np.ones((8, 8)) + 1e-3 * np.eye(8)
    innovation = np.linalg.cholesky(covariance) @ generator.standard_normal(8)
    innovation[generator.choice(8, seed % 3, replace=False)] += 3.0
    found = kernels.find_contradictions(innovation, covariance, 3, 5.0, 0.1)
    np.testing.assert_array_equal(found, contradictions(innovation, covariance, 3))
    assert np.count_nonzero(found) == seed % 3


def test_an_unknown_content_contradicts_nothing():
    """A satellite without an orbit has neither a prediction nor an error."""
    innovation, covariance = np.zeros(5), np.eye(5)
    innovation[2] = covariance[2, :] = covariance[:, 2] = math.nan
    assert not kernels.find_contradictions(innovation, covariance, 3, 5.0, 0.1).any()


@pytest.mark.parametrize("seed", range(4))
def test_density_of_each_satellite(seed):
    generator, state, covariance, common, _ = draw_filter(seed)
    residual, variance = generator.standard_normal(9), 1e-3 + generator.random(9)
    density, sigma = kernels.satellite_densities(common, residual, variance, state, covariance)
    others = np.delete(np.arange(COMMON), DENSITY)
    rest = residual - common[:, others] @ state[others]
    spread = common[:, others] @ covariance[np.ix_(others, others)] @ common[:, others].T
    close(density, rest / common[:, DENSITY])
    close(sigma, np.sqrt(variance + np.diag(spread)) / np.abs(common[:, DENSITY]))


@pytest.mark.parametrize("satellites", [4, 9, 14])
def test_residuals_of_what_satellites_do_not_share(satellites):
    generator = np.random.default_rng(satellites)
    # The columns differ by many powers of ten, as those of b and of the density do.
    common = generator.standard_normal((satellites, 3)) * [1.0, 1e-3, -1e3]
    observed = 100.0 + generator.standard_normal(satellites)
    fast = 0.01 + generator.random(satellites)
    common_sigma = np.array([np.inf, np.inf, 1e-3])
    is_determined, weight, residual, freedom = kernels.slow_residuals(
        observed, common, common_sigma, fast, 0.04
    )
    scaled = np.vstack((common * weight[:, np.newaxis], np.diag(1.0 / common_sigma)))
    projection = np.eye(satellites + 3) - scaled @ np.linalg.pinv(scaled, rcond=1e-14)
    projection = projection[:satellites, :satellites]
    assert is_determined
    close(weight, 1.0 / np.sqrt(fast + 0.04))
    np.testing.assert_allclose(residual, projection @ (observed * weight), atol=1e-9)
    np.testing.assert_allclose(freedom, np.diag(projection), atol=1e-9)


@pytest.mark.parametrize("satellites", [0, 2, 5])
def test_what_is_shared_may_be_undetermined(satellites):
    common = np.ones((satellites, 3))
    values = np.ones(satellites)
    assert not kernels.slow_residuals(values, common, np.full(3, np.inf), values, 1.0)[0]


@pytest.mark.parametrize("seed", range(4))
def test_variances_that_contents_did_not_come_with(seed):
    """A content that is off by more than five sigmas has the variance that its error shows."""
    generator = np.random.default_rng(seed)
    root = generator.standard_normal((8, 8))
    covariance = 1e-4 * root @ root.T + 1e-3 * np.eye(8)
    innovation = np.linalg.cholesky(covariance) @ generator.standard_normal(8)
    innovation[seed] += 2.0
    others = np.delete(np.arange(8), seed)
    gain = np.linalg.solve(covariance[np.ix_(others, others)], covariance[others, seed])
    expected = np.where(np.arange(8) == seed, (innovation - gain @ innovation[others]) ** 2, 0.0)
    close(kernels.unsaid_variances(innovation, covariance, 3, 5.0), expected)
    innovation[seed] = gain @ innovation[others]
    assert not kernels.unsaid_variances(innovation, covariance, 3, 5.0).any()


def test_rays_of_a_second_are_found_again():
    """Contents are those of a new table of rays, also when a table is full or of another place."""
    profile, state = RunningProfile(), np.zeros(COMMON)
    chief = np.linspace(0.3, 1.5, 6)
    kept = empty_rays(25, len(profile.altitude))
    for altitude, rows in ((400e3, 4), (400e3, 6), (400.1e3, 6), (400.1e3, 3)):
        sights = elevation_functions(chief[:rows], chief[:rows] + 1e-3)
        arguments = (*sights, altitude, altitude + 1e3, profile.table)
        again = content_design(*arguments, kept, state)
        for actual, expected in zip(
            again,
            content_design(*arguments, empty_rays(25, len(profile.altitude)), state),
            strict=True,
        ):
            np.testing.assert_array_equal(actual, expected)
    assert 0 < kept.filled[0] <= 25


@pytest.mark.parametrize("altitude_deputy", [401e3, 399.5e3])
def test_modelled_contents_are_integrals_through_the_profile(altitude_deputy):
    """The contents above both spacecraft, and the electrons between them along the rays."""
    profile = RunningProfile()
    chief = np.linspace(0.3, 1.5, 6)
    deputy = chief + 1e-3
    rays = empty_rays(13, len(profile.altitude))
    sights = elevation_functions(chief, deputy)
    common, modelled = content_design(
        *sights, 400e3, altitude_deputy, profile.table, rays, np.zeros(COMMON)
    )
    path = (altitude_deputy - 400e3) / np.sin(0.5 * (chief + deputy))
    above = [
        profile_content(
            elevation, WGS84_SEMI_MAJOR_AXIS + height, profile.altitude, profile.density
        )
        for elevation, height in ((chief, 400e3), (deputy, altitude_deputy))
    ]
    between = profile.mean_density(400e3, altitude_deputy) / ELECTRONS_PER_TECU * path
    close(modelled, above[1] - above[0] + between)
    close(common[:, DENSITY], -path)
