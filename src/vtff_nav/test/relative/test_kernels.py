"""Compiled arithmetic of an epoch against the same formulas by operations on arrays."""

from __future__ import annotations

import numpy as np
import pytest
from cdgps_test_support import CHIEF, DEPUTY_5KM

from vtff_dynamics.frames.rtn import relative_state_rtn, rotation_gcrf_to_rtn
from vtff_gnss.constants import (
    EARTH_ROTATION_RATE_BROADCAST,
    FLAG_CODE_VALID,
    FLAG_HALF_CYCLE_ADDED,
    FLAG_LOCK_LOST,
    FLAG_PHASE_VALID,
)
from vtff_nav.relative.cdgps.output import derivatives_rtn
from vtff_nav.relative.kernels.combinations import combine_carriers, read_signals
from vtff_nav.relative.kernels.differences import find_worst_measurement, leave_one_out
from vtff_nav.relative.kernels.gaussian import decay_members, replace_members, without_nuisance
from vtff_nav.relative.kernels.motion import positions_at_reception
from vtff_nav.relative.kernels.noise import expect_slow_error, update_models
from vtff_nav.relative.kernels.orbit import orbit_measurements
from vtff_nav.relative.kernels.phases import learn_scatter
from vtff_nav.relative.kernels.sky import (
    move_over_ground,
    north_and_east,
    plasma_paths,
    shell_paths,
)

COUNT = 9


def random_numbers(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def unit_vectors(generator: np.random.Generator, *shape: int) -> np.ndarray:
    vectors = generator.standard_normal((*shape, 3))
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def test_positions_at_reception():
    """In orbit with free fall, on the ground without."""
    generator = random_numbers(1)
    states = np.array([CHIEF, DEPUTY_5KM, CHIEF])
    states[2, 3:] = 10.0 * generator.standard_normal(3)
    delay = np.array([[-0.4], [2e-3], [0.3]])
    position, velocity = states[:, :3], states[:, 3:]
    rotation = EARTH_ROTATION_RATE_BROADCAST * np.array([0.0, 0.0, 1.0])
    pull = -3.986005e14 * position / np.linalg.norm(position, axis=1, keepdims=True) ** 3
    pull -= 2.0 * np.cross(rotation, velocity) + np.cross(rotation, np.cross(rotation, position))
    pull[2] = 0.0
    expected = position + delay * velocity + 0.5 * delay**2 * pull
    found = positions_at_reception(states, delay[:, 0].copy())
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)


def test_plasma_of_layers_and_shells():
    generator = random_numbers(2)
    elevation, layers = generator.uniform(0.1, 1.5, (2, COUNT)), np.array([4e4, 6e5])
    receiver = np.array([[6.93e6], [6.931e6]])
    across, down = receiver * np.cos(elevation), receiver * np.sin(elevation)
    paths = np.sqrt((6.93e6 + layers[:, None, None]) ** 2 - across**2) - down
    expected = (paths[:, 1] - paths[:, 0]).T * 1e-4
    found = plasma_paths(6.93e6, 1e3, elevation, layers)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)

    positions = np.array([CHIEF[:3], DEPUTY_5KM[:3]])
    zenith = positions[0] / np.linalg.norm(positions[0])
    rays = unit_vectors(generator, 2, COUNT)
    rays *= np.sign(rays @ zenith)[..., None]
    axes = north_and_east(positions[0])
    np.testing.assert_allclose(axes @ axes.T, np.eye(2), atol=1e-12)
    assert axes[0, 2] > 0.0 and axes[1, 2] == 0.0 and np.linalg.det([*axes, zenith]) < 0.0
    radius = np.linalg.norm(positions, axis=1)[:, None, None]
    heights = np.array([1e5, 3e5])
    shell = radius[0] + heights
    up = (rays @ positions[:, :, None]) / radius
    up_there = np.sqrt(1.0 - (radius / shell) ** 2 * (1.0 - up**2))
    distance = shell * up_there - radius * up
    pierce = (positions @ axes.T)[:, None, None] + distance[..., None] * (rays @ axes.T)[:, :, None]
    content = np.ones((*distance.shape, 3))
    content[..., 1:] = np.degrees(np.arcsin(pierce / shell[..., None]))
    content /= up_there[..., None]
    expected = (content[1] - content[0]).reshape(COUNT, -1)
    np.testing.assert_allclose(shell_paths(positions, rays, heights), expected, atol=1e-9)


