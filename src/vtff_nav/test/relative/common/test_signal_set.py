"""Sets of signals: what follows from names, and columns that are kept from epoch to epoch."""

from __future__ import annotations

import numpy as np

from vtff_gnss.signals import SignalKey
from vtff_nav.relative.common.signal_set import SignalPlaces, SignalSet, with_places

SIGNALS = SignalSet(
    SignalKey(system, prn, band, ord("C"))
    for system, prn, band in ((0, 7, 1), (0, 7, 2), (3, 2, 1))
)


def test_names():
    assert SIGNALS.satellites == ((0, 7), (0, 7), (3, 2))
    assert SIGNALS.ordered_satellites == ((0, 7), (3, 2))
    assert SIGNALS.satellite_rows.tolist() == [0, 0, 1]
    assert SIGNALS.groups == tuple(key.group for key in SIGNALS)
    assert SIGNALS.rows[SIGNALS[2]] == 2
    assert [column.tolist() for column in SIGNALS.name_columns] == [
        [0, 0, 3], [7, 7, 2], [1, 2, 1], [ord("C")] * 3,
    ]  # fmt: skip


def test_some_rows_are_the_same_object_again():
    rows = np.array([0, 2])
    chosen = SIGNALS.select(rows)
    assert chosen == (SIGNALS[0], SIGNALS[2])
    assert SIGNALS.select(rows.copy()) is chosen


def test_places_stay_and_columns_grow():
    places = SignalPlaces()
    assert places.of(SIGNALS).tolist() == [0, 1, 2]
    assert places.of(SIGNALS) is places.of(SIGNALS)
    assert places.of(SIGNALS.select(np.array([2, 0]))).tolist() == [2, 0]
    assert (len(places), places[SIGNALS[1]]) == (3, 1)
    column = with_places(np.zeros((2, 0)), places, -1.0)
    assert column.shape[1] >= 3
    assert (column == -1.0).all()
    assert with_places(column, places) is column
    assert places.of(SignalSet()).shape == (0,)


def test_places_are_those_of_their_owner_alone():
    other = SignalPlaces()
    other.of(SignalSet(SignalKey(0, prn, 1, ord("C")) for prn in range(2, 33)))
    places = SignalPlaces()
    alone = SignalSet([SignalKey(2, 1, 1, ord("C"))])
    assert alone[0] not in places
    assert places.of(alone).tolist() == [0]
    assert (len(places), len(other)) == (1, 31)


def test_old_sets_are_forgotten_and_their_places_stay():
    places = SignalPlaces()
    first = places.of(SIGNALS).tolist()
    for prn in range(1, 100):
        places.of(SignalSet([SignalKey(6, prn, 1, ord("C"))]))
    assert places.of(SIGNALS).tolist() == first
