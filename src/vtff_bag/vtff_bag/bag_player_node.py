"""Node `bag_player`: replays a bag, paced by the wall clock, by steps or by a live /clock."""

from __future__ import annotations

import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from vtff_bag.file.errors import BagError
from vtff_bag.file.reader import BagReader
from vtff_bag.player.messages_in_order import CLOCK_TOPIC, Replay, ReplaySelection, select_topics
from vtff_bag.player.player_parameters import BagPlayerParameters
from vtff_bag.player.replay_publishers import LATEST_STAMP, ReplayPublishers
from vtff_bag.player.step_replay import StepReplay
from vtff_msgs.srv import Seek, SetRate
from vtff_node import diagnostics
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import ParameterError
from vtff_node.stamps import to_nanoseconds
from vtff_node.start.listeners import DIAGNOSTICS_TOPIC

POLL_INTERVAL = 0.001  # s of wall time between looks at what is due
STATE_INTERVAL = 0.2  # s of wall time between messages on ~/state


class BagPlayerNode(VtffNode):
    """Replay a bag: every message once, in order, its bytes and quality of service unchanged.

    Publishes the recorded topics and, where no recorded /clock is replayed, /clock before each
    message. With pacing wall it also publishes ~/state (diagnostic_msgs/DiagnosticStatus) and
    offers ~/pause, ~/resume and ~/step (std_srvs/Trigger), ~/seek and ~/set_rate (vtff_msgs). With
    pacing steps it takes the place of the simulator: topics that the nodes under test publish are
    not replayed, and each step waits until these nodes have acknowledged the step before on
    /sim/step_done. With pacing clock each message waits for the /clock of another node.
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
        self.replay: Replay | None = None
        self._step_replay: StepReplay | None = None
        self._replay_publishers: ReplayPublishers | None = None
        self._warned_notes = 0
        self._warn_of_damage()
        for line in self.selection.skipped:
            self.get_logger().warning(line)
        self._begins_at = time.monotonic()
        {"wall": self._pace_by_wall, "steps": self._pace_by_steps, "clock": self._pace_by_clock}[
            given.pacing
        ]()

    # ---- pacing ------------------------------------------------------------------------------

    def _pace_by_wall(self) -> None:
        given: BagPlayerParameters = self.parameters
        publishers = self._replay_publishers = self._make_publishers()
        try:
            self.replay = Replay(
                self.reader,
                self.selection.topics,
                publishers.publish,
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

    def _make_publishers(self) -> ReplayPublishers:
        """Make the publishers of a replay by the wall clock, with /clock where it is wanted."""
        wants_clock = self.parameters.publish_clock
        if wants_clock and self.reader.end_time > LATEST_STAMP:
            self.get_logger().warning("no /clock: the bag has times after 2038")
            wants_clock = False
        has_clock = wants_clock and not self.selection.has_clock
        return ReplayPublishers(
            self, self.selection, publishes_clock=has_clock, clock_from_messages=has_clock
        )

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
        self._step_replay = StepReplay(self, self.reader, self.parameters)

    def _pace_by_clock(self) -> None:
        # Another node's /clock paces: the recorded /clock must not contradict it.
        topics = {n: t for n, t in self.selection.topics.items() if n != CLOCK_TOPIC}
        self.selection = ReplaySelection(topics, self.selection.skipped)
        self._replay_publishers = ReplayPublishers(self, self.selection, is_lockstep=self.lockstep)
        self._messages = self.reader.raw_messages(list(topics))
        self._next_message = next(self._messages, None)
        self.subscribe(Clock, CLOCK_TOPIC, self._on_clock)

    def _on_clock(self, message: Clock) -> None:
        started = time.perf_counter()
        now = to_nanoseconds(message.clock)
        assert self._replay_publishers is not None
        while self._next_message is not None and self._next_message.log_time <= now:
            self._replay_publishers.publish(self._next_message)
            self._next_message = next(self._messages, None)
        self.acknowledge_step(message.clock, started)

    # ---- services ----------------------------------------------------------------------------

    def _create_services(self) -> None:
        self.create_service(Trigger, "~/pause", self._on_pause)
        self.create_service(Trigger, "~/resume", self._on_resume)
        self.create_service(Trigger, "~/step", self._on_step)
        self.create_service(Seek, "~/seek", self._on_seek)
        self.create_service(SetRate, "~/set_rate", self._on_set_rate)

    def pause(self) -> None:
        """Stop the replay until `resume`."""
        assert self.replay is not None
        self._waits_to_begin = False
        self.replay.pause()

    def resume(self) -> None:
        """Continue the replay."""
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

    def _warn_of_damage(self) -> None:
        """Log the defects of the bag that are new; some show only when a part of it is read."""
        for note in self.reader.notes[self._warned_notes :]:
            self.get_logger().warning(note)
        self._warned_notes = len(self.reader.notes)

    def on_stop(self) -> None:
        """Log the defects that the last messages have shown."""
        self._warn_of_damage()

    def _position(self) -> float:
        return self.replay.position if self.replay is not None else 0.0

    def _publish_state(self) -> None:
        self._warn_of_damage()
        self._state_publisher.publish(self.health()[0])
        assert self.replay is not None
        self.report_progress(self.replay.position, self.replay.duration)

    def publish_reports(self, reports: list[DiagnosticStatus]) -> None:
        """Publish reports, unless recorded /diagnostics are replayed."""
        publishers = self._current_publishers()
        if publishers is None or DIAGNOSTICS_TOPIC not in publishers.topics:
            super().publish_reports(reports)

    def _current_publishers(self) -> ReplayPublishers | None:
        return (
            self._replay_publishers if self._step_replay is None else self._step_replay.publishers
        )

    def health(self) -> list[DiagnosticStatus]:
        """Report the position and the state of the replay."""
        publishers = self._current_publishers()
        sent = 0 if publishers is None else publishers.sent
        values: dict[str, Any] = {"bag": self.reader.path, "messages sent": sent}
        level, text = diagnostics.OK, "playing"
        if self.replay is not None:
            values["position, s"] = f"{self.replay.position:.3f}"
            values["duration, s"] = f"{self.replay.duration:.3f}"
            values["start, ns since 1970"] = self.reader.start_time
            values["rate"] = f"{self.replay.rate:g}"
            text = "paused" if self.replay.paused else "playing"
        elif self._step_replay is not None:
            level, text = self._step_replay.health()
        return [diagnostics.status(f"{self.get_name()}: replay", level, text, values)]


NODE_CLASS = BagPlayerNode


def main() -> None:
    """Run the player to the end of the bag."""
    run_node(BagPlayerNode)


if __name__ == "__main__":
    main()