def test_combinations_of_carriers():
    """Half of the satellites with two carriers, the others with one (GRAPHIC)."""
    generator = random_numbers(3)
    is_dual = np.arange(COUNT) % 2 == 0
    first = np.cumsum(1 + np.append(0, is_dual[:-1])) - 1
    second = first + is_dual
    signals = int(second[-1]) + 1
    factors = np.where(is_dual, 2.546, 1.0), np.where(is_dual, -1.546, 0.0)
    pseudorange, delay, phase = generator.uniform(2e7, 2.5e7, (3, signals))
    code_sigma, phase_sigma, rate = generator.uniform(0.1, 1.0, (3, signals))
    lock = generator.uniform(0.0, 9.0, signals)
    flags = generator.choice([0, FLAG_LOCK_LOST, FLAG_HALF_CYCLE_ADDED], signals).astype(np.uint16)
    numbers, is_lost, half_cycles, lock_times = combine_carriers(
        first, second, is_dual, *factors, pseudorange, delay, phase, code_sigma, phase_sigma, rate,
        flags, lock,
    )  # fmt: skip
    code = pseudorange - delay
    one, two = factors
    np.testing.assert_allclose(numbers[0], one * code[first] + two * code[second])
    ionosphere_free = one * phase[first] + two * phase[second]
    np.testing.assert_allclose(
        numbers[1], np.where(is_dual, ionosphere_free, 0.5 * (code + phase)[first])
    )
    np.testing.assert_allclose(
        numbers[2], np.hypot(one * code_sigma[first], two * code_sigma[second])
    )
    both = np.hypot(one * phase_sigma[first], two * phase_sigma[second])
    single = 0.5 * np.hypot(code_sigma, phase_sigma)[first]
    np.testing.assert_allclose(numbers[3], np.where(is_dual, both, single))
    np.testing.assert_array_equal(numbers[4], rate[first])
    lost, added = (flags & FLAG_LOCK_LOST) > 0, (flags & FLAG_HALF_CYCLE_ADDED) > 0
    np.testing.assert_array_equal(is_lost, lost[first] | lost[second])
    np.testing.assert_array_equal(half_cycles, added[first] + 2 * added[second])
    np.testing.assert_array_equal(lock_times, np.array((lock[first], lock[second])).T)


