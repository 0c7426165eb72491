"""Waves of the plasma that are smaller than the sky of a receiver."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cdgps_test_support import CHIEF, configuration, fly, simulate

from vtff_nav.relative.noise.plasma_waves import PlasmaWaves
from vtff_sim_bridge.atmosphere.horizontal_structure import TravellingDisturbance
from vtff_sim_bridge.truth.scenario import state_ahead_on_orbit

STATED, TIME, DISTANCE = 0.01, 30.0, 1e6
SATELLITES = 9
FIRST = 20


def sigmas_learnt(sigma_by_second: np.ndarray, noise: float, seed: int) -> np.ndarray:
    """Return the sigmas that are learnt by filters of contents with true sigmas, TECU."""
    random = np.random.default_rng(seed)
    waves = PlasmaWaves(STATED, 50e3, TIME)
    decay = math.exp(-1.0 / TIME)
    mean, variance = np.zeros(SATELLITES), np.full(SATELLITES, waves.sigma_tecu(DISTANCE) ** 2)
    content, learnt = np.zeros(SATELLITES), []
    for sigma in sigma_by_second.tolist():
        content = decay * content + sigma * math.sqrt(1.0 - decay**2) * random.standard_normal(
            SATELLITES
        )
        steady = waves.sigma_tecu(DISTANCE) ** 2
        mean, variance = decay * mean, decay**2 * variance + (1.0 - decay**2) * steady
        information = 1.0 / (variance + noise**2)
        innovation = content + noise * random.standard_normal(SATELLITES) - mean
        waves.learn_changes(information * innovation, information, DISTANCE, 1.0)
        gain = variance * information
        mean, variance = mean + gain * innovation, (1.0 - gain) * variance
        waves.learn(mean, variance, DISTANCE, 1.0)
        learnt.append(waves.sigma_tecu(DISTANCE))
    return np.array(learnt)


@pytest.mark.parametrize("factor", [0.0, 0.5, 4.0, 8.0])
def test_sigma_of_waves_is_learnt(factor):
    """From a stated sigma that is up to eight times wrong, within a third."""
    stated = PlasmaWaves(STATED, 50e3, TIME).sigma_tecu(DISTANCE)
    true = np.full(600, factor * stated)
    last = [sigmas_learnt(true, 0.01, seed)[-1] / stated for seed in range(5)]
    if factor == 0.0:
        assert max(last) < 0.3
    else:
        assert np.sqrt(np.mean(np.square(last))) == pytest.approx(factor, rel=0.35)


def test_waves_that_begin_in_a_quiet_sky_are_followed():
    """A small sigma that was learnt in ten minutes does not hold for two."""
    stated = PlasmaWaves(STATED, 50e3, TIME).sigma_tecu(DISTANCE)
    true = stated * np.repeat([0.0, 4.0], [600, 120])
    learnt = np.array([sigmas_learnt(true, 0.01, seed) for seed in range(5)])
    assert learnt[:, 599].max() < 0.3 * stated
    assert learnt[:, -1].min() > 0.5 * true[-1]


@pytest.mark.parametrize(
    ("mean", "share"),
    [(math.nan, 0.5), (0.01, math.nan), (math.inf, 0.5), (0.01, 1.2), (0.01, 1.0 + 1e-9)],
)
def test_what_is_no_number_leaves_no_trace_in_the_sigma(mean, share):
    """Neither an estimate that is not a number nor one of negative variance is a sample."""
    waves, untouched = PlasmaWaves(STATED, 50e3, TIME), PlasmaWaves(STATED, 50e3, TIME)
    steady = untouched.sigma_tecu(DISTANCE) ** 2
    good, variance = np.full(3, 0.03), np.full(3, 0.2 * steady)
    waves.learn(np.append(good, mean), np.append(variance, (1.0 - share) * steady), DISTANCE, 1.0)
    untouched.learn(good, variance, DISTANCE, 1.0)
    waves.learn_changes(np.array([1e3, math.nan]), np.array([1e5, 1e5]), DISTANCE, 1.0)
    untouched.learn_changes(np.array([1e3]), np.array([1e5]), DISTANCE, 1.0)
    assert waves.sigma_tecu(DISTANCE) == pytest.approx(untouched.sigma_tecu(DISTANCE), rel=1e-12)
    assert untouched.sigma_tecu(DISTANCE) != math.sqrt(steady)


def test_waves_are_not_felt_by_spacecraft_that_are_near():
    waves = PlasmaWaves(0.012, 50e3, TIME)
    assert not waves.are_felt(5e3)
    assert waves.are_felt(10e3)
    assert waves.sigma_tecu(1e6) == pytest.approx(math.sqrt(2.0) * 0.012)


@pytest.mark.parametrize("sigma_tecu", [None, 0.0], ids=["waves", "no waves"])
def test_difference_under_a_travelling_disturbance(sigma_tecu):
    """At 60 km: fixed and honest with waves in the state, of no use without them."""
    wave = TravellingDisturbance(0.08, 250e3, 1500.0, 150.0, 700e3)
    deputy = state_ahead_on_orbit(CHIEF, 60e3)
    scenario = simulate(90, deputy, seed=4, structures=[wave])
    changes = {} if sigma_tecu is None else {"plasma_wave_sigma_tecu": sigma_tecu}
    flight = fly(scenario, configuration(**changes))
    nees = flight.normalised_squares()[FIRST:].mean() / 3.0
    print(
        f"NEES {nees:.2f}, RMS {1e3 * flight.rms(FIRST):.1f} mm, {flight.is_fixed[FIRST:].mean()}"
    )
    assert (sigma_tecu is None) == bool(0.3 < nees < 2.5 and flight.is_fixed[FIRST:].all())
