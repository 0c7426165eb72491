"""Stretches of time over which the single differences of a link may be averaged together.

A link between a satellite and both spacecraft has an arc in each receiver and, as a rule, integers
for both of its signals. While neither changes, its single differences differ by noise and by the
ionosphere only. Every such stretch has a number, so that samples of different stretches are never
mixed in one mean.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, KeysView, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from vtff_gnss.signals import SignalKey

__all__ = ["LinkSignals", "PhaseStretch", "PhaseStretches"]


class LinkSignals(NamedTuple):
    """The two signals of a link, which name it in both receivers.

    Attributes
    ----------
    first, second : SignalKey
        Signals of one satellite, the one of the higher frequency first.
    """

    first: SignalKey
    second: SignalKey

    @property
    def prn(self) -> int:
        """Number of the satellite in its system."""
        return self.first.prn


@dataclass(eq=False)
class PhaseStretch:
    """A stretch of a link with the same arcs and the same integers.

    Parameters
    ----------
    number : int
        Number of the stretch; a later stretch has a higher number.
    signals : LinkSignals
    arcs : tuple of int
        Arcs of the link in the receivers of chief and deputy.
    continuity : tuple of hashable
        For both signals what changes when the phase of either receiver is interrupted.
    integers : tuple of float or None
        Integers of both signals, deputy less chief, cycles; None while one is not fixed.
    seconds_of_agreement : int
        For how many seconds in a row its content has agreed with that of the other satellites.
    origin : float
        Differential content of its first sample, TECU; NaN before.
    has_proved : bool
        Whether its integers have proved right by the agreement of its content with the others.
    """

    number: int
    signals: LinkSignals
    arcs: tuple[int, int]
    continuity: tuple[Hashable, Hashable]
    integers: tuple[float | None, float | None]
    seconds_of_agreement: int = 0
    origin: float = math.nan
    has_proved: bool = False

    @property
    def has_integers(self) -> bool:
        """Whether the integers of both signals are fixed."""
        return None not in self.integers


class PhaseStretches:
    """The stretches of all links, those that are over forgotten.

    A stretch that was interrupted, for example because its integers were not fixed for a while,
    is the same stretch when it continues. The arcs of a link are numbered upwards, so that a
    stretch whose arcs are not the latest ones of its link never continues: it may be forgotten as
    soon as no mean of a second needs it. What remains are the stretches of the latest arcs, a few
    for each link, however long the flight is.
    """

    def __init__(self) -> None:
        self._by_number: dict[int, PhaseStretch] = {}
        self._by_content: dict[
            tuple[
                LinkSignals,
                tuple[int, int],
                tuple[Hashable, Hashable],
                tuple[float | None, float | None],
            ],
            PhaseStretch,
        ] = {}
        self._latest_arcs: dict[LinkSignals, tuple[int, int]] = {}
        self._created = 0
        # Whether there may be a stretch that never continues.
        self._may_have_ended = False

    def __len__(self) -> int:
        """Return how many stretches are remembered."""
        return len(self._by_number)

    def numbers(self) -> KeysView[int]:
        """Return the numbers of the stretches that are remembered."""
        return self._by_number.keys()

    def __getitem__(self, number: int) -> PhaseStretch:
        """Return the stretch with a number."""
        return self._by_number[number]

    def continue_or_begin(
        self,
        arcs: Mapping[LinkSignals, tuple[int, int]],
        integers: Mapping[SignalKey, float],
        continuity: Mapping[SignalKey, Hashable],
    ) -> dict[LinkSignals, PhaseStretch]:
        """Return the stretch that each link has now, a new one where arcs or integers have changed.

        Parameters
        ----------
        arcs : mapping of LinkSignals to tuple of int
            Arcs of the links in the receivers of chief and deputy.
        integers : mapping of SignalKey to float
            Integers that hold now, deputy less chief, cycles.
        continuity : mapping of SignalKey to hashable
            For each signal what changes when the phase of either receiver is interrupted.
        """
        self._latest_arcs.update(arcs)
        self._may_have_ended = True
        current = {}
        for signals, arcs_of_link in arcs.items():
            content = (
                signals,
                arcs_of_link,
                (continuity.get(signals.first), continuity.get(signals.second)),
                (integers.get(signals.first), integers.get(signals.second)),
            )
            stretch = self._by_content.get(content)
            if stretch is None:
                stretch = PhaseStretch(self._created, *content)
                self._by_content[content] = self._by_number[self._created] = stretch
                self._created += 1
            current[signals] = stretch
        return current

    def forget_ended(self, numbers_in_use: Iterable[int]) -> None:
        """Forget the stretches that never continue, except those whose numbers are still in use."""
        if not self._may_have_ended:
            return
        self._may_have_ended = False
        in_use = set(numbers_in_use)
        for content, stretch in list(self._by_content.items()):
            signals, arcs = content[:2]
            if self._latest_arcs[signals] == arcs:
                continue
            if stretch.number in in_use:
                self._may_have_ended = True
            else:
                del self._by_content[content], self._by_number[stretch.number]