@pytest.mark.parametrize("use_receiver_sigmas", [True, False])
def test_signals_that_are_read(use_receiver_sigmas):
    """Signals without phase, ephemeris or number are left out; the first of a carrier counts."""
    generator = random_numbers(4)
    count = 14
    satellite, carrier = np.arange(count) // 4, np.arange(count) // 2
    wavelength = generator.uniform(0.19, 0.25, count)
    has_ephemeris = np.array([True, True, False, True])
    flags = np.full(count, FLAG_CODE_VALID | FLAG_PHASE_VALID, dtype=np.uint16)
    flags[[2, 12]] = FLAG_CODE_VALID
    code, cycles = generator.uniform(1e7, 2e7, (2, count))
    code[4] = np.nan
    stated_code, stated_phase = (
        generator.uniform(0.0, 0.02, (2, count)).astype(np.float32) * [[20.0], [1.0]]
    ).astype(np.float32)
    stated_code[0] = 0.0
    doppler, lock = generator.uniform(1.0, 9.0, (2, count)).astype(np.float32)
    # The columns of an epoch are in another order.
    order = generator.permutation(count)
    ordered = (flags, code, cycles, stated_code, stated_phase, doppler, lock)
    columns = [column[np.argsort(order)] for column in ordered]
    rows, numbers, flags_used = read_signals(
        order, satellite, carrier, wavelength, has_ephemeris, *columns, np.array([0.3, 1e-3]),
        np.array([0.05, 2e-4]), use_receiver_sigmas,
    )  # fmt: skip
    np.testing.assert_array_equal(flags_used, flags[rows])
    np.testing.assert_array_equal(rows, [0, 3, 5, 6, 13])
    sigmas = np.full(count, 0.3), np.full(count, 1e-3)
    if use_receiver_sigmas:
        stated = stated_code.astype(float), stated_phase * wavelength
        sigmas = tuple(
            np.where(given > 0.0, np.maximum(given, smallest), default)
            for given, smallest, default in zip(stated, (0.05, 2e-4), sigmas, strict=True)
        )
    expected = (code, wavelength * cycles, *sigmas, -wavelength * doppler, lock)
    np.testing.assert_allclose(numbers, np.array(expected)[:, rows], rtol=1e-12)


@pytest.mark.parametrize("position_relative", [-1, 9])
def test_model_of_the_orbit_filter_is_the_derivative(position_relative):
    """Rows against differences of what they predict, and values of a state that is not zero."""
    generator = random_numbers(5)
    members, codes = 40, np.array([0, 2, 5])
    direction, rate = (
        unit_vectors(generator, 2, COUNT),
        generator.uniform(-800.0, 800.0, (2, COUNT)),
    )
    columns = generator.permutation(COUNT)
    shares = generator.uniform(0.0, 0.5, (2, COUNT))
    ambiguities, errors = np.arange(18, 18 + COUNT), np.array([30, 31, 32])
    residuals, sigmas = generator.standard_normal((2, 2, COUNT))
    system = np.arange(COUNT) % 2

    def model(mean: np.ndarray) -> tuple[np.ndarray, ...]:
        return orbit_measurements(
            mean, 0, position_relative, ambiguities, errors, codes, columns, shares, direction,
            rate, residuals, sigmas, system, np.array([0, 1]),
        )  # fmt: skip

    mean = generator.standard_normal(members)
    design, values, variances, nuisance = model(mean)
    order = np.concatenate((codes, np.arange(COUNT)))
    kind = np.repeat([0, 1], (len(codes), COUNT))
    expected = residuals[kind, order]
    expected[len(codes) :] -= mean[ambiguities]
    for code, error in enumerate(errors):
        expected[[code, len(codes) + codes[code]]] -= mean[error]
    np.testing.assert_allclose(values, expected)
    # The position of the deputy is that of the chief and the difference.
    share = shares[kind, order][:, None] * (position_relative >= 0)
    rays, rays_deputy = direction[:, columns[order]]
    np.testing.assert_allclose(design[:, :3], -(1.0 - share) * rays - share * rays_deputy)
    if position_relative >= 0:
        np.testing.assert_allclose(design[:, 9:12], -share * rays_deputy)
    for member in range(18, members):
        moved = mean.copy()
        moved[member] += 1.0
        np.testing.assert_allclose(values - model(moved)[1], design[:, member], atol=1e-12)
    np.testing.assert_allclose(variances, sigmas[kind, order] ** 2)
    of_clock = 1.0 - rate[0, columns[order]] / 299792458.0
    np.testing.assert_allclose(nuisance, of_clock[:, None] * (system[order, None] == [0, 1]))


