"""Integers of single differences that outlive the filter that found them, in one datum.

Relative navigation publishes integers of double differences with a reference satellite. Two things
are done with them here, because the electron density rests on one constant that all satellites have
in common:

- that constant, the ambiguity of the reference satellite, must not change when relative navigation
  chooses another reference satellite;
- an integer holds for as long as the phases of both receivers are continuous, also while the
  filter, which sees scintillation as errors of millimetres, does not use it.

An integer that has proved right, because the content of its satellite agrees with that of the
others, is not overruled by a later integer of relative navigation.
"""

from __future__ import annotations

import collections
from collections.abc import Hashable, Mapping
from typing import NamedTuple

from vtff_gnss.signals import SignalKey

__all__ = ["IntegerDatum"]

SignalGroup = tuple[int, int, int]
"""System, band and attribute: `SignalKey.group`."""


class _HeldInteger(NamedTuple):
    """An integer, cycles in the datum, and the continuity of the phases that it belongs to."""

    cycles: float
    continuity: Hashable


class IntegerDatum:
    """The integers that hold, relative to a reference that does not change with the satellites.

    Attributes
    ----------
    number : int
        Number of the datum. It grows when no satellite connects the integers of relative navigation
        with those held before, so that their common constant is a new one.
    changes : int
        It grows with each change of the integers that are held or trusted.
    """

    def __init__(self) -> None:
        self.number = self.changes = 0
        self._held: dict[SignalGroup, dict[SignalKey, _HeldInteger]] = {}
        self._refused: dict[SignalKey, _HeldInteger] = {}
        self._proved: dict[SignalGroup, set[SignalKey]] = {}
        # What the last update was given, None once integers were changed since, and its result.
        self._given: tuple[Mapping[SignalKey, float], Mapping[SignalKey, Hashable], bool] | None
        self._given = None
        self._holding: dict[SignalKey, float] = {}

    def update(
        self,
        fixed: Mapping[SignalKey, float],
        continuity: Mapping[SignalKey, Hashable],
        may_begin_anew: bool = True,
    ) -> dict[SignalKey, float]:
        """Return the integers that hold now, cycles in the datum.

        Parameters
        ----------
        fixed : mapping of SignalKey to float
            Integers that relative navigation has fixed, cycles relative to the reference satellite
            of each group of signals.
        continuity : mapping of SignalKey to hashable
            For each signal with continuous phases in both receivers a value that changes when the
            continuity is broken. A signal without an entry has no integer.
        may_begin_anew : bool
            Whether integers that nothing connects with those held may begin another datum. If not,
            those of the filter wait until an integer has been found in the old one: see `resolve`.
        """
        # As a rule nothing has changed since the second before: the same integers hold.
        given = (fixed, continuity, may_begin_anew)
        if given == self._given:
            return self._holding
        self.changes += 1
        result: dict[SignalKey, float] = {}
        for group in sorted({signal.group for signal in fixed} | set(self._held)):
            usable = {
                signal: cycles
                for signal, cycles in fixed.items()
                if signal.group == group and signal in continuity
            }
            result |= self._update_group(group, usable, continuity, may_begin_anew)
        self._given, self._holding = given, result
        return result

    def _update_group(
        self,
        group: SignalGroup,
        fixed: dict[SignalKey, float],
        continuity: Mapping[SignalKey, Hashable],
        may_begin_anew: bool,
    ) -> dict[SignalKey, float]:
        """Return the integers of one group that hold now; arguments as in `update`."""
        held = {
            signal: integer.cycles
            for signal, integer in self._held.get(group, {}).items()
            if continuity.get(signal) == integer.continuity
        }
        proved = self._proved.get(group, set()) & held.keys()
        shifts = collections.Counter(
            held[signal] - cycles for signal, cycles in fixed.items() if signal in held
        )
        if shifts:
            # All satellites show the same shift unless one of the integers is wrong: then the
            # majority decides.
            shift = shifts.most_common(1)[0][0]
            held |= {
                signal: cycles + shift
                for signal, cycles in fixed.items()
                if signal not in proved
                and self._refused.get(signal) != (cycles + shift, continuity[signal])
            }
        elif len(fixed) > len(held) and may_begin_anew:
            self.number += 1
            held, proved = fixed, set()
        self._proved[group] = proved
        self._held[group] = {
            signal: _HeldInteger(cycles, continuity[signal]) for signal, cycles in held.items()
        }
        return held

    def resolve(self, signal: SignalKey, cycles: float, continuity: Hashable) -> None:
        """Hold an integer, cycles in the datum, that was found here; it counts as proved."""
        self._forget_given()
        self._held.setdefault(signal.group, {})[signal] = _HeldInteger(cycles, continuity)
        self._refused.pop(signal, None)
        self.prove(signal)

    def prove(self, signal: SignalKey) -> None:
        """Trust the integer of a signal for as long as its phases are continuous."""
        if signal in self._held.get(signal.group, {}):
            self._forget_given()
            self._proved.setdefault(signal.group, set()).add(signal)

    def _forget_given(self) -> None:
        """Let the next update count, because the integers have changed since the last one."""
        self._given = None
        self.changes += 1

    def is_proved(self, signal: SignalKey) -> bool:
        """Return whether the integer of a signal is trusted."""
        return signal in self._proved.get(signal.group, set())

    def refuse(self, signal: SignalKey) -> None:
        """Give up an integer that is wrong, for as long as the phases are continuous."""
        self._forget_given()
        self._proved.get(signal.group, set()).discard(signal)
        integer = self._held.get(signal.group, {}).pop(signal, None)
        if integer is not None:
            self._refused[signal] = integer
