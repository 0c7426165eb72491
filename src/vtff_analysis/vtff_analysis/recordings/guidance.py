"""Messages of formation_guidance as arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_node.stamps import to_nanoseconds

__all__ = ["GUIDANCE_TOPIC", "GuidanceCollector", "GuidanceHistory"]

GUIDANCE_TOPIC = "/formation/guidance"

#: Names of vtff_msgs/FormationGuidance.MODE_*, in their order.
MODE_NAMES = ("hold", "keep", "reconfigure", "phase", "free drift", "abort", "plug-in")


@dataclass(frozen=True, eq=False)
class GuidanceHistory:
    """What formation_guidance wanted: n steps, k spacecraft, the chief first.

    Attributes
    ----------
    time
        ns since 1970, shape (n,).
    spacecraft
        Names.
    mode
        Index in `MODE_NAMES`, shape (n,).
    formation, reason
        Formation that is kept or approached, and why a request was refused or the mode changed.
    closest_approach
        Smallest distance of any pair at any time of the plan, m, shape (n,); NaN without a plan.
    position_rtn
        Wanted position relative to the chief, m, shape (n, k, 3).
    velocity_change
        Sum of commanded magnitudes since the start, m/s, shape (n, k).
    """

    time: npt.NDArray[np.int64]
    spacecraft: tuple[str, ...]
    mode: npt.NDArray[np.intp]
    formation: tuple[str, ...]
    reason: tuple[str, ...]
    closest_approach: FloatArray
    position_rtn: FloatArray
    velocity_change: FloatArray


class GuidanceCollector:
    """Takes the messages of formation_guidance."""

    def __init__(self) -> None:
        self._messages: list[Any] = []

    def add(self, message: Any) -> None:
        """Take a vtff_msgs/FormationGuidance; one of other spacecraft than before is left out."""
        if not self._messages or list(message.spacecraft) == list(self._messages[0].spacecraft):
            self._messages.append(message)

    def history(self) -> GuidanceHistory | None:
        """Return what was taken; None without messages."""
        messages = self._messages
        if not messages:
            return None
        return GuidanceHistory(
            time=np.array([to_nanoseconds(m.header.stamp) for m in messages], dtype=np.int64),
            spacecraft=tuple(messages[0].spacecraft),
            mode=np.array([min(m.mode, len(MODE_NAMES) - 1) for m in messages]),
            formation=tuple(m.formation for m in messages),
            reason=tuple(m.reason for m in messages),
            closest_approach=np.array([m.closest_approach for m in messages]),
            position_rtn=np.array([np.reshape(m.position, (-1, 3)) for m in messages]),
            velocity_change=np.array([m.velocity_change for m in messages]),
        )
