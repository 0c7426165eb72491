"""Integers of single differences that keep one datum while the reference satellite changes.

Double differences tell the ambiguity of each satellite relative to a reference satellite. That of
the reference itself is arbitrary: it adds one constant to the differential TEC of all satellites.
The constant must not change when another satellite becomes the reference, because the electron
density rests on it.
"""

from __future__ import annotations

import collections
from collections.abc import Hashable, Mapping
from dataclasses import dataclass

__all__ = ["FixedInteger", "IntegerDatum"]

Group = tuple[int, int, int]
"""System, band and attribute."""


@dataclass(frozen=True)
class FixedInteger:
    """An integer as the relative navigation tells it.

    Parameters
    ----------
    cycles : float
        Double difference with the reference satellite of the group.
    decision : hashable
        Changes when the integer is decided anew, e.g. the time at which it was fixed.
    """

    cycles: float
    decision: Hashable


class IntegerDatum:
    """Integers in a datum of their own; see the module.

    Attributes
    ----------
    number : int
        Number of the datum; it changes when no satellite connects a table with the one before.
    """

    def __init__(self) -> None:
        self.number = 0
        self._known: dict[Group, dict[int, tuple[float, Hashable]]] = {}

    def update(
        self, table: Mapping[tuple[Group, int], FixedInteger]
    ) -> dict[tuple[Group, int], float]:
        """Return the integers of a table, by group and satellite, in the datum.

        Parameters
        ----------
        table : mapping of (Group, prn) to FixedInteger
            All integers that are fixed at an epoch.
        """
        by_group: dict[Group, dict[int, FixedInteger]] = {}
        for (group, prn), entry in table.items():
            by_group.setdefault(group, {})[prn] = entry
        result: dict[tuple[Group, int], float] = {}
        for group, entries in by_group.items():
            before = self._known.get(group, {})
            shifts = collections.Counter(
                before[prn][0] - entry.cycles
                for prn, entry in entries.items()
                if prn in before and before[prn][1] == entry.decision
            )
            if shifts:
                # All agree, unless an integer has been changed without a word.
                shift = shifts.most_common(1)[0][0]
            else:
                shift = 0.0
                self.number += 1
                before = {}
            # Satellites that have set stay known: after a short loss of all others they connect.
            kept = dict(before)
            for prn, entry in entries.items():
                kept[prn] = (entry.cycles + shift, entry.decision)
                result[group, prn] = entry.cycles + shift
            self._known[group] = kept
        return result
