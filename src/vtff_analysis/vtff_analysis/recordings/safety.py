"""What formation_safety has said in a run: modes, reasons, isolated axes, predictions."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from vtff_node.stamps import to_nanoseconds

__all__ = ["SAFETY_TOPIC", "DeputySafety", "SafetyCollector", "SafetyHistory"]

SAFETY_TOPIC = "/formation/safety"

_MODE_WATCH = 1  # vtff_msgs/FormationSafety.MODE_*
_MODE_EVADE = 2
_AXES = ((1, "R"), (2, "T"), (4, "N"))


@dataclass
class DeputySafety:
    """What happened to a deputy.

    Attributes
    ----------
    steps, watched, taken_over
        Judged steps, those in which it was watched, and those in which it was taken over.
    taken_over_time
        When it was first taken over, ns since 1970; None if it was not.
    reason
        Why; empty if it was not.
    isolated
        Axes of its thruster that were shut off.
    """

    steps: int = 0
    watched: int = 0
    taken_over: int = 0
    taken_over_time: int | None = None
    reason: str = ""
    isolated: set[str] = field(default_factory=set)


@dataclass
class SafetyHistory:
    """What the safety monitor has said; lengths in m.

    Attributes
    ----------
    hard_radius
        Hard radius of the run.
    deputies
        By name.
    separation, separation_pair
        Smallest separation that was predicted with all thrust off, and of which pair.
    probability
        Largest probability of being inside the hard radius that was predicted.
    """

    hard_radius: float
    deputies: dict[str, DeputySafety]
    separation: float = math.inf
    separation_pair: str = ""
    probability: float = 0.0

    @property
    def taken_over(self) -> dict[str, DeputySafety]:
        """Return the deputies that were taken over."""
        return {name: deputy for name, deputy in self.deputies.items() if deputy.taken_over}


class SafetyCollector:
    """Takes the messages of the safety monitor."""

    def __init__(self) -> None:
        self.history: SafetyHistory | None = None

    def add(self, message: Any) -> None:
        """Take a vtff_msgs/FormationSafety."""
        if self.history is None:
            self.history = SafetyHistory(message.hard_radius, {})
        history = self.history
        for name, mode, axes, reason in zip(
            message.spacecraft, message.mode, message.isolated_axes, message.reason, strict=True
        ):
            deputy = history.deputies.setdefault(name, DeputySafety())
            deputy.steps += 1
            deputy.watched += mode == _MODE_WATCH
            deputy.taken_over += mode >= _MODE_EVADE
            deputy.isolated |= {axis for bit, axis in _AXES if axes & bit}
            if mode >= _MODE_EVADE and deputy.taken_over_time is None:
                deputy.taken_over_time = to_nanoseconds(message.header.stamp)
                deputy.reason = reason
        for first, second, separation, probability in zip(
            message.first, message.second, message.separation, message.probability, strict=True
        ):
            if separation < history.separation:
                history.separation, history.separation_pair = separation, f"{first}-{second}"
            history.probability = max(history.probability, probability)
