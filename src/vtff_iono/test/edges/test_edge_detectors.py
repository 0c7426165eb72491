"""Edges of a bubble, horizontal edges of rays, scores of minutes, the lag between spacecraft."""

import math

import numpy as np
import pytest
from formation_simulation import NOISE_ONE_SECOND, chapman, mean_density

from vtff_dynamics.frames.geodetic import itrf_from_geodetic
from vtff_gnss.orbits.line_of_sight import ellipsoid_normal
from vtff_iono.edges.density_edges import DensityEdgeDetector
from vtff_iono.edges.edge_detectors import (
    ExceedanceDetector,
    edge_position,
    intensity_variance,
)
from vtff_iono.edges.wall_fit import KINK, LAYER, PARABOLA, WALL, fit_wall
from vtff_iono.edges.window_scores import score_windows
from vtff_iono.scintillation.fluctuation_lag import fluctuation_lag

BOTTOM, TOP = 290e3, 350e3


def smeared_step(distance, width, length):
    """A wall that rises linearly from 0 to 1 over its width, averaged over a length besides."""
    first, second = max(width, 1e-3), max(length, 1e-3)
    ends = (first + second, first - second, second - first, -first - second)
    total = sum(
        sign * np.maximum(distance + 0.5 * end, 0.0) ** 2
        for sign, end in zip((1.0, -1.0, -1.0, 1.0), ends, strict=True)
    )
    return total / (2.0 * first * second)


def bubble():
    """The paper's region: a plateau of the content from 290 to 350 km, edges 100 m wide."""
    altitude = np.arange(150e3, 1000e3, 10.0)
    inside = np.interp(altitude, [BOTTOM - 50, BOTTOM + 50, TOP - 50, TOP + 50], [0.0, 1, 1, 0])
    density = (1.0 - inside) * chapman(altitude, 1.9e12) + inside * 1.2e10
    return altitude, density


def pass_through(rising, offset=984.9, seed=0, speed=296.0):
    """Densities each second of a pass through the bubble with the noise of eight satellites."""
    time = np.arange(0.0, 400.0)
    chief = 265e3 + speed * time if rising else 265e3 + speed * (399.0 - time)
    sigma = NOISE_ONE_SECOND / math.sqrt(8.0) * 1e16 / abs(offset)
    low = np.minimum(chief, chief + offset)
    density = mean_density(*bubble(), low, low + abs(offset))
    density = density + sigma * np.random.default_rng(seed).standard_normal(len(time))
    return time, chief, chief + 0.5 * offset, density, np.full(len(time), sigma)


def found(rising, **options):
    time, _, altitude, density, sigma = pass_through(rising, **options)
    separation = options.get("offset", 984.9)
    detector = DensityEdgeDetector()
    edges = []
    for sample in zip(time, altitude, density, sigma, strict=True):
        edges += detector.update(sample[0], sample[1], separation, sample[2], sample[3])
    return [edge for edge in (*edges, *detector.flush()) if not edge.is_doubtful]


@pytest.mark.parametrize("rising", [True, False])
@pytest.mark.parametrize("offset", [984.9, -984.9, 300.0])
@pytest.mark.parametrize("seed", range(4))
def test_vertical_edges_within_100_m(rising, offset, seed):
    edges = found(rising, offset=offset, seed=seed)
    expected = [BOTTOM, TOP] if rising else [TOP, BOTTOM]
    assert [edge.is_entry for edge in edges] == [True, False]
    assert [edge.altitude for edge in edges] == pytest.approx(expected, abs=100.0)
    assert all(edge.confidence > 0.9 and edge.time_sigma < 0.5 for edge in edges)


def test_no_edge_in_a_smooth_layer_with_noise():
    generator = np.random.default_rng(1)
    detector = DensityEdgeDetector()
    edges = []
    for second, altitude in enumerate(np.arange(236e3, 567e3, 296.0)):
        density = float(chapman(altitude)) + 1.5e10 * generator.standard_normal()
        edges += detector.update(float(second), altitude, 985.0, density, 1.5e10)
    assert [*edges, *detector.flush()] == []


