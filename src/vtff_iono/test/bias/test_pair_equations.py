"""Equations of pairs: which pairs, their columns, and a solution with a known answer."""

import math

import numpy as np
import pytest

from vtff_dynamics.frames.geodetic import itrf_from_geodetic
from vtff_gnss.orbits.line_of_sight import ellipsoid_normal
from vtff_iono.bias.bias_samples import BiasSamples, ReceiverBiasError
from vtff_iono.bias.pair_equations import (
    PairEquations,
    _normal_equations,
    count_pairs,
    satellite_pairs,
    solve_pairs,
)
from vtff_iono.geometry.mapping import thin_shell_mapping

SHELL = 450e3
LATITUDE, LONGITUDE = 0.3, 1.0
POSITION = itrf_from_geodetic([LATITUDE, LONGITUDE, 0.0])
UP = ellipsoid_normal(POSITION)
EAST = np.array([-math.sin(LONGITUDE), math.cos(LONGITUDE), 0.0])
NORTH = np.cross(UP, EAST)


def directions(elevation, azimuth):
    level = np.cos(azimuth)[:, None] * NORTH + np.sin(azimuth)[:, None] * EAST
    return np.sin(elevation)[:, None] * UP + np.cos(elevation)[:, None] * level


def drawn(
    vertical,
    biases=(5.0,),
    epochs=24,
    satellites=8,
    noise=0.0,
    seed=0,
    arcs=False,
    sector=2.0 * np.pi,
):
    """Return samples and their mapping; `vertical` gives the content (TECU) by time and ray."""
    generator = np.random.default_rng(seed)
    count = epochs * satellites
    time = np.repeat(600.0 * np.arange(epochs), satellites)
    elevation = generator.uniform(0.35, 1.5, count)
    azimuth = generator.uniform(0.0, sector, count)
    group = np.arange(count) % len(biases)
    mapping = thin_shell_mapping(elevation, np.linalg.norm(POSITION), SHELL)
    stec = vertical(time, elevation, azimuth) * mapping + np.array(biases)[group]
    samples = BiasSamples(
        time=time,
        group=group,
        stec_tecu=stec + noise * generator.standard_normal(count),
        stec_sigma_tecu=np.full(count, max(noise, 0.01)),
        elevation=elevation,
        direction_itrf=directions(elevation, azimuth),
        position_receiver_itrf=np.tile(POSITION, (count, 1)),
        arc=np.arange(count) % satellites if arcs else None,
    )
    return samples, mapping


def equations_of(samples, mapping, block=3600.0):
    pairs = satellite_pairs(samples.time)
    return PairEquations(samples, mapping, np.full(len(mapping), SHELL), *pairs, block), pairs


def constant(time, elevation, azimuth):
    return 12.0 + 0.0 * time


def test_pairs_are_all_of_one_epoch():
    first, second = satellite_pairs(np.array([0.0, 0.0, 0.0, 30.0, 60.0, 60.0]))
    assert [*zip(first.tolist(), second.tolist(), strict=True)] == [(0, 1), (0, 2), (1, 2), (4, 5)]
    first, second = satellite_pairs(np.zeros(0))
    assert len(first) == len(second) == 0


def test_columns_of_a_pair():
    samples, mapping = drawn(constant, biases=(5.0, -3.0), epochs=14, satellites=3)
    equations, (first, second) = equations_of(samples, mapping)
    inverse = 1.0 / mapping
    for row in (0, 1, 2, 20):
        i, j = first[row], second[row]
        design = np.zeros((2, 2))
        design[0, samples.group[i]] = inverse[i]
        design[1, samples.group[j]] = inverse[j]
        assert equations.design[row] == pytest.approx(design[0] - design[1])
        assert equations.mean_design[row] == pytest.approx(0.5 * (design[0] + design[1]))
        vertical = samples.stec_tecu[[i, j]] * inverse[[i, j]]
        assert equations.difference[row] == pytest.approx(vertical[0] - vertical[1])
        assert equations.mean_vertical[row] == pytest.approx(0.5 * vertical.sum())
        assert equations.elevation[row] == min(samples.elevation[i], samples.elevation[j])
        sigma = samples.stec_sigma_tecu[[i, j]] * inverse[[i, j]]
        assert equations.noise[row] == pytest.approx((sigma**2).sum() + 2.0 * 0.3**2)
        assert equations.block[row] == samples.time[i] // 3600.0
    assert np.unique(equations.block).tolist() == [0, 1, 2]


