"""Identity of satellites and signals: numbers and names are inverses and sort alike."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vtff_gnss import constants as c
from vtff_gnss.signals import (
    SignalKey,
    satellite_from_number,
    satellite_number,
    satellite_number_of_signal,
    signal_from_number,
    signal_number,
)

keys = st.builds(
    SignalKey,
    system=st.integers(0, len(c.SYSTEM_LETTERS) - 1),
    prn=st.integers(0, 255),
    band=st.integers(0, 9),
    attribute=st.integers(ord("A"), ord("Z")),
)


@given(keys)
def test_a_number_gives_back_its_signal_and_its_satellite(key):
    number = signal_number(*key)
    assert signal_from_number(int(number)) == key
    assert satellite_number_of_signal(number) == satellite_number(*key.satellite)
    assert satellite_from_number(satellite_number(*key.satellite)) == key.satellite


@given(st.lists(keys, min_size=1, max_size=20))
def test_numbers_of_arrays_sort_as_the_names_do(drawn):
    columns = np.array(drawn, dtype=np.uint8).T
    numbers = signal_number(*columns)
    assert [signal_from_number(n) for n in np.sort(numbers)] == sorted(drawn)


def test_a_key_reads_as_the_field_writes_it():
    key = SignalKey(c.SYSTEM_GPS, 5, 1, ord("C"))
    assert str(key) == "G05 L1C"
    assert key.group == (c.SYSTEM_GPS, 1, ord("C"))