def test_an_edge_with_samples_at_its_middle_is_among_them():
    """Three of the densities of the edge are exactly half the sum of those on both sides."""
    density = np.concatenate((np.full(30, 1e12), np.full(3, 5e11), np.zeros(30)))
    detector = DensityEdgeDetector()
    edges = []
    for second, value in enumerate(density.tolist()):
        edges += detector.update(float(second), 300e3 + 296.0 * second, 985.0, value, 1e9)
    (edge,) = [*edges, *detector.flush()]
    assert edge.is_entry
    # Levels are those of the fitted wall, so that the middle may lie just beside the three.
    assert (edge.before, edge.after) == pytest.approx((1e12, 0.0), abs=6e10)
    assert 29.9 <= edge.time <= 32.1
    assert edge.altitude == pytest.approx(300e3 + 296.0 * edge.time)


@pytest.mark.parametrize(
    ("passes", "kind"), [(1, WALL), (2, WALL), (3, WALL), (1, PARABOLA), (1, KINK)]
)
def test_the_compiled_fit_is_generalised_least_squares(passes, kind):
    """Against the textbook's formulas with the whole covariance, for groups of up to 24 samples."""
    generator = np.random.default_rng(3)
    length, slow_time = 985.0, 100.0
    fitted = 0
    for count in (5, 9, 17, 24, 25, 31, 60):
        for width in (0.0, 2e3, 20e3):
            direction = generator.choice((-1.0, 1.0))
            reach = 0.55 * (width + length) + 3e3
            altitude = direction * np.sort(generator.uniform(-reach, reach, count)) + 300e3
            time = np.cumsum(generator.uniform(0.5, 2.0, count))
            density = 1e12 + 1e11 * generator.standard_normal(count)
            samples = np.stack(
                (
                    time,
                    altitude,
                    density,
                    generator.uniform(1e9, 1e10, count),
                    np.random.default_rng(count).uniform(1e9, 5e9, count),
                ),
                axis=1,
            )
            slow = 3e10 * generator.standard_normal((count, 4))
            steepest = 1e-4
            found = fit_wall(
                samples,
                slow,
                direction,
                direction * 300e3,
                reach,
                width,
                length,
                slow_time,
                steepest,
                24,
                3,
                passes,
                kind,
            )
            groups = np.array_split(np.arange(count), count)
            if count > 24:
                number = np.arange(count) * 24 // count
                groups = [np.flatnonzero(number == group) for group in range(24)]
            mean = np.array([samples[group].mean(axis=0) for group in groups])
            parts = np.array([slow[group].mean(axis=0) for group in groups])
            distance = direction * mean[:, 1] - direction * 300e3
            half = 0.5 * (width + length)
            is_enough = min(np.sum(distance < -half), np.sum(distance > half)) >= 3
            assert found[0] == (is_enough and count >= 6)
            if not found[0]:
                continue
            fitted += 1
            lag = np.abs(np.subtract.outer(mean[:, 0], mean[:, 0]))
            covariance = (parts @ parts.T) * np.exp(-lag / slow_time)
            covariance += np.diag([np.mean(samples[g, 3] ** 2) / len(g) for g in groups])
            common = np.array([np.mean(samples[g, 4] ** 2) for g in groups])
            covariance += np.minimum.outer(common, common)
            wall = smeared_step(distance, width, length) - 0.5
            if kind == PARABOLA:
                wall = (distance / reach) ** 2
            elif kind == KINK:
                wall = np.abs(distance) / reach
            weight = np.linalg.inv(covariance)
            level_sigma = math.sqrt(np.diag(covariance).mean())
            prior = np.zeros((3, 3))
            prior[1, 1] = (steepest * reach * (mean[:, 2].mean() + level_sigma)) ** -2
            slope = distance / reach
            for _ in range(passes):
                design = np.stack((np.ones(len(mean)), slope, wall), axis=-1)
                normal = np.linalg.inv(design.T @ weight @ design + prior)
                expected = normal @ design.T @ weight @ mean[:, 2]
                ratio = np.clip(expected[2] / expected[0], -1.9, 1.9)
                slope = distance / reach
                if kind == WALL and passes > 2:
                    growth = np.clip(expected[1] / expected[0], -1.0, 1.0)
                    slope = np.expm1(growth * slope) / growth
                slope = slope * (1.0 + ratio * wall)
            residual = mean[:, 2] - design @ expected
            misfit = residual @ weight @ residual + expected @ prior @ expected
            freedom = max(1, len(mean) - 3)
            assert found[1:4] == pytest.approx(expected, rel=1e-8)
            expected_sigma = math.sqrt(normal[2, 2] * max(1.0, misfit / freedom))
            white = np.linalg.solve(np.linalg.cholesky(covariance), residual)
            correlation = white[1:] @ white[:-1] / (white @ white)
            expected = (expected_sigma, misfit, freedom, correlation)
            assert found[4:] == pytest.approx(expected, rel=1e-8, abs=1e-8)
    assert fitted >= 12


