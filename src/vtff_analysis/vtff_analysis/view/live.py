"""A run while it is published: a node that listens to the graph, and a scene that grows."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

from vtff_analysis.view.regions import add_dip_equator
from vtff_analysis.view.scene import Scene
from vtff_analysis.view.scene_builder import SceneBuilder
from vtff_bag.file.errors import UnknownTypeError
from vtff_bag.file.message_definitions import first_field_type, message_class
from vtff_bag.file.stamps import CLOCK_TYPE, leading_stamp
from vtff_bag.recorder.offered_qos import strongest_common
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_msgs.srv import Seek, SetRate
from vtff_node.qos import HISTORY_DEPTH
from vtff_node.samples import SampleError, SampleReader

SEARCH_INTERVAL = 0.5  # s of wall time between looks for new topics
ANSWER_TIMEOUT = 2.0  # s of wall time for an answer of the replay
PLAYER = "/bag_player"

#: s; a stamp that goes back by more belongs to another run, or to a replay that was set back.
LARGEST_STEP_BACK = 5.0
#: Topics whose stamps go back within a run: an edge is told after others that came later, and each
#: node reports its health with the step that it has reached.
_UNORDERED = re.compile(r"(boundar\w*|/diagnostics)$")

_GENERATION = ""  # key among the counts under which the number of the scene stands

Forward = Callable[[str, str, bytes, int], None]


class LiveScene:
    """A growing scene for several threads.

    Parameters
    ----------
    name
        Name of the run that the page shows.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._lock = threading.Lock()
        self._generation = 0
        self._begin()

    def _begin(self) -> None:
        self.scene = Scene(self._name, live=True)
        self._builder = SceneBuilder(self.scene)
        self._newest: dict[str, int] = {}
        self._has_dip_equator = False
        self._generation += 1

    def shows(self, topic: str) -> bool:
        """Return whether the scene shows a topic."""
        return self._builder.handler(topic) is not None

    def take(self, topic: str, stamp: int, decode: Callable[[], Any]) -> None:
        """Add a message; one that the scene does not need is not decoded.

        Parameters
        ----------
        topic
            Topic of the message.
        stamp
            Time of the message, ns since 1970.
        decode
            Function that returns the message.
        """
        with self._lock:
            # Each topic by itself: latched messages of one topic may arrive before older messages
            # of another.
            step_back = self._newest.get(topic, stamp) - stamp
            if step_back > LARGEST_STEP_BACK * NANOSECONDS_PER_SECOND:
                self._begin()
            if not _UNORDERED.search(topic):
                self._newest[topic] = stamp
            if self._builder.claim_slot(topic, stamp):
                self._builder.add(topic, stamp, decode())

    def as_json(self) -> dict[str, Any]:
        """Return the scene so far without its series; the first news contain them."""
        with self._lock:
            return {**self.scene.as_json(self.scene.counts())}

    def news(self, sent: Mapping[str, int]) -> tuple[dict[str, Any], dict[str, int]]:
        """Return the samples that a page does not have yet, and the counts after them.

        Parameters
        ----------
        sent
            Counts that the call before returned; empty at the first call.
        """
        with self._lock:
            self._builder.finish()
            if self.scene.start and not self._has_dip_equator:
                self._has_dip_equator = True
                add_dip_equator(self.scene)
            same = sent.get(_GENERATION) == self._generation
            content = self.scene.as_json(sent if same else None)
            content["reset"] = not same
            return content, {**self.scene.counts(), _GENERATION: self._generation}


class ViewerNode(Node):
    """Listens to every topic that the scene shows, whoever publishes it.

    It publishes nothing, not even diagnostics or logs, so that a run that is being recorded holds
    only messages of its own nodes.

    Parameters
    ----------
    live
        Scene that gets the messages.
    forward
        Function that also gets every message of every topic: name, type, CDR bytes, stamp in ns
        since 1970.
    node_arguments
        Arguments of ``rclpy.node.Node``.
    """

    def __init__(
        self, live: LiveScene, forward: Forward | None = None, **node_arguments: Any
    ) -> None:
        super().__init__(
            "viewer", enable_rosout=False, start_parameter_services=False, **node_arguments
        )
        self._live = live
        self._forward = forward
        self._subscribed: set[str] = set()
        self._newest = 0
        self.received = 0
        self._commands = {
            "pause": (self.create_client(Trigger, f"{PLAYER}/pause"), Trigger.Request),
            "resume": (self.create_client(Trigger, f"{PLAYER}/resume"), Trigger.Request),
            "seek": (self.create_client(Seek, f"{PLAYER}/seek"), Seek.Request),
            "rate": (self.create_client(SetRate, f"{PLAYER}/set_rate"), SetRate.Request),
        }
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(SEARCH_INTERVAL, self.search, clock=steady)

    def search(self) -> None:
        """Subscribe to topics that have appeared since the last search."""
        for topic, types in self.get_topic_names_and_types():
            if topic in self._subscribed or len(types) != 1:
                continue
            if self._forward is None and not self._live.shows(topic):
                continue
            endpoints = self.get_publishers_info_by_topic(topic)
            if not endpoints:
                continue
            self._subscribed.add(topic)
            try:
                message_type = message_class(types[0])
                self._listen(topic, types[0], message_type, endpoints)
            except UnknownTypeError as error:
                self._live.scene.notes.append(f"topic '{topic}' is left out: {error}")

    def _listen(self, topic: str, type_name: str, message_type: Any, endpoints: Any) -> None:
        reliable, latched = strongest_common(endpoint.qos_profile for endpoint in endpoints)
        profile = QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=HISTORY_DEPTH,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        stamped = type_name == CLOCK_TYPE or first_field_type(type_name) == "std_msgs/Header"
        shown = self._live.shows(topic)
        reader = SampleReader(message_type)

        def take(serialized: bytes) -> None:
            self.received += 1
            stamp = (leading_stamp(serialized) if stamped else 0) or self._newest
            self._newest = stamp
            if shown and stamp:
                try:
                    self._live.take(topic, stamp, lambda: reader.read(serialized))
                except SampleError as error:
                    self.get_logger().warning(
                        f"a sample of {topic} is not shown: {error}", throttle_duration_sec=5.0
                    )
            if self._forward is not None:
                self._forward(topic, type_name, serialized, stamp)

        self.create_subscription(message_type, topic, take, profile, raw=True)

    def command(self, name: str, value: float) -> str:
        """Send a command to a running `vtff replay`, from a thread that does not spin this node.

        Parameters
        ----------
        name
            ``pause``, ``resume``, ``seek`` (value: s after the first message) or ``rate``.
        value
            Argument of ``seek`` and ``rate``.

        Returns
        -------
        str
            The answer, or the reason why there is none.

        Raises
        ------
        ValueError
            If the command is unknown.
        """
        if name not in self._commands:
            raise ValueError(f"unknown command '{name}'; known: {', '.join(self._commands)}")
        client, make_request = self._commands[name]
        if not client.service_is_ready():
            return "live; no replay runs, so only the page moves"
        request = make_request()
        if name == "seek":
            request.offset = value
        elif name == "rate":
            request.rate = value
        answered = threading.Event()
        future = client.call_async(request)
        future.add_done_callback(lambda _: answered.set())
        if not answered.wait(ANSWER_TIMEOUT) or future.result() is None:
            return f"the replay did not answer within {ANSWER_TIMEOUT:g} s"
        return str(future.result().message)
