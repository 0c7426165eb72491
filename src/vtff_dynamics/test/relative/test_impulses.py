"""Impulsive control: the wanted change is reached at the least velocity change."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vtff_dynamics.relative.impulses import (
    InfeasibleChangeError,
    in_plane_impulses,
    least_impulses,
    least_velocity_change,
    out_of_plane_impulse,
)
from vtff_dynamics.relative.relative_elements import control_matrix, linear_map_rtn

MEAN_MOTION = 1.05e-3
lengths = st.lists(st.floats(-500.0, 500.0), min_size=6, max_size=6).map(np.array)


def effect(impulses, end=None):
    total = np.zeros(6)
    for impulse in impulses:
        change = control_matrix(MEAN_MOTION, impulse.mean_latitude) @ impulse.velocity_rtn
        if end is not None:
            change[1] -= 1.5 * (end - impulse.mean_latitude) * change[0]
        total += change
    return total


def size(impulses):
    return sum(np.abs(impulse.velocity_rtn).sum() for impulse in impulses)


@given(lengths)
def test_closed_forms_reach_the_change(change):
    pair = in_plane_impulses(change, MEAN_MOTION)
    np.testing.assert_allclose(effect(pair)[[0, 2, 3]], change[[0, 2, 3]], atol=1e-9)
    single = out_of_plane_impulse(change, MEAN_MOTION)
    np.testing.assert_allclose(effect([single])[4:], change[4:], atol=1e-9)
    in_plane, out_of_plane = least_velocity_change(change, MEAN_MOTION)
    assert size(pair) == pytest.approx(in_plane, abs=1e-12)
    assert size([single]) == pytest.approx(out_of_plane, abs=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_linear_programme_reaches_all_six_elements(seed):
    change = np.random.default_rng(seed).normal(0.0, 100.0, 6)
    end = 6.0 * math.pi
    impulses = least_impulses(change, MEAN_MOTION, 0.0, end)
    np.testing.assert_allclose(effect(impulses, end), change, atol=1e-5)
    # Never below the bound of any timing, which leaves the mean longitude free.
    assert size(impulses) >= sum(least_velocity_change(change, MEAN_MOTION)) * (1.0 - 1e-9)


def test_linear_programme_finds_the_closed_form_where_the_longitude_is_free_to_fit():
    change = np.array([0.0, 0.0, 0.0, 0.0, 30.0, 40.0])
    (impulse,) = least_impulses(change, MEAN_MOTION, 0.0, 2.0 * math.pi, samples=3601, axes="N")[:1]
    total = size(least_impulses(change, MEAN_MOTION, 0.0, 2.0 * math.pi, samples=3601))
    assert total == pytest.approx(50.0 * MEAN_MOTION, rel=1e-5)
    assert math.tan(impulse.mean_latitude) == pytest.approx(4.0 / 3.0, rel=0.02)


def test_what_cannot_be_reached_is_said():
    with pytest.raises(InfeasibleChangeError, match="along T"):
        least_impulses([0, 0, 0, 0, 10.0, 0], MEAN_MOTION, 0.0, 6.0, axes="T")


def deviations(impulses, change, start, end, drift):
    """Return the positions on the way against where the change leads, m, (k, 3)."""
    seen = []
    for latitude in np.linspace(start, end, 61):
        left = (end - latitude) / (end - start)
        given = [impulse for impulse in impulses if impulse.mean_latitude <= latitude + 1e-9]
        elements = -np.asarray(change)
        elements[1] -= 1.5 * (end - latitude) * change[0]
        elements = elements + effect(given, latitude) - left * np.asarray(drift)
        seen.append(linear_map_rtn(MEAN_MOTION, latitude)[:3] @ elements)
    return np.array(seen)


@pytest.mark.parametrize("seed", range(4))
def test_a_price_of_deviations_brings_impulses_earlier(seed):
    change = np.random.default_rng(seed).normal(0.0, 0.05, 6)
    start, end = 0.5, 0.5 + math.pi
    least = least_impulses(change, MEAN_MOTION, start, end, 61)
    means, prices = [], []
    for price in (0.0, 2.0, 8.0):
        impulses = least_impulses(change, MEAN_MOTION, start, end, 61, deviation_price=price)
        np.testing.assert_allclose(effect(impulses, end), change, atol=1e-6)
        path = deviations(impulses, change, start, end, np.zeros(6))
        means.append(np.abs(path).sum(axis=1).mean())
        prices.append(size(impulses))
        # What the programme makes least.
        cost = prices[-1] + price * MEAN_MOTION * means[-1]
        assert cost <= size(least) + price * MEAN_MOTION * means[0] + 1e-9
    assert means[2] <= means[1] + 1e-9 and means[1] <= means[0] + 1e-9
    assert prices[0] <= prices[1] + 1e-9 <= prices[2] + 2e-9


def test_a_steady_drift_is_shared_between_both_sides():
    """A pulse at the beginning, where the inclination can be changed, would only lead away."""
    drift = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.05])
    start, end = 0.5 * math.pi, 1.5 * math.pi
    means = []
    for before in (0.025, 0.0, -0.025):
        # In the middle at the start, or half a drift to one side of it.
        change = -drift + [0.0, 0.0, 0.0, 0.0, 0.0, before]
        impulses = least_impulses(
            change, MEAN_MOTION, start, end, 61, deviation_price=8.0, drift=drift
        )
        off = effect(impulses, end) - change
        assert np.abs(off[:5]).max() < 1e-6
        assert abs(off[5]) <= 0.025 + 1e-6
        means.append(deviations(impulses, change, start, end, drift)[:, 2])
    assert np.abs(means).max() < 0.04
