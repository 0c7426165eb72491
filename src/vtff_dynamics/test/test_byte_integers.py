"""Integers of bytes are those that Python reads."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vtff_dynamics.byte_integers import read_integer


@given(st.binary(min_size=8, max_size=20), st.integers(1, 8), st.integers(0, 12))
def test_integers_are_those_of_python(content, length, place):
    place = min(place, len(content) - length)
    expected = int.from_bytes(content[place : place + length], "little", signed=length == 8)
    assert read_integer(np.frombuffer(content, dtype=np.uint8), place, length) == expected