def correlated(generator, count, sigma, time):
    """Errors that are correlated over a time, s, one each second."""
    decay = math.exp(-1.0 / time)
    errors = np.empty(count)
    errors[0] = generator.standard_normal()
    for second in range(1, count):
        step = math.sqrt(1.0 - decay**2) * generator.standard_normal()
        errors[second] = decay * errors[second - 1] + step
    return sigma * errors


def detected(time, altitude, density, fast_sigma, slow_sigma, separation=985.0):
    """Return the edges that densities tell alone."""
    detector = DensityEdgeDetector()
    edges = []
    for sample in zip(time, altitude, density, strict=True):
        edges += detector.update(
            sample[0], sample[1], separation, sample[2], fast_sigma, {1: slow_sigma}, 100.0
        )
    return [edge for edge in (*edges, *detector.flush()) if not edge.is_doubtful]


def test_errors_that_are_correlated_are_no_edges():
    """Multipath of 1.5 mm is 5e4 cm-3 over 1 km, and wanders within 100 s."""
    altitude = np.arange(250e3, 310e3, 270.0)
    time = np.arange(len(altitude), dtype=float)
    found_with_all, found_as_white = 0, 0
    for seed in range(6):
        generator = np.random.default_rng(seed)
        errors = correlated(generator, len(time), 5e10, 100.0)
        errors += 5e9 * generator.standard_normal(len(time))
        density = 2e11 + errors
        found_with_all += len(detected(time, altitude, density, 5e9, 5e10))
        found_as_white += len(detected(time, altitude, density, 1e10, 0.0))
    assert found_with_all == 0
    # The test would see a detector that takes them for white.
    assert found_as_white >= 2


@pytest.mark.parametrize("width", [2e3, 5e3, 10e3, 20e3])
@pytest.mark.parametrize("depth", [0.6])
def test_gradual_walls_are_edges_with_a_width(width, depth):
    altitude = np.arange(350e3, 430e3, 270.0)
    table = np.arange(250e3, 560e3, 50.0)
    missing = np.interp(table, [390e3 - width / 2, 390e3 + width / 2], [0.0, depth])
    profile = chapman(table, 1e12) * (1.0 - missing)
    time = np.arange(len(altitude), dtype=float)
    truth = mean_density(table, profile, altitude - 492.5, altitude + 492.5)
    generator = np.random.default_rng(4)
    density = truth + correlated(generator, len(time), 1e10, 100.0)
    density += 5e9 * generator.standard_normal(len(time))
    (edge,) = detected(time, altitude, density, 5e9, 1e10)
    assert edge.is_entry
    assert edge.altitude == pytest.approx(390e3, abs=0.3 * width)
    assert 0.4 * width <= edge.width <= 2.5 * width


