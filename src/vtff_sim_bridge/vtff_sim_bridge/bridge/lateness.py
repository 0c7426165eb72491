"""Lateness of the steps of a run that the wall clock paces."""

from __future__ import annotations

#: Part of a step by which a step may begin late before it counts as late.
TOLERATED_STEPS = 0.5


class Lateness:
    """Compares the begin of each step with its time.

    Parameters
    ----------
    step
        Length of a step, s.
    maximum_steps
        Steps that the run may be late; 0 for no limit.

    Attributes
    ----------
    late_steps
        Number of steps that began late.
    largest
        Largest delay of a step so far, s.
    is_late
        Whether the newest step began late.
    """

    def __init__(self, step: float, maximum_steps: float) -> None:
        self._step = step
        self._maximum_steps = maximum_steps
        self.late_steps = 0
        self.largest = 0.0
        self.is_late = False

    def note(self, delay: float) -> bool:
        """Note by how many s a step began after its time; return whether a late phase begins."""
        was_late = self.is_late
        self.is_late = delay > TOLERATED_STEPS * self._step
        self.late_steps += self.is_late
        self.largest = max(self.largest, delay)
        return self.is_late and not was_late

    def exceeds_limit(self, delay: float) -> bool:
        """Return whether a delay, s, is more than the run may have."""
        return 0.0 < self._maximum_steps * self._step < delay
