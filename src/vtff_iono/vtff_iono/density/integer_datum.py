"""Integers of single differences that outlive the filter that found them, in one datum.

Relative navigation tells double differences with a reference satellite. Two things are done with
them here, because the electron density rests on one constant that all satellites have in common:

- that constant, the ambiguity of the reference, must not change with the reference satellite;
- an integer holds for as long as the phases of both receivers are continuous, also while the
  filter, which sees scintillation as errors of millimetres, does not dare to use it.

An integer that has proved right, because its satellite agrees with others, is not overruled by what
relative navigation tells later.
"""

from __future__ import annotations

import collections
from collections.abc import Hashable, Mapping

from vtff_iono.spacecraft.formation_second import Group

__all__ = ["IntegerDatum"]


class IntegerDatum:
    """Integers in a datum of their own; see the module.

    Attributes
    ----------
    number : int
        Number of the datum; it changes when nothing connects a table with the one before.
    """

    def __init__(self) -> None:
        self.number = 0
        self._known: dict[Group, dict[int, tuple[float, Hashable]]] = {}
        self._refused: dict[Group, dict[int, tuple[float, Hashable]]] = {}
        self._proved: dict[Group, set[int]] = {}

    def update(
        self,
        table: Mapping[tuple[Group, int], float],
        continuity: Mapping[tuple[Group, int], Hashable],
    ) -> dict[tuple[Group, int], float]:
        """Return the integers that hold now, by group and satellite, in the datum.

        Parameters
        ----------
        table : mapping of (Group, prn) to float
            Integers that relative navigation holds, cycles relative to a reference of each group.
        continuity : mapping of (Group, prn) to hashable
            For each signal with continuous phases in both receivers something that changes when
            the continuity is broken; a signal that is not in it has no integer.
        """
        result: dict[tuple[Group, int], float] = {}
        for group in sorted({group for group, _ in table} | set(self._known)):
            held = {
                prn: cycles
                for prn, (cycles, unbroken) in self._known.get(group, {}).items()
                if continuity.get((group, prn)) == unbroken
            }
            told = {
                prn: cycles
                for (other, prn), cycles in table.items()
                if other == group and (group, prn) in continuity
            }
            refused = self._refused.get(group, {})
            proved = self._proved.get(group, set()) & held.keys()
            shifts = collections.Counter(
                held[prn] - cycles for prn, cycles in told.items() if prn in held
            )
            if shifts:
                # All agree, unless an integer has been found to be wrong: then the others rule.
                shift = shifts.most_common(1)[0][0]
                held |= {
                    prn: cycles + shift
                    for prn, cycles in told.items()
                    if prn not in proved
                    and refused.get(prn) != (cycles + shift, continuity[group, prn])
                }
            elif len(told) > len(held):
                self.number += 1
                held, proved = told, set()
            self._proved[group] = proved
            self._known[group] = {
                prn: (cycles, continuity[group, prn]) for prn, cycles in held.items()
            }
            result |= {(group, prn): cycles for prn, cycles in held.items()}
        return result

    def resolve(self, group: Group, prn: int, cycles: float, unbroken: Hashable) -> None:
        """Take an integer that was found otherwise, in the datum; it counts as proved."""
        self._known.setdefault(group, {})[prn] = (cycles, unbroken)
        self._refused.get(group, {}).pop(prn, None)
        self.prove(group, prn)

    def prove(self, group: Group, prn: int) -> None:
        """Trust an integer for as long as its phases are continuous."""
        if prn in self._known.get(group, {}):
            self._proved.setdefault(group, set()).add(prn)

    def is_proved(self, group: Group, prn: int) -> bool:
        """Return whether an integer is trusted."""
        return prn in self._proved.get(group, set())

    def forget(self, group: Group, prn: int) -> None:
        """Give up an integer that has proved wrong, for as long as its phases are continuous."""
        self._proved.get(group, set()).discard(prn)
        known = self._known.get(group, {}).pop(prn, None)
        if known is not None:
            self._refused.setdefault(group, {})[prn] = known