def test_a_wall_in_unsure_densities_is_found_with_more_of_them():
    """The change is four times the sigma of a second, as after scintillation."""
    time, sigma, wall, found = np.arange(300.0), 1.6e11, 308e3, 0
    for seed in range(12):
        noise = sigma * np.random.default_rng(seed).standard_normal(len(time))
        altitude = 270e3 + 255.0 * time
        density = np.where(altitude < wall, 6.4e11, 1e10) + noise
        edges = detected(time, altitude, density, sigma, 0.0)
        assert len(edges) <= 1
        found += sum(abs(edge.altitude - wall) < 1500.0 and edge.is_entry for edge in edges)
        if seed % 3 == 0:
            assert detected(time, altitude, 6.4e11 + noise, sigma, 0.0) == []
    assert found >= 11


def test_the_ledge_below_a_layer_is_no_edge():
    """Densities that grow by a factor of ten in 8 km, as at the bottom of a layer."""
    altitude = np.arange(270e3, 350e3, 230.0)
    table = np.arange(150e3, 600e3, 50.0)
    time = np.arange(len(altitude), dtype=float)
    truth = mean_density(table, chapman(table, 1e12, 378e3, 35e3), altitude - 500, altitude + 500)
    for seed in range(2):
        generator = np.random.default_rng(seed)
        noise = 1e10 * generator.standard_normal(len(time))
        assert detected(time, altitude, truth + noise, 1e10, 0.0) == []


def test_a_step_where_another_satellite_joins_is_no_edge():
    """A new satellite brings its own multipath; with the old ones alone the step is an edge."""
    joined = []
    for parts_after in ({1: 1e11}, {1: 5e10, 2: 9e10}):
        detector, edges = DensityEdgeDetector(), []
        for second in range(160):
            density, parts = (6e11, {1: 1e11}) if second < 80 else (8e11, parts_after)
            edges += detector.update(
                float(second), 300e3 + 270.0 * second, 985.0, density, 1e9, parts, 1000.0
            )
        joined.append(len([*edges, *detector.flush()]))
    assert joined == [1, 0]


@pytest.mark.parametrize(("common_sigma", "is_told"), [(1e9, True), (8e10, False)])
def test_what_the_estimator_has_learned_is_no_edge(common_sigma, is_told):
    """A step of 1.6e11 where more is known than before; with as much known it is a wall."""
    generator, detector, edges = np.random.default_rng(3), DensityEdgeDetector(), []
    for second in range(120):
        is_late = second >= 60
        edges += detector.update(
            float(second),
            300e3 + 290.0 * second,
            985.0,
            5e11 + (1.6e11 if is_late else 0.0) + 5e9 * generator.standard_normal(),
            5e9,
            common_sigma=1e9 if is_late else common_sigma,
        )
    assert bool(edges + detector.flush()) == is_told


def test_the_foot_of_a_wide_wall_is_no_wall_of_the_other_sense():
    altitude = 390e3 - 320.0 * np.arange(100.0)
    density = np.interp(-altitude, [-380e3, -374e3], [4.4e11, 11.2e11])
    edges = detected(np.arange(100.0), altitude, density, 5e9, 1e9, separation=6900.0)
    assert [edge.is_entry for edge in edges] == [False]