def test_separations_are_those_of_the_pierce_points():
    """Two rays to the east and north at 30 deg: 650 km from the receiver at 450 km height."""
    elevation = np.array([0.5 * np.pi, math.radians(30.0), math.radians(30.0)])
    direction = directions(elevation, np.array([0.0, 0.5 * np.pi, 0.0]))
    samples = BiasSamples(
        time=np.zeros(3),
        group=np.zeros(3, dtype=np.int64),
        stec_tecu=np.zeros(3),
        stec_sigma_tecu=np.ones(3),
        elevation=elevation,
        direction_itrf=direction,
        position_receiver_itrf=np.tile(POSITION, (3, 1)),
    )
    equations, _ = equations_of(samples, np.ones(3))
    radius = np.linalg.norm(POSITION)
    angle = math.radians(60.0) - math.asin(radius / (radius + SHELL) * math.cos(math.radians(30.0)))
    arc = 1e-6 * (radius + SHELL) * angle
    assert equations.separation[:2] * 1e-6 == pytest.approx(arc, rel=0.01)
    # First less second, in 1000 km: the second ray is to the east, the third to the north.
    assert equations.structure[0, :2] == pytest.approx((-arc, 0.0), abs=0.02)
    assert equations.structure[1, :2] == pytest.approx((0.0, -arc), abs=0.02)
    assert equations.structure[2, :2] == pytest.approx((arc, -arc), abs=0.03)
    # The third ray is as far to the north as the others are not.
    assert equations.structure[:, 2] == pytest.approx((0.0, -(arc**2), -(arc**2)), abs=0.03)


def test_elevations_select_pairs_with_all_their_columns():
    equations, _ = equations_of(*drawn(constant))
    above = equations.above(0.8)
    chosen = equations.elevation >= 0.8
    assert 0 < chosen.sum() < len(chosen)
    for name, value in vars(equations).items():
        assert np.array_equal(getattr(above, name), value[chosen])


@pytest.mark.parametrize("structure", [0, 2, 3])
def test_biases_of_a_uniform_ionosphere(structure):
    samples, mapping = drawn(constant, biases=(5.0, -3.0))
    equations, _ = equations_of(samples, mapping)
    biases, sigma, _ = solve_pairs(equations, structure)
    assert biases == pytest.approx([5.0, -3.0], abs=1e-6)
    assert (sigma < 1e-6).all()


def test_gradients_are_told_from_the_bias():
    """Content that grows by a tenth in 1000 km to the east and to the north.

    All satellites are in the north-east, where it looks like a bias.
    """

    def sloping(time, elevation, azimuth):
        radius = np.linalg.norm(POSITION)
        angle = 0.5 * np.pi - elevation - np.arcsin(radius / (radius + SHELL) * np.cos(elevation))
        way = 1e-6 * (radius + SHELL) * angle
        return 12.0 * (1.0 + 0.1 * way * np.sin(azimuth) + 0.1 * way * np.cos(azimuth))

    equations, _ = equations_of(*drawn(sloping, sector=0.5 * np.pi))
    with_gradients = solve_pairs(equations, 2).bias_tecu
    without, sigma, _ = solve_pairs(equations, 0)
    # The gradient is linear in the distance, not in latitude and longitude.
    assert with_gradients[0] == pytest.approx(5.0, abs=0.2)
    assert abs(without[0] - 5.0) > 2.0 * abs(with_gradients[0] - 5.0)
    assert sigma[0] > 0.02


