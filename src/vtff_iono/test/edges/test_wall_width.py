"""The width of a wall by densities and contents together, against closed forms and drawn walls."""

import math

import numpy as np
import pytest
from scipy import integrate, special

from vtff_iono.edges.wall_fit import SMOOTH_WALL, WALL, fit_wall
from vtff_iono.edges.wall_width import (
    WALL_SHAPES,
    WidthsByShape,
    combine_widths,
    shape_misfits,
    wall_integrals,
)


def by_densities(width, sigma, misfit=(0.0, 1e3)):
    """Widths that are the same for each shape; as a rule the second one is none."""
    return WidthsByShape(np.full(2, width), np.full(2, sigma), np.array(misfit))


def by_contents(width, square_sigma, misfit=(0.0, 1e3)):
    return WidthsByShape(np.full(2, width), np.full(2, square_sigma), np.array(misfit), True)


def test_of_wide_walls_it_is_the_weighted_mean():
    width, sigma = combine_widths(by_densities(8.2e3, 0.4e3), by_contents(8e3, 2.0 * 8e3 * 0.3e3))
    assert width == pytest.approx((8.2 / 0.4**2 + 8.0 / 0.3**2) / (0.4**-2 + 0.3**-2) * 1e3, abs=20)
    assert sigma == pytest.approx(0.24e3, rel=0.05)


def test_of_contents_alone_the_width_of_a_thin_wall_is_that_of_their_square():
    """Where W^2 = 0 +- q, the mean of W is q^0.5 2^0.25 Gamma(1/2) / Gamma(1/4)."""
    width, sigma = combine_widths(by_contents(0.0, 500.0**2))
    mean = 500.0 * 2.0**0.25 * math.gamma(0.5) / math.gamma(0.25)
    square = 500.0**2 * math.sqrt(2.0) * math.gamma(0.75) / math.gamma(0.25)
    assert width == pytest.approx(mean, abs=10.0)
    assert sigma == pytest.approx(math.sqrt(square - mean**2), rel=0.05)


def test_what_disagrees_is_less_sure():
    agreed = combine_widths(by_densities(5e3, 0.5e3), by_contents(5.1e3, 2.0 * 5.1e3 * 0.5e3))[1]
    apart = combine_widths(by_densities(3e3, 0.5e3), by_contents(7e3, 2.0 * 7e3 * 0.5e3))[1]
    assert apart > 3.0 * agreed


def test_a_shape_that_is_not_known_is_in_the_sigma():
    widths = WidthsByShape(np.array([8e3, 10e3]), np.array([0.1e3, 0.1e3]), np.zeros(2))
    width, sigma = combine_widths(widths)
    assert width == pytest.approx(9e3, abs=20.0)
    assert sigma == pytest.approx(math.hypot(1e3, 0.1e3), rel=0.02)


def test_satellites_tell_of_the_shape_what_they_agree_about():
    line, agreed, apart = np.zeros(8), np.full(8, 2.0), np.array([20.0, -16.0] * 4)
    assert np.diff(shape_misfits(np.array([line, agreed])))[0] == pytest.approx(16.0, abs=0.1)
    assert 0.0 < np.diff(shape_misfits(np.array([line, apart])))[0] < 2.0
    assert np.diff(shape_misfits(np.array([[1.0], [3.0]])))[0] == pytest.approx(2.0)


def test_errors_of_drawn_walls_are_those_of_the_sigma():
    generator = np.random.default_rng(0)
    ratios = []
    for true in np.exp(generator.uniform(math.log(300.0), math.log(15e3), 300)):
        square_sigma = 1.5e6
        square = true**2 + square_sigma * generator.standard_normal()
        told = by_densities(abs(true + 800.0 * generator.standard_normal()), 800.0)
        width, stated = combine_widths(told, by_contents(math.sqrt(max(square, 0.0)), square_sigma))
        ratios.append((width - true) / stated)
    assert 0.8 < math.sqrt(np.mean(np.square(ratios))) < 1.2


def part_of_wall(shape, place):
    """Part of a wall of the width of one that has been crossed."""
    if shape:
        return float(special.ndtr(place * math.sqrt(12.0)))
    return min(max(place + 0.5, 0.0), 1.0)


@pytest.mark.parametrize("shape", range(len(WALL_SHAPES)))
def test_integrals_of_a_wall(shape):
    depths = np.array([-1.0, -0.3, 0.2, 0.45, 3.0])
    for power, found in enumerate(wall_integrals(shape, depths * 4.0, 4.0)):
        for depth, value in zip(depths, found, strict=True):
            expected, _ = integrate.quad(
                lambda place, power=power: part_of_wall(shape, place) * place**power,
                *(-4.0, depth),
                points=[-0.5] if depth > -0.5 else None,
            )
            assert value == pytest.approx(4.0 ** (power + 1) * expected, abs=1e-6)


@pytest.mark.parametrize(("kind", "shape"), [(WALL, 0), (SMOOTH_WALL, 1)])
def test_densities_of_a_wall_of_each_shape_are_fitted_exactly(kind, shape):
    """They are means over the length between the spacecraft."""
    altitude = np.arange(-12e3, 12e3, 600.0)
    first, last = (wall_integrals(shape, altitude + side * 1.5e3, 4e3)[0] for side in (-0.5, 0.5))
    samples = np.zeros((len(altitude), 5))
    samples[:, 0], samples[:, 1] = altitude / 300.0, altitude
    samples[:, 2] = 2e11 + 1e11 * (last - first) / 1.5e3
    samples[:, 3] = 1e9
    misfits = [
        fit_wall(
            *(samples, np.zeros((len(samples), 0)), 1.0, 0.0, 12e3, 4e3, 1.5e3, 100.0, 1e-4),
            *(len(samples), 1, 1, tried),
        )[5]
        for tried in (kind, WALL + SMOOTH_WALL - kind)
    ]
    assert misfits[0] < 1e-6 < 1.0 < misfits[1]