@pytest.mark.parametrize("scale_height", [28e3, 60e3])
@pytest.mark.parametrize("separation", [2e3, 7.5e3])
def test_a_wall_against_the_slope_of_its_layer_is_told(scale_height, separation):
    """Spacecraft that are far apart smear the lower wall of a shallow bubble over up to 25 s.

    In a descent below the peak densities fall by as much before, and go on to fall behind.
    """
    altitude = 385e3 - 310.0 * np.arange(190.0)
    time = np.arange(len(altitude), dtype=float)
    table = np.arange(280e3, 420e3, 50.0)
    profile = 5e11 * np.exp((table - 350e3) / scale_height) * np.where(table > 355e3, 0.74, 1.0)
    half = 0.5 * separation
    truth = mean_density(table, profile, altitude - half, altitude + half)
    for seed in range(3):
        noise = 1e10 * np.random.default_rng(seed).standard_normal(len(altitude))
        (edge,) = detected(time, altitude, truth + noise, 1e10, 5e9, separation=separation)
        assert not edge.is_entry
        assert abs(edge.time - (385e3 - 355e3) / 310.0) < 2.5 * edge.time_sigma < 5.0


@pytest.mark.parametrize("seed", range(3))
def test_a_wall_in_which_densities_go_on_again_is_told(seed):
    """As behind a bubble in which all phases were lost; nothing was seen of its inside."""
    altitude = 300e3 + 210.0 * np.arange(450.0)
    is_seen = (altitude < 318e3) | (altitude > 350e3)
    inside = np.interp(altitude, [318.5e3, 320e3, 349.6e3, 351.3e3], [0.0, 1.0, 1.0, 0.0])
    density = 1.5e12 * (1.0 - 0.85 * inside)
    density += 2e10 * np.random.default_rng(seed).standard_normal(len(density))
    density[~is_seen] = np.nan
    (edge,) = detected(np.arange(450.0), altitude, density, 2e10, 3e10, separation=1700.0)
    assert not edge.is_entry
    assert abs(edge.altitude - 350.45e3) < 4.0 * 210.0 * edge.time_sigma < 3e3


def test_the_sigma_of_a_place_contains_that_fades_go_on_for_seconds():
    """Errors that are as large as they are said to be, but correlated over two seconds."""
    ratios = []
    for seed in range(24):
        generator = np.random.default_rng(seed)
        altitude = 300e3 + 230.0 * np.arange(160.0)
        truth = np.interp(altitude, [317e3, 319e3], [1.5e12, 5e11])
        density = truth + correlated(generator, len(altitude), 9e10, 2.0)
        edges = detected(np.arange(160.0), altitude, density, 9e10, 1e9, separation=2000.0)
        errors = [(edge.altitude - 318e3, 230.0 * edge.time_sigma) for edge in edges]
        ratios += [error / sigma for error, sigma in errors if abs(error) < 4e3]
    assert len(ratios) >= 22
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.1


@pytest.mark.parametrize("scale_height", [8e3, 35e3, 110e3])
@pytest.mark.parametrize("direction", [-1.0, 1.0])
def test_a_density_that_bends_is_no_edge(scale_height, direction):
    """Exponential layers of many densities that are well known."""
    generator = np.random.default_rng(5)
    altitude = 400e3 + direction * 250.0 * np.arange(-120.0, 120.0)
    density = 8e11 * np.exp((altitude - 430e3) / scale_height)
    density += 2e9 * generator.standard_normal(len(density))
    for separation in (985.0, 7000.0):
        assert not detected(np.arange(240.0), altitude, density, 2e9, 1e9, separation)


def test_a_doubtful_edge_hides_no_wall_and_is_told_last():
    """A wall of five sigmas and one of four and a half; contents may confirm that one."""
    altitude = 300e3 + 250.0 * np.arange(320.0)
    generator = np.random.default_rng(2)
    density = 1e12 - 0.9e11 * (altitude > 340e3) - 4e11 * (altitude > 352e3)
    density = density + 5e10 * generator.standard_normal(len(altitude))
    detector, edges = DensityEdgeDetector(relative_change=0.05), []
    for time, (height, value) in enumerate(zip(altitude, density, strict=True)):
        edges += [(height, e) for e in detector.update(time, height, 985.0, value, 5e10)]
    ((at_sure, sure),) = [pair for pair in edges if not pair[1].is_doubtful]
    assert len(edges) == 2
    assert sure.altitude == pytest.approx(352e3, abs=0.5e3)
    for at, edge in edges:
        if edge.is_doubtful:
            assert abs(edge.altitude - 352e3) > 4e3
            assert at - edge.altitude > at_sure - sure.altitude