def test_a_crest_above_the_station_is_told_from_the_bias():
    """Content that falls to the north and to the south, as by the equatorial anomaly."""

    def crest(time, elevation, azimuth):
        radius = np.linalg.norm(POSITION)
        angle = 0.5 * np.pi - elevation - np.arcsin(radius / (radius + SHELL) * np.cos(elevation))
        north = 1e-6 * (radius + SHELL) * angle * np.cos(azimuth)
        return 40.0 * (1.0 - 0.3 * north**2)

    equations, _ = equations_of(*drawn(crest))
    errors = [abs(solve_pairs(equations, structure)[0][0] - 5.0) for structure in (2, 3)]
    assert errors[1] < 0.3
    assert errors[0] > 1.0


def test_errors_are_as_large_as_the_sigmas():
    ratios = []
    for seed in range(30):
        equations, _ = equations_of(*drawn(constant, noise=0.5, seed=seed))
        biases, sigma, _ = solve_pairs(equations, 0)
        ratios.append((biases[0] - 5.0) / sigma[0])
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.5


def test_outliers_count_little():
    samples, mapping = drawn(constant, noise=0.1)
    stec = samples.stec_tecu.copy()
    stec[::40] += 60.0
    bad = BiasSamples(**{**vars(samples), "stec_tecu": stec})
    equations, _ = equations_of(bad, mapping)
    biases = solve_pairs(equations, 0).bias_tecu
    assert biases[0] == pytest.approx(5.0, abs=1.0)


def test_errors_of_levels_are_in_the_sigma():
    """Computed by moving each level by one sigma and solving the normal equations again."""
    samples, mapping = drawn(constant, noise=0.3, arcs=True)
    equations, (first, second) = equations_of(samples, mapping)
    weight = 1.0 / equations.noise
    matrix = (equations.design * weight[:, None]).T @ equations.design
    moved = []
    for arc in range(8):
        shift = np.where(samples.arc == arc, samples.stec_sigma_tecu / mapping, 0.0)
        difference = shift[first] - shift[second]
        moved.append(np.linalg.solve(matrix, equations.design.T @ (weight * difference)))
    expected = np.sqrt(np.sum(np.square(moved), axis=0))
    assert equations.level_sigma(weight, matrix) == pytest.approx(expected)
    sigma = solve_pairs(equations, 0).sigma_tecu
    alone = BiasSamples(**{**vars(samples), "arc": None})
    without, _ = equations_of(alone, mapping)
    assert without.level_sigma(weight, matrix).tolist() == [0.0]
    assert solve_pairs(without, 0)[1][0] < sigma[0]


def test_what_cannot_be_solved_is_named():
    samples, mapping = drawn(constant, biases=(5.0, -3.0))
    only = samples.select(samples.group == 1)
    equations, _ = equations_of(only, mapping[samples.group == 1])
    with pytest.raises(ReceiverBiasError, match="a group has no pairs"):
        solve_pairs(equations, 0)
    # A single block leaves nothing to a jackknife.
    equations, _ = equations_of(samples, mapping, block=1e6)
    assert np.isinf(solve_pairs(equations, 0)[1]).all()


@pytest.mark.parametrize("columns", [1, 2, 5])
def test_normal_equations_are_those_of_each_block(columns):
    generator = np.random.default_rng(columns)
    design, observed = generator.standard_normal((40, columns)), generator.standard_normal(40)
    weight, starts = generator.random(40), np.array([0, 3, 20, 39])
    matrices, vectors = _normal_equations(design, observed, weight, starts)
    for block, rows in enumerate(np.split(np.arange(40), starts[1:])):
        weighted = design[rows].T * weight[rows]
        np.testing.assert_allclose(matrices[block], weighted @ design[rows], rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(
            vectors[block], weighted @ observed[rows], rtol=1e-12, atol=1e-14
        )


@pytest.mark.parametrize("seed", range(3))
def test_number_of_pairs_is_that_of_their_indices(seed):
    time = np.sort(np.random.default_rng(seed).integers(0, 10, 40)).astype(float)
    assert count_pairs(time) == len(satellite_pairs(time)[0])
    assert count_pairs(time[:1]) == count_pairs(time[:0]) == 0
