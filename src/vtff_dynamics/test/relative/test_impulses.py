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
from vtff_dynamics.relative.relative_elements import control_matrix

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