def test_models_of_slow_errors():
    """Two epochs, with a gap of its own for one signal; then what they weigh."""
    generator = random_numbers(6)
    sigmas, times = np.array([0.0, 1e-3, 5e-3]), np.array([1.0, 30.0, 300.0])
    mean, variance = np.zeros((3, COUNT)), np.repeat(sigmas[:, None] ** 2, COUNT, axis=1)
    log_likelihood = np.array([0.0, -0.3, -0.7])
    expected = mean.copy(), variance.copy(), log_likelihood.copy()
    for _ in range(2):
        gaps = np.full(COUNT, 1.0)
        gaps[3] = 7.0
        residual = 3e-3 * generator.standard_normal(COUNT)
        residual[0] = 0.5
        number, noise = generator.uniform(0.0, 1.0, COUNT), generator.uniform(1e-6, 4e-6, COUNT)
        number[5] = 0.1
        update_models(
            mean, variance, log_likelihood, sigmas, times, gaps, residual, number, noise, 5.0, 0.15
        )
        decay = np.exp(-gaps / times[:, None])
        before, spread, weight = expected
        before = decay * before
        spread = decay**2 * spread + (1.0 - decay**2) * sigmas[:, None] ** 2
        is_sample = (number > 0.15) & (residual**2 < 25.0 * (sigmas[-1] ** 2 + noise))
        total, error = spread + noise, residual - before
        terms = -0.5 * (np.log(total) + error**2 / total)
        weight = weight + terms @ np.where(is_sample, number, 0.0)
        gain = np.where(is_sample, spread / total, 0.0)
        expected = before + gain * error, (1.0 - gain) * spread, weight - weight.max()
    for found, wanted in zip((mean, variance, log_likelihood), expected, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-15)
    weight = np.exp(log_likelihood) / np.exp(log_likelihood).sum()
    none, sigma, time = expect_slow_error(log_likelihood, sigmas, times)
    assert none == pytest.approx(weight[0])
    square = weight[1:] @ sigmas[1:] ** 2 / weight[1:].sum()
    assert sigma == pytest.approx(np.sqrt(square))
    assert time == pytest.approx(
        (weight[1:] * sigmas[1:] ** 2) @ times[1:] / (weight[1:] @ sigmas[1:] ** 2)
    )


@pytest.mark.parametrize("climb", [0.0, 800.0])
@pytest.mark.parametrize("distance", [5e3, 225e3])
def test_derivatives_of_the_relative_state(distance, climb):
    """By central differences; the orbit of a chief that climbs is not circular."""
    chief = CHIEF + np.concatenate((np.zeros(3), climb * CHIEF[:3] / np.linalg.norm(CHIEF[:3])))
    relative = (DEPUTY_5KM - CHIEF) * distance / np.linalg.norm((DEPUTY_5KM - CHIEF)[:3])
    deputy, rotation = chief + relative, rotation_gcrf_to_rtn(chief)
    state, by_difference, by_chief = derivatives_rtn(chief, relative, rotation)
    np.testing.assert_allclose(state, relative_state_rtn(chief, deputy), atol=1e-7)
    for column in range(6):
        step = np.zeros(6)
        step[column] = 10.0 if column < 3 else 0.01
        for moved, derivative in ((0.0, by_difference), (1.0, by_chief)):
            after = relative_state_rtn(chief + moved * step, deputy + step)
            before = relative_state_rtn(chief - moved * step, deputy - step)
            expected = 0.5 * (after - before) / step[column]
            np.testing.assert_allclose(derivative[:, column], expected, rtol=1e-5, atol=2e-8)


def test_scatter_is_learnt_from_the_squares_of_changes():
    generator = random_numbers(7)
    count, stated = 200, 1e-9
    before, now = generator.standard_normal((2, count))
    residual = np.concatenate((np.zeros(count), now))
    numbers = np.array([np.zeros(count), np.ones(count), before])
    learn_scatter(
        np.arange(count), 10, residual, np.zeros(2 * count), np.ones(2 * count),
        np.full(count, stated), np.ones(2 * count, bool), np.zeros(count, bool), 0.0, 2.0,
        np.zeros(count, np.int64), np.zeros(count, np.int64), numbers,
    )  # fmt: skip
    expected = 1.0 + (0.5 * (now - before) ** 2 / stated - 1.0) / 10
    kept = numbers[0] > 0.0
    assert kept.sum() > 100
    np.testing.assert_allclose(numbers[1][kept], expected[kept], rtol=1e-12)


