"""Integers in one datum, whatever the filter that finds them does; and found anew."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_gnss.constants import FREQUENCY_L1, FREQUENCY_L2, SYSTEM_GPS
from vtff_gnss.signals import SignalKey
from vtff_iono.density.integer_datum import IntegerDatum
from vtff_iono.density.integer_resolution import (
    FloatingContent,
    IntegerResolver,
    WeightedMean,
)
from vtff_iono.links.geometry_free import tecu_per_metre


def signal(prn):
    return SignalKey(SYSTEM_GPS, prn, 1, ord("C"))


def relative_to(reference, integers):
    return {signal(prn): cycles - integers[reference] for prn, cycles in integers.items()}


def unbroken(integers, arc=1):
    return {signal(prn): arc for prn in integers}


@given(
    st.dictionaries(st.integers(1, 32), st.integers(-1000, 1000).map(float), min_size=2),
    st.data(),
)
def test_the_datum_outlives_its_reference_satellite(integers, data):
    datum = IntegerDatum()
    first = datum.update(relative_to(next(iter(integers)), integers), unbroken(integers))
    for _ in range(3):
        reference = data.draw(st.sampled_from(sorted(integers)))
        assert datum.update(relative_to(reference, integers), unbroken(integers)) == first
    assert datum.number == 1


def test_integers_hold_while_the_filter_floats_and_end_with_their_arcs():
    integers = {1: 5.0, 2: 7.0, 3: -4.0}
    datum = IntegerDatum()
    first = datum.update(relative_to(1, integers), unbroken(integers))
    continuity = unbroken(integers) | {signal(2): 2}
    held = datum.update({}, continuity)
    assert held == {key: value for key, value in first.items() if key.prn != 2}
    datum.resolve(signal(2), 99.0, 2)
    assert datum.update({}, continuity)[signal(2)] == 99.0


def test_a_second_like_the_one_before_sees_what_was_resolved_and_refused_meanwhile():
    datum = IntegerDatum()
    fixed, continuity = {signal(5): 1.0, signal(7): 2.0}, {signal(5): 0, signal(7): 0, signal(9): 0}
    assert datum.update(fixed, continuity) == fixed
    assert datum.update(dict(fixed), dict(continuity)) == fixed
    datum.resolve(signal(9), 4.0, 0)
    assert datum.update(fixed, continuity) == {**fixed, signal(9): 4.0}
    datum.refuse(signal(7))
    assert datum.update(fixed, continuity) == {signal(5): 1.0, signal(9): 4.0}
    assert datum.number == 1


def test_without_a_connection_the_datum_is_another():
    datum = IntegerDatum()
    datum.update(relative_to(1, {1: 0.0, 2: 1.0}), unbroken([1, 2]))
    datum.update(relative_to(3, {3: 0.0, 4: 1.0}), unbroken([3, 4]))
    assert datum.number == 2


def test_another_datum_needs_more_integers_than_are_held():
    """As many integers without a connection are no reason to give the constant up."""
    datum = IntegerDatum()
    first = datum.update(relative_to(1, {1: 0.0, 2: 1.0}), unbroken([1, 2]))
    assert datum.update(relative_to(3, {3: 0.0, 4: 1.0}), unbroken([1, 2, 3, 4])) == first
    assert datum.number == 1
    more = {3: 0.0, 4: 1.0, 5: 2.0}
    assert datum.update(relative_to(3, more), unbroken([1, 2, 3, 4, 5])).keys() == {
        signal(prn) for prn in more
    }
    assert datum.number == 2


def test_a_constant_that_is_known_is_not_given_up():
    """Integers of the filter wait; one that is found in the datum connects the others with it."""
    datum = IntegerDatum()
    datum.update(relative_to(1, {1: 0.0, 2: 1.0}), unbroken([1, 2]))
    other = relative_to(3, {3: 0.0, 4: 1.0})
    assert datum.update(other, unbroken([3, 4]), may_begin_anew=False) == {}
    datum.resolve(signal(4), 7.0, 1)
    assert datum.update(other, unbroken([3, 4]), may_begin_anew=False) == {
        signal(3): 6.0,
        signal(4): 7.0,
    }
    assert datum.number == 1


def test_the_majority_overrules_a_wrong_integer():
    datum = IntegerDatum()
    integers = {1: 0.0, 2: 1.0, 3: 2.0, 4: 3.0}
    datum.update(relative_to(1, integers), unbroken(integers))
    corrected = integers | {4: 8.0}
    assert datum.update(relative_to(1, corrected), unbroken(integers))[signal(4)] == 8.0


def test_nothing_overrules_an_integer_that_has_proved_right():
    datum = IntegerDatum()
    integers = {1: 0.0, 2: 1.0, 3: 2.0, 4: 3.0}
    first = datum.update(relative_to(1, integers), unbroken(integers))
    datum.prove(signal(4))
    wrong = relative_to(1, integers | {4: 8.0})
    assert datum.update(wrong, unbroken(integers)) == first
    assert datum.is_proved(signal(4)) and not datum.is_proved(signal(3))
    # A new arc has to prove itself again.
    broken = unbroken([1, 2, 3]) | {signal(4): 2}
    assert datum.update(wrong, broken)[signal(4)] == 8.0
    assert not datum.is_proved(signal(4))


def test_a_refused_integer_does_not_come_back_with_the_same_arc():
    datum = IntegerDatum()
    integers = {1: 0.0, 2: 1.0, 3: 2.0}
    table = relative_to(1, integers)
    datum.update(table, unbroken(integers))
    datum.refuse(signal(3))
    assert signal(3) not in datum.update(table, unbroken(integers))
    assert signal(3) in datum.update(table, unbroken([1, 2]) | {signal(3): 2})


def test_a_refused_integer_does_not_come_back_from_another_reference_satellite():
    datum = IntegerDatum()
    integers = {1: 5.0, 2: 7.0, 3: -4.0}
    datum.update(relative_to(1, integers), unbroken(integers))
    datum.refuse(signal(3))
    for reference in integers:
        held = datum.update(relative_to(reference, integers), unbroken(integers))
        assert held == {signal(1): 0.0, signal(2): 2.0}


def resolve(
    resolver, wide_lane, samples, excess, sigma, prediction_sigma, known=(None, None), arc="arc"
):
    """Add a second of a single link; return its integers or None."""
    content = FloatingContent(arc, wide_lane, samples, excess, sigma, known)
    return resolver.resolve([content], np.array([[prediction_sigma**2]])).get(arc)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("pair", [(3, -2), (-40, -41), (1000, 1290)])
def test_integers_of_a_broken_arc_are_found_again(seed, pair):
    """20 samples a second of 0.35 cycles, scintillation of 0.08 TECU from second to second."""
    generator = np.random.default_rng(seed)
    resolver = IntegerResolver(FREQUENCY_L1, FREQUENCY_L2)
    scale = tecu_per_metre(FREQUENCY_L1, FREQUENCY_L2)
    shift = scale * SPEED_OF_LIGHT * (pair[0] / FREQUENCY_L1 - pair[1] / FREQUENCY_L2)
    bias = 12.3
    for _ in range(100):
        resolver.add_resolved(bias + generator.normal(0.0, 0.35 / np.sqrt(20)), 20)
    for second in range(60):
        wide = pair[0] - pair[1] + bias + generator.normal(0.0, 0.35 / np.sqrt(20))
        found = resolve(resolver, wide, 20, shift + generator.normal(0.0, 0.08), 0.08, 0.02)
        if found is not None:
            assert found == pair
            assert second >= 3
            return
    pytest.fail("no decision within a minute")


def test_nothing_is_decided_between_two_integers():
    generator = np.random.default_rng(1)
    resolver = IntegerResolver(FREQUENCY_L1, FREQUENCY_L2)
    scale = tecu_per_metre(FREQUENCY_L1, FREQUENCY_L2) * SPEED_OF_LIGHT
    half = 0.5 * scale * (1.0 / FREQUENCY_L1 - 1.0 / FREQUENCY_L2)
    for _ in range(100):
        resolver.add_resolved(generator.normal(0.0, 0.08), 20)
        noise = generator.normal(0.0, 0.01, size=2)
        excess = half + noise[1]
        assert resolve(resolver, noise[0], 20, excess, 0.01, 0.02) is None


@pytest.mark.parametrize("wide_lane_error", [0.0, 0.45])
def test_the_content_decides_where_the_wide_lane_is_off(wide_lane_error):
    """Multipath of a code moves a wide lane by most of a cycle for minutes."""
    generator = np.random.default_rng(2)
    resolver = IntegerResolver(FREQUENCY_L1, FREQUENCY_L2)
    for _ in range(300):
        resolver.add_resolved(generator.normal(0.0, 0.25), 20)
    for _ in range(30):
        excess = generator.normal(0.0, 0.01)
        integers = resolve(resolver, wide_lane_error, 20, excess, 0.01, 0.02)
        if integers is not None:
            break
    assert integers == (0.0, 0.0)


def test_a_content_off_its_level_is_not_explained_by_other_integers():
    """A level that differs from all that integers can do is no pair of integers."""
    resolver = IntegerResolver(FREQUENCY_L1, FREQUENCY_L2)
    for _ in range(100):
        resolver.add_resolved(0.0, 20)
        assert resolve(resolver, 0.0, 20, 0.2, 0.01, 0.02) is None


@pytest.mark.parametrize("known", [(7.0, None), (None, -4.0)])
def test_beside_a_signal_that_went_on_the_other_integer_is_found_in_a_second(known):
    """One cycle of a single signal is 1.8 or 2.3 TECU: codes are not needed."""
    scale = tecu_per_metre(FREQUENCY_L1, FREQUENCY_L2) * SPEED_OF_LIGHT
    excess = scale * (7.0 / FREQUENCY_L1 + 4.0 / FREQUENCY_L2)
    arguments = (0.0, 20, excess + 0.3)
    resolver = IntegerResolver(FREQUENCY_L1, FREQUENCY_L2)
    assert resolve(resolver, *arguments, 0.2, 0.1, known) == (7.0, -4.0)
    # Nor is it guessed where a second does not tell it.
    assert resolve(resolver, *arguments, 0.6, 0.1, known) is None
    assert resolve(resolver, *arguments, 0.2, 0.1) is None


@pytest.mark.parametrize(
    ("relative_sigma_cycles", "is_told"), [(0.0, True), (0.05, True), (1.0, False)]
)
@pytest.mark.parametrize("seed", range(3))
def test_a_range_that_is_known_tells_both_integers_in_a_second(
    seed, relative_sigma_cycles, is_told
):
    """The codes are off by a cycle, as in multipath; what relative navigation states counts."""
    generator = np.random.default_rng(seed)
    resolver = IntegerResolver(FREQUENCY_L1, FREQUENCY_L2)
    for _ in range(100):
        resolver.add_resolved(generator.normal(0.0, 0.4), 20)
        resolver.add_geometric([(error, 0.005) for error in generator.normal(0.0, 0.03, 8)])
    scale = tecu_per_metre(FREQUENCY_L1, FREQUENCY_L2) * SPEED_OF_LIGHT
    excess = scale * (7.0 / FREQUENCY_L1 + 4.0 / FREQUENCY_L2) + generator.normal(0.0, 0.03)
    content = FloatingContent(
        "arc", 12.0, 20, excess, 0.01, geometric_cycles=11.0 + generator.normal(0.0, 0.03)
    )
    arguments = ([content], np.array([[0.03**2]]), True, 0.02**2, relative_sigma_cycles)
    assert resolver.resolve(*arguments) == ({"arc": (7.0, -4.0)} if is_told else {})


def test_a_bent_phase_is_no_other_integer():
    """Half a cycle of L2 moves content and wide lane; integers that fit the content fit neither."""
    resolver = IntegerResolver(FREQUENCY_L1, FREQUENCY_L2)
    for _ in range(100):
        resolver.add_resolved(0.0, 20)
        resolver.add_geometric([(0.02, 0.005), (-0.02, 0.005), (0.01, 0.005), (-0.01, 0.005)])
    bent = 0.22
    excess = bent * tecu_per_metre(FREQUENCY_L1, FREQUENCY_L2) * SPEED_OF_LIGHT / FREQUENCY_L2
    content = FloatingContent("arc", 0.0, 20, excess, 0.25, geometric_cycles=bent)
    found = resolver.resolve([content], np.array([[0.02**2]]), True, 1e-4, 0.0)
    assert found in ({}, {"arc": (0.0, 0.0)})


@pytest.mark.parametrize(("sigma", "is_told"), [(0.05, True), (0.3, False)])
def test_the_shift_of_all_links(sigma, is_told):
    generator = np.random.default_rng(1)
    resolver = IntegerResolver(FREQUENCY_L1, FREQUENCY_L2)
    for _ in range(100):
        resolver.add_resolved(5.0 + generator.normal(0.0, 0.35), 20)
    scale = tecu_per_metre(FREQUENCY_L1, FREQUENCY_L2) * SPEED_OF_LIGHT
    excess = scale * (200.0 / FREQUENCY_L1 + 90.0 / FREQUENCY_L2) + 0.3 * sigma
    wide_lanes = 5.0 + 290.0 + generator.normal(0.0, 0.35, 8)
    found = resolver.find_shift(excess, sigma**2, wide_lanes, (None, None))
    assert found == ((200.0, -90.0) if is_told else None)
    assert resolver.find_shift(excess, sigma**2, wide_lanes, (200.0, None)) == (200.0, -90.0)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("position_error", "is_possible"), [(0.0, True), (2.1, False)])
def test_codes_contradict_integers_that_fit_a_wrong_position(seed, position_error, is_possible):
    """Codes have slow errors of a third of a cycle, and one bias that nobody knows."""
    generator = np.random.default_rng(seed)
    resolver = IntegerResolver(FREQUENCY_L1, FREQUENCY_L2)
    for _ in range(300):
        resolver.add_resolved(5.0 + generator.normal(0.0, 0.35), 20)
    sines = np.sin(np.radians([66.0, 50.0, 49.0, 48.0, 29.0, 23.0, 11.0]))
    cycles = position_error * sines * (FREQUENCY_L1 - FREQUENCY_L2) / SPEED_OF_LIGHT
    offered = {arc: float(n) for arc, n in enumerate(100.0 + np.rint(cycles))}
    slow = generator.normal(0.0, 0.35, len(sines))
    for _ in range(10):
        contents = [
            FloatingContent(arc, 85.3 + error, 20, 0.25 + generator.normal(0.0, 0.5), 1.0)
            for arc, error in enumerate(slow + generator.normal(0.0, 0.1, len(sines)))
        ]
        resolver.resolve(contents, 100.0 * np.ones((len(sines), len(sines))))
    assert resolver.agree_with_codes(offered) == is_possible


def test_no_codes_allow_nothing():
    resolver = IntegerResolver(FREQUENCY_L1, FREQUENCY_L2)
    assert not resolver.agree_with_codes({"arc": 3.0})


def links_without_density(generator, paths, known, sigma=0.01):
    """Contents of links whose predictions err by a density in common, and their true integers.

    The density is unknown by 1 TECU of vertical content; `paths` are of the rays through a layer
    over its height.
    """
    scale = tecu_per_metre(FREQUENCY_L1, FREQUENCY_L2) * SPEED_OF_LIGHT
    error = generator.normal(0.0, 1.0)
    contents, true = [], {}
    for arc, path in enumerate(paths):
        first, second = (float(n) for n in generator.integers(-50, 50, size=2))
        shift = scale * (first / FREQUENCY_L1 - second / FREQUENCY_L2)
        excess = shift + error * path + generator.normal(0.0, sigma)
        wide_lane = first - second + generator.normal(0.0, 0.1)
        told = (first, None) if known else (None, None)
        contents.append(FloatingContent(arc, wide_lane, 20, excess, sigma, told))
        true[arc] = (first, second)
    paths = np.asarray(paths)
    return contents, np.outer(paths, paths), true


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("known", [False, True])
def test_integers_of_all_links_are_found_together_where_none_has_kept_them(seed, known):
    """An unknown density may be many cycles on a single link, but it is one for all links."""
    generator = np.random.default_rng(seed)
    resolver = IntegerResolver(FREQUENCY_L1, FREQUENCY_L2)
    for _ in range(100):
        resolver.add_resolved(generator.normal(0.0, 0.1), 20)
    paths = [1.13, 1.41, 1.87, 2.36, 3.08, 4.23]
    contents, covariance, true = links_without_density(generator, paths, known)
    for _ in range(4):
        found = resolver.resolve(contents, covariance, is_density_known=False)
        assert found in ({}, true)
        if found:
            return
        # A single link tells nothing.
        assert resolver.resolve([contents[0]._replace(arc="one")], covariance[:1, :1], False) == {}
    pytest.fail("not found")


def test_a_link_whose_content_fits_no_integers_does_not_hinder_the_others():
    generator = np.random.default_rng(5)
    resolver = IntegerResolver(FREQUENCY_L1, FREQUENCY_L2)
    contents, covariance, true = links_without_density(
        generator, [1.13, 1.41, 1.87, 2.36, 3.08, 4.23], True
    )
    contents[2] = contents[2]._replace(excess_tecu=contents[2].excess_tecu + 0.7)
    found = resolver.resolve(contents, covariance, is_density_known=False)
    assert found == {arc: integers for arc, integers in true.items() if arc != 2}


def test_the_sigma_of_a_mean_is_that_of_its_samples_from_two_on():
    mean, values = WeightedMean(), [3.0, 5.0, 1.0]
    sigmas = []
    for value in values:
        mean.add(value)
        sigmas.append(mean.sigma())
    assert sigmas[0] == np.inf
    expected = [np.std(values[:n], ddof=1) / np.sqrt(n) for n in (2, 3)]
    assert sigmas[1:] == pytest.approx(expected)
    assert mean.mean == pytest.approx(3.0)