@pytest.mark.parametrize("seed", range(3))
def test_a_layer_below_a_wide_bubble_is_no_wall(seed):
    """Its lower side rises as the upper wall of a bubble does; that wall is told behind a fall."""
    generator = np.random.default_rng(seed)
    altitude = 285e3 + 280.0 * np.arange(500.0)
    inside = np.interp(altitude, [326e3, 345e3, 376e3, 384e3], [0.0, 0.6, 0.6, 0.0])
    argument = (altitude - 378e3) / np.where(altitude < 378e3, 35e3, 55e3)
    layer = 9e11 * np.exp(0.5 * (1.0 - argument - np.exp(-argument)))
    density = (1.0 - inside) * layer + 8e9 * generator.standard_normal(len(altitude))
    edges = detected(np.arange(500.0), altitude, density, 8e9, 5e9, separation=3200.0)
    assert all(edge.is_entry for edge in edges if edge.altitude < 330e3)
    assert [edge.altitude for edge in edges if not edge.is_entry] == pytest.approx([380e3], abs=2e3)


@pytest.mark.parametrize("wall_width", [12e3, 1e3])
def test_the_upper_wall_of_a_bubble_in_a_steep_layer_is_told(wall_width):
    """In a climb below the peak the layer grows as fast as the lower wall takes away."""
    generator = np.random.default_rng(2)
    altitude = 295e3 + 240.0 * np.arange(400.0)
    half = 0.5 * wall_width
    ends = [313e3 - half, 313e3 + half, 361e3 - half, 361e3 + half]
    inside = np.interp(altitude, ends, [0.0, 0.45, 0.45, 0.0])
    density = (1.0 - inside) * chapman(altitude, 1.1e12, 378e3, 35e3)
    density += 1e10 * generator.standard_normal(len(altitude))
    edges = detected(np.arange(400.0), altitude, density, 1e10, 5e9, separation=1000.0)
    assert [e.altitude for e in edges if not e.is_entry] == pytest.approx([361e3], abs=1e3)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("scale_height", [12e3, 35e3])
def test_a_layer_is_fitted_where_there_is_one(seed, scale_height):
    """The misfit of the right kind is that of the noise, that of the other kind far more."""
    generator = np.random.default_rng(seed)
    altitude = 340e3 + 240.0 * np.arange(-60.0, 61.0)
    layer = chapman(altitude, 1e12, 365e3, scale_height)
    wall = 7e11 + 2e11 * (2.0 * smeared_step(altitude - 340e3, 2e3, 1e3) - 1.0)
    sigma = 1e10
    misfits = np.empty((2, 2))
    for row, density in enumerate((layer, wall)):
        samples = np.zeros((len(altitude), 5))
        samples[:, 0], samples[:, 1] = np.arange(len(altitude)), altitude
        samples[:, 2] = density + sigma * generator.standard_normal(len(altitude))
        samples[:, 3] = sigma
        for column, (kind, passes) in enumerate(((LAYER, 6), (WALL, 1))):
            fit = fit_wall(
                samples,
                np.zeros((len(altitude), 0)),
                1.0,
                340e3,
                14e3,
                2e3,
                1e3,
                100.0,
                1e-4,
                24,
                3,
                passes,
                kind,
            )
            assert fit[0] and fit[6] == 21
            misfits[row, column] = fit[5]
    # What a layer of 12 km is besides a parabola of its logarithm is there, too.
    assert misfits[0, 0] < (60.0 if scale_height > 2e4 else 0.5 * misfits[0, 1])
    assert misfits[1, 1] < 50.0 and misfits[1, 0] > 10.0 * misfits[1, 1]


