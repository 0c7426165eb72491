"""Crossings of an edge by two spacecraft, in scintillation and without."""

import math

import numpy as np
import pytest
import scipy.special
from formation_simulation import chapman

from vtff_iono.edges.edge_crossing import ContentSeries, fit_edge_crossings

RATE = 20
SPEED = 256.0
EDGE = 290e3
SEPARATION = 985.0
LAG = 2.034
"""Time of the deputy behind the chief, s: 15 km at 7.4 km/s."""
ELEVATIONS = np.radians([20.0, 22.0, 23.0, 28.0, 31.0, 38.0, 39.0, 40.0, 46.0, 68.0])
TIME = np.arange(-45 * RATE, 45 * RATE + 1) / RATE


def missing_part(altitude, width, shape):
    """Part of the density that is missing; walls of any shape have the second moment of a line."""
    height = altitude - EDGE
    if shape == "erf":
        return 0.5 * (1.0 + scipy.special.erf(height / (width / math.sqrt(12.0)) / math.sqrt(2.0)))
    if shape == "tanh":
        return 0.5 * (1.0 + np.tanh(height / (width / math.pi)))
    if shape == "cosine":
        # The density of cos^2 over a length l has the variance l^2 (1/12 - 1/(2 pi^2)).
        length = width / math.sqrt(1.0 - 6.0 / math.pi**2)
        place = np.clip(height / length, -0.5, 0.5)
        return 0.5 + place + np.sin(2.0 * math.pi * place) / (2.0 * math.pi)
    return np.interp(height, [-width / 2, width / 2], [0.0, 1.0])


def vertical_content(width, shape="line"):
    """Content above an altitude: the paper's bubble above 290 km, its edge 100 m wide or more."""
    altitude = np.arange(230e3, 360e3, 10.0)
    inside = missing_part(altitude, width, shape)
    density = (1.0 - inside) * chapman(altitude, 1.3e12) + inside * 1.1e10
    return altitude, -np.concatenate(([0.0], np.cumsum(density[:-1] * 10.0 / 1e16)))


def pattern(generator, size=0.063):
    """Scintillation of one ray: 0.063 TECU on L1 and L2 together, correlated over 0.5 s."""
    place = np.arange(-60.0, 60.0, 0.01)
    step = np.arange(0.0, 6.5, 0.01)
    # The Butterworth low pass of the Cornell model; see the emulator's scintillation field.
    response = np.exp(-step / 0.4) * np.sin(step / 0.4)
    noise = np.convolve(generator.standard_normal(len(place)), response)[: len(place)]
    return place, size * noise / noise.std()


def crossing(rising=True, size=0.063, seed=0, slip=False, width=100.0, shape="line", slow=0.0):
    """Series of chief and deputy, and the true times of both.

    `slow` is what contents have changed by after a minute, independently of each other, TECU.
    """
    generator = np.random.default_rng(seed)
    speed = SPEED if rising else -SPEED
    shift = -0.5 * SEPARATION
    heights = [EDGE + shift + speed * TIME, EDGE - shift + speed * TIME]
    if rising:
        # The deputy is below and comes later, as on the paper's second pass.
        heights.reverse()
    table = vertical_content(width, shape)
    patterns = [pattern(generator, size) for _ in ELEVATIONS]
    series = []
    for craft, height in enumerate(heights):
        content = np.interp(height, *table)
        slope = np.outer(np.linspace(-0.02, 0.03, len(ELEVATIONS)), TIME)
        stec = content / np.sin(ELEVATIONS)[:, np.newaxis] + slope + 0.0001 * slope * TIME
        stec += 7.0 * craft + np.arange(len(ELEVATIONS))[:, np.newaxis]
        stec += [np.interp(TIME - craft * LAG, *one) for one in patterns]
        stec += 0.0135 * generator.standard_normal(stec.shape)
        if slow:
            walk = generator.standard_normal(stec.shape) * slow / math.sqrt(60.0 * RATE)
            stec += np.cumsum(walk, axis=1)
        arc = np.ones(stec.shape, dtype=np.int64)
        if slip:
            stec[::3, 700:] += 5.0
            arc[::3, 700:] = 2
        elevation = np.repeat(ELEVATIONS[:, np.newaxis], len(TIME), axis=1)
        series.append(ContentSeries(height, stec, arc, elevation))
    true = [float(np.interp(0.0, (h - EDGE) * math.copysign(1, speed), TIME)) for h in heights]
    return series, np.array(true)


def fitted(series, rising=True):
    found = fit_edge_crossings(TIME, *series, EDGE + 90.0, is_dense_above=False)
    assert found is not None
    return found


