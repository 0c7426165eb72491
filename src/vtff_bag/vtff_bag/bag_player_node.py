"""bag_player: publishes what a bag holds, at its pace, at the pace of steps or of a live /clock."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.duration import Duration
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from vtff_bag.file.errors import BagError
from vtff_bag.file.message_definitions import message_class
from vtff_bag.file.reader import BagReader, RawMessage
from vtff_bag.player.messages_in_order import CLOCK_TOPIC, Replay, ReplaySelection, select_topics
from vtff_bag.player.replay_clock import LARGEST_RATE, SMALLEST_RATE
from vtff_bag.player.replay_qos import publisher_profile
from vtff_bag.player.replay_step_source import StepSource
from vtff_msgs.srv import Seek, SetRate
from vtff_node import diagnostics
from vtff_node.main import run_node
from vtff_node.node import CountingPublisher, VtffNode
from vtff_node.parameters import REQUIRED, ParameterError, parameter
from vtff_node.qos import HISTORY_DEPTH, PUBLISH
from vtff_node.stamps import to_nanoseconds, to_stamp

PACINGS = ("wall", "steps", "clock")

POLL_INTERVAL = 0.001  # s of wall time between looks at what is due
STATE_INTERVAL = 0.2  # s of wall time between messages on ~/state
DIAGNOSTICS_TOPIC = "/diagnostics"

#: Later times do not fit a ROS stamp (2038-01-19); a foreign or damaged bag may have them.
LATEST_STAMP = (2**31 - 1) * 1_000_000_000

#: After this many messages on a topic its readers are waited for: a publisher keeps only its
#: newest `HISTORY_DEPTH`, and a fast replay would overwrite what a slow reader has not got.
ACKNOWLEDGED_EVERY = HISTORY_DEPTH // 4
ACKNOWLEDGE_TIMEOUT = 2.0  # s of wall time; a reader that has died must not stop the replay


@dataclass(frozen=True)
class BagPlayerParameters:
    """Parameters of the node."""

    bag: str = parameter(REQUIRED, "bag directory, run folder or .mcap file")
    pacing: str = parameter(
        "wall",
        "what the messages wait for: the wall clock, acknowledged steps, or a live /clock",
        choices=PACINGS,
    )
    topics: list[str] = parameter([], "full names of the topics to replay; all if empty")
    exclude_topics: list[str] = parameter([], "full names of topics to leave out")
    publish_clock: bool = parameter(
        True, "publish /clock where no recorded one is replayed; never with pacing clock"
    )
    rate: float = parameter(
        1.0,
        "pacing wall: recorded seconds per second",
        minimum=SMALLEST_RATE,
        maximum=LARGEST_RATE,
    )
    start_offset: float = parameter(
        0.0, "pacing wall: where to begin, after the first message", unit="s", minimum=0.0
    )
    loop: bool = parameter(False, "pacing wall: begin again at the end")
    start_paused: bool = parameter(False, "pacing wall: wait for ~/resume or ~/step")
    delay: float = parameter(
        0.5, "pacing wall: time for readers to find the topics", unit="s", minimum=0.0
    )
    step_topic: str = parameter(
        CLOCK_TOPIC, "pacing steps: topic of which each stamp is a step to be acknowledged"
    )
    duration: float = parameter(
        0.0, "pacing steps: recorded time to replay, 0 = all", unit="s", minimum=0.0
    )
    stands_for: list[str] = parameter(
        [],
        "pacing steps: nodes whose recorded work is replayed; each step is acknowledged for them",
    )
    lockstep_participants: list[str] = parameter(
        [], "pacing steps: fully qualified nodes that must acknowledge each step"
    )
    lockstep_side_branches: list[str] = parameter(
        [], "pacing steps: nodes that must acknowledge but may lag"
    )
    expected_nodes: list[str] = parameter(
        [], "pacing steps: nodes to wait for; what they publish is not replayed"
    )
    maximum_lag: int = parameter(
        50, "pacing steps: steps a side branch may lag", minimum=0, maximum=500
    )
    start_timeout: float = parameter(
        30.0, "pacing steps: wall time for the first step", unit="s", minimum=0.1
    )
    step_timeout: float = parameter(
        10.0, "pacing steps: wall time for a later step", unit="s", minimum=0.1
    )


class BagPlayerNode(VtffNode):
    """Replay a bag: every message once, in order, its bytes and quality of service unchanged.

    Publishes the recorded topics, /clock before each message where none is replayed, and ~/state
    (diagnostic_msgs/DiagnosticStatus). With pacing wall it offers ~/pause, ~/resume and ~/step
    (std_srvs/Trigger), ~/seek and ~/set_rate (vtff_msgs). With pacing steps it takes the place
    of the simulator: what the nodes under test publish is not replayed, and each step waits
    until they have acknowledged the one before on /sim/step_done. With pacing clock each
    message waits for the /clock that somebody else publishes.
    """

    Parameters = BagPlayerParameters

    def __init__(self, **node_arguments: Any) -> None:
        # Its own log lines must not mix with a recorded /rosout.
        super().__init__("bag_player", enable_rosout=False, **node_arguments)
        given: BagPlayerParameters = self.parameters
        try:
            self.reader = BagReader(given.bag)
            self.selection = select_topics(self.reader, given.topics, given.exclude_topics)
        except BagError as error:
            raise ParameterError(f"parameter 'bag': {error}") from error
        self._replayed: dict[str, CountingPublisher] = {}
        self._clock_publisher: CountingPublisher | None = None
        self._clock_message = Clock()
        self._clock_sent: int | None = None
        self.replay: Replay | None = None
        self._steps: StepSource | None = None
        self._messages_sent = 0
        for line in (*self.reader.notes, *self.selection.skipped):
            self.get_logger().warning(line)
        self._begins_at = time.monotonic()
        {"wall": self._pace_by_wall, "steps": self._pace_by_steps, "clock": self._pace_by_clock}[
            given.pacing
        ]()

    # ---- pacing ------------------------------------------------------------------------------

    def _pace_by_wall(self) -> None:
        given: BagPlayerParameters = self.parameters
        self._create_publishers(self.selection, given.publish_clock)
        try:
            self.replay = Replay(
                self.reader,
                self.selection.topics,
                self.publish_recorded,
                start_offset=given.start_offset,
                rate=given.rate,
                loop=given.loop,
                paused=True,
            )
        except ValueError as error:
            raise ParameterError(f"parameter 'start_offset': {error}") from error
        self._begins_at += given.delay
        self._waits_to_begin = not given.start_paused
        self._create_services()
        self._state_publisher = self.publisher(DiagnosticStatus, "~/state")
        self.create_timer(POLL_INTERVAL, self._advance, clock=self.steady_clock)
        self.create_timer(STATE_INTERVAL, self._publish_state, clock=self.steady_clock)

    def _advance(self) -> None:
        replay = self.replay
        assert replay is not None
        if self._waits_to_begin and time.monotonic() >= self._begins_at:
            self._waits_to_begin = False
            replay.resume()
        replay.advance()
        if replay.finished and not self._waits_to_begin:
            self.finish()

    def _pace_by_steps(self) -> None:
        if not self.lockstep:
            raise ParameterError("parameter 'pacing' is 'steps'; that needs lockstep:=true")
        self._steps = StepSource(self, self.reader, self.parameters)

    def begin_steps(self, selection: ReplaySelection) -> None:
        """Create the publishers of a replay in steps; every late reader gets all of it."""
        self.selection = selection
        self._create_publishers(selection, clock=False, lockstep=True)
        self._clock_publisher = self.publisher(Clock, CLOCK_TOPIC)

    def unmatched_topics(self) -> list[str]:
        """Return the replayed topics that nobody reads yet."""
        return [
            name
            for name, publisher in self._replayed.items()
            if not publisher.get_subscription_count()
        ]

    def _pace_by_clock(self) -> None:
        # Somebody else's /clock paces: the recorded one must not contradict it.
        topics = {n: t for n, t in self.selection.topics.items() if n != CLOCK_TOPIC}
        self.selection = ReplaySelection(topics, self.selection.skipped)
        self._create_publishers(self.selection, clock=False, lockstep=self.lockstep)
        self._waiting = self.reader.raw_messages(list(topics))
        self._next = next(self._waiting, None)
        self.subscribe(Clock, CLOCK_TOPIC, self._on_clock)

    def _on_clock(self, message: Clock) -> None:
        started = time.perf_counter()
        now = to_nanoseconds(message.clock)
        while self._next is not None and self._next.log_time <= now:
            self.publish_recorded(self._next)
            self._next = next(self._waiting, None)
        self.acknowledge_step(message.clock, started)

    # ---- publishing --------------------------------------------------------------------------

    def _create_publishers(
        self, selection: ReplaySelection, clock: bool, lockstep: bool = False
    ) -> None:
        for name, topic in selection.topics.items():
            if name == CLOCK_TOPIC and lockstep:
                continue
            profile = PUBLISH if lockstep else publisher_profile(topic.offered_qos_profiles)
            self._replayed[name] = self.publisher(message_class(topic.type), name, profile)
        if clock and self.reader.end_time > LATEST_STAMP:
            self.get_logger().warning("no /clock: the bag has times after 2038")
        elif clock and not selection.has_clock:
            self._clock_publisher = self.publisher(Clock, CLOCK_TOPIC)

    def publish_recorded(self, message: RawMessage) -> None:
        """Publish a recorded message as its bytes are, after a /clock where none is recorded."""
        if self._clock_publisher is not None and not self.lockstep:
            self.publish_clock(message.log_time)
        self.scenario_nanoseconds = min(message.log_time, LATEST_STAMP)
        publisher = self._replayed[message.topic]
        publisher.publish(message.serialized)
        self._messages_sent += 1
        if publisher.published % ACKNOWLEDGED_EVERY == 0:
            publisher.wait_for_all_acked(Duration(seconds=ACKNOWLEDGE_TIMEOUT))

    def publish_clock(self, nanoseconds: int) -> None:
        """Publish /clock once for each new time."""
        if nanoseconds == self._clock_sent:
            return
        self._clock_sent = nanoseconds
        self.scenario_nanoseconds = nanoseconds
        self._clock_message.clock = to_stamp(nanoseconds)
        assert self._clock_publisher is not None
        self._clock_publisher.publish(self._clock_message)

    # ---- services ----------------------------------------------------------------------------

    def _create_services(self) -> None:
        self.create_service(Trigger, "~/pause", self._on_pause)
        self.create_service(Trigger, "~/resume", self._on_resume)
        self.create_service(Trigger, "~/step", self._on_step)
        self.create_service(Seek, "~/seek", self._on_seek)
        self.create_service(SetRate, "~/set_rate", self._on_set_rate)

    def pause(self) -> None:
        """Stand still until `resume`."""
        assert self.replay is not None
        self._waits_to_begin = False
        self.replay.pause()

    def resume(self) -> None:
        """Go on."""
        assert self.replay is not None
        self._waits_to_begin = False
        self.replay.resume()

    def _on_pause(self, request: Any, response: Any) -> Any:
        self.pause()
        return self._answer(response, True, f"paused at {self._position():.3f} s")

    def _on_resume(self, request: Any, response: Any) -> Any:
        self.resume()
        return self._answer(response, True, f"playing from {self._position():.3f} s")

    def _on_step(self, request: Any, response: Any) -> Any:
        assert self.replay is not None
        self._waits_to_begin = False
        message = self.replay.step()
        if message is None:
            return self._answer(response, False, "there is no further message")
        return self._answer(response, True, f"{message.topic} at {self._position():.3f} s")

    def _on_seek(self, request: Any, response: Any) -> Any:
        assert self.replay is not None
        try:
            self.replay.seek(request.offset)
        except ValueError as error:
            return self._answer(response, False, str(error))
        return self._answer(response, True, f"at {self._position():.3f} s")

    def _on_set_rate(self, request: Any, response: Any) -> Any:
        assert self.replay is not None
        try:
            self.replay.set_rate(request.rate)
        except ValueError as error:
            return self._answer(response, False, str(error))
        return self._answer(response, True, f"rate {self.replay.rate:g}")

    @staticmethod
    def _answer(response: Any, success: bool, message: str) -> Any:
        response.success = success
        response.message = message
        return response

    # ---- reports -----------------------------------------------------------------------------

    def _position(self) -> float:
        return self.replay.position if self.replay is not None else 0.0

    def _publish_state(self) -> None:
        self._state_publisher.publish(self.health()[0])
        assert self.replay is not None
        self.report_progress(self.replay.position, self.replay.duration)

    def publish_diagnostics(self) -> None:
        """Publish `health`, unless /diagnostics is replayed: nothing may mix with it."""
        if DIAGNOSTICS_TOPIC not in self._replayed:
            super().publish_diagnostics()

    def health(self) -> list[DiagnosticStatus]:
        """Report where the replay is."""
        values: dict[str, Any] = {"bag": self.reader.path, "messages sent": self._messages_sent}
        level, text = diagnostics.OK, "playing"
        if self.replay is not None:
            values["position, s"] = f"{self.replay.position:.3f}"
            values["duration, s"] = f"{self.replay.duration:.3f}"
            values["start, ns since 1970"] = self.reader.start_time
            values["rate"] = f"{self.replay.rate:g}"
            text = "paused" if self.replay.paused else "playing"
        elif self._steps is not None:
            level, text = self._steps.health()
        return [diagnostics.status(f"{self.get_name()}: replay", level, text, values)]


NODE_CLASS = BagPlayerNode


def main() -> None:
    """Run the player to the end of the bag."""
    run_node(BagPlayerNode)


if __name__ == "__main__":
    main()
