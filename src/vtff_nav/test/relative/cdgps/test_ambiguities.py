"""Arcs, integers and half integers without a filter around them."""

from __future__ import annotations

import numpy as np
import pytest
from cdgps_test_support import START

from vtff_gnss.signals import SignalKey
from vtff_nav.relative.cdgps.ambiguity_arcs import Arc, ArcBook
from vtff_nav.relative.cdgps.ambiguity_fixing import fix_ambiguities
from vtff_nav.relative.cdgps.state import GaussianState
from vtff_nav.relative.common.measurements import SingleDifferences

WAVELENGTH = {1: 0.19, 2: 0.24}


def key(prn: int, band: int = 1) -> SignalKey:
    return SignalKey(0, prn, band, ord("C") if band == 1 else ord("W"))


def measured(keys, phase=0.0, **columns) -> SingleDifferences:
    count = len(keys)
    values = {
        "satellite": np.array([k.prn for k in keys]),
        "wavelength": np.array([WAVELENGTH[k.band] for k in keys]),
        "frequency_hz": np.array([299792458.0 / WAVELENGTH[k.band] for k in keys]),
        "code": np.zeros(count),
        "phase": np.full(count, phase) if np.isscalar(phase) else np.asarray(phase, float),
        "code_variance": np.full(count, 0.18),
        "phase_variance": np.full(count, 2e-6),
        "is_parity_known": np.ones(count, dtype=bool),
        "half_cycles": np.zeros(count, dtype=np.int64),
        "is_lock_lost": np.zeros(count, dtype=bool),
        "lock_time": np.full((2, count), 100.0),
        "noise_growth": np.ones(count),
    }
    return SingleDifferences(keys=list(keys), **{**values, **columns})


def book_of(keys, **columns) -> ArcBook:
    book = ArcBook()
    first = measured(keys, **columns)
    for row in range(len(keys)):
        book.start(START, first, row, 0.0)
    return book


def test_undisturbed_arcs_go_on():
    keys = [key(1), key(1, 2), key(2)]
    book = book_of(keys)
    after = measured(keys, phase=0.004, lock_time=np.full((2, 3), 101.0))
    assert book.find_breaks(START + 1.0, after, 1.0) == {}


@pytest.mark.parametrize(
    ("columns", "reason"),
    [
        ({"is_lock_lost": np.array([True])}, "lock was lost"),
        ({"half_cycles": np.array([2])}, "half a cycle"),
        ({"lock_time": np.array([[0.5], [101.0]])}, "restarted"),
    ],
)
def test_receivers_tell_of_breaks(columns, reason):
    book = book_of([key(1)])
    broken = book.find_breaks(START + 1.0, measured([key(1)], **columns), 1.0)
    assert reason in broken[key(1)]


def test_parity_becomes_known():
    book = book_of([key(1)], is_parity_known=np.array([False]))
    assert "parity" in book.find_breaks(START + 1.0, measured([key(1)]), 1.0)[key(1)]


def test_lock_time_bridges_a_gap_and_only_that():
    book = book_of([key(1)])
    kept = measured([key(1)], lock_time=np.full((2, 1), 105.0))
    assert book.find_breaks(START + 5.0, kept, 1.0) == {}
    unknown = measured([key(1)], lock_time=np.full((2, 1), np.nan))
    assert book.find_breaks(START + 5.0, unknown, 1.0) == {key(1): "gap"}


@pytest.mark.parametrize(("first", "second"), [(1, 0), (0, 1), (9, 7), (-5, -4)])
def test_geometry_free_phase_jumps(first, second):
    """Also where both signals slip, unless their ranges slip by the same."""
    keys = [key(1), key(1, 2), key(2), key(2, 2)]
    book = book_of(keys)
    slip = np.array([first * 0.19, second * 0.24, 0.0, 0.0])
    breaks = book.find_breaks(START + 1.0, measured(keys, phase=7.6 + slip), 1.0)
    jump = abs(slip[0] - slip[1])
    assert set(breaks) == (set(keys[:2]) if jump > 0.025 else set())


def test_old_arcs_end():
    book = book_of([key(1), key(2)])
    after = measured([key(2)], lock_time=np.full((2, 1), 200.0))
    assert book.find_breaks(START + 40.0, after, 40.0) == {key(1): "not seen any more"}


