"""Receiver biases in orbit and on the ground, with a known answer and levels that are wrong."""

import math
from dataclasses import replace

import numpy as np
import pytest
from formation_simulation import RADIUS
from orbit_simulation import BIAS, PER_NS, samples, seen

from vtff_iono.bias.bias_samples import BiasSamples, ReceiverBiasError
from vtff_iono.bias.pair_equations import PairSolution
from vtff_iono.bias.receiver_bias import (
    ReceiverBias,
    _proven_part,
    content_sigma,
    estimate_receiver_biases,
)
from vtff_iono.geometry.mapping import mapping_factor
from vtff_iono.links.geometry_free import tecu_per_metre


@pytest.mark.parametrize("name", ["chapman", "plumex"])
@pytest.mark.parametrize("seed", range(3))
def test_orbit(name, seed):
    """Bound of the project: 0.15 ns, inside the stated two sigma; two revolutions."""
    rows = seen(name, 3.0)
    (found,) = estimate_receiver_biases(samples(rows, seed, 0.2)).biases
    assert abs(found.bias_tecu - BIAS) <= 0.15 * PER_NS
    assert abs(found.bias_tecu - BIAS) <= 2.0 * found.sigma_tecu
    assert found.sigma_tecu <= 0.15 * PER_NS
    value, sigma = found.code_bias(tecu_per_metre(1575.42e6, 1227.60e6))
    assert value * 1e9 == pytest.approx(-found.bias_tecu / PER_NS, rel=1e-3)
    assert sigma * 1e9 == pytest.approx(found.sigma_tecu / PER_NS, rel=1e-3)


def test_ground_without_gradients():
    """A thin layer at 450 km: only the models with other shells are wrong, and the sigma knows."""
    rows = seen("chapman", 12.0, orbit=False).copy()
    rows[:, 1] = 20.0 * mapping_factor(rows[:, 2], RADIUS, 0.0)
    (found,) = estimate_receiver_biases(samples(rows, 0, 0.1)).biases
    assert abs(found.bias_tecu - BIAS) <= 2.0 * found.sigma_tecu
    assert found.spread_tecu > 0.3
    nearest = np.min(np.abs(np.array(found.model_tecu) - BIAS))
    assert nearest < 0.2
    assert not found.is_bounded


def test_groups_share_the_ionosphere():
    rows = seen("chapman", 3.0)
    one = samples(rows, 0, 0.1)
    group = (rows[:, 9] % 2).astype(np.int64)
    stec = one.stec_tecu + np.where(group == 1, -15.0, 0.0)
    both = BiasSamples(**{**vars(one), "group": group, "stec_tecu": stec})
    first, second = estimate_receiver_biases(both).biases
    assert abs(first.bias_tecu - BIAS) <= 2.5 * first.sigma_tecu
    assert abs(second.bias_tecu - (BIAS - 15.0)) <= 2.5 * second.sigma_tecu


def test_contents_are_not_negative():
    """Levels that all err together make pairs ask for a bias that leaves nothing."""
    rows = seen("chapman", 12.0, orbit=False).copy()
    # Content that falls towards the horizon looks like a large bias with little content.
    rows[:, 1] = 0.5 + 2.0 * np.sin(rows[:, 2])
    (found,) = estimate_receiver_biases(samples(rows, 0, 0.01)).biases
    assert found.is_bounded
    high = rows[:, 2] >= math.radians(20.0)
    assert found.bias_tecu <= np.quantile(rows[high, 1] + BIAS, 0.02) + 0.05


def test_an_hour_on_the_ground_is_sampled_forty_times():
    """Samples between these add nothing: neighbours have the same ionosphere."""
    rows = seen("chapman", 1.0, orbit=False, interval=30.0)
    thinned = rows[rows[:, 0] % 90.0 == 0.0]
    (of_all,) = estimate_receiver_biases(samples(rows, 0, 0.1)).biases
    (of_thinned,) = estimate_receiver_biases(samples(thinned, 0, 0.1)).biases
    assert 0 < of_all.pairs <= 1.1 * of_thinned.pairs


def left_out_solutions(change, scatter, seed):
    """Solutions of 9 models without and with an effect, known to 1 and to `scatter` TECU."""
    generator = np.random.default_rng(seed)
    blocks = 24
    common = generator.standard_normal((blocks, 1)) / (blocks - 1)
    own = scatter * generator.standard_normal((blocks, 1)) / (blocks - 1)
    without, having = [], []
    for _ in range(9):
        one = 5.0 + math.sqrt(blocks) * common
        other = one + change + math.sqrt(blocks) * own
        without.append(PairSolution(np.full(1, 5.0), np.ones(1), one))
        having.append(PairSolution(np.full(1, 5.0 + change), np.ones(1), other))
    return without, having


@pytest.mark.parametrize(("change", "part"), [(0.3, 0.0), (2.0, 0.75), (10.0, 0.99)])
def test_only_the_proven_part_of_an_effect_is_taken_over(change, part):
    """An effect whose jackknife sigma is 1 TECU; what both solutions share does not hide it."""
    found = [_proven_part(*left_out_solutions(change, 1.0, seed)) for seed in range(20)]
    assert np.mean(found) == pytest.approx(part, abs=0.1)
    one_block = PairSolution(np.full(1, 5.0), np.full(1, np.inf), np.full((1, 1), 5.0))
    assert _proven_part([one_block], [one_block._replace(bias_tecu=np.full(1, 9.0))]) == 0.0


def test_too_few_satellites():
    rows = seen("chapman", 3.0)[:20]
    with pytest.raises(ReceiverBiasError, match=r"only \d+ pairs of satellites"):
        estimate_receiver_biases(samples(rows, 0, 0.1))


def test_sigma_of_contents():
    """The noise seen in the samples takes the place of the noise that the samples state."""
    known = ReceiverBias(8.0, 0.3, 0.3, 0.0, (8.0,), False, 100)
    shown = replace(known, satellite_sigma_tecu=0.13)
    stec_sigma = np.full(4, math.hypot(0.1, 3.7))
    sigma = content_sigma(
        stec_sigma, np.full(4, 3.7), [known, shown, None], np.array([0, 1, 2, -1])
    )
    expected = [math.hypot(0.1, 3.7, 0.3), math.hypot(0.1, 0.13, 0.3), stec_sigma[0], stec_sigma[0]]
    assert sigma == pytest.approx(expected)
