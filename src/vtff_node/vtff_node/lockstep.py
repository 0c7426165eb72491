"""Which node has finished which step: the bookkeeping of lockstep, without ROS.

The publisher of a step names it by its stamp. Participants acknowledge that stamp;
the next step may begin when every participant has acknowledged the current one and
every side branch (recorder, viewer) is at most a few steps behind.
"""

from __future__ import annotations

from collections.abc import Iterable


class StepCoordinator:
    """Keeps the acknowledgements of steps and says whether all nodes have acknowledged.

    Parameters
    ----------
    participants
        Fully qualified names of the nodes that must finish a step before the next begins.
    side_branches
        Names of the nodes that may lag.
    maximum_lag
        Steps a side branch may be behind.
    """

    def __init__(
        self, participants: Iterable[str], side_branches: Iterable[str] = (), maximum_lag: int = 50
    ) -> None:
        self._lag_allowed = {name: 0 for name in participants}
        self._lag_allowed.update({name: maximum_lag for name in side_branches})
        self._steps: dict[int, int] = {}
        self._acknowledged = {name: -1 for name in self._lag_allowed}
        self._step = -1
        self._waiting_for = set(self._lag_allowed)

    @property
    def step(self) -> int:
        """Number of the current step, -1 before the first."""
        return self._step

    def begin(self, stamp_nanoseconds: int) -> None:
        """Begin the next step, which this stamp names."""
        self._step += 1
        self._steps[stamp_nanoseconds] = self._step
        self._waiting_for = {name for name in self._lag_allowed if self._is_behind(name)}

    def acknowledge(self, node: str, stamp_nanoseconds: int) -> bool:
        """Note that a node has finished the step of this stamp.

        Returns
        -------
        bool
            True if this acknowledgement completed the current step. Unknown nodes,
            unknown stamps and repetitions change nothing.
        """
        step = self._steps.get(stamp_nanoseconds)
        if step is None or self._acknowledged.get(node, step) >= step:
            return False
        self._acknowledged[node] = step
        if node not in self._waiting_for or self._is_behind(node):
            return False
        self._waiting_for.discard(node)
        if self._waiting_for:
            return False
        self._forget_old_steps()
        return True

    @property
    def complete(self) -> bool:
        """Whether the next step may begin."""
        return not self._waiting_for

    def missing(self) -> dict[str, int]:
        """Return the nodes that the current step waits for, with their last finished step.

        The number is -1 for a node that has finished none.
        """
        return {name: self._acknowledged[name] for name in sorted(self._waiting_for)}

    def _is_behind(self, name: str) -> bool:
        # The first step waits for every node, so that none misses the start.
        lag = self._lag_allowed[name] if self._step > 0 else 0
        return self._acknowledged[name] < self._step - lag

    def _forget_old_steps(self) -> None:
        if len(self._steps) > 4096:
            oldest = min(self._acknowledged.values(), default=self._step)
            self._steps = {stamp: step for stamp, step in self._steps.items() if step >= oldest}
