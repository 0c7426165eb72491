"""Signals of an epoch: what follows from their names alone, which stay the same for minutes."""

from __future__ import annotations

import functools
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from vtff_gnss.signals import SignalKey

__all__ = ["SignalPlaces", "SignalSet", "read_only", "with_places"]

_SETS_KEPT = 16
Number = TypeVar("Number", bound=np.generic)


class SignalSet(tuple[SignalKey, ...]):
    """Signals in the order of their rows in the columns of an epoch.

    Everything else is computed once: while a receiver tracks the same signals, the set is the same
    object.
    """

    @functools.cached_property
    def rows(self) -> dict[SignalKey, int]:
        """Row of each signal."""
        return {key: row for row, key in enumerate(self)}

    @functools.cached_property
    def satellites(self) -> tuple[tuple[int, int], ...]:
        """System and number of the satellite of each signal."""
        return tuple(key.satellite for key in self)

    @functools.cached_property
    def distinct_satellites(self) -> frozenset[tuple[int, int]]:
        """System and number of each satellite, once."""
        return frozenset(self.satellites)

    @functools.cached_property
    def groups(self) -> tuple[tuple[int, int, int], ...]:
        """Groups with a receiver bias of their own, in the order of their first signals."""
        return tuple(dict.fromkeys(key.group for key in self))

    @functools.cached_property
    def group_rows(self) -> npt.NDArray[np.int64]:
        """Row of the group of each signal in `groups`, shape (n,)."""
        row = {group: index for index, group in enumerate(self.groups)}
        return np.array([row[key.group] for key in self], dtype=np.int64)

    @functools.cached_property
    def ordered_satellites(self) -> tuple[tuple[int, int], ...]:
        """System and number of each satellite, once, in increasing order."""
        return tuple(sorted(self.distinct_satellites))

    @functools.cached_property
    def satellite_rows(self) -> npt.NDArray[np.int64]:
        """Row of the satellite of each signal in `ordered_satellites`, shape (n,)."""
        row = {satellite: index for index, satellite in enumerate(self.ordered_satellites)}
        return np.array([row[satellite] for satellite in self.satellites], dtype=np.int64)

    @functools.cached_property
    def name_columns(self) -> tuple[npt.NDArray[np.uint8], ...]:
        """System, number, band and attribute of the signals, shape (n,) each."""
        names = np.array(self, dtype=np.uint8).reshape(-1, 4)
        return tuple(read_only(column.copy()) for column in names.T)

    @functools.cached_property
    def _selected(self) -> dict[bytes, SignalSet]:
        return {}

    def select(self, rows: npt.NDArray[np.intp]) -> SignalSet:
        """Return the signals of some rows; the same object for the same rows."""
        name = rows.tobytes()
        selected = self._selected.get(name)
        if selected is None:
            if len(self._selected) >= _SETS_KEPT:
                self._selected.clear()
            selected = self._selected[name] = SignalSet(self[row] for row in rows.tolist())
        return selected


class SignalPlaces:
    """Places of signals in the columns that one owner keeps from epoch to epoch.

    A signal has a place from the moment at which its owner first asks for it.
    """

    def __init__(self) -> None:
        self._places: dict[SignalKey, int] = {}
        self._of_sets: dict[int, tuple[SignalSet, npt.NDArray[np.int64]]] = {}  # by identity

    def __len__(self) -> int:
        """Return the number of places."""
        return len(self._places)

    def __getitem__(self, key: SignalKey) -> int:
        """Return the place of a signal that has one."""
        return self._places[key]

    def __contains__(self, key: SignalKey) -> bool:
        """Return whether a signal has a place."""
        return key in self._places

    def of(self, signals: SignalSet) -> npt.NDArray[np.int64]:
        """Return the place of each signal, shape (n,); signals without one get it."""
        known = self._of_sets.get(id(signals))
        if known is not None:
            return known[1]
        rows = [self._places.setdefault(key, len(self._places)) for key in signals]
        places = read_only(np.array(rows, dtype=np.int64))
        if len(self._of_sets) >= _SETS_KEPT:
            self._of_sets.clear()
        self._of_sets[id(signals)] = signals, places
        return places


def read_only(column: npt.NDArray[Number]) -> npt.NDArray[Number]:
    """Return a column that is shared by many epochs, after nothing can be written to it."""
    column.flags.writeable = False
    return column


def with_places(
    column: npt.NDArray[Number], places: SignalPlaces, value: float = 0
) -> npt.NDArray[Number]:
    """Return a column, shape (..., m), that has all places.

    Parameters
    ----------
    column : ndarray
        Values by place; it is returned as it is, if it is long enough.
    places : SignalPlaces
    value : float
        Number that new places hold.
    """
    missing = len(places) - column.shape[-1]
    if missing <= 0:
        return column
    # Some more, so that columns hardly ever grow.
    shape = (*column.shape[:-1], missing + 64)
    return np.concatenate((column, np.full(shape, value, dtype=column.dtype)), axis=-1)
