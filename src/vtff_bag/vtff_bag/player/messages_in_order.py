"""Replay of a bag without ROS: its topics, and the order and time of its messages."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Collection, Iterator

from vtff_bag.file.errors import BagReadError, UnknownTypeError
from vtff_bag.file.message_definitions import (
    first_field_type,
    installed_type_hash,
    message_class,
)
from vtff_bag.file.metadata import TopicInformation
from vtff_bag.file.reader import BagReader, RawMessage
from vtff_bag.file.stamps import CLOCK_TYPE, leading_stamp
from vtff_bag.player.replay_clock import ReplayClock
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND

CLOCK_TOPIC = "/clock"
SERIALIZATION_FORMAT = "cdr"

#: A message is due when the replay is this near to its time, so that rounding delays no message.
_TOLERANCE_NANOSECONDS = 1_000


@dataclasses.dataclass(frozen=True)
class ReplaySelection:
    """The topics of a bag that are replayed.

    Attributes
    ----------
    topics
        Topics to replay, by name.
    skipped
        One line for each wanted topic that cannot be replayed, with the reason.
    """

    topics: dict[str, TopicInformation]
    skipped: tuple[str, ...]

    @property
    def has_clock(self) -> bool:
        """Whether the recorded /clock is among the topics."""
        return CLOCK_TOPIC in self.topics


def select_topics(
    reader: BagReader, wanted: Collection[str] = (), excluded: Collection[str] = ()
) -> ReplaySelection:
    """Choose the topics of a bag that are replayed.

    Parameters
    ----------
    reader
        The bag.
    wanted
        Full names of the topics to replay; all if empty.
    excluded
        Full names of topics to leave out.

    Raises
    ------
    BagReadError
        If a wanted topic is not in the bag.
    """
    for name in wanted:
        if name not in reader.topics:
            present = ", ".join(sorted(reader.topics)) or "none"
            raise BagReadError(f"{reader.path}: no topic '{name}' in the bag; topics: {present}")
    topics: dict[str, TopicInformation] = {}
    skipped = []
    for name, topic in sorted(reader.topics.items()):
        if name in excluded or (wanted and name not in wanted):
            continue
        reason = _find_reason_to_skip(topic)
        if reason:
            skipped.append(f"{name} is skipped ({topic.message_count} messages): {reason}")
        else:
            topics[name] = topic
    return ReplaySelection(topics, tuple(skipped))


def _find_reason_to_skip(topic: TopicInformation) -> str:
    """Return why a topic cannot be replayed; empty if it can."""
    if topic.serialization_format != SERIALIZATION_FORMAT:
        return f"its messages are '{topic.serialization_format}', not {SERIALIZATION_FORMAT}"
    try:
        message_class(topic.type)
        installed = installed_type_hash(topic.type)
    except UnknownTypeError as error:
        return str(error)
    if topic.type_hash and installed and topic.type_hash != installed:
        return f"'{topic.type}' was recorded with another definition than is installed"
    return ""


class Replay:
    """Publishes the messages of a bag at their times, each once and in order.

    Parameters
    ----------
    reader
        The bag.
    topics
        Names of the topics to replay.
    publish
        Function that publishes a message; called when the message is due.
    start_offset
        Start of the replay, s after the first message of the bag.
    rate
        Recorded seconds per second of wall time.
    loop
        Begin again at `start_offset` when the end is reached.
    paused
        Wait for `resume` or `step`.
    steady_clock
        Wall time in s.

    Raises
    ------
    ValueError
        If `start_offset` lies outside the bag or `rate` outside its range.
    """

    def __init__(
        self,
        reader: BagReader,
        topics: Collection[str],
        publish: Callable[[RawMessage], None],
        *,
        start_offset: float = 0.0,
        rate: float = 1.0,
        loop: bool = False,
        paused: bool = False,
        steady_clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._reader = reader
        self._topics = list(topics)
        self._publish = publish
        self._loop = loop
        self._steady_clock = steady_clock
        self._start = self._find_time(start_offset)
        self._clock = ReplayClock(self._start, rate, paused=paused, steady_clock=steady_clock)
        self._messages: Iterator[RawMessage] = iter(())
        self._next: RawMessage | None = None
        self.published = 0
        self._open(self._start)

    @property
    def duration(self) -> float:
        """Recorded time between first and last message of the bag, s."""
        return (self._reader.end_time - self._reader.start_time) / NANOSECONDS_PER_SECOND

    @property
    def position(self) -> float:
        """Current time of the replay, s after the first message of the bag."""
        now = min(max(self._clock.now(), self._reader.start_time), self._reader.end_time)
        return (now - self._reader.start_time) / NANOSECONDS_PER_SECOND

    @property
    def rate(self) -> float:
        """Recorded seconds per second of wall time."""
        return self._clock.rate

    @property
    def paused(self) -> bool:
        """Whether the replay stands still."""
        return self._clock.paused

    @property
    def finished(self) -> bool:
        """Whether the last message has been published; never in a loop."""
        return self._next is None

    def advance(self, budget: float = 0.05) -> None:
        """Publish the messages that are due, for about `budget` s of wall time at most.

        Messages that are left then stay due, so that the caller can do other work in between.
        """
        if self.paused:
            return
        deadline = self._steady_clock() + budget
        # The clock is read again for each message, because a loop sets it back.
        while (
            self._next is not None
            and self._next.log_time <= self._clock.now() + _TOLERANCE_NANOSECONDS
        ):
            self._publish_next()
            if self._steady_clock() >= deadline:
                return

    def pause(self) -> None:
        """Stop the replay until `resume`."""
        self._clock.pause()

    def resume(self) -> None:
        """Continue the replay."""
        self._clock.resume()

    def step(self) -> RawMessage | None:
        """Publish the next message, even before it is due, and pause at its time.

        Returns
        -------
        RawMessage or None
            The published message; None at the end of the bag.
        """
        message = self._next
        if not self.paused:
            self.pause()
        if message is None:
            return None
        self._clock.jump(max(self._clock.now(), message.log_time))
        self._publish_next()
        return message

    def set_rate(self, rate: float) -> None:
        """Change the rate.

        Raises
        ------
        ValueError
            If the rate is outside its range.
        """
        self._clock.set_rate(rate)

    def seek(self, offset: float) -> None:
        """Go to a time; the next message is the first message at or after it.

        Parameters
        ----------
        offset
            The time, s after the first message of the bag.

        Raises
        ------
        ValueError
            If the time lies outside the bag.
        """
        target = self._find_time(offset)
        self._clock.jump(target)
        self._open(target)

    def _find_time(self, offset: float) -> int:
        if not 0.0 <= offset <= self.duration:
            raise ValueError(
                f"offset {offset:g} s lies outside the bag, which lasts {self.duration:.3f} s"
            )
        return self._reader.start_time + round(offset * NANOSECONDS_PER_SECOND)

    def _open(self, start: int) -> None:
        self._messages = self._reader.raw_messages(self._topics, start=start)
        self._next = next(self._messages, None)

    def _publish_next(self) -> None:
        message = self._next
        assert message is not None
        self._publish(message)
        self.published += 1
        self._next = next(self._messages, None)
        if self._next is None and self._loop:
            # The clock goes back as well, but a paused replay stays paused.
            self._clock.jump(self._start)
            self._open(self._start)


@dataclasses.dataclass(frozen=True)
class ReplayStep:
    """Messages that are published in one step of lockstep.

    Attributes
    ----------
    stamp
        Stamp of the step, which the participants acknowledge, ns since 1970.
    messages
        Messages of the step in order of log time; without /clock.
    """

    stamp: int
    messages: tuple[RawMessage, ...]


def replay_steps(
    reader: BagReader, topics: Collection[str], step_topic: str
) -> Iterator[ReplayStep]:
    """Divide a recording into the steps of lockstep.

    Each stamp on `step_topic` is one step. The step holds the messages that were logged after the
    stamp before and up to its own stamp: as in a run, the samples within a second travel in the
    step that ends this second. Messages after the last stamp belong to no step and are left out,
    because no node would acknowledge them.

    Parameters
    ----------
    reader
        The bag.
    topics
        Names of the topics to replay; the topic of the steps and /clock may be among them.
    step_topic
        Topic whose messages begin with a stamp.

    Raises
    ------
    BagReadError
        If the bag has no message on `step_topic`, or its messages begin with no stamp.
    """
    stamps = step_stamps(reader, step_topic)
    messages = reader.raw_messages([name for name in topics if name != CLOCK_TOPIC])
    following = next(messages, None)
    for stamp in stamps:
        messages_of_step = []
        while following is not None and following.log_time <= stamp:
            messages_of_step.append(following)
            following = next(messages, None)
        yield ReplayStep(stamp, tuple(messages_of_step))


def step_stamps(reader: BagReader, step_topic: str) -> list[int]:
    """Return the distinct stamps of a topic in ascending order, ns since 1970.

    Raises
    ------
    BagReadError
        If the bag has no message on the topic, or its messages begin with no stamp.
    """
    topic = reader.topics.get(step_topic)
    if topic is None or not topic.message_count:
        raise BagReadError(f"{reader.path}: no messages on '{step_topic}', which paces the steps")
    if topic.type != CLOCK_TYPE and first_field_type(topic.type) != "std_msgs/Header":
        raise BagReadError(
            f"{reader.path}: '{step_topic}' ({topic.type}) cannot pace steps: "
            "its messages begin with no stamp"
        )
    return sorted({leading_stamp(raw.serialized) for raw in reader.raw_messages([step_topic])})
