"""Compiled arithmetic rounds as that of Python and numpy, to the last bit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from vtff_dynamics.rounding import exact_total, power, total

NUMBERS = st.floats(-1e30, 1e30, allow_subnormal=False)


@given(arrays(float, st.integers(0, 128), elements=NUMBERS))
def test_totals_are_those_of_numpy_and_python(values):
    assert total(values) == values.sum()
    assert exact_total(values) == math.fsum(values.tolist())


def test_sums_in_another_order_are_other_ones():
    """The comparison above can fail."""
    values = np.random.default_rng(3).normal(size=(200, 20))
    assert any(total(row) != sum(row.tolist()) for row in values)
    assert any(exact_total(row) != sum(row.tolist()) for row in values)


@pytest.mark.parametrize(
    "values",
    [
        (1.0, 2.0**-53, 2.0**-106),
        (1.0, 2.0**-53, -(2.0**-106)),
        (1.0, 2.0**-53),
        (-1.0, -(2.0**-53), -(2.0**-120)),
        (1e16, 1.0, 1e-16),
        (1e16, 1.0, -1e16),
    ],
)
def test_halves_of_the_last_bit_are_rounded_as_python_does(values):
    assert exact_total(np.array(values)) == math.fsum(values)


@given(NUMBERS, st.sampled_from((2.0, 3.0, -2.0, 0.5)))
def test_powers_are_those_of_python(value, exponent):
    value = abs(value) if exponent != int(exponent) else value
    try:
        expected = value**exponent
    except (ZeroDivisionError, OverflowError):
        return
    assert power(value, exponent) == expected


def test_a_power_is_no_product():
    """The C library rounds some squares otherwise; where it does not, nothing is to be tested."""
    values = np.random.default_rng(5).uniform(0.01, 10.0, 20_000).tolist()
    other = [value for value in values if value**2 != value * value]
    assert all(power(value, 2.0) == value**2 for value in other)


def test_powers_of_what_is_not_finite():
    assert power(math.inf, 2.0) == power(-math.inf, 2.0) == math.inf
    assert math.isnan(power(math.nan, 2.0))