@pytest.mark.parametrize(("behind", "count"), [(80, 1), (95, 0)])
def test_a_wall_in_a_gap_is_anywhere_in_it(behind, count):
    """Half a minute is the longest: after more there may be other plasma."""
    detector, edges = DensityEdgeDetector(), []
    for second in [*range(60), *range(behind, 200)]:
        density = 5e11 if second < 70 else 8e11
        edges += detector.update(float(second), 300e3 + 270.0 * second, 985.0, density, 1e9)
    edges += detector.flush()
    assert len(edges) == count
    for edge in edges:
        assert 60.0 < edge.time < behind and edge.time_sigma > 3.0


@pytest.mark.parametrize("seen", [2.5e3, 4e3, 8e3])
def test_a_wall_behind_which_densities_end(seen):
    """The first part of a wall of 6 km, or all of it: its place is as unsure as it is stated."""
    altitude = 400e3 - 250.0 * np.arange(200.0)
    altitude = altitude[altitude > 374e3 - seen]
    density = np.interp(altitude, [368e3, 374e3], [3e11, 11e11])
    generator = np.random.default_rng(7)
    density = density + 5e9 * generator.standard_normal(len(density))
    time = np.arange(len(altitude), dtype=float)
    detector = DensityEdgeDetector()
    for sample in zip(time, altitude, density, strict=True):
        assert not detector.update(*sample[:2], 985.0, sample[2], 5e9)
    assert detector.flush_after_gap(time[-1] + 30.0) == []
    edges = detector.flush_after_gap(time[-1] + 31.0)
    assert [edge.is_entry for edge in edges] == [True]
    assert abs(edges[0].altitude - 371e3) < 3.0 * edges[0].time_sigma * 250.0
    assert edges[0].time_sigma * 250.0 < (150.0 if seen == 8e3 else 500.0)
    assert abs(edges[0].width - 6e3) < 3.0 * edges[0].width_sigma + 500.0
    assert detector.flush_after_gap(time[-1] + 60.0) == []


def test_a_wall_is_told_where_altitudes_leap():
    """A leap forgets the densities about a wall that waits: the wall stays where it was found."""
    time, _, altitude, density, sigma = pass_through(False)
    detector = DensityEdgeDetector()
    for sample in zip(time[:128], altitude, density, sigma, strict=False):
        assert not detector.update(*sample[:2], 984.9, *sample[2:])
    (edge,) = detector.update(time[128], altitude[127] - 60e3, 984.9, density[127], sigma[127])
    assert edge.is_entry and edge.altitude == pytest.approx(350.3e3, abs=500.0)


def rays(s4, onset, end, seconds=300, seed=0, rate=20):
    """Intensity of a ray that scintillates from `onset` to `end`, with thermal noise."""
    generator = np.random.default_rng(seed)
    white = generator.standard_normal((2, seconds * rate))
    kernel = np.exp(-0.5 * (np.arange(-20, 21) / 5.0) ** 2)
    smooth = np.array([np.convolve(part, kernel, mode="same") for part in white])
    smooth /= smooth.std()
    time = np.arange(seconds * rate) / rate
    active = (time >= onset) & (time < end)
    direct = math.sqrt(math.sqrt(1.0 - s4**2))
    scattered = math.sqrt(1.0 - math.sqrt(1.0 - s4**2))
    gain = direct + scattered * (smooth[0] + 1j * smooth[1]) / math.sqrt(2.0)
    power = np.where(active, np.abs(gain) ** 2, 1.0)
    return power * (1.0 + 0.035 * generator.standard_normal(len(power)))


