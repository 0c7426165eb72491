"""Recording of a ROS graph: discovery, raw subscriptions, time and acknowledgement rules.

The class works on any node object with rclpy's graph and subscription methods and owns
neither the process nor the executor; `bag_recorder_node` does.
"""

from __future__ import annotations

import dataclasses
import functools
import re
import struct
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from vtff_bag.file.errors import BagWriteError, UnknownTypeError
from vtff_bag.file.message_definitions import (
    first_field_type,
    message_class,
    message_definition,
)
from vtff_bag.file.metadata import QosEntry, offered_qos
from vtff_bag.file.writer import BagWriter

CLOCK_TYPE = "rosgraph_msgs/msg/Clock"
SUBSCRIPTION_DEPTH = 5000  # messages of a topic that may wait for the recorder

STABLE_AFTER = 0.3  # s of wall time without a new topic, then the topic set is complete
SEARCH_INTERVAL = 0.02  # s of wall time between looks at the graph until then
LATER_SEARCH_INTERVAL = 0.5  # s of wall time between looks afterwards

#: Messages without a time of their own wait for the first scenario time at most this long.
HOLD_LIMIT_SECONDS = 60.0
HOLD_LIMIT_MESSAGES = 10_000

_NANOSECONDS = 1_000_000_000
_STAMP = {0: struct.Struct(">iI"), 1: struct.Struct("<iI")}  # by the byte order flag of CDR
_ENCAPSULATION = 4  # B before the first field


def leading_stamp(serialized: bytes) -> int:
    """Return the time at the beginning of a CDR message, ns since 1970.

    Parameters
    ----------
    serialized
        CDR of a type that begins with builtin_interfaces/Time or std_msgs/Header: seconds
        (int32) in bytes 4 to 7, nanoseconds (uint32) in bytes 8 to 11.

    Returns
    -------
    int
        0 where the time is unset, negative, or the message too short.
    """
    if len(serialized) < _ENCAPSULATION + 8:
        return 0
    seconds, nanoseconds = _STAMP[serialized[1] & 1].unpack_from(serialized, _ENCAPSULATION)
    return max(0, seconds * _NANOSECONDS + nanoseconds)


class ScenarioTime:
    """Scenario time as the recorder knows it: the newest /clock, else the newest stamp.

    Parameters
    ----------
    only_clock
        Stamps tell nothing: in lockstep a thrust is stamped with the time at which it begins, and
        which message comes first differs between runs.
    """

    def __init__(self, only_clock: bool = False) -> None:
        self.nanoseconds = 0
        self._only_clock = only_clock
        self._has_clock = False

    def clock(self, nanoseconds: int) -> None:
        """Note a /clock message."""
        self._has_clock = True
        self.nanoseconds = nanoseconds

    def stamp(self, nanoseconds: int) -> None:
        """Note the stamp of a message; without effect once there is a /clock."""
        if not (self._only_clock or self._has_clock) and nanoseconds > self.nanoseconds:
            self.nanoseconds = nanoseconds


@dataclasses.dataclass(frozen=True)
class TopicSelection:
    """Which topics are recorded.

    Hidden topics (a name part beginning with an underscore) and /parameter_events are not,
    unless ``include_hidden``.
    """

    include: str = ""
    exclude: tuple[str, ...] = ()
    include_hidden: bool = False

    def __post_init__(self) -> None:
        try:
            re.compile(self.include)
        except re.error as error:
            raise ValueError(
                f"include '{self.include}' is not a regular expression: {error}"
            ) from None

    def wants(self, topic: str) -> bool:
        """Whether a topic is recorded."""
        if topic in self.exclude:
            return False
        hidden = topic == "/parameter_events" or "/_" in topic
        if hidden and not self.include_hidden:
            return False
        return not self.include or re.search(self.include, topic) is not None