def filter_of(cycles, sigma_cycles: float, seed: int = 0, common: float = 0.5):
    """Return a state with SD ambiguities (m) of one signal, and their arcs."""
    random = np.random.default_rng(seed)
    keys = [key(prn) for prn in range(1, len(cycles) + 1)]
    count = len(keys)
    # A common error, as that of the clock, and the errors of each.
    covariance = common**2 * np.ones((count, count)) + (0.19 * sigma_cycles) ** 2 * np.eye(count)
    truth = 0.19 * np.asarray(cycles, dtype=float) + 0.037
    mean = truth + np.linalg.cholesky(covariance) @ random.standard_normal(count)
    state = GaussianState([("ambiguity", k) for k in keys], mean, covariance)
    arcs = [Arc(k, n, 0.0) for n, k in enumerate(keys, start=1)]
    return state, arcs, keys


def attempt(state, arcs, **changes):
    wavelength = {arc.key: 0.19 for arc in arcs}
    elevation = {arc.key: 0.1 * arc.key.prn for arc in arcs}
    options = {"success_rate": 0.999, "failure_rate": 0.001, "smallest_ratio": 2.0, **changes}
    return fix_ambiguities(state, START, arcs, wavelength, elevation, **options)


def test_integers_leave_the_state():
    cycles = [3, -7, 12, 0, 5]
    state, arcs, keys = filter_of(cycles, sigma_cycles=0.03)
    result = attempt(state, arcs)
    assert set(result.fixed) == set(keys)
    assert state.labels == [("phase_bias", keys[0].group)]
    # The highest satellite is the reference.
    assert [arc.integer for arc in arcs] == [c - cycles[-1] for c in cycles]
    assert all(arc.fixed_since == START for arc in arcs)


def test_uncertain_integers_stay():
    state, arcs, _ = filter_of([3, -7, 12, 0, 5], sigma_cycles=0.6)
    before = state.mean.copy()
    result = attempt(state, arcs)
    assert result.fixed == ()
    assert result.reason
    assert all(arc.integer is None for arc in arcs)
    np.testing.assert_array_equal(state.mean, before)


def test_new_satellite_is_fixed_against_the_bias():
    state, arcs, keys = filter_of([3, -7, 12], sigma_cycles=0.02, common=0.0)
    attempt(state, arcs)
    bias = state.value(("phase_bias", keys[0].group))
    new = Arc(key(9), 9, 0.0)
    state.add(("ambiguity", new.key), bias + 0.19 * 4 + 0.001, 1e-5)
    result = attempt(state, [*arcs, new][3:])
    assert result.fixed == (new.key,)
    assert new.integer == 4.0


def test_half_integers_only_when_certain():
    """A receiver that has lost half a cycle: held at the half, never rounded to a whole."""
    for sigma, expected in ((1e-5, 4.5), (0.06**2, None)):
        state, arcs, keys = filter_of([3, -7, 12], sigma_cycles=0.02, common=0.0)
        attempt(state, arcs)
        bias = state.value(("phase_bias", keys[0].group))
        new = Arc(key(9), 9, 0.0)
        state.add(("ambiguity", new.key), bias + 0.19 * 4.5, sigma)
        attempt(state, [new])
        assert new.integer == expected


def test_half_integers_of_all_satellites_after_an_outage():
    """The chief has lost half cycles, and no bias is known any more: many floats say so at once."""
    cycles = [3.0, -7.5, 12.0, 0.5, 5.5, 8.0, -2.5]
    state, arcs, keys = filter_of(cycles, sigma_cycles=0.005)
    assert set(attempt(state, arcs).fixed) == set(keys)
    assert [arc.integer for arc in arcs] == [cycle - cycles[-1] for cycle in cycles]
    assert state.labels == [("phase_bias", keys[0].group)]


@pytest.mark.parametrize(
    "cycles", [[3.0, -7.5, 12.0], [3.0, -7.5, 12.0, 0.5, 5.75, 8.0, -2.5]], ids=["few", "another"]
)
def test_no_half_integers_where_chance_may_have_made_them(cycles):
    state, arcs, _ = filter_of(cycles, sigma_cycles=0.005)
    assert attempt(state, arcs).fixed == ()
    assert all(arc.integer is None for arc in arcs)


def test_no_wrong_integers_in_many_trials():
    """Fewer accepted integers of weak models than the failure rate are wrong."""
    accepted = wrong = 0
    random = np.random.default_rng(1)
    for seed in range(600):
        cycles = random.integers(-20, 20, 7)
        state, arcs, _ = filter_of(cycles, sigma_cycles=0.17, seed=seed)
        attempt(state, arcs, smallest_ratio=1.0)
        integers = [arc.integer for arc in arcs]
        for arc, cycle in zip(arcs, cycles.tolist(), strict=True):
            if arc.integer is not None:
                accepted += 1
                wrong += arc.integer != cycle - cycles[-1]
        assert integers[-1] in (0.0, None)
    assert accepted > 100
    assert wrong <= 0.001 * accepted + 3.0 * np.sqrt(0.001 * accepted)