@pytest.mark.parametrize("s4", [0.4, 0.8])
@pytest.mark.parametrize("seed", range(5))
def test_horizontal_edges_within_a_few_seconds(s4, seed):
    variance = intensity_variance(rays(s4, 100.0, 220.0, seed=seed).reshape(-1, 20))
    detector = ExceedanceDetector(threshold=0.01)
    edges = []
    for second, value in enumerate(variance):
        edges += detector.update(float(second), float(value))
    edges += detector.flush()
    assert [edge.is_entry for edge in edges] == [True, False]
    assert edges[0].time == pytest.approx(100.0, abs=5.0)
    assert edges[1].time == pytest.approx(220.0, abs=5.0)


def test_a_quiet_ray_and_single_outliers_have_no_edge():
    variance = intensity_variance(rays(0.4, 1e9, 1e9, seconds=3600).reshape(-1, 20))
    variance[[10, 11, 500]] = 1.0
    detector = ExceedanceDetector(threshold=0.01)
    edges = [e for t, v in enumerate(variance) for e in detector.update(float(t), float(v))]
    assert edges == [] and detector.flush() == []


def test_an_event_ends_with_a_gap():
    detector = ExceedanceDetector(threshold=1.0)
    edges = [edge for t in range(10) for edge in detector.update(float(t), 2.0)]
    edges += detector.update(500.0, 0.0)
    assert [(edge.is_entry, edge.time) for edge in edges] == [(True, 0.0), (False, 10.0)]
    assert detector.update(501.0, math.nan) == []


def test_samples_that_no_detector_expects_change_nothing():
    """Samples below the threshold may be left out where `is_expecting` is false."""
    rng = np.random.default_rng(5)
    values = np.repeat(rng.random(200) > 0.7, 6) * rng.random(1200) * 2.0
    times = np.cumsum(rng.choice([1.0, 1.0, 1.0, 20.0], 1200))
    whole, some = ExceedanceDetector(threshold=1.0), ExceedanceDetector(threshold=1.0)
    left_out = 0
    for time, value in zip(times.tolist(), values.tolist(), strict=True):
        edges = whole.update(time, value)
        if value > 1.0 or some.is_expecting:
            assert some.update(time, value) == edges
        else:
            left_out += 1
            assert edges == []
    assert left_out > 100 and whole.flush() == some.flush()


def test_scores_of_minutes():
    minutes = score_windows([True, False, True, False], [60.0, 40.0, 10.0, 0.0])
    assert (minutes.detection_rate, minutes.false_alarm_rate) == (0.5, 0.0)
    assert (minutes.crossing_count, minutes.other_count) == (2, 1)


@pytest.mark.parametrize("lag", [2.0, -1.37])
def test_lag_of_the_deputy(lag):
    """Bound of the project: 2.0 +- 0.2 s."""
    shift = round(lag * 20)
    first, second = [], []
    for seed in range(3):
        pattern = rays(0.4, 50.0, 250.0, seed=seed, seconds=320)
        noise = np.random.default_rng(100 + seed).standard_normal((2, 5600)) * 0.05
        first.append(pattern[400:6000] + noise[0])
        second.append(pattern[400 - shift : 6000 - shift] + noise[1])
    result = fluctuation_lag(first, second, 20.0)
    assert result.lag == pytest.approx(shift / 20.0, abs=0.05)
    assert abs(result.lag - shift / 20.0) < 4.0 * result.sigma + 0.01
    assert result.correlation > 0.8
    assert math.isnan(fluctuation_lag(np.ones((1, 100)), np.ones((1, 100)), 20.0).lag)


def test_where_a_ray_meets_the_region():
    below = itrf_from_geodetic([0.1, 0.2, 250e3])
    direction = ellipsoid_normal(below)
    assert np.linalg.norm(edge_position(below, direction, 320e3) - below) == pytest.approx(
        70e3, abs=50
    )
    above = itrf_from_geodetic([0.1, 0.2, 400e3])
    assert edge_position(above, direction, 320e3) == pytest.approx(above)
