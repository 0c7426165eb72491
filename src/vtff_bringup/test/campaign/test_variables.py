"""Lists, ranges, distributions, and the designs that sample them."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats

from vtff_bringup.campaign.variables import DESIGNS, read_variable, sample_variables
from vtff_sim_bridge.truth.scenario_fields import ScenarioError, Section


def variable(entry, name="x"):
    return read_variable(Section("file.yaml", "vary", {name: entry}), name)


def test_a_list_is_its_values_and_sets_what_it_is_named_after():
    read = variable([3, "two", [1.0, 2.0]], "node.parameter")
    assert read.values == (3, "two", [1.0, 2.0])
    assert read.keys == ("node.parameter",)


def test_ranges_are_even_on_their_scale():
    linear = variable({"from": 1, "to": 2, "count": 5})
    assert linear.values == pytest.approx((1.0, 1.25, 1.5, 1.75, 2.0))
    logarithmic = variable({"from": 0.01, "to": 10, "count": 4, "spacing": "logarithmic"})
    assert logarithmic.values == pytest.approx((0.01, 0.1, 1.0, 10.0))


@pytest.mark.parametrize("design", DESIGNS)
def test_samples_have_the_distribution_and_come_from_the_seed_alone(design):
    normal = variable({"distribution": "norm", "loc": 5.0, "scale": 2.0}, "normal")
    whole = variable({"distribution": "randint", "low": 1, "high": 7}, "whole")
    seed = np.random.SeedSequence(3)
    samples = sample_variables([normal, whole], 512, design, seed)
    again = sample_variables([normal, whole], 512, design, np.random.SeedSequence(3))
    other = sample_variables([normal, whole], 512, design, np.random.SeedSequence(4))
    assert samples == again != other
    drawn = scipy.stats.kstest([s["normal"] for s in samples], "norm", args=(5.0, 2.0))
    assert drawn.pvalue > 0.01
    assert {s["whole"] for s in samples} == {1, 2, 3, 4, 5, 6}
    assert all(type(s["whole"]) is int and type(s["normal"]) is float for s in samples)


def test_a_latin_hypercube_has_one_sample_in_each_stratum():
    uniform = variable({"distribution": "uniform", "loc": 0.0, "scale": 1.0})
    samples = sample_variables([uniform], 20, "latin_hypercube", np.random.SeedSequence(1))
    assert sorted(int(20 * sample["x"]) for sample in samples) == list(range(20))


def test_more_random_samples_begin_with_the_same():
    uniform = variable({"distribution": "uniform"})
    few = sample_variables([uniform], 5, "random", np.random.SeedSequence(1))
    assert sample_variables([uniform], 9, "random", np.random.SeedSequence(1))[:5] == few


@pytest.mark.parametrize(
    ("entry", "problem"),
    [
        ([], "vary.x: a list of one or more values"),
        ({"values": []}, "vary.x.values: a list of one or more values"),
        ({"values": [1], "distribution": "norm"}, "exactly one of values, from, distribution"),
        ({"sets": ["a"]}, "exactly one of values, from, distribution"),
        ({"distribution": "nrom"}, "vary.x.distribution: scipy.stats has no distribution 'nrom'"),
        ({"distribution": "kstest"}, "scipy.stats has no distribution 'kstest'"),
        ({"distribution": "norm", "sigma": 1.0}, "vary.x.sigma: unknown field"),
        ({"distribution": "gamma"}, "vary.x.a: field is missing; gamma takes a, loc, scale"),
        ({"distribution": "norm", "scale": -1.0}, "norm has no values for scale = -1"),
        ({"distribution": "norm", "scale": "wide"}, "vary.x.scale: a number expected"),
        ({"from": 1, "to": 2}, "vary.x.count: field is missing"),
        ({"from": 1, "to": 2, "count": 1}, "vary.x.count: 2 or more"),
        ({"from": 0, "to": 2, "count": 3, "spacing": "logarithmic"}, "above 0"),
        ({"values": [1], "sets": []}, "vary.x.sets: a list of one or more values"),
        ({"values": [1], "colour": "red"}, "vary.x.colour: unknown field"),
        (7, "vary.x: a mapping of fields expected"),
    ],
)
def test_what_is_wrong_is_named(entry, problem):
    with pytest.raises(ScenarioError, match="file.yaml: ") as caught:
        variable(entry)
    assert problem in str(caught.value) and "\n" not in str(caught.value)


def test_a_distribution_without_a_finite_value_is_refused():
    endless = variable({"distribution": "pareto", "b": 1e-3})
    with pytest.raises(ValueError, match="x: the distribution gives a value that is not finite"):
        sample_variables([endless], 64, "random", np.random.SeedSequence(1))