def test_worst_measurement():
    generator = random_numbers(8)
    count, limit = 6, 3.0
    root = generator.standard_normal((2 * count + 1, 2 * count + 1))
    weight = root @ root.T
    is_used = np.arange(2 * count + 1) != 4
    values, variances = generator.standard_normal(2 * count + 1), np.full(2 * count + 1, 1e3)
    residual, variance = leave_one_out(weight, weight @ values, variances, is_used)
    diagonal = np.diagonal(weight)
    np.testing.assert_allclose(residual[is_used], (weight @ values / diagonal)[is_used])
    np.testing.assert_allclose(variance[is_used], (1.0 / diagonal)[is_used])
    assert (residual[4], variance[4]) == (0.0, np.inf)

    def worst(is_scattered: np.ndarray, slip: float, limit: float) -> int:
        return find_worst_measurement(
            residual, variance, variance, is_scattered, np.full(count, slip), limit
        )

    quiet, normalised = np.zeros(count, bool), np.abs(residual) / np.sqrt(variance)
    largest = int(normalised.argmax())
    assert worst(quiet, 0.0, 0.99 * normalised[largest]) == largest
    assert worst(quiet, 0.0, 1.01 * normalised[largest]) == -1
    # A phase that scintillates and is nearer to a slip counts as a fault.
    scattered = np.arange(count) == 2
    slip = 0.9 * abs(residual[count + 2])
    assert worst(scattered, slip, 1e3 * limit) == count + 2
    assert worst(scattered, 1.1 * abs(residual[count + 2]), 1e3 * limit) == -1


def test_prediction_of_a_state():
    generator = random_numbers(9)
    root, mean = generator.standard_normal((5, 5)), generator.standard_normal(5)
    covariance, rows = root @ root.T, np.array([0, 3])
    coefficients = generator.standard_normal((2, 5))
    whole = np.eye(5)
    whole[rows] = coefficients
    expected_mean, expected = whole @ mean, whole @ covariance @ whole.T
    changed = coefficients @ covariance
    replace_members(mean, covariance, rows, coefficients @ mean, changed, changed @ coefficients.T)
    np.testing.assert_allclose(mean, expected_mean)
    np.testing.assert_allclose(covariance, expected)
    decay, steady, growth = generator.uniform(0.1, 1.0, (3, 5))
    decay_members(mean, covariance, decay, steady, growth)
    expected = expected * np.outer(decay, decay) + np.diag((1.0 - decay**2) * steady + growth)
    np.testing.assert_allclose(mean, decay * expected_mean)
    np.testing.assert_allclose(covariance, expected)


def test_nuisance_is_projected_out():
    generator = random_numbers(10)
    root, nuisance = generator.standard_normal((6, 6)), generator.standard_normal((6, 1))
    weight = root @ root.T
    weighted = weight @ nuisance
    normal = (nuisance.T @ weighted).item()
    expected = weight - weighted @ weighted.T / normal
    gain = without_nuisance(weight, weighted, normal)
    np.testing.assert_allclose(gain, weighted.T / normal)
    np.testing.assert_allclose(weight, expected)
    np.testing.assert_allclose(weight @ nuisance, 0.0, atol=1e-12)


def test_motion_over_ground():
    before, after, turn = CHIEF[:3], CHIEF[:3] + CHIEF[3:], 7.3e-5
    axes, moved = move_over_ground(before, after, turn)
    zenith, zenith_after = (position / np.linalg.norm(position) for position in (before, after))
    expected = zenith_after - zenith - turn * np.cross([0.0, 0.0, 1.0], zenith)
    np.testing.assert_allclose(moved, expected, atol=1e-15)
    np.testing.assert_allclose(axes, north_and_east(before), atol=1e-15)
