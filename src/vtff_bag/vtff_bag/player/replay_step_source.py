"""Replay in lockstep: each step waits until the nodes under test have done the one before."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

from vtff_bag.file.errors import BagError
from vtff_bag.player.messages_in_order import (
    ReplaySelection,
    ReplayStep,
    replay_steps,
    select_topics,
    step_stamps,
)
from vtff_msgs.msg import StepDone
from vtff_node import diagnostics
from vtff_node.lockstep import StepCoordinator
from vtff_node.main import EXIT_FAILURE
from vtff_node.parameters import ParameterError
from vtff_node.stamps import to_nanoseconds, to_stamp

if TYPE_CHECKING:
    from vtff_bag.bag_player_node import BagPlayerNode, BagPlayerParameters
    from vtff_bag.file.reader import BagReader

POLL_INTERVAL = 0.05  # s of wall time between looks at the graph and the clock
SETTLE_TIME = 0.5  # s without a new topic, then the publishers of the nodes are known
STEPS_AT_ONCE = 20  # then acknowledgements are looked at again
READER_TIMEOUT = 3.0  # s that the first step waits for a reader of each topic

_NANOSECONDS = 1_000_000_000


class StepSource:
    """What the simulator is in a run: the source of steps, here from a bag.

    Parameters
    ----------
    node
        The player; it publishes.
    reader
        The bag.
    given
        Its parameters.

    Raises
    ------
    ParameterError
        If the bag has no steps.
    """

    def __init__(self, node: BagPlayerNode, reader: BagReader, given: BagPlayerParameters) -> None:
        self._node = node
        self._reader = reader
        self._given = given
        self._coordinator = StepCoordinator(
            given.lockstep_participants, given.lockstep_side_branches, given.maximum_lag
        )
        try:
            # The topics are known only when the nodes are; a bag without steps is refused now.
            stamps = step_stamps(reader, given.step_topic)
        except BagError as error:
            raise ParameterError(f"parameter 'step_topic': {error}") from error
        self._first_stamp, self._last_stamp = stamps[0], stamps[-1]
        self._steps: Iterator[ReplayStep] = iter(())
        self._waiting: ReplayStep | None = None
        self._running = False
        self._problem = ""
        self._made = time.monotonic()
        self._recomputed: frozenset[str] = frozenset()
        self._changed_at = self._made
        self._created_at: float | None = None
        self._step_began = self._made
        self._done_publisher = (
            node.publisher(StepDone, "/sim/step_done") if given.stands_for else None
        )
        node.subscribe(StepDone, "/sim/step_done", self._on_step_done)
        node.create_timer(POLL_INTERVAL, self._watch, clock=node.steady_clock)

    # ---- start -------------------------------------------------------------------------------

    def _watch(self) -> None:
        if self._node.finished:
            return
        if self._running:
            self._check_patience()
        elif self._created_at is None:
            self._look_for_nodes()
        elif self._has_readers():
            self._running = True
            self._publish_step()

    def _look_for_nodes(self) -> None:
        """Wait for all nodes, and learn what they publish: that is not replayed."""
        now = time.monotonic()
        absent = self._node.absent_nodes(self._given.expected_nodes)
        if absent:
            if now - self._made > self._given.start_timeout:
                self._fail(f"the replay did not start: not in the graph: {', '.join(absent)}")
            return
        published = self._topics_of_others()
        if published != self._recomputed:
            self._recomputed, self._changed_at = published, now
        if now - max(self._changed_at, self._made) < SETTLE_TIME:
            return
        excluded = {*self._given.exclude_topics, *self._recomputed}
        wanted = [name for name in self._given.topics if name not in excluded]
        selection = select_topics(self._reader, wanted, excluded)
        self._node.begin_steps(selection)
        self._steps = self._limited(selection)
        self._waiting = next(self._steps, None)
        self._created_at = now

    def _topics_of_others(self) -> frozenset[str]:
        own = self._node.get_fully_qualified_name()
        return frozenset(
            name
            for name, _ in self._node.get_topic_names_and_types()
            for endpoint in self._node.get_publishers_info_by_topic(name)
            if f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}" != own
        )

    def _limited(self, selection: ReplaySelection) -> Iterator[ReplayStep]:
        """Return the steps within the wanted duration."""
        limit = self._given.duration or float("inf")
        for step in replay_steps(self._reader, list(selection.topics), self._given.step_topic):
            if (step.stamp - self._first_stamp) / _NANOSECONDS > limit:
                return
            yield step

    def _has_readers(self) -> bool:
        """Whether each topic is read; a bag may also hold topics that nobody wants."""
        assert self._created_at is not None
        waited = time.monotonic() - self._created_at
        return waited > READER_TIMEOUT or not self._node.unmatched_topics()

    # ---- steps -------------------------------------------------------------------------------

    def _publish_step(self) -> None:
        step, self._waiting = self._waiting, next(self._steps, None)
        if step is None:
            self._node.report_progress(self._total(), self._total())
            self._node.finish()
            return
        self._step_began = time.monotonic()
        self._coordinator.begin(step.stamp)
        self._node.publish_clock(step.stamp)
        for message in step.messages:
            self._node.publish_recorded(message)
        self._acknowledge_for_recorded_nodes(step.stamp)
        # The newest message may be older than the step, or one of a second that is to come.
        self._node.scenario_nanoseconds = step.stamp
        done = (step.stamp - self._first_stamp) / _NANOSECONDS
        self._node.report_progress(done, self._total())

    def _acknowledge_for_recorded_nodes(self, stamp: int) -> None:
        """Tell whoever waits for the nodes that the bag stands for that they have done the step."""
        if self._done_publisher is None:
            return
        for name in self._given.stands_for:
            done = StepDone(node=name)
            done.header.stamp = to_stamp(stamp)
            self._done_publisher.publish(done)

    def _total(self) -> float:
        whole = (self._last_stamp - self._first_stamp) / _NANOSECONDS
        return min(whole, self._given.duration) if self._given.duration else whole

    def _on_step_done(self, message: StepDone) -> None:
        self._coordinator.acknowledge(message.node, to_nanoseconds(message.header.stamp))
        if self._running:
            self._advance()

    def _advance(self) -> None:
        """Publish steps while nobody is behind; only without participants more than one."""
        for _ in range(STEPS_AT_ONCE):
            if self._node.finished or not self._coordinator.complete:
                return
            self._publish_step()

    def _check_patience(self) -> None:
        self._advance()
        if self._node.finished or self._coordinator.complete:
            return
        first = self._coordinator.step == 0
        patience = self._given.start_timeout if first else self._given.step_timeout
        if time.monotonic() - self._step_began <= patience:
            return
        missing = ", ".join(
            f"{name} (" + (f"last did step {step}" if step >= 0 else "never answered") + ")"
            for name, step in self._coordinator.missing().items()
        )
        self._fail(
            f"step {self._coordinator.step} was not finished within {patience:.0f} s; "
            f"waiting for {missing}"
        )

    def _fail(self, problem: str) -> None:
        self._problem = problem
        self._node.get_logger().error(problem)
        self._node.finish(EXIT_FAILURE)

    def health(self) -> tuple[bytes, str]:
        """Return level and text for the diagnostics."""
        if self._problem:
            return diagnostics.ERROR, self._problem
        if not self._running:
            return diagnostics.OK, "waiting for the nodes"
        return diagnostics.OK, f"step {self._coordinator.step}"
