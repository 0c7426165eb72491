"""Numbers of keys that occur in many rows."""

from __future__ import annotations

import numpy as np
import pytest

from vtff_iono.links.key_numbers import number_keys, rows_by_number


@pytest.mark.parametrize("different", [1, 40, 3000])
def test_keys_have_numbers_in_the_order_in_which_they_appear(different):
    rng = np.random.default_rng(different)
    # Keys of up to seven bytes, as those of links are, and negative ones.
    choice = rng.integers(-(2**55), 2**55, different)
    keys = rng.choice(choice, 20_000)
    found = number_keys(keys)
    np.testing.assert_array_equal(found.keys[found.number], keys)
    np.testing.assert_array_equal(found.keys, keys[found.first])
    assert (np.diff(found.first) > 0).all()
    np.testing.assert_array_equal(np.sort(found.keys), np.unique(keys))


def test_rows_of_each_number_in_their_order():
    number = np.array([2, 0, 2, 3, 0])
    rows = [of_number.tolist() for of_number in rows_by_number(number, 4)]
    assert rows == [[1, 4], [], [0, 2], [3]]


def test_no_rows():
    found = number_keys(np.zeros(0, dtype=np.int64))
    assert len(found.keys) == len(found.first) == len(found.number) == 0
    assert rows_by_number(found.number, 0) == []
