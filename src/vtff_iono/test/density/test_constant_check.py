"""The constant after all integers were lost, in contents that are drawn about a known one."""

import copy
import functools
import math

import numpy as np
import pytest
from scipy import stats

from vtff_iono.bias.running_profile import RunningProfile
from vtff_iono.density.constant_check import ConstantCheck, walk_probability
from vtff_iono.density.electron_density import ElectronDensityEstimator
from vtff_iono.density.filter.settings import DensitySettings

CYCLE = -0.513
BIAS = 1234.5
ELEVATION = np.radians([15.0, 24.0, 35.0, 47.0, 66.0, 80.0])
ALTITUDES = (600e3, 601e3)
SECONDS = 200


def contents(density, bias=BIAS):
    """Return differential contents of a layer that is all below the deputy, TECU."""
    return bias - density * 1e3 / 1e16 / np.sin(ELEVATION)


@functools.cache
def estimator():
    """Return an estimator that has learned the constant in quiet plasma of 6e11 per m3."""
    profile = RunningProfile()
    profile.resize(1e-6)
    learned = ElectronDensityEstimator(DensitySettings(mapping_sigma=0.1), profile)
    random = np.random.default_rng(1)
    for second in range(SECONDS):
        observed = contents(6e11) + 0.004 * random.standard_normal(len(ELEVATION))
        learned.update(second, *ALTITUDES, ELEVATION, ELEVATION, observed, np.full(6, 0.004))
    assert learned.is_bias_known
    return learned


def lost(unchecked, steps=0, exposure=0):
    """Return a check of integers that nothing has checked for so many seconds."""
    check = ConstantCheck(CYCLE)
    check.add_steps(steps, exposure)
    check.pass_second(SECONDS - 1.0, True)
    check.lose(estimator())
    for second in range(unchecked):
        check.pass_second(float(SECONDS + second), False)
    return check


def compare(check, observed, sigma, second=SECONDS + 10.0):
    return check.compare(
        second, ALTITUDES, ELEVATION, ELEVATION, observed, sigma, list(range(len(ELEVATION)))
    )


@pytest.mark.parametrize("steps", [0.0, 0.01, 0.7, 5.0, 300.0])
def test_a_walk_of_cycles_is_the_difference_of_two_poisson_variables(steps):
    places = np.arange(-60, 61)
    expected = (places == 0) if steps == 0.0 else stats.skellam.pmf(places, steps / 2, steps / 2)
    assert walk_probability(places, steps) == pytest.approx(expected.astype(float), abs=1e-12)


@pytest.mark.parametrize("cycles", [-2, -1, 0, 1, 2])
def test_quiet_contents_decide(cycles):
    check = lost(60)
    verdict = compare(check, contents(5e11) + cycles * CYCLE, np.full(6, 0.01))
    assert verdict.may_use and verdict.spread_tecu == 0.0 and not check.is_open
    if cycles == 0:
        assert verdict.estimator is None
        return
    epoch = verdict.estimator.update(
        SECONDS + 10.0,
        *ALTITUDES,
        ELEVATION,
        ELEVATION,
        contents(5e11) + cycles * CYCLE,
        np.full(6, 0.01),
    )
    assert abs(epoch.density - 5e11) < 3.0 * epoch.sigma < 3e11


def test_what_all_contents_are_off_by_is_of_the_stated_size():
    """Cycles are drawn as a walk takes them, densities about that of the profile."""
    random, squares, stated, undecided = np.random.default_rng(5), [], [], 0
    expected = 0.4
    places = np.arange(-2, 3)
    probability = stats.skellam.pmf(places, expected / 2, expected / 2)
    probability /= probability.sum()
    between = estimator().profile.mean_density(*ALTITUDES)
    for _ in range(300):
        cycles = random.choice(places, p=probability)
        sigma = np.full(6, random.choice([0.1, 0.2, 0.4, 1.0]))
        density = between + (between + 1e11) * random.standard_normal()
        observed = contents(density) + cycles * CYCLE + sigma * random.standard_normal(6)
        check = lost(40, steps=2, exposure=250)
        verdict = compare(check, observed, sigma)
        if not check.is_open:
            continue
        undecided += 1
        squares.append((cycles * CYCLE) ** 2)
        stated.append(verdict.spread_tecu**2)
    assert undecided > 100
    ratio = math.sqrt(np.mean(squares) / np.mean(stated))
    assert 0.8 < ratio < 1.2
    # What is stated tells which are off: those of the larger half are by far the more.
    larger = np.array(stated) > np.median(stated)
    assert np.mean(np.array(squares)[larger]) > 4.0 * np.mean(np.array(squares)[~larger])


