"""Recording of a ROS graph: discovery of topics, raw subscriptions, log time of each message.

The recorder needs only the graph and subscription methods of its node. The process and the executor
belong to `bag_recorder_node`.
"""

from __future__ import annotations

import dataclasses
import functools
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from vtff_bag.file.errors import BagWriteError, UnknownTypeError
from vtff_bag.file.message_definitions import (
    first_field_type,
    message_class,
    message_definition,
)
from vtff_bag.file.stamps import CLOCK_TYPE, leading_stamp
from vtff_bag.file.writer import BagWriter
from vtff_bag.recorder.expected_nodes import ExpectedNodes
from vtff_bag.recorder.offered_qos import qos_entries, strongest_common
from vtff_bag.recorder.recording_rules import Acknowledger, ScenarioTime, TopicSelection
from vtff_node.samples import SampleError, SampleReader
from vtff_node.start.listeners import DIAGNOSTICS_TOPIC, read_listeners
from vtff_node.start.unannounced import take_unannounced

#: Type of the messages in which nodes state which nodes hear them.
DIAGNOSTICS_TYPE = "diagnostic_msgs/msg/DiagnosticArray"

SUBSCRIPTION_DEPTH = 5000  # messages of a topic that may wait for the recorder
GATHER_LIMIT = 0.1  # s of wall time for which messages may gather before the recorder takes them

#: Wall time without a new topic after which the set of topics is stable, s. Where nodes are
#: expected it is stable as soon as all their topics are heard.
STABLE_AFTER = 0.3
SEARCH_INTERVAL = 0.02  # s of wall time between looks at the graph until the topics are stable
LATER_SEARCH_INTERVAL = 0.5  # s of wall time between later looks at the graph

#: Limits of the time and number of messages without a stamp that wait for the first scenario time.
HOLD_LIMIT_SECONDS = 60.0
HOLD_LIMIT_MESSAGES = 10_000


@dataclasses.dataclass
class _RecordedTopic:
    name: str
    type: str
    number: int
    callback: Callable[[bytes], None]
    subscription: Any
    reliable: bool
    transient_local: bool
    is_gathered: bool = False
    publishers: int = 0