class Acknowledger:
    """When the recorder, a side branch of lockstep, says that it keeps up.

    The first step is acknowledged once the topic set is stable, then every
    ``acknowledge_every``-th /clock, always by its own stamp, so that two runs give the
    same acknowledgements, however long a machine pauses.

    Parameters
    ----------
    acknowledge
        Publishes the acknowledgement of a stamp (ns since 1970).
    acknowledge_every
        Steps between acknowledgements.
    """

    def __init__(self, acknowledge: Callable[[int], None], acknowledge_every: int = 10) -> None:
        self._acknowledge = acknowledge
        self._every = acknowledge_every
        self._steps = 0
        self._newest = 0
        self._last_acknowledged_step = 0
        self.ready = False
        self.stopped = False

    def clock(self, nanoseconds: int) -> None:
        """Note a /clock message."""
        self._steps += 1
        self._newest = nanoseconds
        if self._last_acknowledged_step == 0:
            self._send_first()
        elif self._steps - self._last_acknowledged_step >= self._every:
            self._send()

    def topics_stable(self) -> None:
        """Note that the topic set is stable: nothing of the first step can be missed."""
        self.ready = True
        self._send_first()

    def _send_first(self) -> None:
        if self.ready and self._steps and self._last_acknowledged_step == 0:
            self._send()

    def _send(self) -> None:
        if not self.stopped:
            self._last_acknowledged_step = self._steps
            self._acknowledge(self._newest)


@dataclasses.dataclass
class _RecordedTopic:
    name: str
    type: str
    number: int
    callback: Callable[[bytes], None]
    subscription: Any
    reliable: bool
    transient_local: bool


class Recorder:
    """Subscribe to every topic and write what arrives.

    Parameters
    ----------
    node : rclpy.node.Node
        Looks at the graph and owns the subscriptions.
    writer
        The bag, open.
    selection
        Which topics are recorded.
    acknowledger
        Is told about /clock and the topic set; None outside lockstep.
    expected_nodes
        Fully qualified names of nodes without whose publishers the topic set is not
        complete: DDS may take three seconds to discover a process.
    on_failure
        Called once with the error when the bag cannot be written any more.
    """

    def __init__(
        self,
        node: Any,
        writer: BagWriter,
        selection: TopicSelection,
        acknowledger: Acknowledger | None = None,
        expected_nodes: Iterable[str] = (),
        on_failure: Callable[[BagWriteError], None] | None = None,
    ) -> None:
        self._node = node
        self._writer = writer
        self._selection = selection
        self._acknowledger = acknowledger
        self._on_failure = on_failure
        self._missing_nodes = set(expected_nodes)
        self._topics: dict[str, _RecordedTopic] = {}
        self._refused: set[str] = set()
        self._scenario_time = ScenarioTime(only_clock=acknowledger is not None)
        self._held: list[tuple[int, bytes]] = []
        self._held_since = 0.0
        self._next_search = 0.0
        self._changed_at = time.monotonic()
        self._failed = False
        self.stable = False
        self.received = 0

    @property
    def scenario_nanoseconds(self) -> int:
        """Newest scenario time seen, ns since 1970."""
        return self._scenario_time.nanoseconds

    @property
    def topic_names(self) -> list[str]:
        """Topics that are recorded."""
        return sorted(self._topics)

    @property
    def missing_nodes(self) -> list[str]:
        """Expected nodes of which no publisher has been seen yet."""
        return sorted(self._missing_nodes)

    def tick(self) -> None:
        """Do what is due by the wall clock; call every `SEARCH_INTERVAL`."""
        now = time.monotonic()
        if now >= self._next_search:
            self._search(now)
        if self._held and now - self._held_since >= HOLD_LIMIT_SECONDS:
            self._release_held(time.time_ns())
        if not self._failed:
            self._guarded(self._writer.flush_if_due)

    def finish(self) -> None:
        """Write what still waits for a time; the writer stays open."""
        self._release_held(self._scenario_time.nanoseconds or time.time_ns())

    def _search(self, now: float) -> None:
        """Look for new topics, and for publishers that offer less than is asked of them."""
        for name, types in sorted(self._node.get_topic_names_and_types()):
            if name in self._refused or not self._selection.wants(name):
                continue
            endpoints = self._node.get_publishers_info_by_topic(name)
            if not endpoints:
                continue
            self._missing_nodes.difference_update(
                f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"
                for endpoint in endpoints
            )
            known = self._topics.get(name)
            if known is not None:
                self._weaken(known, endpoints)
            elif self._add(name, types, endpoints):
                self._changed_at = now
        settled = self._topics and now - self._changed_at >= STABLE_AFTER
        if not self.stable and settled and not self._missing_nodes:
            self.stable = True
            if self._acknowledger is not None:
                self._acknowledger.topics_stable()
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
        number = self._guarded(
            lambda: self._writer.add_topic(
                name,
                type_name,
                qos_entries(endpoint.qos_profile for endpoint in endpoints),
                _type_hash(endpoints),
                definition,
            )
        )
        if number is None:
            return False
        reliable, transient_local = strongest_common(endpoint.qos_profile for endpoint in endpoints)
        callback = self._callback(number, type_name == CLOCK_TYPE, first_field == "std_msgs/Header")
        topic = _RecordedTopic(name, type_name, number, callback, None, reliable, transient_local)
        topic.subscription = self._subscribe(class_of_topic, topic)
        self._topics[name] = topic
        return True

    def _refuse(self, name: str, reason: str) -> None:
        self._refused.add(name)
        self._node.get_logger().warning(f"topic {name} is not recorded: {reason}")

    def _subscribe(self, class_of_topic: Any, topic: _RecordedTopic) -> Any:
        # Imported here: the rules above are tested without ROS.
        from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

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
        """Ask for less where a publisher has appeared that would not match the subscription."""
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
        self._node.destroy_subscription(topic.subscription)
        topic.subscription = self._subscribe(message_class(topic.type), topic)

    def _callback(self, number: int, is_clock: bool, has_header: bool) -> Callable[[bytes], None]:
        """Return the subscription callback of a topic; these run thousands of times a second."""
        scenario_time = self._scenario_time

        def on_clock(serialized: bytes) -> None:
            stamp = leading_stamp(serialized)
            scenario_time.clock(stamp)
            self._write(number, serialized, stamp)
            if self._acknowledger is not None:
                self._acknowledger.clock(stamp)

        def on_stamped(serialized: bytes) -> None:
            stamp = leading_stamp(serialized)
            scenario_time.stamp(stamp)
            self._write(number, serialized, stamp or scenario_time.nanoseconds)

        def on_unstamped(serialized: bytes) -> None:
            self._write(number, serialized, scenario_time.nanoseconds)

        if is_clock:
            return on_clock
        return on_stamped if has_header else on_unstamped

    def _write(self, number: int, serialized: bytes, log_time: int) -> None:
        self.received += 1
        if self._failed:
            return
        if not log_time and not self._scenario_time.nanoseconds:
            self._hold(number, serialized)
            return
        if self._held:
            # Before the first /clock only the times of its own topic order a message.
            known = self._scenario_time.nanoseconds
            self._release_held(known or log_time, None if known else number)
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
        """Write the messages that wait for a time, all or those of one topic."""
        held, self._held = self._held, []
        if only_number is not None:
            self._held = [item for item in held if item[0] != only_number]
            held = [item for item in held if item[0] == only_number]
        for number, serialized in held:
            if not self._failed:
                self._guarded(functools.partial(self._writer.write, number, serialized, log_time))

    def _guarded(self, action: Callable[[], Any]) -> Any:
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


