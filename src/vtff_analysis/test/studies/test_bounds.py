"""Bounds of campaigns and their binomial confidence."""

from __future__ import annotations

import math

import pytest
from scipy.stats import binom, binomtest

from vtff_analysis.studies.bounds import Bound, judge_bound, lower_confidence_limit


@pytest.mark.parametrize(("successes", "trials"), [(1, 1), (5, 10), (99, 100), (1000, 1000)])
@pytest.mark.parametrize("confidence", [0.9, 0.95, 0.99])
def test_the_limit_is_that_of_clopper_and_pearson(successes, trials, confidence):
    limit = lower_confidence_limit(successes, trials, confidence)
    exact = binomtest(successes, trials, alternative="greater").proportion_ci(confidence, "exact")
    assert limit == pytest.approx(exact.low, rel=1e-9)
    # Its definition: so many successes or more are then only just too improbable.
    assert binom.sf(successes - 1, trials, limit) == pytest.approx(1.0 - confidence, rel=1e-6)


def test_without_a_success_nothing_is_shown():
    assert lower_confidence_limit(0, 10, 0.95) == 0.0


def test_every_case_must_keep_a_bound_without_a_fraction():
    bound = Bound("x", at_most=3.0)
    assert judge_bound(bound, [1.0, 3.0]).holds
    assert not judge_bound(bound, [1.0, 3.1]).holds
    assert not judge_bound(bound, [1.0, None]).holds
    assert not judge_bound(bound, []).holds


def test_a_fraction_must_be_shown_with_confidence():
    bound = Bound("x", at_least=0.0, fraction=0.9)
    few, many = [1.0] * 20, [1.0] * 40
    assert not judge_bound(bound, few).holds  # 0.05 ** (1 / 20) = 0.861
    assert "NOT SHOWN" in str(judge_bound(bound, few))
    assert judge_bound(bound, many).holds  # 0.05 ** (1 / 40) = 0.928
    assert "DOES NOT HOLD" in str(judge_bound(bound, [-1.0] * 40))


def test_excess_orders_cases_by_how_bad_they_are():
    bound = Bound("x", at_least=0.0, at_most=10.0)
    values = [None, 14.0, -1.0, 9.0, 5.0]
    assert [bound.excess(value) for value in values] == [math.inf, 4.0, 1.0, -1.0, -5.0]
    assert bound.excess(math.nan) == math.inf