class Recorder:
    """Subscribes to every topic and writes the messages that arrive.

    In lockstep a message with a header has its time in itself, so it does not matter when it is
    taken; one with a stamp of zero has the scenario time at which it is taken. Such messages gather
    in their subscriptions, which no executor should know (`gathered_subscriptions`), until `flush`
    or for `GATHER_LIMIT`: to be told of each by an executor costs as much as all the rest.

    Parameters
    ----------
    node : rclpy.node.Node
        Its graph is recorded; it owns the subscriptions.
    writer
        The bag, open.
    selection
        The topics that are recorded.
    acknowledger
        Acknowledges the steps; None outside lockstep.
    expected_nodes
        Fully qualified names of nodes. Until the recorder hears all topics of each, the set of
        topics is not stable: DDS may take three seconds to discover a process, and a second more
        for a publisher whose announcement was lost (`ExpectedNodes`).
    on_failure
        Called once with the error when the bag can no longer be written.
    on_full_disk
        Called once with a line when the disk is full. The recorder goes on with what the writer
        has reserved; the run has to end.

    Attributes
    ----------
    received
        Number of messages received so far.
    stable
        Whether the set of topics is stable.
    """

    def __init__(
        self,
        node: Any,
        writer: BagWriter,
        selection: TopicSelection,
        acknowledger: Acknowledger | None = None,
        expected_nodes: Iterable[str] = (),
        on_failure: Callable[[BagWriteError], None] | None = None,
        on_full_disk: Callable[[str], None] | None = None,
    ) -> None:
        self._node = node
        self._writer = writer
        self._selection = selection
        self._acknowledger = acknowledger
        self._on_failure = on_failure
        self._on_full_disk = on_full_disk
        self._expected = ExpectedNodes(
            expected_nodes, node.get_fully_qualified_name(), selection.wants, self._warn
        )
        self._diagnostics: _RecordedTopic | None = None
        self._topics: dict[str, _RecordedTopic] = {}
        self._refused: set[str] = set()
        self._scenario_time = ScenarioTime(only_clock=acknowledger is not None)
        self._held: list[tuple[int, bytes]] = []
        self._held_since = 0.0
        self._next_search = 0.0
        self._gathered_at = 0.0
        self._changed_at = time.monotonic()
        self._failed = False
        self.stable = False
        self.received = 0

    @property
    def scenario_nanoseconds(self) -> int:
        """Newest scenario time, ns since 1970."""
        return self._scenario_time.nanoseconds

    @property
    def topic_names(self) -> list[str]:
        """Names of the topics that are recorded."""
        return sorted(self._topics)

    @property
    def gathered_subscriptions(self) -> list[Any]:
        """Subscriptions whose messages `take_gathered` takes."""
        return [topic.subscription for topic in self._topics.values() if topic.is_gathered]

    @property
    def missing(self) -> list[str]:
        """One text for each expected node that is not heard yet, or for what is missing of it."""
        return self._expected.missing()

    def tick(self) -> None:
        """Search for topics, take what has gathered and flush the bag, when these are due.

        To be called every `SEARCH_INTERVAL`, once the set of topics is stable every `GATHER_LIMIT`.
        """
        now = time.monotonic()
        if now >= self._next_search:
            self._search(now)
        # Once stable, ticks are as far apart as messages may gather.
        if self.stable or now - self._gathered_at >= GATHER_LIMIT:
            self._gathered_at = now
            self.take_gathered()
        if self._held and now - self._held_since >= HOLD_LIMIT_SECONDS:
            self._release_held(time.time_ns())
        if not self._failed:
            self._write_or_fail(self._writer.flush_if_due)
        if self._writer.disk_alarm and self._on_full_disk is not None:
            on_full_disk, self._on_full_disk = self._on_full_disk, None
            on_full_disk(self._writer.disk_alarm)

    def take_gathered(self) -> None:
        """Take and write the messages that have gathered in their subscriptions."""
        take_unannounced(self.gathered_subscriptions)

    def flush(self) -> None:
        """Hand what has been received to the operating system."""
        self.take_gathered()
        if not self._failed:
            self._write_or_fail(self._writer.flush)

    def finish(self) -> None:
        """Write the messages that still wait for a scenario time; the writer stays open."""
        self._release_held(self._scenario_time.nanoseconds or time.time_ns())

    def _search(self, now: float) -> None:
        """Search for new topics, and for publishers that do not match a subscription."""
        for name, types in sorted(self._node.get_topic_names_and_types()):
            is_wanted = name not in self._refused and self._selection.wants(name)
            if not is_wanted and name != DIAGNOSTICS_TOPIC:
                continue
            topic = self._topics.get(name)
            count = self._node.count_publishers(name)
            if not count or (self.stable and topic is not None and topic.publishers == count):
                continue
            endpoints = self._node.get_publishers_info_by_topic(name)
            if not endpoints:
                continue
            self._expected.discover(
                name,
                [f"{item.node_namespace.rstrip('/')}/{item.node_name}" for item in endpoints],
                now,
            )
            if not is_wanted:
                self._listen_to_diagnostics()
                continue
            if topic is not None:
                topic.publishers = len(endpoints)
                self._weaken(topic, endpoints)
            elif self._add(name, types, endpoints):
                self._changed_at = now
        # Expected nodes state all their topics, and nothing more is waited for.
        patience = 0.0 if self._expected.names else STABLE_AFTER
        settled = self._topics and now - self._changed_at >= patience
        if not self.stable and settled and self._expected.are_heard(now):
            self.stable = True
            if self._acknowledger is not None:
                self._acknowledger.allow_first()
        self._next_search = now + (LATER_SEARCH_INTERVAL if self.stable else SEARCH_INTERVAL)

    def _add(self, name: str, types: Sequence[str], endpoints: Sequence[Any]) -> bool:
        if len(types) != 1:
            self._refuse(name, f"it has several types ({', '.join(types)})")
            return False
        type_name = types[0]
        try:
            definition = message_definition(type_name)
            first_field = first_field_type(type_name)
            class_of_topic = message_class(type_name)
        except UnknownTypeError as error:
            self._refuse(name, str(error))
            return False
        number = self._write_or_fail(
            lambda: self._writer.add_topic(
                name,
                type_name,
                qos_entries(endpoint.qos_profile for endpoint in endpoints),
                _find_type_hash(endpoints),
                definition,
            )
        )
        if number is None:
            return False
        reliable, transient_local = strongest_common(endpoint.qos_profile for endpoint in endpoints)
        has_header = first_field == "std_msgs/Header"
        callback = self._make_callback(number, type_name, has_header)
        topic = _RecordedTopic(name, type_name, number, callback, None, reliable, transient_local)
        # What the nodes hear of each other is looked at when it comes.
        is_timely = self._acknowledger is None or type_name == DIAGNOSTICS_TYPE
        topic.is_gathered = has_header and not is_timely
        topic.subscription = self._subscribe(class_of_topic, topic)
        self._topics[name] = topic
        return True

    def _listen_to_diagnostics(self) -> None:
        """Take the statements of the nodes also where /diagnostics is not recorded."""
        if self._diagnostics is None:
            self._diagnostics = _RecordedTopic(
                DIAGNOSTICS_TOPIC, DIAGNOSTICS_TYPE, 0, self._take_diagnostics, None, True, True
            )
            class_of_topic = message_class(DIAGNOSTICS_TYPE)
            self._diagnostics.subscription = self._subscribe(class_of_topic, self._diagnostics)

    def _take_diagnostics(self, serialized: bytes) -> None:
        """Take what a node states about its topics, until all are heard."""
        if self.stable:
            return
        try:
            message = SampleReader(message_class(DIAGNOSTICS_TYPE)).read(serialized)
        except SampleError as error:
            self._warn(f"a sample of {DIAGNOSTICS_TOPIC} states nothing: {error}")
            return
        for status in message.status:
            statement = read_listeners(status)
            if statement is not None:
                self._expected.state(*statement)

    def _refuse(self, name: str, reason: str) -> None:
        self._refused.add(name)
        self._expected.ignore(name)
        self._warn(f"topic {name} is not recorded: {reason}")

    def _warn(self, text: str) -> None:
        self._node.get_logger().warning(text)

    def _subscribe(self, class_of_topic: Any, topic: _RecordedTopic) -> Any:
        reliability = (
            ReliabilityPolicy.RELIABLE if topic.reliable else ReliabilityPolicy.BEST_EFFORT
        )
        durability = (
            DurabilityPolicy.TRANSIENT_LOCAL if topic.transient_local else DurabilityPolicy.VOLATILE
        )
        profile = QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=SUBSCRIPTION_DEPTH,
            reliability=reliability,
            durability=durability,
        )
        return self._node.create_subscription(
            class_of_topic, topic.name, topic.callback, profile, raw=True
        )

    def _weaken(self, topic: _RecordedTopic, endpoints: Sequence[Any]) -> None:
        """Subscribe again with weaker policies if a publisher does not match the subscription."""
        reliable, transient_local = strongest_common(endpoint.qos_profile for endpoint in endpoints)
        if (reliable or not topic.reliable) and (transient_local or not topic.transient_local):
            return
        topic.reliable = topic.reliable and reliable
        topic.transient_local = topic.transient_local and transient_local
        self._node.get_logger().warning(
            f"topic {topic.name}: publishers offer different quality of service; recorded as "
            f"{'reliable' if topic.reliable else 'best effort'}, "
            f"{'transient local' if topic.transient_local else 'volatile'}"
        )
        # What waits in the subscription is lost with it.
        take_unannounced([topic.subscription])
        self._node.destroy_subscription(topic.subscription)
        topic.subscription = self._subscribe(message_class(topic.type), topic)

    def _make_callback(
        self, number: int, type_name: str, has_header: bool
    ) -> Callable[[bytes], None]:
        """Return the subscription callback of a topic.

        Callbacks run thousands of times a second, so each does only what its kind of topic needs.
        """
        scenario_time = self._scenario_time

        def on_clock(serialized: bytes) -> None:
            stamp = leading_stamp(serialized)
            if not stamp:  # cut short
                on_unstamped(serialized)
                return
            scenario_time.take_clock(stamp)
            self._write(number, serialized, stamp)
            if self._acknowledger is not None:
                self._acknowledger.take_clock(stamp)

        def on_stamped(serialized: bytes) -> None:
            stamp = leading_stamp(serialized)
            scenario_time.take_stamp(stamp)
            self._write(number, serialized, stamp or scenario_time.nanoseconds)

        def on_unstamped(serialized: bytes) -> None:
            self._write(number, serialized, scenario_time.nanoseconds)

        def on_diagnostics(serialized: bytes) -> None:
            on_stamped(serialized)
            self._take_diagnostics(serialized)

        if type_name == CLOCK_TYPE:
            return on_clock
        if type_name == DIAGNOSTICS_TYPE:
            return on_diagnostics
        return on_stamped if has_header else on_unstamped

    def _write(self, number: int, serialized: bytes, log_time: int) -> None:
        self.received += 1
        if self._failed:
            return
        if not log_time and not self._scenario_time.nanoseconds:
            self._hold(number, serialized)
            return
        if self._held:
            # Without a scenario time a stamp orders only the held messages of its own topic.
            scenario_time = self._scenario_time.nanoseconds
            self._release_held(scenario_time or log_time, None if scenario_time else number)
        try:
            self._writer.write(number, serialized, log_time)
        except BagWriteError as error:
            self._fail(error)

    def _hold(self, number: int, serialized: bytes) -> None:
        if not self._held:
            self._held_since = time.monotonic()
        self._held.append((number, serialized))
        if len(self._held) >= HOLD_LIMIT_MESSAGES:
            self._release_held(time.time_ns())

    def _release_held(self, log_time: int, only_number: int | None = None) -> None:
        """Write the messages that wait for a scenario time: all, or those of one topic number."""
        held, self._held = self._held, []
        if only_number is not None:
            self._held = [item for item in held if item[0] != only_number]
            held = [item for item in held if item[0] == only_number]
        for number, serialized in held:
            if not self._failed:
                self._write_or_fail(
                    functools.partial(self._writer.write, number, serialized, log_time)
                )

    def _write_or_fail(self, action: Callable[[], Any]) -> Any:
        """Return the result of an action on the bag; None if an error ends the recording."""
        try:
            return action()
        except BagWriteError as error:
            self._fail(error)
            return None

    def _fail(self, error: BagWriteError) -> None:
        if not self._failed:
            self._failed = True
            if self._on_failure is not None:
                self._on_failure(error)


def _find_type_hash(endpoints: Sequence[Any]) -> str:
    hashes = sorted(str(endpoint.topic_type_hash) for endpoint in endpoints)
    return next((text for text in hashes if text.startswith("RIHS")), "")
