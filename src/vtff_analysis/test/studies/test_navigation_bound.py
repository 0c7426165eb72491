"""The covariance bound of relative navigation against results in closed form."""

import dataclasses

import numpy as np
import pytest

from vtff_analysis.studies.navigation_bound import PhaseNoise, PhaseSky, motion_covariances

STILL = np.eye(9)
NO_NOISE = np.zeros((9, 9))


def sky(count: int = 9, groups: int = 2, nuisance: int = 0) -> PhaseSky:
    """Return a sky of satellites above the horizon with some signals each."""
    random = np.random.default_rng(3)
    directions = random.standard_normal((count, 3))
    directions[:, 2] = np.abs(directions[:, 2])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    names = [(satellite, group) for group in range(groups) for satellite in range(count)]
    return PhaseSky(
        names,
        [group for _, group in names],
        np.tile(directions, (groups, 1)),
        random.standard_normal((len(names), nuisance)),
    )


def dilution(epoch: PhaseSky) -> float:
    """Return the PDOP of one group of an epoch whose clock is unknown, by least squares."""
    directions = epoch.directions[: len(set(epoch.signals)) // len(set(epoch.groups))]
    design = np.column_stack((directions, np.ones(len(directions))))
    return float(np.sqrt(np.trace(np.linalg.inv(design.T @ design)[:3, :3])))


def position_sigmas(epochs: list, noise: PhaseNoise) -> np.ndarray:
    """Return the 3-D sigma of position at each epoch."""
    covariances = motion_covariances(epochs, noise)
    return np.sqrt(np.trace(covariances[:, :3, :3], axis1=1, axis2=2))


def test_one_epoch_is_least_squares():
    """PDOP sqrt(2) sigma / sqrt(number of carriers), with a bias for each carrier."""
    epoch = sky()
    (sigma,) = position_sigmas([(epoch, STILL, NO_NOISE)], PhaseNoise(0.001))
    # The prior of 10 m and the clock of 100 m leave 1e-8 of it.
    assert sigma == pytest.approx(dilution(epoch) * 0.001, rel=1e-4)
    (sigma,) = position_sigmas([(epoch, STILL, NO_NOISE)], PhaseNoise(0.0006, 0.0008))
    assert sigma == pytest.approx(dilution(epoch) * 0.001, rel=1e-4)


def test_slow_noise_averages_as_slowly_as_it_changes():
    """The best mean of a Gauss-Markov process over T has the variance 2 / (2 + T / tau)."""
    epoch, correlation_time, count = sky(), 50.0, 1001
    noise = PhaseNoise(1e-6, 0.001, correlation_time)
    sigmas = position_sigmas([(epoch, STILL, NO_NOISE)] * count, noise)
    mean = 2.0 / (2.0 + np.arange(count) / correlation_time)
    # Epochs 1 s apart instead of a continuous record: 1e-4.
    np.testing.assert_allclose(sigmas / sigmas[0], np.sqrt(mean), rtol=2e-3)


def test_white_noise_averages_with_the_number_of_epochs():
    epochs = [(sky(), STILL, NO_NOISE)] * 100
    sigmas = position_sigmas(epochs, PhaseNoise(0.001))
    # The bias of the second group becomes known: the mean is a little better than sqrt(n).
    assert sigmas[-1] / sigmas[0] == pytest.approx(0.1, rel=0.03)


def test_unknown_parameters_and_motion_cost_accuracy():
    plain = position_sigmas([(sky(), STILL, NO_NOISE)] * 5, PhaseNoise(0.001))
    with_nuisance = position_sigmas([(sky(nuisance=2), STILL, NO_NOISE)] * 5, PhaseNoise(0.001))
    assert np.all(with_nuisance > 1.05 * plain)
    wandering = np.diag([1e-3**2] * 3 + [0.0] * 6)
    assert position_sigmas([(sky(), STILL, wandering)] * 5, PhaseNoise(0.001))[-1] > plain[-1]


def test_epochs_without_phases_grow_by_the_process_noise():
    empty = PhaseSky([], [], np.zeros((0, 3)), np.zeros((0, 0)))
    wandering = np.diag([0.01**2] * 3 + [0.0] * 6)
    epochs = [(sky(), STILL, wandering), *[(empty, STILL, wandering)] * 4]
    sigmas = position_sigmas(epochs, PhaseNoise(0.001))
    np.testing.assert_allclose(sigmas**2 - sigmas[0] ** 2, 3e-4 * np.arange(5), rtol=1e-6)


def test_measurements_with_other_noise_have_their_own_sigmas():
    epoch = dataclasses.replace(sky(groups=1), white_sigmas=np.full(9, 0.3))
    (sigma,) = position_sigmas([(epoch, STILL, NO_NOISE)], PhaseNoise(0.001))
    # Two receivers have the double variance; the prior of 10 m leaves 1e-3.
    assert sigma == pytest.approx(np.sqrt(2.0) * dilution(epoch) * 0.3, rel=1e-2)
