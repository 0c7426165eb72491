"""The width of a wall by densities and contents together, against closed forms and drawn walls."""

import math

import numpy as np
import pytest

from vtff_iono.edges.wall_width import combine_widths


def test_of_wide_walls_it_is_the_weighted_mean():
    width, sigma = combine_widths(8.2e3, 0.4e3, 8.0e3, 0.3e3, 2.0 * 8.0e3 * 0.3e3)
    assert width == pytest.approx((8.2 / 0.4**2 + 8.0 / 0.3**2) / (0.4**-2 + 0.3**-2) * 1e3, abs=20)
    assert sigma == pytest.approx(0.24e3, rel=0.05)


def test_of_contents_alone_the_width_of_a_thin_wall_is_that_of_their_square():
    """Where W^2 = 0 +- q, the mean of W is q^0.5 2^0.25 Gamma(1/2) / Gamma(1/4)."""
    width, sigma = combine_widths(math.nan, math.nan, 0.0, 500.0, 500.0**2)
    mean = 500.0 * 2.0**0.25 * math.gamma(0.5) / math.gamma(0.25)
    square = 500.0**2 * math.sqrt(2.0) * math.gamma(0.75) / math.gamma(0.25)
    assert width == pytest.approx(mean, abs=10.0)
    assert sigma == pytest.approx(math.sqrt(square - mean**2), rel=0.05)


def test_what_disagrees_is_less_sure():
    agreed = combine_widths(5.0e3, 0.5e3, 5.1e3, 0.5e3, 2.0 * 5.1e3 * 0.5e3)[1]
    apart = combine_widths(3.0e3, 0.5e3, 7.0e3, 0.5e3, 2.0 * 7.0e3 * 0.5e3)[1]
    assert apart > 3.0 * agreed


def test_errors_of_drawn_walls_are_those_of_the_sigma():
    generator = np.random.default_rng(0)
    ratios = []
    for true in np.exp(generator.uniform(math.log(300.0), math.log(15e3), 300)):
        square_sigma = 1.5e6
        square = true**2 + square_sigma * generator.standard_normal()
        by_contents = math.sqrt(max(square, 0.0))
        sigma = min(math.sqrt(square_sigma), 0.5 * square_sigma / max(by_contents, 1.0))
        by_densities = abs(true + 800.0 * generator.standard_normal())
        width, stated = combine_widths(by_densities, 800.0, by_contents, sigma, square_sigma)
        ratios.append((width - true) / stated)
    assert 0.8 < math.sqrt(np.mean(np.square(ratios))) < 1.2