@pytest.mark.parametrize("rising", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_without_scintillation_within_a_few_metres(rising, seed):
    series, true = crossing(rising, 0.0, seed)
    found = fitted(series)
    assert np.abs(found.time - true).max() * SPEED < 20.0
    assert (np.abs(found.time - true) < 4.0 * found.time_sigma).all()
    assert found.density == pytest.approx(chapman(EDGE, 1.3e12) - 1.1e10, rel=0.05)


@pytest.mark.parametrize("slip", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_in_scintillation(seed, slip):
    """Bounds of the project: 100 m, and 5 % of 985 m between the two."""
    series, true = crossing(seed=seed, slip=slip)
    found = fitted(series)
    error = found.time - true
    assert np.abs(error).max() * SPEED < 100.0
    assert abs(error[1] - error[0]) * SPEED < 0.05 * SEPARATION
    assert (np.abs(error) < 4.0 * found.time_sigma).all()
    assert found.lag == pytest.approx(LAG, abs=0.03)


def test_the_covariance_of_both_times_is_that_of_their_difference():
    """Errors of the wall are common to both times, so that their difference errs by less."""
    ratios, shared = [], []
    for seed in range(12):
        series, true = crossing(seed=seed, width=4e3)
        found = fit_edge_crossings(TIME, *series, EDGE + 90.0, is_dense_above=False, width=4e3)
        assert found is not None
        independent = float(found.time_sigma @ found.time_sigma)
        variance = independent - 2.0 * found.time_covariance
        assert 0.0 < variance < independent
        ratios.append((np.subtract(*(found.time - true))) ** 2 / variance)
        shared.append(found.time_covariance / independent)
    assert 0.6 < math.sqrt(np.mean(ratios)) < 1.5
    assert np.mean(shared) > 0.1


@pytest.mark.parametrize("width", [1e3, 2e3, 4e3, 8e3])
@pytest.mark.parametrize("seed", range(2))
def test_the_width_of_a_wall(width, seed):
    series, true = crossing(seed=seed, size=0.02, width=width)
    found = fit_edge_crossings(TIME, *series, EDGE + 90.0, is_dense_above=False, width=2e3)
    assert found is not None
    assert found.width == pytest.approx(width, rel=0.3)
    assert abs(found.width - width) < 4.0 * found.width_sigma + 0.05 * width
    assert (np.abs(found.time - true) < 4.0 * found.time_sigma).all()


@pytest.mark.parametrize(("shape", "most"), [("line", 2), ("erf", 2), ("cosine", 2), ("tanh", 3)])
def test_the_width_of_a_wall_of_any_shape_is_in_its_sigma(shape, most):
    """It is that of the line of the same second moment.

    The cosine lies between the shapes that are tried, tanh with its long feet beyond them.
    """
    ratios = []
    for width in (2e3, 4e3, 8e3):
        series, true = crossing(size=0.01, width=width, shape=shape)
        found = fit_edge_crossings(TIME, *series, EDGE + 90.0, is_dense_above=False, width=width)
        assert found is not None
        assert found.width == pytest.approx(width, rel=0.3)
        ratios.append((found.width - width) / found.width_sigma)
        assert (np.abs(found.time - true) < 4.0 * found.time_sigma).all()
    assert math.sqrt(np.mean(np.square(ratios))) < most


def test_an_edge_is_found_where_densities_show_it_exactly():
    """The search ends with parameters of 1e-13, a part of which is no step for a derivative."""
    series, true = crossing(size=0.0, seed=1, width=800.0)
    found = fit_edge_crossings(
        TIME, *series, EDGE, is_dense_above=False, width=800.0, altitude_sigma=741.3534977224307
    )
    assert found is not None
    assert (np.abs(found.time - true) < 4.0 * found.time_sigma).all()


def test_what_is_slow_is_in_the_sigma_of_the_difference_of_both_times():
    """Contents that walk by 0.1 TECU a minute: about wide walls and thin ones."""
    ratios = []
    for width in (100.0, 6e3):
        for seed in range(5):
            series, true = crossing(seed=seed, size=0.02, width=width, slow=0.1)
            found = fit_edge_crossings(
                TIME, *series, EDGE + 90.0, is_dense_above=False, width=width
            )
            assert found is not None
            variance = float(found.time_sigma @ found.time_sigma) - 2.0 * found.time_covariance
            ratios.append(np.subtract(*(found.time - true)) / math.sqrt(variance))
    assert 0.5 < math.sqrt(np.mean(np.square(ratios))) < 1.2


@pytest.mark.parametrize("width", [100.0, 300.0])
def test_the_sigma_of_the_width_of_a_thin_wall(width):
    """Some of the fits end with the thinnest wall that there is, which they do not know."""
    errors, sigmas = [], []
    for seed in range(4):
        series, _ = crossing(seed=seed, width=width)
        found = fit_edge_crossings(TIME, *series, EDGE + 90.0, is_dense_above=False, width=300.0)
        assert found is not None
        errors.append(found.width - width)
        sigmas.append(found.width_sigma)
    ratios = np.array(errors) / sigmas
    assert np.abs(ratios).max() < 3.0
    assert 0.2 < math.sqrt(np.mean(ratios**2)) < 1.5


def test_what_shows_no_edge_has_none():
    series, _ = crossing(size=0.0)
    flat = [
        ContentSeries(one.altitude + 5e3, 0.0 * one.stec, one.arc, one.elevation) for one in series
    ]
    assert fit_edge_crossings(TIME, *flat, EDGE, is_dense_above=False) is None
    # Dense on the other side: the fitted density is negative.
    assert fit_edge_crossings(TIME, *series, EDGE, is_dense_above=True) is None
    nothing = [
        ContentSeries(one.altitude, np.full_like(one.stec, np.nan), 0 * one.arc, one.elevation)
        for one in series
    ]
    assert fit_edge_crossings(TIME, *nothing, EDGE, is_dense_above=False) is None
    unknown = [
        ContentSeries(np.full_like(one.altitude, np.nan), one.stec, one.arc, one.elevation)
        for one in series
    ]
    assert fit_edge_crossings(TIME, *unknown, EDGE, is_dense_above=False) is None