def strongest_common(profiles: Iterable[Any]) -> tuple[bool, bool]:
    """Return whether all publishers offer RELIABLE, and whether all offer TRANSIENT_LOCAL.

    A subscription that asks for more than a publisher offers gets nothing from it, so the
    recorder asks for the most that every publisher offers (as ``ros2 bag record`` does).
    """
    offered = list(profiles)
    return (
        all(profile.reliability.name == "RELIABLE" for profile in offered),
        all(profile.durability.name == "TRANSIENT_LOCAL" for profile in offered),
    )


def qos_entries(profiles: Iterable[Any]) -> list[QosEntry]:
    """Return the distinct profiles as ``offered_qos_profiles`` entries, in a fixed order."""
    entries: list[QosEntry] = []
    for profile in profiles:
        entry = offered_qos(
            history=profile.history.name.lower(),
            depth=profile.depth,
            reliability=profile.reliability.name.lower(),
            durability=profile.durability.name.lower(),
            deadline=_split_duration(profile.deadline),
            lifespan=_split_duration(profile.lifespan),
            liveliness=profile.liveliness.name.lower(),
            liveliness_lease_duration=_split_duration(profile.liveliness_lease_duration),
            avoid_ros_namespace_conventions=bool(profile.avoid_ros_namespace_conventions),
        )
        if entry not in entries:
            entries.append(entry)
    return sorted(entries, key=repr)


def _split_duration(duration: Any) -> dict[str, int]:
    seconds, remainder = divmod(duration.nanoseconds, _NANOSECONDS)
    return {"sec": seconds, "nsec": remainder}


def _type_hash(endpoints: Sequence[Any]) -> str:
    hashes = sorted(str(endpoint.topic_type_hash) for endpoint in endpoints)
    return next((text for text in hashes if text.startswith("RIHS")), "")
