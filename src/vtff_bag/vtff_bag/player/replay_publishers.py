"""The publishers of a replay: recorded messages with their bytes unchanged, and /clock."""

from __future__ import annotations

from rclpy.duration import Duration
from rosgraph_msgs.msg import Clock

from vtff_bag.file.message_definitions import message_class
from vtff_bag.file.reader import RawMessage
from vtff_bag.player.messages_in_order import CLOCK_TOPIC, ReplaySelection
from vtff_bag.player.replay_qos import publisher_profile
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_node.node import CountingPublisher, VtffNode
from vtff_node.qos import HISTORY_DEPTH, PUBLISH
from vtff_node.stamps import to_stamp

__all__ = ["LATEST_STAMP", "ReplayPublishers"]

#: Later times do not fit a ROS stamp (2038-01-19); a foreign or damaged bag may have them.
LATEST_STAMP = (2**31 - 1) * NANOSECONDS_PER_SECOND

#: After this many messages of a topic the replay waits for its readers: a publisher keeps only its
#: newest `HISTORY_DEPTH` messages, and a fast replay would overwrite those that are still unread.
ACKNOWLEDGED_EVERY = HISTORY_DEPTH // 4
ACKNOWLEDGE_TIMEOUT = 2.0  # s of wall time; a reader that has died must not stop the replay


class ReplayPublishers:
    """Publishes the recorded messages of a selection of topics.

    Parameters
    ----------
    node : VtffNode
        The player, which owns the publishers.
    selection : ReplaySelection
        The topics.
    is_lockstep : bool
        Publish in lockstep: every reader that is discovered late gets all messages, and the
        recorded /clock is left out.
    publishes_clock : bool
        Create a publisher of /clock for `publish_clock`.
    clock_from_messages : bool
        Publish /clock with the log time of each message before the message.

    Attributes
    ----------
    sent : int
        Number of recorded messages published so far.
    """

    def __init__(
        self,
        node: VtffNode,
        selection: ReplaySelection,
        *,
        is_lockstep: bool = False,
        publishes_clock: bool = False,
        clock_from_messages: bool = False,
    ) -> None:
        self._node = node
        self._clock_from_messages = clock_from_messages
        self._clock_message = Clock()
        self._clock_sent: int | None = None
        self._publishers: dict[str, CountingPublisher] = {}
        self.sent = 0
        for name, topic in selection.topics.items():
            if name == CLOCK_TOPIC and is_lockstep:
                continue
            profile = PUBLISH if is_lockstep else publisher_profile(topic.offered_qos_profiles)
            self._publishers[name] = node.publisher(message_class(topic.type), name, profile)
        self._clock_publisher = node.publisher(Clock, CLOCK_TOPIC) if publishes_clock else None

    @property
    def topics(self) -> frozenset[str]:
        """Names of the replayed topics."""
        return frozenset(self._publishers)

    def unmatched_topics(self) -> list[str]:
        """Return the replayed topics that nobody reads yet."""
        return [
            name
            for name, publisher in self._publishers.items()
            if not publisher.get_subscription_count()
        ]

    def publish(self, message: RawMessage) -> None:
        """Publish a recorded message with its bytes unchanged."""
        if self._clock_from_messages:
            self.publish_clock(message.log_time)
        self._node.scenario_nanoseconds = min(message.log_time, LATEST_STAMP)
        publisher = self._publishers[message.topic]
        publisher.publish(message.serialized)
        self.sent += 1
        if publisher.published % ACKNOWLEDGED_EVERY == 0:
            publisher.wait_for_all_acked(Duration(seconds=ACKNOWLEDGE_TIMEOUT))

    def publish_clock(self, nanoseconds: int) -> None:
        """Publish /clock, once for each time in ns since 1970."""
        if self._clock_publisher is None or nanoseconds == self._clock_sent:
            return
        self._clock_sent = nanoseconds
        self._node.scenario_nanoseconds = nanoseconds
        self._clock_message.clock = to_stamp(nanoseconds)
        self._clock_publisher.publish(self._clock_message)
