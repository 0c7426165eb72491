"""Replay in lockstep: each step waits until the nodes under test have finished the step before."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence

from diagnostic_msgs.msg import DiagnosticArray

from vtff_bag.file.errors import BagError
from vtff_bag.file.reader import BagReader
from vtff_bag.player.messages_in_order import (
    ReplaySelection,
    ReplayStep,
    replay_steps,
    select_topics,
    step_stamps,
)
from vtff_bag.player.player_parameters import BagPlayerParameters
from vtff_bag.player.replay_publishers import ReplayPublishers
from vtff_bag.recorder.expected_nodes import STATEMENT_PATIENCE
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_msgs.msg import StepDone
from vtff_node import diagnostics
from vtff_node.node import STEP_DONE_TOPIC, VtffNode
from vtff_node.parameters import ParameterError
from vtff_node.stamps import to_stamp
from vtff_node.start.listeners import DIAGNOSTICS_TOPIC, read_listeners
from vtff_node.step_source import StepSource

__all__ = ["StepReplay"]

POLL_INTERVAL = 0.05  # s of wall time between looks at the graph and the clock
SETTLE_TIME = 0.5  # s without a new topic, after which the publishers of all nodes are discovered
READER_TIMEOUT = 3.0  # s that the first step waits for a reader of each topic


class StepReplay:
    """Replays a bag step by step, in the place of the simulator of a run.

    Parameters
    ----------
    node : VtffNode
        The player.
    reader : BagReader
        The bag.
    parameters : BagPlayerParameters

    Raises
    ------
    ParameterError
        If the bag has no steps.
    """

    def __init__(self, node: VtffNode, reader: BagReader, parameters: BagPlayerParameters) -> None:
        self._node = node
        self._reader = reader
        self._parameters = parameters
        try:
            # The topics of the replay depend on the nodes under test, which may not be there yet; a
            # bag without steps is refused at once.
            stamps = step_stamps(reader, parameters.step_topic)
        except BagError as error:
            raise ParameterError(f"parameter 'step_topic': {error}") from error
        self._first_stamp, self._last_stamp = stamps[0], stamps[-1]
        self._steps: Iterator[ReplayStep] = iter(())
        self._next_step: ReplayStep | None = None
        self._publishers: ReplayPublishers | None = None
        self._is_running = False
        self._created_at = time.monotonic()
        self._recomputed_topics: frozenset[str] = frozenset()
        self._recomputed_changed_at = self._created_at
        # Discovery may be late; what the nodes themselves state of their topics counts, too.
        self._stated_topics: dict[str, frozenset[str]] = {}
        self._reports = node.subscribe(
            DiagnosticArray, DIAGNOSTICS_TOPIC, self._take_reports, required=False
        )
        self._publishers_created_at = 0.0
        self._done_publisher = (
            node.publisher(StepDone, STEP_DONE_TOPIC) if parameters.stands_for else None
        )
        self._step_source = StepSource(node, parameters, self._advance)
        node.create_timer(POLL_INTERVAL, self._watch, clock=node.steady_clock)

    @property
    def publishers(self) -> ReplayPublishers | None:
        """The publishers of the replayed topics; None until the nodes under test are there."""
        return self._publishers

    # ---- start -------------------------------------------------------------------------------

    def _watch(self) -> None:
        if self._node.finished:
            return
        if self._is_running:
            self._advance()
            problem = self._step_source.describe_hanging_step()
            if problem and not self._node.finished:
                self._node.fail(problem)
        elif self._publishers is None:
            self._look_for_nodes()
        elif self._has_readers(self._publishers):
            self._is_running = True
            self._publish_step()

    def _look_for_nodes(self) -> None:
        """Wait for the nodes under test, and leave out of the replay what they publish."""
        now = time.monotonic()
        absent = self._node.unready_nodes(self._parameters.expected_nodes)
        if absent:
            if now - self._created_at > self._parameters.start_timeout:
                self._node.fail(f"the replay did not start: not in the graph: {', '.join(absent)}")
            return
        published = self._find_topics_of_other_nodes().union(*self._stated_topics.values())
        if published != self._recomputed_topics:
            self._recomputed_topics, self._recomputed_changed_at = published, now
        unsettled_time = now - self._recomputed_changed_at
        is_stated = self._stated_topics.keys() >= set(self._parameters.expected_nodes)
        if unsettled_time < (SETTLE_TIME if is_stated else STATEMENT_PATIENCE):
            return
        self._node.destroy_subscription(self._reports)
        excluded = {*self._parameters.exclude_topics, *self._recomputed_topics}
        wanted = [name for name in self._parameters.topics if name not in excluded]
        selection = select_topics(self._reader, wanted, excluded)
        self._publishers = ReplayPublishers(
            self._node, selection, is_lockstep=True, publishes_clock=True
        )
        self._publishers_created_at = now
        self._steps = self._read_steps(selection)
        self._next_step = next(self._steps, None)

    def _take_reports(self, message: DiagnosticArray) -> None:
        for status in message.status:
            statement = read_listeners(status)
            if statement is not None and statement[0] != self._node.get_fully_qualified_name():
                node, listeners = statement
                self._stated_topics[node] = frozenset(listeners)

    def _find_topics_of_other_nodes(self) -> frozenset[str]:
        own_name = self._node.get_fully_qualified_name()
        return frozenset(
            name
            for name, _ in self._node.get_topic_names_and_types()
            for endpoint in self._node.get_publishers_info_by_topic(name)
            if f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}" != own_name
        )

    def _read_steps(self, selection: ReplaySelection) -> Iterator[ReplayStep]:
        wanted = self._parameters.duration
        limit = math.inf if wanted is None else wanted
        step_topic = self._parameters.step_topic
        for step in replay_steps(self._reader, list(selection.topics), step_topic):
            if (step.stamp - self._first_stamp) / NANOSECONDS_PER_SECOND > limit:
                return
            yield step

    def _has_readers(self, publishers: ReplayPublishers) -> bool:
        """Return whether each topic has a reader, or no further reader is waited for."""
        waited = time.monotonic() - self._publishers_created_at
        return waited > READER_TIMEOUT or not publishers.unmatched_topics()

    # ---- steps -------------------------------------------------------------------------------

    def _publish_step(self) -> None:
        assert self._publishers is not None
        step, self._next_step = self._next_step, next(self._steps, None)
        if step is None:
            self._node.report_progress(self._compute_duration(), self._compute_duration())
            self._node.finish()
            return
        self._step_source.begin(step.stamp)
        self._publishers.publish_clock(step.stamp)
        for message in step.messages:
            self._publishers.publish(message)
        self._acknowledge_step_for(self._parameters.stands_for, step.stamp)
        # The stamp of the newest message may lie before the step, or in a second that is to come.
        self._node.scenario_nanoseconds = step.stamp
        done = (step.stamp - self._first_stamp) / NANOSECONDS_PER_SECOND
        self._node.report_progress(done, self._compute_duration())

    def _acknowledge_step_for(self, recorded_nodes: Sequence[str], stamp: int) -> None:
        """Acknowledge a step in the name of nodes whose recorded messages are replayed."""
        if self._done_publisher is None:
            return
        for name in recorded_nodes:
            done = StepDone(node=name)
            done.header.stamp = to_stamp(stamp)
            self._done_publisher.publish(done)

    def _compute_duration(self) -> float:
        """Return the recorded time of the replay, s."""
        whole = (self._last_stamp - self._first_stamp) / NANOSECONDS_PER_SECOND
        wanted = self._parameters.duration
        return whole if wanted is None else min(whole, wanted)

    def _advance(self) -> None:
        if self._is_running:
            self._step_source.advance(self._publish_step)

    def health(self) -> tuple[bytes, str]:
        """Return level and text for the diagnostics."""
        if self._node.problem:
            return diagnostics.ERROR, self._node.problem
        if not self._is_running:
            return diagnostics.OK, "waiting for the nodes"
        return diagnostics.OK, f"step {self._step_source.step}"
