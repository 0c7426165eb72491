"""The step source of a lockstep run: it begins the steps and decides when a step is complete.

A step is complete (`StepSource.is_complete`) when all nodes have acknowledged it
(`vtff_node.lockstep`) and all awaited data have come.
The simulator bridge, a receiver log and a replayed bag can each be the step source of a run.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from vtff_msgs.msg import StepDone
from vtff_node.lockstep import StepCoordinator
from vtff_node.node import STEP_DONE_TOPIC, VtffNode
from vtff_node.parameters import parameter
from vtff_node.stamps import to_nanoseconds

__all__ = ["StepSource", "StepSourceParameters"]

#: Steps that may begin in one callback; then the executor takes in acknowledgements again.
STEPS_AT_ONCE = 20


@dataclass(frozen=True)
class StepSourceParameters:
    """Parameters of every node that can be a step source; tables of such nodes inherit them."""

    lockstep_participants: list[str] = parameter(
        [], "in lockstep, fully qualified nodes that must acknowledge each step"
    )
    lockstep_side_branches: list[str] = parameter(
        [], "in lockstep, nodes that must acknowledge but may lag (recorder, viewer)"
    )
    expected_nodes: list[str] = parameter(
        [], "fully qualified nodes of the system; absent nodes are named when a step hangs"
    )
    maximum_lag: int = parameter(
        50, "in lockstep, steps a side branch may lag", minimum=0, maximum=500
    )
    # A first run compiles: 90 s of a processor, which 16 processes of a loaded machine share.
    start_timeout: float = parameter(
        600.0,
        "wall time until all nodes have done the first step",
        unit="s",
        minimum=0.1,
    )
    # Longer than the `compute_limit` of plug-ins, so that a slow plug-in is named itself.
    step_timeout: float = parameter(
        15.0, "wall time for all participants to finish a later step", unit="s", minimum=0.1
    )


class StepSource:
    """Collects the acknowledgements of the steps that a node begins.

    Parameters
    ----------
    node : VtffNode
        The node that begins the steps.
    parameters : StepSourceParameters
        Names of the nodes that a step waits for, and how long it waits.
    on_acknowledged : callable
        Called after each acknowledgement of a step, in lockstep only.
    awaited_data : callable, optional
        Yields one text for each piece of data that the current step still waits for, besides the
        acknowledgements. After each message the first is asked for, no more.
    preparing : iterable of str
        Fully qualified nodes that must report ready before the first step.
    steady_clock : callable
        Wall time in s.

    Attributes
    ----------
    unprepared : set of str
        Nodes that have not reported ready yet.
    """

    def __init__(
        self,
        node: VtffNode,
        parameters: StepSourceParameters,
        on_acknowledged: Callable[[], None],
        *,
        awaited_data: Callable[[], Iterable[str]] = list,
        preparing: Iterable[str] = (),
        steady_clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._node = node
        self._parameters = parameters
        self._on_acknowledged = on_acknowledged
        self._awaited_data = awaited_data
        self.unprepared = set(preparing)
        self._steady_clock = steady_clock
        self._coordinator = StepCoordinator(
            parameters.lockstep_participants,
            parameters.lockstep_side_branches,
            parameters.maximum_lag,
        )
        self._step_began = steady_clock()
        if node.lockstep or self.unprepared:
            # Latched: a node may have reported ready before this node was discovered.
            node.subscribe(StepDone, STEP_DONE_TOPIC, self.acknowledge, latched=True)

    @property
    def step(self) -> int:
        """Number of the current step, -1 before the first."""
        return self._coordinator.step

    @property
    def is_complete(self) -> bool:
        """Whether every participant has finished the current step and all its data have come."""
        return self._coordinator.complete and next(iter(self._awaited_data()), None) is None

    def begin(self, stamp_nanoseconds: int) -> None:
        """Begin the next step, named by its stamp in ns since 1970."""
        self._step_began = self._steady_clock()
        self._coordinator.begin(stamp_nanoseconds)

    def advance(self, begin_next: Callable[[], None]) -> None:
        """Call `begin_next` while the current step is complete; without participants repeatedly."""
        for _ in range(STEPS_AT_ONCE):
            if self._node.finished or not self.is_complete:
                return
            begin_next()

    def acknowledge(self, message: StepDone) -> None:
        """Take the acknowledgement of a node, or its report that it is ready (zero stamp)."""
        stamp_nanoseconds = to_nanoseconds(message.header.stamp)
        if stamp_nanoseconds == 0:
            self.unprepared.discard(message.node)
        elif self._node.lockstep:
            self._coordinator.acknowledge(message.node, stamp_nanoseconds)
            self._on_acknowledged()

    def describe_hanging_step(self) -> str:
        """Return which nodes and data the current step has waited for too long.

        Returns
        -------
        str
            One line; empty while the step is complete or the time for it has not run out.
        """
        is_first = self.step == 0
        patience = self._parameters.start_timeout if is_first else self._parameters.step_timeout
        if self._steady_clock() - self._step_began <= patience or self.is_complete:
            return ""
        awaited = [
            f"{name} (" + (f"last did step {step}" if step >= 0 else "never answered") + ")"
            for name, step in self._coordinator.missing().items()
        ]
        awaited += self._awaited_data()
        absent = self._node.absent_nodes(self._parameters.expected_nodes)
        return (
            f"step {self.step} was not finished within {patience:.0f} s "
            f"({'start_timeout' if is_first else 'step_timeout'}); waiting for {', '.join(awaited)}"
            + (f"; not in the graph: {', '.join(absent)}" if absent else "")
        )

    def describe_unprepared_nodes(self) -> str:
        """Return, in one line, which nodes have not reported ready within the time to start."""
        absent = self._node.absent_nodes(sorted(self.unprepared))
        nodes = [
            f"{name} " + ("is not in the graph" if name in absent else "did not report ready")
            for name in sorted(self.unprepared)
        ]
        patience = self._parameters.start_timeout
        return (
            f"within {patience:.0f} s (start_timeout) {' and '.join(nodes)}; the logs and "
            "/diagnostics of these nodes say why, or the machine is busy"
        )
