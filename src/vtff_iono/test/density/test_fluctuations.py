"""Fluctuations of contents and wrong integers of a second, against the plain formulas."""

import math

import numpy as np
import pytest

from vtff_iono.density.differential_tec import vertical_content
from vtff_iono.density.fluctuations import (
    LastErrors,
    add_changes,
    empty_fluctuations,
    mean_over_scatter,
    measure_fades,
    raise_doubted,
    weigh_contents,
)
from vtff_iono.density.integer_judgement import (
    BIAS_COUNT,
    BIAS_MEAN,
    OF_CODES,
    OF_GEOMETRY,
    find_wrong_integers,
    first_measured,
)
from vtff_iono.density.phase_differences import (
    DEVIATION_SQUARED,
    GEOMETRIC,
    STEC,
    STEP_SQUARED,
    WIDE_LANE,
)

LINKS = 6
PRN, SAMPLES = np.arange(3, 3 + LINKS), np.full(LINKS, 20)


def columns_of(scatter, noise=1e-4):
    """Means of links whose contents scatter, TECU^2, and have white noise, TECU^2."""
    columns = np.zeros((8, LINKS))
    columns[DEVIATION_SQUARED], columns[STEP_SQUARED] = scatter, 2.0 * noise
    return columns


def test_white_noise_is_averaged_and_fluctuation_is_not():
    table, scatter = empty_fluctuations(), np.array([1e-4, 1e-4, 0.1, 0.1, 0.5, 1e-4])
    sigma = weigh_contents(table, PRN, SAMPLES, columns_of(scatter), 1e-6)
    excess = np.where(scatter > 2e-4, scatter - 1e-4, 0.0)
    np.testing.assert_allclose(sigma, np.sqrt(1e-4 / 20 + 2.0 * excess))
    # The next second is quiet: fifteen seconds remember most of the one before.
    sigma = weigh_contents(table, PRN, SAMPLES, columns_of(1e-4), 1e-6)
    np.testing.assert_allclose(sigma, np.sqrt(1e-4 / 20 + 2.0 * excess * 14.0 / 15.0))


def test_fluctuation_has_ended_after_three_quiet_seconds_of_many():
    table = empty_fluctuations()
    weigh_contents(table, PRN, SAMPLES, columns_of(0.1), 1e-6)
    left = [weigh_contents(table, PRN, SAMPLES, columns_of(1e-4), 1e-6)[0] > 0.1 for _ in range(4)]
    assert left == [True, True, False, False]


@pytest.mark.parametrize("factor", [0.5, 4.0])
def test_geometry_shows_contents_that_fluctuate_more(factor):
    """The sigma of all that fluctuate is what their wide lanes scatter by."""
    table, generator = empty_fluctuations(), np.random.default_rng(2)
    scatter = np.array([0.1, 0.1, 0.1, 1e-4, 1e-4, 1e-4])
    columns = columns_of(scatter)
    sigma = weigh_contents(table, PRN, SAMPLES, columns, 1e-6)
    columns[GEOMETRIC] = factor * sigma * np.sign(generator.standard_normal(LINKS))
    expected, weight = sigma.copy(), 1.0 / (sigma**2 + 1e-6)
    shown = columns[GEOMETRIC]
    squares = (weight * (shown - weight @ shown / weight.sum()) ** 2)[:3].sum()
    expected[:3] *= math.sqrt(max(squares / (3.0 - weight[:3].sum() / weight.sum()), 1.0))
    raise_doubted(table, PRN, np.ones(LINKS, dtype=bool), columns, sigma, 0.0, 1.0, 1e-6)
    np.testing.assert_allclose(sigma, expected)


def test_fades_are_measured_by_changes_over_scatter():
    """Changes of half the scatter: the ratio goes from two towards a half."""
    table, generator = empty_fluctuations(), np.random.default_rng(3)
    columns = columns_of(0.1)
    for _ in range(200):
        errors = math.sqrt(0.05) * generator.standard_normal(LINKS)
        measure_fades(table, PRN, SAMPLES, columns, errors, np.full(LINKS, 0.3))
    assert 0.3 < mean_over_scatter(table) < 0.9


def test_a_change_counts_for_the_same_stretch_and_integers_only():
    table, columns = empty_fluctuations(), columns_of(1e-4)
    weigh_contents(table, PRN, SAMPLES, columns, 1e-6)
    integers = np.column_stack((np.full(LINKS, math.nan), np.arange(LINKS)))
    last = LastErrors(np.arange(LINKS), integers, np.zeros(LINKS))
    other = integers.copy()
    other[1, 1] += 1.0
    numbers = np.where(np.arange(LINKS) == 2, 99, np.arange(LINKS))
    now = LastErrors(numbers, other, np.array([1.0, 1.0, 1.0, 1e-4, 1.0, 0.0]))
    add_changes(table, PRN, SAMPLES, columns, last, now, 1e-6)
    expected = np.array([0.5, 0.0, 0.0, 0.0, 0.5, 0.0])
    np.testing.assert_allclose(table.excess[PRN], expected / 15.0)
    np.testing.assert_allclose(table.recent[-1, PRN], expected)


def judged(columns, errors, measured):
    """Return which of the integers are wrong, with sigmas of 0.01 TECU and 0.02 wide lanes."""
    sigma = np.full(LINKS, 0.01)
    none = np.zeros(LINKS, dtype=bool)
    wrong, is_any, _ = find_wrong_integers(
        columns, SAMPLES, errors, sigma, sigma, none, measured, 0.0, 1.0, 0.02, 5.0, 0.1, 1e-6
    )
    assert is_any == wrong.any()
    return wrong.tolist()


def test_wrong_integers_show_in_contents_and_in_both_wide_lanes():
    measured, columns = first_measured(), columns_of(1e-4)
    columns[WIDE_LANE], columns[STEC] = 0.3, 1.0
    nothing = np.zeros(LINKS)
    assert not any(judged(columns, nothing, measured))
    assert measured[BIAS_COUNT] == LINKS
    assert measured[BIAS_MEAN] == pytest.approx(0.3)
    # Errors of zero: the variances shrink as means of ten squares and those of this second do.
    assert measured[OF_CODES] == pytest.approx(0.01 * 10.0 / 13.0)
    assert measured[OF_GEOMETRY] == pytest.approx(0.0025 * 10.0 / 16.0)
    errors = np.where(np.arange(LINKS) == 1, 0.2, 0.0)
    assert judged(columns, errors, measured) == [False, True, *[False] * 4]
    columns[WIDE_LANE, 2], columns[GEOMETRIC, 4] = 1.3, -1.0
    before = measured.copy()
    assert judged(columns, errors, measured) == [False, True, True, False, True, False]
    assert measured[BIAS_COUNT] == before[BIAS_COUNT] + 3


def test_the_vertical_content_is_the_median_of_high_satellites():
    elevation = np.radians([20.0, 50.0, 60.0, 80.0, 70.0])
    rejected = np.array([0, 0, 0, 0, 1], dtype=np.uint16)
    slant, sigma = np.full(5, 20.0), np.full(5, 2.0)
    vertical = np.array([5.0, 10.0, 12.0, 11.0, 90.0])
    content, of_layer = vertical_content(rejected, elevation, slant, sigma, vertical, 0.5)
    assert content == 11.0
    assert of_layer == pytest.approx(math.hypot(1.1, 0.5))
    low = np.full(5, 0.3)
    assert math.isnan(vertical_content(rejected, low, slant, sigma, vertical, 0.5)[0])
