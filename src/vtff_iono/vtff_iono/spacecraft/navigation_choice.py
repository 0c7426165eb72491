"""Whether the states of a second come from relative navigation or from the receivers' own fixes.

Relative navigation is good to millimetres, a fix to metres, and in scintillation a fix may be off
by a hundred metres for seconds. Relative navigation that has lost its way stays lost. Therefore a
contradiction overrules it only when it lasts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray

__all__ = ["NavigationChoice"]

# m; larger than any error of a fix in quiet plasma or of relative navigation that works.
_LARGEST_CONTRADICTION = 50.0
# s; for which a contradiction has lasted that overrules relative navigation, without a fix that
# agrees. Fades of a bubble that is crossed are shorter.
_PATIENCE = 60.0


class NavigationChoice:
    """Chooses the states of a formation, second by second."""

    def __init__(self) -> None:
        # For each deputy since when its relative navigation has been contradicted, ns.
        self._contradicted_since: dict[int, int] = {}

    def choose(
        self,
        time: int,
        pairs: Sequence[tuple[FloatArray, FloatArray] | None],
        fixes: Sequence[FloatArray | None],
    ) -> tuple[tuple[FloatArray | None, ...], tuple[bool, ...]]:
        """Return the states of the chief and the deputies, and which deputies are not lost.

        Parameters
        ----------
        time : int
            GPS time, ns.
        pairs : sequence of tuple of 2 ndarray, shape (6,), or None
            For each deputy the states of chief and deputy in ITRF, m and m/s, as relative
            navigation has them. The chief's state is that of the first deputy that is not lost.
        fixes : sequence of ndarray, shape (6,), or None
            Own solutions of the receivers of chief and deputies.
        """
        states, has_chief_state = list(fixes), False
        are_trusted = []
        for deputy, pair in enumerate(pairs, 1):
            of_receivers = (fixes[0], fixes[deputy])
            is_trusted = not self._is_lost(deputy, time, pair, of_receivers)
            if pair is not None and is_trusted:
                states[deputy] = pair[1]
                if not has_chief_state:
                    states[0], has_chief_state = pair[0], True
            are_trusted.append(is_trusted)
        return tuple(states), tuple(are_trusted)

    def _is_lost(
        self,
        deputy: int,
        time: int,
        pair: tuple[FloatArray, FloatArray] | None,
        fixes: tuple[FloatArray | None, FloatArray | None],
    ) -> bool:
        """Return whether the fixes have contradicted relative navigation for long."""
        if pair is None:
            return False
        distances = [
            math.dist(fix[:3].tolist(), state[:3].tolist())
            for fix, state in zip(fixes, pair, strict=True)
            if fix is not None
        ]
        if distances and max(distances) <= _LARGEST_CONTRADICTION:
            self._contradicted_since.pop(deputy, None)
        elif distances:
            self._contradicted_since.setdefault(deputy, time)
        since = self._contradicted_since.get(deputy, time)
        return time - since >= _PATIENCE * NANOSECONDS_PER_SECOND
