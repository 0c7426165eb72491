"""Sets of signals: what follows from names, and columns that are kept from epoch to epoch."""

from __future__ import annotations

import numpy as np

from vtff_gnss.signals import SignalKey
from vtff_nav.relative.common.signal_set import SignalSet, place_of, with_places

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
    assert chosen.places.tolist() == SIGNALS.places[rows].tolist()


def test_places_stay_and_columns_grow():
    assert SIGNALS.places.tolist() == [place_of(key) for key in SIGNALS]
    assert len(set(SIGNALS.places.tolist())) == len(SIGNALS)
    column = with_places(np.zeros((2, 0)), SIGNALS, -1.0)
    assert column.shape[1] > SIGNALS.largest_place
    assert (column == -1.0).all()
    assert with_places(column, SIGNALS) is column
    assert SignalSet().largest_place == -1