def test_a_constant_is_the_surer_the_shorter_and_the_quieter_the_loss_was():
    """Contents that tell nothing leave what is believed before them."""
    loud = np.full(6, 20.0)
    spreads = [
        compare(lost(unchecked, steps, exposure), contents(6e11), loud).spread_tecu
        for unchecked, steps, exposure in ((1, 0, 1000), (30, 0, 1000), (30, 0, 50), (30, 3, 50))
    ]
    assert spreads == sorted(spreads)
    # A single step of rate 0.5 in a thousand seconds: its probability is that of either sign.
    assert spreads[0] == pytest.approx(abs(CYCLE) * math.sqrt(0.5e-3), rel=0.05)
    # Without end all five numbers that are tried are alike.
    endless = compare(lost(600, 60, 50), contents(6e11), loud)
    assert endless.spread_tecu == pytest.approx(abs(CYCLE) * math.sqrt(2.0), rel=0.02)


def test_what_no_walk_has_reached_is_not_believed_of_contents_that_lie_far_off():
    """Three links, a second after the loss, contents of hundreds of sigmas: all is finite."""
    few = np.where(np.arange(6) < 3, 1e-4, math.nan)
    verdict = compare(lost(0, exposure=1000), contents(6e11) + 3.0 * CYCLE, few)
    assert verdict.may_use and 0.0 <= verdict.spread_tecu <= 2.0 * abs(CYCLE)


def test_contents_that_speak_for_another_constant_are_not_used():
    sigma = np.full(6, 0.17)
    check = lost(60)
    verdict = compare(check, contents(6e11) + CYCLE, sigma)
    assert check.is_open and not verdict.may_use and verdict.estimator is None
    # Three links decide nothing, but make unsure.
    few = np.where(np.arange(6) < 3, 0.05, math.nan)
    verdict = compare(check, contents(6e11) + CYCLE, few)
    assert check.is_open and verdict.may_use
    assert verdict.spread_tecu == pytest.approx(abs(CYCLE), rel=0.05)
    check.forget()
    assert compare(check, contents(6e11), sigma) == (True, 0.0, None)


def test_only_sigmas_know_of_a_constant_that_may_be_another_one():
    """They grow by what densities are off by if all contents are."""
    random = np.random.default_rng(2)
    observed = contents(4e11) + 0.1 * random.standard_normal(6)

    def updated(shift=0.0, **options):
        own = copy.deepcopy(estimator())
        epoch = own.update(
            float(SECONDS),
            *ALTITUDES,
            ELEVATION,
            ELEVATION,
            observed + shift,
            np.full(6, 0.1),
            **options,
        )
        return epoch, own

    (plain, own), (shifted, _) = updated(), updated(0.02)
    unsure, same = updated(constant_sigma_tecu=0.02)
    assert unsure.density == plain.density and (unsure.slow_parts == plain.slow_parts).all()
    for name in ("fast_sigma", "common_sigma", "bias_tecu", "bias_sigma_tecu"):
        assert getattr(unsure, name) == getattr(plain, name)
    assert same.profile.density.tolist() == own.profile.density.tolist()
    added = math.sqrt(unsure.sigma**2 - plain.sigma**2)
    assert added == pytest.approx(abs(shifted.density - plain.density), rel=0.02)
    added = np.sqrt(unsure.sigma_satellite**2 - plain.sigma_satellite**2)
    assert added == pytest.approx(0.02 * 1e16 / 1e3 * np.sin(ELEVATION), rel=1e-6)
